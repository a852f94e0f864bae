# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Explicit bulk: vertices whose cells move as one, and those that have cracked.

**Whole vertices** move with the momentum of their cells over their mass, as a node of ordinary
finite elements does, as long as some admissible tractions hold them together (`holding.py`).

**The others** are solved cluster by cluster of cells that fused bonds join. Each cluster has the
mass of its corners; impulses r of the bonds between clusters obey r = S(b), S the law and b the
relative velocity without the bond's own impulse. Gauss-Seidel sweeps are followed, where they
stall, by steps of a semismooth Newton method for all bonds of the vertex,

    (I - T (W - diag W)) dr = S(b) - r,   T the slopes of S by differences.

Then the fused bonds are asked: where their flow is not borne, the vertex is solved with each cell
for itself and all sound bonds following their set-valued law, what has opened is cut, and the
clusters are solved again. What opens within a cluster that other bonds hold stays as it was.

Nodes keep their velocities when they part, so that a split conserves momentum and energy. Cells
of a cluster have the same velocity, to the bit, and with it the same displacement for as long as
they stay together.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.splitting.fused_points import FusedPoints
from xper_fx.nscd.splitting.holding import flow_kernel, local_flow
from xper_fx.nscd.splitting.vertex_graphs import VertexGraphs
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport

# Relative change of the impulses of a vertex at which it is solved: a few unknowns, cheap to have.
_TOLERANCE = 1e-11
# Sweeps before the first Newton steps, and after each batch of them, early and late.
_FIRST, _BATCH, _LONG_BATCH, _EARLY = 8, 4, 25, 8
_NEWTON_STEPS = 6
# Sweeps after which to give up, after which bonds that broke once stay broken, and after which none
# is sounder than it was.
_MOST, _SNAPS, _SETTLES = 400, 24, 100
# How often flows are eased along all rings of a vertex: in the plane there is but one.
_EASINGS = 3
# How often what opens is looked for.
_ROUNDS = 4
# Impulses smaller than this share of what stops the parts are of no account.
_SMALL = 1e-2
# Slopes are multiplied by this, as closed rings of bonds are redundant; and the reach of their
# differences, over the velocity.
_REGULAR, _REACH = 1.0 - 1e-9, 1e-7
_SINGULAR = 1e-14
_ROUNDING = 16.0 * np.finfo(float).eps

_INLINED = {"inline": "always"}


class _Work(NamedTuple):
    """Work space of a vertex with as many corners k and bonds e as any has.

    Attributes:
        cluster: shape (k,), first corner of each corner's cluster.
        pinned: shape (k,).
        driven: shape (k, dim).
        free: shape (k, dim), velocities of the cells for themselves (m/s).
        v, w: shape (k, dim), velocity and compliance of the cluster whose first corner it is.
        source: shape (k, dim).
        laplacian: shape (k, k).
        fused, active: shape (e,), what transmits within a cluster, and what acts between two.
        flow: shape (e, dim); also residuals and corrections (N s).
        slope: shape (e, dim, dim).
        system: shape (e dim, e dim).
    """

    cluster: np.ndarray
    pinned: np.ndarray
    driven: np.ndarray
    free: np.ndarray
    v: np.ndarray
    w: np.ndarray
    source: np.ndarray
    laplacian: np.ndarray
    fused: np.ndarray
    active: np.ndarray
    flow: np.ndarray
    slope: np.ndarray
    system: np.ndarray


def _work(graphs: VertexGraphs, dim: int) -> _Work:
    k = int(np.diff(graphs.corner_offsets).max(initial=1))
    e = int(np.diff(graphs.bond_offsets).max(initial=1))
    corners = [np.zeros((k, dim)) for _ in range(4)]
    return _Work(
        np.zeros(k, np.int64), np.zeros(k, bool), np.zeros((k, dim), bool), *corners,
        np.zeros((k, k)), np.zeros(e, bool), np.zeros(e, bool), np.zeros((e, dim)),
        np.zeros((e, dim, dim)), np.zeros((e * dim, e * dim)),
    )  # fmt: skip


