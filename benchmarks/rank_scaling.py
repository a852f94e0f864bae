# SPDX-License-Identifier: LGPL-3.0-or-later
"""How a notched plate scales with the number of ranks, and what more ranks would give.

    ./fenicsx python3 benchmarks/rank_scaling.py [--cells 160] [--model 64 256 1024]
    ./fenicsx python3 benchmarks/rank_scaling.py --scheme newton --cells 40 --ranks 2

Each number of ranks is a process group of its own (`mpirun -n N`), one thread a rank but for the
second line:

- *two threads*: one rank;
- *apart*: as many runs on one rank, side by side: what cores that share a memory leave of each
  other's time, without any message;
- *strong*: the plate stays, ranks share it;
- *weak*: the number of cells a rank stays.

For the explicit bulk with vertices solved alone and for the implicit bulk with sweeps, and if asked
for with Newton's method (steps of 1 ns) and for a static run in one system, it prints the median
time of a step, the processor time of the busiest rank outside of exchanges and sums over ranks,
which other programs change little, the part of the time spent in these (waiting for others
included), how many they are, and bytes. More ranks than cores share the cores, so that times then
say nothing.

The model: a step of n points on P ranks takes

    t = w n b / P + sum over x exchanges of (c + o (k - 1) + l) + sum over s sums of (d + l log2 P)
        + v (p + 1 / B),

w: least time of a point on one rank; b: imbalance of the partition; x, s: exchanges and sums of a
step; c, d: what they cost in software, measured on two ranks that begin one together, so that
nobody waits; k: neighbours of a rank in an exchange; o: what each message more costs, measured with
nine messages between two ranks in place of one of the same bytes; v: bytes that a rank sends; p:
what a byte costs in software (packed, copied and unpacked); l, B: latency and
bandwidth between ranks (assumed: 2 us and 10 GB/s, an InfiniBand network). Messages to several
neighbours are on their way together, and so are a sum and a maximum that ranks ask for at once, for
which d is measured as well; both go through log2 P stages, as MPI doubles the distance.
b, k, v and the phases of sweeps come from a plate of 10 000 points a rank that is divided for P
ranks here, of 1e7 points at most. Beyond 1000 ranks parts are smaller, which leaves neighbours and
phases as they are; v is then that of 10 000 points (it goes with the root), and b that of as many
parts as 1e7 points make of 10 000 each, times what parts of the smaller size lose by their greater
number, b_small(P) / b_small(1000), both of which are printed. Of what ranks wait for each other the
model knows the imbalance alone: other programs on their cores come on top.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "demos"))
from notched_plate import LEFT, notched_plate

import xper_fx as xf
from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.local_bodies import bodies_by_rank
from xper_fx.parallel.ownership import owners_by_facet
from xper_fx.parallel.turns import Visits, hand_over_rows, phases_of_rows
from xper_fx.simulation.simulation import Simulation
from xper_fx.support import ranks as agreed
from xper_fx.support.ranks import Ranks

LATENCY, BANDWIDTH = 2e-6, 10e9
WARM, STEPS, CALLS = 3, 40, 400
SLOTS = 100, 600  # of exchanges that are measured
POINTS, MOST = 10_000, 10_000_000  # a rank, and of all that are divided, in the model
RUNS = {
    "explicit": {"scheme": "explicit", "solver": "auto", "tolerance": 1e-3},
    "implicit": {"scheme": "implicit", "solver": "nlgs", "tolerance": 1e-3},
    "newton": {"scheme": "implicit", "solver": "newton", "tolerance": 1e-4, "step": 1e-9},
    "static": {"theta": 1.0, "inertia": False, "solver": "monolithic", "step": 2e-9},
}


class Clock:
    """Counts calls, bytes and seconds of what ranks exchange."""

    def __init__(self):
        self.exchanges = self.sums = self.pairs = 0
        self._methods: list[tuple[type, str, Callable]] = []
        for name, returned in (("forward", False), ("back", True), ("add_back", True)):
            self._wrap(Exchange, name, "exchanges", returned)
        for name in ("sum", "max"):  # of few ranks none calls another
            self._wrap(Ranks, name, "sums", False)
        self._wrap(Ranks, "sum_and_max", "pairs", False)
        self.begin()

    def begin(self) -> None:
        """Count from here."""
        self.exchanges = self.sums = self.pairs = self.bytes = 0
        self.seconds = self.processor = 0.0

    def _wrap(self, kind, name: str, what: str, returned: bool) -> None:
        method = getattr(kind, name)
        self._methods.append((kind, name, method))

        def timed(this, *arguments):
            start, busy = time.perf_counter(), time.thread_time()
            result = method(this, *arguments)
            self.processor += time.thread_time() - busy
            self.seconds += time.perf_counter() - start
            setattr(self, what, getattr(self, what) + 1)
            if kind is Exchange:
                self.bytes += this.bytes_returned if returned else this.bytes_sent
            return result

        setattr(kind, name, timed)

    def end(self) -> None:
        """Leave the methods as they were: the clock takes time of its own."""
        for kind, name, method in self._methods:
            setattr(kind, name, method)


def cost_of_call(ranks: Ranks, call) -> float:
    """Median of the seconds of a call that all ranks begin together."""
    taken = np.empty(CALLS)
    for i in range(CALLS):
        ranks.comm.Barrier()
        start = time.perf_counter()
        call()
        taken[i] = time.perf_counter() - start
    return ranks.max(float(np.median(taken)))


def cost_of_messages(ranks: Ranks, count: int) -> float:
    """As `cost_of_call`, of 1800 numbers in so many messages between two ranks, both ways."""
    other, comm = 1 - ranks.rank, ranks.comm
    given, taken = np.zeros((count, 1800 // count)), np.zeros((count, 1800 // count))
    requests = [comm.Recv_init(taken[i], other, i) for i in range(count)]
    requests += [comm.Send_init(given[i], other, i) for i in range(count)]

    def exchange() -> None:
        MPI.Prequest.Startall(requests)
        MPI.Request.Waitall(requests)

    return cost_of_call(ranks, exchange)


def cost_of_exchange(ranks: Ranks, count: int) -> float:
    """As `cost_of_call`, of an exchange of so many slots of two dofs between two ranks."""
    own, values = 2 * np.arange(count), np.zeros(6 * count)
    other = 1 - ranks.rank
    exchange = Exchange(ranks, {other: own}, {other: 2 * count + np.arange(count)}, 2)
    return cost_of_call(ranks, partial(exchange.forward, values))


def measure(cells: int, scheme: str, threads: int) -> dict:
    """Steps of the plate on all ranks that were started, so many threads each."""
    clock = Clock()
    plate = notched_plate(cells, "weak", homogeneous=True)
    if scheme == "static":
        loads = [*plate.loads, xf.PrescribedVelocity(LEFT, 1, 0.0)]
        plate = replace(plate, loads=loads, initial_velocity=None)
    simulation = Simulation(plate, num_threads=threads, **RUNS[scheme])
    step, ranks = simulation.step_size, simulation.ranks
    for _ in simulation.steps(WARM * step):
        pass
    clock.begin()
    sweeps, taken, start, busy = 0, [], time.perf_counter(), time.process_time()
    for record in simulation.steps((WARM + STEPS) * step):
        sweeps += record.sweeps
        taken.append(time.perf_counter() - start)
        start = time.perf_counter()
    busy = time.process_time() - busy - clock.processor
    found = {
        "ranks": ranks.size,
        "points": simulation.interactions.num_points,
        "step": float(np.median(taken)),
        "least": min(taken),
        "work": ranks.max(busy) / STEPS,
        "exchange": ranks.max(clock.seconds) / sum(taken),
        "exchanges": clock.exchanges / STEPS,
        "sums": (clock.sums + clock.pairs) / STEPS,
        "pairs": clock.pairs / STEPS,
        "bytes": ranks.max(clock.bytes) / STEPS,
        "sweeps": sweeps / STEPS,
    }
    clock.end()
    if ranks.size == 2:
        energies, (few, many) = np.zeros(4), (cost_of_exchange(ranks, n) for n in SLOTS)
        found["byte_cost"] = (many - few) / (16 * (SLOTS[1] - SLOTS[0]))
        found["exchange_cost"] = few - 16 * SLOTS[0] * found["byte_cost"]
        found["message_cost"] = (cost_of_messages(ranks, 9) - cost_of_messages(ranks, 1)) / 8
        found["sum_cost"] = cost_of_call(ranks, lambda: ranks.sum(energies))
        most, agreed._FEW = agreed._FEW, 1
        found["sum_of_many"] = cost_of_call(ranks, lambda: ranks.sum(energies))
        pair = partial(ranks.sum_and_max, energies, energies)
        found["pair_of_many"] = cost_of_call(ranks, pair)
        agreed._FEW = most
    return found


def start(
    count: int, cells: int, scheme: str, threads: int = 1, bound: bool = True
) -> subprocess.Popen:
    """`measure` in a process group of its own, each rank bound to a core of its own or not."""
    command = ["mpirun", "--oversubscribe", "--bind-to", "core" if bound else "none"]
    command += ["-n", str(count), sys.executable, __file__]
    command += ["--worker", str(threads), "--cells", str(cells), "--scheme", scheme]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def told(process: subprocess.Popen) -> dict:
    """What a process that has ended was asked for."""
    out, _ = process.communicate()
    if process.returncode:
        raise SystemExit(f"{process.args} ended with {process.returncode}.")
    return json.loads(out.splitlines()[-1])


def row(label: str, r: dict, one: dict, share: float) -> None:
    """A line of the table; `share` is what an ideal machine would make of the first line's time."""
    efficiency = one["step"] * share / r["step"]
    print(
        f"{label:24}{r['ranks']:3d} {r['points']:9d} {r['step'] * 1e3:9.2f} {efficiency:8.2f} "
        f"{r['work'] * 1e3:9.2f} {r['exchange']:8.2f} {r['exchanges']:9.1f} {r['sums']:6.1f} "
        f"{r['bytes'] / 1e3:9.1f} {r['sweeps']:7.1f}", flush=True,
    )  # fmt: skip


