# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss-Seidel by colours: threads visit contacts that share no body at the same time.

Within a colour no contact reads what another writes, so that the impulses are those of the serial
sweep in the same order, up to rounding, and the same bits whatever the number of threads. Sums over
contacts, which decide when to stop, are made by one thread. Each colour of each sweep costs the
threads a meeting: two take 0.65 of the time of one at 96 000 contacts in 2D, but 1.8 times as long
at 7000.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import prange

from xper_fx.cache import njit
from xper_fx.nscd.friction.blocks import BlockProblem
from xper_fx.nscd.friction.error import residual_kernel
from xper_fx.nscd.friction.gauss_seidel import UNRELAXED, Sweeps, factors_of, visit_kernel
from xper_fx.nscd.local_solvers import LocalSolver

# The change of a sweep at which the error is computed, in units of the error wanted; also every so
# many sweeps.
_WORTH, _LOOK = 2.0, 16


@cache
def _kernels(dim: int, local: LocalSolver, relaxed: bool):
    visit, squared = visit_kernel(dim, local, relaxed), residual_kernel(dim)

    @njit(parallel=True, nogil=True, fastmath={"contract"}, error_model="numpy")
    def sweep(colors, problem, factors, r, omega, changes):
        for color in range(len(colors) - 1):
            for a in prange(colors[color], colors[color + 1]):
                changes[a] = visit(np.uintp(a), problem, factors, r, omega)

    @njit(parallel=True, nogil=True, fastmath={"contract"}, error_model="numpy")
    def errors(problem, r, out):
        for a in prange(len(r)):
            out[a] = squared(a, a + 1, problem, r)

    return sweep, errors


def sweep(
    problem: BlockProblem,
    colors: np.ndarray,
    local: LocalSolver,
    r: np.ndarray,
    *,
    tolerance: float,
    max_sweeps: int,
    relaxation: float = 1.0,
) -> Sweeps:
    """Sweep until the error is within the tolerance, with Numba's threads.

    Args:
        problem: the stored problem, sorted by colour.
        colors: shape (num_colors + 1,), first contact of each colour.
        local, r, tolerance, max_sweeps, relaxation: as in `gauss_seidel.sweep`.
    """
    run, errors = _kernels(problem.dim, local, relaxation != 1.0)
    factors = factors_of(problem, local)
    size_q = np.linalg.norm(problem.q) or 1.0
    each = np.empty(len(r))
    worth, history, reached, count = _WORTH * tolerance, [], False, 0
    for count in range(1, max_sweeps + 1):
        omega = relaxation if count > UNRELAXED else 1.0
        run(colors, problem, factors, r, omega, each)
        change = np.sqrt(each.sum()) / size_q
        if not np.isfinite(change):
            break
        if change <= worth or count % _LOOK == 0 or count == max_sweeps:
            errors(problem, r, each)
            error = np.sqrt(each.sum()) / size_q
            history.append((count, error))
            reached = bool(error <= tolerance)
            if reached:
                break
            worth = change * tolerance / error
    return Sweeps(np.array([count]), np.array([reached]), history, count * len(r))
