# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices that are not whole: clusters of cells, and bonds between them."""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER, MERGED
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.splitting.bonds_of_laws import kernels_of_laws
from xper_fx.nscd.splitting.vertex_kernels import vertex_kernels
from xper_fx.nscd.splitting.whole_vertices import whole_kernel

# Relative change of the impulses of a vertex at which it is solved: a few unknowns, cheap to have.
# Solvers with a tolerance below it take it, too: it is near what rounding lets through.
_TOLERANCE = 1e-11
# Change at which a vertex is solved where Newton's method has come to rest, if that is within the
# solver's tolerance, or what opens is all that is asked: a bond at a kink of its law, as one that
# just bears its load, then answers now so and now so.
_AT_REST = 1e-6
# Relative change of internal variables, as of damage, at which they have followed.
_SETTLED = 1e-9
# Sweeps before the first Newton steps, and after each batch of them, early and late.
_FIRST, _BATCH, _LONG_BATCH, _EARLY = 8, 4, 25, 8
_NEWTON_STEPS = 6
# Growth of what the laws ask for that is none, and by what a Newton step becomes shorter that lets
# it grow, or longer that lets it be: wedged cells creep, by the same amount at each visit. Shortest
# and longest step.
_ALIKE, _LONGER, _SHORTEST, _LONGEST = 1.001, 4.0, 1e-6, 1e6
# Sweeps after which to give up.
_MOST = 400
# How often what opens is looked for.
_ROUNDS = 4


@cache
def _nest(count: int):
    """Kernel that makes of a flat tuple of arrays one of a tuple a group."""
    if count == 0:
        return njit(inline="always")(lambda arrays: ())
    rest = _nest(count - 1)

    @njit(inline="always")
    def nest(arrays):
        return (arrays[:10], *rest(arrays[10:]))

    return nest