@cache
def divided(count: int, points: float):
    """A plate for so many ranks: imbalance, cut facets of a rank, neighbours in each exchange.

    These are of all, for the exchanges once a step, and after each phase of a sweep; `points` are
    those of a rank.
    """
    cells = 20 * round((points * count / 12) ** 0.5 / 20)
    bodies = notched_plate(cells, "weak", homogeneous=True).bodies
    facets, rank_of_body = bodies.facets, bodies_by_rank(bodies, count)
    sides, owner = rank_of_body[facets.bodies], owners_by_facet(facets, rank_of_body)
    cut = sides[:, 0] != sides[:, 1]
    units, owners = facets.bodies[cut].astype(np.int64), owner[cut]
    phase = phases_of_rows(units, owners)
    visits = np.column_stack([units.ravel(), np.repeat(phase, 2), np.repeat(owners, 2)])
    visits = Visits(*np.unique(visits, axis=0).T)
    ways = hand_over_rows(visits, rank_of_body[visits.unit])
    pairs = np.unique(np.sort(sides[cut], axis=1), axis=0)
    neighbours = [np.bincount(pairs.ravel()).max()]
    for step in range(1 + phase.max()):
        gone = ways.after == step
        met = np.unique(np.column_stack([ways.giver[gone], ways.taker[gone]]), axis=0)
        neighbours.append(np.bincount(met.ravel()).max())
    load = np.bincount(owner, minlength=count)
    at_cut = np.bincount(sides[cut].ravel(), minlength=count).max()
    return load.max() / load.mean(), at_cut * (POINTS / points) ** 0.5, np.array(neighbours)


