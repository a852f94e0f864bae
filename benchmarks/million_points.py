# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time and memory from 10 000 to 1 000 000 interaction points, on one machine.

    OPENBLAS_NUM_THREADS=1 ./fenicsx python3 benchmarks/million_points.py [--cells ...]

The notched plate (`demos/notched_plate.py`, homogeneous, each triangle a body, two points a facet)
with either bulk. Prints a line a size and fits y = c points^p to each row's last column. Times are
the processor's, on one thread, compiling left out; steps are also given as wall times on one
thread and on all. Memory is that of the arrays held after some steps, by part, and beside it the
highest resident memory of the whole process meanwhile (Linux), some 400 MB of which are Python,
DOLFINx and compiled kernels. Phases of the set-up are those of the simulation's stopwatch.

**The limit** of a step is memory. Its arrays hold what it reads and what it writes; the last column
is its time over that in which the machine copies half of these bytes on to the other half.

**Single precision** was tried where it would be least noticed. The inverses that an explicit bulk
keeps for its vertices (209 bytes a point of some 1200), which only correct what is then confirmed
in double precision, drift by their many small changes: over a weak plate of 40 x 40 to 0.6 % strain
the sum over steps of the most visits that a vertex needed doubles (21 923 to 42 195 at a tolerance
of 1e-3, 42 015 to 79 571 at 1e-6), for 7 % less time or none. They stay double. Terms of the laws
and w would be a half of what a sweep moves; but the bonds' impulses and the velocities are what
the energy ledger, which closes to 1e-13, is made of.

**The sweep** is one in which every point moves, as in a step: velocities are disturbed before it.
12 160 points stay in the cache and take 15 ns each, 1 022 000 come from memory and take 39 ns,
hence an exponent of 1.25 over all sizes; without asking for the memory of points to come
(`nscd/couplings.fetch_kernel`) it was 60 ns. Some 300 bytes a point at the 16 GB/s that one thread
reads here would take 20 ns. Asking for the laws' terms as well, which lie in order, gave nothing;
tiles grown as compact patches instead of strips another 13 % at 1 022 000 points, nothing below.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
from notched_plate import notched_plate  # noqa: E402

from xper_fx.nscd.solvers.solver import SolveOptions  # noqa: E402
from xper_fx.nscd.solvers.sweeps import prepare_sweep, sweep_ranks  # noqa: E402
from xper_fx.output.memory import memory_by_part  # noqa: E402
from xper_fx.plotting.figures import COLOURS, new_figure  # noqa: E402
from xper_fx.simulation.simulation import Simulation  # noqa: E402

STEPS, BEFORE = 8, 4  # timed, and made before: the first ones take memory from the system
SWEEPS = 20
TIMED = ("mesh and bodies", "set-up", "assembly", "sweep", "step")


def least(work, repeat: int) -> float:
    """Least processor time of some calls (s)."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def copying(count: float) -> float:
    """Least processor time in which half of so many bytes are read and half written (s)."""
    given = np.ones(int(count) // 16)
    taken = np.zeros_like(given)
    return least(lambda: np.copyto(taken, given), 5)


def simulation_of(scene, cells: int, scheme: str) -> Simulation:
    """The plate with an explicit bulk, or with an implicit one at five times its bonds' step."""
    if scheme == "explicit":
        return Simulation(scene, scheme=scheme, tolerance=1e-3)
    step = 5 * 3.1e-11 * 20 / cells
    return Simulation(scene, step, scheme=scheme, solver="nlgs", tolerance=1e-3)


def advance(simulation: Simulation, count: int) -> tuple[float, float]:
    """Processor and wall time of a step (s)."""
    start, wall = time.process_time(), time.perf_counter()
    for _ in simulation.steps(simulation.time + count * simulation.step_size):
        pass
    return (time.process_time() - start) / count, (time.perf_counter() - wall) / count


