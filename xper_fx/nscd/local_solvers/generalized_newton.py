# SPDX-License-Identifier: LGPL-3.0-or-later
"""3D: generalized Newton on the projection form of Alart & Curnier (1991).

With u = b + W r, rho_N = 1 / W_NN, rho_T = 2 / tr W_TT, the augmented impulses
tau_N = r_N - rho_N u_N and tau_T = r_T - rho_T u_T, a solution is a zero of

    F_N = r_N - max(tau_N, 0),   F_T = r_T - P_D(tau_T),   D the disc of radius mu max(tau_N, 0).

The generalized tangent is exact on each side of the kinks. Sticking, F = (rho_N u_N, rho_T u_T).
Slipping, with t = tau_T / |tau_T|, k = mu tau_N / |tau_T| < 1, Q = k (I - t t^T), and as
rho_N W_NN = 1 takes the normal part out,

    dF_N = rho_N W dr,   dF_T/dr_N = rho_T Q W_TN,
    dF_T/dr_T = I + mu rho_N t W_NT - Q (I - rho_T W_TT).

The 3 x 3 system is solved by Cramer's rule. Backtracking on |F|; where the tangent is singular,
|F| does not fall, or `_STEPS` are spent, `exact` solves, as it does for singular W and where
closing meets no friction. Stops after a full step of less than 1e-9 of r (the error left is its
square).
"""

import numpy as np

from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.local_solvers import exact
from xper_fx.nscd.local_solvers.interface import INLINE_KERNEL, KERNEL, LocalSolver

_STEPS = 25
_OWN = exact.NUM_FACTORS
# Of exact's factors: 1 / W_NN, and 0 where W is singular.
_RHO_N, _REGULAR = 0, 4

_ALGEBRA = for_dimension(3)
_add, _dot, _scale = _ALGEBRA.add, _ALGEBRA.dot, _ALGEBRA.scale
_sym_vector = _ALGEBRA.sym_vector
_exact_prepare, _exact_solve = exact.prepare, exact.solve


@INLINE_KERNEL
def _residual(b, w, rho_n, rho_t, mu, r):
    """F, tau_T, its size, and mu tau_N."""
    u = _add(b, _sym_vector(w, r))
    radius = mu * max(r[0] - rho_n * u[0], 0.0)
    x, y = r[1] - rho_t * u[1], r[2] - rho_t * u[2]
    size = np.sqrt(x * x + y * y)
    # F_N = min(r_N, rho_N u_N); written this way nothing is lost where it is small
    normal = min(r[0], rho_n * u[0])
    if size <= radius:
        return (normal, rho_t * u[1], rho_t * u[2]), x, y, size, radius
    shorter = radius / size
    return (normal, r[1] - shorter * x, r[2] - shorter * y), x, y, size, radius


@INLINE_KERNEL
def _newton_step(f, w, rho_n, rho_t, mu, x, y, size, radius):
    """-J^-1 F, and whether J could be inverted."""
    if size <= radius:
        a, b, c = rho_n * w[0], rho_n * w[1], rho_n * w[2]
        d, e, g = rho_t * w[1], rho_t * w[3], rho_t * w[4]
        h, k, m = rho_t * w[2], rho_t * w[4], rho_t * w[5]
    else:
        x, y = x / size, y / size
        ratio = radius / size
        q11, q12, q22 = ratio * y * y, -ratio * x * y, ratio * x * x
        a, b, c = 1.0, rho_n * w[1], rho_n * w[2]
        d = rho_t * (q11 * w[1] + q12 * w[2])
        h = rho_t * (q12 * w[1] + q22 * w[2])
        e = 1.0 + mu * b * x - q11 + rho_t * (q11 * w[3] + q12 * w[4])
        g = mu * c * x - q12 + rho_t * (q11 * w[4] + q12 * w[5])
        k = mu * b * y - q12 + rho_t * (q12 * w[3] + q22 * w[4])
        m = 1.0 + mu * c * y - q22 + rho_t * (q12 * w[4] + q22 * w[5])
    c0, c1, c2 = e * m - g * k, g * h - d * m, d * k - e * h
    det = a * c0 + b * c1 + c * c2
    inverse = -1.0 / det
    step = (
        inverse * (c0 * f[0] + (c * k - b * m) * f[1] + (b * g - c * e) * f[2]),
        inverse * (c1 * f[0] + (a * m - c * h) * f[1] + (c * d - a * g) * f[2]),
        inverse * (c2 * f[0] + (b * h - a * k) * f[1] + (a * e - b * d) * f[2]),
    )
    return step, det != 0.0 and abs(step[0]) + abs(step[1]) + abs(step[2]) < np.inf


@KERNEL
def prepare(w, mu, factors, i):
    """Those of the exact solver, and rho_T."""
    _exact_prepare(w, mu, factors, i)
    twice = w[3] + w[5]
    factors[i, _OWN] = 2.0 / twice if twice > 0.0 else 0.0


@INLINE_KERNEL
def solve_and_count(b, w, factors, i, mu, r):
    """The impulse and the Newton steps, negative where the exact solver finished."""
    if b[0] >= 0.0 or factors[i, _REGULAR] == 0.0 or mu == 0.0:
        return _exact_solve(b, w, factors, i, mu, r), 0
    rho_n, rho_t = factors[i, _RHO_N], factors[i, _OWN]
    steps = 0
    f, x, y, size, radius = _residual(b, w, rho_n, rho_t, mu, r)
    if radius == 0.0:  # it would come out open, which it cannot stay
        r = (-b[0] * rho_n, 0.0, 0.0)
        f, x, y, size, radius = _residual(b, w, rho_n, rho_t, mu, r)
    square = _dot(f, f)
    while steps < _STEPS:
        if square == 0.0:
            return r, steps
        steps += 1
        step, regular = _newton_step(f, w, rho_n, rho_t, mu, x, y, size, radius)
        if not regular:
            break
        if radius > 0.0 and _dot(step, step) <= 1e-18 * _dot(r, r):
            return _add(r, step), steps
        length, fell = 1.0, False
        for _ in range(8):
            trial = _add(r, _scale(length, step))
            f, x, y, size, radius = _residual(b, w, rho_n, rho_t, mu, trial)
            now = _dot(f, f)
            if now <= (1.0 - 0.2 * length) * square:
                fell = True
                break
            length *= 0.5
        if not fell:
            break
        r, square = trial, now
    return _exact_solve(b, w, factors, i, mu, r), -1 - steps


@INLINE_KERNEL
def solve(b, w, factors, i, mu, r):
    """The impulse."""
    if b[0] >= 0.0:
        return 0.0, 0.0, 0.0
    r, _ = solve_and_count(b, w, factors, i, mu, r)
    return r


NEWTON = LocalSolver("newton", _OWN + 1, prepare, solve)
