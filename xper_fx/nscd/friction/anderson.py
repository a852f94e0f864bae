# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss-Seidel sweeps accelerated by Anderson's mixing (`nscd/algebra/anderson_mixing.py`).

Sixteen sweeps are a map whose fixed points are the solutions. Mixing may lead astray where statuses
of contacts change: when the error exceeds four times the least one met, the history is forgotten
and the iteration goes on from the best point.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.anderson_mixing import AndersonMixing
from xper_fx.nscd.friction.blocks import BlockProblem
from xper_fx.nscd.friction.error import residual_kernel
from xper_fx.nscd.friction.gauss_seidel import Iterate, Progress, Stop, factors_of, sweeps_kernel
from xper_fx.nscd.local_solvers import LocalSolver

SWEEPS, _MEMORY = 16, 10
_ASTRAY = 4.0
# The error has to fall by this factor within so many mixings.
_FALL, _WITHIN = 2.0, 12
_EPS = np.finfo(float).eps


@cache
def _kernel(dim: int, local: LocalSolver):
    sweeps_of, squared = sweeps_kernel(dim, local, False, False), residual_kernel(dim)

    @njit(nogil=True, error_model="numpy")
    def image(problem, factors, r):
        """r becomes its image; the square of its natural map, not yet over |q|."""
        done = Progress(np.zeros(1, np.int64), np.zeros(1, np.bool_), np.zeros((2, 2)))
        iterate = Iterate(r, factors, np.ones(len(r), np.bool_))
        sweeps_of(problem, iterate, 1.0, Stop(0.0, SWEEPS, np.inf), done)
        return squared(0, len(r), problem, r)

    return image


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
        problem: the stored problem, as one component.
        r: shape (n, dim), first guess; the best impulses met on return.
        tolerance: bound on `error.natural_error`.
        history: the error of each mixing is appended.
        local: local solver of the sweeps.
        max_sweeps: sweeps after which to give up.

    Returns:
        Whether the tolerance was reached.
    """
    kernel, size_q = _kernel(problem.dim, local), np.linalg.norm(problem.q) or 1.0
    factors = factors_of(problem, local)
    # impulses so large that their rounding hides q: there is no solution
    beyond = tolerance * size_q / (_EPS * np.abs(problem.diagonal).max())
    mixing = AndersonMixing(r.size, _MEMORY, 1)
    point, image, errors = r.copy(), r.copy(), []
    for _ in range(max(max_sweeps // SWEEPS, 1)):
        image[:] = point
        error = float(np.sqrt(kernel(problem, factors, image))) / size_q
        if not (np.isfinite(error) and np.abs(image).max() < beyond):
            break
        best = min(errors, default=np.inf)
        errors.append(error)
        history.append(error)
        if error < best:
            best = error
            r[:] = image
        if error <= tolerance:
            return True
        if len(errors) > _WITHIN and best > min(errors[:-_WITHIN]) / _FALL:
            break
        if error > _ASTRAY * best:
            mixing.forget()
            point[:] = r
        else:
            mixing.mix((image - point).ravel(), image.ravel(), point.reshape(-1))
    return False
