# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of rigid bodies that ranks divide, however few they are; results as a .npz file."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from xper_fx.forms.loads import Gravity
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.nscd.rigid import Cluster, Disc, Part, Polygon, RigidBody, Sphere, wall
from xper_fx.output.connectivity import find_fragments
from xper_fx.output.contact_forces import find_contact_forces
from xper_fx.output.effects import effects_of
from xper_fx.output.fragments import measure_fragments
from xper_fx.output.joint_forces import find_joint_forces
from xper_fx.parallel import rigid_partition as rigid_division
from xper_fx.parallel.launch import run_together
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.contact import Contact
from xper_fx.scene.joints import Hinge, Tendon
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

G, RADIUS = 9.81, 0.1


def clouds() -> Simulation:
    """Two clouds of spinning spheres of several sizes fly into each other, nothing else there."""
    random = np.random.default_rng(3)
    site = np.stack(np.meshgrid(*[np.arange(3)] * 3), axis=-1).reshape(-1, 3)
    bodies = []
    for side in (-1.0, 1.0):
        for place in 0.24 * site + [0.5 * side - 0.24, -0.24, -0.24]:
            bodies.append(
                RigidBody(
                    Sphere(RADIUS * random.uniform(0.8, 1.0)),
                    place + 0.02 * random.uniform(-1.0, 1.0, 3),
                    "spheres",
                    velocity=(-2.0 * side, *(0.1 * random.normal(size=2))),
                    spin=random.normal(size=3),
                    density=1000.0,
                )
            )
    law = SignoriniCoulomb(friction=0.3, restitution=0.5, rolling=0.1)
    scene = Scene(rigid=bodies, contacts=[Contact(("spheres", "spheres"), law)])
    return Simulation(scene, 2e-3, tolerance=1e-13, num_threads=1)


def falling() -> Simulation:
    """Discs fall into a trough."""
    random = np.random.default_rng(5)
    site = np.stack(np.meshgrid(np.arange(8), np.arange(6)), axis=-1).reshape(-1, 2)
    bodies = [
        RigidBody(
            Disc(RADIUS * random.uniform(0.7, 1.0)),
            0.21 * place + 0.005 * random.uniform(-1.0, 1.0, 2), "discs", velocity=(0.0, -1.0),
            density=1000.0,
        )
        for place in site
    ]  # fmt: skip
    bodies += [
        wall((0.0, -0.12), (0.1, 1.0), "walls"),
        wall((-0.12, 0.0), (1.0, 0.2), "walls"),
        wall((1.62, 0.0), (-1.0, 0.2), "walls"),
    ]
    law = SignoriniCoulomb(friction=0.4)
    scene = Scene(
        rigid=bodies,
        contacts=[Contact(("discs", "discs"), law), Contact(("discs", "walls"), law)],
        loads=[Gravity((0.0, -G))],
    )
    return Simulation(scene, 2e-3, tolerance=1e-11, num_threads=1)


def bricks(**options) -> Simulation:
    """Blocks in bond on a floor that jerks them along; those on top are of two halves."""
    brick = Polygon.box((0.2, 0.1))
    half = Polygon.box((0.1, 0.1))
    halves = Cluster([Part(half, (-0.05, 0.0)), Part(half, (0.05, 0.0))])
    bodies = [
        RigidBody(
            halves if j == 2 else brick,
            (0.21 * i + 0.105 * (j % 2), 0.05 + 0.1 * j),
            "blocks",
            density=2000.0,
        )
        for i in range(6)
        for j in range(3)
    ]
    bodies.append(
        RigidBody(
            Polygon.box((3.0, 0.1)), (0.45, -0.05), "floor",
            prescribed={0: lambda t: 0.5 * np.sin(60.0 * t), 1: 0.0, 2: 0.0},
        )
    )  # fmt: skip
    law = SignoriniCoulomb(friction=0.3)
    scene = Scene(
        rigid=bodies,
        contacts=[Contact(("blocks", "blocks"), law), Contact(("blocks", "floor"), law)],
        loads=[Gravity((0.0, -G))],
    )
    return Simulation(scene, 2e-3, tolerance=1e-10, num_threads=1, **({"solver": "nlgs"} | options))


def hard_bricks() -> Simulation:
    """The same with so few sweeps together that each rank goes on alone, with other solvers."""
    return bricks(solver="auto", max_sweeps=400)


def assembled() -> Simulation:
    """The same by a solver that wants all contacts."""
    return bricks(solver="friction_problem")


def shear() -> Simulation:
    """A sheet of discs, pressed together from above and below; the top is driven along."""
    bodies = []
    for j in range(6):
        for i in range(14):
            upper = j >= 3
            driven = {0: 2.0 if upper else 0.0} if j in (0, 5) else {}
            pressed = {0: 1.0, 5: -1.0}.get(j, 0.0)
            bodies.append(
                RigidBody(
                    Disc(RADIUS), (0.21 * i + 0.105 * (j % 2), 0.1 * np.sqrt(3.0) * j), "discs",
                    velocity=(2.0 if upper else 0.0, 0.0), prescribed=driven, density=1000.0,
                    force=(0.0, 20.0 * pressed),
                )
            )  # fmt: skip
    law = SignoriniCoulomb(friction=0.1)
    scene = Scene(rigid=bodies, contacts=[Contact(("discs", "discs"), law)])
    return Simulation(scene, 2e-2, tolerance=1e-10, num_threads=1)


