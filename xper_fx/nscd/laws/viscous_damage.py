# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Damage that lags behind its curve, as adhesion with viscosity does.

With the intensity of adhesion a = sqrt(beta) and the energy e = <U>.C.<U> / 2 of a sound bond with
the present jump, that of Raous, Cangemi and Cocou 1999 (their beta is a) obeys

    b da/dt = -<2 a e - w>+,

w being what adhesion costs. Here the curve says what it costs: with e_c(beta) the energy e at which
the curve, in the direction of the jump, has the damage beta,

    b da/dt = -F,    F = 2 a <e - e_c(beta)>+,

for any curve of `curves/` (theirs is w = 2 a e_c, `adhesion.py`). b (J s/m^2) is the viscosity;
without it damage follows the curve, and nothing of this module is compiled.

**Over a step** h, from a0 with the energy e0 to a1 with e1,

    b (a0 - a1) / h = (1 - m) F(a0, e0) + m F(a1, e1),
    m = 1 / (1 - exp(-n)) - 1 / n,    n = 2 max(e0, e1) h / b.

The weight m, from 1/2 in short steps to 1 in long ones, makes what is linear with a constant e
exact (Liniger and Willoughby 1970): the error is of second order, and for b -> 0, or h -> infinity,
beta1 is on the curve. Of a step with e0 < e_c(beta0) h is the part in which e is above, e changing
in proportion to time, and F = 0 at the start of that part. With openings x, e = k x^2 / 2, k the
stiffness in the direction of the jump, x_c the opening of a damage on the curve and q = b / (h k),
the solution is the root of

    m (x_c^2 - x1^2) a(x_c) + q (a0 - a(x_c)) - (1 - m) a0 <x0^2 - x_c0^2>+

between x_c0 and max(x0, x1), or the latter if there is none, found by regula falsi. Damage weighs
alike in the mean of the step, beta_m = m beta1 + (1 - m) beta0, and is beta0 before that part.

**What it dissipates.** Let D(beta) be the area between the curve and its secant, dD = -e_c dbeta:
what the damage costs without viscosity. By `cohesive_zone.py` a step loses

    L = (beta0 - beta1) e0 + (beta_m - beta1) (e1 - e0)    for beta1 <= beta_m <= beta0,

besides what theta > 1/2 damps. As e_c rises while beta falls and x_c <= max(x0, x1),

    0 <= D(beta1) - D(beta0) <= (beta0 - beta1) e_c(beta1) <= (beta0 - beta1) max(e0, e1),

and the right side is the L of beta_m = beta0 (e1 > e0) or of beta1 (e1 < e0). So there is always a
beta_m between, with which L is D(beta1) - D(beta0): beta_m is moved to it where it would lose less.
Whatever the path, its mixture of modes, h and theta, a step then spends D(beta1) - D(beta0) >= 0 of
the fracture energy, and the rest of L is viscous work, never negative. For b -> 0 beta_m is the
mean of `cohesive_zone.py`, so that a bond that opens spends its area at any step.

A bond that is worn to `_NOTHING` beyond the end of its curve is broken, as a falls exponentially.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions

# Share of its stiffness below which nothing is left of a bond.
_NOTHING = 1e-8
# Below it the weight is its series.
_SHORT = 1e-2
# Iterations for an opening, and what counts as none left.
_ITERATIONS = 60
_ROUNDING = 1e-15

LaggingDamage = namedtuple("LaggingDamage", "followed mean")


@njit(**LEAN_INNER)
def _weight(n):
    """m, of a step of n relaxation times."""
    return 0.5 + n / 12.0 if n < _SHORT else -1.0 / np.expm1(-n) - 1.0 / n


@cache
def lagging_damage(curve: CurveFunctions) -> LaggingDamage:
    """The compiled functions of a curve.

    followed(x0, x1, x_max, share, q, p) -> x_c, m
        opening (m) at which the curve p has the damage of the end of a step, and what that damage
        weighs in the mean
    mean(x0, x1, x_max, x_c, old, new, m, p, beta0) -> beta_m
        its mean damage

    with the openings x0, x1 (m) at both ends, x_max that of the damage `old` at the start on the
    curve, `share` what is left of it beside beta0, and q = b / (h k) (m^2).
    """
    fall, area = curve.fall, curve.area

    @njit(**LEAN_INNER)
    def left(x, p):
        return np.sqrt(max(fall(x, p), 0.0))

    @njit(**LEAN_ENTRY)
    def followed(x0, x1, x_max, share, q, p):
        far, start = max(x0, x1), np.sqrt(share)
        if far <= x_max:
            return x_max, 1.0
        part = 1.0  # of the step above the threshold
        if x0 < x_max:
            part = (x1 - x_max) * (x1 + x_max) / ((x1 - x0) * (x1 + x0))
            q /= part
        m = _weight(far * far / q) if q > 0.0 else 1.0
        pulled = (1.0 - m) * max(x0 - x_max, 0.0) * (x0 + x_max)
        below = -start * (m * (x1 - x_max) * (x1 + x_max) + pulled)
        if below >= 0.0:
            return x_max, m * part
        # m (y - target) a + lag = 0 in y = x_c^2
        target, lag = x1 * x1 + q / m, start * (q - pulled)
        low, high = x_max * x_max, min(far, p[1]) ** 2
        above = m * (high - target) * left(np.sqrt(high), p) + lag
        if above <= 0.0:
            return min(far, p[1]), m * part
        side, x = 0, x_max
        for _ in range(_ITERATIONS):
            y = (low * above - high * below) / (above - below)
            x = np.sqrt(y)
            value = m * (y - target) * left(x, p) + lag
            if value < 0.0:
                low, below = y, value
                above *= 0.5 if side == 1 else 1.0
                side = 1
            else:
                high, above = y, value
                below *= 0.5 if side == -1 else 1.0
                side = -1
            if abs(value) <= _ROUNDING * start * target or high - low <= _ROUNDING * high:
                break
        return (p[1] if far >= p[1] and fall(x, p) <= _NOTHING else x), m * part

    @njit(**LEAN_ENTRY)
    def mean(x0, x1, x_max, x_c, old, new, m, p, beta0):
        beta, long = m * new + (1.0 - m) * old, (x1 - x0) * (x1 + x0)
        # of a step that spends D(beta1) - D(beta0) alone
        spent = old * (x_max - x0) * (x_max + x0)
        spent += 2.0 * beta0 * area(x_max, x_c, old / beta0, p)
        spent += new * (x1 - x_c) * (x1 + x_c)
        if long > 0.0:
            beta = max(beta, spent / long)
        elif long < 0.0:
            beta = min(beta, spent / long)
        return max(new, min(old, beta))

    return LaggingDamage(followed, mean)
