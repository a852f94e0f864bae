# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loops of a law's step functions over the points of a group, compiled for each law."""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.couplings import Sides, point_velocity, prefetch
from xper_fx.nscd.kernel_options import LEAN_ENTRY, MERGED
from xper_fx.nscd.laws.law import LawKernels

# Points whose energies are added up for themselves: sums do not hang on the number of threads.
CHUNK = 1024
# Visits ahead at which velocities are asked for.
_AHEAD = 8
# Gap of facets that touch, but for rounding of what they have moved, relative to the width of the
# point's area.
_TOUCHING = 1e-10


@cache
def ending(law: LawKernels, sides: Sides):
    """Kernel that ends the step of point i of p, `PointArrays`.

    Its jump, `jump0` (m) at the start, has changed at the rate `mean` (m/s); `u` is the velocity at
    the end. Its energies are added to `sums`.
    """
    algebra = for_dimension(sides.dim, sides.components)
    row, set_row, add, scale = algebra.row, algebra.set_row, algebra.add, algebra.scale
    commit, energies = law.commit, len(law.energies)

    @njit(**MERGED)
    def end(i, jump0, mean, u, p, step, theta, sums):
        jump1, r = add(jump0, scale(step, mean)), row(p.impulse, i)
        p.status[i] = commit(
            i, jump0, jump1, u, r, p.area[i], step, theta, p.parameters,
            p.state, p.terms, p.details, p.energy,
        )  # fmt: skip
        set_row(p.jump, i, jump1)
        set_row(p.velocity, i, u)
        set_row(p.committed, i, r)
        for j in range(energies):
            sums[j] += p.energy[i, j]

    return end


@cache
def jump_to_prepare(law: LawKernels, dim: int, lever_arms: bool = False):
    """Kernel that gives the jump that a law's `prepare` takes for that of point i.

    Gaps of facets at which a law knows impacts, and no bond holds, count as smaller by what
    rounding may leave of zero: else it would decide which points of bodies that touch take an
    impact. Contacts of rigid bodies, with lever arms, may have an area of 1, which says nothing of
    a width.
    """
    algebra = for_dimension(dim, law.components)
    subtract, scale, power = algebra.subtract, algebra.scale, 1.0 / (dim - 1)
    normal = (_TOUCHING, 0.0, 0.0)[: law.components]
    may_touch = "pushed" in law.state_names and not lever_arms
    may_hold, holds = law.holds is not None, law.holds

    @njit(**MERGED)
    def touch(i, jump, area, parameters, state):
        if may_touch and not (may_hold and holds(i, parameters, state)):
            return subtract(jump, scale(area**power, normal))
        return jump

    return touch


@cache
def step_loops(law: LawKernels, sides: Sides):
    """The loops of a law's `prepare` and `commit` over ranges of the points p, `PointArrays`.

    The second goes over ranges of chunks, which have a row each in `sums`, for each of the law's
    energies (J; 2D: J/m).
    """
    read = point_velocity(sides)
    algebra = for_dimension(sides.dim, sides.components)
    row, set_row, add, scale = algebra.row, algebra.set_row, algebra.add, algebra.scale
    prepare, touch = law.prepare, jump_to_prepare(law, sides.dim, sides.lever_arms)
    end, energies = ending(law, sides), len(law.energies)
    may_rest = law.rigid is not None and law.rigid.rests is not None
    rests = law.rigid.rests if may_rest else None

    @njit(nogil=True, **LEAN_ENTRY)
    def prepare_range(first, last, p, step, theta):
        for i in range(first, last):
            jump = touch(i, row(p.jump, i), p.area[i], p.parameters, p.state)
            prepare(
                i, jump, row(p.velocity, i), p.compliance, p.area[i], step, theta,
                p.parameters, p.state, p.terms, p.details,
            )  # fmt: skip

    @njit(nogil=True, **LEAN_ENTRY)
    def commit_range(first, last, v, c, p, step, theta, sums):
        count = len(p.area)
        for chunk in range(first, last):
            for number in range(chunk * CHUNK, min((chunk + 1) * CHUNK, count)):
                i = np.uintp(number)
                prefetch(v, np.uintp(c.start[min(number + _AHEAD, count - 1), 0, 0]))
                if may_rest and rests(i, p.details):  # nothing moves on
                    p.status[i] = 1
                    set_row(p.committed, i, row(p.impulse, i))
                    for j in range(energies):
                        p.energy[i, j] = 0.0
                    continue
                jump0, u = row(p.jump, i), read(v, c, i)
                mean = add(scale(theta, u), scale(1.0 - theta, row(p.velocity, i)))
                end(i, jump0, mean, u, p, step, theta, sums[chunk])

    return prepare_range, commit_range


@cache
def evolve_loop(law: LawKernels, sides: Sides):
    """The loop of a law's `evolve` over a range of the points p, `PointArrays`."""
    read = point_velocity(sides)
    evolve = law.evolve

    @njit(nogil=True, **LEAN_ENTRY)
    def evolve_range(first, last, v, c, p):
        largest = least = 0.0
        for i in range(first, last):
            u = read(v, c, np.uintp(i))
            change = evolve(i, u, p.compliance, p.parameters, p.terms, p.details)
            largest, least = max(largest, change), min(least, change)
        return largest, -least

    return evolve_range
