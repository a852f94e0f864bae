# SPDX-License-Identifier: LGPL-3.0-or-later
"""How a notched plate scales with the number of ranks, and what more ranks would give.

    ./fenicsx python3 benchmarks/rank_scaling.py

Each number of ranks is a process group of its own (`mpirun -n N`), one thread a rank:

- *strong*: the plate stays, ranks share it;
- *weak*: the number of cells a rank stays.

For the explicit bulk with vertices solved alone and for the implicit bulk with sweeps it prints the
time of a step, the part of it spent in exchanges and sums over ranks (waiting for others included),
messages and bytes. More ranks than cores share the cores, so that times then say nothing.

The model: a step of n points on P ranks takes

    t = (w n / P) b + m (l + c) + s / v,

w: time of a point measured on one rank, b: imbalance of the partition; m: messages that a rank
sends or waits for in a step, s: bytes; l, v: latency and bandwidth between ranks (assumed: 2 us
and 10 GB/s, an InfiniBand network); c: what an exchange or a sum costs in software and in waiting
for the other, the mean over a step of two ranks here, so that the model is rather pessimistic.
m, s and b come from the partition of the plate itself for P ranks, whose cuts grow with
(n P)^(1/2) in the plane: the graph of bodies is divided for 64 and 1024 ranks here, nothing is
extrapolated.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "demos"))
from notched_plate import notched_plate

from xper_fx.parallel.halo import Exchange
from xper_fx.parallel.local_bodies import bodies_by_rank
from xper_fx.parallel.ownership import owners_by_facet, phases
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.ranks import Ranks

LATENCY, BANDWIDTH = 2e-6, 10e9
WARM, STEPS = 3, 12


class Clock:
    """Counts calls, bytes and seconds of what ranks exchange."""

    def __init__(self):
        self.seconds, self.calls, self.bytes = 0.0, 0, 0
        self._wrap(Exchange, "forward")
        self._wrap(Exchange, "back")
        self._wrap(Exchange, "add_back")
        self._wrap(Ranks, "sum")
        self._wrap(Ranks, "max")

    def _wrap(self, kind, name: str) -> None:
        method = getattr(kind, name)

        def timed(this, *arguments):
            start = time.perf_counter()
            result = method(this, *arguments)
            self.seconds += time.perf_counter() - start
            self.calls += 1
            self.bytes += getattr(this, "bytes_sent", 8)
            return result

        setattr(kind, name, timed)


def measure(cells: int, scheme: str) -> dict:
    """Steps of the plate on all ranks that were started."""
    clock = Clock()
    start = time.perf_counter()
    simulation = Simulation(
        notched_plate(cells, "weak", homogeneous=True), scheme=scheme, tolerance=1e-3,
        solver="auto" if scheme == "explicit" else "nlgs", num_threads=1,
    )  # fmt: skip
    set_up = time.perf_counter() - start
    step, ranks = simulation.step_size, simulation.ranks
    for _ in simulation.steps(WARM * step):
        pass
    clock.seconds, clock.calls, clock.bytes = 0.0, 0, 0
    cpu, wall, sweeps = time.process_time(), time.perf_counter(), 0
    for record in simulation.steps((WARM + STEPS) * step):
        sweeps += record.sweeps
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return {
        "ranks": ranks.size,
        "points": simulation.interactions.num_points,
        "set_up": set_up,
        "step": wall / STEPS,
        "cpu": ranks.max(cpu) / STEPS,
        "exchange": ranks.max(clock.seconds) / STEPS,
        "calls": clock.calls / STEPS,
        "bytes": ranks.max(clock.bytes) / STEPS,
        "sweeps": sweeps / STEPS,
    }


def on_ranks(count: int, cells: int, scheme: str) -> dict:
    """`measure` in a process group of its own."""
    command = ["mpirun", "--oversubscribe", "-n", str(count), sys.executable, __file__]
    command += ["--worker", "--cells", str(cells), "--scheme", scheme]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def row(label: str, r: dict, one: dict, share: float) -> None:
    """A line of the table; `share` is what an ideal machine would make of the first line's time."""
    efficiency = one["step"] * share / r["step"]
    print(
        f"{label:24}{r['ranks']:3d} {r['points']:9d} {r['step'] * 1e3:9.2f} {efficiency:8.2f} "
        f"{r['exchange'] / r['step']:8.2f} {r['calls']:8.0f} {r['bytes'] / 1e3:9.1f} "
        f"{r['sweeps']:7.1f}"
    )


