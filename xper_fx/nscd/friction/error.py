# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far impulses are from a solution: the natural map, and its parts in physical units.

With the velocity of de Saxce, u~ = u + mu |u_T| n, Signorini-Coulomb is K 3 r _|_ u~ in K*, K the
Coulomb cone |r_T| <= mu r_N; for any rho > 0 this is (Acary and Brogliato 2008, section 13.6)

    F(r) = r - P_K(r - rho u~) = 0.

Two measures of F:

- `error`: rho = 1 / m, m = mean(diag W), and |F| / (rho |q|). It does not depend on units, and is
  what tolerances bound. With q = 0, which r = 0 solves, it is |F| / rho.
- `siconos_error`: rho = 1 and |F| / max(|q|, |r|, |u|), as Siconos reports it, to compare figures.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.friction.blocks import BlockProblem, row_product


@cache
def natural_map(dim: int):
    """Kernel `residual(r, u, mu, rho) -> F` at one contact, all tuples but mu and rho."""

    @njit(inline="always")
    def residual2(r, u, mu, rho):
        n = r[0] - rho * (u[0] + mu * abs(u[1]))
        t = r[1] - rho * u[1]
        size = abs(t)
        if size <= mu * n:
            return r[0] - n, r[1] - t
        if mu * size <= -n:
            return r
        normal = (n + mu * size) / (1.0 + mu * mu)
        return r[0] - normal, r[1] - np.copysign(mu * normal, t)

    @njit(inline="always")
    def residual3(r, u, mu, rho):
        n = r[0] - rho * (u[0] + mu * np.sqrt(u[1] * u[1] + u[2] * u[2]))
        t1, t2 = r[1] - rho * u[1], r[2] - rho * u[2]
        size = np.sqrt(t1 * t1 + t2 * t2)
        if size <= mu * n:
            return r[0] - n, r[1] - t1, r[2] - t2
        if mu * size <= -n:
            return r
        normal = (n + mu * size) / (1.0 + mu * mu)
        ratio = mu * normal / size
        return r[0] - normal, r[1] - ratio * t1, r[2] - ratio * t2

    return residual2 if dim == 2 else residual3


@cache
def residual_kernel(dim: int):
    """Kernel `squared(first, last, problem, r) -> sum |F|^2` with rho = 1."""
    algebra = for_dimension(dim)
    row, dot = algebra.row, algebra.dot
    multiply, residual = row_product(dim), natural_map(dim)

    @njit(fastmath={"contract"}, error_model="numpy", _nrt=False)
    def squared(first, last, problem, r):
        total = 0.0
        for a in range(first, last):
            u = multiply(a, problem, r, row(problem.q, a))
            f = residual(row(r, a), u, problem.mu[a], 1.0)
            total += dot(f, f)
        return total

    return squared


def natural_error(problem: BlockProblem, r: np.ndarray) -> float:
    """`error` of the module docstring, of a stored (scaled) problem; r shape (n, dim)."""
    squared = residual_kernel(problem.dim)
    total = squared(0, len(r), problem, r)
    return np.sqrt(total) / (np.linalg.norm(problem.q) or 1.0)


class Errors(NamedTuple):
    """The error of given impulses, and its parts."""

    error: float  #: unit-free natural-map error (module docstring)
    siconos_error: float  #: Siconos's natural-map error
    penetration: float  #: largest -u_N, or 0 (m/s)
    complementarity: float  #: largest |u_N r_N| (J)
    cone_violation: float  #: largest |r_T| - mu r_N, or 0 (N s)


@cache
def _measure_kernel(dim: int):
    algebra, residual = for_dimension(dim), natural_map(dim)
    row, dot, scale = algebra.row, algebra.dot, algebra.scale

    @njit(error_model="numpy")
    def measure(indptr, indices, data, q, mu, flat, mean_diagonal, u):
        r = flat.reshape(-1, dim)
        largest_q, largest = 0.0, 0.0
        for a in range(len(mu)):
            for i in range(dim):
                total = q[a, i]
                line = a * dim + i
                for k in range(indptr[line], indptr[line + 1]):
                    total += data[k] * flat[indices[k]]
                u[a, i] = total
                largest_q = max(largest_q, abs(q[a, i]))
                largest = max(largest, abs(r[a, i]), abs(total))
        # Both maps are homogeneous: by these units no square under- or overflows.
        unit = 1.0 / largest_q if largest_q > 0.0 else 1.0
        largest = max(largest, largest_q)
        unit_of_all = 1.0 / largest if largest > 0.0 else 1.0
        size_q, size_r, size_u, error, siconos = 0.0, 0.0, 0.0, 0.0, 0.0
        penetration, complementarity, cone_violation = 0.0, 0.0, 0.0
        for a in range(len(mu)):
            ra, ua, qa = row(r, a), row(u, a), row(q, a)
            f = residual(scale(mean_diagonal * unit, ra), scale(unit, ua), mu[a], 1.0)
            error += dot(f, f)
            qa = scale(unit, qa)
            size_q += dot(qa, qa)
            sr, su = scale(unit_of_all, ra), scale(unit_of_all, ua)
            f = residual(sr, su, mu[a], 1.0)
            siconos += dot(f, f)
            size_r += dot(sr, sr)
            size_u += dot(su, su)
            tangential = 0.0
            for i in range(1, dim):
                tangential = np.hypot(tangential, r[a, i])
            penetration = max(penetration, -ua[0])
            complementarity = max(complementarity, abs(ua[0] * ra[0]))
            cone_violation = max(cone_violation, tangential - mu[a] * ra[0])
        error = np.sqrt(error / size_q) if size_q > 0.0 else np.sqrt(error)
        size_q *= (unit_of_all / unit) ** 2
        size = np.sqrt(max(size_q, size_r, size_u))
        siconos = np.sqrt(siconos) / (size if size > 0.0 else 1.0)
        return error, siconos, penetration, complementarity, cone_violation

    return measure


def measure(W, q, mu, dim: int, r, mean_diagonal: float) -> tuple[np.ndarray, Errors]:
    """Velocities and errors of given impulses, from W as it was given.

    Args:
        W: shape (n dim, n dim), CSR (m/s per N s).
        q, r: shape (n dim,) (m/s, N s).
        mu: shape (n,).
        dim: 2 or 3.
        mean_diagonal: mean(diag W).

    Returns:
        u = W r + q, shape (n dim,), and the errors.
    """
    u = np.empty(len(q))
    shape = (-1, dim)
    errors = _measure_kernel(dim)(
        W.indptr, W.indices, W.data, q.reshape(shape), mu, r, mean_diagonal, u.reshape(shape)
    )
    return u, Errors(*errors)
