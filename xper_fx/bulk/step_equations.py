# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a step of the theta scheme asks of the bulk's velocities at its end."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State


class StepEquations:
    r"""The momentum balance of a step, with q1 = predictor + h theta v1.

    The residual is h F_ext - h F_int - C v - M (v1 - v0), forces weighted by theta at the end and
    1 - theta at the start; with the impulses of interactions it vanishes where motions are free.

    Args:
        state: at the start of the step.
        step: h (s).
        weight: theta, of each unknown's equation where they differ.

    Attributes:
        force_impulse: h times the weighted external forces (N s).
        predictor: q1 where v1 is zero (m).
    """

    def __init__(self, bulk: Bulk, state: State, step: float, weight: float | np.ndarray):
        self._bulk, self._state, self._step, self._weight = bulk, state, step, weight
        self.predictor = state.displacement + step * (1.0 - weight) * state.velocity
        self._past = step * (1.0 - weight) * (state.internal + bulk.viscous(state.velocity))

    def load(self, external: np.ndarray | float) -> None:
        """Set the external forces at the end of the step (N)."""
        weight = self._weight
        held = self._state.external
        self.force_impulse = self._step * (weight * external + (1.0 - weight) * held)
        self.start = self.force_impulse - self._past

    def displacement(self, velocity: np.ndarray) -> np.ndarray:
        """q1 (m) for end velocities v1 (m/s)."""
        return self.predictor + self._step * self._weight * velocity

    def residual(self, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The residual (N s) without impulses, and the internal forces (N), for v1."""
        bulk, state = self._bulk, self._state
        internal = bulk.internal(self.displacement(velocity))
        force = internal + bulk.viscous(velocity)
        momentum = bulk.momentum(velocity - state.velocity)
        return self.start - momentum - self._step * self._weight * force, internal