@cache
def _vertex_kernels(dim: int):
    """What is done at a vertex whatever its laws are."""
    flow = flow_kernel(dim)

    @njit(**LEAN_INNER)
    def gather(b, v, g, work):
        """Free velocities of the corners; returns how many there are."""
        first = g.corner_offsets[b]
        k = g.corner_offsets[b + 1] - first
        for c in range(k):
            slot = g.corner[first + c]
            for d in range(dim):
                work.free[c, d] = v[slot * dim + d]
                work.driven[c, d] = g.compliance[slot, d] == 0.0
        return k

    @njit(**LEAN_INNER)
    def partition(b, k, g, work):
        """Clusters of corners that fused bonds join; returns how many there are."""
        cluster = work.cluster
        for c in range(k):
            cluster[c] = c
        first, count = g.bond_offsets[b], k
        for q in range(first, g.bond_offsets[b + 1]):
            if work.fused[q - first]:
                x, y = cluster[g.sides[q, 0]], cluster[g.sides[q, 1]]
                if x != y:
                    count -= 1
                    low, high = min(x, y), max(x, y)
                    for c in range(k):
                        if cluster[c] == high:
                            cluster[c] = low
        return count

    @njit(**LEAN_INNER)
    def activate(b, g, work):
        """Bonds act between clusters; returns how many do."""
        first, count = g.bond_offsets[b], 0
        for q in range(first, g.bond_offsets[b + 1]):
            acts = work.cluster[g.sides[q, 0]] != work.cluster[g.sides[q, 1]]
            work.active[q - first] = acts
            count += acts
        return count

    @njit(**LEAN_INNER)
    def form(b, k, g, work):
        """Compliance and free velocity of the clusters."""
        first = g.corner_offsets[b]
        for c in range(k):
            if work.cluster[c] != c:
                continue
            for d in range(dim):
                mass, momentum, held, speed = 0.0, 0.0, False, 0.0
                for other in range(c, k):
                    if work.cluster[other] == c:
                        if work.driven[other, d]:
                            held, speed = True, work.free[other, d]
                        else:
                            own = 1.0 / g.compliance[g.corner[first + other], d]
                            mass += own
                            momentum += own * work.free[other, d]
                work.w[c, d] = 0.0 if held else 1.0 / mass
                work.v[c, d] = speed if held else momentum / mass

    @njit(**LEAN_INNER)
    def sources(b, k, g, work):
        """Impulses that bonds give each corner; returns half their sum, or all if one is driven."""
        first = g.corner_offsets[b]
        total, share = 0.0, 0.5
        for c in range(k):
            root, squared = work.cluster[c], 0.0
            for d in range(dim):
                if work.driven[c, d]:
                    work.source[c, d], share = 0.0, 1.0
                else:
                    mass = 1.0 / g.compliance[g.corner[first + c], d]
                    work.source[c, d] = mass * (work.v[root, d] - work.free[c, d])
                    squared += work.source[c, d] ** 2
            total += np.sqrt(squared)
        return share * total

    @njit(**LEAN_INNER)
    def put(b, k, ground, v, impulses, g, work, external):
        """Velocities and impulses of the corners; `external` has those of other clusters."""
        first = g.corner_offsets[b]
        for c in range(k):
            root, slot = work.cluster[c], g.corner[first + c]
            if slot == ground:
                continue
            for d in range(dim):
                v[slot * dim + d] = work.v[root, d]
                if not work.driven[c, d]:
                    mass = 1.0 / g.compliance[slot, d]
                    impulses[slot, d] = mass * (work.v[root, d] - work.free[c, d])
                    continue
                # what the others of the cluster do not take, shared among those that are driven
                rest, sharing = 0.0, 0
                for other in range(k):
                    if work.cluster[other] != root:
                        continue
                    rest += external[other, d]
                    if work.driven[other, d]:
                        sharing += 1
                    else:
                        mass = 1.0 / g.compliance[g.corner[first + other], d]
                        rest -= mass * (work.v[root, d] - work.free[other, d])
                impulses[slot, d] = rest / sharing

    @njit(**LEAN_INNER)
    def least_flow(b, k, g, work):
        first, last = g.bond_offsets[b], g.bond_offsets[b + 1]
        flow(
            work.laplacian, k, first, last, g.sides, g.least, work.fused, work.driven,
            work.cluster, work.pinned, work.source, work.flow,
        )  # fmt: skip

    @njit(**LEAN_INNER)
    def eliminate(a, n, x):
        """x, flat, becomes a^-1 x; False if a is singular. Pivots are sought by columns."""
        for c in range(n):
            pivot = c
            for i in range(c + 1, n):
                if abs(a[i, c]) > abs(a[pivot, c]):
                    pivot = i
            if abs(a[pivot, c]) < _SINGULAR:
                return False
            if pivot != c:
                for j in range(c, n):
                    a[c, j], a[pivot, j] = a[pivot, j], a[c, j]
                x[c], x[pivot] = x[pivot], x[c]
            for i in range(c + 1, n):
                factor = a[i, c] / a[c, c]
                if factor != 0.0:
                    for j in range(c, n):
                        a[i, j] -= factor * a[c, j]
                    x[i] -= factor * x[c]
        for c in range(n - 1, -1, -1):
            for j in range(c + 1, n):
                x[c] -= a[c, j] * x[j]
            x[c] /= a[c, c]
        return True

    @njit(**LEAN_INNER)
    def newton(b, g, work):
        """`flow` of active bonds, their residuals, becomes the correction; False if there is none.

        Unknowns are those of active bonds, packed one after the other.
        """
        first, last = g.bond_offsets[b], g.bond_offsets[b + 1]
        n = 0
        for q in range(first, last):
            if not work.active[q - first]:
                continue
            m = 0
            for p in range(first, last):
                if not work.active[p - first]:
                    continue
                for y in range(dim):
                    coupling = 0.0
                    if p != q:
                        for s in range(2):
                            for t in range(2):
                                root = work.cluster[g.sides[q, s]]
                                if root == work.cluster[g.sides[p, t]]:
                                    coupling += work.w[root, y] if s == t else -work.w[root, y]
                    for x in range(dim):
                        entry = -_REGULAR * work.slope[q - first, x, y] * coupling
                        work.system[n + x, m + y] = entry
                m += dim
            for x in range(dim):
                work.system[n + x, n + x] += 1.0
            n += dim
        packed = work.slope.reshape(-1)  # no longer needed
        n = 0
        for q in range(last - first):
            if work.active[q]:
                for x in range(dim):
                    packed[n + x] = work.flow[q, x]
                n += dim
        if not eliminate(work.system, n, packed):
            return False
        n = 0
        for q in range(last - first):
            if work.active[q]:
                for x in range(dim):
                    work.flow[q, x] = packed[n + x]
                n += dim
        return True

    return gather, partition, activate, form, sources, put, least_flow, newton


