# SPDX-License-Identifier: LGPL-3.0-or-later
"""Path following: static steps whose load is found from what they may break."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from xper_fx.bulk.state import State
from xper_fx.nscd.growth import GrowthLimit
from xper_fx.nscd.interactions import Interactions
from xper_fx.support.checks import require_count, require_number, require_positive

logger = logging.getLogger(__name__)

_BRANCHES = (
    "the path branches near the time %g s of the loads: the structure is unstable in %d ways "
    "there, and small imperfections decide which it goes"
)
# Bounds of the growth of a step beside the one asked for, and what a failure leaves of it.
_LEAST, _MOST, _SHORTENED = 1e-4, 5.0, 0.4
# Exponent and bounds of the change of the growth by the number of iterations.
_EXPONENT, _SLOWEST, _FASTEST = 0.7, 0.5, 2.0


@dataclass(frozen=True)
class GrowthControl:
    """The load of each static step is that at which some bond opens by a given length.

    So the load rises, falls, or goes back (snap-back) as the structure can bear it, and no step
    jumps to a broken state (`nscd/growth.py`). The time of the scene's loads is the unknown: a load
    `lambda t: P * t` has the load factor t.

    Args:
        growth: how far a bond may open in a step, relative to the length of its curve dc - d0; a
            step has less where iterations were many, more where they were few.
        relative: the same, relative to its largest opening so far.
        iterations: of Newton's method at which the growth stays as it is.

    Raises:
        ValueError: a number out of range.
    """

    growth: float = 0.3
    relative: float = 5.0
    iterations: int = 6

    def __post_init__(self) -> None:
        for name in ("growth", "relative"):
            require_number(name, getattr(self, name))
            require_positive(name, getattr(self, name))
        require_count("iterations", self.iterations, 1)

    def follower(self) -> PathFollower:
        """What a run asks for each step."""
        return PathFollower(self)


class PathFollower:
    """Where a run is on its path.

    Args:
        control: what was asked for.

    Attributes:
        limit_points: times of the loads (s) at which they turned.
        branches: times of the loads (s) of steps with more than one unstable way to go on.
    """

    def __init__(self, control: GrowthControl):
        self._control = control
        self._factor = 1.0
        self._last_growth = self._last_change = 0.0
        self._guesses = True
        self.limit_points: list[float] = []
        self.branches: list[float] = []

    @property
    def growth(self) -> float:
        """Of the next step."""
        return self._factor * self._control.growth

    def limit(self, interactions: Interactions) -> GrowthLimit:
        """The limit of the next step, from the state that is committed."""
        return GrowthLimit(interactions, self.growth, self._control.relative)

    def guess(self, state: State):
        """Time and velocities to start from: the last increment, scaled; None without one."""
        if not self._guesses or self._last_growth == 0.0:
            return None
        share = self.growth / self._last_growth
        return state.time + share * self._last_change, share * state.velocity

    def shorten(self, share: float) -> None:
        """Take a share of the growth in the step that is made again."""
        self._factor = max(share * self._factor, _LEAST)

    def succeeded(self, change: float, iterations: int, start: float, ways: int) -> None:
        """A step has converged.

        Args:
            change: of the time in the step (s).
            iterations: of Newton's method.
            start: time of the loads at which the step began (s).
            ways: in which the structure would move on under loads that stand still.
        """
        if change * self._last_change < 0.0:
            self.limit_points.append(start)
            logger.info("limit point: the loads turn at the time %g s", start)
        if ways > 1:
            if not self.branches:
                logger.warning(_BRANCHES, start + change, ways)
            self.branches.append(start + change)
        self._last_growth, self._last_change, self._guesses = self.growth, change, True
        share = (self._control.iterations / iterations) ** _EXPONENT
        factor = self._factor * min(max(share, _SLOWEST), _FASTEST)
        self._factor = min(max(factor, _LEAST), _MOST)

    def failed(self) -> bool:
        """A step has not converged; whether another is to be tried."""
        if self._guesses and self._last_growth > 0.0:
            self._guesses = False
            return True
        self._guesses = False
        self._factor *= _SHORTENED
        return self._factor >= _LEAST

    def saved(self) -> dict:
        """All that the next step depends on."""
        return {
            "factor": self._factor, "last_growth": self._last_growth,
            "last_change": self._last_change, "limit_points": np.array(self.limit_points),
            "branches": np.array(self.branches),
        }  # fmt: skip

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        self._factor = saved["factor"]
        self._last_growth, self._last_change = saved["last_growth"], saved["last_change"]
        self.limit_points = saved["limit_points"].tolist()
        self.branches = saved["branches"].tolist()
        self._guesses = True
