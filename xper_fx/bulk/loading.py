# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Loads and prescribed motions at the end of a step, whose time may be unknown.

Along a path the time is found from changes of the loads f, by their rates df/dt. Where no load
moves there is none, and nothing on the way: a hold from a to b is one state of the loads, and a
path that comes to it from one side goes on at the other, as if the time in between were not there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State
from xper_fx.bulk.step_equations import StepEquations

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.driven_motion import DrivenMotion

# Of forces, of velocities of all unknowns, and of rigid bodies.
_Changes: TypeAlias = tuple[np.ndarray | float, np.ndarray, np.ndarray]
_NONE = np.zeros((0, 0))

# Part of a step whose change of linear loads is that part of the step's; no period divides it. And
# relative difference of the two at which loads are not linear in time.
_PART, _BENT = 0.5 * (3.0 - math.sqrt(5.0)), 1e-9
# Part of the step over which differences of such loads are taken.
_SHORT = 1e-6
# Relative difference of loads that are the same.
_SAME = 4.0 * np.finfo(float).eps
# How often the end of a hold is looked for in half of where it may be.
_HALVINGS = 60


class Loading:
    """Loads of a step that ends at a time to be set.

    Args:
        equations: of the step, which are given the loads.
        state: at the start of the step.
        step: h by which velocities are defined (s).
        theta: weight of the end of the step.
        rigid: motion of rigid bodies that are driven, None without any.

    Attributes:
        time: at the end of the step (s).
        external: forces there (N).
        wanted: velocities at its end, those of the start where nothing is prescribed (m/s).
        driven: those of rigid bodies, shape (2 n, dim), m/s and rad/s.
        held: time (s) within the step in which no load moves, as far as `rates` passed it by;
            negative where it leads back.
    """

    def __init__(
        self,
        bulk: Bulk,
        equations: StepEquations,
        state: State,
        step: float,
        theta: float,
        rigid: DrivenMotion | None = None,
    ):
        self._bulk, self._equations, self._state, self._rigid = bulk, equations, state, rigid
        self._step, self._theta = step, theta
        self._last, self.held = state.time, 0.0
        self.set(state.time + step)

    def set(self, time: float) -> None:
        """Let the step end at a time (s)."""
        self.time = time
        self.external, self.wanted, self.driven = self._at(time)
        self._equations.load(self.external)

    def rates(self) -> _Changes:
        """Change of the force impulse (N), the wanted and the driven velocities with the time.

        By differences over h, exact where loads are linear in time. Over h a load that turns may
        change the other way, so that those of loads that bend are taken over a short time. Where
        no load moves the time becomes the end of that, on the way from the last time asked at.
        """
        step = self._step
        whole, part = self._changes(step), self._changes(_PART * step)
        values = self._values()
        bends = [
            np.abs(_PART * a - b).max(initial=0.0)
            > _BENT * max(np.abs(a).max(initial=0.0), np.abs(value).max(initial=0.0))
            for a, b, value in zip(whole, part, values, strict=True)
        ]
        if self._bulk.ranks.max(float(any(bends))) > 0.0:
            step *= _SHORT
            whole = self._changes(step)
            if not self._moved(whole):
                step = -step
                whole = self._changes(step)
            if not self._moved(whole) and (time := self._after_hold()) is not None:
                step = math.copysign(step, time - self.time)
                self.set(time)
                whole = self._changes(step)
        self._last = self.time
        force, motion, driven = whole
        return force * (self._step / step), motion / step, driven / step

    def _values(self) -> _Changes:
        """What `_changes` has the changes of."""
        return self._theta * self.external, self.wanted, self.driven

    def _moved(self, changes: _Changes) -> bool:
        """Whether changes of forces or velocities, as of `_changes`, are more than rounding."""
        moved = [
            np.abs(change).max(initial=0.0) > _SAME * np.abs(value).max(initial=0.0)
            for change, value in zip(changes, self._values(), strict=True)
        ]
        return bool(self._bulk.ranks.max(float(any(moved))))

    def _after_hold(self) -> float | None:
        """Where loads move again that stand still at the present time; None if they do not.

        It is looked for no further away than the time itself, or the step.
        """
        now, came = self.time, self.time - self._last
        if came == 0.0:
            return None
        longest, later = max(abs(now), self._step), came
        while not self._moved(self._changes(later)):
            if abs(later) >= longest:
                return None
            later = math.copysign(min(2.0 * abs(later), longest), came)
        end = now + self._least_change(later)
        self.held += end - now
        if self._moved(self._changes(-came)):
            self.held -= self._least_change(-came)
        else:
            self.held += came
        return end

    def _least_change(self, later: float) -> float:
        """The part of a time (s) by whose end loads have changed that do not at its start."""
        same, other = 0.0, later
        for _ in range(_HALVINGS):
            middle = 0.5 * (same + other)
            if self._moved(self._changes(middle)):
                other = middle
            else:
                same = middle
        return same

    def turn_between(self, since: float, until: float) -> bool:
        """Whether loads turn or stand still between times (s) before and after the step's start."""
        short, start = _SHORT * self._step, self._state.time
        before = [since, start - short] if since < start - short else []
        rates = []
        for at in (*before, start, until - short):
            self.set(at)
            rates.append([np.ravel(change) for change in self._changes(short)])
        return any(self._along(a, b, rates) <= 0.0 for a, b in pairwise(rates))

    def go_on(self, before: float, now: float, later: float) -> bool:
        """Whether loads change from a time (s) to another one as they did before."""
        loads = [[np.ravel(load) for load in self._at(time)] for time in (before, now, later)]
        first, second = ([b - a for a, b in zip(*two, strict=True)] for two in pairwise(loads))
        return self._along(first, second, [first, second]) > 0.0

    def _along(self, a: Sequence, b: Sequence, among: Sequence) -> float:
        """a . b of changes of all kinds of loads, each by its largest one among some."""
        total, largest = self._bulk.ranks.sum, self._bulk.ranks.max
        of_kinds = zip(*among, strict=True)
        sizes = [largest(max(np.abs(r).max(initial=0.0) for r in kind)) for kind in of_kinds]
        kinds = zip(a, b, sizes, strict=True)
        return total(sum(np.vdot(x, y) / size**2 for x, y, size in kinds if size > 0.0))

    def _changes(self, later: float) -> _Changes:
        """Of the force impulse of a step (N s / h) and of given velocities, in a time (s)."""
        external, wanted, driven = self._at(self.time + later)
        change = np.asarray(self._theta * (external - self.external))
        return change, wanted - self.wanted, driven - self.driven

    def _at(self, time: float) -> _Changes:
        wanted, state, rigid = self._state.velocity.copy(), self._state, self._rigid
        self._bulk.prescribe(
            wanted,
            time,
            self._step,
            self._theta,
            state.displacement,
            state.velocity,
            time - state.time,
        )
        driven = _NONE if rigid is None else rigid.velocities(self._step, state.time, time)
        return self._bulk.external(time), wanted, driven
