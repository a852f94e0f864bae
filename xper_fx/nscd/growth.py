# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How far a load may go before some bond opens further than a step may let it.

Each bond has a largest opening so far, x_r, and may open by no more than g L, L a length of its
curve and g the growth of the step. Along jumps U(s) = A + s B, s the change of the load, the
openings of all bonds stay within their limits in an interval of s. A step that ends at one of its
ends makes one bond at least open by exactly g L: so the load is found, whether it rises, falls, or
the structure snaps back (Lorentz and Badel 2004, on openings in place of strains). Of the two ends
the one goes on along the path towards which the bonds that opened in the last step open on. In the
first step the load rises, and iterations take the end that is nearer to the present jumps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.interactions import Interactions

# An opening this near to the largest one so far grew in the last step.
_ROUNDING = 1e-9
# Growth beside the one asked for at which an iteration goes astray.
_ASTRAY = 10.0


class GrowthLimit:
    """The limits of a step.

    Args:
        interactions: points at the start of the step, some of them with a law that has a `growth`.
        growth: g, relative to the length of a bond's curve.
        relative: bound on g L beside x_r.
    """

    def __init__(self, interactions: Interactions, growth: float, relative: float):
        self._growth = growth
        groups = [(n, g) for n, g in enumerate(interactions.groups) if g.kernels.growth is not None]
        known = zip(*(g.kernels.growth(g.parameters, g.state) for _, g in groups), strict=True)
        self._reached, length, whole = (np.concatenate(list(values)) for values in known)
        self._length = np.minimum(length, relative * self._reached)
        self._numbers = [n for n, _ in groups]
        # a step's end velocities have the direction of its jumps, as theta is 1
        forward = np.concatenate([g.points.area[:, None] * g.velocity for _, g in groups])
        x = _opening(np.concatenate([g.jump for _, g in groups]))
        grew = x > (1.0 - _ROUNDING) * self._reached
        self._forward = np.where(grew[:, None], forward, 0.0) if np.any(grew) else forward
        self._grows = np.flatnonzero(whole)

    @property
    def exhausted(self) -> bool:
        """Whether all bonds are broken."""
        return len(self._grows) == 0

    @property
    def begins(self) -> bool:
        """Whether no bond has opened yet."""
        return not np.any(self._forward)

    def _all(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        return np.concatenate([arrays[n] for n in self._numbers])

    def _of(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        return self._all(arrays)[self._grows]

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
        a, b = self._all(start), self._all(slope)
        closed = self._all(held)
        a[closed, 0] = b[closed, 0] = 0.0
        goes_on = float(np.vdot(self._forward, b))
        a, b = a[self._grows], b[self._grows]
        low, high = _interval(a, b, self._limits())
        if not low < high:  # on the way no load may obey all limits: one that nearly does
            middle = 0.5 * (low + high)
            growth = self._largest(a + middle * b) if np.isfinite(middle) else np.inf
            return middle if growth < _ASTRAY * self._growth else None
        roots = [s for s in (low, high) if np.isfinite(s)]
        if not roots:
            return None
        if not self.begins:
            return roots[-1] if goes_on >= 0.0 else roots[0]
        present = self._of(now)
        if not np.any(present):
            return roots[-1]
        return min(roots, key=lambda s: float(((a + s * b - present) ** 2).sum()))

    def turns_back(self, moved: Sequence[np.ndarray], change: float) -> bool:
        """Whether the bonds that opened in the last step close, or the load of the first one falls.

        Args:
            moved: change of the jumps of each group in the step, shape (n, components), m.
            change: of the time of the loads (s).
        """
        if self.begins:
            return change < 0.0
        return float(np.vdot(self._forward, self._all(moved))) < 0.0

    def left(self, now: Sequence[np.ndarray]) -> float:
        """By how much the growth differs from the one asked for, relative."""
        return self._largest(self._of(now)) / self._growth - 1.0

    def _largest(self, jumps: np.ndarray) -> float:
        """Largest growth of the bonds that are left."""
        reached, length = self._reached[self._grows], self._length[self._grows]
        return float(((_opening(jumps) - reached) / length).max())

    def _limits(self) -> np.ndarray:
        return self._reached[self._grows] + self._growth * self._length[self._grows]


def _opening(jumps: np.ndarray) -> np.ndarray:
    """Opening of jumps, shape (n, components): no negative normal part counts."""
    return np.sqrt(np.maximum(jumps[:, 0], 0.0) ** 2 + (jumps[:, 1:] ** 2).sum(1))


def _interval(a: np.ndarray, b: np.ndarray, limit: np.ndarray) -> tuple[float, float]:
    """Between which s all openings of a + s b stay below their limits.

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
    return float(ends[0].max()), float(ends[1].min())


def _root(a: np.ndarray, b: np.ndarray, limit: np.ndarray, sign: float) -> np.ndarray:
    """s where |a + s b| = limit, the smaller or the larger one by `sign`."""
    bb, ab, aa = (b * b).sum(1), (a * b).sum(1), (a * a).sum(1)
    return (-ab + sign * np.sqrt(ab * ab - bb * (aa - limit * limit))) / bb
