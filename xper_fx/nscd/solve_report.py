# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a solver of the interactions says of a solve."""

from __future__ import annotations

from typing import NamedTuple


class SolveReport(NamedTuple):
    """How a solve ended.

    Attributes:
        converged: whether the estimated error is within the tolerance.
        sweeps: sweeps made.
        residual: estimated relative error of the impulses; of contacts of rigid bodies the
            relative violation of their laws (`nlgs.py`).
        traction_change: largest change of a traction in the last sweep (Pa).
        solver: name of the solver that found the impulses.
        reason: why this solver, and what else it did; empty if there was no choice.
        contraction: of the last sweeps, a sweep; 1 if unknown.
    """

    converged: bool
    sweeps: int
    residual: float
    traction_change: float
    solver: str = "nlgs"
    reason: str = ""
    contraction: float = 1.0
