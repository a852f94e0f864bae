# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time to a residual of 1e-6 against the number of points: sweeps, mixed sweeps, Newton, auto.

    ./fenicsx python3 benchmarks/stall_study.py [--cells 20 40 80 160] [--steps 1 10 100]

The notched plate's matrix and bonds (Perales et al. 2010), each triangle a body, from rest: intact,
stretched along x; and with half of its bonds broken at random, stretched along x and pressed along
y, so that most broken facets slide and others open. Steps are multiples of the explicit limit with
bonds, 3.1e-11 s at 20 x 20, like the square root of the size of a cell.

The residual is the same for all, |S(b) - r| / |r| (`nscd/solvers/tangent.py`): every point asked
once for its exact local answer, nothing changed. Solvers stop by their own estimates: each is given
the loosest of the tolerances 1e-4, 3e-5, 1e-5 ... at which that residual is reached, and this run
is timed, on one thread. Results go to a JSON file, case by case; what is there is not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from plates import crossed_plate  # noqa: E402

from xper_fx.nscd.interactions import Interactions  # noqa: E402
from xper_fx.nscd.laws import CohesiveZone  # noqa: E402
from xper_fx.nscd.solvers import (  # noqa: E402
    AcceleratedSweeps,
    Automatic,
    NewtonOnAllPoints,
    NonlinearGaussSeidel,
    SolveOptions,
)
from xper_fx.nscd.solvers.tangent import residual  # noqa: E402

SIZE, THETA, TARGET = 50e-6, 0.5, 1e-6
BOND = CohesiveZone(2e18, 0.5, 1e9, friction=0.05)
SOLVERS = {
    "nlgs": NonlinearGaussSeidel,
    "accelerated": AcceleratedSweeps,
    "newton": NewtonOnAllPoints,
    "auto": Automatic,
}
CASES = ("intact", "half-broken")
TOLERANCES = [a * 10.0**-b for b in range(4, 9) for a in (1.0, 0.3)]


def state(cells: int, factor: float, case: str):
    """Interactions after `begin_step`, and the free velocity."""
    plate = crossed_plate(cells, SIZE)
    step = factor * 3.1e-11 * np.sqrt(20 / cells)
    inverse = plate.inverse(step, THETA)
    scene = Interactions(plate.points, [BOND], np.zeros(len(plate.points), int), inverse)
    x = np.repeat(plate.x.mean(axis=1), 3, axis=0) - SIZE / 2
    rng = np.random.default_rng(0)
    broken = case == "half-broken"
    free = np.zeros((inverse.num_slots, 2))
    free[: len(x)] = 4e4 * x * [1, -1 if broken else 0] + 0.002 * rng.normal(size=x.shape)
    if broken:
        (group,) = scene.groups
        lost = rng.random(len(plate.points)) < 0.5
        group.state[lost[group.indices], group.kernels.state_names.index("damage")] = 0.0
    scene.begin_step(step, THETA)
    return scene, free.ravel()


def run(cells: int, factor: float, case: str, name: str, max_sweeps: int, patience: float) -> dict:
    """Time of the loosest tolerance that reaches the target."""
    spent = 0.0
    for tolerance in TOLERANCES:
        scene, velocity = state(cells, factor, case)
        start = time.perf_counter()
        options = SolveOptions(tolerance, max_sweeps, relaxation=1.3, num_threads=1)
        report = SOLVERS[name]().solve(scene, velocity, options)
        seconds = time.perf_counter() - start
        spent += seconds
        size, total, _ = residual(scene, velocity)
        reached = bool(size <= TARGET * total)
        if reached or not report.converged or spent > patience:
            break
    return {
        "cells": cells, "points": len(scene), "step": factor, "case": case, "solver": name,
        "seconds": seconds, "reached": reached, "residual": size / total, "tolerance": tolerance,
        "sweeps": report.sweeps, "picked": report.solver, "reason": report.reason,
    }  # fmt: skip


