# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear Gauss-Seidel over interaction points (Jean 1999; Perales et al. 2010, section 3.4).

**When it stops.** The change of the impulses in one sweep, |dr| / |r|, understates the error:
with sweeps that contract by rho the error left is about |dr| rho / (1 - rho). rho is measured on
the last sweeps, and it is this estimate that `tolerance` bounds. Beside it stands the largest
change of traction in the last sweep, in Pa.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import get_num_threads

from xper_fx.nscd.exchange import sweep_kernel
from xper_fx.nscd.interactions import Interactions

# Sweeps over which the contraction is measured.
_WINDOW = 4


class SolveReport(NamedTuple):
    """How a solve ended.

    Attributes:
        converged: whether the estimated error is within the tolerance.
        sweeps: sweeps made.
        residual: estimated relative error of the impulses (module docstring).
        traction_change: largest change of a traction in the last sweep (Pa).
    """

    converged: bool
    sweeps: int
    residual: float
    traction_change: float


def estimated_error(changes: list[float]) -> float:
    """Relative error left, from the relative changes of the sweeps so far."""
    last = changes[-1]
    if last == 0.0:
        return 0.0
    window = min(_WINDOW, len(changes) - 1)
    if window == 0:
        return np.inf
    rho = (last / changes[-1 - window]) ** (1.0 / window)
    return last * max(1.0, rho / (1.0 - rho)) if rho < 1.0 else np.inf


def solve(
    interactions: Interactions,
    velocity: np.ndarray,
    *,
    tolerance: float = 1e-4,
    max_sweeps: int = 10_000,
    relaxation: float = 1.0,
    num_threads: int | None = None,
) -> SolveReport:
    """Find the impulses of the step; `velocity` becomes the end velocity.

    Args:
        interactions: points after `begin_step`, whose impulses are the first guess.
        velocity: shape (num_slots * dim,), the free velocity on entry, v_free + w H r on return.
        tolerance: bound on the estimated relative error of the impulses.
        max_sweeps: sweeps after which to give up.
        relaxation: factor on the change of an impulse where its law is locally linear, in (0, 2).
        num_threads: threads to use; all that Numba has if not given. Results do not depend on it
            beyond the rounding of the residual.

    Returns:
        The report; not converged is reported, not raised.
    """
    dim, groups = interactions.dim, interactions.groups
    parallel = (num_threads or get_num_threads()) > 1
    sweeps = []
    for g in groups:
        kernel = sweep_kernel(g.kernels, dim, g.points.nodes.shape[2], g.block_size, parallel)
        arguments = (
            g.ordering.tile_offsets, g.ordering.color_offsets, velocity, g.couplings, g.impulse,
            g.compliance, g.inverse_area, g.parameters, g.terms, g.details, relaxation,
        )  # fmt: skip
        sweeps.append((kernel, arguments))
    interactions.add_velocity(velocity)
    changes: list[float] = []
    for count in range(1, max_sweeps + 1):
        changed, total, largest = 0.0, 0.0, 0.0
        for kernel, arguments in sweeps:
            a, b, m = kernel(*arguments)
            changed, total, largest = changed + a, total + b, max(largest, m)
        changes.append(np.sqrt(changed / total) if total > 0.0 else np.sqrt(changed))
        error = estimated_error(changes)
        traction = np.sqrt(largest) / interactions.step_size
        if error <= tolerance:
            return SolveReport(True, count, error, traction)
        if not np.isfinite(changed):
            break
    return SolveReport(False, len(changes), changes[-1] if changes else 0.0, 0.0)
