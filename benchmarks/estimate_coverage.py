# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far the error that a run estimates can be believed: estimated over true, scene by scene.

    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/estimate_coverage.py [--only NAME]
    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/estimate_coverage.py --quantities [2]

Each scene is run with an accuracy asked for and compared with a run whose settings are far finer:
external work, elastic and kinetic energy and each dissipation at the end (over the largest energy
held), the largest force of the supports (relative), the motion of all nodes and bodies at the end
(over the largest of the run, in the L2 norm). The true error is the largest of these; the table
says which that is. With `--quantities` each of them is estimated by itself, from one finer run, two
where the first tells far more than the run of itself, or as many as are given
(`xf.study.estimate_errors`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parent.parent / "demos"))

import accuracy_asked
import accuracy_cost
import notched_plate as plate

import xper_fx as xf

LEFT, RIGHT, BOTTOM, TOP = 1, 2, 3, 4
ASKED = (1e-2, 1e-3)
# An estimate is believed within this factor of the true error, or where both are this small beside
# what was asked for.
WITHIN, LITTLE = 3.0, 0.1
# A bar of unit modulus, density and wave speed.
ELASTIC = xf.materials.LinearElastic(1.0, 0.0, 1.0)


@dataclass(frozen=True)
class Case:
    """A scene, how it is run, and how finely its reference is.

    Args:
        build: makes the scene.
        end_time: s.
        fine: options of the reference.
        options: of the runs that ask for an accuracy.
        force: facet tag or name of a rigid group whose reaction counts, None for none.
        motion: whether the motion at the end counts; not where bodies fly about.
    """

    build: Callable[[], xf.Scene]
    end_time: float
    fine: dict
    options: dict = field(default_factory=dict)
    force: int | str | None = None
    motion: bool = True


def rectangle(size, cells, whole=True, label=None, material=None, shape="crossed"):
    """Bodies of a rectangle with its four sides tagged; in one piece, by label, or each cell."""
    from dolfinx.mesh import CellType, create_rectangle
    from mpi4py import MPI

    width, height = size
    if shape == "crossed":
        mesh = xf.crossed_rectangle((0.0, 0.0), size, cells)
    else:
        mesh = create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), size], cells, CellType.quadrilateral)
    sides = {
        LEFT: lambda x: x[0] < 1e-9 * width,
        RIGHT: lambda x: x[0] > (1 - 1e-9) * width,
        BOTTOM: lambda x: x[1] < 1e-9 * height,
        TOP: lambda x: x[1] > (1 - 1e-9) * height,
    }
    count = mesh.topology.index_map(2).size_local
    labels = np.zeros(count, int) if whole else None
    if label is not None:
        centre = mesh.geometry.x[mesh.geometry.dofmap].mean(axis=1)
        labels = label(centre.T).astype(int)
    tags = None if material is None else xf.tag_cells(mesh, material, 1)
    return xf.explode(mesh, labels, facet_tags=xf.tag_facets(mesh, sides), cell_tags=tags)


def vibrating(material) -> xf.Scene:
    """A bar in its first mode."""
    return xf.Scene(
        rectangle((1.0, 0.1), (20, 2)),
        {1: material},
        loads=[xf.PrescribedVelocity(LEFT, 0, 0.0), xf.PrescribedVelocity(LEFT, 1, 0.0)],
        initial_velocity=lambda x: np.array([1e-3 * np.sin(np.pi * x[0] / 2), 0.0 * x[0]]),
    )


def bending() -> xf.Scene:
    """A neo-Hookean strip that swings far."""
    return xf.Scene(
        rectangle((1.0, 0.1), (20, 2)),
        {1: xf.materials.NeoHookean(1.0, 0.3, 1.0)},
        loads=[xf.PrescribedVelocity(LEFT, i, 0.0) for i in (0, 1)],
        initial_velocity=lambda x: np.array([0.0 * x[0], 0.05 * x[0] ** 2]),
    )


def pulled_bond() -> xf.Scene:
    """Two halves held together by a bond, pulled apart."""
    return xf.Scene(
        rectangle((2.0, 0.5), (8, 2), label=lambda x: x[0] > 1.0),
        {1: ELASTIC},
        default_interaction=xf.laws.CohesiveZone(1e3, 1e-4, 1e-2),
        loads=[xf.PrescribedVelocity(LEFT, 0, -1e-3), xf.PrescribedVelocity(RIGHT, 0, 1e-3)],
        initial_velocity=lambda x: np.array([1e-3 * (x[0] - 1.0), 0.0 * x[0]]),
    )