def glued() -> Simulation:
    """Rows of four to seven discs that glue joins, flying their ways; too far apart to meet."""
    bodies = [
        RigidBody(
            Disc(RADIUS), (2.0 * RADIUS * i, j), "discs", velocity=(0.1 * j, 0.2), density=1000.0
        )
        for j in range(4)
        for i in range(4 + j)
    ]  # fmt: skip
    law = CohesiveZone(1e9, 10.0, 1e5)
    scene = Scene(rigid=bodies, contacts=[Contact(("discs", "discs"), law)])
    return Simulation(scene, 1e-5, tolerance=1e-11, num_threads=1)


def ropes() -> Simulation:
    """Ropes of hinged discs swing into each other; wires join the first two and hold the last."""
    bodies, joints = [], []
    for rope in range(6):
        before, side = None, (-1.0) ** rope
        for n in range(3):
            place = np.array([0.22 * rope, -0.2 * n - 0.1])
            disc = RigidBody(
                Disc(RADIUS), place, "discs", density=1000.0,
                velocity=(-side * 5.0 * place[1], 0.0), spin=side * 5.0,
            )  # fmt: skip
            bodies.append(disc)
            joints.append(
                Hinge(
                    (before, disc), place + [0.0, 0.1], friction=0.2 * (n == 1),
                    limits=None if n else (-0.5, 0.12), restitution=0.0 if n else 0.5,
                )
            )  # fmt: skip
            before = disc
    bodies.append(RigidBody(Polygon.box((2.0, 0.1)), (0.55, -0.65), "floor",
                            prescribed={0: 0.3, 1: 0.0, 2: 0.0}))  # fmt: skip
    two, last = (bodies[2], bodies[5]), bodies[17]
    joints.append(Tendon(two, [b.position for b in two], stiffness=2e4, prestress=50.0))
    joints.append(Tendon((last, None), [last.position, (1.6, -0.5)]))
    law = SignoriniCoulomb(friction=0.3, restitution=0.3)
    pairs = ("discs", "discs"), ("discs", "floor")
    scene = Scene(rigid=bodies, contacts=[Contact(pair, law) for pair in pairs], joints=joints,
                  loads=[Gravity((0.0, -G))])  # fmt: skip
    return Simulation(scene, 2e-3, tolerance=1e-11, num_threads=1)


def swinging() -> Simulation:
    """The same ropes, which swing through each other: nothing is searched."""
    scene = replace(ropes().scene, contacts=[])
    return Simulation(scene, 2e-3, tolerance=1e-11, num_threads=1)


def packed(count: int) -> list[RigidBody]:
    """Discs of several sizes, some of them squares, on a square grid of so many a side."""
    random = np.random.default_rng(7)
    bodies = []
    for number in range(count * count):
        radius = random.uniform(0.8, 1.0) * RADIUS
        square = Polygon.box((1.3 * radius, 1.3 * radius))
        bodies.append(
            RigidBody(
                square if number % 5 == 0 else Disc(radius),
                0.21 * np.array(divmod(number, count)) + 0.005 * random.uniform(-1.0, 1.0, 2),
                "grains", density=1000.0, velocity=((-1.0) ** number * 0.5, 0.2 * np.sin(number)),
            )
        )  # fmt: skip
    return bodies


def gas() -> Simulation:
    """Grains in a periodic box that fly into each other and across its boundary."""
    law = SignoriniCoulomb(friction=0.3, restitution=0.5)
    scene = Scene(
        rigid=packed(7), lattice=(7 * 0.21, 7 * 0.21), contacts=[Contact(("grains", "grains"), law)]
    )
    return Simulation(scene, 2e-3, tolerance=1e-12, num_threads=1)


def sheared() -> Simulation:
    """Such grains in a periodic cell that is sheared and compressed by its given gradient."""
    law = SignoriniCoulomb(friction=0.3, restitution=0.5)
    drive = MacroscopicDrive(
        rate={"12": 1.0, "22": lambda t: -1.5 - t}, gradient={"11": 1.0, "21": 0.0}
    )
    scene = Scene(
        rigid=packed(7), lattice=(7 * 0.21, 7 * 0.21), macroscopic=drive,
        contacts=[Contact(("grains", "grains"), law)],
    )  # fmt: skip
    return Simulation(scene, 2e-3, tolerance=1e-12, num_threads=1, solver="nlgs")


