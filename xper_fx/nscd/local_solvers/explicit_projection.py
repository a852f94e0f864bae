# SPDX-License-Identifier: LGPL-3.0-or-later
"""Explicit solution where normal and tangential directions are uncoupled (Renouf et al. 2004).

With W_NT = 0, Signorini's condition alone gives r_N = max(0, -b_N / W_NN), and friction is a
projection on a disc of known radius. In 3D, W_TT must moreover be W_t I: then u_T = b_T + W_t r_T
opposes r_T exactly when r_T is along -b_T, and

    r_T = -b_T / W_t, shortened to mu r_N if longer.

With two different tangential entries, even on the diagonal, the slip turns away from b_T and the
projection is wrong. Entries off this form are ignored: `explicit_applies` tells where it holds.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.algebra.small import SINGULAR
from xper_fx.nscd.local_solvers.interface import KERNEL, LocalSolver


def explicit_applies(w: np.ndarray) -> np.ndarray:
    """Where the explicit solver is exact, to 1e-12 of the trace.

    Args:
        w: shape (num_points, 3) in 2D, (num_points, 6) in 3D, packed compliances, m/s per N s.

    Returns:
        shape (num_points,), bool.
    """
    if w.shape[1] == 3:
        return np.abs(w[:, 1]) <= 1e-12 * (w[:, 0] + w[:, 2])
    wrong = np.abs(np.stack([w[:, 1], w[:, 2], w[:, 4], w[:, 3] - w[:, 5]])).max(axis=0)
    return wrong <= 1e-12 * (w[:, 0] + w[:, 3] + w[:, 5])


@KERNEL
def _prepare2(w, mu, factors, i):
    # a direction in which W vanishes carries no impulse
    factors[i, 0] = 1.0 / w[0] if w[0] > SINGULAR * w[2] else 0.0
    factors[i, 1] = 1.0 / w[2] if w[2] > SINGULAR * w[0] else 0.0


@KERNEL
def _solve2(b, w, factors, i, mu, r):
    if b[0] >= 0.0:
        return 0.0, 0.0
    normal = -b[0] * factors[i, 0]
    limit = mu * normal
    return normal, min(max(-b[1] * factors[i, 1], -limit), limit)


@KERNEL
def _prepare3(w, mu, factors, i):
    twice = w[3] + w[5]
    factors[i, 0] = 1.0 / w[0] if w[0] > SINGULAR * twice else 0.0
    factors[i, 1] = 2.0 / twice if twice > SINGULAR * w[0] else 0.0


@KERNEL
def _solve3(b, w, factors, i, mu, r):
    if b[0] >= 0.0:
        return 0.0, 0.0, 0.0
    normal = -b[0] * factors[i, 0]
    limit = mu * normal
    x, y = -b[1] * factors[i, 1], -b[2] * factors[i, 1]
    square = x * x + y * y
    if square > limit * limit:
        shorter = limit / np.sqrt(square)
        return normal, x * shorter, y * shorter
    return normal, x, y


EXPLICIT = {
    2: LocalSolver("explicit", 2, _prepare2, _solve2),
    3: LocalSolver("explicit", 2, _prepare3, _solve3),
}