def imbalance_of_many(count: int, small: float) -> float:
    """That of parts of `POINTS`, more than are divided here; `small` is that of small parts."""
    full = int(MOST / POINTS)
    large, few = divided(full, POINTS)[0], divided(full, MOST / count)[0]
    print(f"{count} parts of {MOST / count:.0f} points: imbalance {small:.3f}, of {full} such "
          f"{few:.3f}, of {full} with {POINTS} points {large:.3f}")  # fmt: skip
    return large * small / few


def model(counts: list[int], one: dict, two: dict, scheme: str) -> None:
    """What the model gives for plates of `POINTS` a rank, from steps of one rank and of two."""
    work = one["least"] / one["points"]
    message = max(two["message_cost"], 0.0)
    sweeps = one["sweeps"] if scheme == "implicit" else 0
    once = two["exchanges"] - (2 * two["sweeps"] if scheme == "implicit" else 0)
    print(
        f"\nmodel, {scheme}: {1e9 * work:.0f} ns a point; {1e6 * two['exchange_cost']:.1f} us an "
        f"exchange, {1e9 * two['byte_cost']:.2f} ns a byte, {1e6 * message:.2f} us a message more, "
        f"{1e6 * two['sum_cost']:.1f} us a sum, "
        f"{1e6 * two['sum_of_many']:.1f} of more than {agreed._FEW} ranks, "
        f"{1e6 * two['pair_of_many']:.1f} with a maximum"
    )
    print(f"{'ranks':>6} {'points':>10} {'imbalance':>10} {'cut facets':>11} {'neighbours':>13} "
          f"{'exchanges':>10} {'sums':>6} {'kB':>8} {'step, ms':>9} {'effic.':>11}")  # fmt: skip
    for count in counts:
        imbalance, at_cut, neighbours = divided(count, min(POINTS, MOST / count))
        if POINTS * count > MOST:
            imbalance = imbalance_of_many(count, imbalance)
        messages = (neighbours - 1) * message
        each = two["exchange_cost"] + LATENCY + messages
        waits = once * each[0] + sweeps * each[1:].sum()
        total = pair = two["sum_cost"]
        if count > agreed._FEW:
            total, pair = two["sum_of_many"], two["pair_of_many"]
        waits += two["sums"] * (total + LATENCY * np.log2(count)) + two["pairs"] * (pair - total)
        sent = 48 * at_cut * (once + 2 * sweeps)  # six dofs of a triangle
        alone = work * POINTS
        step = alone * imbalance + waits + sent * (two["byte_cost"] + 1.0 / BANDWIDTH)
        print(
            f"{count:6d} {POINTS * count:10d} {imbalance:10.3f} {at_cut:11.0f} "
            f"{' '.join(map(str, neighbours)):>13} "
            f"{once + sweeps * (len(neighbours) - 1):10.0f} {two['sums']:6.0f} "
            f"{sent / 1e3:8.0f} {1e3 * step:9.2f} {alone / step:11.2f}", flush=True,
        )  # fmt: skip


