# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a vertex does with its bonds, law by law: visits, slopes, what they bear."""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.splitting.holding import local_flow

# Impulses smaller than this share of what stops the parts are of no account.
_SMALL = 1e-2
# Reach of the differences that give slopes, over the velocity.
_REACH = 1e-7
# Sweeps after which bonds that broke once stay broken, and after which none is sounder than it was.
_SNAPS, _SETTLES = 24, 100

_INLINED = {"inline": "always"}


@cache
def _law_kernels(law: LawKernels, dim: int):
    """What a vertex does with its bonds of one law.

    Each takes the vertex, its graphs, the work space, the number of the group, the rows of bonds,
    and the group's arrays.
    """
    components = law.components
    algebra, world = for_dimension(dim, components), for_dimension(dim)
    row, set_row, dot, unit = algebra.row, algebra.set_row, algebra.dot, algebra.unit
    add, subtract, scale = algebra.add, algebra.subtract, algebra.scale
    to_local, to_global, world_row = algebra.to_local, algebra.to_global, world.row
    world_set = world.set_row
    solve, prepare, evolve, local = law.solve, law.prepare, law.evolve, local_flow(dim)
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

    @njit(**MERGED)
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
                prepare(  # nothing of an attempt to open it stays
                    i, row(jump, i), row(velocity, i), compliance, area[i], step, 0.5, parameters,
                    state, terms, details,
                )  # fmt: skip
                continue
            c, a = work.cluster[g.sides[q, 0]], work.cluster[g.sides[q, 1]]
            place = 0
            for z in range(components):
                e = to_global(frame, i, unit(z, 1.0))
                moved = world_add(weigh(work.w, c, e), weigh(work.w, a, e))
                column = to_local(frame, i, moved)
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

    @njit(**MERGED)
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

    @njit(**MERGED)
    def settle(b, g, work, group, rows, arrays, group_of):
        """Internal variables of active bonds follow; returns the largest relative change."""
        largest = 0.0
        if evolve is not None:
            compliance, parameters = arrays[2], arrays[6]
            terms, details = arrays[8], arrays[9]
            first = g.bond_offsets[b]
            for q in range(first, g.bond_offsets[b + 1]):
                if group_of[q] == group and work.active[q - first]:
                    i, u = rows[q], relative(q, rows[q], g, work, arrays)
                    change = evolve(i, u, compliance, parameters, terms, details)
                    largest = max(largest, change)
        return largest

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

    @njit(**MERGED)
    def give(b, g, work, group, rows, arrays, group_of, factor):
        """Add to the source of each corner what active bonds give it, times a factor."""
        frame, impulse, corners = arrays[0], arrays[1], work.source
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if group_of[q] == group and work.active[q - first]:
                p = world_scale(factor, to_global(frame, rows[q], row(impulse, rows[q])))
                c, a = g.sides[q, 0], g.sides[q, 1]
                world_set(corners, c, world_add(world_row(corners, c), p))
                world_set(corners, a, world_subtract(world_row(corners, a), p))

    @njit(**MERGED)
    def all_bear(b, g, work, group, rows, step, parameters, group_of):
        """Whether fused bonds bear their flows; `rows` are those of `parameters`."""
        if rigid:
            first = g.bond_offsets[b]
            for q in range(first, g.bond_offsets[b + 1]):
                if group_of[q] == group and work.fused[q - first]:
                    p = local(g.normal, q, work.flow, q - first)
                    if not bears(rows[q], p, step * g.area[q], parameters):
                        return False
        return True

    @njit(**MERGED)
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
            impulse = arrays[1]
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

    return begin, sweep, settle, linearise, correct, give, all_bear, find_fused, cut


@cache
def kernels_of_laws(laws: tuple[LawKernels, ...], dim: int):
    """The kernels over all laws of a vertex, one after the other."""
    here, last = _law_kernels(laws[0], dim), len(laws) == 1
    begin, sweep, settle, linearise, correct, give, all_bear, find_fused, cut = here
    rest = here if last else kernels_of_laws(laws[1:], dim)
    begin_2, sweep_2, settle_2, linearise_2, correct_2, give_2, all_bear_2, find_2, cut_2 = rest

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
    def settle_all(b, g, work, group, rows, groups, group_of):
        largest = settle(b, g, work, group, rows, groups[0], group_of)
        if not last:
            largest = max(largest, settle_2(b, g, work, group + 1, rows, groups[1:], group_of))
        return largest

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
    def give_all(b, g, work, group, rows, groups, group_of, factor):
        give(b, g, work, group, rows, groups[0], group_of, factor)
        if not last:
            give_2(b, g, work, group + 1, rows, groups[1:], group_of, factor)

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
        begin_all, sweep_all, settle_all, linearise_all, correct_all, give_all, bear_all, find_all,
        cut_all,
    )  # fmt: skip
