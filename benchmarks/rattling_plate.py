# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies of a plate that breaks and whose pieces rattle on for 1e5 steps.

    ./fenicsx python3 benchmarks/rattling_plate.py [--steps 100000] [--figure rattling_plate.png]

Where cohesive elements are put in as cracks grow and contact is a penalty, energy grows without
bound as pieces go to and fro between cohesion and contact (Ghesquiere-Dierickx, Molinari and
Anciaux 2025). Here bonds are initially rigid and contacts act on velocities, in
an explicit bulk.

- **Clamped**: the sides are held and shaken, the start throws the plate about. Its pieces stay
  where they are and strike each other with e = 1, without friction. Small strain: the balance of
  energies is exact, and what is left of it is rounding.
- **Loose**: a plate at finite strain bursts within a frame; pieces tumble, meet each other and the
  frame wherever a search finds them, with e = 1, without friction. Central differences leave an
  error of the energy of a nonlinear bulk, of second order in the step, that must not grow. A step
  costs some six times that of the clamped plate, and so there are a fifth as many.

Each line has steps, processor time of one, work of the loads and what was dissipated over the
energy of the start, the largest error of the balance of energies over it up to a tenth, half and
the end of the run, pieces, broken bonds, and what of the dissipation is numerical.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

import xper_fx as xf

STRENGTH, ENERGY, CLAMPED_SPEED, LOOSE_SPEED = 1e-2, 5e-6, 0.006, 0.012
SHAKEN, OMEGA = 5e-4, 2.0
GAP, BAR = 0.1, 0.1
SHARE = 0.8  # of the critical step of free cells


class Course(NamedTuple):
    """A thousand times on the way, energies over the kinetic one of the start.

    `balanced` is what the scheme has to conserve: what it holds at the start, which is not the
    kinetic energy alone where steps are long, and the work of the loads.
    """

    steps: np.ndarray
    kinetic: np.ndarray
    elastic: np.ndarray
    cohesive: np.ndarray
    dissipated: np.ndarray
    work: np.ndarray
    balanced: np.ndarray
    closure: np.ndarray
    milliseconds: float
    end: str


