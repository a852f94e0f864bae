# SPDX-License-Identifier: LGPL-3.0-or-later
"""The damage of a cohesive zone as a function of its opening, and what it has dissipated."""

from __future__ import annotations

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY

# Columns of a cohesive zone's parameters and state.
C_N, C_T, D0, DC, BETA0, MU = range(6)
OPENING_MAX, DAMAGE = 0, 1


@njit(**LEAN_ENTRY)
def damage(x, d0, dc, beta0):
    """g(x): damage of a bond opened monotonically to x (m) (Perales et al. 2010, eq. 37)."""
    if x <= d0:
        return beta0
    if x >= dc:
        return 0.0
    y = (x - d0) / (dc - d0)
    return beta0 * d0 / x * (1.0 - y * y)


@njit(**LEAN_ENTRY)
def mean_damage(x1, x0, x_max, beta, d0, dc, beta0):
    """Mean of the damage over x^2 from x0 to x1 (m), for a bond that had reached x_max, beta.

    Up to x_max the bond unloads along its secant (beta); beyond, it follows g. No difference of
    nearly equal numbers is taken.
    """
    if x1 <= x_max or beta == 0.0:
        return beta
    start = max(x_max, d0, x0)  # below d0 the curve is still its secant
    if x1 <= start:
        return beta
    top = min(x1, dc)
    length = dc - d0
    spent = 0.0
    if top > start:
        y0, y1 = (start - d0) / length, (top - d0) / length
        spent = 2.0 * beta0 * d0 * (top - start) * (1.0 - (y1 * y1 + y1 * y0 + y0 * y0) / 3.0)
    secant = beta * (start - x0) * (start + x0)
    return (secant + spent) / ((x1 - x0) * (x1 + x0))


@njit(**LEAN_ENTRY)
def dissipated(x, d0, dc, beta0):
    """What a bond of unit stiffness has dissipated that was opened to x (m): m^2.

    The area under its curve less what it holds, int_0^x g s ds - g(x) x^2 / 2.
    """
    if x <= d0:
        return 0.0
    length = dc - d0
    y = min(x - d0, length) / length
    spent = beta0 * d0 * (0.5 * d0 + length * y * (1.0 - y * y / 3.0))
    return spent - 0.5 * damage(x, d0, dc, beta0) * x * x


def spent_share(parameters: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Share of the fracture energy that each bond has spent (`LawKernels.spent`)."""
    d0, length = parameters[:, D0], parameters[:, DC] - parameters[:, D0]
    y = np.clip((state[:, OPENING_MAX] - d0) / length, 0.0, 1.0)
    # in units of beta0 d0: area under the curve, less what the bond holds, over the whole area
    held = 0.5 * (d0 + length * y) * (1.0 - y * y)
    share = (0.5 * d0 + length * y * (1.0 - y * y / 3.0) - held) / (0.5 * d0 + length * 2.0 / 3.0)
    return np.where(state[:, DAMAGE] > 0.0, share, 1.0)
