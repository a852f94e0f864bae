# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of many kinds at finite strain have one history, in whatever axes they are seen.

The whole scene is turned, loads, gravity, walls and velocities with it, by 37 degrees (3D: by 60
about a diagonal), or moves steadily, where no wall stands still.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from scenes import LEFT, RIGHT, field, mesh_of, nodes, run, side_tags, unmatched_plates

from xper_fx.bodies.explode import EACH_CELL, explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import tag_cells
from xper_fx.forms.loads import Gravity, SurfaceTraction
from xper_fx.materials import J2FiniteStrain, NeoHookean, SaintVenantKirchhoff, Voce
from xper_fx.nscd.laws import CohesiveZone, MixedMode, RigidCohesiveZone, SignoriniCoulomb
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.scene.tie import Tie
from xper_fx.scene.wall import Wall
from xper_fx.simulation.simulation import Simulation

ANGLE = np.radians(37.0)
TURNS = {
    2: np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]]),
    3: np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0,
}
SOFT, STIFF = NeoHookean(100.0, 0.3, 1.0), SaintVenantKirchhoff(150.0, 0.3, 1.2)


class Axes(NamedTuple):
    """In which a scene is seen.

    Attributes:
        R: turns the scene.
        wind: velocity of all that moves (m/s).
    """

    R: np.ndarray
    wind: np.ndarray

    def turn(self, mesh) -> None:
        """Turn a mesh."""
        dim = len(self.R)
        mesh.geometry.x[:, :dim] = mesh.geometry.x[:, :dim] @ self.R.T

    def velocity(self, own):
        """An initial velocity from that in the scene's own axes."""
        dim = len(self.R)
        return lambda x: self.R @ np.array(own(self.R.T @ x[:dim])) + self.wind[:, None]

    def of(self, *components) -> tuple[float, ...]:
        """Components of a vector."""
        return tuple(self.R @ np.array(components))


def falling(axes, cells=(2, 1, 1), **options):
    """A ductile box of cells, torn as it falls askew on a wall that it slides on."""
    lengths = (2.0, 1.0, 1.0)
    mesh = mesh_of(lengths, cells, "tetrahedron")
    tags = side_tags(mesh, lengths)
    axes.turn(mesh)
    wall = Wall(LEFT, axes.of(-0.02, 0.0, 0.0), axes.of(1.0, 0.0, 0.0), SignoriniCoulomb(0.3))
    scene = Scene(
        explode(mesh, EACH_CELL, None, tags),
        {1: J2FiniteStrain(100.0, 0.3, 1.5, Voce(0.5, 5.0, 1.0), 1.0)},
        default_interaction=CohesiveZone(1000.0, 0.3, 4.0, 400.0, friction=0.2),
        walls=[wall],
        loads=[
            Gravity(axes.of(-1.0, 0.5, 0.0)),
            SurfaceTraction(RIGHT, axes.of(-3.0, 1.0, 0.5)),
        ],
        initial_velocity=axes.velocity(
            lambda x: [-1.0 + 0.2 * x[1], 0.5 + 0.0 * x[0], 0.4 * x[0] - 0.3 * x[1]]
        ),
    )
    return Simulation(scene, **options)


def tied(axes, bond, **options):
    """Plates whose nodes do not match, bonded, that a spin tears."""
    joined = unmatched_plates()
    axes.turn(joined.mesh)
    scene = Scene(
        explode(joined.mesh, joined.part, facet_tags=joined.facet_tags),
        {1: SOFT},
        ties=[Tie(8, 7, bond)],
        initial_velocity=axes.velocity(lambda x: [1.5 * (x[0] > 1.0) - 2.0 * x[1], 2.0 * x[0]]),
        points="gauss",
    )
    return Simulation(scene, **options)


def meeting(dim, axes, mirrored=False, **options):
    """Blocks of cells that fly at each other and break; contacts are searched.

    They are unlike, and meet askew; or each is the mirror image of the other, and their own, so
    that cells which enter their neighbours could leave by either of two sides.
    """
    kind, cells = ("crossed", (2, 1)) if dim == 2 else ("tetrahedron", (1, 1, 1))
    cells = (1,) * dim if mirrored else cells
    meshes = [mesh_of((1.0,) * dim, n, kind) for n in (cells, (1,) * dim)]
    meshes[1].geometry.x[:, :dim] += [1.02, 0.0 if mirrored else 0.23, 0.17][:dim]
    joined = join_meshes(meshes)
    tags = tag_cells(joined.mesh, {2: lambda x: x[0] > 1.0 + 1e-9})
    axes.turn(joined.mesh)
    law, swirl = SignoriniCoulomb(0.3), 0.0 if mirrored else 1.0
    scene = Scene(
        explode(joined.mesh, EACH_CELL, tags),
        {1: SOFT, 2: SOFT if mirrored else STIFF},
        default_interaction=CohesiveZone(1000.0, 0.02, 5.0),
        surfaces={"a": (1,), "b": (2,)},
        contacts=[Contact(pair, law) for pair in (("a", "b"), ("a", "a"), ("b", "b"))],
        initial_velocity=axes.velocity(
            lambda x: [
                1.5 * np.where(x[0] > 1.01, -1.0, 1.0),
                0.5 * swirl * x[0],
                0.2 * swirl * x[1],
            ][:dim]
        ),
    )
    return Simulation(scene, **options)