@cache
def _group_kernels(law: LawKernels, dim: int):
    """What a vertex does with its bonds of one law.

    Each takes the vertex, its graphs, the work space, the number of the group, the rows of bonds,
    and the group's arrays.
    """
    components = law.components
    algebra, world = for_dimension(dim, components), for_dimension(dim)
    row, set_row, dot, unit = algebra.row, algebra.set_row, algebra.dot, algebra.unit
    add, subtract, scale = algebra.add, algebra.subtract, algebra.scale
    to_local, to_global, world_row = algebra.to_local, algebra.to_global, world.row
    multiply, world_set = world.multiply_diagonal, world.set_row
    solve, prepare, local = law.solve, law.prepare, local_flow(dim)
    rigid = law.rigid is not None
    bears, held, insist = law.rigid if rigid else (None, None, None)
    world_add, world_subtract = world.add, world.subtract
    world_unit, world_scale = world.unit, world.scale

    @njit(**_INLINED)
    def weigh(w, root, x):
        """w x of a cluster."""
        if dim == 2:
            return w[root, 0] * x[0], w[root, 1] * x[1]
        return w[root, 0] * x[0], w[root, 1] * x[1], w[root, 2] * x[2]

    @njit(**_INLINED)
    def relative(q, i, g, work, arrays):
        candidate = world_row(work.v, work.cluster[g.sides[q, 0]])
        antagonist = world_row(work.v, work.cluster[g.sides[q, 1]])
        return to_local(arrays[0], i, world_subtract(candidate, antagonist))

    @njit(**_INLINED)
    def push(q, g, work, p):
        """Give an impulse, in axes of space, to both clusters."""
        c, a = work.cluster[g.sides[q, 0]], work.cluster[g.sides[q, 1]]
        world_set(work.v, c, world_add(world_row(work.v, c), weigh(work.w, c, p)))
        world_set(work.v, a, world_subtract(world_row(work.v, a), weigh(work.w, a, p)))

    @njit(**LEAN_INNER)
    def begin(b, g, work, group, rows, step, arrays, group_of):
        """Compliances and constants of active bonds; their impulses act."""
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if group_of[q] != group:
                continue
            i = rows[q]
            if not work.active[q - first]:
                set_row(impulse, i, scale(0.0, row(impulse, i)))
                continue
            c, a = work.cluster[g.sides[q, 0]], work.cluster[g.sides[q, 1]]
            place = 0
            for z in range(components):
                e = to_global(frame, i, unit(z, 1.0))
                column = to_local(
                    frame, i, world_add(weigh(work.w, c, e), weigh(work.w, a, e))
                )  # fmt: skip
                for x in range(z, components):
                    compliance[i, place] = column[x]
                    place += 1
            prepare(
                i, row(jump, i), row(velocity, i), compliance, area[i], step, 0.5, parameters,
                state, terms, details,
            )  # fmt: skip
            push(q, g, work, to_global(frame, i, row(impulse, i)))

    @njit(**_INLINED)
    def scale_of(i, u, r, compliance):
        """Impulse that counts as one of the bond's: its own, or a share of what would stop it."""
        w = compliance[i, 0]
        stop = _SMALL * np.sqrt(dot(u, u)) / w if w > 0.0 else 0.0
        return max(np.sqrt(dot(r, r)), stop)

    @njit(**LEAN_INNER)
    def sweep(b, g, work, group, rows, count, arrays, group_of):
        """Visit active bonds; returns the largest change and the largest impulse."""
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        first, worst, big = g.bond_offsets[b], 0.0, 0.0
        for q in range(first, g.bond_offsets[b + 1]):
            if group_of[q] != group or not work.active[q - first]:
                continue
            i = rows[q]
            u, old = relative(q, i, g, work, arrays), row(impulse, i)
            new, _ = solve(i, u, old, compliance, parameters, terms, details)
            change = subtract(new, old)
            set_row(impulse, i, new)
            push(q, g, work, to_global(frame, i, change))
            worst = max(worst, np.sqrt(dot(change, change)))
            big = max(big, scale_of(i, u, new, compliance))
            if rigid and count > _SNAPS:
                u = relative(q, i, g, work, arrays)
                insist(i, u, count > _SETTLES, parameters, terms, details)
        return worst, big

    @njit(**LEAN_INNER)
    def linearise(b, g, work, group, rows, arrays, group_of):
        """Residuals and slopes of active bonds, in axes of space."""
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        first, worst, big = g.bond_offsets[b], 0.0, 0.0
        for q in range(first, g.bond_offsets[b + 1]):
            if group_of[q] != group or not work.active[q - first]:
                continue
            i = rows[q]
            u, old = relative(q, i, g, work, arrays), row(impulse, i)
            new, _ = solve(i, u, old, compliance, parameters, terms, details)
            change = subtract(new, old)
            world_set(work.flow, q - first, to_global(frame, i, change))
            worst = max(worst, np.sqrt(dot(change, change)))
            big = max(big, scale_of(i, u, new, compliance))
            moved = np.sqrt(dot(u, u)) + compliance[i, 0] * np.sqrt(dot(old, old))
            reach = max(_REACH * moved, 1e-300)
            for y in range(dim):
                e = to_local(frame, i, world_unit(y, reach))
                other, _ = solve(i, add(u, e), old, compliance, parameters, terms, details)
                column = to_global(frame, i, scale(1.0 / reach, subtract(other, new)))
                for x in range(dim):
                    work.slope[q - first, x, y] = column[x]
        return worst, big

    @njit(**LEAN_INNER)
    def correct(b, g, work, group, rows, arrays, group_of):
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if group_of[q] == group and work.active[q - first]:
                i = rows[q]
                change = to_local(frame, i, world_row(work.flow, q - first))
                set_row(impulse, i, add(row(impulse, i), change))
                push(q, g, work, to_global(frame, i, change))

    @njit(**LEAN_INNER)
    def subtract_from(b, g, work, group, rows, arrays, group_of, corners, factor):
        """Add to each corner what active bonds give it, times a factor."""
        frame, impulse = arrays[0], arrays[1]
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if group_of[q] == group and work.active[q - first]:
                p = world_scale(factor, to_global(frame, rows[q], row(impulse, rows[q])))
                c, a = g.sides[q, 0], g.sides[q, 1]
                world_set(corners, c, world_add(world_row(corners, c), p))
                world_set(corners, a, world_subtract(world_row(corners, a), p))

    @njit(**LEAN_INNER)
    def all_bear(b, g, work, group, rows, step, parameters, group_of):
        """Whether fused bonds bear their flows; `rows` are those of `parameters`."""
        if rigid:
            first = g.bond_offsets[b]
            for q in range(first, g.bond_offsets[b + 1]):
                if group_of[q] == group and work.fused[q - first]:
                    p = local(g.normal, q, work.flow, q - first)
                    r = (p[0], p[1]) if dim == 2 else (p[0], p[1], p[2])
                    if not bears(rows[q], r, step * g.area[q], parameters):
                        return False
        return True

    @njit(**LEAN_INNER)
    def find_fused(b, g, work, group, rows, arrays, group_of):
        """Bonds that have never opened are fused."""
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if group_of[q] == group:
                work.fused[q - first] = rigid and arrays[7][rows[q], 0] == 0.0

    @njit(**LEAN_INNER)
    def cut(b, g, work, group, rows, arrays, group_of):
        """Fused bonds that have opened are no longer; returns how many."""
        count = 0
        if rigid:
            frame, impulse = arrays[0], arrays[1]
            parameters, terms, details = arrays[6], arrays[8], arrays[9]
            first = g.bond_offsets[b]
            for q in range(first, g.bond_offsets[b + 1]):
                if group_of[q] == group and work.fused[q - first]:
                    i = rows[q]
                    u, r = relative(q, i, g, work, arrays), row(impulse, i)
                    if not held(i, u, r, parameters, terms, details):
                        work.fused[q - first] = False
                        count += 1
        return count

    return begin, sweep, linearise, correct, subtract_from, all_bear, find_fused, cut


