# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear complementarity problem (Stewart & Trinkle 1996), by Lemke's pivoting.

Coulomb's disc is replaced by a polygon inscribed in it, with m vertices d_j (unit vectors, angles
2 pi j / m from t1): r_T = D beta with beta >= 0, sum(beta) <= mu r_N. Maximal dissipation on the
polygon, with multiplier lambda (the slip speed, m/s), gives for z = (r_N, beta, lambda)

    u_N   = b_N + W_NN r_N + W_NT D beta                          >= 0  _|_  r_N    >= 0
    sigma = D^T b_T + D^T W_TN r_N + D^T W_TT D beta + lambda 1   >= 0  _|_  beta   >= 0
    zeta  = mu r_N - 1^T beta                                     >= 0  _|_  lambda >= 0

a problem q + M z of m + 2 unknowns; M is copositive, so that Lemke's algorithm ends with a
solution unless degenerate ties make it cycle. In 2D the two directions -1 and +1 are the whole
"polygon": 4 unknowns, exact.

In 3D it is exact where the point opens, where it sticks inside the polygon, and where it slips
against a vertex. Elsewhere the polygon's vertices attract: the direction of slipping friction is
wrong by up to pi / m, and with it the impulse by O(1/m). What friction lacks in length, and in
power at a given slip, goes with the cosine of that angle: O(1/m^2). `faceting_error` measures them.

The pivots run in a tableau kept in the point's own factors: about (m + 2)^2 floats a point, 1.2 kB
for m = 8. What the final basis tells (open, stick, the one or two vertices loaded) is solved again
in closed form, so that rounding does not add up over pivots. After `_PIVOTS` per unknown, or with
no row to pivot on, or singular W, the sure solver answers (`graph`, `exact`).
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.nscd.local_solvers import exact, graph
from xper_fx.nscd.local_solvers.interface import INLINE_KERNEL, KERNEL, LocalSolver

# Pivots per unknown: they are about one and a half.
_PIVOTS = 6
# Relative size below which an entry of the tableau is rounding.
_ROUNDING = 1e-11
# What counts as a tie between z0 and another variable, relative to the impulses.
_TIE = 1e-11


@INLINE_KERNEL
def _in_3d(b, w):
    """A 2D problem as one whose second tangential direction is never used."""
    return (b[0], b[1], 0.0), (w[0], w[1], 0.0, w[2], 0.0, 0.0)


@INLINE_KERNEL
def _as_is(b, w):
    return b, w


@INLINE_KERNEL
def _first_two(x):
    return x[0], x[1]


@INLINE_KERNEL
def _all(x):
    return x


@INLINE_KERNEL
def _pivot(t, i, first, n, row, column):
    """Exchange a basic and a nonbasic variable in the dictionary at t[i, first:].

    n rows of n + 2: constant, n + 1 nonbasic variables.
    """
    width = n + 2
    line = first + row * width
    inverse = 1.0 / t[i, line + column]
    for j in range(width):
        t[i, line + j] *= -inverse
    t[i, line + column] = inverse
    for other in range(n):
        if other != row:
            start = first + other * width
            factor = t[i, start + column]
            if factor != 0.0:
                for j in range(width):
                    t[i, start + j] += factor * t[i, line + j]
                t[i, start + column] = factor * inverse


@INLINE_KERNEL
def _lemke(t, i, first, n):
    """Lemke's algorithm on the dictionary w = q + M z + d z0 at t[i, first:].

    After it the labels of the basic variables: w_k is k, z_k is n + k, z0 is 2 n; then those of the
    nonbasic ones. Returns the number of pivots, negative on failure.
    """
    width = n + 2
    basic = first + n * width
    nonbasic = basic + n
    for k in range(n):
        t[i, basic + k] = k
        t[i, nonbasic + k] = n + k
    t[i, nonbasic + n] = 2 * n
    row, least = -1, 0.0
    for k in range(n):
        ratio = t[i, first + k * width] / t[i, first + k * width + n + 1]
        if ratio < least:
            row, least = k, ratio
    if row < 0:
        return 0
    column = n  # of z0, among the nonbasic
    for count in range(1, _PIVOTS * n + 1):
        _pivot(t, i, first, n, row, column + 1)
        left, entered = t[i, basic + row], t[i, nonbasic + column]
        t[i, basic + row], t[i, nonbasic + column] = entered, left
        if left == 2 * n:
            return count
        complement = left + n if left < n else left - n
        column = -1
        for k in range(n + 1):
            if t[i, nonbasic + k] == complement:
                column = k
        row, least, end, leave = -1, np.inf, -1, np.inf
        for k in range(n):
            entry = t[i, first + k * width + column + 1]
            if entry < -_ROUNDING:
                ratio = -max(t[i, first + k * width], 0.0) / entry
                if ratio < least:
                    row, least = k, ratio
                if t[i, basic + k] == 2 * n:
                    end, leave = k, ratio
        # z0 leaves as soon as it can: when sticking, every sigma vanishes together with it
        if leave <= least * (1.0 + _TIE) + _TIE:
            row = end
        if row < 0 or column < 0:
            return -count
    return -_PIVOTS * n - 1