def pressed(**options) -> Simulation:
    """Such grains in a periodic cell that stress presses together while it is sheared."""
    law = SignoriniCoulomb(friction=0.3, restitution=0.5)
    drive = MacroscopicDrive(
        rate={"12": lambda t: 1.0 + t}, gradient={"21": 0.0},
        stress={"11": -2e3, "22": lambda t: -4e3 * (1.0 + t)},
    )  # fmt: skip
    scene = Scene(
        rigid=packed(7), lattice=(7 * 0.21, 7 * 0.21), macroscopic=drive,
        contacts=[Contact(("grains", "grains"), law)],
    )  # fmt: skip
    return Simulation(scene, 2e-3, tolerance=1e-12, num_threads=1, **({"solver": "nlgs"} | options))


def hard_pressed() -> Simulation:
    """The same with so few sweeps together that each rank goes on alone, with all contacts."""
    return pressed(solver="auto", max_sweeps=1000)


def squeezed() -> Simulation:
    """Spheres in a periodic cell in space that is pressed from all sides and may be sheared."""
    random = np.random.default_rng(4)
    bodies = [
        RigidBody(
            Sphere(RADIUS * random.uniform(0.8, 1.0)),
            0.21 * np.array(place) + 0.005 * random.uniform(-1.0, 1.0, 3),
            "grains", density=1000.0, velocity=0.5 * random.normal(size=3),
        )
        for place in np.ndindex(3, 3, 4)
    ]  # fmt: skip
    drive = MacroscopicDrive(
        gradient={"21": 0.0, "31": 0.0, "32": 0.0, "23": 0.0},
        stress={"11": -8e3, "22": -6e3, "33": -4e3, "12": 3e3, "13": 0.0},
    )
    scene = Scene(
        rigid=bodies, lattice=(3 * 0.21, 3 * 0.21, 4 * 0.21), macroscopic=drive,
        contacts=[Contact(("grains", "grains"), SignoriniCoulomb(friction=0.3, rolling=0.1))],
    )  # fmt: skip
    return Simulation(scene, 2e-3, tolerance=1e-12, num_threads=1, solver="nlgs")


SCENES = {"clouds": (clouds, 0.16), "falling": (falling, 0.1), "bricks": (bricks, 0.02),
          "shear": (shear, 0.8), "glued": (glued, 1e-4), "ropes": (ropes, 0.12),
          "hard_bricks": (hard_bricks, 0.02), "gas": (gas, 0.4), "pressed": (pressed, 0.15),
          "sheared": (sheared, 0.15), "hard_pressed": (hard_pressed, 0.15),
          "squeezed": (squeezed, 0.08), "swinging": (swinging, 0.04),
          "assembled": (assembled, 0.01)}  # fmt: skip


def results(name: str) -> dict[str, np.ndarray]:
    """What became of a scene."""
    build, end = SCENES[name]
    simulation = build()
    told = effects_of(simulation)  # before anything has touched
    assert "several ranks" in {effect.name for effect in told}
    motion = simulation.rigid
    start = np.concatenate([motion.momentum(), motion.angular_momentum()])
    records, pushed, away = [], 0, set()
    for record in simulation.steps(end):
        records.append([*record.energies.values(), record.sweeps])
        pushed += len(find_contact_forces(simulation).force)
        division = simulation.model.division
        away.add(division is not None and division.halo is None)
    state, force = motion.state, np.zeros((0, 2))
    moved = force
    if simulation.scene.lattice is None:
        pieces = measure_fragments(simulation)
        moved = pieces.mass[:, None] * pieces.velocity
    driven = simulation.scene.macroscopic is not None
    every = simulation.team.comm.allgather((state.position, state.velocity, state.turn.spin))
    return {
        "start": start,
        "fragment": find_fragments(simulation),
        "stress": simulation.macroscopic.stress if driven else force,
        "gradient": simulation.macroscopic.gradient if driven else force,
        "sum_of_momenta": moved.sum(axis=0),
        "momenta": np.concatenate([motion.momentum(), motion.angular_momentum()]),
        "position": state.position,
        "velocity": state.velocity,
        "spin": state.turn.spin,
        "records": np.array(records),
        "pushed": pushed,
        "force": np.abs(find_contact_forces(simulation).force).sum(axis=0),
        "alike": all(np.array_equal(a, b) for e in every for a, b in zip(e, every[0], strict=True)),
        "undivided": True in away,
        "partitions": 0 if division is None else division.partitions,
        "moved": 0 if division is None else division.moved,
        "own": simulation.team.comm.allgather(sum(map(len, simulation.interactions.contacts))),
        "joints": np.column_stack(find_joint_forces(simulation)) if name == "ropes" else force,
        "rows": simulation.team.comm.allgather(
            len(simulation.model.joints.here) if name == "ropes" else 0
        ),
        "reaction": simulation.reaction_of("floor") if name == "bricks" else np.zeros(2),
        "asked": simulation.contact_problem().q if name == "bricks" else force,
    }


def main() -> None:
    """Run the scenes named after the file to write."""
    rigid_division._FEW = 0
    found = {f"{name}/{k}": v for name in sys.argv[2:] for k, v in results(name).items()}
    if MPI.COMM_WORLD.rank == 0:
        np.savez(sys.argv[1], **found)


if __name__ == "__main__":
    run_together(main)
