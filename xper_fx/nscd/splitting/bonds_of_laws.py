# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a vertex does with its bonds, law by law: visits, slopes, what they bear."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED
from xper_fx.nscd.law_loops import jump_to_prepare
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.splitting.holding import local_flow

# Impulses smaller than this share of what stops the parts are of no account.
_SMALL = 1e-2
# Reach of the differences that give slopes, over the velocity.
_REACH = 1e-7
# Sweeps after which bonds that broke once stay broken, and after which none is sounder than it was.
_SNAPS, _SETTLES = 24, 100

_INLINED = {"inline": "always"}


class _OfBond(NamedTuple):
    """What a vertex does with bond q, which has place e in its work space.

    Each takes the arrays of the law's group (`bears` the table of parameters), q, e, the graphs,
    the work space, and the bond's row in the group.
    """

    begin: object
    visit: object
    settle: object
    ask: object
    slope: object
    correct: object
    give: object
    bears: object
    sound: object
    opens: object


@cache
def _kernels_of_bond(law: LawKernels, dim: int) -> _OfBond:
    """The kernels of a law."""
    components = law.components
    algebra, world = for_dimension(dim, components), for_dimension(dim)
    row, set_row, dot, unit = algebra.row, algebra.set_row, algebra.dot, algebra.unit
    add, subtract, scale = algebra.add, algebra.subtract, algebra.scale
    to_local, to_global, world_row = algebra.to_local, algebra.to_global, world.row
    world_set = world.set_row
    solve, prepare, evolve, local = law.solve, law.prepare, law.evolve, local_flow(dim)
    touch = jump_to_prepare(law, dim)
    rigid = law.rigid is not None
    bears_flow, held, insist, rest, _ = law.rigid if rigid else 5 * (None,)
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
    def sound(arrays, q, e, g, work, i):
        """Whether a bond has never opened."""
        return rigid and arrays[7][i, 0] == 0.0

    @njit(**MERGED)
    def begin(arrays, q, e, g, work, i, step):
        """Compliance and constants of a bond; if it is active, its impulse acts.

        Nothing of an attempt to open it stays where it is not. A sound bond that has never moved
        has no use for constants then: its lips stay one.
        """
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        if work.active[e]:
            c, a = work.cluster[g.sides[q, 0]], work.cluster[g.sides[q, 1]]
            place = 0
            for z in range(components):
                axis = to_global(frame, i, unit(z, 1.0))
                moved = world_add(weigh(work.w, c, axis), weigh(work.w, a, axis))
                column = to_local(frame, i, moved)
                for x in range(z, components):
                    compliance[i, place] = column[x]
                    place += 1
            push(q, g, work, to_global(frame, i, row(impulse, i)))
        else:
            set_row(impulse, i, scale(0.0, row(impulse, i)))
            still = dot(row(jump, i), row(jump, i)) + dot(row(velocity, i), row(velocity, i)) == 0.0
            if rigid and still and sound(arrays, q, e, g, work, i):
                rest(i, details)
                return
        start = touch(i, row(jump, i), area[i], parameters, state)
        prepare(
            i, start, row(velocity, i), compliance, area[i], step, 0.5, parameters, state,
            terms, details,
        )  # fmt: skip

    @njit(**_INLINED)
    def scale_of(i, u, r, compliance):
        """Impulse that counts as one of the bond's: its own, or a share of what would stop it."""
        w = compliance[i, 0]
        stop = _SMALL * np.sqrt(dot(u, u)) / w if w > 0.0 else 0.0
        return max(np.sqrt(dot(r, r)), stop)

    @njit(**MERGED)
    def visit(arrays, q, e, g, work, i, count):
        """Let a bond answer; returns its change and the impulse that counts as one."""
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        u, old = relative(q, i, g, work, arrays), row(impulse, i)
        new, _ = solve(i, u, old, compliance, parameters, terms, details)
        change = subtract(new, old)
        set_row(impulse, i, new)
        push(q, g, work, to_global(frame, i, change))
        if rigid and count > _SNAPS:
            moved = relative(q, i, g, work, arrays)
            insist(i, moved, count > _SETTLES, parameters, terms, details)
        return np.sqrt(dot(change, change)), scale_of(i, u, new, compliance)

    @njit(**MERGED)
    def settle(arrays, q, e, g, work, i):
        """Internal variables follow; returns their largest relative change."""
        if evolve is None:
            return 0.0
        u = relative(q, i, g, work, arrays)
        return evolve(i, u, arrays[2], arrays[6], arrays[8], arrays[9])

    @njit(**MERGED)
    def ask(arrays, q, e, g, work, i):
        """Residual of a bond, in axes of space; returns what `visit` does."""
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        u, old = relative(q, i, g, work, arrays), row(impulse, i)
        new, _ = solve(i, u, old, compliance, parameters, terms, details)
        change = subtract(new, old)
        set_row(work.answer, e, new)
        world_set(work.flow, e, to_global(frame, i, change))
        return np.sqrt(dot(change, change)), scale_of(i, u, new, compliance)

    @njit(**MERGED)
    def slope(arrays, q, e, g, work, i):
        """Slope of a bond where `ask` has asked it, in axes of space."""
        frame, impulse, compliance, area, jump, velocity, parameters, state, terms, details = arrays
        u, old, new = relative(q, i, g, work, arrays), row(impulse, i), row(work.answer, e)
        moved = np.sqrt(dot(u, u)) + compliance[i, 0] * np.sqrt(dot(old, old))
        reach = max(_REACH * moved, 1e-300)
        for y in range(dim):
            axis = to_local(frame, i, world_unit(y, reach))
            other, _ = solve(i, add(u, axis), old, compliance, parameters, terms, details)
            column = to_global(frame, i, scale(1.0 / reach, subtract(other, new)))
            for x in range(dim):
                work.slope[e, x, y] = column[x]

    @njit(**MERGED)
    def correct(arrays, q, e, g, work, i):
        """Change the impulse of a bond by `flow`."""
        frame, impulse = arrays[0], arrays[1]
        change = to_local(frame, i, world_row(work.flow, e))
        set_row(impulse, i, add(row(impulse, i), change))
        push(q, g, work, to_global(frame, i, change))

    @njit(**MERGED)
    def give(arrays, q, e, g, work, i, factor):
        """Add to the sources of a bond's corners what it gives them, times a factor."""
        p = world_scale(factor, to_global(arrays[0], i, row(arrays[1], i)))
        corners, c, a = work.source, g.sides[q, 0], g.sides[q, 1]
        world_set(corners, c, world_add(world_row(corners, c), p))
        world_set(corners, a, world_subtract(world_row(corners, a), p))

    @njit(**MERGED)
    def bears(parameters, q, e, g, work, i, step):
        """Whether a bond bears its flow; `i` is the row of `parameters`."""
        if not rigid:
            return True
        return bears_flow(i, local(g.normal, q, work.flow, e), step * g.area[q], parameters)

    @njit(**MERGED)
    def opens(arrays, q, e, g, work, i):
        """Whether a bond that was sound is no longer."""
        if not rigid:
            return False
        u, r = relative(q, i, g, work, arrays), row(arrays[1], i)
        return not held(i, u, r, arrays[6], arrays[8], arrays[9])

    return _OfBond(begin, visit, settle, ask, slope, correct, give, bears, sound, opens)