def bouncing_bar() -> xf.Scene:
    """A bar that falls on a wall and flies on."""
    return xf.Scene(
        rectangle((1.0, 0.1), (10, 1)),
        {1: ELASTIC},
        walls=[xf.Wall(LEFT, (-0.1, 0.0), (1.0, 0.0), xf.laws.SignoriniCoulomb())],
        initial_velocity=lambda x: np.array([-1e-2 + 0.0 * x[0], 0.0 * x[0]]),
    )


def plastic_plate(rate: float) -> xf.Scene:
    """A plate with a soft half, pulled."""
    materials = {
        tag: xf.materials.J2SmallStrain(1.0, 0.3, strength, xf.materials.Linear(0.05), 1.0)
        for tag, strength in ((1, 2e-3), (2, 1e-3))
    }
    bodies = rectangle((1.0, 1.0), (4, 4), material={2: lambda x: x[0] + x[1] < 1.0})
    pull = xf.PrescribedDisplacement(RIGHT, 0, lambda t: rate * t)
    hold = [xf.PrescribedDisplacement(LEFT, i, lambda t: 0.0 * t) for i in (0, 1)]
    return xf.Scene(bodies, materials, loads=[pull, *hold])


def plastic_cycle() -> xf.Scene:
    """The same, pulled, sheared and pushed back: the path of the strains turns."""
    materials = {1: xf.materials.J2SmallStrain(1.0, 0.3, 1e-3, xf.materials.Linear(0.05), 1.0)}
    turn = [
        xf.PrescribedDisplacement(RIGHT, 0, lambda t: 5e-3 * np.sin(np.pi * t)),
        xf.PrescribedDisplacement(RIGHT, 1, lambda t: 5e-3 * (1.0 - np.cos(np.pi * t))),
    ]
    hold = [xf.PrescribedDisplacement(LEFT, i, 0.0) for i in (0, 1)]
    return xf.Scene(rectangle((1.0, 1.0), (4, 4)), materials, loads=[*turn, *hold])


def plastic_cycles() -> xf.Scene:
    """A square, weak and strong across its diagonal, to and fro: flow in bursts that grow."""
    square = rectangle((1.0, 1.0), (4, 4), material={2: lambda x: x[0] + x[1] > 1.0})
    materials = {
        tag: xf.materials.J2SmallStrain(1.0, 0.3, tag * 1e-3, xf.materials.Linear(0.05), 1.0)
        for tag in (1, 2)
    }
    hold = [xf.PrescribedDisplacement(LEFT, i, 0.0) for i in (0, 1)]

    def pull(t: float) -> float:
        return 1.2e-3 * (1.0 + 0.15 * t) * np.sin(2.0 * np.pi * t)

    return xf.Scene(square, materials, loads=[*hold, xf.PrescribedDisplacement(RIGHT, 0, pull)])


def sliding_block() -> xf.Scene:
    """A rigid block thrown on a floor, which friction stops."""
    block = xf.rigid.Polygon([(-0.5, -0.25), (0.5, -0.25), (0.5, 0.25), (-0.5, 0.25)])
    return xf.Scene(
        rigid=[
            xf.rigid.wall((0, 0), (0, 1), "floor"),
            xf.RigidBody(block, (0.0, 0.25), "block", density=1000.0, velocity=(2.0, 0.0)),
        ],
        contacts=[xf.Contact(("block", "floor"), xf.laws.SignoriniCoulomb(0.3))],
        loads=[xf.Gravity((0.0, -9.81))],
    )


def rocking_block() -> xf.Scene:
    """A rigid block pushed on its floor that rocks."""
    block = xf.rigid.Polygon([(-0.25, -1.0), (0.25, -1.0), (0.25, 1.0), (-0.25, 1.0)])
    return xf.Scene(
        rigid=[
            xf.rigid.wall((0, 0), (0, 1), "floor"),
            xf.RigidBody(
                block, (0.0, 1.0), "block", density=1000.0, velocity=(0.4, 0.1), spin=-0.4
            ),
        ],
        contacts=[xf.Contact(("block", "floor"), xf.laws.SignoriniCoulomb(0.7))],
        loads=[xf.Gravity((0.0, -9.81))],
    )


