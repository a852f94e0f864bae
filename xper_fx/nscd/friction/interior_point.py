# SPDX-License-Identifier: LGPL-3.0-or-later
"""Primal-dual interior point for the whole problem: hyperstatic systems do not stall it.

In the coordinates x = (mu r_N, r_T), z = (u~_N / mu, u_T) the Coulomb cone and its dual are both
the second-order cone L = {x_0 >= |x_T|}, and Signorini-Coulomb in de Saxce's form reads

    z = W' x + q' + |z_T| e_0,   x in L,   z in L,   x . z = 0.

Newton's method follows x o z = s e (o the Jordan product of L, s -> 0) after the scaling of
Nesterov and Todd, which maps x and z on the same vector lambda; |z_T| is linearised along with the
rest, as Acary, Armand, Nguyen and Shpakovych do (Second-order cone programming for frictional
contact mechanics using interior point algorithm, 2023). With Theta the inverse square of the
scaling, d = z_T / |z_T| and C = I - e_0 d^T, each iteration solves

    (W' + C Theta) dx = C g - residual,     dz = g - Theta dx,

twice with one factorisation: g = -z predicts, and with the dx and dz of this
g = -z + S^-1 (lambda \\ (s e - dx o dz)) corrects, as Mehrotra does. Theta is positive definite,
so that W may have any rank, and iterations hardly depend on the size. At contacts neither closing
nor parting (x = z = 0) the natural map is only of the size of sqrt(s): rounding ends the descent at
some 1e-6 or 1e-7, from where Newton steps finish.

Without friction L has no inside; such contacts get mu = 1e-10 here.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.friction.blocks import BlockProblem
from xper_fx.nscd.friction.error import natural_map
from xper_fx.nscd.friction.sparse_system import SparseSystem
from xper_fx.nscd.halo_protocol import Reductions

LEAST_FRICTION = 1e-10
_MAX_ITERATIONS = 60
# Fraction of the way to the boundary of the cones.
_TO_BOUNDARY = 0.99
# Steps shorter than this, or complementarity below this of its first value, end the descent.
_SHORTEST, _ROUNDING = 1e-3, 1e-18
# What the eigenvalues of x o z are brought between, in units of the centre's: this and its inverse.
_LEAST_SHARE = 0.2
TINY = np.finfo(float).tiny


class _Alone:
    """The reductions of points that are all here."""

    comm = None
    sum = max = all = staticmethod(lambda value: value)


ALONE: Reductions = _Alone()


class ConeKernels(NamedTuple):
    """Kernels over points with x and z in the cones, shape (n, dim)."""

    size_t: Callable  #: `size_t(x, a)`, |x_T| of point a
    #: `scale(x, z, a, scaling)` sets the unit scaling point and its factor eta, dim + 1 numbers
    scale: Callable
    #: `longest(x, z, dx, dz)`, the largest step that keeps x + step dx and z + step dz in the cones
    longest: Callable
    to_dz: Callable  #: `to_dz(scaling, g, dx, dz)` sets dz = g - Theta dx
    reach: Callable  #: `reach(x, z, dx, dz, step)`, x . z after a step.
    #: `correct(scaling, x, z, dx, dz, centre, residual, g, rhs)` takes dx and dz of the predictor,
    #: and sets g and the right-hand side of the corrector for x o z = centre e
    correct: Callable
    #: `recentre(scaling, x, z, dx, dz, step, centre, g)` changes g for a longer step
    recentre: Callable
    advance: Callable  #: `advance(x, z, dx, dz, step)` goes so far


@cache
def cone_kernels(dim: int) -> ConeKernels:
    """What any interior point in these cones is made of."""

    @njit(inline="always")
    def size_t(x, a):
        total = 0.0
        for i in range(1, dim):
            total += x[a, i] * x[a, i]
        return np.sqrt(total)

    @njit(inline="always")
    def determinant(x, a):
        t = size_t(x, a)
        return max((x[a, 0] - t) * (x[a, 0] + t), TINY)

    @njit(inline="always")
    def scale(x, z, a, scaling):  # Nesterov-Todd
        dx, dz = np.sqrt(determinant(x, a)), np.sqrt(determinant(z, a))
        product = 1.0
        for i in range(dim):
            product += x[a, i] * z[a, i] / (dx * dz)
        half = 0.5 / np.sqrt(0.5 * product)
        scaling[a, 0] = (x[a, 0] / dx + z[a, 0] / dz) * half
        for i in range(1, dim):
            scaling[a, i] = (x[a, i] / dx - z[a, i] / dz) * half
        scaling[a, dim] = np.sqrt(dx / dz)

    @njit(error_model="numpy")
    def longest_in(x, dx):
        """Largest step that keeps x + step dx in its cones."""
        step = np.inf
        for a in range(len(x)):
            square, cross = dx[a, 0] * dx[a, 0], x[a, 0] * dx[a, 0]
            for i in range(1, dim):
                square -= dx[a, i] * dx[a, i]
                cross -= x[a, i] * dx[a, i]
            constant = determinant(x, a)
            discriminant = cross * cross - square * constant
            if discriminant > 0.0:
                root = np.sqrt(discriminant)
                if cross < 0.0:
                    step = min(step, constant / (root - cross))
                elif square < 0.0:
                    step = min(step, (-cross - root) / square)
            if dx[a, 0] < 0.0:
                step = min(step, -x[a, 0] / dx[a, 0])
        return step

    @njit(error_model="numpy")
    def longest(x, z, dx, dz):
        return min(longest_in(x, dx), longest_in(z, dz))

    @njit(error_model="numpy")
    def reach(x, z, dx, dz, step):
        reached = 0.0
        for a in range(len(x)):
            for i in range(dim):
                reached += (x[a, i] + step * dx[a, i]) * (z[a, i] + step * dz[a, i])
        return reached

    @njit(inline="always")
    def unscale(scaling, a, vector, out, inverse):
        """out = S vector, or S^-1 vector: S = eta [[w0, w^T], [w, I + w w^T / (1 + w0)]]."""
        sign = -1.0 if inverse else 1.0
        factor = 1.0 / scaling[a, dim] if inverse else scaling[a, dim]
        along = 0.0
        for i in range(1, dim):
            along += scaling[a, i] * vector[i]
        out[0] = factor * (scaling[a, 0] * vector[0] + sign * along)
        common = sign * vector[0] + along / (1.0 + scaling[a, 0])
        for i in range(1, dim):
            out[i] = factor * (vector[i] + scaling[a, i] * common)

    @njit(inline="always")
    def multiply(p, s, out):
        """out = p o s."""
        out[0] = p[0] * s[0]
        for i in range(1, dim):
            out[0] += p[i] * s[i]
            out[i] = p[0] * s[i] + s[0] * p[i]

    @njit(inline="always")
    def divide(lam, c):
        """c = lam \\ c, which is lam o c = c for the c of before."""
        inner, square = 0.0, 0.0
        for i in range(1, dim):
            inner += lam[i] * c[i]
            square += lam[i] * lam[i]
        size = np.sqrt(square)
        first = (lam[0] * c[0] - inner) / max((lam[0] - size) * (lam[0] + size), TINY)
        for i in range(1, dim):
            c[i] = (c[i] - lam[i] * first) / lam[0]
        c[0] = first

    @njit(error_model="numpy")
    def to_dz(scaling, g, dx, dz):
        """dz = g - Theta dx."""
        for a in range(len(dx)):
            square = 1.0 / (scaling[a, dim] * scaling[a, dim])
            along = scaling[a, 0] * dx[a, 0]
            for i in range(1, dim):
                along -= scaling[a, i] * dx[a, i]
            dz[a, 0] = g[a, 0] - square * (2.0 * scaling[a, 0] * along - dx[a, 0])
            for i in range(1, dim):
                dz[a, i] = g[a, i] - square * (-2.0 * scaling[a, i] * along + dx[a, i])

    @njit(error_model="numpy")
    def correct(scaling, x, z, dx, dz, centre, residual, g, rhs):
        """Centring and second-order terms: g and the right-hand side of the corrector."""
        p, s, lam, c = np.empty(dim), np.empty(dim), np.empty(dim), np.empty(dim)
        for a in range(len(x)):
            unscale(scaling, a, dx[a], p, True)
            unscale(scaling, a, dz[a], s, False)
            unscale(scaling, a, z[a], lam, False)
            multiply(p, s, c)
            c[0] = centre - c[0]
            for i in range(1, dim):
                c[i] = -c[i]
            divide(lam, c)
            unscale(scaling, a, c, p, True)
            slip = size_t(z, a)
            for i in range(dim):
                g[a, i] = p[i] - z[a, i]
                rhs[a, i] = g[a, i] - residual[a, i]
            for i in range(1, dim):
                rhs[a, 0] -= z[a, i] / max(slip, TINY) * g[a, i]

    @njit(error_model="numpy")
    def recentre(scaling, x, z, dx, dz, step, centre, g):
        """Add to g what brings the eigenvalues of x o z after a step nearer to the centre's."""
        p, s, lam, c = np.empty(dim), np.empty(dim), np.empty(dim), np.empty(dim)
        low, high = centre * _LEAST_SHARE, centre / _LEAST_SHARE
        for a in range(len(x)):
            for i in range(dim):
                c[i], lam[i] = x[a, i] + step * dx[a, i], z[a, i] + step * dz[a, i]
            unscale(scaling, a, c, p, True)
            unscale(scaling, a, lam, s, False)
            multiply(p, s, c)
            size = 0.0
            for i in range(1, dim):
                size += c[i] * c[i]
            size = np.sqrt(size)
            less, more = c[0] - size, c[0] + size
            less = max(min(max(less, low), high) - less, -high)
            more = max(min(max(more, low), high) - more, -high)
            if less == 0.0 and more == 0.0:
                continue
            c[0] = 0.5 * (less + more)
            for i in range(1, dim):
                c[i] *= 0.5 * (more - less) / max(size, TINY)
            unscale(scaling, a, z[a], lam, False)
            divide(lam, c)
            unscale(scaling, a, c, p, True)
            for i in range(dim):
                g[a, i] += p[i]

    @njit(error_model="numpy")
    def advance(x, z, dx, dz, step):
        for a in range(len(x)):
            for i in range(dim):
                x[a, i] += step * dx[a, i]
                z[a, i] += step * dz[a, i]

    return ConeKernels(size_t, scale, longest, to_dz, reach, correct, recentre, advance)


