# SPDX-License-Identifier: LGPL-3.0-or-later
"""One attempt at a step along a path: the load that its control finds, or the last it may have.

Control of bonds finds a load t from what they do. It knows no bound where matter flows in their
place, or nothing is left to open, and lands beyond the end. So the load of a step from t0 has a
last value t1, the end of the path or before it, and may fall by no more than a longest change l:

    t0 - l <= t <= t1,    t1 = min(t0 + l, end).

Where the load that is found lies beyond t1, the step goes to t1 itself, from the state on the way
there, and bonds then do less than they may. A state at t1 in which they do more, or that leads
back, is not taken; then, and where the load falls too far, bonds may do less in the step. Where no
load is found at all, as where all that opens is broken or pressed, the step goes up to t1, and less
far as bonds may do less. So it does on a path that has gone up where loads turn or stand still,
from the last step to t1, and where a step has passed by such a turn, so that bonds would open on
towards the load before it: bonds then close as the loads say. Time in which no load moves does not
count where a step passes it by (`bulk/loading.py`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from xper_fx.bulk.monolithic_scheme import MonolithicScheme
from xper_fx.bulk.state import State, StepOutcome
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.simulation.path import AT_LAST, PathFollower

# How often bonds may do less in a step, as its load goes too far, before it has failed.
_APPROACHES = 5
# Relative rounding of the sum of many steps.
_ROUNDING = 1e-9
_TOO_FAR = "the load changes by more than a step may, however little bonds do"


class PathStep:
    """A step to be made.

    Args:
        scheme: of bulk and interactions.
        points: the interactions, at the start of the step.
        solver, options: of the interactions.
        path: where the run is on its path.
        state: at the start, which is not changed.
        last_size: time by which its velocities are defined (s).
        reach: at which time the path ends, and by how much a step may change it (s).
    """

    def __init__(
        self,
        scheme: MonolithicScheme,
        points: Interactions,
        solver: Solver,
        options: SolveOptions,
        path: PathFollower,
        state: State,
        last_size: float,
        reach: tuple[float, float],
    ):
        self._points, self._path, self._state, self._last_size = points, path, state, last_size
        self._scheme = scheme
        self._attempt = partial(
            scheme.attempt, state, interactions=points, solver=solver, options=options
        )
        end_time, self._longest = reach
        near = end_time - state.time <= (1.0 + _ROUNDING) * self._longest
        self._last = end_time if near else state.time + self._longest

    def attempt(self, size: float) -> tuple[StepOutcome, float]:
        """The outcome, converged or not, and the time by which its velocities are defined (s).

        Args:
            size: such a time where the load is found (s).
        """
        path, state, rise = self._path, self._state, self._last - self._state.time
        path.idles = False
        if path.limit(self._points).exhausted:
            return self._to(self._last, None), rise
        if path.rose_by(self._longest):
            there = self._to(self._last, state.velocity * (self._last_size / rise))
            if self._may_be(there, rise, back=False):
                return there, rise
        for _ in range(_APPROACHES):
            limit, guess = path.limit(self._points), path.guess(state, self._last_size / size)
            outcome = self._attempt(size, growth=limit, guess=guess, onwards=path.onwards)
            path.rubs = path.onwards == "sliding" and self._scheme.rub
            path.onwards = path.onwards if self._scheme.told else ""
            change = outcome.state.time - state.time - self._scheme.loading.held
            in_reach = -self._longest <= change <= rise
            if not outcome.converged:
                path.loads_turn = self._loads_turn()
                turned = path.loads_turn and path.last_rise >= 0.0
                last = path.coasts or path.share <= AT_LAST
                if limit.idle or turned or not in_reach or last:
                    found = self._part_of(rise, back=bool(limit.idle) or turned)
                    return found or (outcome, size)
                return outcome, size
            if in_reach:
                found = self._part_of(rise, back=True) if self._passed_a_turn(change) else None
                return found or (outcome, size)
            if change > 0.0:
                there = self._to(self._last, outcome.state.velocity * (size / change))
                if self._may_be(there, rise, back=False):
                    return there, rise
            path.shorten((rise if change > 0.0 else -self._longest) / change)
        path.loads_turn = self._loads_turn()
        return outcome._replace(converged=False, failure=_TOO_FAR), size

    def _part_of(self, rise: float, back: bool) -> tuple[StepOutcome, float] | None:
        """As `attempt`, to a given load that no bond asks for; None if it may not be.

        Args:
            rise: by how much the load may change (s).
            back: as of `_may_be`.
        """
        path = self._path
        part = min(path.share * self._longest, rise)
        if (part, back) in path.refused:
            return None
        there = self._to(self._state.time + part if part < rise else self._last, None)
        if self._may_be(there, part, back):
            path.idles = True
            return there, part
        path.refused.add((part, back))
        return None

    def _passed_a_turn(self, change: float) -> bool:
        """Whether loads have turned in the last step, so that they rise on towards before it.

        A bond that opens on would lead back there, up to the largest load and no further.
        """
        path, now = self._path, self._state.time
        if not change < 0.0 < path.last_rise:
            return False
        return self._scheme.loading.go_on(now - path.last_rise, now, now + change)

    def _loads_turn(self) -> bool:
        """Whether loads turn or stand still from the last step to where this one may go."""
        since = self._state.time - self._path.last_rise
        return self._scheme.loading.turn_between(since, self._last)

    def _to(self, time: float, velocity: np.ndarray | None) -> StepOutcome:
        """The step to a load.

        Args:
            time: of the load (s).
            velocity: to start from (m/s), None to start from rest.
        """
        guess = None if velocity is None else (time, velocity)
        outcome = self._attempt(time - self._state.time, guess=guess)
        return outcome._replace(state=replace(outcome.state, time=time))

    def _may_be(self, outcome: StepOutcome, size: float, back: bool) -> bool:
        """Whether bonds do no more than they may in a step to a load.

        Args:
            size: of the step (s).
            back: whether it may lead back along the path, as where nothing is left to go on.
        """
        if not outcome.converged:
            return False
        limit, velocity = self._path.limit(self._points), outcome.slots
        velocity = velocity.reshape(-1, self._points.dim)
        moved = [size * g.points.relative(velocity) for g in self._points.groups]
        return limit.allows(moved) and (back or not limit.turns_back(moved, size))