def exponents(results: list[dict]) -> dict:
    """Slope of log time against log points, from least squares, per step, case and solver."""
    slopes = {}
    for key in sorted({(r["step"], r["case"], r["solver"]) for r in results}):
        rows = [r for r in results if (r["step"], r["case"], r["solver"]) == key and r["reached"]]
        if len(rows) > 1:
            slopes[key] = np.polyfit(
                np.log([r["points"] for r in rows]), np.log([r["seconds"] for r in rows]), 1
            )[0]
    return slopes


def table(results: list[dict]) -> str:
    """Markdown: milliseconds, exponents; a dash where the residual was not reached."""
    cells = sorted({r["cells"] for r in results})
    by_key = {(r["step"], r["case"], r["solver"], r["cells"]): r for r in results}
    slopes = exponents(results)
    lines = [
        "| step / limit | plate | solver | " + " | ".join(f"{n} x {n}" for n in cells)
        + " | exponent |",
        "|---" * (len(cells) + 4) + "|",
    ]  # fmt: skip
    for step in sorted({r["step"] for r in results}):
        for case in CASES:
            for name in SOLVERS:
                row = []
                for n in cells:
                    r = by_key.get((step, case, name, n))
                    shown = "" if r is None else f"{1e3 * r['seconds']:.1f}"
                    row.append(shown if r is None or r["reached"] else "not reached")
                slope = slopes.get((step, case, name))
                row.append("" if slope is None else f"{slope:.2f}")
                lines.append(f"| {step:g} | {case} | {name} | " + " | ".join(row) + " |")
    return "\n".join(lines)


def plot(results: list[dict], file: Path) -> None:
    """Time against points, a panel a step size and a row a case."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    steps = sorted({r["step"] for r in results})
    slopes = exponents(results)
    figure, axes = plt.subplots(
        len(CASES), len(steps), figsize=(4 * len(steps), 6.5), sharex=True, squeeze=False
    )
    looks = dict(zip(SOLVERS, ("C0o-", "C1s-", "C2^-", "kx--"), strict=True))
    for row, case in zip(axes, CASES, strict=True):
        for panel, step in zip(row, steps, strict=True):
            for name, look in looks.items():
                rows = sorted(
                    (r["points"], r["seconds"])
                    for r in results
                    if (r["step"], r["case"], r["solver"]) == (step, case, name) and r["reached"]
                )
                if rows:
                    slope = slopes.get((step, case, name))
                    label = name if slope is None else f"{name}, exponent {slope:.2f}"
                    panel.loglog(*zip(*rows, strict=True), look, label=label, markersize=4)
            panel.set_title(f"{case}, step {step:g} x explicit limit", fontsize=10)
            panel.grid(alpha=0.3)
            panel.legend(fontsize=7)
        row[0].set_ylabel("time to a residual of 1e-6 (s)")
    for panel in axes[-1]:
        panel.set_xlabel("interaction points")
    figure.tight_layout()
    figure.savefig(file, dpi=130)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40, 80, 160])
    parser.add_argument("--steps", type=float, nargs="+", default=[1.0, 10.0, 100.0])
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=list(SOLVERS))
    parser.add_argument("--max-sweeps", type=int, default=10_000)
    parser.add_argument("--patience", type=float, default=60.0, help="seconds a case")
    parser.add_argument("--results", type=Path, default=Path("stall_study.json"))
    parser.add_argument("--figure", type=Path, default=None, help="e.g. docs/stall_study.png")
    options = parser.parse_args()
    results = json.loads(options.results.read_text()) if options.results.exists() else []
    known = {(r["cells"], r["step"], r["case"], r["solver"]) for r in results}
    for name in options.solvers:  # compile
        for case in CASES:
            run(4, 30.0, case, name, 1000, 60.0)
    for cells in options.cells:
        for factor in options.steps:
            for case in CASES:
                for name in options.solvers:
                    if (cells, factor, case, name) in known:
                        continue
                    results.append(
                        run(cells, factor, case, name, options.max_sweeps, options.patience)
                    )
                    options.results.write_text(json.dumps(results, indent=1))
    print(table(results))
    if options.figure is not None:
        plot(results, options.figure)


if __name__ == "__main__":
    main()
