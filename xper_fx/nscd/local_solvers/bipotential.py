# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bipotential (de Saxce & Feng 1998): projections on Coulomb's cone of a corrected velocity.

Signorini-Coulomb is  -(u_N + mu |u_T|, u_T) in the normal cone of K_mu = {|r_T| <= mu r_N} at r, so
that r is the fixed point of

    r <- P_K(r - rho (u_N + mu |u_T|, u_T)),   u = b + W r,   rho > 0.

The metric is chosen so that W has a constant diagonal: r' = (r_N, alpha r_T) with
alpha^2 = mean W_TT / W_NN turns K_mu into K_(alpha mu) and u into (u_N, u_T / alpha). rho W_NN
starts from 1 and then follows the secant (Barzilai & Borwein 1988, its two forms in turn): on the
change dr' and the change dv of the corrected velocity, |dr'|^2 / dr'.dv or dr'.dv / |dv|^2. In 2D
that is superlinear, where a fixed rho contracts by 1 - 1/cond(W') at best.

It stops where the change bounds the error by 1e-12 of r, through a lower bound of W's smallest
eigenvalue and the largest rho met; slipping, only the direction of r is kept and u_N = 0 gives its
length. The correction mu |u_T| depends on r and has a kink at u_T = 0, so that nothing bounds
the iterations when mu or cond(W') is large: after `_ITERATIONS`, or once the projection has been
idle for `_IDLE` (the point sticks, and that is a linear system), the sure solver finishes (`graph`
in 2D, `exact` in 3D). It also takes mu = 0 and singular W.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.local_solvers import exact, graph
from xper_fx.nscd.local_solvers.interface import INLINE_KERNEL, KERNEL, LocalSolver

_ITERATIONS = 60
# Iterations in a row that may stay strictly inside the cone.
_IDLE = 6
_TOLERANCE = 1e-12
# Bounds of rho W_NN.
_SHORTEST, _LONGEST = 0.1, 1e6


@INLINE_KERNEL
def _project(normal, size, mu):
    """Projection on K_mu of (normal, |tangent| = size): normal, and factor on the tangent."""
    if size <= mu * normal:
        return normal, 1.0
    if mu * size <= -normal:
        return 0.0, 0.0
    projected = (normal + mu * size) / (1.0 + mu * mu)
    return projected, mu * projected / size


@INLINE_KERNEL
def _size2(x):
    return abs(x[1])


@INLINE_KERNEL
def _size3(x):
    return np.sqrt(x[1] * x[1] + x[2] * x[2])


@KERNEL
def _tangential2(w):
    return w[2]


@KERNEL
def _tangential3(w):
    return 0.5 * (w[3] + w[5])


@KERNEL
def _softness2(factors, i, w):
    """W_NN over the least eigenvalue of W', at most: 2 / det for a unit diagonal."""
    return 2.0 * factors[i, 2] * w[2]


@KERNEL
def _softness3(factors, i, w):
    """The same: (trace / 2)^2 / det, det = det S / (tr W_TT / 2)^2."""
    tangential = _tangential3(w) * factors[i, 3]
    return 2.25 * tangential * tangential / factors[i, 4]


@INLINE_KERNEL
def _with_normal2(normal, x):
    return normal, x[1]


@INLINE_KERNEL
def _with_normal3(normal, x):
    return normal, x[1], x[2]


@cache
def kernels(dim: int):
    """Kernels `(prepare, solve, solve_and_count)`.

    `solve_and_count(b, w, factors, i, mu, r) -> r, iterations`, negative where the sure solver
    finished.
    """
    algebra = for_dimension(dim)
    add, subtract, scale, dot = algebra.add, algebra.subtract, algebra.scale, algebra.dot
    multiply_diagonal, sym_vector = algebra.multiply_diagonal, algebra.sym_vector
    size_of, tangential, softness, with_normal, sure = (
        (_size2, _tangential2, _softness2, _with_normal2, graph)
        if dim == 2
        else (_size3, _tangential3, _softness3, _with_normal3, exact)
    )
    sure_prepare, sure_solve, own = sure.prepare, sure.solve, sure.NUM_FACTORS
    # the sure solver's flag of a singular W
    flag = 2 if dim == 2 else 4

    @KERNEL
    def prepare(w, mu, factors, i):
        sure_prepare(w, mu, factors, i)
        factors[i, own] = 0.0
        if factors[i, flag] != 0.0:
            factors[i, own] = np.sqrt(tangential(w) / w[0])
            factors[i, own + 1] = softness(factors, i, w)

    @INLINE_KERNEL
    def corrected(b, w, alpha, mu, r):
        """(u_N + mu |u_T|, u_T / alpha) / W_NN at the scaled impulse r, an impulse."""
        u = add(b, sym_vector(w, multiply_diagonal(1.0, 1.0 / alpha, r)))
        return multiply_diagonal(
            1.0 / w[0], 1.0 / (alpha * w[0]), with_normal(u[0] + mu * size_of(u), u)
        )

    @INLINE_KERNEL
    def solve_and_count(b, w, factors, i, mu, r):
        alpha = factors[i, own]
        if b[0] >= 0.0 or alpha == 0.0 or mu == 0.0:
            # open, singular, or the frictionless formula
            return sure_solve(b, w, factors, i, mu, r), 0
        scaled = alpha * mu
        x = multiply_diagonal(1.0, alpha, r)
        v = corrected(b, w, alpha, mu, x)
        softest, rho, idle = factors[i, own + 1], 1.0, 0
        for iteration in range(_ITERATIONS):
            y = subtract(x, scale(rho, v))
            normal, factor = _project(y[0], size_of(y), scaled)
            y = multiply_diagonal(normal, factor, with_normal(1.0, y))
            v_new = corrected(b, w, alpha, mu, y)
            change, stretch = subtract(y, x), subtract(v_new, v)
            moved, size = np.sqrt(dot(change, change)), np.sqrt(dot(y, y))
            softest = max(softest, rho)
            if moved * softest <= _TOLERANCE * rho * size:
                y = multiply_diagonal(1.0, 1.0 / alpha, y)
                if factor == 1.0:
                    return y, iteration + 1
                # u_N = 0 on the generator of the cone through y
                y = scale(1.0 / y[0], y)
                gain = sym_vector(w, y)[0]
                if gain > 0.0:
                    return scale(-b[0] / gain, y), iteration + 1
                break
            along = dot(change, stretch)
            rho = 1.0
            if along > 0.0:
                square = moved * moved if iteration % 2 else along
                other = along if iteration % 2 else dot(stretch, stretch)
                rho = min(max(square / other, _SHORTEST), _LONGEST)
            idle = idle + 1 if factor == 1.0 else 0
            if idle > _IDLE:
                break
            x, v = y, v_new
        return sure_solve(b, w, factors, i, mu, r), -1 - iteration

    @INLINE_KERNEL
    def solve(b, w, factors, i, mu, r):
        if b[0] >= 0.0:
            return scale(0.0, b)
        r, _ = solve_and_count(b, w, factors, i, mu, r)
        return r

    return prepare, solve, solve_and_count


BIPOTENTIAL = {
    dim: LocalSolver("bipotential", sure.NUM_FACTORS + 2, *kernels(dim)[:2])
    for dim, sure in ((2, graph), (3, exact))
}