def falling_discs() -> xf.Scene:
    """Twenty rigid discs that fall into a box."""
    random = np.random.default_rng(1)
    law = xf.laws.SignoriniCoulomb(0.3)
    discs = [
        xf.RigidBody(
            xf.rigid.Disc(0.04 + 0.01 * random.random()),
            (0.12 * (k % 5) + 0.02 * random.random(), 0.1 + 0.12 * (k // 5)),
            "discs",
            density=2000.0,
        )
        for k in range(20)
    ]
    box = [
        xf.rigid.wall((0, 0), (0, 1), "box"),
        xf.rigid.wall((-0.1, 0), (1, 0), "box"),
        xf.rigid.wall((0.65, 0), (-1, 0), "box"),
    ]
    return xf.Scene(
        rigid=box + discs,
        contacts=[xf.Contact(("discs", "discs"), law), xf.Contact(("discs", "box"), law)],
        loads=[xf.Gravity((0.0, -9.81))],
    )


def soft_block() -> xf.Scene:
    """A soft block that falls on a rigid floor."""
    block = rectangle((1.0, 1.0), (3, 3))
    return xf.Scene(
        block,
        {1: xf.materials.LinearElastic(1e6, 0.3, 1000.0)},
        walls=[xf.Wall(BOTTOM, (0.0, -0.01), (0.0, 1.0), xf.laws.SignoriniCoulomb(0.4))],
        loads=[xf.Gravity((0.0, -9.81))],
    )


def pulled_plate() -> xf.Scene:
    """A plate of bonded triangles torn slowly, without inertia."""
    law = xf.laws.CohesiveZone(1e3, 2e-4, 5e-3)
    return xf.Scene(
        rectangle((1.0, 1.0), (2, 2), label=lambda x: x[1] > 0.5),
        {1: ELASTIC},
        default_interaction=law,
        loads=[
            xf.PrescribedDisplacement(BOTTOM, 0, 0.0),
            xf.PrescribedDisplacement(BOTTOM, 1, 0.0),
            xf.PrescribedDisplacement(TOP, 0, 0.0),
            xf.PrescribedDisplacement(TOP, 1, lambda t: 0.04 * t),
        ],
    )


def smoothly_pulled() -> xf.Scene:
    """A plastic plate whose pull begins smoothly, with inertia."""
    scene = plastic_plate(0.0)
    pull = xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-4 * t**2)
    return xf.Scene(scene.bodies, scene.materials, loads=[pull, *scene.loads[1:]])


def solid_block() -> xf.Scene:
    """A soft block of tetrahedra that is thrown on a wall, obliquely."""
    from dolfinx.mesh import create_unit_cube
    from mpi4py import MPI

    mesh = create_unit_cube(MPI.COMM_SELF, 2, 2, 2)
    tags = xf.tag_facets(mesh, {BOTTOM: lambda x: x[2] < 1e-9})
    count = mesh.topology.index_map(3).size_local
    return xf.Scene(
        xf.explode(mesh, np.zeros(count, int), facet_tags=tags),
        {1: xf.materials.LinearElastic(1e6, 0.3, 1000.0)},
        walls=[xf.Wall(BOTTOM, (0, 0, -0.02), (0, 0, 1), xf.laws.SignoriniCoulomb(0.3))],
        initial_velocity=lambda x: np.array([0.3 + 0 * x[0], 0.1 + 0 * x[0], -1.0 + 0 * x[0]]),
    )


def sheared_block() -> xf.Scene:
    """A block pressed on a wall, then sheared, without inertia."""
    return accuracy_cost.sheared_block(6, 1)


def disc_on_beam(density: float, speed: tuple[float, float]) -> xf.Scene:
    """A rigid disc thrown on a clamped beam, which it leaves and hits again and again."""
    disc = xf.RigidBody(xf.rigid.Disc(0.1), (0.4, 0.201), "disc", density=density, velocity=speed)
    return xf.Scene(
        rectangle((1.0, 0.1), (20, 2)),
        {1: xf.materials.LinearElastic(1e7, 0.3, 1000.0)},
        surfaces={"beam": (1,)},
        rigid=[disc],
        contacts=[
            xf.Contact(("beam", "disc"), xf.laws.SignoriniCoulomb(0.5)),
            xf.Contact(("beam", "beam"), None),
        ],
        loads=[*clamped(), xf.Gravity((0.0, -9.81))],
    )


def clamped() -> list[xf.PrescribedVelocity]:
    """Both ends of a beam or plate are held."""
    return [xf.PrescribedVelocity(side, i, 0.0) for side in (LEFT, RIGHT) for i in (0, 1)]


def ball_on_plate() -> xf.Scene:
    """A meshed ball thrown on a clamped meshed plate, obliquely."""
    plate_mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 0.1), (20, 3))
    ball = xf.crossed_rectangle((-1.0, -1.0), (1.0, 1.0), (6, 6))
    x, y = ball.geometry.x[:, :2].T.copy()
    across = np.column_stack([x * np.sqrt(1.0 - 0.5 * y**2), y * np.sqrt(1.0 - 0.5 * x**2)])
    ball.geometry.x[:, :2] = np.array([0.45, 0.181]) + 0.08 * across
    sides = {LEFT: lambda x: x[0] < 1e-9, RIGHT: lambda x: x[0] > 1.0 - 1e-9}
    joined = xf.join_meshes(
        [plate_mesh, ball],
        [xf.tag_cells(plate_mesh, {}, 1), xf.tag_cells(ball, {}, 2)],
        [xf.tag_facets(plate_mesh, sides), None],
    )
    still = np.zeros((2, 1))
    return xf.Scene(
        xf.explode(joined.mesh, joined.part, joined.cell_tags, joined.facet_tags),
        {
            1: xf.materials.LinearElastic(1e7, 0.3, 1000.0),
            2: xf.materials.LinearElastic(2e7, 0.3, 1500.0),
        },
        surfaces={"plate": (1,), "ball": (2,)},
        contacts=[
            xf.Contact(("ball", "plate"), xf.laws.SignoriniCoulomb(0.3)),
            xf.Contact(("ball", "ball"), None),
            xf.Contact(("plate", "plate"), None),
        ],
        loads=clamped(),
        initial_velocity={
            1: lambda x: still + 0.0 * x[:2],
            2: lambda x: np.array([[0.3], [-1.0]]) + 0.0 * x[:2],
        },
    )


