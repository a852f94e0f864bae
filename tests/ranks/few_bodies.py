# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fewer bodies than ranks, whole meshes and spread ones, run by all; the first rank writes.

Where a name begins with "spread_" the mesh is spread over the ranks.
"""

from dataclasses import replace
from itertools import islice

import meshed_scenes
import numpy as np
import scenes
from asked_scenes import run_asked
from cells import cell_of
from mpi4py import MPI
from periodic_cells import BOND as SOFT
from periodic_cells import MIXED
from scenes import BOTTOM, LEFT, RIGHT, box_bodies
from touching_bodies import EACH_OTHER, ELASTIC, RUB, apart

from xper_fx.bodies.explode import explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import crossed_rectangle
from xper_fx.forms.loads import Gravity, PrescribedDisplacement
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.nscd.rigid import Disc, RigidBody, wall
from xper_fx.output.effects import effects_of
from xper_fx.output.fragments import measure_fragments
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.parallel.launch import run_together
from xper_fx.scene import Contact, Scene, Tie, Wall
from xper_fx.simulation.simulation import Simulation
from xper_fx.study.quantities import DisplacementL2

BOND = CohesiveZone(2e4, 0.05, 10.0, friction=0.3)
TURNING = NeoHookean(1000.0, 0.3, 1.0)
EXACT = {"step": 1e-3, "tolerance": 1e-10, "scheme": "implicit"}
LAST = 8  # step of runs that are recorded


def inwards(x):
    """Towards the middle of a unit box, sliding."""
    return np.stack([0.6 - x[0], 0.3 * x[0] - 0.2])


def blocks():
    """Two blocks of order 2 at finite strain meet above a wall."""
    scene = Scene(
        apart((2, 1), (4, 2)), {1: TURNING}, order=2, initial_velocity=lambda x: 8.0 * inwards(x),
        walls=[Wall(BOTTOM, (0.0, -5e-3), (0.0, 1.0), RUB)], loads=[Gravity((0.0, -20.0))],
        **EACH_OTHER,
    )  # fmt: skip
    return scene, EXACT | {"newton_tolerance": 1e-11}, 12


def assembled():
    """Two such blocks meet on the wall by a solver that assembles their contacts."""
    scene, options, steps = blocks()
    scene = replace(scene, order=1, materials={1: ELASTIC})
    return scene, options | {"solver": "friction_problem", "tolerance": 1e-9}, steps


def explicit():
    """Two blocks meet; their strains are watched."""
    scene, _, _ = blocks()
    return replace(scene, order=1, walls=[]), {"scheme": "explicit", "tolerance": 1e-11}, 30


def halves(material, up=0.0):
    """A coarse half and a fine one, whose side is a candidate, drawn apart.

    Where the latter is moved up (m) its top is a body of its own.
    """
    meshes = [
        crossed_rectangle((first, 0.0), (first + 0.5, 1.0), (cells // 2, cells))
        for first, cells in ((0.0, 2), (0.5, 4))
    ]
    meshes[1].geometry.x[:, 1] += up
    mesh, tags = meshed_scenes.unmatched(
        join_meshes(meshes),
        {LEFT: lambda x: x[0] < 1e-9, RIGHT: lambda x: x[0] > 1.0 - 1e-9,
         14: lambda x: np.abs(x[0] - 0.5) < 1e-9},
    )  # fmt: skip
    x, y, _ = scenes.midpoints(mesh)[:, : mesh.topology.index_map(2).size_local]
    label = (x > 0.5).astype(int) + (y > 1.05)
    loads, start = meshed_scenes.stretched(1.0)
    return Scene(
        explode(mesh, label, facet_tags=tags), {1: material}, loads=loads,
        default_interaction=BOND, ties=[Tie(19, 14, BOND)], initial_velocity=lambda x: start(x)[:2],
    )  # fmt: skip


def tied():
    """Halves whose bonds turn with them."""
    return halves(TURNING), EXACT, 6


def static():
    """Halves that are pulled slowly: the rank of the held one has no body that floats."""
    held = [PrescribedDisplacement(LEFT, axis, 0.0) for axis in range(2)]
    scene = replace(
        halves(ELASTIC), initial_velocity=None,
        loads=[*held, PrescribedDisplacement(RIGHT, 0, lambda t: 0.01 * t)],
    )  # fmt: skip
    return scene, {"step": 0.1, "inertia": False, "tolerance": 1e-10}, 4


def swept():
    """The same by sweeps over anchored bodies."""
    scene, options, steps = static()
    return scene, options | {"solver": "accelerated"}, steps


def struck():
    """Discs that meet fall on one block on a floor."""
    disc, law = Disc(0.1), Contact(("block", "disc"), RUB)
    solids = [
        RigidBody(disc, (0.37, 0.62), "disc", density=20.0, velocity=(0.3, -3.0), spin=2.0),
        RigidBody(disc, (0.46, 0.83), "disc", density=20.0, velocity=(0.0, -4.0)),
        wall((0.0, -0.02), (0.0, 1.0), "floor"),
    ]
    scene = Scene(
        box_bodies((1.0, 0.5), (4, 2), label=lambda x: 0.0 * x[0]), {1: ELASTIC}, rigid=solids,
        surfaces={"block": (1,)}, loads=[Gravity((0.0, -10.0))],
        contacts=[law, replace(law, between=("block", "floor")), Contact(("disc", "disc"), RUB),
                  Contact(("block", "block"), None), Contact(("disc", "floor"), None)],
    )  # fmt: skip
    return scene, EXACT, 24


def cell():
    """A periodic cell of two bodies."""
    bodies = cell_of((1, 1), (4, 2), "quadrilateral", label=lambda x: x[0] > 0.5)
    material = LinearElastic(100.0, 0.3, 10.0)
    scene = Scene(bodies, {1: material}, default_interaction=SOFT, macroscopic=MIXED)
    return scene, {"step": 0.02, "theta": 0.7, "tolerance": 1e-9, "solver": "nlgs"}, 8


def bar():
    """A bar that swings; its bulk is explicit at first, as nothing else acts on it."""
    scene = Scene(
        box_bodies((1.0, 0.5), (6, 3), label=lambda x: 0.0 * x[0]), {1: ELASTIC},
        loads=[PrescribedDisplacement(LEFT, axis, 0.0) for axis in range(2)],
        initial_velocity=lambda x: np.stack([0.0 * x[0], x[0] ** 2]),
    )  # fmt: skip
    return scene, {"step": "auto", "accuracy": 0.1}, 40


def hole():
    """A static periodic cell of one body."""
    bodies = cell_of((1, 1), (4, 4), "quadrilateral")
    scene = Scene(bodies, {1: TURNING}, macroscopic=MIXED)
    return scene, {"step": 0.02, "inertia": False, "newton_tolerance": 1e-11}, 4


OF_ALL = (blocks, assembled, explicit, tied, static, swept, struck, cell, bar, hole)
SCENES = {scene.__name__: scene for scene in OF_ALL}


def run(name: str) -> dict[str, np.ndarray]:
    """Energies of a scene and the masses of its pieces; or what ranks tell of a tie."""
    scenes.COMM = MPI.COMM_WORLD if name.startswith("spread_") else MPI.COMM_SELF
    if name.endswith("misfit"):
        return {"told": np.array(MPI.COMM_WORLD.allgather(misfit()))}
    scene, options, steps = SCENES[name.removeprefix("spread_")]()
    simulation, history = Simulation(scene, **options), {}
    for record in islice(simulation.steps(1e6), steps):
        for key, value in record.energies.items():
            history.setdefault(key, []).append(value)
    effects = {row.name for row in effects_of(simulation) if row.on}
    assert ("several ranks" in effects) == (simulation.team.size > 1)
    found = {key: np.array(values) for key, values in history.items()}
    found["bodies"] = np.array(simulation.team.comm.allgather(simulation.bodies.num_bodies))
    samples = DisplacementL2(100).value(simulation, None)["displacement"]
    assert np.isfinite(samples).any()
    found["samples"] = np.nan_to_num(samples)
    if name.endswith("assembled"):
        problem = simulation.contact_problem()
        told = simulation.team.comm.allgather((problem.q, problem.W.data))
        assert all(np.array_equal(a, b) for one in told for a, b in zip(one, told[0], strict=True))
        found["asked"] = np.sort(problem.solve(tolerance=1e-13).velocity)
    if scene.macroscopic is None:
        mass = measure_fragments(simulation).mass
        spread = scene.bodies.spread is not None
        found["mass"] = np.concatenate(scenes.COMM.allgather(mass)) if spread else mass
    return found


def misfit() -> str:
    """What is said of candidates that reach beyond the antagonists."""
    try:
        Simulation(halves(ELASTIC, up=0.3), **EXACT)
    except ValueError as error:
        return str(error)
    return "nothing"


def record(folder: str, last: int, restart: bool) -> None:
    """Run to a step of `tied`, or go on to it."""
    scenes.COMM = MPI.COMM_WORLD if "spread" in folder else MPI.COMM_SELF
    scene, options, _ = tied()
    simulation = Simulation(scene, **options)
    end = LAST * simulation.step_size
    recorder = Recorder(simulation, folder, end_time=end, fields=4, fragments=True, restart=restart)
    for _ in recorded_steps(recorder, last * simulation.step_size, "run", quiet=True):
        pass


if __name__ == "__main__":
    run_together(lambda: run_asked(run, record))
