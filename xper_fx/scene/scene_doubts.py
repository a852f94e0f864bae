# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene may not mean: told once, as a warning, before the first step.

Each of these has a meaning, so that it is no error; most often it is a slip.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.bodies.meshes import cell_measure, facet_cells, facet_geometry_nodes, midpoints_of
from xper_fx.forms.loads import SurfaceTraction
from xper_fx.nscd.laws.parameters import fields_of
from xper_fx.support.compat import geometry_dofmap

if TYPE_CHECKING:
    from xper_fx.nscd.laws.law import Law
    from xper_fx.scene.scene import Scene
    from xper_fx.scene.wall import Wall
    from xper_fx.support.ranks import Ranks

logger = logging.getLogger(__name__)

# Depth behind a wall beside the length of a facet, and stiffness of bonds beside that of their
# bodies, at which a scene is doubted.
_BEHIND, _SOFT = 1e-3, 0.1
# Speed (m/s) that no wave in a solid reaches, and a step beside the time in which a wave crosses
# the smallest body.
_FASTEST, _SHORTEST = 1e5, 1e-5
# Densities of solids in t/mm^3: with stresses in MPa the fastest wave is in mm/s.
_TONNES = 1e-10, 3e-8
# Momentum of grains in a cell, beside that of each, that is rounding.
_STILL = 1e-9


def tell_doubts(scene: Scene, step: float | None, team: Ranks) -> None:
    """Warn of what is doubted, on the first rank; of a mesh that is spread, where most is.

    Args:
        scene, step: as in `scene_doubts`.
        team: the ranks that simulate it, which call it together.
    """
    spread = scene.bodies is not None and scene.bodies.spread is not None
    doubts = list(scene_doubts(scene, step)) if spread or team.rank == 0 else []
    if spread:
        doubts = max(team.comm.allgather(doubts), key=len)
    for doubt in doubts if team.rank == 0 else ():
        logger.warning("%s", doubt)


def scene_doubts(scene: Scene, step: float | None) -> Iterator[str]:
    """Sentences that say what is doubted and what to do.

    Args:
        scene: checked.
        step: h (s) that is asked for, None if it is picked.
    """
    if scene.rigid_bodies is not None:
        yield from _degrees(scene)
        if scene.joints and scene.after is None:
            yield from _parting_joints(scene)
        if scene.lattice is not None and scene.macroscopic is not None:
            yield from _drift(scene)
    if scene.bodies is not None and scene.bodies.num_bodies:  # else all are on other ranks
        for wall in scene.walls:
            yield from _wall_doubts(scene, wall)
        yield from _tractions_in_cracks(scene)
        if scene.surfaces:
            from xper_fx.scene.mesh_overlaps import mesh_overlaps

            yield from mesh_overlaps(scene)
        yield from _units(scene, step)
        yield from _soft_bonds(scene)
        yield from _long_bonds(scene)


def _degrees(scene: Scene) -> Iterator[str]:
    """Angles that were hardly meant in radians."""
    bodies = scene.rigid_bodies
    if bodies.dim != 2:
        return
    large = np.flatnonzero(np.abs(bodies.rotation) > 2.0 * np.pi)
    if len(large):
        yield (
            f"the angle of rigid body {large[0]} is {bodies.rotation[large[0]]:g} rad, more than a "
            f"turn ({len(large)} such in all); angles are in radians: numpy.deg2rad(degrees)"
        )


def _parting_joints(scene: Scene) -> Iterator[str]:
    """Bodies that move at the start as a joint between them does not allow."""
    from xper_fx.scene.joints import parting_joint

    parting = parting_joint(scene.joints, scene.rigid, scene.rigid_bodies)
    if parting is not None:
        joint, speed = parting
        yield (
            f"the bodies of joint {joint}, a {type(scene.joints[joint]).__name__}, part at "
            f"{speed:.3g} m/s or rad/s at the start: the first step stops that as an impact does; "
            "give them velocities and spins that the joint allows"
        )


def _drift(scene: Scene) -> Iterator[str]:
    """A fluctuation with a mean, which a cell that deforms carries along and changes."""
    bodies = scene.rigid_bodies
    momentum = np.linalg.norm(bodies.mass @ bodies.velocity)
    if momentum > _STILL * (bodies.mass @ np.linalg.norm(bodies.velocity, axis=1)):
        mean = [float(f"{v:.4g}") for v in bodies.mass @ bodies.velocity / bodies.mass.sum()]
        yield (
            f"the grains of the periodic cell have the mean velocity {mean} m/s, which adds to the "
            "stress and changes as the cell deforms; take it from all `velocity`"
        )


def _wall_doubts(scene: Scene, wall: Wall) -> Iterator[str]:
    """A wall that looks away from its facets, or that they are in."""
    mesh = scene.bodies.mesh
    cells, local = (each[:, 0] for each in facet_cells(mesh))
    facets = scene.bodies.facet_tags.find(wall.facets)
    if not len(facets):  # all are on other ranks
        return
    nodes = facet_geometry_nodes(mesh, cells[facets], local[facets])
    x, dim = mesh.geometry.x, scene.dim
    normal = np.asarray(wall.normal, float) / np.linalg.norm(wall.normal)
    out = midpoints_of(x, nodes) - midpoints_of(x, geometry_dofmap(mesh)[cells[facets]])
    if np.all(out[:, :dim] @ normal > 0.0):
        yield (
            f"all facets of tag {wall.facets} look along the normal {tuple(wall.normal)} of their "
            "wall; it should point out of the obstacle, towards the bodies: turn it round"
        )
        return
    depth = -float(((x[nodes][..., :dim] - np.asarray(wall.point, float)) @ normal).min())
    if depth > _BEHIND * np.ptp(x[nodes], axis=1).max():
        yield (
            f"facets of tag {wall.facets} lie up to {depth:.3g} m inside of their wall at the "
            "start; move the bodies or the wall"
        )


