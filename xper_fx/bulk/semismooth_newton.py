# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Semismooth Newton on velocities and impulses of a monolithic step (`coupled_step.py`).

A point that its law holds (contact, stick, a perfect bond) has a multiplier for its impulse, so
that constraints are exact, not penalties.

A correction is shortened where it would raise what is left. That is taken with the laws' answers
for impulses, so that every inequality is kept: |R + H r| over the free unknowns, and the change of
the answers when they are asked again, which is what held points are apart, times the bulk's
stiffness.

The iteration is quadratic near its end and may go round in circles far from it, where contact alone
holds slender bodies or slips: `augmented_lagrangian.py` then finds who is in contact.
"""

from __future__ import annotations

import logging

import numpy as np

from xper_fx.bulk.coupled_step import Correction, CoupledStep
from xper_fx.bulk.sparse_direct import SingularMatrixError

logger = logging.getLogger(__name__)

# p of the points' springs.
_PROXIMAL = 1e-3
# Lengths of a correction that are tried, and what is left of how many iterations it may not exceed.
_LENGTHS, _MEMORY = (1.0, 0.5, 0.25, 0.1), 3
# Iterations after which more may be left, and how much beside the tolerance: bonds that flip
# between loading and unloading may go round in circles too small to matter.
_PATIENCE, _ROUND = 7, 100.0
# Iterations within which what is left has to become less than a share of the least before.
_STALLED, _PROGRESS = 6, 0.7
# Relative error of the growth that a step is asked for.
_GROWN = 1e-6
# Growth of what is left at which an iteration has gone astray.
_ASTRAY = 1e9
# What may fail.
_SINGULAR = "the matrix of bodies and interactions cannot be factorised: something hangs by nothing"
_NO_LOAD = "no load keeps all bonds within what the step may open or dissipate"
_NOT_FINITE = "iterates run away"
_STUCK = "Newton's method goes round in circles"
_SLOW = "Newton's method takes more than {} iterations"
_NOT_GROWN = "forces balance, but with {:.3g} times what the step is to open or dissipate"


class SemismoothNewton:
    """The iteration of a step.

    Args:
        step: whose unknowns it changes.

    Attributes:
        left: what is left, relative to the largest nodal impulse.
        failure: why the last run has not converged, in words.
    """

    def __init__(self, step: CoupledStep):
        self._step = step
        self._apart = 0.0, 0.0
        self._most = self.left = np.inf
        self.failure = ""

    def run(self, tolerance: float, most: int) -> bool:
        """Whether what is left came within the tolerance in that many iterations at most."""
        self.failure = self._iterate(tolerance, most)
        return not self.failure

    def _iterate(self, tolerance: float, most: int) -> str:
        """What failed, empty if nothing has; see `run`."""
        step, history, small = self._step, [], False
        for count in range(1, most + 1):
            try:
                correction = step.correction(_PROXIMAL)
            except SingularMatrixError:
                return _SINGULAR
            if correction is None:
                return _NO_LOAD
            best = None
            start = step.velocity, step.loading.time, step.impulses_of_points()
            for length in _LENGTHS:
                self._go(start, correction, length)
                merit = self._merit()
                if best is None or merit < best[0]:
                    best = merit, length
                if not history or merit < max(history[-_MEMORY:]):
                    break
            if best[1] != length:
                self._go(start, correction, best[1])
                self._merit()
            history.append(best[0])
            if not np.isfinite(best[0]):
                return _NOT_FINITE
            reference, floor = step.size(), step.rounding()
            self.left = self._most / reference if reference > 0.0 else 0.0
            logger.debug(
                "iteration %d: length %g, %.2e left, growth %.1e, %d points held",
                count,
                best[1],
                self.left,
                step.growth_left(),
                step.num_held(),
            )
            allowed = tolerance * (1.0 if count <= _PATIENCE else _ROUND)
            small = self._most <= max(allowed * reference, floor) or reference <= step.noise()
            if small and best[1] == 1.0 and abs(step.growth_left()) <= _GROWN:
                if step.interactions is None or step.interactions.evolve(step.slots) <= tolerance:
                    return ""
                history.clear()
            elif best[0] > _ASTRAY * reference:
                return _NOT_FINITE
            elif _stalls(history):
                return self._short(small) or _STUCK
        return self._short(small) or _SLOW.format(most)

    def _short(self, small: bool) -> str:
        """What is wrong with the growth where little is left."""
        left = self._step.growth_left()
        return _NOT_GROWN.format(1.0 + left) if small and abs(left) > _GROWN else ""

    def start_from(self, time: float, velocity: np.ndarray) -> None:
        """Take a state to start from: its loads, and the laws' answers to it."""
        self._step.move(velocity, time)
        self._answer()

    def _go(self, start, correction: Correction, length: float) -> None:
        """The state at a length of a correction from a start; the laws answer there."""
        velocity, time, impulses = start
        self._step.move(velocity + length * correction.velocity, time + length * correction.time)
        changes = zip(impulses, correction.impulses, strict=True)
        self._step.set_impulses([old + length * change for old, change in changes])
        self._answer()
        self._apart = self._answer()

    def _answer(self) -> tuple[float, float]:
        """Impulses become the laws' answers, which keep every inequality.

        Returns:
            Sum of squares and largest entry of their change (N s), of this rank's points.
        """
        total, most, step = 0.0, 0.0, self._step
        answers = step.answers()
        for old, answer in zip(step.impulses_of_points(), answers, strict=True):
            apart = answer - old
            total += float(np.vdot(apart, apart))
            most = max(most, float(np.abs(apart).max(initial=0.0)))
        step.set_impulses(answers)
        return total, most

    def _merit(self) -> float:
        """What is left; `_most` is its largest entry."""
        step = self._step
        step.impulses = step.on_unknowns(step.impulses_of_points())
        balance = step.balance()
        self._most = step.ranks.max(max(self._apart[1], float(np.abs(balance).max(initial=0.0))))
        return float(np.sqrt(step.ranks.sum(self._apart[0]) + step.dot(balance, balance)))


def _stalls(history: list[float]) -> bool:
    """Whether the last iterations have got nowhere."""
    if len(history) <= _STALLED:
        return False
    return min(history[-_STALLED:]) > _PROGRESS * min(history[:-_STALLED])
