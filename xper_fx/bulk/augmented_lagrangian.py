# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Who is in contact, by the method of multipliers: slow and sure where Newton's goes in circles.

With given impulses m in the laws' answers, a step asks

    R(v) + H S(H^T v, m) = 0.

Without friction, of bonds that do not soften and a bulk that is stable, that is where a convex
function of v has its least value: each contact is a spring on one side, of the stiffness by which
its law tells branches, and nothing goes in circles. Newton's method with a line search finds it in
finitely many iterations (the slope along a correction, -dv . (R + H S), grows with its length, so
that its zero is bracketed). Then m becomes S, and so on: the proximal point algorithm on the
impulses (Rockafellar 1976), whose error falls by the ratio of that spring to the spring and the
structure together; structures are soft. With friction or softening it is the same, without a
theorem: corrections may then go round in circles between stick and slip, with the balance nearly
found. They are left after some; the impulses that the laws answer there are nearer to the solution,
and the circles end (an inexact proximal point algorithm).

Where bonds soften the function curves down along some directions, and a correction, which asks for
the state at which it is flat, may lead up along one. The other way leads down, and is taken. Where
such corrections find no balance twice, the load may have no equilibrium: the step is given up, to
be cut. Where it cannot be cut any more, springs that push are turned round in such corrections, so
that each leads down, and states are followed downwards to one in balance: the load has snapped.
A softening bond may also open and close with the given impulses in turns. The impulses then
go away from a state that was nearly found; Newton's method goes on from the nearest one. All this
is for loads that are given, without inertia and viscosity. Else a shorter step has a state near the
last one, and what lies down there may be far away, beyond a snap.

