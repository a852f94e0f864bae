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

import numpy as np

from xper_fx.nscd.friction.blocks import BlockProblem
from xper_fx.nscd.friction.error import natural_error
from xper_fx.nscd.friction.gauss_seidel import sweep
from xper_fx.nscd.local_solvers import LocalSolver

_SWEEPS, _MEMORY = 16, 10
_ASTRAY = 4.0
# Ridge of the least-squares problem, relative to its diagonal.
_RIDGE = 1e-12
# The error has to fall by this factor within so many mixings.
_FALL, _WITHIN = 2.0, 12


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
    point, best = r.copy(), np.inf
    residuals, images = [], []
    errors = []
    for _ in range(0, max_sweeps, _SWEEPS):
        image = point.copy()
        sweep(problem, local, image, tolerance=0.0, max_sweeps=_SWEEPS)
        error = natural_error(problem, image)
        errors.append(error)
        if error < best:
            best = error
            r[:] = image
        if not error > tolerance:
            break
        if len(errors) > _WITHIN and min(errors) > min(errors[:-_WITHIN]) / _FALL:
            break
        if error > _ASTRAY * best:
            residuals.clear()
            images.clear()
            point = r.copy()
            continue
        residuals.append((image - point).ravel())
        images.append(image.ravel())
        del residuals[: -_MEMORY - 1], images[: -_MEMORY - 1]
        point = image
        if len(residuals) > 1:
            df, dg = np.diff(residuals, axis=0), np.diff(images, axis=0)
            normal = df @ df.T
            normal[np.diag_indices(len(df))] *= 1.0 + _RIDGE
            try:
                gamma = np.linalg.solve(normal, df @ residuals[-1])
            except np.linalg.LinAlgError:
                continue
            point = image - (gamma @ dg).reshape(image.shape)
    history += errors
    return best <= tolerance
