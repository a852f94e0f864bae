# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frictional contact problems on their own: time and error of each solver, beside Siconos.

    ./fenicsx python3 benchmarks/friction_cases.py [FOLDER] [--solvers NAME ...] [--repeat R]

FOLDER holds problems as `.npz` or FCLIB `.hdf5`. Each is solved to 1e-8 by "auto", and by the other
solvers named; the least time of R solves counts (building the problem from W, and compiling, do
not: Siconos's figures leave out the like). Beside stand the best times of some twenty Siconos 4.4
configurations, compiled C on one thread of another two-core machine of the kind, to 1e-8 by its own
error ("best"; ours in "its own") and on the scaled problem by the unit-free error ("scaled").
`ns` is the time of one visit of one contact in plain sweeps.

Without a folder, the families of problems that the tests make from geometry: piles, arches, walls,
heaps.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

# one thread, as the figures beside
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
import problems  # noqa: E402

from xper_fx.nscd import FrictionProblem  # noqa: E402
from xper_fx.nscd.friction import SOLVERS, gauss_seidel  # noqa: E402
from xper_fx.nscd.friction.blocks import store  # noqa: E402
from xper_fx.nscd.local_solvers import local_solver  # noqa: E402

TOLERANCE = 1e-8
PATIENCE = 20.0  # seconds a problem and solver

# Siconos 4.4 (ms): best by its own error at 1e-8, best on the scaled problem by the unit-free one.
SICONOS = {
    "FC2D_SliderCrankLagrangian00000": (0.00116, None),
    "FrictionContactProblem00031": (0.00102, None),
    "gfc2d_granularflowonwall_00069_00350__reduced": (0.0179, None),
    "FrictionContactProblem00071": (0.101, None),
    "FrictionContactProblem00237": (2.82, None),
    "fc2d_granularflowonwall_00667_00000": (0.0738, None),
    "GFC3D_Example00_badly_scaled__reduced": (0.00104, None),
    "Confeti-ex13-4contact-Fc3D-SBM": (0.00103, None),
    "Rover4144": (0.0153, None),
    "Rover1041": (0.0234, None),
    "NESpheres_10_1": (0.0191, None),
    "OneObject-i1028-138": (1.94, 2.9),
    "OneObject-i100000-316": (1.56, 1.5),
    "BoxesStack1-i100000-32": (26.2, 16.0),
    "Confeti-ex03-Fc3D-SBM": (0.407, 0.28),
    "LMGC_100_PR_PerioBox-i00361-60-03000": (0.935, 10.0),
    "Capsules-i101-404": (17.4, 29.0),
    "Capsules-i100-1090": (37.0, 23.0),
    "Capsules-i125-1213": (23.5, 36.0),
}

FAMILIES = {
    "square pile of 20 rows": lambda: problems.square_pile(20),
    "pyramid of 20 rows": lambda: problems.pyramid(20),
    "arch, t/R 3 % under": lambda: problems.arch(20, 0.97 * 0.1075),
    "arch, t/R 3 % over": lambda: problems.arch(20, 1.03 * 0.1075),
    "boxes, stack of 13": lambda: problems.box_stack(13),
    "boxes, stack of 50": lambda: problems.box_stack(50),
    "boxes, wall of 6 x 8": lambda: problems.box_wall(6, 8),
    "column under mass 1e6": lambda: problems.column_with_mass_ratio(10, 1e6),
    "stack hit": lambda: problems.impact(20),
    "200 points, one body": lambda: problems.one_object(200, 3),
    "spheres, heap of 1000": lambda: problems.sphere_heap(1000),
    "capsules, heap of 90": lambda: problems.capsule_heap(90),
    "capsules, heap of 250": lambda: problems.capsule_heap(250),
}


def visit_time(problem: FrictionProblem, sweeps: int = 50) -> float:
    """Nanoseconds a visit of plain sweeps, which pass over nothing that still moves."""
    stored = store(problem.W, problem.q, problem.mu, problem.dim, "given").problem
    local = local_solver(problem.dim, {2: "graph", 3: "exact"}[problem.dim])
    least = np.inf
    for _ in range(20):
        r = np.zeros_like(stored.q)
        start = time.perf_counter()
        done = gauss_seidel.sweep(stored, local, r, tolerance=1e-300, max_sweeps=sweeps)
        least = min(least, (time.perf_counter() - start) / done.visits)
    return 1e9 * least


def solve(problem: FrictionProblem, solver: str, repeat: int):
    """Least time in ms, and the result."""
    result = problem.solve(solver, tolerance=TOLERANCE, max_sweeps=100_000)  # compiles
    least, spent = np.inf, 0.0
    for _ in range(repeat):
        start = time.perf_counter()
        result = problem.solve(solver, tolerance=TOLERANCE, max_sweeps=100_000)
        elapsed = time.perf_counter() - start
        least, spent = min(least, elapsed), spent + elapsed
        if spent > PATIENCE:
            break
    return 1e3 * least, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--solvers", nargs="*", default=[], choices=SOLVERS)
    parser.add_argument("--repeat", type=int, default=20)
    options = parser.parse_args()
    if options.folder is None:
        cases = {name: FrictionProblem(*make()) for name, make in FAMILIES.items()}
    else:
        files = sorted(p for p in options.folder.iterdir() if p.suffix in (".npz", ".hdf5", ".h5"))
        if not files:
            parser.error(f"no .npz, .hdf5 or .h5 file in {options.folder}")
        cases = {p.stem: FrictionProblem.read(p) for p in files}
    others = [name for name in options.solvers if name != "auto"]
    print(
        "| problem | dim | contacts | ns | auto (ms) | error | its own | solvers | best | scaled |"
        + "".join(f" {name} (ms) |" for name in others)
    )
    print("|---" * (10 + len(others)) + "|")
    for name, problem in sorted(cases.items(), key=lambda item: len(item[1])):
        elapsed, result = solve(problem, "auto", options.repeat)
        best, scaled = (f"{t:.3g}" if t else "" for t in SICONOS.get(name, (None, None)))
        line = (
            f"| {name} | {problem.dim} | {len(problem)} | {visit_time(problem):.0f} | "
            f"{elapsed:.3g}{'' if result.converged else ' NOT SOLVED'} | {result.error:.1e} | "
            f"{result.errors.siconos_error:.1e} | {result.solver} | {best} | {scaled} |"
        )
        for other in others:
            elapsed, result = solve(problem, other, 3)
            line += f" {elapsed:.3g} |" if result.converged else f" ({result.error:.0e}) |"
        print(line, flush=True)


if __name__ == "__main__":
    main()