@cache
def kernels(dim: int, facets: int):
    """Kernels `(num_factors, prepare, solve, solve_and_count)`.

    `solve_and_count(b, w, factors, i, mu, r) -> r, pivots`, negative where the sure solver did it.
    """
    sure, unpack, pack = (graph, _in_3d, _first_two) if dim == 2 else (exact, _as_is, _all)
    sure_prepare, sure_solve, first = sure.prepare, sure.solve, sure.NUM_FACTORS
    flag = 2 if dim == 2 else 4  # 0 in the sure solver's factors where W is singular
    n = facets + 2
    width = n + 2
    num_factors = first + n * width + 2 * n + 1
    angles = 2.0 * np.pi * np.arange(facets) / facets
    cosines, sines = np.cos(angles), np.sin(angles) * (dim == 3)

    @INLINE_KERNEL
    def fill(b, w, t, i, mu, size):
        """q, M and the covering column, in impulses of the size of `size`."""
        inverse = 1.0 / w[0]
        push = inverse / size
        w1, w2 = w[1] * inverse, w[2] * inverse
        s11, s12, s22 = w[3] * inverse, w[4] * inverse, w[5] * inverse
        last = first + (n - 1) * width
        t[i, first], t[i, first + 1] = push * b[0], 1.0
        t[i, first + n], t[i, last + n] = 0.0, 0.0
        t[i, last], t[i, last + 1] = 0.0, mu
        for j in range(facets):
            line = first + (j + 1) * width
            x, y = cosines[j], sines[j]
            t[i, first + 2 + j] = w1 * x + w2 * y
            t[i, last + 2 + j] = -1.0
            t[i, line] = push * (b[1] * x + b[2] * y)
            t[i, line + 1] = w1 * x + w2 * y
            t[i, line + n] = 1.0
            sx, sy = s11 * x + s12 * y, s12 * x + s22 * y
            for k in range(facets):
                t[i, line + 2 + k] = sx * cosines[k] + sy * sines[k]
        for k in range(n):  # uneven, against ties
            t[i, first + k * width + n + 1] = 1.0 + 0.01 * k

    @INLINE_KERNEL
    def from_basis(b, w, t, i, mu):
        """The impulse of the final basis."""
        basic = first + n * width
        closed, sliding, loaded, one, two = False, False, 0, 0, 0
        for k in range(n):
            label = int(t[i, basic + k]) - n
            if label == 0:
                closed = True
            elif label == n - 1:
                sliding = True
            elif 0 < label < n - 1 and t[i, first + k * width] > 0.0:
                loaded += 1
                one, two = label - 1, one
        inverse = 1.0 / w[0]
        push = -b[0] * inverse
        if not closed:
            return (0.0, 0.0, 0.0), True
        c1, c2 = w[1] * inverse, w[2] * inverse
        if loaded == 0:
            return (push, 0.0, 0.0), True
        x, y = cosines[one], sines[one]
        if sliding and loaded == 1:
            r_n = push / (1.0 + mu * (c1 * x + c2 * y))
            return (r_n, mu * r_n * x, mu * r_n * y), True
        g1, g2 = b[1] - c1 * b[0], b[2] - c2 * b[0]
        s11, s12, s22 = w[3] - w[1] * c1, w[4] - w[1] * c2, w[5] - w[2] * c2
        if not sliding:
            if dim == 2 or loaded == 1:
                along = -(g1 * x + g2 * y) / (x * (s11 * x + s12 * y) + y * (s12 * x + s22 * y))
                r1, r2 = along * x, along * y
            else:
                inverse = -1.0 / (s11 * s22 - s12 * s12)
                r1, r2 = inverse * (s22 * g1 - s12 * g2), inverse * (s11 * g2 - s12 * g1)
            return (push - c1 * r1 - c2 * r2, r1, r2), True
        # Two vertices: r_T = mu r_N d + a e along the side e, where e.u_T = 0 and u_N = 0.
        e1, e2 = cosines[two] - x, sines[two] - y
        # r_N = from_push + a from_side
        lever = 1.0 / (1.0 + mu * (c1 * x + c2 * y))
        from_push, from_side = push * lever, -(c1 * e1 + c2 * e2) * lever
        f1, f2 = e1 * s11 + e2 * s12, e1 * s12 + e2 * s22
        toward = mu * (f1 * x + f2 * y)
        a = -(e1 * g1 + e2 * g2 + toward * from_push) / (f1 * e1 + f2 * e2 + toward * from_side)
        r_n = from_push + a * from_side
        return (r_n, mu * r_n * x + a * e1, mu * r_n * y + a * e2), loaded == 2

    @KERNEL
    def prepare(w, mu, factors, i):
        sure_prepare(w, mu, factors, i)

    @INLINE_KERNEL
    def solve_and_count(b, w, factors, i, mu, r):
        if b[0] >= 0.0 or factors[i, flag] == 0.0 or mu == 0.0:
            return sure_solve(b, w, factors, i, mu, r), 0
        b3, w3 = unpack(b, w)
        size = (abs(b3[0]) + abs(b3[1]) + abs(b3[2])) / w3[0]
        fill(b3, w3, factors, i, mu, size)
        pivots = _lemke(factors, i, first, n)
        if pivots > 0:
            found, sure_of_it = from_basis(b3, w3, factors, i, mu)
            finite = abs(found[0]) + abs(found[1]) + abs(found[2]) < np.inf
            if sure_of_it and finite and found[0] > 0.0:
                return pack(found), pivots
        return sure_solve(b, w, factors, i, mu, r), -1 - abs(pivots)

    @INLINE_KERNEL
    def solve(b, w, factors, i, mu, r):
        if b[0] >= 0.0:
            return pack((0.0, 0.0, 0.0))
        r, _ = solve_and_count(b, w, factors, i, mu, r)
        return r

    return num_factors, prepare, solve, solve_and_count


