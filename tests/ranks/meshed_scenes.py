# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of meshed bodies, run by all ranks together; the first writes what came out."""

import sys
from dataclasses import fields, replace

import numpy as np
import scenes
from dolfinx.mesh import compute_midpoints, create_mesh, meshtags
from mpi4py import MPI
from outside_law import LinearSoftening
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies, midpoints, nodes

import xper_fx as xf
from xper_fx.bodies.explode import explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import crossed_rectangle, facet_cells, tag_facets
from xper_fx.forms.loads import Gravity, PrescribedVelocity, RayleighDamping
from xper_fx.materials import J2SmallStrain, LinearElastic, NeoHookean, SaintVenantKirchhoff
from xper_fx.materials.hardening import Linear
from xper_fx.nscd.laws import (
    CohesiveCurve,
    CohesiveZone,
    MixedMode,
    RigidCohesiveZone,
    RigidMixedMode,
    SignoriniCoulomb,
)
from xper_fx.nscd.laws.fields import Weibull
from xper_fx.output.field_series import point_coordinates
from xper_fx.output.fragments import Fragments, measure_fragments
from xper_fx.parallel.launch import run_together
from xper_fx.scene import Scene, Tie, Wall
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

# E = 1000, rho = 1, strength 10, cohesive length 0.5 of a side.
ELASTIC = LinearElastic(1000.0, 0.3, 1.0)
# What a table of fragments has for each.
PIECES = [
    field.name
    for field in fields(Fragments)
    if field.name not in ("time", "fragment", "first", "count")
]
BOND = CohesiveZone(2e4, 0.05, 10.0, friction=0.3)
CONTACT = SignoriniCoulomb(0.4)


def stretched(speed):
    """Motions of the left and right side and the velocity that they start with."""
    loads = [PrescribedVelocity(LEFT, 0, -speed), PrescribedVelocity(RIGHT, 0, speed)]
    return loads, lambda x: np.stack([speed * (2.0 * x[0] - 1.0), *np.zeros_like(x[1:])])


def quadrants(x):
    return 4 * (x[1] * 2.999).astype(int) + (x[0] * 3.999).astype(int)


def explicit():
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (6, 6))
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=BOND, loads=loads,
        initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-12}, 36


def scattered():
    """As `explicit`, bonds of other strength and energy from place to place."""
    scene, options, steps = explicit()
    bond = CohesiveZone(2e4, lambda x: 0.03 + 0.04 * x[1], lambda x: 8.0 + 4.0 * x[0])
    return replace(scene, default_interaction=bond), options, steps


def quadratic():
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (4, 4))
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=BOND, loads=loads, order=2,
        initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-12}, 40


def blocks():
    """Bodies of several cells of unlike size, finite strain, Gauss points."""
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (8, 6), label=quadrants)
    scene = Scene(
        bodies, {1: NeoHookean(1000.0, 0.3, 1.0)}, default_interaction=BOND, points="gauss",
        loads=loads, initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"step": 5e-4, "tolerance": 1e-9, "scheme": "implicit"}, 12


def fall():
    """Bonded blocks that fall on a wall."""
    bodies = box_bodies((1, 1), (8, 6), label=quadrants)
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=BOND,
        walls=[Wall(BOTTOM, (0.0, -1e-3), (0.0, 1.0), SignoriniCoulomb(0.0))],
        loads=[Gravity((0.0, -50.0))],
        initial_velocity=lambda x: np.stack([0.5 + 0.0 * x[0], -1.0 + 0.0 * x[0]]),
    )  # fmt: skip
    return scene, {"step": 5e-4, "tolerance": 1e-9, "scheme": "implicit"}, 12


def plastic():
    """Plasticity, damping and bonds, each quadrilateral a body."""
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (6, 5), kind="quadrilateral")
    material = J2SmallStrain(1000.0, 0.3, 6.0, Linear(50.0), 1.0)
    scene = Scene(
        bodies, {1: material}, default_interaction=BOND, loads=loads,
        damping=RayleighDamping(mass=0.5), initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"step": 5e-4, "tolerance": 1e-9, "scheme": "implicit"}, 14


