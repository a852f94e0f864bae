# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts that are searched on meshes that are spread over the ranks; the first rank writes."""

import dataclasses
from unittest.mock import patch

import numpy as np
import rebalanced
import scenes
import touching_bodies
from asked_scenes import run_asked
from dolfinx import fem
from mpi4py import MPI
from scenes import box_bodies
from spread_scenes import bytes_held, pieces

from xper_fx.nscd.laws import CohesiveZone, RigidCohesiveZone
from xper_fx.nscd.rigid import Disc, RigidBody, Sphere
from xper_fx.output.contact_forces import find_contact_forces
from xper_fx.output.frames import take_frame
from xper_fx.output.joint_forces import find_joint_forces
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.parallel.launch import run_together
from xper_fx.scene import Scene, moved_scene
from xper_fx.scene.contact import Contact
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

WORLD = MPI.COMM_WORLD
LAST = 18  # step of runs that are recorded


def strength(x):
    """Between 7 and 13 Pa, no two alike."""
    return 10.0 + 3.0 * np.sin(7.0 * x[0] + 3.3 * x[1]) * np.cos(5.0 * x[1] - x[0])


def split_cells():
    """Cells that initially rigid bonds join; later steps have more than one solution."""
    bodies = box_bodies((2.0, 1.0), (10, 5), material={2: lambda x: x[0] > 1.0 - 1e-9})
    scene = touching_bodies.flying_plates(
        bodies, (0.004, 0.13), 0.5, 4.0, touching_bodies.ELASTIC, RigidCohesiveZone(strength, 0.1)
    )
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 16


def turning_cells():
    """The same at finite strain, where bonds turn and lips have nodes at vertices of others."""
    scene, options, steps = split_cells()
    return touching_bodies.at_finite_strain(scene), options, steps


def breaking():
    """Plates of bonded blocks meet, break, and their lips part."""
    scene, options, _ = touching_bodies.explicit_shards()
    return scene, options, 20


def one_end():
    """A strip breaks; pieces of one end might meet, of which some ranks know nothing."""
    bodies = box_bodies((4.0, 1.0), (12, 3), material={2: lambda x: x[0] > 3.0 - 1e-9})
    scene = Scene(
        bodies, dict.fromkeys((1, 2), touching_bodies.ELASTIC),
        default_interaction=CohesiveZone(2e4, 0.05, strength, friction=0.3),
        surfaces={"end": (2,)}, contacts=[Contact(("end", "end"), touching_bodies.RUB)],
        initial_velocity=lambda x: np.stack([8.0 * (x[0] - 2.0), 6.0 * (x[1] - 0.5)]),
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-11}, 24


def in_space(bond):
    """Two boxes of bonded tetrahedra fly into each other as they are drawn out of shape."""
    bodies = box_bodies(
        (2.0, 1.0, 1.0), (4, 2, 2), "tetrahedron", material={2: lambda x: x[0] > 1.0 - 1e-9}
    )
    second = np.unique(geometry_dofmap(bodies.mesh)[bodies.material_of_cell == 2])
    bodies.mesh.geometry.x[second] += (0.004, 0.13, 0.07)
    velocity = {
        tag: lambda x, v=v: np.stack([v + 0.3 * (x[0] - 1.0), 3.0 * (x[1] - 0.5), 0.1 * v * x[0]])
        for tag, v in ((1, 0.3), (2, -0.3))
    }
    return Scene(
        bodies, dict.fromkeys((1, 2), touching_bodies.ELASTIC), default_interaction=bond,
        interactions={(1, 2): None}, surfaces={"left": (1,), "right": (2,)},
        contacts=[
            Contact(pair, touching_bodies.RUB)
            for pair in (("left", "right"), ("left", "left"), ("right", "right"))
        ],
        initial_velocity=velocity,
    )  # fmt: skip


def broken_boxes():
    """Blocks whose bonds weaken, and whose lips part."""
    bond = CohesiveZone(2e4, 0.01, lambda x: 0.5 * strength(x), friction=0.3)
    return in_space(bond), {"scheme": "explicit", "tolerance": 1e-11}, 12


def split_boxes():
    """The same of initially rigid bonds."""
    law = RigidCohesiveZone(lambda x: 0.5 * strength(x), 0.02)
    return in_space(law), {"scheme": "explicit", "tolerance": 1e-10}, 16


def on_edge():
    """A sphere breaks a plate of tetrahedra on an edge, as near to cells on both sides."""
    ball = RigidBody(Sphere(0.1), (1.1, 0.5, 0.601), "ball", density=9.0, velocity=(0, 0, -4))
    scene = Scene(
        box_bodies((2.0, 1.0, 0.5), (4, 2, 1), "tetrahedron"), {1: touching_bodies.ELASTIC},
        default_interaction=RigidCohesiveZone(lambda x: 0.2 * strength(x), 0.01),
        surfaces={"plate": (1,)}, rigid=[ball],
        contacts=[Contact((a, "plate"), touching_bodies.RUB) for a in ("ball", "plate")],
    )  # fmt: skip
    # of velocities that differ by 1e-13 runs part from step 4 on
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 3


