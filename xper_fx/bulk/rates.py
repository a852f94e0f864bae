# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How a static state goes on along a path: which bonds open, and whether the load rises or falls.

A bond c at its largest opening so far softens where it opens on, and unloads along its secant where
it closes. With n_c the direction in which it opens, K_c its springs along the secant, and a_c the
impulse that it bears less for each opening of its lips, rates v of the unknowns and l of the load
obey

    (A + sum_c H_c K_c H_c^T) v = l f + sum_c H_c a_c g_c,     g_c = max(0, n_c . H_c^T v),

f what the load does. One solution for the load and one for each bond give the openings
x = l x0 + M g, and a linear complementarity problem (Bolzon, Maier and Tin-Loi 1997),

    g >= 0,    w = (I - M) g - l x0 >= 0,    g . w = 0,

for l = 1 and l = -1. Lemke's algorithm (Cottle, Pang and Stone 1992, section 4.4) finds a solution
or ends on a ray. From its end Newton's method begins with each bond on its branch, where from the
last increment or from rest two of them may take turns for ever. Of two solutions that one goes on
in which bonds open further for the same change of the load: in the other one they unload, on the
way back.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.point_group import PointGroup

# Part of its largest opening by which the branches of a bond are told apart.
_APART = 1e-4
# Entry of a column of Lemke's tableau, beside the largest, that counts as zero; pivots a bond.
_ZERO, _PIVOTS = 1e-12, 20


@cache
def _branch_kernel(law: LawKernels):
    """Kernel: changes of the impulse if the lips of some points move to and fro."""
    algebra, solve = for_dimension(law.components), law.solve
    row, set_row, subtract = algebra.row, algebra.set_row, algebra.subtract
    scale = algebra.scale

    @njit(nogil=True, **LEAN_ENTRY)
    def branches(which, moved, points, opened, closed):
        w, parameters, terms = points.compliance, points.parameters, points.terms
        for j in range(len(which)):
            i, u = which[j], row(moved, j)
            r = row(points.impulse, i)
            base, _ = solve(i, scale(0.0, u), r, w, parameters, terms, points.details)
            new, _ = solve(i, u, r, w, parameters, terms, points.details)
            set_row(opened, j, subtract(new, base))
            new, _ = solve(i, scale(-1.0, u), r, w, parameters, terms, points.details)
            set_row(closed, j, subtract(new, base))

    return branches


def fall_of_bonds(
    group: PointGroup, stiffness: np.ndarray, which: np.ndarray, openings: np.ndarray, scaled: float
) -> tuple[np.ndarray, np.ndarray]:
    """Directions n in which bonds open, and what they bear less, a (N s per m/s).

    Both of shape (m, components). Their springs become those of their secants.

    Args:
        group: after `begin_step`.
        stiffness: of all its points, on either branch; changed.
        which: bonds at their largest openings, shape (m,).
        openings: these, shape (m,), m.
        scaled: h theta (s).
    """
    direction = group.jump[which].copy()
    direction[:, 0] = np.maximum(direction[:, 0], 0.0)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    speed = (_APART * openings / scaled)[:, None]
    opened, closed = np.empty_like(direction), np.empty_like(direction)
    arrays = group.law_arrays()
    _branch_kernel(group.kernels)(which, speed * direction, arrays, opened, closed)
    falls = (opened + closed) / speed
    pulled = np.einsum("pij,pj->pi", stiffness[which], direction)
    off_curve = np.linalg.norm(pulled + opened / speed, axis=1)
    off_secant = np.linalg.norm(pulled - closed / speed, axis=1)
    softens = (off_curve < off_secant)[:, None, None]
    stiffness[which] += np.where(softens, falls[:, :, None] * direction[:, None, :], 0.0)
    return direction, falls


def rates_of_bonds(x0: np.ndarray, m: np.ndarray, lengths: np.ndarray) -> tuple | None:
    """The rate l of the load and the rates g at which bonds open; None if there are none.

    Args:
        x0, m: see the module, shapes (n,) and (n, n).
        lengths: by which bonds may open in a step, shape (n,), m: the first one does in unit time.
    """
    best = None
    for load in (1.0, -1.0):
        g = lemke(np.eye(len(x0)) - m, -load * x0)
        fastest = 0.0 if g is None else float((g / lengths).max())
        if fastest > 0.0 and (best is None or fastest > best[0]):
            best = fastest, load, g
    if best is None:
        return None
    fastest, load, g = best
    return load / fastest, g / fastest


def lemke(m: np.ndarray, q: np.ndarray) -> np.ndarray | None:
    """z >= 0 with w = M z + q >= 0 and z . w = 0; None where Lemke's algorithm ends on a ray.

    Args:
        m, q: shapes (n, n) and (n,).
    """
    n = len(q)
    scale = np.abs(q).max(initial=0.0)
    if not np.isfinite(scale) or not np.isfinite(m).all():
        return None
    if q.min(initial=0.0) >= 0.0:
        return np.zeros(n)
    # w - M z - z0 = q, of which z0 makes all right sides positive
    table = np.hstack([np.eye(n), -m, -np.ones((n, 1)), q[:, None] / scale])
    basic = np.arange(n)
    row, entering = int(np.argmin(q)), 2 * n
    for _ in range(_PIVOTS * n):
        left = int(basic[row])
        basic[row] = entering
        table[row] /= table[row, entering]
        column = table[:, entering].copy()
        column[row] = 0.0
        table -= np.outer(column, table[row])
        if left == 2 * n:
            z = np.zeros(2 * n + 1)
            z[basic] = scale * table[:, -1]
            return z[n:-1]
        entering = left + n if left < n else left - n
        column = table[:, entering]
        positive = column > _ZERO * np.abs(column).max()
        if not positive.any():
            return None
        ratios = np.full(n, np.inf)
        ratios[positive] = table[positive, -1] / column[positive]
        row = int(np.argmin(ratios))
        of_z0 = np.flatnonzero(basic == 2 * n)[0]
        if ratios[of_z0] <= ratios[row] + _ZERO * abs(ratios[row]):
            row = int(of_z0)
    return None
