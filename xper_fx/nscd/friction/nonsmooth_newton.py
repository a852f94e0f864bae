# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonsmooth Newton on all contacts, alone or inside a proximal point iteration.

The function of Alart and Curnier (1991), with u = W r + q + alpha (r - c), alpha >= 0 a proximal
term around the centre c:

    F_N = r_N - max(0, y_N),          y_N = r_N - rho_N u_N,
    F_T = r_T - P(y_T; mu max(0, y_N)),   y_T = r_T - rho_T u_T,

P(.; s) the projection on the disc of radius s, rho_N = 1 / W_NN, rho_T = 1 / (largest eigenvalue of
W_TT) at each contact. With A the derivative of the right-hand sides by y (an element of its
generalized Jacobian), the step solves (I - A + A rho (W + alpha)) dr = -F; it is halved until |F|
falls. Near a solution it converges quadratically; from afar, or where sticking contacts are
hyperstatic (W singular), it may not. Hence

**proximal point** (Rockafellar 1976; for contact Acary, Bremond and Huber 2018): r_{k+1} solves the
problem with alpha > 0 and centre r_k, which is regular; what is left is alpha |r_{k+1} - r_k|.
alpha falls where Newton does well, boldly until it fails a first time, and grows where it fails.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.friction.blocks import BlockProblem, row_product
from xper_fx.nscd.friction.error import natural_error
from xper_fx.nscd.friction.sparse_system import SparseSystem

_MAX_STEPS = 50
# A step is halved until |F| falls by this fraction of it, down to the shortest step.
_DESCENT, _SHORTEST = 1e-4, 1e-3
# Newton alone: the proximal term that only makes the matrix regular, relative to mean(diag W).
_REGULAR = 1e-12
_FIRST_ALPHA, _LEAST_ALPHA, _LARGEST_ALPHA = 1e-3, 1e-12, 1e3
_INNER_STEPS, _INNER_ERROR = 20, 0.05
_MAX_CENTRES, _NO_BETTER, _MAX_FACTORISATIONS = 150, 60, 3000
# alpha falls by the first factor while all goes well, by the second after the first failure.
_BOLD, _CAUTIOUS, _BACK = 0.1, 0.7, 3.0

# Fractions of the friction, the error wanted on the way, and the proximal coefficient there.
_FRACTIONS, _ON_THE_WAY, _LOOSE_ALPHA = (0.2, 0.4, 0.6, 0.8, 0.9), 1e-3, 1e-2


@cache
def _kernels(dim: int):
    row, multiply = for_dimension(dim).row, row_product(dim)

    @njit
    def steps(diagonal, rho):
        """rho_N and rho_T of each contact."""
        for a in range(len(rho)):
            rho[a, 0] = 1.0 / diagonal[a, 0] if diagonal[a, 0] > 0.0 else 1.0
            if dim == 2:
                largest = diagonal[a, 2]
            else:
                half = 0.5 * (diagonal[a, 3] - diagonal[a, 5])
                largest = 0.5 * (diagonal[a, 3] + diagonal[a, 5]) + np.hypot(half, diagonal[a, 4])
            rho[a, 1] = 1.0 / largest if largest > 0.0 else 1.0

    @njit(error_model="numpy")
    def value(problem, rho, alpha, centre, r, f, y):
        """F and y; returns |F|^2."""
        total, mu = 0.0, problem.mu
        for a in range(len(mu)):
            u = multiply(a, problem, r, row(problem.q, a))
            size = 0.0
            for i, ui in enumerate(u):
                shifted = ui + alpha * (r[a, i] - centre[a, i])
                y[a, i] = r[a, i] - rho[a, min(i, 1)] * shifted
                if i > 0:
                    size += y[a, i] * y[a, i]
            normal = max(y[a, 0], 0.0)
            size, limit = np.sqrt(size), mu[a] * normal
            ratio = limit / size if size > limit else 1.0
            f[a, 0] = r[a, 0] - normal
            total += f[a, 0] * f[a, 0]
            for i in range(1, dim):
                f[a, i] = r[a, i] - ratio * y[a, i]
                total += f[a, i] * f[a, i]
        return total

    @njit(error_model="numpy")
    def jacobian(problem, rho, alpha, y, data):
        """I - A + A rho (W + alpha), row by row."""
        offsets, columns, blocks, mu = problem.offsets, problem.columns, problem.blocks, problem.mu
        slope = np.empty((dim, dim))
        for a in range(len(mu)):
            slope[:] = 0.0
            if y[a, 0] > 0.0:
                size = 0.0
                for i in range(1, dim):
                    size += y[a, i] * y[a, i]
                size, limit = np.sqrt(size), mu[a] * y[a, 0]
                slope[0, 0] = 1.0
                for i in range(1, dim):
                    slope[i, i] = 1.0
                    if size > limit:
                        ei = y[a, i] / size
                        slope[i, 0] = mu[a] * ei
                        slope[i, i] = limit / size
                        for j in range(1, dim):
                            slope[i, j] -= limit / size * ei * y[a, j] / size
            length = offsets[a + 1] - offsets[a]
            start = dim * dim * offsets[a]
            for k in range(offsets[a], offsets[a + 1]):
                for i in range(dim):
                    entry = start + i * dim * length + (k - offsets[a]) * dim
                    for j in range(dim):
                        total = 0.0
                        for m in range(dim):
                            total += slope[i, m] * rho[a, min(m, 1)] * blocks[k, m, j]
                        if columns[k] == a:
                            total += slope[i, j] * (alpha * rho[a, min(j, 1)] - 1.0)
                            if i == j:
                                total += 1.0
                        data[entry + j] = total

    return steps, value, jacobian