def split_struck():
    """Cells that initially rigid bonds join fly into discs that meet, and on a floor."""
    scene, options, steps = touching_bodies.split_struck()
    law = RigidCohesiveZone(strength, 0.1)
    return dataclasses.replace(scene, default_interaction=law), options, steps


def turning_split_struck():
    """The same at finite strain."""
    scene, options, steps = split_struck()
    return touching_bodies.at_finite_strain(scene), options, steps


def tabled():
    """The plates of `breaking`; their bonds have tables of strengths for facets and for points."""
    scene, options, steps = breaking()
    facets = scene.bodies.facets
    on_points = np.outer(strength(facets.midpoint.T), (1.0, 0.8))
    bond = CohesiveZone(2e4, 0.05, on_points, friction=0.2 + 0.02 * facets.midpoint[:, 0])
    return dataclasses.replace(scene, default_interaction=bond), options, steps


def sampled():
    """The plates of `breaking`; strengths, frictions and velocities are DOLFINx functions."""
    scene, options, steps = breaking()
    mesh, beside = scene.bodies.mesh, scenes.mesh_of((3, 2), (7, 5))
    spaces = (mesh, ("DG", 0)), (mesh, ("P", 1)), (beside, ("P", 1, (2,)))
    strong, rough, fast = (fem.Function(fem.functionspace(*space)) for space in spaces)
    strong.interpolate(strength)
    rough.interpolate(lambda x: 0.2 + 0.02 * x[0])
    fast.interpolate(scene.initial_velocity[1])
    bond = CohesiveZone(2e4, 0.05, strong, friction=rough)
    velocity = scene.initial_velocity | {1: fast}
    return (
        dataclasses.replace(scene, default_interaction=bond, initial_velocity=velocity),
        options,
        steps,
    )


def thrown():
    """A disc leaves the block beside it and flies into another one, far from the first."""
    scene = Scene(
        touching_bodies.apart((2, 1), (8, 4), gap=0.5), {1: touching_bodies.ELASTIC},
        interactions={(1, 1): None}, surfaces={"blocks": (1,)},
        rigid=[
            RigidBody(Disc(0.1), (0.67, 0.52), "ball", density=5.0, velocity=(6.0, 0.3), spin=5.0)
        ],
        contacts=[Contact((a, b), touching_bodies.RUB) for a, b in (("blocks", "blocks"),
                                                                   ("blocks", "ball"))],
    )  # fmt: skip
    return scene, {"step": 2e-3, "tolerance": 1e-10, "scheme": "implicit"}, 35


def rubbed():
    """Discs strike bodies that rub on each other; rounding leaves gaps of 1e-17 m between them."""
    scene, options, _ = touching_bodies.struck()
    return dataclasses.replace(scene, default_interaction=touching_bodies.RUB), options, 18


OWN = (
    rubbed, broken_boxes, split_boxes, thrown, split_cells, turning_cells, breaking, one_end,
    split_struck, turning_split_struck, on_edge, tabled, sampled,
)  # fmt: skip
SCENES = {f.__name__: f for f in OWN}
SCENES |= {
    name: touching_bodies.SCENES[name]
    for name in ("boxes", "heap", "slide", "struck", "rammed", "pelted")
}


def pictured(simulation: Simulation) -> dict[str, np.ndarray]:
    """What is seen of the bodies on the first rank, by what no numbers decide."""
    bodies, seen = simulation.scene.bodies, {}
    middle = bodies.mesh.geometry.x[geometry_dofmap(bodies.mesh)].mean(axis=1)
    for colour in ("group", "speed", "coordination", middle[:, 0]):
        frame = take_frame(simulation, colour)
        own = np.isfinite(frame.values)  # those of rigid bodies are left out
        centre = np.array([face.mean(axis=0) for face in frame.faces])
        key = f"frame_{len(seen)}"
        values = frame.values[own, None]
        seen[key] = np.vstack([np.sort(centre, axis=0), [(values * centre[own]).sum(axis=0)]])
    seen["chains"] = np.einsum("m,msd->sd", frame.forces, frame.chains)
    return seen


