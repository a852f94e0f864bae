# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How far a load may go before some bond opens further than a step may let it.

Each bond has a largest opening so far, x_r, and may open by no more than g L, L a length of its
curve and g the growth of the step. Along jumps U(s) = A + s B, s the change of the load, the
openings of all bonds stay within their limits in an interval of s. A step that ends at one of its
ends makes one bond at least open by exactly g L: so the load is found, whether it rises, falls, or
the structure snaps back (Lorentz and Badel 2004, on openings in place of strains). Of the two ends
the one goes on along the path towards which the bonds that opened in the last step open on. Where
none opened, the path is elastic, and the load goes on to rise or to fall: openings do not tell, as
loads may push in another way than before. In the first step the load rises, and iterations take the
end that is nearer to the present jumps.

**Corners.** A bond that reaches its largest opening so far may soften by more than the structure
stiffens it, as long as those that have opened go on to do so. No load then solves the step: with
its secant the bond opens too far, along its curve it closes, and the iterations take turns. The
path turns there: this bond opens, the others close. `turning` tells the bonds that take turns, and
`follow` lets the path go on where they open. What the others would have opened up to the corner is
left out, which a step bounds by its growth. `bulk/rates.py` finds turns of all bonds at once.

**Slip.** Of joints that slip weakens what grows is the slip that they have made, to and fro. Their
jumps are measured from where the step begins, where nothing is reached, without the normal part,
and L is the whole length, as nothing is elastic before. A joint that slides as a whole bears most
where it begins to. There the last points to slip are bounded instead: of all that have not slipped
yet, the one that slips least slips by no more than g a L, a a small share, of which the load that
a step passes by is g a of the joint's cohesion at most.

Where ranks divide the points each has the bonds of its own; ends, sums and decisions are those of
all, and all ranks ask together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from xper_fx.nscd.interactions import Interactions

# An opening this near to the largest one so far grew in the last step.
_ROUNDING = 1e-9
# An opening this near to the largest one so far is at it, for the rates of bonds.
_AT_LIMIT = 1e-6
# Of the fastest lips, how fast those are at most that the load does not move; of a bond's largest
# opening, how far lips move in a step of which nothing is told.
_STILL = 1e-9
# Iterations within which a bond is told that takes turns.
_TURNS = 6
# Length beside that of its curve of a bond that weakens from the first opening, and is closed yet.
_FIRST = 0.05
# Part of its slip distance by which the last point of joints may slip for the first time (a), and
# the part up to which one has not slipped.
_FIRST_SLIP, _STUCK = 5e-3, 1e-6
# How much of what a step may do, relative, at which an iteration goes astray.
_ASTRAY = 10.0


class GroupLimits(NamedTuple):
    """The limits of a group."""

    group: int  #: its number
    first: int  #: number of its first point among those of all groups that have bonds
    reached: np.ndarray  #: largest openings so far, shape (n,), m
    length: np.ndarray  #: by how much bonds may open in the step, shape (n,), m


