# SPDX-License-Identifier: LGPL-3.0-or-later
"""Path following: static steps whose load is found from what they may break."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from xper_fx.bulk.monolithic_scheme import Rates
from xper_fx.bulk.state import State
from xper_fx.nscd.growth import GrowthLimit
from xper_fx.nscd.interactions import Interactions
from xper_fx.support.checks import require_count, require_positive

logger = logging.getLogger(__name__)

_BRANCHES = (
    "the path branches near the time %g s of the loads: the structure is unstable in %d ways "
    "there, and small imperfections decide which it goes"
)
# Least share of what was asked for in a step, and what a failure leaves of it.
_LEAST, _SHORTENED = 1e-6, 0.4
# Least shares that a control may have: with less a path goes on for ever, or stands still.
_SMALLEST = 1e-6
# Share at which a step that fails is near enough to a corner to go round it (`nscd/growth.py`).
_AT_CORNER = 0.05
# Share at which a load is tried that is not found from what bonds do.
AT_LAST = 1e-5
# Share above which a step that failed from the rates of its bonds is not made again from rest, but
# with less: it seldom converges from there.
_RATES_ALONE = 0.1
# Relative difference of changes of the load that are the same.
_ROUNDING = 1e-9
# Exponent and bounds of the change of the share by the number of iterations.
_EXPONENT, _SLOWEST, _FASTEST = 0.7, 0.5, 2.0


def _require_share(name: str, value: Any) -> None:
    """Refuse a share of so little that no path would end.

    Raises:
        TypeError: no real number.
        ValueError: not a finite number above zero, or below the smallest share.
    """
    if require_positive(name, value) < _SMALLEST:
        raise ValueError(f"{name} should be at least {_SMALLEST:g}, or no path ends, got {value}.")


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
        longest: share of the path's end by which the load may change in a step.

    Raises:
        ValueError: a number out of range; a share below 1e-6, with which no path ends.
    """

    growth: float = 0.3
    relative: float = 5.0
    iterations: int = 6
    longest: float = 0.05

    def __post_init__(self) -> None:
        for name in ("growth", "relative", "longest"):
            _require_share(name, getattr(self, name))
        require_count("iterations", self.iterations, 1)

    most: ClassVar[float] = 5.0
    """Bound of the growth of a step beside the one asked for."""
    asks: ClassVar[str] = "growth"
    """What of a law's kernels tells how far a step goes."""

    def follower(self) -> PathFollower:
        """What a run asks for each step."""
        return PathFollower(self)

    def limit(self, interactions: Interactions, share: float) -> GrowthLimit:
        """The limit of a step that may grow by a share of what was asked for."""
        return GrowthLimit(interactions, share * self.growth, self.relative)


@dataclass(frozen=True)
class DissipationControl:
    """The load of each static step is that at which bonds dissipate a given energy.

    So n steps spend n times the energy, whatever the openings: the change of "dissipated_cohesion"
    in the ledger (`nscd/dissipation.py`). A step that does not converge is made again with less,
    and the next ones return to the energy asked for.

    Args:
        energy: of a step (J; 2D: J per metre of depth); about that of a facet, w times its area, or
            less: with a large first step several cracks may start that a small one tells apart.
            Where less than twice the energy is left in all bonds, a step dissipates half of that.
        iterations: of Newton's method above which the next step dissipates less.
        longest: share of the path's end by which the load may change in a step.

    Raises:
        ValueError: a number out of range; a share below 1e-6, with which no path ends.
    """

    energy: float
    iterations: int = 12
    longest: float = 0.05

    def __post_init__(self) -> None:
        require_positive("energy", self.energy)
        _require_share("longest", self.longest)
        require_count("iterations", self.iterations, 1)

    most: ClassVar[float] = 1.0
    """Bound of the energy of a step beside the one asked for."""
    asks: ClassVar[str] = "cost"
    """What of a law's kernels tells how far a step goes."""

    def follower(self) -> PathFollower:
        """What a run asks for each step."""
        return PathFollower(self)

    def limit(self, interactions: Interactions, share: float) -> GrowthLimit:
        """The limit of a step that may dissipate a share of what was asked for."""
        from xper_fx.nscd.dissipation import DissipationLimit

        return DissipationLimit(interactions, share * self.energy)


PathControl = GrowthControl | DissipationControl
"""How the load of a static run is found."""


