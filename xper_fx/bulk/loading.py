# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads and prescribed motions at the end of a step, whose time may be unknown."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State
from xper_fx.bulk.step_equations import StepEquations

# Relative difference of the changes in both halves of a step at which loads are not linear in time.
_BENT = 1e-9
# Part of the step over which differences of such loads are taken.
_SHORT = 1e-6


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
        bends: whether `rates` has found loads or motions that are not linear in time.
    """

    def __init__(
        self, bulk: Bulk, equations: StepEquations, state: State, step: float, theta: float
    ):
        self._bulk, self._equations, self._state = bulk, equations, state
        self._step, self._theta, self.bends = step, theta, False
        self.set(state.time + step)

    def set(self, time: float) -> None:
        """Let the step end at a time (s)."""
        self.time = time
        self.external, self.wanted = self._at(time)
        self._equations.load(self.external)

    def rates(self) -> tuple[np.ndarray | float, np.ndarray]:
        """Change of the force impulse (N) and of the wanted velocities (m/s^2) with the time.

        By differences over h, exact where loads are linear in time. Over h a load that turns may
        change the other way, so that those of loads that bend are taken over a short time.
        """
        step = self._step
        whole, half = self._changes(step), self._changes(0.5 * step)
        values = self._theta * self.external, self.wanted
        bends = [
            np.abs(a - 2.0 * b).max(initial=0.0)
            > _BENT * max(np.abs(a).max(initial=0.0), np.abs(value).max(initial=0.0))
            for a, b, value in zip(whole, half, values, strict=True)
        ]
        self.bends = bool(self._bulk.ranks.max(float(any(bends))))
        if self.bends:
            step *= _SHORT
            whole = self._changes(step)
        force, motion = whole
        return force * (self._step / step), motion / step

    def _changes(self, later: float) -> tuple[np.ndarray, np.ndarray]:
        """Of the force impulse of a step (N s / h) and of the wanted velocities, in a time (s)."""
        external, wanted = self._at(self.time + later)
        return np.asarray(self._theta * (external - self.external)), wanted - self.wanted

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
