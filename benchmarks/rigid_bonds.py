# SPDX-License-Identifier: LGPL-3.0-or-later
"""What initially rigid bonds change: stiffness, time, convergence, beside elastic ones.

    ./fenicsx python3 benchmarks/rigid_bonds.py [--cells 20 40 80] [--courant 0.9]
    ./fenicsx python3 benchmarks/rigid_bonds.py --intact 40 500

The notched plate (`demos/notched_plate.py`) with bonds of the same strengths, energies and linear
softening, rigid or elastic (the demo's stiffnesses), pulled to 1.2 % by steps of a share of the
critical step of free cells, on one thread. Each line has the processor time of the steps, compiling
and output aside, the peak, what cracks took, closing lips, numerical energy and closure over the
external work, and how many vertices were split in the end; elastic and rigid take turns. Then the
resolved plate, whose peak and cracking energy should not hang on the mesh.

With `--intact`, steps of a uniformly stretched square whose bonds are rigid and hold, and of the
same cells without bonds, in turns; what the former holds in memory; and how long the vertices take
to be told that they hold when the stress is some share of the strength.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import xper_fx as xf
from xper_fx.nscd.splitting.whole_vertices import whole_kernel
from xper_fx.output.memory import memory_by_part

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
import notched_plate as demo  # noqa: E402

FINAL, EARLY = 0.012, 1e-3
BONDS = ("elastic", "rigid")


class Run(NamedTuple):
    """What a run gave: s, steps, MPa at the peak and at `EARLY`, J/m."""

    seconds: float
    steps: int
    peak: float
    early: float
    cracks: float
    lips: float
    numerical: float
    closure: float
    work: float
    split: str


def plate(cells: int, interface: str, bonds: str, resolved: bool) -> xf.Scene:
    """The demo's scene with linear softening."""
    toughening = demo.toughening() if resolved else 1.0
    rigid = bonds == "rigid"
    scene = demo.notched_plate(cells, interface, toughening=toughening, rigid=rigid)
    laws = demo.bonds(interface, toughening, False, rigid)
    if not rigid:
        laws = {pair: replace(law, curve=xf.laws.curves.Linear()) for pair, law in laws.items()}
    return replace(scene, interactions=laws)


def run(cells: int, interface: str, bonds: str, courant: float, resolved: bool = False) -> Run:
    """Pull a plate; the time of the first steps, which compile, is left out."""
    scene = plate(cells, interface, bonds, resolved)
    step = courant * xf.Simulation(scene, scheme="explicit").bulk.critical_step()
    simulation = xf.Simulation(scene, step, scheme="explicit", num_threads=1, forgiving=True)
    gauge = xf.TensileGauge(demo.LEFT, demo.RIGHT, 0, demo.SIZE, demo.SIZE)
    end = FINAL * demo.SIZE / (2.0 * demo.SPEED)
    list(simulation.steps(3.0 * step))
    peak, early, seconds, count = 0.0, 0.0, 0.0, 3
    start = time.process_time()
    for _ in simulation.steps(end):
        seconds += time.process_time() - start
        count += 1
        strain, stress = gauge.read(simulation)
        peak = max(peak, stress)
        early = stress if strain <= EARLY else early
        start = time.process_time()
    e = simulation.ledger.as_columns()
    fused = simulation.interactions.fused
    split = "" if fused is None else f"{len(fused.split)} of {fused.graphs.num_vertices}"
    return Run(
        seconds, count, 1e-6 * peak, 1e-6 * early, e["dissipated_cohesion"],
        e["dissipated_impact"], e["dissipated_numerical"], e["closure"], e["external_work"], split,
    )  # fmt: skip


def line(cells: int, interface: str, bonds: str, found: Run) -> str:
    """A row of the table."""
    share = 1e2 / found.work
    return (
        f"| {cells} | {interface} | {bonds} | {found.steps} | {found.seconds:.2f} | "
        f"{1e3 * found.seconds / found.steps:.2f} | {found.peak:.1f} | {found.early:.1f} | "
        f"{1e3 * found.cracks:.4f} | {1e3 * found.lips:.3f} | {share * found.numerical:.1g} | "
        f"{found.closure / found.work:.0e} | {found.split} |"
    )


STRETCH, SHARES = 1e-3, (0.1, 0.5, 0.8)


