# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads and prescribed motions at the end of a step, whose time may be unknown."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State
from xper_fx.bulk.step_equations import StepEquations


class Loading:
    """Loads of a step that ends at a time to be set.

    Args:
        bulk: the bulk.
        equations: of the step, which are given the loads.
        state: at the start of the step.
        step: h by which velocities are defined (s).
        theta: weight of the end of the step.

    Attributes:
        time: at the end of the step (s).
        external: forces there (N).
        wanted: velocities at its end, those of the start where nothing is prescribed (m/s).
    """

    def __init__(
        self, bulk: Bulk, equations: StepEquations, state: State, step: float, theta: float
    ):
        self._bulk, self._equations, self._state = bulk, equations, state
        self._step, self._theta = step, theta
        self.set(state.time + step)

    def set(self, time: float) -> None:
        """Let the step end at a time (s)."""
        self.time = time
        self.external, self.wanted = self._at(time)
        self._equations.load(self.external)

    def rates(self) -> tuple[np.ndarray | float, np.ndarray]:
        """Change of the force impulse (N) and of the wanted velocities (m/s^2) with the time.

        By differences over h, exact where loads are linear in time.
        """
        external, wanted = self._at(self.time + self._step)
        force = self._theta * (external - self.external)
        return force, (wanted - self.wanted) / self._step

    def _at(self, time: float) -> tuple[np.ndarray | float, np.ndarray]:
        wanted, state = self._state.velocity.copy(), self._state
        self._bulk.prescribe(
            wanted,
            time,
            self._step,
            self._theta,
            state.displacement,
            state.velocity,
            time - state.time,
        )
        return self._bulk.external(time), wanted