def clamped(cells: int) -> xf.Scene:
    """A plate whose sides are held, and shaken along x."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells))
    sides = xf.tag_facets(mesh, {1: lambda x: np.abs(x[:2] - 0.5).max(axis=0) > 0.5 - 1e-9})
    waves = np.random.default_rng(0).normal(size=(2, 4, 4))
    order = np.pi * np.arange(1, 5)
    return xf.Scene(
        xf.explode(mesh, facet_tags=sides),
        {1: xf.materials.LinearElastic(1.0, 0.3, 1.0)},
        default_interaction=bond(),
        loads=[
            xf.PrescribedVelocity(1, 0, lambda t: SHAKEN * np.sin(OMEGA * t)),
            xf.PrescribedVelocity(1, 1, 0.0),
        ],
        initial_velocity=lambda x: CLAMPED_SPEED * np.einsum(
            "dij,in,jn->dn", waves, *(np.sin(np.outer(order, x[d])) for d in range(2))
        ),
    )  # fmt: skip


def loose(cells: int) -> xf.Scene:
    """A plate that bursts within a frame of four bars."""
    near, far = -GAP, 1.0 + GAP
    plate = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells))
    bars = [
        xf.crossed_rectangle((near - BAR, near - BAR), (near, far + BAR), (1, 4)),
        xf.crossed_rectangle((far, near - BAR), (far + BAR, far + BAR), (1, 4)),
        xf.crossed_rectangle((near, near - BAR), (far, near), (4, 1)),
        xf.crossed_rectangle((near, far), (far, far + BAR), (4, 1)),
    ]
    everywhere = lambda x: x[0] > -np.inf  # noqa: E731
    joined = xf.join_meshes(
        [plate, *bars],
        [None] + [xf.tag_cells(bar, {2: everywhere}) for bar in bars],
        [None] + [xf.tag_facets(bar, {1: everywhere}) for bar in bars],
    )
    count = np.count_nonzero(joined.part == 0)
    label = np.where(joined.part == 0, np.arange(len(joined.part)), count + joined.part)
    lips = xf.laws.SignoriniCoulomb(0.0, restitution=1.0)
    return xf.Scene(
        xf.explode(joined.mesh, label, joined.cell_tags, joined.facet_tags),
        dict.fromkeys((1, 2), xf.materials.SaintVenantKirchhoff(1.0, 0.3, 1.0)),
        default_interaction=bond(),
        surfaces={"plate": (1,), "frame": (2,)},
        contacts=[
            xf.Contact(("plate", "plate"), lips), xf.Contact(("plate", "frame"), lips),
            xf.Contact(("frame", "frame"), None),
        ],
        loads=[xf.PrescribedVelocity(1, axis, 0.0) for axis in range(2)],
        initial_velocity={
            1: lambda x: LOOSE_SPEED * np.stack([2 * x[0] - 0.6 - x[1], 2 * x[1] - 1.4 + x[0]])
        },
    )  # fmt: skip


def bond() -> xf.laws.RigidCohesiveZone:
    """Strengths scatter by a tenth; broken lips rebound without loss."""
    strength = xf.fields.Uniform(0.9 * STRENGTH, 1.1 * STRENGTH, 0)
    return xf.laws.RigidCohesiveZone(strength, ENERGY, restitution=1.0)


def simulate(scene: xf.Scene, tolerance: float) -> xf.Simulation:
    """A run of the scene, before its first step."""
    step = SHARE * xf.Simulation(scene, scheme="explicit").bulk.critical_step()
    return xf.Simulation(scene, step, scheme="explicit", tolerance=tolerance, num_threads=1)


def rattle(simulation: xf.Simulation, steps: int) -> Course:
    """Make steps, keep what the energies were."""
    start = simulation.ledger.energies.kinetic
    rows, every, clock = [], max(1, steps // 1000), time.process_time()
    for number, _ in enumerate(simulation.steps(steps * simulation.step_size), 1):
        if number % every == 0:
            e = simulation.ledger.as_columns()
            lost = sum(value for name, value in e.items() if name.startswith("dissipated"))
            held = (e["kinetic"], e["elastic"], e["cohesive"])
            balanced = sum(held) + e["shadow"] + lost + e["closure"]
            rows.append((*held, lost, e["external_work"], balanced, e["closure"]))
    spent = 1e3 * (time.process_time() - clock) / steps
    columns = np.array(rows).T / start
    pieces = len(set(xf.output.find_fragments(simulation)))
    broken = np.count_nonzero(xf.output.broken_points(simulation))
    numerical = simulation.ledger.energies.dissipated_numerical / start
    end = f"{pieces} | {broken} of {len(simulation.interactions)} | {numerical:.0e}"
    return Course(every * np.arange(1, len(rows) + 1), *columns, spent, end)


def line(name: str, course: Course) -> str:
    """A row of the table."""
    size = np.maximum.accumulate(np.abs(course.closure))
    tenths = ", ".join(f"{size[len(size) * tenth // 10 - 1]:.0e}" for tenth in (1, 5, 10))
    return (
        f"| {name} | {course.steps[-1]} | {course.milliseconds:.2f} | {course.work[-1]:.2g} | "
        f"{course.dissipated[-1]:.3f} | {tenths} | {course.end} |"
    )


def draw(courses: dict[str, Course], file: Path) -> None:
    """Energies and their balance against steps, a column a scene."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(courses), figsize=(10, 5.5), sharex="col", squeeze=False,
                                layout="constrained")  # fmt: skip
    for (name, course), (above, below) in zip(courses.items(), axes.T, strict=True):
        above.stackplot(
            course.steps, course.dissipated, course.cohesive, course.elastic, course.kinetic,
            labels=("dissipated", "in open bonds", "elastic", "kinetic"),
            colors=("0.8", "tab:green", "tab:blue", "tab:orange"),
        )  # fmt: skip
        above.plot(course.steps, course.balanced, "k--", lw=1.0, label="start and work of loads")
        above.set(title=name, ylabel="energy over that of the start")
        above.legend(loc="center right")
        below.semilogy(course.steps, np.abs(course.closure), lw=0.8)
        below.set(xlabel="steps", ylabel="error of their balance")
    figure.savefig(file, dpi=130)


def main(arguments: list[str] | None = None) -> None:
    """Print the table, draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--steps", type=int, default=100_000)
    add("--cells", type=int, default=6, help="squares of four triangles along the plate")
    add("--scenes", nargs="+", choices=("clamped", "loose"), default=["clamped", "loose"])
    add("--figure", type=Path, help="file of the figure")
    options = parser.parse_args(arguments)
    print(
        "| scene | steps | ms a step | work | dissipated | closure, 1/10, 1/2, all | pieces | "
        "broken | numerical |\n" + 9 * "|---" + "|"
    )
    courses = {}
    for name in options.scenes:
        scene, tolerance, steps = {
            "clamped": (clamped, 1e-8, options.steps), "loose": (loose, 1e-5, options.steps // 5)
        }[name]  # fmt: skip
        courses[name] = rattle(simulate(scene(options.cells), tolerance), steps)
        print(line(name, courses[name]), flush=True)
    if options.figure is not None:
        draw(courses, options.figure)


if __name__ == "__main__":
    main()