def torn(dim, axes, bond, order=1, points="nodal", kind=None, **options):
    """A box of cells that a field of velocities tears and turns."""
    lengths, cells = (2.0, 1.0, 1.0)[:dim], (2, 1, 1)[:dim]
    mesh = mesh_of(lengths, cells, kind or ("crossed" if dim == 2 else "tetrahedron"))
    axes.turn(mesh)

    def velocity(x):
        return [1.2 * np.sin(2.0 * x[0]) - x[1], x[0] + 0.3 * x[1], 0.4 * x[0] * x[1]][:dim]

    scene = Scene(
        explode(mesh, EACH_CELL),
        {1: STIFF},
        default_interaction=bond,
        initial_velocity=axes.velocity(velocity),
        order=order,
        points=points,
    )
    return Simulation(scene, **options)


def implicit(theta=0.5, **options):
    return {"step": 0.01, "scheme": "implicit", "theta": theta, "newton_tolerance": 1e-13} | options


EXPLICIT = {"scheme": "explicit"}
RIGID = RigidCohesiveZone(0.3, 4.0, friction=0.3)
ELASTIC = CohesiveZone(1000.0, 0.3, 5.0, 300.0)
MODES = MixedMode(1000.0, (5.0, 7.0), (0.3, 0.5), 2.0, tangential_stiffness=600.0)
# Dimension, what makes the scene, its arguments.
SCENES = {
    "ductile cells, wall, explicit": (3, falling, EXPLICIT),
    "ductile cells, wall, theta 1": (3, partial(falling, cells=(1, 1, 1)), implicit(1.0)),
    "tie, explicit": (2, partial(tied, bond=ELASTIC), EXPLICIT),
    "tie, modes apart, theta 1": (2, partial(tied, bond=MODES), implicit(1.0)),
    "searched contact, explicit": (2, partial(meeting, 2), EXPLICIT),
    "searched contact in 3D, explicit": (3, partial(meeting, 3), EXPLICIT),
    "searched contact, mirrored, explicit": (2, partial(meeting, 2, mirrored=True), EXPLICIT),
    "searched contact, implicit": (2, partial(meeting, 2), implicit()),
    "initially rigid bonds, explicit": (2, partial(torn, 2, bond=RIGID), EXPLICIT),
    "initially rigid bonds in 3D, explicit": (3, partial(torn, 3, bond=RIGID), EXPLICIT),
    "initially rigid bonds, implicit": (2, partial(torn, 2, bond=RIGID), implicit()),
    "quadratic cells, theta 3/4": (
        2, partial(torn, 2, bond=ELASTIC, order=2, points="gauss"), implicit(0.75),
    ),
    "hexahedra, explicit": (3, partial(torn, 3, bond=ELASTIC, kind="hexahedron"), EXPLICIT),
}  # fmt: skip
FAST = ("ductile cells, wall, explicit", "tie, explicit", "initially rigid bonds, explicit",
        "initially rigid bonds in 3D, explicit", "hexahedra, explicit")  # fmt: skip
LONG = ("ductile cells, wall, theta 1", *(name for name in SCENES if "searched" in name))
LOSSES = ("cohesion", "friction", "impact")
ENERGIES = ("elastic", "cohesive", *(f"dissipated_{loss}" for loss in LOSSES))


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in FAST else pytest.mark.slow) for n in SCENES]
)
def test_one_history(name, figure):
    """Positions in the scene's own axes, and energies that no motion of all adds to."""
    dim, make, options = SCENES[name]
    loose = dim == 3 or "rigid" in name or "searched" in name
    options = {"tolerance": 1e-10 if loose else 1e-12} | options
    still, wind = np.zeros(dim), np.array([0.7, -0.4, 0.5])[:dim]
    seen = {"plain": Axes(np.eye(dim), still), "turned": Axes(TURNS[dim], still)}
    if "wall" not in name:
        seen["moving"] = Axes(np.eye(dim), wind)
    found = {}
    for how, axes in seen.items():
        simulation = make(axes, num_threads=1, **options)
        record = run(simulation, 6 if name in LONG else 16)[-1]
        place = nodes(simulation) + field(simulation) - axes.wind * record.time
        found[how] = place @ axes.R, np.array([record.energies[e] for e in ENERGIES])
    plain = found.pop("plain")
    assert record.energies["dissipated_cohesion"] > 0.01
    if "search" in name:
        assert record.energies["dissipated_friction"] > 0.01
    for how, (place, energies) in found.items():
        apart, changed = np.abs(place - plain[0]).max(), np.abs(energies - plain[1]).max()
        figure(f"frame indifference: {name}", f"{how}, displacement < 1e-9", apart)
        assert apart < 1e-9
        assert changed < 1e-9