class GrowthLimit:
    """The limits of a step.

    Args:
        interactions: points at the start of the step, some of them with a law that has a `growth`.
        growth: g, relative to the length of a bond's curve.
        relative: bound on g L beside x_r.

    Attributes:
        idle: whether the first iteration found that bonds may go on as far as they like: those that
            opened in the last step are broken, and the others open no further.
        exhausted: whether all bonds are broken.
        begins: whether no bond has opened yet.
    """

    def __init__(self, interactions: Interactions, growth: float, relative: float):
        self._growth = growth
        self._points = interactions
        groups = [(n, g) for n, g in enumerate(interactions.groups) if g.kernels.growth is not None]
        known = [g.kernels.growth(g.parameters, g.state) for _, g in groups]
        none = np.zeros(0), np.zeros(0), np.zeros(0, bool)  # a rank may have no bond
        reached, length, self._whole = map(np.concatenate, zip(none, *known, strict=True))
        slips = np.concatenate([none[2], *(np.full(len(g), g.kernels.slips) for _, g in groups)])
        beside = np.where(reached > 0.0, relative * reached, _FIRST * length)
        self._length = np.where(slips, length, np.minimum(length, beside))
        self._reached = np.where(slips, 0.0, reached)
        self._moves_by, self._slips = np.where(slips, length, reached), slips
        self._numbers = [n for n, _ in groups]
        self._counts = np.ones((len(slips), interactions.dim))
        self._counts[slips, 0] = 0.0
        # a step's end velocities have the direction of its jumps, as theta is 1
        self._area = np.concatenate([none[0], *(g.points.area for _, g in groups)])
        self._origin = np.zeros_like(self._counts)
        jumps = self._all([g.jump for g in interactions.groups])
        self._origin[slips] = jumps[slips]
        self._start = jumps - self._origin
        velocity = self._all([g.velocity for g in interactions.groups])
        forward = self._area[:, None] * self._but_rounding(velocity, interactions.committed_step)
        grew = _opening(self._start) > (1.0 - _ROUNDING) * self._reached
        grew[slips] = (forward[slips] != 0.0).any(axis=1)
        self._grows = np.flatnonzero(self._whole)
        sticks = slips & self._whole & (reached < _STUCK * length)
        self._sticks = np.flatnonzero(sticks)
        none_grew, self.exhausted, all_slip = self._nowhere(grew, self._whole, sticks)
        self._some_stick = not all_slip
        self._none_grew = none_grew
        self._go(forward if none_grew else np.where(grew[:, None], forward, 0.0))
        self._opened = [np.zeros(len(grew))] * 2
        self.idle: bool | None = None

    def keep_on(self, change: float) -> None:
        """Go on as the load did in the last step, if no bond opened in it.

        Args:
            change: of the time of the loads in it (s), 0 if there was none.
        """
        if self._none_grew:
            self._sense = float(np.sign(change))

    def follow(self, leading: np.ndarray) -> None:
        """Go on where some bonds open, whatever opened in the last step.

        Args:
            leading: those bonds, shape (n,), bool, as `turning` has them, or their numbers.
        """
        forward = np.zeros_like(self._start)
        forward[leading] = self._area[leading, None] * self._start[leading]
        self._go(forward)

    def at_limit(self) -> np.ndarray:
        """Bonds at their largest openings, which open on or close: their numbers, shape (m,)."""
        opening = _opening(self._start)
        at_limit = (opening > 0.0) & (opening >= (1.0 - _AT_LIMIT) * self._reached)
        return np.flatnonzero(self._whole & ~self._slips & at_limit)

    def of_groups(self) -> list[GroupLimits]:
        """The limits of each group that has bonds."""
        ends = np.cumsum([0, *(len(self._points.groups[n]) for n in self._numbers)])
        length = self._growth * self._length
        return [
            GroupLimits(n, start, self._reached[start:end], length[start:end])
            for n, start, end in zip(self._numbers, ends, ends[1:], strict=False)
        ]

    def _go(self, forward: np.ndarray) -> None:
        """Take what tells which way goes on, shape (n, components)."""
        self._forward, self._sense = forward, 0.0
        (self.begins,) = self._nowhere(forward)

    @property
    def turning(self) -> np.ndarray | None:
        """Bonds that one of the last two iterations opened beyond `reached`.

        Shape (n,), bool; None if there are none.
        """
        before, last = (x > self._reached for x in self._opened[-2:])
        return None if self._nowhere(before != last)[0] else before != last

    @property
    def contested(self) -> int | None:
        """The bond that took turns in the last iterations and whose opening changed most.

        Beside the length of its curve; its number in the scene's order, None if none took turns.
        """
        opened = np.stack(self._opened)
        least, largest = opened.min(axis=0), opened.max(axis=0)
        turned = self._whole & (least <= self._reached) & (largest > self._reached)
        if self._nowhere(turned)[0]:
            return None
        change = np.where(turned, (largest - least) / self._length, 0.0)
        most = float(self._points.largest(change.max(initial=0.0)))
        groups, none = self._points.groups, np.zeros(0, np.int64)
        numbers = [self._points.numbers[groups[n].indices] for n in self._numbers]
        own = np.concatenate([none, *numbers])[turned & (change == most)]
        return int(self._points.largest(own.max(initial=-1)))

    def _but_rounding(self, moved: np.ndarray, time: float = 1.0) -> np.ndarray:
        """Changes of all jumps in a time without what may be rounding, as of closed lips."""
        still = time * np.abs(moved).max(axis=1, initial=0.0) < _STILL * self._moves_by
        return np.where(still[:, None], 0.0, moved)

    def _nowhere(self, *conditions: np.ndarray) -> list[bool]:
        """Of each condition whether it holds for no bond of all ranks."""
        some = np.array([np.any(condition) for condition in conditions])
        return [not there for there in self._points.largest(some)]

    def _sum(self, a: np.ndarray, b: np.ndarray) -> float:
        """a . b over the bonds of all ranks."""
        return float(self._points.total(np.vdot(a, b)))

    def _all(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Vectors of all groups that have bonds, without what does not count."""
        none = np.zeros((0, self._points.dim))
        return self._counts * np.concatenate([none, *(arrays[n] for n in self._numbers)])

    def _from_origin(self, jumps: Sequence[np.ndarray]) -> np.ndarray:
        """Jumps from where they are measured."""
        return self._all(jumps) - self._origin

    def change(
        self,
        now: Sequence[np.ndarray],
        held: Sequence[np.ndarray],
        start: Sequence[np.ndarray],
        slope: Sequence[np.ndarray],
    ) -> float | None:
        """s at the end of the interval that goes on from `now`; None if there is none.

        Args:
            now: jumps of each group at present, shape (n, components), m.
            held: of each group, shape (n,), whether the lips are closed.
            start, slope: A and B of each group, shape (n, components), m.
        """
        a, b = self._from_origin(start), self._all(slope)
        # the load does not reach a part that has come loose: what is left there is rounding
        fastest = float(self._points.largest(np.abs(b).max(initial=0.0)))
        b[np.abs(b).max(axis=1, initial=0.0) < _STILL * fastest] = 0.0
        self._opened = [*self._opened[-_TURNS + 1 :], _opening(self._from_origin(now))]
        closed = np.concatenate([np.zeros(0, bool), *(held[n] for n in self._numbers)])
        a[closed, 0] = b[closed, 0] = 0.0
        goes_on = self._sense or self._sum(self._forward, b)
        low, high = self._ends(a, b)
        if not low < high:  # on the way no load may obey all limits: one that nearly does
            middle = 0.5 * (low + high)
            used = self._used(a + middle * b) if np.isfinite(middle) else np.inf
            return middle if used < _ASTRAY else None
        ends = [s for s in (low, high) if np.isfinite(s)]
        if self.idle is None:
            self.idle = not np.isfinite(high if goes_on >= 0.0 else low)
        if not ends:
            return None
        if not self.begins:
            return ends[-1] if goes_on >= 0.0 else ends[0]
        present, a, b = self._from_origin(now)[self._grows], a[self._grows], b[self._grows]
        if self._nowhere(present)[0]:
            return ends[-1]
        return min(ends, key=lambda s: self._sum(a + s * b - present, a + s * b - present))

    def turns_back(self, moved: Sequence[np.ndarray], change: float) -> bool:
        """Whether the bonds that opened in the last step close, or the load of the first one falls.

        Args:
            moved: change of the jumps of each group in the step, shape (n, components), m.
            change: of the time of the loads (s).
        """
        if self.begins or self._sense:
            return change < 0.0 if self.begins else change * self._sense < 0.0
        return self._sum(self._forward, self._but_rounding(self._all(moved))) < 0.0

    def allows(self, moved: Sequence[np.ndarray]) -> bool:
        """Whether bonds do in a step what they may, or less.

        Args:
            moved: change of the jumps of each group in the step, shape (n, components), m.
        """
        return self._used(self._start + self._all(moved)) <= 1.0

    def left(self, now: Sequence[np.ndarray]) -> float:
        """By how much a step does more than it was asked to, relative."""
        return self._used(self._from_origin(now)) - 1.0

    def _ends(self, a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
        """Between which s the jumps a + s b of all points, shape (n, components), may be."""
        ends = roots(a[self._grows], b[self._grows], self._opening_after(self._growth))
        low, high = self._within(*ends)
        if self._some_stick:
            first = self._growth * _FIRST_SLIP * self._length[self._sticks]
            below, above = roots(a[self._sticks], b[self._sticks], first)
            own = -below.min(initial=np.inf), above.max(initial=-np.inf)
            below, above = self._points.largest(np.array(own)).tolist()
            low, high = max(low, -below), min(high, above)
        return low, high

    def _within(self, low: np.ndarray, high: np.ndarray) -> tuple[float, float]:
        """What the intervals of all bonds have in common, as low and high end."""
        own = low.max(initial=-np.inf), -high.min(initial=np.inf)
        low, high = self._points.largest(np.array(own)).tolist()
        return low, -high

    def _used(self, jumps: np.ndarray) -> float:
        """Share of what a step may do that jumps of all points use."""
        reached, length = self._reached[self._grows], self._length[self._grows]
        grown = (_opening(jumps[self._grows]) - reached) / length
        used = float(self._points.largest(grown.max(initial=-np.inf))) / self._growth
        if self._some_stick:
            slipped = _opening(jumps[self._sticks]) / (_FIRST_SLIP * self._length[self._sticks])
            least = -float(self._points.largest(-slipped.min(initial=np.inf)))
            used = max(used, least / self._growth)
        return used

    def _opening_after(self, growth: float) -> np.ndarray:
        """Opening (m) of each bond that is left after a growth."""
        return self._reached[self._grows] + growth * self._length[self._grows]


def _opening(jumps: np.ndarray) -> np.ndarray:
    """Opening of jumps, shape (n, components): no negative normal part counts."""
    return np.sqrt(np.maximum(jumps[:, 0], 0.0) ** 2 + (jumps[:, 1:] ** 2).sum(1))


def roots(a: np.ndarray, b: np.ndarray, limit: np.ndarray) -> list[np.ndarray]:
    """Between which s the opening of each a + s b is below its limit; infinite if it always is.

    The opening counts no negative normal part; it is convex in s, so that each limit leaves an
    interval.
    """
    ends = []
    with np.errstate(all="ignore"):
        for sign in (-1.0, 1.0):
            whole = _root(a, b, limit, sign)
            sheared = _root(a[:, 1:], b[:, 1:], limit, sign)
            s = np.where(a[:, 0] + whole * b[:, 0] >= 0.0, whole, sheared)
            moves = (b * b).sum(1) > 0.0
            ends.append(np.where(moves & np.isfinite(s), s, sign * np.inf))
    return ends


def _root(a: np.ndarray, b: np.ndarray, limit: np.ndarray, sign: float) -> np.ndarray:
    """s where |a + s b| = limit, the smaller or the larger one by `sign`."""
    bb, ab, aa = (b * b).sum(1), (a * b).sum(1), (a * a).sum(1)
    return (-ab + sign * np.sqrt(ab * ab - bb * (aa - limit * limit))) / bb