def centre_of(cones: ConeKernels, x, z, dx, dz, gap: float, ranks: Reductions = ALONE) -> float:
    """What the corrector asks of x o z, from how far the predictor dx, dz leads (Mehrotra).

    Args:
        cones: their kernels.
        x, z, dx, dz: shape (n, dim), of this rank's points.
        gap: x . z of all ranks.
        ranks: that have the points.
    """
    step = min(1.0, -ranks.max(-cones.longest(x, z, dx, dz)))
    reached = ranks.sum(cones.reach(x, z, dx, dz, step))
    return min(max(reached / gap, 0.0), 1.0) ** 3 * gap / ranks.sum(len(x))


def go_along(cones: ConeKernels, x, z, dx, dz, ranks: Reductions = ALONE) -> float:
    """Take x + step dx and z + step dz, nearly as far as the cones of all ranks allow; the step."""
    step = min(1.0, _TO_BOUNDARY * -ranks.max(-cones.longest(x, z, dx, dz)))
    cones.advance(x, z, dx, dz, step)
    return step


@cache
def _kernels(dim: int):
    row = for_dimension(dim).row
    residual_map, cones = natural_map(dim), cone_kernels(dim)
    size_t, scale = cones.size_t, cones.scale

    @njit
    def begin(problem, mu, scaled, qs):
        """W' and q'."""
        offsets, columns, blocks, q = problem.offsets, problem.columns, problem.blocks, problem.q
        for a in range(len(mu)):
            for i in range(dim):
                si = 1.0 / mu[a] if i == 0 else 1.0
                qs[a, i] = q[a, i] * si
                for k in range(offsets[a], offsets[a + 1]):
                    sn = 1.0 / mu[columns[k]]
                    for j in range(dim):
                        scaled[k, i, j] = blocks[k, i, j] * si * (sn if j == 0 else 1.0)

    @njit(error_model="numpy")
    def linearise(problem, true_mu, x, z, residual, scaling, data, rhs):
        """Residual, scaling and matrix at (x, z), right-hand side of the predictor.

        `problem` has W', q' and the friction they were scaled by; `true_mu` may be zero.

        `scaling[a]` holds the unit scaling point and its factor eta. Returns squared natural-map
        error and complementarity.
        """
        offsets, columns, scaled = problem.offsets, problem.columns, problem.blocks
        qs, mu = problem.q, problem.mu
        error, gap = 0.0, 0.0
        theta = np.empty((dim, dim))
        d = np.zeros(dim)
        u, r = np.empty((1, dim)), np.empty((1, dim))
        for a in range(len(mu)):
            for i in range(dim):
                total = qs[a, i]
                for k in range(offsets[a], offsets[a + 1]):
                    b = columns[k]
                    for j in range(dim):
                        total += scaled[k, i, j] * x[b, j]
                u[0, i] = total
                residual[a, i] = total - z[a, i]
                r[0, i] = x[a, i]
                gap += x[a, i] * z[a, i]
            slip = size_t(z, a)
            residual[a, 0] += slip
            for i in range(1, dim):
                d[i] = z[a, i] / max(slip, TINY)
            u[0, 0] *= mu[a]
            r[0, 0] /= mu[a]
            f = residual_map(row(r, 0), row(u, 0), true_mu[a], 1.0)
            for i in range(dim):
                error += f[i] * f[i]
            scale(x, z, a, scaling)
            eta = scaling[a, dim]
            # Theta = (2 (J w) (J w)^T - J) / eta^2
            square = 1.0 / (eta * eta)
            for i in range(dim):
                for j in range(dim):
                    sign = -1.0 if (i == 0) != (j == 0) else 1.0
                    theta[i, j] = 2.0 * sign * scaling[a, i] * scaling[a, j] * square
                theta[i, i] += -square if i == 0 else square
            length = offsets[a + 1] - offsets[a]
            start = dim * dim * offsets[a]
            for k in range(offsets[a], offsets[a + 1]):
                for i in range(dim):
                    entry = start + i * dim * length + (k - offsets[a]) * dim
                    for j in range(dim):
                        value = scaled[k, i, j]
                        if columns[k] == a:
                            value += theta[i, j]
                            if i == 0:
                                for t in range(1, dim):
                                    value -= d[t] * theta[t, j]
                        data[entry + j] = value
            for i in range(dim):
                rhs[a, i] = -z[a, i] - residual[a, i]
                if i == 0:
                    for t in range(1, dim):
                        rhs[a, 0] += d[t] * z[a, t]
        return error, gap

    return begin, linearise


