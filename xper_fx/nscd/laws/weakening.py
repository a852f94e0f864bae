# SPDX-License-Identifier: LGPL-3.0-or-later
"""How a bond's openings weaken it: what kernels of bonds ask of a law beside its curve.

`Weakening` has compiled functions of a point i:

    shape(i, jump, parameters) -> p
        shape of the curve along the direction of a jump
    limit(i, parameters, state) -> x
        opening (m) up to which no jump weakens the bond further
    weakens(x, limit, share, p) -> bool
        whether an opening x (m) beyond that limit weakens the bond along the curve p
    reach(limit, share, p) -> x
        opening (m) from which the bond weakens along the curve p, `share` being what is left of its
        damage beside beta0

`effects` are those of the columns that it has among the parameters of a point, with their numbers;
and, of all points of a group, `spent(parameters, state)` (`LawKernels.spent`) and
`lengths(parameters) -> (d0, dc)`, m, of the curve that the growth of a load is measured by.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache

import numpy as np
from numba.cpython.unsafe.tuple import tuple_setitem

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions
from xper_fx.nscd.laws.damage_curve import (
    BETA0,
    DAMAGE,
    OPENING_MAX,
    damage_functions,
    shape_column,
)

Weakening = namedtuple("Weakening", "effects curve shape limit weakens reach spent lengths")


@cache
def take_columns(first: int, count: int):
    """The compiled function `take(i, array)`: columns of a row as a tuple."""
    zeros = (0.0,) * count
    if not count:
        return njit(**LEAN_INNER)(lambda i, array: ())

    @njit(**LEAN_INNER)
    def take(i, array):
        taken = zeros
        for j in range(count):
            taken = tuple_setitem(taken, j, array[i, first + j])
        return taken

    return take


@cache
def one_curve(curve: CurveFunctions, num_columns: int, friction: bool) -> Weakening:
    """A curve that is the same in all directions, with its shape in the parameters of a point."""
    first = shape_column(friction)
    take, dissipated = take_columns(first, num_columns), damage_functions(curve).dissipated

    @njit(inline="always")
    def shape(i, jump, parameters):
        return take(i, parameters)

    @njit(inline="always")
    def limit(i, parameters, state):
        return max(state[i, OPENING_MAX], parameters[i, first])

    @njit(inline="always")
    def weakens(x, limit, share, p):
        return x > max(limit, p[0])

    @njit(inline="always")
    def reach(limit, share, p):
        return max(limit, p[0])

    @njit(**LEAN_ENTRY)
    def spent_loop(parameters, state, share):
        for i in range(len(share)):
            if state[i, DAMAGE] > 0.0:
                p, beta0 = take(i, parameters), parameters[i, BETA0]
                lost = dissipated(state[i, OPENING_MAX], p, beta0)
                share[i] = lost / dissipated(p[1], p, beta0)

    def spent(parameters: np.ndarray, state: np.ndarray) -> np.ndarray:
        share = np.ones(len(state))
        spent_loop(parameters, state, share)
        return share

    def lengths(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return parameters[:, first], parameters[:, first + 1]

    effects = (("damage", num_columns),)
    return Weakening(effects, curve, shape, limit, weakens, reach, spent, lengths)


@cache
def falls_below(curve: CurveFunctions):
    """`weakens` of bonds whose history is their damage: where the curve is below what is left."""
    fall = curve.fall

    @njit(**LEAN_INNER)
    def weakens(x, limit, share, p):
        return x >= p[1] or (x > p[0] and fall(x, p) < share)

    return weakens