def run(name: str) -> dict[str, np.ndarray]:
    """Histories, and final values in an order that no numbers decide, the same on every rank."""
    if name == "held":
        return {"held": np.array(WORLD.allgather((held(scenes.COMM), held(MPI.COMM_SELF))))}
    if name == "refused":
        return {"told": np.array(refused())}
    if name.startswith("moved_"):
        return moved(name.removeprefix("moved_"))
    scene, options, steps = SCENES[name]()
    simulation, dim = Simulation(scene, comm=scenes.COMM, **options), scene.dim
    everyone, history = scenes.COMM.allgather, {}
    for record in simulation.steps(steps * simulation.step_size):
        momentum = (simulation.bulk.mass * simulation.state.velocity).reshape(-1, dim)
        solid = 0.0 if simulation.rigid is None else simulation.rigid.momentum()
        now = record.energies | {
            "pushed": len(find_contact_forces(simulation).force),
            "momentum": simulation.ranks.sum(momentum.sum(axis=0)) + solid,
        }
        for key, value in now.items():
            history.setdefault(key, []).append(value)
    dofmap = simulation.forms.V.dofmap.list
    x = simulation.forms.V.tabulate_dof_coordinates()[dofmap][..., :dim]
    place = np.concatenate([x, np.broadcast_to(x.mean(axis=1, keepdims=True), x.shape)], axis=2)
    motion = np.concatenate(
        [getattr(simulation.state, name).reshape(-1, dim)[dofmap] for name in ("displacement",
                                                                               "velocity")], axis=2
    )  # fmt: skip
    rows = np.concatenate(everyone(np.concatenate([place, motion], axis=2).reshape(-1, 4 * dim)))
    rows = rows[np.lexsort(rows[:, : 2 * dim].round(9).T)]
    forces = find_contact_forces(simulation)
    others = {}
    if simulation.rigid is not None:
        state = simulation.rigid.state
        others["solids"] = np.column_stack([state.position, state.velocity, state.turn.spin])
    if scene.joints:
        others["joints"] = np.column_stack(find_joint_forces(simulation))
    others |= pieces(simulation)
    if name in ("rammed", "broken_boxes"):
        others |= pictured(simulation)
    return {key: np.array(values) for key, values in history.items()} | others | {
        "displacement": rows[:, 2 * dim : 3 * dim], "velocity": rows[:, 3 * dim :],
        "force": np.sort(np.linalg.norm(forces.force, axis=1)),
        "damage": np.sort(simulation.interactions.gather("damage")),
    }  # fmt: skip


def moved(name: str) -> dict[str, np.ndarray]:
    """A scene whose bodies change their ranks every few steps, and how often they did."""
    with (
        rebalanced.to_and_fro(),
        patch.object(moved_scene, "moved_scene", wraps=moved_scene.moved_scene) as calls,
    ):
        return run(name) | {"moves": np.array(calls.call_count)}


def held(comm: MPI.Comm) -> float:
    """Bytes that the search of plates that meet reaches after some steps, a body of this rank."""
    scenes.COMM, before = comm, scenes.COMM
    bodies = box_bodies((2, 1), (32, 16), material={2: lambda x: x[0] > 1.0 - 1e-9})
    bond = CohesiveZone(2e4, 0.05, 10.0)
    scene = touching_bodies.flying_plates(
        bodies, (1e-3, 0.13), 0.5, 0.1, touching_bodies.ELASTIC, bond
    )
    simulation = Simulation(scene, scheme="explicit")
    for _ in simulation.steps(3 * simulation.step_size):
        pass
    scenes.COMM = before
    return bytes_held(simulation.detection) / simulation.bodies.num_bodies


def refused() -> list[str]:
    """What is said of scenes that are not divided."""
    told = []
    cells = {2: lambda x: x[0] > 1.0 - 1e-9}
    pair = [Contact(("left", "right"), touching_bodies.RUB)]
    every = [*pair, *(Contact((name, name), None) for name in ("left", "right"))]
    on_last = [Contact(("left", "wrong"), None)] if MPI.COMM_WORLD.rank == 2 else []
    for contacts in (pair, every + on_last):
        bodies = box_bodies((2, 1), (4, 2), material=cells)
        try:
            scene = Scene(
                bodies, {1: touching_bodies.ELASTIC, 2: touching_bodies.ELASTIC},
                interactions={(1, 2): None}, default_interaction=touching_bodies.BOND,
                surfaces={"left": (1,), "right": (2,)}, contacts=contacts,
            )  # fmt: skip
            Simulation(scene, scheme="explicit")
            told.append("nothing")
        except ValueError as error:
            told.append(f"{type(error).__name__}: {error}")
    return told


def record(folder: str, last: int, restart: bool) -> None:
    """Run a scene to a step, or go on to it: what the folder's name begins with says which."""
    kind, _, _ = folder.rsplit("/", 1)[-1].partition("_")
    make = {"solids": split_struck, "boxes": split_boxes}.get(kind, breaking)
    scene, options, _ = make()
    simulation = Simulation(scene, **options)
    end = LAST * simulation.step_size
    recorder = Recorder(simulation, folder, end_time=end, fields=0, restart=restart)
    for _ in recorded_steps(recorder, last * simulation.step_size, "run", quiet=True):
        pass


def main() -> None:
    scenes.COMM = WORLD
    run_asked(run, record)


if __name__ == "__main__":
    run_together(main)
