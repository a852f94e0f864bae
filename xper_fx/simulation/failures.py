# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors that end a run at a step; the state before it is saved before they are raised."""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from xper_fx.bulk.state import StepOutcome
from xper_fx.simulation.attempt import StepAttempts
from xper_fx.simulation.not_finite import source_of_not_finite
from xper_fx.simulation.restartable import Restartable
from xper_fx.simulation.turned_bonds import TurnedBonds
from xper_fx.support.errors import ConvergenceError, NotFiniteError, SmallStrainError


def require_finite(simulation: Restartable, source: str | None, size: float) -> None:
    """Raise a NotFiniteError if something in a step of size h (s) gave NaN or infinity.

    Args:
        simulation: at the start of the step.
        source: what gave it, None if all is finite.
        size: h (s).
    """
    if source is not None:
        number, time = simulation.step_number + 1, simulation.time
        raise NotFiniteError(number, time, size, source, simulation.save_state())


def require_small_turns(simulation: Restartable, turned: TurnedBonds | None, size: float) -> None:
    """Raise a SmallStrainError if bonds have turned too far in a step of size h (s)."""
    if turned is not None:
        number, time = simulation.step_number + 1, simulation.time
        raise SmallStrainError(number, time, size, *turned, simulation.save_state())


def give_up(
    simulation: Restartable, attempts: StepAttempts, outcome: StepOutcome | None, size: float
) -> NoReturn:
    """Raise the error of a step that does not converge, with what may help.

    Args:
        simulation: at the start of the step.
        attempts: the last of which has failed.
        outcome: of the last attempt, None if it went too far.
        size: its h (s).

    Raises:
        NotFiniteError: if it is known what gave NaN or infinity.
        ConvergenceError: otherwise.
    """
    model, residual, newton, failure = simulation.model, np.nan, np.nan, ""
    if outcome is not None:
        residual, newton, failure = outcome.residual, outcome.newton_residual, outcome.failure
        if model.ranks.alone:
            source = source_of_not_finite(
                model.scene, model.bulk, model.interactions, simulation.state, outcome, size
            )
            require_finite(simulation, source, size)
    helps = attempts.advice(residual, newton, simulation.tolerance, simulation.path)
    number, time = simulation.step_number + 1, simulation.time
    raise ConvergenceError(
        number, time, size, (residual, newton), simulation.save_state(), *helps, failure=failure,
        cut=None if simulation.path is None else simulation.path.shortest,
    )  # fmt: skip