class PathFollower:
    """Where a run is on its path.

    Args:
        control: what was asked for.

    Attributes:
        share: of what was asked for, in the next step.
        limit_points: times of the loads (s) at which they turned.
        branches: times of the loads (s) of steps with more than one unstable way to go on.
        contested: as of `GrowthLimit`, of the last attempts at the step; None if they had none.
        refused: changes of the load that attempts at the step went by in vain, as it is given: with
            whether they may lead back. With a smaller share they are refused again.
        idles: whether the last attempt went part of the way to a given load, as its bonds asked for
            none: iterations are then those of contacts, and short steps do not have fewer.
        coasts: whether it did so as nothing else was left, or as the step before did: the path goes
            on by given loads until bonds ask for one.
        onwards: from which rates of the bonds the next attempt begins; of the last one, from which
            it did: where they told nothing it began from rest, and is not made again.
        rubs: whether lips had slid where the last attempt asked for rates by which they slide on.
        loads_turn: whether loads turn or stand still from the last step to where this one may go.
    """

    def __init__(self, control: PathControl):
        self._control = control
        self._last_share = self._last_change = 0.0
        self._guesses = True
        self._leading: np.ndarray | None = None
        self._limit: GrowthLimit
        self.contested: int | None = None
        self.loads_turn = self.idles = self.coasts = self.rubs = False
        self.onwards: Rates = ""
        self.share = 1.0
        self.refused: set[tuple[float, bool]] = set()
        self.limit_points: list[float] = []
        self.branches: list[float] = []

    def limit(self, interactions: Interactions) -> GrowthLimit:
        """The limit of the next step, from the state that is committed."""
        self._limit = self._control.limit(interactions, self.share)
        self._limit.keep_on(self._last_change)
        if self._leading is not None:
            self._limit.follow(self._leading)
        return self._limit

    def longest(self, time: float, end_time: float) -> float:
        """By how much the load may change in the next step (s).

        Args:
            time: of the loads (s).
            end_time: at which the path ends (s).
        """
        return self._control.longest * max(abs(end_time), abs(time))

    def rose_by(self, longest: float) -> bool:
        """Whether the load rose in the last step by as much as it may, and may do so again.

        A step that such a load was refused is made again with less, which bears it no better.
        """
        return self._guesses and self._last_change >= (1.0 - _ROUNDING) * longest

    @property
    def last_rise(self) -> float:
        """By how much the time rose in the last step (s); negative where it fell."""
        return self._last_change

    def guess(self, state: State, scale: float):
        """Time and velocities to start from: the last increment, scaled; None without one.

        Args:
            state: at its end.
            scale: of its velocities, to those of the same motion in the next step.
        """
        if not self._guesses or self._last_share == 0.0:
            return None
        share = self.share / self._last_share
        return state.time + share * self._last_change, share * scale * state.velocity

    def shorten(self, share: float) -> None:
        """Ask for a share of that in the step that is made again."""
        self.share = max(share * self.share, _LEAST)

    def succeeded(
        self, change: float, iterations: int, start: float, ways: int, tells: bool
    ) -> None:
        """A step has converged.

        Args:
            change: of the time in the step (s).
            iterations: of Newton's method.
            start: time of the loads at which the step began (s).
            ways: in which the structure would move on under loads that stand still.
            tells: whether this rank tells of turns and branches.
        """
        if change * self._last_change < 0.0:
            self.limit_points.append(start)
            if tells:
                logger.info("limit point: the loads turn at the time %g s", start)
        if ways > 1:
            if tells and not self.branches:
                logger.warning(_BRANCHES, start + change, ways)
            self.branches.append(start + change)
        self._leading = self.contested = None
        self.loads_turn, self.onwards = False, ""
        self.refused.clear()
        self._last_share, self._last_change, self._guesses = self.share, change, True
        self.coasts = self.idles and (self.coasts or self.share <= AT_LAST)
        few = 1 if self.coasts else iterations
        faster = (self._control.iterations / few) ** _EXPONENT
        share = self.share * min(max(faster, _SLOWEST), _FASTEST)
        self.share = min(max(share, _LEAST), self._control.most)

    def failed(self) -> bool:
        """A step has not converged; whether another is to be tried."""
        bond = self._limit.contested
        self.contested = self.contested if bond is None else bond
        if self._guesses and self._last_share > 0.0:
            self._guesses, self.onwards = False, "sliding"
            return True
        self._guesses = False
        if self.rubs and self.share <= _RATES_ALONE:
            self.rubs, self.onwards = False, "friction"
            return True
        again = not self.onwards or self.share > _RATES_ALONE
        self.onwards = "sliding" if again else ""
        if not self.onwards:
            return True
        corner = self._leading is None and self.share <= _AT_CORNER
        self._leading = self._limit.turning if corner else None
        if self._leading is not None:
            return True
        self.share *= _SHORTENED
        return self.share >= _LEAST

    @property
    def shortest(self) -> str:
        """Down to what a step along a path was cut before the run gave up, in words."""
        return f"a share of {_LEAST:g} of what the path's control asks for"

    def saved(self) -> dict:
        """All that the next step depends on."""
        return {
            "share": self.share, "last_share": self._last_share,
            "last_change": self._last_change, "limit_points": np.array(self.limit_points),
            "branches": np.array(self.branches), "coasts": self.coasts,
        }  # fmt: skip

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, perhaps by another control."""
        self.share = min(saved["share"], self._control.most)
        self._last_share, self._last_change = saved["last_share"], saved["last_change"]
        self.limit_points = saved["limit_points"].tolist()
        self.branches, self.coasts = saved["branches"].tolist(), bool(saved["coasts"])
        self._guesses = True
