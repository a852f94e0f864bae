# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a committed step was."""

from __future__ import annotations

from typing import NamedTuple


class StepRecord(NamedTuple):
    """What a committed step was.

    Attributes:
        step: number, from 1.
        time: time at its end (s).
        size: h (s).
        sweeps, residual, traction_change: of the interaction solver.
        newton_iterations, newton_residual: of the bulk.
        energies: columns of the energy ledger (J; 2D: J/m).
    """

    step: int
    time: float
    size: float
    sweeps: int
    residual: float
    traction_change: float
    newton_iterations: int
    newton_residual: float
    energies: dict[str, float]
