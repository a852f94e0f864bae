# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss-Seidel sweeps accelerated by Anderson's mixing: no factorisation, a few vectors of memory.

Sixteen sweeps are a map g(r) whose fixed points are the solutions. From the last m differences of
f = g(r) - r and of g, the next point is (Anderson 1965; Walker and Ni 2011)

    r <- g(r) - dG gamma,   gamma = argmin |f - dF gamma|,

which is GMRES where the statuses of the contacts no longer change. Mixing may lead astray where
they do: when the error exceeds four times the least one met, the history is forgotten and the
iteration goes on from the best point.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.friction.blocks import BlockProblem
from xper_fx.nscd.friction.error import residual_kernel
from xper_fx.nscd.friction.gauss_seidel import factors_of, sweeps_kernel
from xper_fx.nscd.local_solvers import LocalSolver

SWEEPS, _MEMORY = 16, 10
_ASTRAY = 4.0
# Ridge of the least-squares problem, relative to its diagonal.
_RIDGE = 1e-12
_TINY = np.finfo(float).tiny
# The error has to fall by this factor within so many mixings.
_FALL, _WITHIN = 2.0, 12


@cache
def _kernel(dim: int, local: LocalSolver):
    sweeps_of, squared = sweeps_kernel(dim, local, False, False), residual_kernel(dim)

    @njit(nogil=True, error_model="numpy")
    def mix(offsets, columns, blocks, diagonal, factors, q, mu, r, size_q, tolerance, errors):
        """Errors of the mixings into `errors`, the best impulses into r; returns their number."""
        n = len(mu)
        whole = np.array([0, n])
        sweeps, converged = np.zeros(1, np.int64), np.zeros(1, np.bool_)
        no_history, dirty = np.zeros((2, 2)), np.ones(n, np.bool_)
        df, dg = np.empty((_MEMORY, n * dim)), np.empty((_MEMORY, n * dim))
        normal = np.empty((_MEMORY, _MEMORY))
        f, g = np.empty(n * dim), np.empty(n * dim)
        image, point = np.empty((n, dim)), r.copy()
        best, filled = np.inf, 0
        for number in range(len(errors)):
            image[:] = point
            dirty[:] = True
            sweeps_of(
                whole, offsets, columns, blocks, diagonal, factors, q, mu, image, 1.0, dirty, 0.0,
                SWEEPS, np.inf, sweeps, converged, no_history,
            )  # fmt: skip
            error = np.sqrt(squared(0, n, offsets, columns, blocks, q, mu, image, 1.0)) / size_q
            errors[number] = error
            if error < best:
                best = error
                r[:] = image
            if not error > tolerance:
                return number + 1
            if number >= _WITHIN and best > errors[: number + 1 - _WITHIN].min() / _FALL:
                return number + 1
            if error > _ASTRAY * best:
                filled = 0
                point[:] = r
                continue
            # the oldest difference makes room for the latest
            slot = (filled - 1) % _MEMORY
            for i in range(n * dim):
                gi = image.flat[i]
                fi = gi - point.flat[i]
                if filled > 0:
                    df[slot, i], dg[slot, i] = fi - f[i], gi - g[i]
                f[i], g[i] = fi, gi
            count = min(filled, _MEMORY)
            filled += 1
            point[:] = image
            if count == 0:
                continue
            for j in range(count):
                normal[slot, j] = normal[j, slot] = df[slot] @ df[j]
            matrix, right = normal[:count, :count].copy(), np.empty(count)
            for j in range(count):
                right[j] = df[j] @ f
                matrix[j, j] = matrix[j, j] * (1.0 + _RIDGE) + _TINY
            gamma = np.linalg.solve(matrix, right)
            if not np.isfinite(gamma).all():
                filled = 0
                continue
            for j in range(count):
                for i in range(n * dim):
                    point.flat[i] -= gamma[j] * dg[j, i]
        return len(errors)

    return mix


def solve(
    problem: BlockProblem,
    r: np.ndarray,
    *,
    tolerance: float,
    history: list,
    local: LocalSolver,
    max_sweeps: int,
) -> bool:
    """Mix until the error is within the tolerance or stops falling.

    Args:
        problem: the stored problem.
        r: shape (n, dim), first guess; the best impulses met on return.
        tolerance: bound on `error.natural_error`.
        history: the error of each mixing is appended.
        local: local solver of the sweeps.
        max_sweeps: sweeps after which to give up.

    Returns:
        Whether the tolerance was reached.
    """
    errors = np.full(max(max_sweeps // SWEEPS, 1), np.inf)
    size_q = np.linalg.norm(problem.q) or 1.0
    try:
        _kernel(problem.dim, local)(
            problem.offsets, problem.columns, problem.blocks, problem.diagonal,
            factors_of(problem, local), problem.q, problem.mu, r, size_q, tolerance, errors,
        )  # fmt: skip
    except np.linalg.LinAlgError:  # impulses beyond all bounds: what was found before stands
        pass
    errors = errors[np.isfinite(errors)]
    history += errors.tolist()
    return bool(errors.min(initial=np.inf) <= tolerance)