def free():
    """Two halves that meet in flight, sliding along each other; nothing holds them."""
    halves = box_bodies((1, 1), (6, 6), label=lambda x: (x[0] > 0.5).astype(int) * 2 + (x[1] > 0.5))
    velocity = lambda x: np.stack([np.where(x[0] > 0.5, -1.0, 2.0), 3.0 * x[0]])  # noqa: E731
    scene = Scene(
        halves, {1: ELASTIC}, default_interaction=CONTACT, initial_velocity=velocity
    )  # fmt: skip
    return scene, {"step": 2e-3, "tolerance": 1e-11, "scheme": "implicit"}, 20


def unmatched(joined, planes):
    """Bodies of two meshes that meet at x = 0.5, their mesh on `scenes.COMM`.

    Args:
        planes: tag of the facets that have a point, by the test of the points; the right mesh's at
            x = 0.5 bear it plus 5.
    """
    mesh, comm = joined.mesh, scenes.COMM
    if comm.size > 1:
        cells = geometry_dofmap(mesh).astype(np.int64)
        x = mesh.geometry.x[:, : mesh.geometry.dim]
        if comm.rank:
            cells, x = cells[:0], x[:0]
        mesh = create_mesh(comm, cells=cells, x=x, e=mesh.ufl_domain())
    tdim = mesh.topology.dim
    on_right = midpoints(mesh)[0] > 0.5
    mesh.topology.create_entities(tdim - 1)
    cell = facet_cells(mesh)[0][:, 0]
    tags = tag_facets(mesh, planes)
    x = compute_midpoints(mesh, tdim - 1, tags.indices)[:, 0]
    values = tags.values + 5 * ((abs(x - 0.5) < 1e-9) & on_right[cell[tags.indices]])
    return mesh, meshtags(mesh, tdim - 1, tags.indices, values.astype(np.int32))


def tied(coarse=4, fine=6):
    """A coarse box of blocks and a fine one beside it, tied by bonds that turn, half by half."""
    loads, start = stretched(1.0)
    halves = [
        crossed_rectangle((first, 0.0), (first + 0.5, 1.0), (cells // 2, cells))
        for first, cells in ((0.0, coarse), (0.5, fine))
    ]
    mesh, tags = unmatched(
        join_meshes(halves),
        {LEFT: lambda x: x[0] < 1e-9, RIGHT: lambda x: x[0] > 1.0 - 1e-9,
         14: lambda x: (np.abs(x[0] - 0.5) < 1e-9) & (x[1] < 0.5 + 1e-9),
         24: lambda x: (np.abs(x[0] - 0.5) < 1e-9) & (x[1] > 0.5 - 1e-9)},
    )  # fmt: skip
    x, y = midpoints(mesh)[:2, : mesh.topology.index_map(2).size_local]
    label = 2 * np.where(x < 0.5, 4.0 * x, 6.0 * x).astype(int) + (y > 0.5)
    scene = Scene(
        explode(mesh, label, facet_tags=tags),
        {1: NeoHookean(1000.0, 0.3, 1.0)}, default_interaction=BOND, loads=loads,
        ties=[Tie(19, 14, replace(BOND, strength=8.0)), Tie(29, 24, BOND)],
        initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"step": 5e-4, "tolerance": 1e-10, "scheme": "implicit"}, 14


def strips():
    """Four strips whose bonds turn with them: of four ranks one has no points."""
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (8, 2), label=lambda x: (4.0 * x[0]).astype(int))
    scene = Scene(
        bodies, {1: NeoHookean(1000.0, 0.3, 1.0)}, default_interaction=BOND,
        loads=loads, initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"step": 5e-4, "tolerance": 1e-10, "scheme": "implicit"}, 10


def space():
    """Bonds whose damage lags."""
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1, 1), (2, 2, 2), kind="tetrahedron")
    bond = replace(BOND, viscosity=lambda x: 1e-4 * x[1])
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=bond, loads=loads, initial_velocity=start
    )
    return scene, {"step": 1e-3, "tolerance": 1e-10, "scheme": "implicit"}, 10