def _tractions_in_cracks(scene: Scene) -> Iterator[str]:
    """Tractions on both lips between two bodies."""
    between = {tag for *_, tag in scene.bodies.present.facing}
    for load in scene.loads:
        if isinstance(load, SurfaceTraction) and load.facets in between:
            yield (
                f"a SurfaceTraction is on facet tag {load.facets} between bodies: the same vector "
                "acts on both lips; tag outer facets if that is not meant"
            )


def _body_sizes(scene: Scene) -> np.ndarray:
    """Volume^(1/dim) of each body, shape (num_bodies,), m."""
    mesh = scene.bodies.mesh
    volume = cell_measure(mesh.topology.cell_name(), mesh.geometry.x[geometry_dofmap(mesh)])
    return np.bincount(scene.bodies.body_of_cell, volume) ** (1.0 / scene.dim)


def _units(scene: Scene, step: float | None) -> Iterator[str]:
    """Waves faster than in any solid, or a step in which they go nowhere."""
    elastic = {t: m for t, m in scene.materials.items() if hasattr(m, "young")}
    speeds = {t: float(np.max(m.young) / m.density) ** 0.5 for t, m in elastic.items()}
    if not speeds:
        return
    tag = max(speeds, key=speeds.get)
    material = elastic[tag]
    in_millimetres = _TONNES[0] < material.density < _TONNES[1]
    if speeds[tag] > _FASTEST * (1e3 if in_millimetres else 1.0):
        yield (
            f"waves in the material of cell tag {tag} go at {speeds[tag]:.2g} m/s, as its young is "
            f"{np.max(material.young):.3g} Pa and its density {material.density:.3g} kg/m^3; look "
            "at the units"
        )
        return
    way = np.inf if step is None else step * min(speeds.values())
    # bodies are no larger than all of them
    if way > _SHORTEST * np.ptp(scene.bodies.mesh.geometry.x, axis=0).max():
        return
    size = float(_body_sizes(scene).min())
    if way < _SHORTEST * size:
        crossing = size / min(speeds.values())
        yield (
            f"the step of {step:.3g} s is short beside the {crossing:.3g} s that a wave takes "
            f"through the smallest body, {size:.3g} m wide; look at the units"
        )


def _laws_between_bodies(scene: Scene) -> list[Law | None]:
    """The laws of facing facets, as the scene was given them."""
    given = (*scene.interactions.values(), *scene.facet_interactions.values())
    return [*given, scene.default_interaction]


def _long_bonds(scene: Scene) -> Iterator[str]:
    """Bonds that would have to open farther than all bodies are wide before they break."""
    width = float(np.linalg.norm(np.ptp(scene.bodies.mesh.geometry.x, axis=0)))
    for law in _laws_between_bodies(scene):
        if fields_of(law) or not hasattr(law, "fracture_energy") or not hasattr(law, "strength"):
            continue
        if law.fracture_energy > law.strength * width:
            yield (
                f"a {type(law).__name__} of {law.strength:.3g} Pa and {law.fracture_energy:.3g} "
                f"J/m^2 would open by {law.fracture_energy / law.strength:.2g} m or more before it "
                f"breaks, and all bodies are {width:.2g} m wide; look at the units, and whether "
                "one stands in the place of the other"
            )


def _has_known_stiffness(law: Law | None) -> bool:
    """Whether a law is one of bonds whose parameters are numbers."""
    return hasattr(law, "stiffnesses") and not fields_of(law)


def _soft_bonds(scene: Scene) -> Iterator[str]:
    """Cohesive laws softer than the bodies that they join."""
    given = [law for law in _laws_between_bodies(scene) if _has_known_stiffness(law)]
    moduli = [np.max(m.young) for m in scene.materials.values() if hasattr(m, "young")]
    if not given or not moduli or not len(scene.bodies.facets):
        return
    # bodies are as large as their facets
    shortest = float(scene.bodies.facets.measure.min()) ** (1.0 / (scene.dim - 1))
    if min(law.stiffnesses()[0] for law in given) * shortest > _SOFT * min(moduli):
        return
    size = _body_sizes(scene)
    laws, law_of_facet = scene.law_of_facet()
    suspects = [i for i, law in enumerate(laws) if _has_known_stiffness(law)]
    for number in suspects:
        joined = scene.bodies.facets.bodies[law_of_facet == number]
        if not len(joined):
            continue
        length, stiffness = float(size[joined].max()), laws[number].stiffnesses()[0]
        if stiffness * length < _SOFT * min(moduli):
            yield (
                f"the normal_stiffness {stiffness:.3g} Pa/m of a cohesive law is soft: over its "
                f"bodies of up to {length:.3g} m that is {stiffness * length:.3g} Pa beside a "
                f"Young's modulus of {min(moduli):.3g} Pa, so that bonds decide the stiffness of "
                "the whole; look at the units, or take some 10 E / size"
            )
