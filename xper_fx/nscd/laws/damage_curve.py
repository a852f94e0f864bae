# SPDX-License-Identifier: LGPL-3.0-or-later
"""The damage of a bond over a step, and what it has dissipated, for any curve of `curves/`."""

from __future__ import annotations

from collections import namedtuple
from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, MERGED
from xper_fx.nscd.laws.curves.curve import CurveFunctions

# Columns of a bond's parameters and state; mu is there with friction alone, and the shape of the
# curve, d0 and dc first, comes after it.
C_N, C_T, BETA0, MU = range(4)
OPENING_MAX, DAMAGE = 0, 1

# Iterations for an opening, and what counts as none left.
_ITERATIONS = 60
_ROUNDING = 1e-15

DamageFunctions = namedtuple("DamageFunctions", "damage mean_damage dissipated opening_with")


def shape_column(friction: bool) -> int:
    """The first column of the shape of a bond's curve among its parameters."""
    return MU + 1 if friction else MU


@njit(**MERGED)
def stiffness_along(jump, c_n, c_t):
    """C_N cos^2 + C_T sin^2 of the direction of a jump; lips that are pressed slide (Pa/m)."""
    normal, tangential = max(jump[0], 0.0) ** 2, 0.0
    for part in jump[1:]:
        tangential += part * part
    both = normal + tangential
    return c_t + (c_n - c_t) * (normal / both) if both > 0.0 else c_t


@cache
def damage_functions(curve: CurveFunctions) -> DamageFunctions:
    """The compiled functions of a curve."""
    fall, area, opening = curve

    @njit(**LEAN_ENTRY)
    def damage(x, p, beta0):
        """Damage of a bond opened monotonically to x (m)."""
        if x <= p[0]:
            return beta0
        return 0.0 if x >= p[1] else beta0 * fall(x, p)

    @njit(**LEAN_ENTRY)
    def mean_damage(x1, x0, x_max, beta, p, beta0):
        """Mean of the damage over x^2 from x0 to x1 (m), for a bond that had reached x_max, beta.

        Up to x_max the bond unloads along its secant (beta); beyond, it follows its curve. No
        difference of nearly equal numbers is taken.
        """
        if x1 <= x_max or beta == 0.0:
            return beta
        reached = max(x_max, p[0])  # below d0 the curve is still its secant
        start = max(reached, x0)
        if x1 <= start:
            return beta
        top, spent = min(x1, p[1]), 0.0
        if top > start:
            left = beta / beta0 if start == reached else fall(start, p)
            spent = 2.0 * beta0 * area(start, top, left, p)
        secant = beta * (start - x0) * (start + x0)
        return (secant + spent) / ((x1 - x0) * (x1 + x0))

    @njit(**LEAN_ENTRY)
    def dissipated(x, p, beta0):
        """What a bond of unit stiffness has dissipated that was opened to x (m): m^2.

        The area under its curve less what it holds, int_0^x g s ds - g(x) x^2 / 2.
        """
        if x <= p[0]:
            return 0.0
        top = min(x, p[1])
        spent = beta0 * (0.5 * p[0] * p[0] + area(p[0], top, 1.0, p))
        return spent - 0.5 * damage(x, p, beta0) * x * x

    @njit(**LEAN_ENTRY)
    def opening_with(share, p):
        """The opening (m) at which g has fallen to a share, for d0 > 0; d0 of 1, dc of 0."""
        low, high = p[0], p[1]
        above, below = low * (1.0 - share), high * (fall(high, p) - share)
        if above <= 0.0:
            return low
        if below >= 0.0:
            return high
        # regula falsi on x (g - share), which is straight where the traction is (Illinois' rule)
        side = 0
        for _ in range(_ITERATIONS):
            x = (low * below - high * above) / (below - above)
            left = x * (fall(x, p) - share)
            if left > 0.0:
                low, above = x, left
                below *= 0.5 if side == 1 else 1.0
                side = 1
            else:
                high, below = x, left
                above *= 0.5 if side == -1 else 1.0
                side = -1
            if abs(left) <= _ROUNDING * share * x or high - low <= _ROUNDING * high:
                return x
        return x

    return DamageFunctions(damage, mean_damage, dissipated, opening or opening_with)