@cache
def _chain(laws: tuple[LawKernels, ...], dim: int):
    """The kernels over all laws of a vertex, one after the other."""
    here = _group_kernels(laws[0], dim)
    if len(laws) == 1:
        rest = None
    else:
        rest = _chain(laws[1:], dim)
    begin, sweep, linearise, correct, subtract_from, all_bear, find_fused, cut = here
    last = rest is None
    (
        begin_2, sweep_2, linearise_2, correct_2, subtract_2, all_bear_2, find_2, cut_2
    ) = here if last else rest  # fmt: skip

    @njit(**_INLINED)
    def begin_all(b, g, work, group, rows, step, groups, group_of):
        begin(b, g, work, group, rows, step, groups[0], group_of)
        if not last:
            begin_2(b, g, work, group + 1, rows, step, groups[1:], group_of)

    @njit(**_INLINED)
    def sweep_all(b, g, work, group, rows, count, groups, group_of):
        worst, big = sweep(b, g, work, group, rows, count, groups[0], group_of)
        if not last:
            x, y = sweep_2(b, g, work, group + 1, rows, count, groups[1:], group_of)
            worst, big = max(worst, x), max(big, y)
        return worst, big

    @njit(**_INLINED)
    def linearise_all(b, g, work, group, rows, groups, group_of):
        worst, big = linearise(b, g, work, group, rows, groups[0], group_of)
        if not last:
            x, y = linearise_2(b, g, work, group + 1, rows, groups[1:], group_of)
            worst, big = max(worst, x), max(big, y)
        return worst, big

    @njit(**_INLINED)
    def correct_all(b, g, work, group, rows, groups, group_of):
        correct(b, g, work, group, rows, groups[0], group_of)
        if not last:
            correct_2(b, g, work, group + 1, rows, groups[1:], group_of)

    @njit(**_INLINED)
    def subtract_all(b, g, work, group, rows, groups, group_of, corners, factor):
        subtract_from(b, g, work, group, rows, groups[0], group_of, corners, factor)
        if not last:
            subtract_2(b, g, work, group + 1, rows, groups[1:], group_of, corners, factor)

    @njit(**_INLINED)
    def bear_all(b, g, work, group, rows, step, tables, group_of):
        good = all_bear(b, g, work, group, rows, step, tables[0], group_of)
        if not last:
            good = good and all_bear_2(b, g, work, group + 1, rows, step, tables[1:], group_of)
        return good

    @njit(**_INLINED)
    def find_all(b, g, work, group, rows, groups, group_of):
        find_fused(b, g, work, group, rows, groups[0], group_of)
        if not last:
            find_2(b, g, work, group + 1, rows, groups[1:], group_of)

    @njit(**_INLINED)
    def cut_all(b, g, work, group, rows, groups, group_of):
        count = cut(b, g, work, group, rows, groups[0], group_of)
        if not last:
            count += cut_2(b, g, work, group + 1, rows, groups[1:], group_of)
        return count

    return (
        begin_all, sweep_all, linearise_all, correct_all, subtract_all, bear_all, find_all, cut_all
    )  # fmt: skip


