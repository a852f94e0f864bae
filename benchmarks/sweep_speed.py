# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a visit of a 2D cohesive point costs, law included, and where the time goes.

    ./fenicsx python3 benchmarks/sweep_speed.py [--cells 20 40] [--repeat R]

Nanoseconds a point and sweep on the crossed plate whose every triangle is a body, bonds open (the
law's linear branch) and half of them closed (contact, branches badly predicted), beside

- NumPy: the same sweep by colours of points that share no body, open bonds only;
- bytes: what a visit reads and writes, over the copy bandwidth of a large array measured in the
  same run, is the time the memory alone would take if nothing stayed in cache;
- stored: W formed once, rows of blocks over the points that share a body, and pulled,
  u_i = q_i + sum_j W_ij r_j,
  instead of velocities exchanged with the bodies; on the plate, and on grains (dense blocks).

Stored and exchanged sweeps are compared: the largest difference of the impulses is printed.
Exchange wins everywhere, which is why the package has no stored W: a facet's two points share
their bodies, so that a row of W holds about twice the numbers of the rows of w it is made of.
Other work on the machine disturbs: variants take turns, and the least of R runs counts.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numba
import numpy as np

from xper_fx.cache import njit

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from plates import crossed_plate  # noqa: E402

from xper_fx.nscd.algebra.small import for_dimension  # noqa: E402
from xper_fx.nscd.interactions import Interactions  # noqa: E402
from xper_fx.nscd.inverse_blocks import BodyInverse  # noqa: E402
from xper_fx.nscd.kernel_calls import make_call  # noqa: E402
from xper_fx.nscd.laws import CohesiveZone  # noqa: E402
from xper_fx.nscd.ordering import greedy_colors  # noqa: E402
from xper_fx.nscd.points import InteractionPoints  # noqa: E402
from xper_fx.nscd.solvers.solver import SolveOptions  # noqa: E402
from xper_fx.nscd.solvers.sweeps import prepare_sweep  # noqa: E402

SIZE, THETA = 50e-6, 0.5
BOND = CohesiveZone(2e18, 0.5, 1e9, friction=0.05)
SWEEPS = 5  # a run


class Problem:
    """A step about to be solved, and the sweeps that solve it."""

    def __init__(self, points, inverse, positions, step, closed):
        self.scene = Interactions(points, [BOND], np.zeros(len(points), int), inverse)
        self.group = self.scene.groups[0]
        rng = np.random.default_rng(0)
        free = np.zeros((inverse.num_slots, 2))
        free[: len(positions)] = 4e4 * positions + 0.002 * rng.normal(size=positions.shape)
        if closed:
            free[: len(positions)] = 2.0 * rng.normal(size=positions.shape)
        self.free, self.velocity = free.ravel(), free.ravel().copy()
        self.scene.begin_step(step, THETA)

    def reset(self):
        self.velocity[:] = self.free
        self.group.impulse[:] = 0.0

    def exchange(self, threads):
        """Function that makes SWEEPS sweeps."""
        sweep = prepare_sweep(self.scene, self.velocity, SolveOptions(num_threads=threads))

        def run():
            numba.set_num_threads(threads)
            for _ in range(SWEEPS):
                make_call(sweep.calls, 0)

        return run

    def stored(self):
        """The same with W stored."""
        g = self.group
        blocks = self.scene.inverse.block_of_node[g.points.nodes[:, :, 0]]
        rows, columns, w = store(g.couplings, blocks, len(self.scene.inverse.node_offsets) - 1)
        kernel = stored_kernel(g.kernels)
        free = g.points.relative(self.free.reshape(-1, 2))
        arguments = (
            rows, columns, w, free, g.impulse, g.compliance, g.inverse_area, g.parameters, g.terms,
            g.details,
        )  # fmt: skip

        def run():
            for _ in range(SWEEPS):
                kernel(*arguments)

        return run, (rows.nbytes + columns.nbytes + w.nbytes) / len(g)

    def numpy_sweeps(self):
        """The same, in NumPy, colour by colour, for open bonds and blocks of one size."""
        g = self.group
        size, ground = g.blocks.size, len(self.scene.inverse.node_offsets) - 2
        pairs = (g.points.nodes[:, :, 0] * 2 // size).astype(np.int64)
        color = greedy_colors(np.arange(len(g) + 1) * 2, pairs.ravel(), ground + 1, ground)
        parts = []
        for value in range(color.max() + 1):
            i = np.flatnonzero(color == value)
            start = g.couplings.start[i, :, 0]
            body = start // size
            w = self.scene.inverse.data.reshape(-1, size, size)[
                body[:, :, None], (start % size)[:, :, None] + np.arange(2)
            ]
            terms = g.terms[i]
            spring, soft = terms[:, 5:7], terms[:, [7, 8, 8, 9]].reshape(-1, 2, 2)
            parts.append((i, start, body, w, g.points.frame[i], terms[:, 3:5], spring, soft))
        v, impulse = self.velocity, g.impulse

        def run():
            bodies = v.reshape(-1, size)
            for _ in range(SWEEPS):
                for i, start, body, w, frame, push, spring, soft in parts:
                    nodal = v[start[:, :, None] + np.arange(2)]
                    u = np.einsum("pij,pj->pi", frame, nodal[:, 0] - nodal[:, 1])
                    old = impulse[i]
                    new = u - np.einsum("pij,pj->pi", soft, old + spring * (push + u))
                    answer = -spring * (push + new)
                    world = np.einsum("pij,pi->pj", frame, answer - old)
                    impulse[i] = answer
                    bodies[body[:, 0]] += np.einsum("pdm,pd->pm", w[:, 0], world)
                    bodies[body[:, 1]] -= np.einsum("pdm,pd->pm", w[:, 1], world)

        return run

    @property
    def bytes_a_visit(self):
        """Read and written: the point's own arrays, its rows of w, the velocities of its bodies."""
        g = self.group
        own = g.terms, g.impulse, g.impulse, g.couplings.start, g.couplings.frame, g.inverse_area
        dofs = g.couplings.size.sum(axis=1).mean()
        return sum(a.nbytes for a in own) / len(g) + dofs * 8 * (2 + 2)


@njit
def _neighbours(blocks, offsets, members, ground):
    """Points that share a body with each point, itself first."""
    count = len(blocks)
    rows = np.zeros(count + 1, np.int64)
    seen = np.full(count, -1)
    for fill in range(2):
        columns = np.empty(rows[-1] if fill else 0, np.int32)
        seen[:] = -1
        total = 0
        for i in range(count):
            seen[i] = i
            if fill:
                columns[total] = i
            total += 1
            for s in range(2):
                b = blocks[i, s]
                if b == ground:
                    continue
                for j in members[offsets[b] : offsets[b + 1]]:
                    if seen[j] != i:
                        seen[j] = i
                        if fill:
                            columns[total] = j
                        total += 1
            rows[i + 1] = total
    return rows, columns


@njit
def _blocks(c, blocks, rows, columns):
    w = np.zeros((len(columns), 4))
    for i in range(len(rows) - 1):
        for entry in range(rows[i], rows[i + 1]):
            j = columns[entry]
            for s in range(2):
                for t in range(2):
                    if blocks[i, s] != blocks[j, t]:
                        continue
                    sign = 1.0 if s == t else -1.0
                    n = c.size[i, s]
                    at = c.rows[i, s, 0] + c.start[j, t, 0] - c.body[i, s]
                    for x in range(2):
                        # rows of the frame: (n0, n1) and (-n1, n0)
                        ix = c.frame[i, 0, 0] if x == 0 else -c.frame[i, 0, 1]
                        iy = c.frame[i, 0, 1] if x == 0 else c.frame[i, 0, 0]
                        for y in range(2):
                            jx = c.frame[j, 0, 0] if y == 0 else -c.frame[j, 0, 1]
                            jy = c.frame[j, 0, 1] if y == 0 else c.frame[j, 0, 0]
                            w[entry, 2 * x + y] += sign * (
                                ix * (c.w[at] * jx + c.w[at + 1] * jy)
                                + iy * (c.w[at + n] * jx + c.w[at + n + 1] * jy)
                            )
    return w


def store(couplings, blocks, num_blocks):
    """W as rows of 2 x 2 blocks: offsets, columns, blocks."""
    flat = blocks.ravel()
    order = np.argsort(flat, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=num_blocks))])
    rows, columns = _neighbours(blocks, offsets, (order // 2).astype(np.int64), num_blocks - 1)
    return rows, columns, _blocks(couplings, blocks, rows, columns)


def stored_kernel(law):
    """A sweep that pulls from stored rows of W."""
    algebra = for_dimension(2)
    row, set_row, subtract, dot = algebra.row, algebra.set_row, algebra.subtract, algebra.dot
    solve = law.solve

    @njit(fastmath={"contract"}, error_model="numpy", _nrt=False)
    def sweep(rows, columns, w, free, r, compliance, inverse_area, parameters, terms, details):
        changed, total, largest = 0.0, 0.0, 0.0
        for number in range(len(rows) - 1):
            i = np.uintp(number)
            x, y = row(free, i)
            for number_2 in range(rows[i], rows[i + 1]):
                entry = np.uintp(number_2)
                j = np.uintp(columns[entry])
                x += w[entry, 0] * r[j, 0] + w[entry, 1] * r[j, 1]
                y += w[entry, 2] * r[j, 0] + w[entry, 3] * r[j, 1]
            old = row(r, i)
            new, _ = solve(i, (x, y), old, compliance, parameters, terms, details)
            set_row(r, i, new)
            change = subtract(new, old)
            size = dot(change, change)
            changed += size
            total += dot(new, new)
            largest = max(largest, size * inverse_area[i] * inverse_area[i])
        return changed, total, largest

    return sweep


def plate(cells, closed):
    """Every triangle a body, at five times the critical step of its bonds."""
    p = crossed_plate(cells, SIZE)
    step = 5 * 3.1e-11 * np.sqrt(20 / cells)
    return Problem(
        p.points, p.inverse(step, THETA), np.repeat(p.x.mean(axis=1), 3, axis=0), step, closed
    )


def grains(cells, width, closed=False):
    """Square grains of width x width quads: dense blocks over their boundary nodes."""
    p = crossed_plate(cells, SIZE)
    step = 1e-9
    quad = np.arange(len(p.x)) // 4
    label = quad // cells // width * (cells // width) + quad % cells // width
    vertex = np.unique((p.x.reshape(-1, 2) / SIZE * 4 * cells).round().astype(int), axis=0,
                       return_inverse=True)[1].ravel()  # fmt: skip
    node = np.repeat(label, 3) * (vertex.max() + 1) + vertex  # of the grain's connected mesh
    used = p.points.nodes[:, :, 0]
    between = label[used[:, 0] // 3] != label[used[:, 1] // 3]
    touching = np.unique(node[used[between]])
    blocks, position, number, positions = [], {}, 0, []
    for grain in range(label.max() + 1):
        cell = np.flatnonzero(label == grain)
        own, local = np.unique(node.reshape(-1, 3)[cell], return_inverse=True)
        dofs = (2 * local.reshape(-1, 3)[:, :, None] + np.arange(2)).reshape(len(cell), 6)
        a = np.zeros((2 * len(own), 2 * len(own)))
        np.add.at(a, (dofs[:, :, None], dofs[:, None, :]), step**2 * THETA**2 * p.stiffness[cell])
        np.add.at(a, (dofs, dofs), p.mass[cell])
        keep = np.flatnonzero(np.isin(own, touching))
        kept = (2 * keep[:, None] + np.arange(2)).ravel()
        blocks.append(np.linalg.inv(a)[np.ix_(kept, kept)])
        for k in keep:
            position[own[k]] = number
            number += 1
        positions += [p.x[cell].mean(axis=(0, 1))] * len(keep)
    nodes = np.array([[position[n] for n in pair] for pair in node[used[between]]], np.int32)
    chosen = p.points.take(np.flatnonzero(between))
    points = InteractionPoints(
        nodes[:, :, None], np.ones((*nodes.shape, 1)), chosen.frame, chosen.area, chosen.gap
    )
    return Problem(points, BodyInverse.from_blocks(blocks, 2), np.array(positions), step, closed)


def measure(runs, reset, repeat):
    """Least time of each run (s), taken in turns."""
    best = dict.fromkeys(runs, np.inf)
    for turn in range(repeat + 1):
        for name, run in runs.items():
            reset()
            start = time.perf_counter()
            run()
            if turn:
                best[name] = min(best[name], time.perf_counter() - start)
    return best


def copy_bandwidth(repeat, megabytes=256):
    """Bytes read and written a second by a copy much larger than the caches."""
    source = np.ones(megabytes * 2**17)
    target = np.empty_like(source)
    best = measure({"copy": lambda: np.copyto(target, source)}, lambda: None, repeat)
    return 2 * source.nbytes / best["copy"]


def difference(problem, run):
    """Largest difference of the impulses after SWEEPS sweeps, relative."""
    problem.reset()
    problem.exchange(1)()
    expected = problem.group.impulse.copy()
    problem.reset()
    run()
    return np.abs(problem.group.impulse - expected).max() / np.abs(expected).max()


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40], help="quads a side")
    parser.add_argument("--repeat", type=int, default=60, help="runs, the least counts")
    options = parser.parse_args()
    bandwidth = copy_bandwidth(max(options.repeat // 10, 3))
    print(f"copy bandwidth {bandwidth / 1e9:.1f} GB/s (read + written, 256 MB)")
    print(
        "plate  bonds   points   1 thread  2 threads  ratio   NumPy  stored"
        "   bytes  ns at copy bandwidth  bytes stored  difference"
    )
    for cells in options.cells:
        for closed in (False, True):
            problem = plate(cells, closed)
            stored, stored_bytes = problem.stored()
            runs = {"one": problem.exchange(1), "two": problem.exchange(2), "stored": stored}
            if not closed:
                runs["numpy"] = problem.numpy_sweeps()
            off = difference(problem, stored)
            best = measure(runs, problem.reset, options.repeat)
            ns = {name: 1e9 * t / SWEEPS / len(problem.group) for name, t in best.items()}
            moved = problem.bytes_a_visit
            print(
                f"{cells:5d}  {'closed' if closed else 'open':6s} {len(problem.group):7d}"
                f"  {ns['one']:9.1f}  {ns['two']:9.1f}  {ns['one'] / ns['two']:5.2f}"
                f"  {ns.get('numpy', np.nan):6.0f}  {ns['stored']:6.1f}  {moved:6.0f}"
                f"  {1e9 * moved / bandwidth:20.1f}  {stored_bytes:12.0f}  {off:10.0e}"
            )
    print("grains: dofs a block, points, ns a visit exchanged / stored, bytes stored, difference")
    for cells, width in ((24, 4), (48, 12), (60, 20)):
        problem = grains(cells, width)
        stored, stored_bytes = problem.stored()
        off = difference(problem, stored)
        runs = {"one": problem.exchange(1), "stored": stored}
        best = measure(runs, problem.reset, options.repeat)
        ns = {name: 1e9 * t / SWEEPS / len(problem.group) for name, t in best.items()}
        size = problem.group.couplings.size
        print(
            f"  {size.min()}-{size.max()}  {len(problem.group)}  {ns['one']:.0f} / "
            f"{ns['stored']:.0f}  {stored_bytes:.0f}  {off:.0e}"
        )


if __name__ == "__main__":
    main()