def solve(
    problem: BlockProblem, r: np.ndarray, *, tolerance: float, history: list, start: float = 1.0
) -> bool:
    """Descend until the error is within the tolerance or no longer falls.

    Args:
        problem: the stored problem, in an order of elimination.
        r: shape (n, dim); the best impulses met on return.
        tolerance: bound on `error.natural_error`.
        history: the error of each iteration is appended.
        start: size of the first x and z, in units of |q| / sqrt(n).

    Returns:
        Whether the tolerance was reached.
    """
    dim, n = problem.dim, len(problem.mu)
    begin, linearise = _kernels(dim)
    cones = cone_kernels(dim)
    size_q = np.linalg.norm(problem.q)
    if size_q == 0.0:
        r[:] = 0.0
        return True
    unit = size_q / np.sqrt(n)  # all is solved for q / unit
    mu = np.maximum(problem.mu, LEAST_FRICTION)
    scaled, qs = np.empty_like(problem.blocks), np.empty((n, dim))
    begin(problem._replace(q=problem.q / unit), mu, scaled, qs)
    own = problem._replace(blocks=scaled, q=qs, mu=mu)
    x, z = np.zeros((2, n, dim))
    x[:, 0], z[:, 0] = start * mu, start / mu
    dx, dz, residual, g, rhs = np.empty((5, n, dim))
    scaling = np.empty((n, dim + 1))
    system = SparseSystem(problem)
    best, step, first_gap = np.inf, 1.0, n * start**2
    to_impulse = np.full((n, dim), unit)
    to_impulse[:, 0] /= mu
    for _ in range(_MAX_ITERATIONS):
        squared, gap = linearise(own, problem.mu, x, z, residual, scaling, system.data, rhs)
        error = np.sqrt(squared / n)
        history.append(error)
        if error < best:
            best = error
            np.multiply(x, to_impulse, out=r)
        if not error > tolerance:
            break
        if step < _SHORTEST or gap < _ROUNDING * first_gap or not system.factorise():
            break
        dx = system.solve(rhs)
        cones.to_dz(scaling, -z, dx, dz)
        centre = centre_of(cones, x, z, dx, dz, gap)
        cones.correct(scaling, x, z, dx, dz, centre, residual, g, rhs)
        dx = system.solve(rhs)
        cones.to_dz(scaling, g, dx, dz)
        if not (np.isfinite(dx).all() and np.isfinite(dz).all()):
            break
        step = go_along(cones, x, z, dx, dz)
    return best <= tolerance
