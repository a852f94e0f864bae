# SPDX-License-Identifier: LGPL-3.0-or-later
"""The stresses asked of a cell, along the iterations of a step.

With interactions the macroscopic strain is corrected only once they have answered, and no more
when what is missing is the error of the impulses.
"""

from __future__ import annotations

from xper_fx.bulk.force_balance import InBalance

# What an answer of the interactions may be blurred by: Newton's correction on the bodies beside
# the strain that was answered, the error of the impulses beside the stress that was missing.
_LITTLE = 0.1
# Relative stress that may be rounding, and tells nothing of the answer.
_NOISE = 1e-7
# An error that falls less than this in an iteration is what the impulses' error leaves.
_STALLED = 0.5


class StressBalance(InBalance):
    """How far the stresses are those asked for; see `InBalance`.

    Args:
        bulk: the cell, with components driven by stress.
        tolerance: relative error that they are held to.
    """

    settled = False

    def __init__(self, bulk, tolerance: float):
        self._bulk, self._tolerance = bulk, tolerance
        self.error = 0.0

    @property
    def missing(self) -> bool:
        """Whether the last iterate leaves something to correct."""
        return self.error > self._tolerance

    def assess(self, inverse, velocity, previous, residual, internal, step, newton) -> None:
        """See `InBalance`; the inverse learns from how interactions answered."""
        bulk, before = self._bulk, self.error
        answered = velocity - previous
        answered[: bulk.unknowns.macroscopic.start] = 0.0
        clear = newton * bulk.norm(velocity) <= _LITTLE * bulk.norm(answered)
        telling = before > max(self._tolerance / _LITTLE, _NOISE)
        inverse.learn(velocity, residual, trusted=telling and clear)
        self.error = bulk.imbalance(residual, internal, step)
        stalled = before > self._tolerance and self.error > _STALLED * before
        self.worse = before > self._tolerance and self.error > before
        if self.worse:
            inverse.unlearn()
        self.settled = self.error <= (self._tolerance / _LITTLE if stalled else self._tolerance)