def stressed_cell() -> xf.Scene:
    """The ductile cell under a stress that is given."""
    stress = {"11": lambda t: 6.5e8 * t, "22": 0.0}
    drive = xf.MacroscopicDrive(gradient={"12": 0.0, "21": 0.0}, stress=stress)
    return replace(accuracy_asked.ductile_cell(), macroscopic=drive)


STATIC = {"theta": 1.0, "inertia": False}
GAUGE_END = 0.0075 * plate.SIZE / (2.0 * plate.SPEED)


def cases() -> dict[str, Case]:
    """All scenes by name."""
    printed = 0.004 * plate.SIZE / (2.0 * plate.SPEED)
    return {
        "elastic bar": Case(lambda: vibrating(ELASTIC), 8.0, {"step": 1e-3}, force=LEFT),
        "elastic bar, theta = 1": Case(
            lambda: vibrating(ELASTIC), 8.0, {"step": 1e-3}, {"theta": 1.0}, LEFT
        ),
        "neo-Hookean strip": Case(bending, 40.0, {"step": 2e-3}, force=LEFT),
        "bond": Case(pulled_bond, 15.0, {"step": 5e-4, "tolerance": 1e-6}, force=RIGHT),
        "resolved plate": Case(
            lambda: accuracy_cost.resolved_plate(20),
            GAUGE_END,
            {"courant": 0.05, "scheme": "explicit", "tolerance": 1e-7},
            force=plate.RIGHT,
        ),
        "resolved plate, implicit": Case(
            lambda: accuracy_cost.resolved_plate(20),
            GAUGE_END,
            {"courant": 0.05, "scheme": "explicit", "tolerance": 1e-7},
            {"scheme": "implicit"},
            plate.RIGHT,
        ),
        "printed plate": Case(
            lambda: plate.notched_plate(20, "strong"),
            printed,
            {"courant": 0.05, "scheme": "explicit", "tolerance": 1e-7},
            force=plate.RIGHT,
        ),
        "bar on a wall": Case(bouncing_bar, 15.0, {"step": 1e-3, "tolerance": 1e-6}),
        "block on a wall": Case(soft_block, 0.25, {"step": 1e-5, "tolerance": 1e-6}),
        "plastic plate, static": Case(
            lambda: plastic_plate(1e-2), 1.0, {"step": 2e-4}, STATIC, RIGHT
        ),
        "plastic cycle, static": Case(plastic_cycle, 2.0, {"step": 2e-4}, STATIC, RIGHT),
        "plastic cycles, static": Case(plastic_cycles, 6.0, {"step": 5e-4}, STATIC, RIGHT),
        "plastic plate": Case(lambda: plastic_plate(1e-3), 10.0, {"step": 5e-3}, force=RIGHT),
        "plastic plate, explicit": Case(
            lambda: plastic_plate(1e-3),
            10.0,
            {"courant": 0.02, "scheme": "explicit"},
            {"scheme": "explicit"},
            RIGHT,
        ),
        "plastic plate, smooth start": Case(smoothly_pulled, 10.0, {"step": 5e-3}, force=RIGHT),
        "viscoelastic bar": Case(
            lambda: vibrating(
                xf.materials.LinearViscoelastic(1.0, 0.2, ((0.3, 1.0), (0.3, 10.0)), 1.0)
            ),
            8.0,
            {"step": 2e-3},
            force=LEFT,
        ),
        "tetrahedra on a wall": Case(solid_block, 0.15, {"step": 1e-5, "tolerance": 1e-6}),
        "sheared block, static": Case(
            sheared_block, 2.0, {"step": 1e-4, "tolerance": 1e-9}, STATIC, accuracy_cost.TOP
        ),
        "ductile cell, static": Case(accuracy_asked.ductile_cell, 0.02, {"step": 2e-5}, STATIC),
        "torn plate, static": Case(
            pulled_plate, 1.0, {"step": 1e-4, "tolerance": 1e-8}, STATIC, TOP
        ),
        "stressed cell, static": Case(stressed_cell, 1.0, {"step": 1e-3}, STATIC),
        "disc on a beam": Case(
            lambda: disc_on_beam(300.0, (0.0, -1.0)),
            0.3,
            {"step": 2e-5, "tolerance": 1e-6},
            force=LEFT,
        ),
        "heavy disc on a beam": Case(
            lambda: disc_on_beam(1e4, (0.5, -0.5)),
            0.1,
            {"step": 1e-5, "tolerance": 1e-6},
            force=LEFT,
        ),
        "ball on a plate": Case(
            ball_on_plate, 0.05, {"step": 2.5e-6, "tolerance": 1e-6}, force=LEFT
        ),
        "sliding block": Case(sliding_block, 1.0, {"step": 1e-4}, {"step": 1e-2}),
        "rocking block": Case(rocking_block, 2.0, {"step": 5e-5}, {"step": 5e-3}),
        "falling discs": Case(
            falling_discs, 0.6, {"step": 2e-5, "tolerance": 1e-5}, {"step": 2e-3}, motion=False
        ),
    }


