# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Semismooth Newton on velocities and impulses of a monolithic step (`coupled_step.py`).

A point that its law holds (contact, stick, a perfect bond) has a multiplier for its impulse, so
that constraints are exact, not penalties.

A correction is shortened where it would raise what is left. That is taken with the laws' answers
for impulses, so that every inequality is kept: |R + H S| over the free unknowns, and S - r, how far
the answers are from the impulses that were asked with: what held points are apart, times the bulk's
stiffness.

The next correction is taken at the impulses r, not at the answers. A bond at its strength whose
multiplier has grown beyond it answers with what it bears; linearised there it would count as sound,
its multiplier would grow again, and the iteration would stay where it is, with all branches the
same and the balance unfound. With r it opens. So with lips that are pulled: r says that they part.
Along a path, whose load lets no bond grow further than it may, it is taken at the answers: at r
some states were 4e-4 of the largest load off an independent arc-length solution, at the answers
2e-6.

Two facets that meet at a node and have turned by different angles have different gaps where their
lips have slid, and so have two nodes that a search finds on each other's facets: one bears all, and
the other opens by next to nothing. The multiplier of the other then has to fall to zero, by that
next to nothing times 1 / p in each iteration: where little is left and iterations stall, p becomes
smaller. Along a path it is so from the start: iterations that stall would shorten the next step.

The iteration is quadratic near its end and may go round in circles far from it, where contact alone
holds slender bodies or slips: `augmented_lagrangian.py` then finds who is in contact.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from xper_fx.bulk.coupled_step import Correction, CoupledStep
from xper_fx.bulk.sparse_direct import SingularMatrixError
from xper_fx.bulk.step_rounding import noise, rounding

logger = logging.getLogger(__name__)