Between two changes of branches the impulses of contacts that hold each other round a node creep by
steps d of one direction that hardly shrink, as the load that such contacts bear by themselves is
nearly free. Where the last two steps have one direction the next is stretched to where they would
end (Aitken's relaxation in the form of Irons and Tuck 1969),

    l' = -l d_old . (d - d_old) / |d - d_old|^2,   m' = m + l' d,

d being the change for a length of 1; twice as far each time where they do not shrink.

It leaves an error of some 1e-4, from which a few iterations of Newton's method on velocities and
impulses together are quadratic (`semismooth_newton.py`).
"""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np

from xper_fx.bulk.coupled_step import Correction, CoupledStep
from xper_fx.bulk.sparse_direct import SingularMatrixError
from xper_fx.bulk.step_rounding import noise, rounding
from xper_fx.support.ranks import Ranks

logger = logging.getLogger(__name__)

# Changes of the given impulses, and corrections for each.
_OUTER, _INNER = 300, 12
# Corrections for each where states are followed down a snap.
_DOWN = 100
# How often in a row corrections that go in circles are left while impulses get no nearer, and the
# share of the smallest change before below which they do. Lips that have turned apart may pass
# impulses on to each other for long: there it counts where forces balance, too.
_CIRCLES, _NEARER = 20, 0.9
# How many rounds get no nearer before all are left: where forces balance in some, and stretched
# changes lead back, impulses go in circles, too. Those that creep get nearer within fewer.
_STANDS = 60
# How many rounds in a row find no balance before all are left. Those that find contacts in the end
# have found some within 6, within 12 where ductile halves part; the others go on for 25 to 60
# rounds, as loads that nothing holds.
_UNFOUND = 15
# How often they may be left after one of them led up: where that does not end soon, it never ends.
# Friction alone leads up as well, as its springs are not symmetric.
_LEFT_UP, _FRICTION_LED_UP = 1, 2
# Cosine between changes that creep along one direction, and how far one may be stretched.
_CREEP, _FURTHEST = 0.95, 1e4
# Error of the balance for given impulses beside the largest nodal impulse, and beside the change
# of the impulses that is good enough.
_BALANCED, _OF_CHANGE = 1e-6, 0.1
# Part of the load at which bonds would open with which contacts are looked for in a first step.
_LITTLE = 0.1
# Slope at which a length is good, beside that at its start, and how many lengths are tried.
_FLAT, _TRIED = 0.5, 12


class Balance(NamedTuple):
    """What the corrections for given impulses come to."""

    found: bool  #: whether velocities in balance were found, or only nearly
    led_up: bool  #: whether a correction led up


def find_contacts(step: CoupledStep, good: float, most: float = np.inf) -> float:
    """Bring velocities and impulses of a step near to its solution.

    Args:
        step: begins at its present velocities, loads and impulses.
        good: change of the impulses at which they are found, beside the largest nodal impulse.
        most: corrections after which no other change is begun.

    Returns:
        The least change of balanced velocities, beside the largest nodal impulse, or `good` if it
        came down to that; the step is where it was. Infinite if all others are of no use.
    """
    follows = step.growth is not None and not step.growth.begins
    if step.growth is not None and not follows and not _load_a_little(step):
        return np.inf
    begun, most_up = step.corrections, _LEFT_UP if step.softens else _FRICTION_LED_UP
    circles, stands, unfound, up, least, length, last = 0, 0, 0, 0, np.inf, 1.0, np.zeros(0)
    best: tuple[float, np.ndarray, float, list[np.ndarray]] | None = None
    for outer in range(1, _OUTER + 1):
        if step.corrections - begun >= most:
            break
        given = step.impulses_of_points()
        error = min(_BALANCED, _OF_CHANGE * good)
        balance = _balance(step, given, error, outer == 1, follows)
        if balance is None:
            break
        balanced = balance.found
        up += balance.led_up and not (balanced or step.descends)
        moved = [answer - m for answer, m in zip(step.answers(), given, strict=True)]
        now = np.concatenate([np.zeros(0), *(d.ravel() for d in moved)])  # a rank may have none
        change = step.ranks.max(float(np.abs(now).max(initial=0.0)))
        may_creep = balanced and not step.turns
        nearer = change < _NEARER * least
        circles = 0 if may_creep or nearer else circles + 1
        stands = 0 if nearer else stands + 1
        unfound = 0 if balanced or (nearer and step.descends) else unfound + 1
        least = min(least, change)
        if circles > _CIRCLES or stands > _STANDS or unfound > _UNFOUND or up > most_up:
            break
        size = step.size()
        logger.debug("impulses %d change by %.2e of %.2e N s", outer, change, size)
        length, last = _stretched(length, last, now, step.ranks) if outer > 1 else 1.0, now
        step.set_impulses([m + length * d for m, d in zip(given, moved, strict=True)])
        if balanced and change <= max(good * size, noise(step)):
            return good
        if balanced and step.may_jump and (best is None or change < best[0] * size):
            best = change / size, step.velocity, step.loading.time, step.impulses_of_points()
    if best is None:
        return np.inf
    step.move(best[1], best[2])
    step.set_impulses(best[3])
    return best[0]


def _stretched(length: float, last: np.ndarray, now: np.ndarray, ranks: Ranks) -> float:
    """Length of the next change of the impulses (module docstring).

    Args:
        length: of the last one.
        last, now: changes for a length of 1, before the last one and after it (N s).
        ranks: that have shares of them.
    """
    turned = now - last
    products = (now @ last, now @ now, last @ last, last @ turned, turned @ turned)
    along, of_now, of_last, grows, of_turned = ranks.sum(np.array(products)).tolist()
    if along <= _CREEP * np.sqrt(of_now * of_last):
        return 1.0
    further = -length * grows / of_turned if grows < 0.0 else 2.0 * length
    return min(max(further, 1.0), _FURTHEST)


def _load_a_little(step: CoupledStep) -> bool:
    """Take a part of the load at which the first bond opens, whatever is in contact."""
    try:
        correction = step.correction(1.0)
    except SingularMatrixError:
        return False
    if correction is not None:
        step.move(step.velocity, step.loading.time + _LITTLE * correction.time)
    return correction is not None


def _balance(
    step: CoupledStep, given: list[np.ndarray], error: float, moves: bool, follows: bool
) -> Balance | None:
    """Look for the velocities in balance with the answers to given impulses.

    Args:
        step: changed.
        given: impulses of each group.
        error: of the balance, beside the largest nodal impulse.
        moves: whether prescribed motions are yet to be made, by a first correction of full length.
        follows: whether the load is to be found from the growth.

    Returns:
        What came of it; None if the corrections lead nowhere.
    """
    led_up = False
    for count in range(_DOWN if step.descends else _INNER):
        step.set_impulses(given)
        try:
            correction = step.correction(1.0, follows)
            if correction is None:
                return None
            line = _Line(step, correction)
            if (moves and count == 0) or follows:
                line.go(1.0)
            else:
                led_up |= line.shorten()
        except SingularMatrixError:
            return None
        left = step.ranks.max(float(np.abs(step.balance()).max(initial=0.0)))
        if not np.isfinite(left):
            return None
        size = step.size()
        if left <= max(error * size, rounding(step)) or size <= noise(step):
            return Balance(True, led_up)
    return Balance(False, led_up)


class _Line:
    """The states along a correction, for given impulses.

    Args:
        step: at the start of the line.
        correction: its direction.
    """

    def __init__(self, step: CoupledStep, correction: Correction):
        self._step, self._correction = step, correction
        self._velocity, self._time = step.velocity, step.loading.time

    def go(self, length: float) -> float:
        """Take the state at a length; the slope of the convex function there.

        It is infinite where cells or facets flip.
        """
        step, along = self._step, self._correction.velocity
        step.move(self._velocity + length * along, self._time + length * self._correction.time)
        step.impulses = step.on_unknowns(step.answers())
        slope = -step.dot(along, step.balance())
        return slope if np.isfinite(slope) else np.inf

    def shorten(self) -> bool:
        """Go to a length at which the slope is flat, the whole one or one within it, downwards.

        Returns:
            Whether the correction led up, so that the other way was taken.

        Raises:
            SingularMatrixError: that of springs that do not push cannot be factorised.
        """
        first = self.go(0.0)
        if self._step.descends and first > 0.0:
            self._correction = self._step.correction(1.0, convex=True)
            first = self.go(0.0)
        up = bool(self._step.may_jump and 0.0 < first < np.inf)
        if up:
            self._correction = self._correction._replace(velocity=-self._correction.velocity)
            first = -first
        last = self.go(1.0)
        low, high, at_low, at_high = 0.0, 1.0, first, last
        for tried in range(_TRIED):
            flat = abs(last) <= _FLAT * abs(first) if tried else last <= _FLAT * abs(first)
            if flat or first >= 0.0:
                return up
            length = low - at_low * (high - low) / (at_high - at_low)
            if tried % 3 == 2 or not np.isfinite(at_high):
                length = 0.5 * (low + high)
            last = self.go(length)
            if last > 0.0:
                high, at_high = length, last
            else:
                low, at_low = length, last
        return up