@cache
def split_kernel(laws: tuple[LawKernels, ...], dim: int):
    """Vertices that are not whole, once those that are have moved."""
    of_vertex, of_laws = vertex_kernels(dim), kernels_of_laws(laws, dim)
    move_whole = whole_kernel(laws, dim)
    gather, _, partition, form, sources, bound, put, least_flow, newton = of_vertex
    begin, sweep, settle, ask, slopes, correct, give, bear, find_fused, cut = of_laws
    nest = _nest(len(laws))

    @njit(**LEAN_INNER)
    def move_along(b, share, g, work, rows, groups, group_of):
        """Change the impulses by a share of `direction`."""
        for q in range(g.bond_offsets[b + 1] - g.bond_offsets[b]):
            for d in range(dim):
                work.flow[q, d] = share * work.direction[q, d]
        correct(b, g, work, rows, groups, group_of)

    @njit(**LEAN_INNER)
    def newton_steps(b, g, work, rows, groups, group_of):
        """Newton steps, as long as what the laws still ask for does not grow; returns that."""
        worst, big = ask(b, g, work, rows, groups, group_of)
        for _ in range(_NEWTON_STEPS):
            if worst <= _TOLERANCE * big:
                break
            slopes(b, g, work, rows, groups, group_of)
            if not newton(b, g, work):
                break
            for q in range(g.bond_offsets[b + 1] - g.bond_offsets[b]):
                for d in range(dim):
                    work.direction[q, d] = work.flow[q, d]
            correct(b, g, work, rows, groups, group_of)
            share = 1.0
            left, big = ask(b, g, work, rows, groups, group_of)
            while left > _ALIKE * worst and share > _SHORTEST:
                move_along(b, (1.0 / _LONGER - 1.0) * share, g, work, rows, groups, group_of)
                share /= _LONGER
                left, big = ask(b, g, work, rows, groups, group_of)
            if left > _ALIKE * worst:
                move_along(b, -share, g, work, rows, groups, group_of)
                break
            while _ALIKE * left > worst and 1.0 <= share < _LONGEST:
                move_along(b, (_LONGER - 1.0) * share, g, work, rows, groups, group_of)
                share *= _LONGER
                left, big = ask(b, g, work, rows, groups, group_of)
                if left > _ALIKE * worst:
                    move_along(b, (1.0 / _LONGER - 1.0) * share, g, work, rows, groups, group_of)
                    left, big = ask(b, g, work, rows, groups, group_of)
                    break
            worst = left
        return worst

    @njit(**MERGED)
    def iterate(b, g, work, rows, tolerance, groups, group_of):
        """Solve the active bonds; returns sweeps and the relative change of the last one."""
        count, batch, stage, error = 0, _FIRST, 0, np.inf
        bound, before = _TOLERANCE, np.inf
        while count < _MOST:
            for _ in range(batch):
                count += 1
                worst, big = sweep(b, g, work, rows, count, groups, group_of)
                error = worst / big if big > 0.0 else 0.0
                if error <= bound:
                    if settle(b, g, work, rows, groups, group_of) <= _SETTLED:
                        return count, error
            worst = newton_steps(b, g, work, rows, groups, group_of)
            bound = min(tolerance, _AT_REST) if worst > 0.5 * before else _TOLERANCE
            before = worst
            stage += 1
            batch = _BATCH if stage < _EARLY else _LONG_BATCH
        return count, error

    @njit(**MERGED)
    def solve_clusters(b, g, work, rows, step, tolerance, groups, group_of):
        """Solve the vertex with the clusters that there are; returns sweeps and error."""
        form(g.corner_offsets[b + 1] - g.corner_offsets[b], work)
        if begin(b, g, work, rows, step, groups, group_of) == 0:
            return 0, 0.0
        return iterate(b, g, work, rows, tolerance, groups, group_of)

    @njit(**MERGED)
    def holds(b, g, work, rows, step, tables, groups, group_of):
        """Whether fused bonds bear what they transmit."""
        k = g.corner_offsets[b + 1] - g.corner_offsets[b]
        sources(k, work)
        give(b, g, work, rows, groups, group_of, -1.0)
        weakest, largest = np.inf, bound(k, work)
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if work.fused[q - first]:
                weakest = min(weakest, g.least[q])
        if largest <= step * weakest:
            return True  # so are the least flows, see `holding.py`
        least_flow(b, k, g, work)
        return bear(b, g, work, rows, step, tables, group_of)

    @njit(**LEAN_INNER)
    def fuse_within_clusters(b, g, work):
        """What has opened within a cluster, which others hold, stays as it was."""
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if g.least[q] > 0.0 and work.cluster[g.sides[q, 0]] == work.cluster[g.sides[q, 1]]:
                work.fused[q - first] = True

    @njit(**MERGED)
    def solve_vertex(b, v, step, tolerance, g, work, rows, tables, groups, group_of):
        """Returns corners, sweeps, error."""
        k, bonds = gather(b, v, g, work), g.bond_offsets[b + 1] - g.bond_offsets[b]
        find_fused(b, g, work, rows, groups, group_of)
        parts = partition(b, k, g, work)
        sweeps, rounds, each_for_itself = 0, _ROUNDS, False
        while True:
            rest = _AT_REST if each_for_itself else tolerance
            count, error = solve_clusters(b, g, work, rows, step, rest, groups, group_of)
            sweeps += count
            if each_for_itself:
                before, each_for_itself = parts, False
                opened = cut(b, g, work, rows, groups, group_of) > 0
                parts = partition(b, k, g, work)
                if opened and parts > before:
                    fuse_within_clusters(b, g, work)
                    continue
                for q in range(bonds):
                    work.fused[q] = work.kept[q]
                parts, rounds = partition(b, k, g, work), 0
                continue
            rounds -= 1
            if rounds <= 0 or parts == k:
                return k, sweeps, error
            if holds(b, g, work, rows, step, tables, groups, group_of):
                return k, sweeps, error
            each_for_itself = True
            for q in range(bonds):
                work.kept[q] = work.fused[q]
            for c in range(k):
                work.cluster[c] = c

    @njit(**LEAN_ENTRY)
    def solve_split(
        v,
        impulses,
        step,
        ground,
        g,
        work,
        vertices,
        whole,
        table_rows,
        group_of,
        whole_tables,
        failed,
        split,
        rows,
        tables,
        arrays,
        tolerance,
        clusters,
    ):
        """Move whole ones of `vertices`, then all of `split` if the former hold.

        `clusters`, shape (num_corners,), takes the first corner of each one's cluster, counted in
        the vertex; it has no length where nobody asks.

        Returns:
            How many whole ones do not hold, as of `move_whole`, and of the others the most sweeps,
            the largest error, and how many failed.
        """
        weak = move_whole(
            v, impulses, step, ground, g, work, vertices, whole, table_rows, group_of,
            whole_tables, failed
        )  # fmt: skip
        if weak > 0:
            return weak, 0, 0.0, 0
        groups, tolerance = nest(arrays), max(tolerance, _TOLERANCE)
        most, largest, missed = 0, 0.0, 0
        for n in range(len(split)):
            b = split[n]
            k, sweeps, error = solve_vertex(
                b, v, step, tolerance, g, work, rows, tables, groups, group_of
            )
            most, largest = max(most, sweeps), max(largest, error)
            missed += error > tolerance
            for c in range(k):
                for d in range(dim):
                    work.source[c, d] = 0.0
            give(b, g, work, rows, groups, group_of, 1.0)
            # velocities that many sweeps have added to carry their rounding: from the start again
            form(k, work)
            for c in range(k):
                root = work.cluster[c]
                for d in range(dim):
                    work.v[root, d] += work.w[root, d] * work.source[c, d]
            put(b, k, ground, v, impulses, g, work, work.source)
            if len(clusters) > 0:
                for c in range(k):
                    clusters[g.corner_offsets[b] + c] = work.cluster[c]
        return 0, most, largest, missed

    return solve_split