# p of the points' springs, and where iterations stall near the end.
_PROXIMAL, _FIRM = 1e-3, 1e-6
# Lengths of a correction that are tried, and what is left of how many iterations it may not exceed.
_LENGTHS, _MEMORY = (1.0, 0.5, 0.25, 0.1), 3
# Relative difference of what is left from what two iterations ago was, at which it is the same.
_AGAIN = 0.1
# Iterations after which more may be left, and how much beside the tolerance: bonds that flip
# between loading and unloading may go round in circles too small to matter.
_PATIENCE, _ROUND = 7, 100.0
# What may be left, relative, when internal variables of turning points follow for the first time.
_NEAR = 1e-3
# How many times as many iterations there may be where each changes these variables.
_LONGEST = 3
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
_LOOSE = "a body that nothing holds moves by {:.3g} m, more than the size of the scene"
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
        self._answers: list[np.ndarray] = []
        self._most = self.left = np.inf
        self.failure = ""

    def run(self, tolerance: float, most: int) -> bool:
        """Whether what is left came within the tolerance in that many iterations at most.

        Impulses are then the laws' answers.
        """
        step = self._step
        self._answers = step.impulses_of_points()
        self.failure = self._iterate(tolerance, most)
        step.set_impulses(self._answers)
        return not self.failure

    def _iterate(self, tolerance: float, most: int) -> str:
        """What failed, empty if nothing has; see `run`."""
        step, history, small = self._step, [], False
        firm = step.growth is not None and step.frames_differ
        count, last, proximal = 0, most, _FIRM if firm else _PROXIMAL
        while count < last:
            count += 1
            try:
                correction = step.correction(proximal)
            except SingularMatrixError:
                return _SINGULAR
            if correction is None:
                return _NO_LOAD
            best = None
            start = step.velocity, step.loading.time, step.impulses_of_points()
            for length in _LENGTHS:
                merit = self._go(start, correction, length)
                if length == 1.0 and _to_and_fro(history, merit):
                    continue
                if best is None or merit < best[0]:
                    best = merit, length
                if not history or merit < max(history[-_MEMORY:]):
                    break
            if best[1] != length:
                self._go(start, correction, best[1])
            history.append(best[0])
            if not np.isfinite(best[0]):
                return step.flipped or _NOT_FINITE
            reference, floor = step.size(), rounding(step)
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
            small = self._most <= max(allowed * reference, floor) or reference <= noise(step)
            if small and best[1] == 1.0 and abs(step.growth_left()) <= _GROWN:
                if step.evolve() <= tolerance:
                    return self._loose()
                history.clear()
                last = min(count + most, _LONGEST * most)
            elif step.turns and best[1] == 1.0 and self._most <= _NEAR * reference:
                if step.evolve() > tolerance:
                    history.clear()
                    last = min(last + 1, _LONGEST * most)
            elif best[0] > _ASTRAY * reference:
                return _NOT_FINITE
            elif _stalls(history):
                # flips too small to matter, which shorter steps of a path have too, and gaps of
                # lips that have turned apart
                for_good = step.turns or step.descends or step.growth is not None
                little = self.left <= _ROUND * tolerance and (for_good or step.contacts_known)
                if little and abs(step.growth_left()) <= _GROWN and step.evolve() <= tolerance:
                    return self._loose()
                if proximal == _FIRM or self.left > _NEAR or not step.frames_differ:
                    return self._short(small) or _STUCK
                proximal = _FIRM
                history.clear()
        return self._short(small) or _SLOW.format(last)

    def _loose(self) -> str:
        """What is wrong with where bodies are, where forces balance."""
        moved = self._step.moved_too_far()
        return _LOOSE.format(moved) if moved > 0.0 else ""

    def _short(self, small: bool) -> str:
        """What is wrong with the growth where little is left."""
        left = self._step.growth_left()
        return _NOT_GROWN.format(1.0 + left) if small and abs(left) > _GROWN else ""

    def start_from(
        self, time: float, velocity: np.ndarray, impulses: Sequence[np.ndarray] | None = None
    ) -> None:
        """Take a state to start from: its loads, and the laws' answers to it.

        Args:
            time: of the loads (s).
            velocity: of all unknowns, shape (num_dofs,), m/s.
            impulses: of each group, shape (n, components), N s; None for the present ones.
        """
        step = self._step
        step.move(velocity, time)
        if impulses is not None:
            step.set_impulses(impulses)
        step.set_impulses(step.answers())

    def _answers_to(self, impulses: list[np.ndarray]) -> list[np.ndarray]:
        """Take impulses of each group, and ask the laws."""
        self._step.set_impulses(impulses)
        return [answer.copy() for answer in self._step.answers()]

    def _go(self, start, correction: Correction, length: float) -> float:
        """Take the state at a length of a correction from a start.

        Returns:
            What is left there; `_most` is its largest entry.
        """
        (velocity, time, impulses), step = start, self._step
        step.move(velocity + length * correction.velocity, time + length * correction.time)
        changes = zip(impulses, correction.impulses, strict=True)
        asked = [old + length * change for old, change in changes]
        along_path = step.growth is not None
        if along_path:
            asked = self._answers_to(asked)
        self._answers = self._answers_to(asked)
        if along_path:
            step.set_impulses(self._answers)
        step.impulses = step.on_unknowns(self._answers)
        balance = step.balance()
        total, most = step.dot(balance, balance), float(np.abs(balance).max(initial=0.0))
        apart = 0.0
        for answer, own in zip(self._answers, asked, strict=True):
            apart += float(np.vdot(answer - own, answer - own))
            most = max(most, float(np.abs(answer - own).max(initial=0.0)))
        self._most = step.ranks.max(most)
        left = float(np.sqrt(step.ranks.sum(apart) + total))
        return left if np.isfinite(left) else np.inf


def _to_and_fro(history: list[float], merit: float) -> bool:
    """Whether as much is left as two iterations ago: two sets of branches take turns."""
    return len(history) > 1 and abs(merit - history[-2]) <= _AGAIN * history[-2]


def _stalls(history: list[float]) -> bool:
    """Whether the last iterations have got nowhere."""
    if len(history) <= _STALLED:
        return False
    return min(history[-_STALLED:]) > _PROGRESS * min(history[:-_STALLED])