def lcp_solver(dim: int, facets: int | None = None) -> LocalSolver:
    """The LCP solver.

    Args:
        dim: 2 or 3.
        facets: vertices of the polygon, at least 3; 8 unless told. Even numbers hold a direction
            and its opposite, multiples of 4 both axes. In 2D there are 2, and nothing to choose.

    Raises:
        ValueError: fewer than 3 facets, or facets in 2D.
    """
    if dim == 2:
        if facets not in (None, 2):
            raise ValueError(f"In 2D the cone has two sides: leave out facets, got {facets}.")
        facets = 2
    elif facets is None:
        facets = 8
    elif facets < 3:
        raise ValueError(f"A polygon has at least 3 facets, got {facets}.")
    num_factors, prepare, solve, _ = kernels(dim, facets)
    return LocalSolver("lcp", num_factors, prepare, solve)


def faceting_error(facets: int, samples: int = 360) -> tuple[float, float, float]:
    """Largest errors of the faceted cone over all directions of approach, slipping.

    Friction is 0.3, the compliance couples the normal and both tangents.

    Args:
        facets: vertices of the polygon.
        samples: directions of b_T, with |b_T| = 5 m/s and b_N = -1 m/s.

    Returns:
        Three numbers: of the impulse, |r - r_exact| / |r_exact|, O(1/m); of the friction power at
        the slip found, 1 + r_T . u_T / (mu r_N |u_T|), and of the length, 1 - |r_T| / (mu r_N),
        both O(1/m^2).
    """
    mu, w = 0.3, (1.0, 0.1, 0.0, 1.5, 0.2, 0.8)
    faceted, sure = lcp_solver(3, facets), exact.EXACT
    work, factors = np.zeros((1, faceted.num_factors)), np.zeros((1, sure.num_factors))
    faceted.prepare(w, mu, work, 0)
    sure.prepare(w, mu, factors, 0)
    none = (0.0, 0.0, 0.0)
    full = np.array([[w[0], w[1], w[2]], [w[1], w[3], w[4]], [w[2], w[4], w[5]]])
    impulse, power, length = 0.0, 0.0, 0.0
    for angle in 2.0 * np.pi * (np.arange(samples) + 0.5) / samples:
        b = (-1.0, 5.0 * np.cos(angle), 5.0 * np.sin(angle))
        r = np.array(faceted.solve(b, w, work, 0, mu, none))
        expected = np.array(sure.solve(b, w, factors, 0, mu, none))
        slip, limit = (b + full @ r)[1:], mu * r[0]
        impulse = max(impulse, np.linalg.norm(r - expected) / np.linalg.norm(expected))
        power = max(power, 1.0 + r[1:] @ slip / (limit * np.linalg.norm(slip)))
        length = max(length, 1.0 - np.linalg.norm(r[1:]) / limit)
    return impulse, power, length