class _Newton:
    """Newton's method on one problem, for any proximal term."""

    def __init__(self, problem: BlockProblem):
        self.problem = problem
        self.system = SparseSystem(problem)
        steps, self._value, self._jacobian = _kernels(problem.dim)
        self.rho = np.empty((len(problem.mu), 2))
        steps(problem.diagonal, self.rho)

    def value(self, alpha, centre, r):
        f, y = np.empty_like(r), np.empty_like(r)
        total = self._value(self.problem, self.rho, alpha, centre, r, f, y)
        return np.sqrt(total), f, y

    def run(self, r, alpha, centre, wanted, max_steps):
        """Newton steps from r until |F| <= wanted; returns r, whether, and the steps made."""
        size, f, y = self.value(alpha, centre, r)
        for count in range(max_steps):
            if size <= wanted:
                return r, True, count
            self._jacobian(self.problem, self.rho, max(alpha, _REGULAR), y, self.system.data)
            if not self.system.factorise():
                return r, False, count
            direction = self.system.solve(-f)
            step = 1.0
            while step > _SHORTEST:
                trial = r + step * direction
                trial_size, trial_f, trial_y = self.value(alpha, centre, trial)
                if trial_size <= (1.0 - _DESCENT * step) * size:
                    break
                step *= 0.5
            else:
                return r, False, count
            r, size, f, y = trial, trial_size, trial_f, trial_y
        return r, size <= wanted, max_steps


def solve(problem: BlockProblem, r: np.ndarray, *, tolerance: float, history: list) -> bool:
    """Newton's method alone, from r.

    Args:
        problem: the stored problem, in an order of elimination.
        r: shape (n, dim), first guess; the best impulses met on return.
        tolerance: bound on `error.natural_error`.
        history: the error at the end is appended.

    Returns:
        Whether the tolerance was reached.
    """
    newton = _Newton(problem)
    # |F| differs from the natural map by bounded factors: ask for less until that suffices.
    size_q = np.linalg.norm(problem.q) or 1.0
    found, before = r, natural_error(problem, r)
    wanted = tolerance * size_q
    error = before
    for _ in range(3):
        found, reached, _ = newton.run(found, 0.0, found, wanted, _MAX_STEPS)
        error = natural_error(problem, found)
        if error <= tolerance or not reached:
            break
        wanted *= 0.5 * tolerance / error
    history.append(error)
    if error < before:
        r[:] = found
    return error <= tolerance


def proximal_point(
    problem: BlockProblem,
    r: np.ndarray,
    *,
    tolerance: float,
    history: list,
    alpha: float = _FIRST_ALPHA,
    max_centres: int = _MAX_CENTRES,
    max_factorisations: int = _MAX_FACTORISATIONS,
) -> bool:
    """Proximal points, each found by Newton's method, from r.

    Args:
        problem, r, tolerance, history: as in `solve`; history gets the error of each centre.
        alpha: first proximal coefficient, relative to mean(diag W).
        max_centres, max_factorisations: after which to give up.

    Returns:
        Whether the tolerance was reached.
    """
    newton = _Newton(problem)
    size_q = np.linalg.norm(problem.q) or 1.0
    centre, best, fall, since = r.copy(), np.inf, _BOLD, 0
    for _ in range(max_centres):
        error = natural_error(problem, centre)
        history.append(error)
        since += 1
        if error < best:
            if error < 0.9 * best:
                since = 0
            best = error
            r[:] = centre
        if not error > tolerance or since > _NO_BETTER:
            break
        if newton.system.factorisations >= max_factorisations:
            break
        wanted = _INNER_ERROR * min(error, 1.0) * size_q
        found, reached, steps = newton.run(centre, alpha, centre, wanted, _INNER_STEPS)
        if reached:
            centre = found
            if steps < 6:
                alpha = max(alpha * fall, _LEAST_ALPHA)
        else:
            if natural_error(problem, found) < error:
                centre = found
            fall = _CAUTIOUS
            alpha *= _BACK
            if alpha > _LARGEST_ALPHA:
                break
    return best <= tolerance


def continuation(
    problem: BlockProblem,
    r: np.ndarray,
    *,
    tolerance: float,
    history: list,
    max_factorisations: int = _MAX_FACTORISATIONS,
) -> bool:
    """Proximal points for friction that grows from a fraction to the whole, from rest.

    With little friction the problem is close to a convex one, which has one way down.

    Args:
        problem, r, tolerance, history: as in `solve`; history gets the errors of the last fraction.
        max_factorisations: at each fraction, after which to go on to the next.

    Returns:
        Whether the tolerance was reached.
    """
    found = np.zeros_like(r)
    common = {"alpha": _LOOSE_ALPHA, "max_factorisations": max_factorisations}
    for fraction in _FRACTIONS:
        part_of_it = problem._replace(mu=fraction * problem.mu)
        proximal_point(part_of_it, found, tolerance=_ON_THE_WAY, history=[], **common)
    reached = proximal_point(problem, found, tolerance=tolerance, history=history, **common)
    r[:] = found
    return reached