def model(cells: int, one: dict, two: dict, scheme: str) -> None:
    """What the model gives for the plate on many ranks, from steps of one rank and of two."""
    call = two["exchange"] / two["calls"]
    sums = two["calls"] - (2 * two["sweeps"] if scheme == "implicit" else 2)
    scene = notched_plate(cells, "weak", homogeneous=True)
    facets = scene.bodies.facets
    points = 2 * len(facets)
    work = one["step"] / one["points"] * points
    print(
        f"\nmodel, {scheme}: {points} points, {1e3 * work:.0f} ms a step on one rank, "
        f"{1e6 * call:.0f} us an exchange or sum, of which {sums:.0f} sums a step"
    )
    print(f"{'ranks':>6} {'imbalance':>10} {'cut points':>11} {'messages':>9} {'kB':>8} "
          f"{'step, ms':>9} {'efficiency':>11}")  # fmt: skip
    for count in (4, 64, 1024):
        rank_of_body = bodies_by_rank(scene.bodies, count)
        sides = rank_of_body[facets.bodies]
        cut = sides[:, 0] != sides[:, 1]
        load = np.bincount(owners_by_facet(facets, rank_of_body), minlength=count)
        at_cut = np.bincount(sides[cut].ravel(), minlength=count).max()
        num_phases = int(phases(sides, count).max())
        # six dofs of a triangle go there and back
        messages, sent = 2 * num_phases, 2 * 48 * at_cut
        if scheme == "implicit":
            messages, sent = messages * one["sweeps"], sent * one["sweeps"]
        imbalance, waits = load.max() / load.mean(), messages * LATENCY
        waits += sums * LATENCY * np.log2(count) + (messages + sums) * call
        step = work / count * imbalance + waits + sent / BANDWIDTH
        print(f"{count:6d} {imbalance:10.3f} {np.count_nonzero(cut) * 2:11d} {messages:9.0f} "
              f"{sent / 1e3:8.0f} {1e3 * step:9.2f} {work / count / step:11.2f}")  # fmt: skip


def main() -> None:
    """Measure, print, model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=80, help="quads a side on one rank")
    parser.add_argument("--ranks", type=int, nargs="+", default=[2, 4], help="beside one")
    parser.add_argument("--scheme", choices=("explicit", "implicit"), help="default: both")
    parser.add_argument("--model", type=int, default=280, help="quads a side of the model's plate")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        found = measure(options.cells, options.scheme)
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found), flush=True)
        return
    for scheme in [options.scheme] if options.scheme else ["explicit", "implicit"]:
        print(f"{scheme:24}{'n':>3} {'points':>9} {'step, ms':>9} {'effic.':>8} {'exchange':>8} "
              f"{'calls':>8} {'kB a step':>9} {'sweeps':>7}")  # fmt: skip
        strong = [on_ranks(count, options.cells, scheme) for count in (1, *options.ranks)]
        one = strong[0]
        for found in strong:
            row("strong", found, one, 1.0 / found["ranks"])
        for count in options.ranks:
            cells = 20 * round(options.cells * count**0.5 / 20)
            found = on_ranks(count, cells, scheme)
            row("weak", found, one, found["points"] / one["points"] / found["ranks"])
        model(options.model, one, strong[1], scheme)
        print()


if __name__ == "__main__":
    main()