@cache
def _nest(count: int):
    """Kernel that makes of a flat tuple of arrays one of a tuple a group."""
    if count == 0:
        return njit(**_INLINED)(lambda arrays: ())
    rest = _nest(count - 1)

    @njit(**_INLINED)
    def nest(arrays):
        return (arrays[:10], *rest(arrays[10:]))

    return nest


@cache
def _whole_kernel(laws: tuple[LawKernels, ...], dim: int):
    """Whole vertices: `move_whole(v, impulses, step, ground, g, work, whole, rows, tables, ...)`."""
    gather, partition, _, form, sources, put, least_flow, _ = _vertex_kernels(dim)
    bear_all = _chain(laws, dim)[5]
    world = for_dimension(dim)
    add, scale, subtract, dot = world.add, world.scale, world.subtract, world.dot

    @njit(**_INLINED)
    def at(v, slot):
        first = slot * dim
        if dim == 2:
            return v[first], v[first + 1]
        return v[first], v[first + 1], v[first + 2]

    @njit(**LEAN_INNER)
    def flow_along_tree(b, v, step, mean, g, work):
        """Whether the flow along the vertex's tree, eased along its rings, is weak enough."""
        first, last = g.corner_offsets[b], g.corner_offsets[b + 1]
        low, flow, source = g.bond_offsets[b], work.flow, work.source
        for c in range(first, last):
            given = scale(g.mass[c], subtract(mean, at(v, g.corner[c])))
            for d in range(dim):
                source[c - first, d] = given[d]
        for q in range(g.bond_offsets[b + 1] - low):
            for d in range(dim):
                flow[q, d] = 0.0
        for n in range(first, last - 1):
            c, q, up = g.tree[n, 0], g.tree[n, 1], g.tree[n, 2]
            if c < 0:
                return False
            sign = 1.0 if g.sides[low + q, 0] == c else -1.0
            for d in range(dim):
                flow[q, d] = sign * source[c, d]
                source[up, d] += source[c, d]
        for _ in range(_EASINGS):
            for m in range(g.ring_offsets[b], g.ring_offsets[b + 1]):
                start = g.ring_ends[m - 1] if m > 0 else 0
                total, x, y, z = 0.0, 0.0, 0.0, 0.0
                for n in range(start, g.ring_ends[m]):
                    q = g.ring[n, 0]
                    weight = 1.0 / (g.least[low + q] * g.least[low + q])
                    total += weight
                    weight *= g.ring[n, 1]
                    x += weight * flow[q, 0]
                    y += weight * flow[q, 1]
                    if dim == 3:
                        z += weight * flow[q, 2]
                for n in range(start, g.ring_ends[m]):
                    q, share = g.ring[n, 0], g.ring[n, 1] / total
                    flow[q, 0] -= share * x
                    flow[q, 1] -= share * y
                    if dim == 3:
                        flow[q, 2] -= share * z
        for q in range(g.bond_offsets[b + 1] - low):
            size = flow[q, 0] ** 2 + flow[q, 1] ** 2
            if dim == 3:
                size += flow[q, 2] ** 2
            if size > (step * g.least[low + q]) ** 2:
                return False
        return True

    @njit(**_INLINED)
    def holds_easily(b, v, step, g, work):
        """Move a vertex that nothing drives if a flow is borne that is soon found."""
        first, last = g.corner_offsets[b], g.corner_offsets[b + 1]
        momentum = scale(0.0, at(v, g.corner[first]))
        for c in range(first, last):
            momentum = add(momentum, scale(g.mass[c], at(v, g.corner[c])))
        mean, total = scale(g.compliance_of_vertex[b], momentum), 0.0
        for c in range(first, last):
            given = scale(g.mass[c], subtract(mean, at(v, g.corner[c])))
            total += dot(given, given)
        # (sum |s|)^2 <= k sum |s|^2
        if 0.25 * (last - first) * total > (step * g.weakest[b]) ** 2:
            if not flow_along_tree(b, v, step, mean, g, work):
                return False
        for c in range(first, last):
            for d in range(dim):
                v[g.corner[c] * dim + d] = mean[d]
        return True

    @njit(**LEAN_ENTRY)
    def move_whole(v, impulses, step, ground, g, work, whole, rows, group_of, tables, failed):
        """Move whole vertices; returns how many do not hold, first of `failed`."""
        count = 0
        for b in range(len(whole)):
            if not whole[b]:
                continue
            if g.compliance_of_vertex[b] > 0.0 and holds_easily(b, v, step, g, work):
                continue
            k = gather(b, v, g, work)
            first, last = g.bond_offsets[b], g.bond_offsets[b + 1]
            for q in range(last - first):
                work.fused[q] = True
            for c in range(k):
                work.cluster[c] = 0
            form(b, k, g, work)
            if sources(b, k, g, work) > step * g.weakest[b]:
                least_flow(b, k, g, work)
                if not bear_all(b, g, work, 0, rows, step, tables, group_of):
                    failed[count] = b
                    count += 1
                    continue
            for c in range(k):
                for d in range(dim):
                    work.source[c, d] = 0.0
            put(b, k, ground, v, impulses, g, work, work.source)
        return count

    return move_whole