def measured(cells: int, scheme: str, threads: int) -> dict:
    """Times and memory of one size."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)  # what the last size has left goes back to the system
    Path("/proc/self/clear_refs").write_text("5")  # forget the highest resident memory so far
    numba.set_num_threads(1)
    start = time.process_time()
    scene = notched_plate(cells, "strong", homogeneous=True)
    meshed, wall = time.process_time(), time.perf_counter()
    simulation = simulation_of(scene, cells, scheme)
    out = {
        "cells": cells,
        "scheme": scheme,
        "points": len(simulation.interactions),
        "bodies": scene.bodies.num_bodies,
        "mesh and bodies": meshed - start,
        "set-up": time.process_time() - meshed,
    }
    share = out["set-up"] / (time.perf_counter() - wall)  # of the processor, busy with others
    phases = simulation.stopwatch.rows()
    out["phases"] = {r.path[-1]: share * r.own for r in phases if r.path[0] == "set-up"}
    advance(simulation, BEFORE)
    out["step"], out["wall of a step"] = advance(simulation, STEPS)
    if threads > 1:
        numba.set_num_threads(threads)
        advance(simulation, 1)
        out[f"wall of a step, {threads} threads"] = advance(simulation, STEPS)[1]
        numba.set_num_threads(1)
    status = Path("/proc/self/status").read_text()
    out["highest resident"] = 1024 * int(re.search(r"VmHWM:\s+(\d+) kB", status)[1])
    out["arrays"] = memory_by_part(simulation)
    out["copy"] = copying(sum(out["arrays"].values()))
    bulk, rest = simulation.bulk, np.zeros(simulation.bulk.num_dofs)
    out["assembly"] = least(lambda: bulk.tangent(rest), 2)
    if scheme == "implicit":
        h = simulation.step_size
        out["assembly"] += least(lambda: simulation.scheme._inverses.at(h, rest, renew=True), 2)
        out["sweep"] = min(sweeps(simulation))
    return out


def sweeps(simulation: Simulation) -> Iterator[float]:
    """Processor times of sweeps in which every point moves (s)."""
    velocity, random = simulation.last.slots.ravel().copy(), np.random.default_rng(0)
    interactions = simulation.interactions
    sweep = prepare_sweep(interactions, velocity, SolveOptions(num_threads=1))
    size = 0.01 * np.abs(velocity).max()
    for _ in range(SWEEPS):
        velocity += size * random.normal(size=len(velocity))
        start = time.process_time()
        sweep_ranks(interactions, sweep, velocity)
        yield time.process_time() - start


def exponent(rows: list[dict], value) -> float:
    """p of value = c points^p by least squares of the logarithms."""
    points = np.log([row["points"] for row in rows])
    return float(np.polyfit(points, np.log([value(row) for row in rows]), 1)[0])


def report(rows: list[dict]) -> None:
    """Print what was measured."""
    for scheme in dict.fromkeys(row["scheme"] for row in rows):
        of = [row for row in rows if row["scheme"] == scheme]
        names = [n for n in TIMED if n in of[0]]
        print(f"\n{scheme} bulk, processor time on one thread (s)")
        print(
            f"{'points':>9}"
            + "".join(f"{n:>17}" for n in names)
            + "   bytes a point   highest MB   step / copy"
        )
        for row in of:
            arrays = sum(row["arrays"].values()) / row["points"]
            print(
                f"{row['points']:9d}"
                + "".join(f"{row[n]:17.4f}" for n in names)
                + f"{arrays:16.0f}{row['highest resident'] / 1e6:13.0f}"
                + f"{row['step'] / row['copy']:14.2f}"
            )
        if len(of) > 1:
            total = exponent(of, lambda r: sum(r["arrays"].values()))
            print(
                " exponent"
                + "".join(f"{exponent(of, lambda r, n=n: r[n]):17.2f}" for n in names)
                + f"{total:16.2f}"
            )
        last = of[-1]
        for name, seconds in last["phases"].items():
            print(f"  {name:<22}{seconds:8.3f} s of the set-up")
        for name, count in last["arrays"].items():
            print(f"  {name:<22}{count / last['points']:8.0f} bytes a point")
        for name in last:
            if name.startswith("wall"):
                print(f"  {name:<30}{last[name]:8.3f} s")


def draw(rows: list[dict], path: Path) -> None:
    """Times and memory against points, each beside a slope of one."""
    labels = {
        "set-up": "set-up, mesh included",
        "assembly": "assembly",
        "step": "one step",
        "sweep": "one sweep",
    }
    quantities = [
        (0, label, lambda r, n=n: r[n] + (r["mesh and bodies"] if n == "set-up" else 0.0), n)
        for n, label in labels.items()
    ]
    quantities += [
        (1, "arrays", lambda r: sum(r["arrays"].values()), "arrays"),
        (1, "highest resident", lambda r: r["highest resident"], "highest resident"),
    ]

    def fill(figure, axes) -> None:
        named = set()
        for scheme, line in (("explicit", "-"), ("implicit", "--")):
            of = [row for row in rows if row["scheme"] == scheme]
            for colour, (panel, label, value, name) in zip(COLOURS, quantities, strict=False):
                if of and name in of[0]:
                    axes[panel].loglog(
                        [r["points"] for r in of], [value(r) for r in of], line, color=colour,
                        marker="o", markersize=3, label=None if name in named else label,
                    )  # fmt: skip
                    named.add(name)
        ends = np.array([min(r["points"] for r in rows), max(r["points"] for r in rows)])
        for panel, factor, what in ((0, 1e-6, "processor time (s)"), (1, 700.0, "memory (bytes)")):
            axes[panel].loglog(ends, factor * ends, "k:", linewidth=1.0, label="slope 1")
            for scheme, line in (("explicit", "k-"), ("implicit", "k--")):
                axes[panel].plot([], [], line, linewidth=1.0, label=scheme)
            axes[panel].set(xlabel="interaction points", ylabel=what)
            axes[panel].legend(fontsize=6)

    new_figure(path, fill, (7.5, 3.6), ncols=2)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--cells", type=int, nargs="+", default=[32, 52, 92, 164, 292],
        help="quads a side, multiples of 4")  # fmt: skip
    add("--schemes", nargs="+", choices=("explicit", "implicit"), default=["explicit", "implicit"])
    add("--results", type=Path, default=Path("million_points.json"))
    add("--figure", type=Path, default=None, help="e.g. docs/million_points.png")
    options = parser.parse_args()
    threads = numba.get_num_threads()
    rows = []
    for scheme in options.schemes:
        measured(64, scheme, threads)  # compile; large enough for all that is threaded
        for cells in sorted(options.cells):
            rows.append(measured(cells, scheme, threads))
            options.results.write_text(json.dumps(rows, indent=1))
    report(rows)
    if options.figure:
        draw(rows, options.figure)


if __name__ == "__main__":
    main()
