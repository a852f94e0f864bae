# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integrals of smooth functions of the opening to rounding, whatever part of a curve is asked for.

An interval is cut into panels no longer than a given length, and each has Gauss's rule of ten
points: for a function of that length, as exp(-x / length), the error of a panel is below 1e-20 of
its integral. Integrals of parts then add up to that of the whole, so that a bond spends the same in
one step or in a thousand. Short intervals, as the opening of a step mostly is, have four points up
to a tenth of the length and six up to half of it: their error is below 1e-17.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER

_POINTS = 10
# The same of intervals shorter than a share of the length.
_FEW, _SHORT = 4, 0.1
_SOME, _HALF = 6, 0.5


@cache
def gauss_sum(function, points: int):
    """The compiled integral `sum(a, b, p)` of a compiled `function(x, p)` by Gauss's rule."""
    nodes, weights = (tuple(values) for values in np.polynomial.legendre.leggauss(points))

    @njit(**LEAN_INNER)
    def integral(a, b, p):
        middle, half, total = 0.5 * (a + b), 0.5 * (b - a), 0.0
        for node, weight in zip(nodes, weights):  # noqa: B905  not known to the compiler
            total += weight * function(middle + node * half, p)
        return half * total

    return integral


@cache
def panel_sum(function):
    """The compiled integral `sum(a, b, length, p)` of a compiled `function(x, p)` by panels."""
    on_panel, on_half, on_part = (gauss_sum(function, n) for n in (_POINTS, _SOME, _FEW))

    @njit(**LEAN_INNER)
    def panels(a, b, length, p):
        if b - a < _SHORT * length:
            return on_part(a, b, p)
        if b - a < _HALF * length:
            return on_half(a, b, p)
        count = max(1, int(np.ceil((b - a) / length)))
        width, total = (b - a) / count, 0.0
        for k in range(count):
            total += on_panel(a + k * width, a + (k + 1) * width, p)
        return total

    return panels