@dataclass(frozen=True)
class Watched:
    """One of the quantities of a case, or all of them.

    Args:
        case: says what counts.
        name: as `errors` has it.
    """

    case: Case
    name: str = ""
    has_reference: ClassVar[bool] = True

    def observe(self, simulation: xf.Simulation, step, seen: dict | None) -> dict:
        """Energies, the largest energy held, the largest force, positions, how far they moved."""
        e, case = step.energies, self.case
        now = positions(simulation) if case.motion else np.zeros(0)
        seen = seen or {"held": 0.0, "force": 0.0, "moved": 0.0, "start": now, "steps": 0}
        held = max(abs(e["external_work"]), e["kinetic"] + e["elastic"] + e["cohesive"])
        force = 0.0
        if isinstance(case.force, str):
            force = float(np.linalg.norm(simulation.reaction_of(case.force)))
        elif case.force is not None:
            force = float(np.linalg.norm(simulation.reaction(case.force)))
        return {
            "energies": {k: v for k, v in e.items() if k not in ("closure", "shadow")},
            "held": max(seen["held"], held), "force": max(seen["force"], force),
            "position": now, "start": seen["start"], "steps": seen["steps"] + 1,
            "moved": max(seen["moved"], float(np.linalg.norm(now - seen["start"]))),
        }  # fmt: skip

    def value(self, simulation: xf.Simulation, seen: dict) -> dict:
        """All of it."""
        return seen

    def error(self, value: dict, reference: dict) -> float:
        """Of the quantity that is named."""
        return errors(value, reference).get(self.name, 0.0)


def options_of(case: Case, options: dict) -> dict:
    """Options of `Simulation`; those of the reference have a `courant` number for a step."""
    options = {"num_threads": 1} | options
    if "courant" in options:
        step = options.pop("courant") * xf.Simulation(case.build()).bulk.critical_step()
        options["step"] = case.end_time / np.ceil(case.end_time / step)
    return options