@cache
def _split_kernel(laws: tuple[LawKernels, ...], dim: int):
    """Vertices that are not whole."""
    gather, partition, activate, form, sources, put, least_flow, newton = _vertex_kernels(dim)
    begin, sweep, linearise, correct, subtract_from, bear, find_fused, cut = _chain(laws, dim)
    nest = _nest(len(laws))

    @njit(**LEAN_INNER)
    def iterate(b, g, work, rows, groups, group_of, most):
        """Solve the active bonds; returns sweeps and the relative change of the last one."""
        count, batch, stage, error = 0, _FIRST, 0, np.inf
        while count < most:
            for _ in range(batch):
                count += 1
                worst, big = sweep(b, g, work, 0, rows, count, groups, group_of)
                error = worst / big if big > 0.0 else 0.0
                if error <= _TOLERANCE:
                    return count, error
            for _ in range(_NEWTON_STEPS):
                worst, big = linearise(b, g, work, 0, rows, groups, group_of)
                if worst <= _TOLERANCE * big or not newton(b, g, work):
                    break
                correct(b, g, work, 0, rows, groups, group_of)
            stage += 1
            batch = _BATCH if stage < _EARLY else _LONG_BATCH
        return count, error

    @njit(**LEAN_INNER)
    def clusters(b, k, g, work, rows, step, groups, group_of, most):
        """Solve the vertex with the clusters that there are; returns sweeps and error."""
        acting = activate(b, g, work)
        form(b, k, g, work)
        begin(b, g, work, 0, rows, step, groups, group_of)
        if acting == 0:
            return 0, 0.0
        return iterate(b, g, work, rows, groups, group_of, most)

    @njit(**LEAN_INNER)
    def solve_vertex(b, v, step, g, work, rows, tables, groups, group_of):
        """Returns corners, sweeps, error."""
        k = gather(b, v, g, work)
        find_fused(b, g, work, 0, rows, groups, group_of)
        first, last = g.bond_offsets[b], g.bond_offsets[b + 1]
        sweeps, error = 0, 0.0
        for turn in range(_ROUNDS):
            parts = partition(b, k, g, work)
            count, error = clusters(b, k, g, work, rows, step, groups, group_of, _MOST)
            sweeps += count
            if turn == _ROUNDS - 1 or parts == k:
                break
            sources(b, k, g, work)
            subtract_from(b, g, work, 0, rows, groups, group_of, work.source, -1.0)
            for c in range(k):
                for d in range(dim):
                    if work.driven[c, d]:
                        work.source[c, d] = 0.0
            least_flow(b, k, g, work)
            if bear(b, g, work, 0, rows, step, tables, group_of):
                break
            # each cell for itself
            for c in range(k):
                work.cluster[c] = c
            count, _ = clusters(b, k, g, work, rows, step, groups, group_of, _MOST)
            sweeps += count
            if cut(b, g, work, 0, rows, groups, group_of) == 0:
                opened = False
            else:
                opened = partition(b, k, g, work) > parts
            # what opened within a cluster stays as it was
            find_all = not opened
            for q in range(first, last):
                if g.least[q] > 0.0 and not work.fused[q - first]:
                    joined = work.cluster[g.sides[q, 0]] == work.cluster[g.sides[q, 1]]
                    if joined:
                        work.fused[q - first] = True
            if find_all:
                find_fused(b, g, work, 0, rows, groups, group_of)
                partition(b, k, g, work)
                count, error = clusters(b, k, g, work, rows, step, groups, group_of, _MOST)
                sweeps += count
                break
        return k, sweeps, error

    @njit(**LEAN_ENTRY)
    def solve_split(
        v, impulses, step, ground, g, work, split, rows, group_of, tables, arrays, tolerance
    ):
        """All that are not whole; returns the most sweeps, the largest error, and how many failed."""
        groups = nest(arrays)
        most, largest, failed = 0, 0.0, 0
        for n in range(len(split)):
            b = split[n]
            k, sweeps, error = solve_vertex(b, v, step, g, work, rows, tables, groups, group_of)
            most, largest = max(most, sweeps), max(largest, error)
            failed += error > tolerance
            for c in range(k):
                for d in range(dim):
                    work.source[c, d] = 0.0
            subtract_from(b, g, work, 0, rows, groups, group_of, work.source, 1.0)
            put(b, k, ground, v, impulses, g, work, work.source)
        return most, largest, failed

    return solve_split