def main() -> None:
    """Measure, print, model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=80, help="quads a side on one rank")
    parser.add_argument("--ranks", type=int, nargs="+", default=[2, 4], help="beside one")
    parser.add_argument("--scheme", choices=tuple(RUNS), help="default: explicit, implicit")
    parser.add_argument(
        "--model", type=int, nargs="+", default=[64, 256], help="numbers of ranks of the model"
    )
    parser.add_argument("--worker", type=int, metavar="THREADS", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        found = measure(options.cells, options.scheme, options.worker)
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found), flush=True)
        return
    for scheme in [options.scheme] if options.scheme else ["explicit", "implicit"]:
        print(f"{scheme:24}{'n':>3} {'points':>9} {'step, ms':>9} {'effic.':>8} {'work, ms':>9} "
              f"{'exchange':>8} {'exchanges':>9} {'sums':>6} {'kB a step':>9} "
              f"{'sweeps':>7}")  # fmt: skip
        one = told(start(1, options.cells, scheme))
        row("one", one, one, 1.0)
        row("two threads", told(start(1, options.cells, scheme, 2, False)), one, 0.5)
        beside = [told(p) for p in [start(1, options.cells, scheme, bound=False) for _ in range(2)]]
        row("two apart", max(beside, key=lambda found: found["step"]), one, 1.0)
        strong = {count: told(start(count, options.cells, scheme)) for count in options.ranks}
        for count, found in strong.items():
            row("strong", found, one, 1.0 / count)
        for count in options.ranks:
            cells = 20 * round(options.cells * count**0.5 / 20)
            found = told(start(count, cells, scheme))
            row("weak", found, one, found["points"] / one["points"] / count)
        if 2 in strong and scheme in ("explicit", "implicit"):
            model(options.model, one, strong[2], scheme)
        print()


if __name__ == "__main__":
    main()