def run(case: Case, options: dict) -> dict:
    """What a run gives: energies, largest force, motion at the end; its estimate."""
    simulation, watched, seen = xf.Simulation(case.build(), **options), Watched(case), None
    for step in simulation.steps(case.end_time):
        seen = watched.observe(simulation, step, seen)
    control = simulation.model.control
    return seen | {
        "estimated": simulation.estimated_error,
        "parts": None if control is None else control.estimate.errors,
    }


def positions(simulation: xf.Simulation) -> np.ndarray:
    """Displacements of all nodes and positions of all rigid bodies (m)."""
    if simulation.rigid is None:
        return simulation.state.displacement.copy()
    return np.concatenate([simulation.state.displacement, simulation.rigid.state.position.ravel()])


def errors(found: dict, fine: dict) -> dict[str, float]:
    """Relative errors by quantity."""
    out = {
        name: abs(found["energies"][name] - value) / fine["held"]
        for name, value in fine["energies"].items()
        if name in found["energies"]
    }
    if fine["force"] > 0.0:
        out["largest force"] = abs(found["force"] - fine["force"]) / fine["force"]
    if len(fine["position"]):
        off = np.linalg.norm(found["position"] - fine["position"])
        out["motion"] = float(off) / fine["moved"]
    return out


def by_quantity(
    name: str, case: Case, options: dict, fine: dict, refinements: int | None
) -> tuple[int, int]:
    """Print estimates of each quantity that errs; how many are believed, and how many there are."""
    quantities = {q: Watched(case, q) for q in errors(fine, fine)}
    found = xf.study.estimate_errors(
        case.build, case.end_time, quantities, refinements=refinements, **options
    )
    believed, count = 0, 0
    for quantity, one in found.items():
        true = quantities[quantity].error(one.value, fine)
        if max(true, one.error) < LITTLE * options["accuracy"]:
            continue
        believed, count = believed + (true / WITHIN <= one.error <= WITHIN * true), count + 1
        ratio = one.error / true if true > 0.0 else np.inf
        print(
            f"| {name} | {options['accuracy']:g} | {quantity} | {true:.1e} | {one.error:.1e} | "
            f"{ratio:.2f} |",
            flush=True,
        )
    return believed, count


def of_run(name: str, case: Case, options: dict, fine: dict, details: bool) -> tuple[int, int]:
    """Print the estimate of the run as a whole; whether it is believed, and 1."""
    found = run(case, options)
    all_errors = errors(found, fine)
    worst = max(all_errors, key=all_errors.get)
    true = all_errors[worst]
    print(
        f"| {name} | {options['accuracy']:g} | {true:.1e} | {worst} | {found['estimated']:.1e} | "
        f"{found['estimated'] / true:.2f} | {found['steps']} |",
        flush=True,
    )
    if details:
        print({k: f"{v:.1e}" for k, v in all_errors.items()})
        print({k: f"{v:.1e}" for k, v in found["parts"].items()})
    little = max(true, found["estimated"]) < LITTLE * options["accuracy"]
    return int(little or true / WITHIN <= found["estimated"] <= WITHIN * true), 1


def main() -> None:
    """Run the scenes and print the table."""
    parser = argparse.ArgumentParser(description="Estimated over true errors.")
    parser.add_argument("--only", default="", help="scenes whose name has this")
    parser.add_argument(
        "--quantities",
        type=int,
        nargs="?",
        const=0,
        help="each by itself, from so many finer runs, or as many as it takes",
    )
    args = parser.parse_args()
    columns = ["scene", "asked", "true", "of", "estimated", "over true", "steps"]
    if args.quantities is not None:
        columns = ["scene", "asked", "of", "true", "estimated", "over true"]
    print(f"| {' | '.join(columns)} |\n" + "|---" * len(columns) + "|")
    believed = count = 0
    for name, case in cases().items():
        if args.only not in name:
            continue
        static = {k: v for k, v in case.options.items() if k in STATIC}
        fine = run(case, options_of(case, static | case.fine))
        for asked in ASKED:
            options = options_of(case, case.options) | {"accuracy": asked}
            if "step" in options:
                options["step"] *= asked / ASKED[0]
            if args.quantities is not None:
                good, of = by_quantity(name, case, options, fine, args.quantities or None)
            else:
                good, of = of_run(name, case, options, fine, bool(args.only))
            believed, count = believed + good, count + of
    small = "or both below" if args.quantities is None else "of those above"
    print(
        f"\nwithin a factor of {WITHIN:g}, {small} {LITTLE:g} of what was asked for: "
        f"{believed} of {count}"
    )


if __name__ == "__main__":
    main()
