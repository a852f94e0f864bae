# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies: what a contact and a sweep cost, where a step's time goes, and how it grows.

    ./fenicsx python3 benchmarks/rigid_speed.py [sweep] [step] [growth] [settling] [--largest N]

- sweep: nanoseconds a contact and sweep of touching discs and spheres with friction, on one thread,
  beside bytes a visit reads and writes, and the time a plain copy of as many bytes takes in arrays
  of the same total size (what stays in a cache is copied from there) and in one of 256 MB;
- step: of discs that settle: its parts, and its time over that of the same step with contacts
  that are given (the search and the building of points left out);
- growth: discs and spheres from 1000 to --largest: memory a body and a contact, time of the parts
  of a step, and the exponents with which they grow;
- settling: from the fall to rest by each solver: time, sweeps, and steps that did not converge.

Times are of the processor, one thread; the least of some runs counts, as others disturb.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from heaps import Heap, grains  # noqa: E402

from xper_fx.nscd.kernel_calls import make_call  # noqa: E402
from xper_fx.nscd.solvers import AcceleratedSweeps, Automatic, NonlinearGaussSeidel  # noqa: E402
from xper_fx.nscd.solvers.solver import SolveOptions  # noqa: E402
from xper_fx.nscd.solvers.sweeps import prepare_sweep  # noqa: E402

TOLERANCE = 1e-3
SWEEPS = 10  # a run


def touching(count, dim):
    """Bodies that touch their neighbours on a lattice, a few steps after they were let go."""
    across = round(count ** (1.0 / dim))
    heap = Heap(grains(count, across, dim=dim, least=1.0, pitch=2.0))
    heap.advance(3, tolerance=TOLERANCE)
    return heap


def clock(run, repeat):
    """Least processor time of a run (s)."""
    best = np.inf
    for _ in range(repeat):
        start = time.process_time()
        run()
        best = min(best, time.process_time() - start)
    return best


