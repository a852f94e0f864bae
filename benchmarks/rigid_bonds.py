# SPDX-License-Identifier: LGPL-3.0-or-later
"""What initially rigid bonds change: stiffness, time, convergence, beside elastic ones.

    ./fenicsx python3 benchmarks/rigid_bonds.py [--cells 20 40 80] [--courant 0.9]

The notched plate (`demos/notched_plate.py`) with bonds of the same strengths, energies and linear
softening, rigid or elastic (the demo's stiffnesses), pulled to 1.2 % by steps of a share of the
critical step of free cells, on one thread. Each line has the processor time of the steps, compiling
and output aside, the peak, what cracks took, closing lips, numerical energy and closure over the
external work, and how many vertices were split in the end; elastic and rigid take turns. Then the
resolved plate, whose peak and cracking energy should not hang on the mesh.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import xper_fx as xf

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


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--cells", type=int, nargs="+", default=[20, 40])
    add("--courant", type=float, default=0.9, help="step over the critical one of free cells")
    options = parser.parse_args(arguments)
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