def uneven():
    """Random strengths a facet, arrays over facets and points, modes apart.

    It ends when rings of rubbing lips close at vertices. Impulses within such a ring are not
    unique, and its slip hangs on them.
    """
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (6, 6))
    strength, (place, count) = Weibull(10.0, 12.0, seed=2), bodies.facet_places()
    of_points = np.linspace(0.05, 0.06, 2 * count).reshape(count, 2)
    bond = MixedMode(
        2e4, (strength, 14.0), (of_points[place], np.linspace(0.07, 0.08, count)[place]), 2.0,
        friction=lambda x: 0.2 + 0.2 * x[0],
    )  # fmt: skip
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=bond, loads=loads,
        initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-12}, 20


def rigid():
    """Initially rigid bonds of random strengths, modes apart and viscous, a point on each facet."""
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (6, 6), label=quadrants)
    bond = RigidMixedMode(
        (Weibull(10.0, 12.0, seed=2), 14.0), (0.05, 0.05), 2.0, friction=0.3, viscosity=1.0
    )
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=bond, loads=loads,
        initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"step": 1e-3, "tolerance": 1e-10, "scheme": "implicit"}, 25


def splitting():
    """As `rigid`, but each cell a body and an explicit bulk: vertices that split, some driven."""
    loads, start = stretched(1.0)
    bodies = box_bodies((1, 1), (6, 6))
    bond = RigidCohesiveZone(Weibull(10.0, 12.0, seed=2), 5e-3, friction=0.3)
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=bond, loads=loads,
        initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 36