@cache
def _whichever(kernels: tuple):
    """Kernel `do(number, groups, ...)`: that of a group's law, given what is the group's."""
    here = kernels[0]
    if len(kernels) == 1:

        @njit(**MERGED)
        def do_last(number, groups, q, e, g, work, i, *more):
            return here(groups[0], q, e, g, work, i, *more)

        return do_last
    others = _whichever(kernels[1:])

    @njit(**MERGED)
    def do(number, groups, q, e, g, work, i, *more):
        if number == 0:
            return here(groups[0], q, e, g, work, i, *more)
        return others(number - 1, groups[1:], q, e, g, work, i, *more)

    return do


@cache
def kernels_of_laws(laws: tuple[LawKernels, ...], dim: int):
    """What a vertex does with all its bonds, one after the other."""
    of_laws = [_kernels_of_bond(law, dim) for law in laws]
    whichever = _OfBond(*(_whichever(kernels) for kernels in zip(*of_laws, strict=True)))
    begin, visit, settle, ask, slope, correct, give, bears, sound, opens = whichever
    some_evolve = any(law.evolve is not None for law in laws)

    @njit(**MERGED)
    def begin_all(b, g, work, rows, step, groups, group_of):
        """Bonds that have not retired act between clusters; returns how many do."""
        first, count = g.bond_offsets[b], 0
        for q in range(first, g.bond_offsets[b + 1]):
            number, e = group_of[q], q - first
            apart = work.cluster[g.sides[q, 0]] != work.cluster[g.sides[q, 1]]
            work.active[e] = apart and number >= 0
            count += work.active[e]
            if number >= 0:
                begin(number, groups, q, e, g, work, rows[q], step)
        return count

    @njit(**MERGED)
    def sweep_all(b, g, work, rows, count, groups, group_of):
        """Visit active bonds; returns the largest change and the largest impulse."""
        first, worst, big = g.bond_offsets[b], 0.0, 0.0
        for q in range(first, g.bond_offsets[b + 1]):
            if work.active[q - first]:
                x, y = visit(group_of[q], groups, q, q - first, g, work, rows[q], count)
                worst, big = max(worst, x), max(big, y)
        return worst, big

    @njit(**MERGED)
    def settle_all(b, g, work, rows, groups, group_of):
        """Internal variables of active bonds follow; returns the largest relative change."""
        largest = 0.0
        if some_evolve:
            first = g.bond_offsets[b]
            for q in range(first, g.bond_offsets[b + 1]):
                if work.active[q - first]:
                    x = settle(group_of[q], groups, q, q - first, g, work, rows[q])
                    largest = max(largest, x)
        return largest

    @njit(**LEAN_INNER)
    def ask_all(b, g, work, rows, groups, group_of):
        """Residuals of active bonds; returns what `sweep_all` does."""
        first, worst, big = g.bond_offsets[b], 0.0, 0.0
        for q in range(first, g.bond_offsets[b + 1]):
            if work.active[q - first]:
                x, y = ask(group_of[q], groups, q, q - first, g, work, rows[q])
                worst, big = max(worst, x), max(big, y)
        return worst, big

    @njit(**LEAN_INNER)
    def slopes_all(b, g, work, rows, groups, group_of):
        """Slopes of active bonds where `ask_all` has asked them."""
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if work.active[q - first]:
                slope(group_of[q], groups, q, q - first, g, work, rows[q])

    @njit(**LEAN_INNER)
    def correct_all(b, g, work, rows, groups, group_of):
        """Change the impulses of active bonds by `flow`."""
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if work.active[q - first]:
                correct(group_of[q], groups, q, q - first, g, work, rows[q])

    @njit(**MERGED)
    def give_all(b, g, work, rows, groups, group_of, factor):
        """Add to the source of each corner what active bonds give it, times a factor."""
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if work.active[q - first]:
                give(group_of[q], groups, q, q - first, g, work, rows[q], factor)

    @njit(**MERGED)
    def bear_all(b, g, work, rows, step, tables, group_of):
        """Whether fused bonds bear their flows; `rows` are those of `tables`."""
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            if work.fused[q - first]:
                if not bears(group_of[q], tables, q, q - first, g, work, rows[q], step):
                    return False
        return True

    @njit(**MERGED)
    def find_fused(b, g, work, rows, groups, group_of):
        """Bonds that have never opened are fused."""
        first = g.bond_offsets[b]
        for q in range(first, g.bond_offsets[b + 1]):
            e = q - first
            work.fused[e] = False
            if group_of[q] >= 0:
                work.fused[e] = sound(group_of[q], groups, q, e, g, work, rows[q])

    @njit(**LEAN_INNER)
    def cut_all(b, g, work, rows, groups, group_of):
        """Fused bonds that have opened are no longer; returns how many."""
        first, count = g.bond_offsets[b], 0
        for q in range(first, g.bond_offsets[b + 1]):
            e = q - first
            if work.fused[e] and opens(group_of[q], groups, q, e, g, work, rows[q]):
                work.fused[e] = False
                count += 1
        return count

    return (
        begin_all, sweep_all, settle_all, ask_all, slopes_all, correct_all, give_all, bear_all,
        find_fused, cut_all,
    )  # fmt: skip