def sweep_time(heap, repeat=15):
    """Time of a sweep over all contacts (s), the first of a solve of bodies that were shaken."""
    layer = heap.layer
    heap.search()
    free = heap.free_velocity()
    shaken = heap.layer.rigid_part(free)
    shaken += 0.1 * np.random.default_rng(0).normal(size=shaken.shape)
    velocity = free.copy()
    sweep = prepare_sweep(layer, velocity, SolveOptions(num_threads=1))
    loops = max(1, 100_000 // max(heap.num_contacts, 1))

    def run():
        for _ in range(loops):
            velocity[:] = free
            for g in layer.groups:
                g.impulse[:] = 0.0
            for _ in range(SWEEPS):
                for number in range(len(layer.groups)):
                    make_call(sweep.calls, number)

    return clock(run, repeat) / loops / SWEEPS


def bytes_a_visit(heap):
    """Read and written: the contact's own arrays, velocities and w of its two bodies."""
    total, count = 0, 0
    for g in heap.layer.groups:
        c = g.couplings
        own = (
            g.terms, g.impulse, g.impulse, g.compliance, g.inverse_area, c.start, c.body, c.rows,
            c.rotation_dof, c.frame, c.lever_arms,
        )  # fmt: skip
        total += sum(a.nbytes for a in own)
        count += len(g)
    n = 2 * heap.bodies.dim
    return total / count + 2 * 8 * (2 * n + n * n)


def copy_time(size, total, repeat=15):
    """Time a plain copy takes to move `size` bytes, half read and half written (s)."""
    source = np.ones(max(1, int(total // 16)))
    target = np.empty_like(source)
    loops = max(1, int(2e7 // source.nbytes))

    def run():
        for _ in range(loops):
            np.copyto(target, source)

    return clock(run, repeat) / loops * size / (2 * source.nbytes)


def sweeps(largest):
    """Table of the visit."""
    print("bodies            contacts  ns/visit  bytes/visit  ns of a copy: same size, 256 MB")
    for dim in (2, 3):
        for count in (1000, 10_000, 100_000):
            if count > largest:
                continue
            heap = touching(count, dim)
            n, size = heap.num_contacts, bytes_a_visit(heap)
            ns = 1e9 * sweep_time(heap) / n
            same, far = (1e9 * copy_time(size, t) for t in (n * size, 2**28))
            name = "discs" if dim == 2 else "spheres"
            print(
                f"{count:7d} {name:8s} {n:9d} {ns:9.1f} {size:12.0f} {same:12.1f} {far:9.1f}",
                flush=True,
            )


def parts_of_step(heap, steps):
    """Mean times (s) of a step's parts, and sweeps."""
    spent = dict.fromkeys(("find", "renew", "solve", "whole"), 0.0)
    total_sweeps = 0

    def timed(name, function):
        def run(*arguments, **options):
            start = time.process_time()
            result = function(*arguments, **options)
            spent[name] += time.process_time() - start
            return result

        return run

    detection = heap.detection
    detection._find = timed("find", detection._find)
    detection.renew = timed("renew", detection.renew)

    class Timed(Automatic):
        solve = timed("solve", Automatic.solve)

    advance = timed("whole", heap.advance)
    for _ in range(steps):
        advance(1, Timed, tolerance=TOLERANCE, max_sweeps=20_000)
        total_sweeps += heap.report.sweeps
    del detection._find, detection.renew
    parts = {
        "search": spent["find"],
        "points": spent["renew"] - spent["find"],
        "solve": spent["solve"],
        "rest": spent["whole"] - spent["renew"] - spent["solve"],
    }
    return {name: value / steps for name, value in parts.items()}, total_sweeps / steps


def steps(largest):
    """Table of a step with its search and without."""
    print("discs     t (s)  contacts  sweeps  ms: search  points   solve    rest   with/without")
    count = min(10_000, largest)
    heap = Heap(grains(count, round(count**0.5), least=0.9, pitch=2.01))
    heap.advance(3, tolerance=TOLERANCE)
    for _ in range(8):
        parts, made = parts_of_step(heap, 15)
        whole = sum(parts.values())
        ratio = whole / (parts["solve"] + parts["rest"])
        ms = " ".join(f"{1e3 * parts[p]:8.2f}" for p in parts)
        print(f"{count:7d} {heap.time:7.3f} {heap.num_contacts:9d} {made:7.0f}   {ms} {ratio:9.2f}",
              flush=True)  # fmt: skip


def memory(heap):
    """Bytes a body and a contact, counted from the arrays that are held."""
    bodies, layer = len(heap.bodies), heap.layer
    state = heap.motion.state
    body = (
        state.position, state.velocity, heap.motion.blocks, heap.bodies.position, heap.bodies.mass,
        layer.inverse.data, layer.inverse.node_offsets, layer.inverse.data_offsets,
    )  # fmt: skip
    contact = sum(g.nbytes for g in layer.contacts)
    contact += sum(a.nbytes for known in layer._found._sets for a in known[:4])
    search = heap.detection._rigid.nbytes
    return sum(a.nbytes for a in body) / bodies, contact / heap.num_contacts, search / bodies


def growth(largest):
    """Table of memory and times against the number of bodies."""
    for dim, counts in ((2, (1000, 10_000, 100_000)), (3, (1000, 8000, 20_000))):
        print("bodies             contacts  bytes: body  contact  lists/body   ms: search  points"
              "   solve    rest  sweeps  ms/sweep")  # fmt: skip
        rows = []
        for count in counts:
            if count > largest:
                continue
            heap = touching(count, dim)
            held = memory(heap)
            parts, made = parts_of_step(heap, 5)
            once = sweep_time(heap, 5)
            rows.append([count, *(parts[p] for p in parts), once])
            ms = " ".join(f"{1e3 * parts[p]:8.2f}" for p in parts)
            print(
                f"{count:7d} {'discs' if dim == 2 else 'spheres':8s} {heap.num_contacts:9d} "
                f"{held[0]:12.0f} {held[1]:8.0f} {held[2]:11.0f}   {ms} {made:7.0f} "
                f"{1e3 * once:9.3f}",
                flush=True,
            )
        if len(rows) > 1:
            logs = np.log(np.array(rows))
            slopes = (logs[-1, 1:] - logs[0, 1:]) / (logs[-1, 0] - logs[0, 0])
            names = ("search", "points", "solve", "rest", "sweep")
            pairs = zip(names, slopes, strict=True)
            print("exponents: " + ", ".join(f"{n} {s:.2f}" for n, s in pairs))


def settling(largest):
    """Table of solvers from the fall to rest."""
    touching(100, 2)  # compiles
    print("discs  solver        s  sweeps a step  steps not converged  kinetic at the end (J)")
    for count, across, number in ((400, 20, 500), (1300, 36, 500)):
        if count > largest:
            continue
        for solver in (NonlinearGaussSeidel, AcceleratedSweeps, Automatic):
            heap = Heap(grains(count, across))
            heap.advance(2, solver, tolerance=TOLERANCE)
            start, made, failed = time.process_time(), 0, 0
            for _ in range(number):
                heap.advance(1, solver, tolerance=TOLERANCE, max_sweeps=20_000)
                made += heap.report.sweeps
                failed += not heap.report.converged
            spent = time.process_time() - start
            print(f"{count:5d}  {solver.name:12s} {spent:6.2f} {made / number:10.0f} {failed:12d} "
                  f"{heap.motion.kinetic:18.2e}", flush=True)  # fmt: skip


def main() -> None:
    """Run the benchmark."""
    tables = {"sweep": sweeps, "step": steps, "growth": growth, "settling": settling}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tables", nargs="*", default=list(tables), help=", ".join(tables))
    parser.add_argument("--largest", type=int, default=100_000, help="bodies")
    options = parser.parse_args()
    for name in options.tables:
        print(f"-- {name}")
        tables[name](options.largest)


if __name__ == "__main__":
    main()