def burst():
    """Free cells that fly apart: which of the bonds at a vertex break hangs on their order."""
    bond = RigidCohesiveZone(lambda x: 0.08 * strength(x), 1e-4, friction=0.3)
    scene = Scene(
        box_bodies((1, 1), (6, 6)), {1: replace(ELASTIC, young=10.0)}, default_interaction=bond,
        initial_velocity=lambda x: 0.5 * (x[:2] - 0.5),
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 12


def strength(x):
    """Between 7 and 13 Pa, no two alike."""
    return 10.0 + 3.0 * np.sin(7.0 * x[0] + 3.3 * x[1]) * np.cos(5.0 * x[1] - x[0])


def notched(loads, start, size=6):
    """Cells at finite strain that initially rigid bonds join, but for a notch of contact."""
    notch = {7: lambda x: (np.abs(x[0] - 0.5) < 1e-9) & (x[1] < 0.334)}
    scene = Scene(
        box_bodies((1, 1), (size, size), interior=notch),
        {1: SaintVenantKirchhoff(1000.0, 0.3, 1.0)},
        default_interaction=RigidCohesiveZone(strength, 5e-3, friction=0.3),
        facet_interactions={7: CONTACT}, loads=loads, initial_velocity=start,
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 60


def pulled():
    """A notched plate drawn at all sides; couples of lips act on driven cells of other ranks."""
    loads, _ = stretched(0.5)
    loads += [PrescribedVelocity(BOTTOM, 1, -0.5), PrescribedVelocity(TOP, 1, 0.5)]
    return notched(loads, lambda x: 0.5 * (2.0 * x[:2] - 1.0), size=4)


def spun():
    """A notched plate that spins by a radian as it flies apart; nothing holds it."""
    return notched((), lambda x: np.stack([0.3 * x[0] - 9.0 * x[1], 9.0 * x[0] + 0.1 * x[1]]))


def dropped():
    """Cells that initially rigid bonds join fly apart on a wall that rubs, and under a roof."""
    scene = Scene(
        box_bodies((1, 1), (6, 6)), {1: ELASTIC},
        default_interaction=RigidCohesiveZone(Weibull(10.0, 12.0, seed=2), 0.05, friction=0.3),
        walls=[Wall(BOTTOM, (0.0, -3e-3), (0.0, 1.0), CONTACT),
               Wall(TOP, (0.0, 1.01), (0.0, -1.0), SignoriniCoulomb(lambda x: 0.2 + 0.2 * x[0]))],
        loads=[Gravity((1.0, -20.0))],
        initial_velocity=lambda x: np.stack([0.5 + 2.0 * x[0], 1.5 * x[1] - 1.0]),
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 36


def turning_dropped():
    """The same at finite strain, where what rounding leaves grows a thousandfold in ten steps."""
    scene, options, _ = dropped()
    bond = RigidCohesiveZone(strength, 0.05, friction=0.3)
    scene = replace(scene, default_interaction=bond, materials={1: NeoHookean(1000.0, 0.3, 1.0)})
    return scene, options, 24


def sound_dropped():
    """The same with bonds that are springs, until rings of rubbing lips close as in `uneven`."""
    scene, options, _ = dropped()
    return replace(scene, default_interaction=BOND), options | {"tolerance": 1e-12}, 24


def crushed():
    """One end is crushed so fast that lips there flip as bonds open; steps are cut."""
    end = lambda x: np.maximum(x[0] - 0.7, 0.0)  # noqa: E731
    scene, options, _ = notched((), lambda x: np.stack([-500.0 * end(x), 0.0 * x[0]]))
    return replace(scene, facet_interactions={}), options, 5


@xf.njit
def falling(x, strength, length):
    """Traction of an opening x."""
    return strength * np.exp(-x / length)


def own():
    """A law with kernels from outside the package."""
    scene, options, steps = explicit()
    return replace(scene, default_interaction=LinearSoftening(2e4, 10.0, 0.05)), options, steps


def own_curve():
    """A curve from outside the package whose strength is a field; bodies of several cells."""
    scene, options, steps = blocks()
    values = {"strength": lambda x: 10.0 + x[1], "length": 5e-3}
    bond = CohesiveCurve(falling, values, end=0.05, normal_stiffness=2e4, friction=0.3)
    return replace(scene, default_interaction=bond), options, steps


SCENES = {
    f.__name__: f
    for f in (
        explicit,
        scattered,
        quadratic,
        blocks,
        fall,
        plastic,
        free,
        tied,
        strips,
        space,
        uneven,
        rigid,
        splitting,
        burst,
        pulled,
        spun,
        dropped,
        turning_dropped,
        sound_dropped,
        crushed,
        own,
        own_curve,
    )  # fmt: skip
}


def run(name: str) -> dict[str, np.ndarray]:
    """Histories and final fields of a scene, the same on every rank."""
    scene, options, steps = SCENES[name]()
    simulation = Simulation(scene, **options)
    history: dict[str, list] = {}

    def momenta():
        """The momentum, and the angular one about the z axis."""
        state = simulation.state
        p = (simulation.bulk.mass * state.velocity).reshape(-1, scene.dim)
        x = nodes(simulation) + state.displacement.reshape(-1, scene.dim)
        turn = np.sum(x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0])
        return simulation.ranks.sum(np.array([*p.sum(axis=0), turn]))

    start = momenta()
    for record in simulation.steps(steps * simulation.step_size):
        now = record.energies | {
            "time": record.time,
            "reaction": simulation.reaction(RIGHT) if scene.loads else np.zeros(scene.dim),
            "mean": simulation.mean_displacement(RIGHT),
            "momenta": momenta(),
        }
        for key, value in now.items():
            history.setdefault(key, []).append(value)
    interactions = simulation.interactions
    found = {key: interactions.gather(key) for key in ("impulse", "jump", "damage", "traction")}
    count = len(point_coordinates(simulation))
    pieces = measure_fragments(simulation)
    found |= {"law": interactions.gather("law"), "fragment": pieces.fragment}
    found |= {f"piece_{name}": getattr(pieces, name) for name in PIECES}
    here = {"points": np.array([interactions.num_points, len(interactions), count])}
    return {k: np.array(v) for k, v in history.items()} | found | here | {"start": start}


def main() -> None:
    for name in sys.argv[2:] or SCENES:
        found = run(name)
        if MPI.COMM_WORLD.rank == 0:
            np.savez(f"{sys.argv[1]}/{name}.npz", **found)


if __name__ == "__main__":
    run_together(main)