def square(cells: int, holds: bool, share: float) -> xf.Scene:
    """A square at a uniform stress along x, `share` of its bonds' strength, held at both ends."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells))
    ends = xf.tag_facets(mesh, {1: lambda x: x[0] < 1e-9, 2: lambda x: x[0] > 1.0 - 1e-9})
    law = xf.laws.RigidCohesiveZone(STRETCH / share, 1.0) if holds else None
    return xf.Scene(
        xf.explode(mesh, facet_tags=ends), {1: xf.materials.LinearElastic(1.0, 0.0, 1.0)},
        interactions={(1, 1): law},
        loads=[xf.PrescribedVelocity(end, 0, 0.0) for end in (1, 2)],
    )  # fmt: skip


def stretched(cells: int, holds: bool, share: float) -> xf.Simulation:
    """The square as it is stretched, after steps that compile."""
    simulation = xf.Simulation(square(cells, holds, share), scheme="explicit", num_threads=1)
    x = simulation.forms.V.tabulate_dof_coordinates()[:, :2]
    u = (x * [STRETCH, 0.0]).ravel()
    internal = simulation.bulk.internal(u)
    simulation.state = replace(simulation.state, displacement=u, forces=internal)
    list(simulation.steps(3.0 * simulation.step_size))
    return simulation


def telling(simulation: xf.Simulation, repeats: int) -> float:
    """Least processor time in which whole vertices are moved, or told not to hold (s)."""
    points, solver = simulation.interactions, simulation.solver
    fused, state = points.fused, simulation.state
    force = simulation.bulk.internal(state.displacement)
    free = np.zeros(points.inverse.num_slots * points.dim)
    mass = simulation.bulk.mass
    free[: len(force)] = -simulation.step_size * force / mass
    free[: len(force)][simulation.bulk.layout.prescribed] = 0.0
    move, least = whole_kernel(tuple(g.kernels for g in fused.groups), points.dim), np.inf
    for _ in range(repeats):
        velocity = free.copy()
        start = time.process_time()
        move(
            velocity, fused.impulses, simulation.step_size, points.inverse.num_nodes, fused.graphs,
            solver._work, solver._all, fused.whole, fused.table_rows, fused.group_of, fused.tables,
            fused.failed,
        )  # fmt: skip
        least = min(least, time.process_time() - start)
    return least


def intact(cells: int) -> None:
    """Print what a step takes that nothing breaks in."""
    repeats = max(3, 40_000 // cells**2)
    both = [stretched(cells, holds, SHARES[0]) for holds in (True, False)]
    least = [np.inf, np.inf]
    for _ in range(repeats):
        for which, simulation in enumerate(both):
            end = simulation.time + 4.0 * simulation.step_size
            start = time.process_time()
            for _ in simulation.steps(end):
                pass
            least[which] = min(least[which], (time.process_time() - start) / 4)
    count = 4 * cells**2
    row = f"| {count} | {1e3 * least[0]:.3f} | {1e3 * least[1]:.3f} | "
    row += f"{1e9 * (least[0] - least[1]) / count:.0f} |"
    bonds = len(both[0].interactions.fused.graphs.point)
    row += f" {sum(memory_by_part(both[0]).values()) / bonds:.0f} |"
    del both
    for share in SHARES:
        simulation = stretched(cells, True, share)
        row += f" {1e9 * telling(simulation, repeats) / count:.0f} |"
    print(row, flush=True)


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--cells", type=int, nargs="+", default=[20, 40])
    add("--courant", type=float, default=0.9, help="step over the critical one of free cells")
    add("--intact", type=int, nargs="+", help="cells a side of squares that hold")
    options = parser.parse_args(arguments)
    if options.intact:
        shares = " | ".join(f"vertices at {share:g} s (ns a cell)" for share in SHARES)
        print(f"| cells | ms a step | without bonds | ns a cell more | bytes a bond | {shares} |")
        for cells in options.intact:
            intact(cells)
        return
    head = (
        "| cells | interface | bonds | steps | s | ms a step | peak (MPa) | at 0.1 % (MPa) | "
        "cracks (mJ/m) | lips (mJ/m) | numerical (%) | closure | split |\n" + 13 * "|---" + "|"
    )
    for resolved in (False, True):
        print("\nresolved" if resolved else "as printed", head, sep="\n")
        for cells in options.cells:
            for interface in ("strong", "weak"):
                both = []
                for bonds in BONDS:
                    both.append(run(cells, interface, bonds, options.courant, resolved))
                    print(line(cells, interface, bonds, both[-1]), flush=True)
                ratio = both[0].seconds / both[1].seconds
                print(f"| | | | | elastic over rigid: {ratio:.1f} | | | | | | | | |", flush=True)


if __name__ == "__main__":
    main()