class SplittingVertices(Solver):
    """Whole vertices as nodes of finite elements, cracked ones solved each for itself."""

    name = "splitting_vertices"

    def __init__(self) -> None:
        self._work: _Work | None = None

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        fused: FusedPoints = interactions.fused
        graphs, dim, step = fused.graphs, interactions.dim, interactions.step_size
        if self._work is None:
            self._work = _work(graphs, dim)
        laws = tuple(g.kernels for g in fused.groups)
        ground = interactions.inverse.num_nodes
        move_whole = _whole_kernel(laws, dim)
        failed = move_whole(
            velocity, fused.impulses, step, ground, graphs, self._work, fused.whole,
            fused.table_rows, fused.group_of, fused.tables, fused.failed,
        )  # fmt: skip
        if failed:
            interactions.wake(fused.failed[:failed].copy())
        if not len(fused.split):
            return SolveReport(True, 0, 0.0, 0.0)
        arrays = tuple(
            array
            for g in fused.groups
            for array in (g.couplings.frame, g.impulse, g.compliance, g.points.area, g.jump,
                          g.velocity, g.parameters, g.state, g.terms, g.details)
        )  # fmt: skip
        sweeps, error, missed = _split_kernel(laws, dim)(
            velocity, fused.impulses, step, ground, graphs, self._work, fused.split, fused.rows,
            fused.group_of, tuple(g.parameters for g in fused.groups), arrays, options.tolerance,
        )  # fmt: skip
        return SolveReport(missed == 0, sweeps, error, 0.0)
