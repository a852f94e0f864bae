# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integrals of smooth functions of the opening to rounding, whatever part of a curve is asked for.

An interval is cut into panels no longer than a given length, and each has Gauss's rule of ten
points: for a function of that length, as exp(-x / length), the error of a panel is below 1e-20 of
its integral. Integrals of parts then add up to that of the whole, so that a bond spends the same in
one step or in a thousand.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER

_NODES, _WEIGHTS = (tuple(values) for values in np.polynomial.legendre.leggauss(10))


@cache
def panel_sum(function):
    """The compiled integral `sum(a, b, length, p)` of a compiled `function(x, p)`."""

    @njit(**LEAN_INNER)
    def panels(a, b, length, p):
        count = max(1, int(np.ceil((b - a) / length)))
        half = 0.5 * (b - a) / count
        total = 0.0
        for k in range(count):
            middle = a + (2 * k + 1) * half
            for node, weight in zip(_NODES, _WEIGHTS):  # noqa: B905  not known to the compiler
                total += weight * function(middle + node * half, p)
        return half * total

    return panels
