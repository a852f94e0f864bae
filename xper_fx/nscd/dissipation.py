# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How far a load may go before bonds dissipate more than a step is to.

The constraint of a step is that its bonds dissipate an energy tau,

    D(U) = sum_i A_i k_i [d(x_i) - d(x_r,i)]+ = tau,    d(x) = int_0^x g y dy - g(x) x^2 / 2,

with the openings x(U) at the end of the step, the largest ones so far x_r, the stiffness k in the
direction of the jump and the damage g(x) of a curve: k d(x) is the area under the curve less what
the bond holds, which is what its law books (`laws/damage_at_end.py`). Where unloading goes to the
origin and the bulk is elastic that is the energy release of Gutierrez 2004 and of Verhoosel,
Remmers and Gutierrez 2009, (f0 . dq - df . q0) / 2 along a small step; theirs is of first order in
the step, and counts the heat of friction and plastic flow too. D of a step is exact.

**No switch.** Their constraint is linearised, says nothing where nothing dissipates, and so needs
the load to be prescribed there. Here a correction looks for the load along the line of jumps
U(s) = A + s B itself, on which D is 0 up to the first bond that weakens: elastic parts of a path,
at its start or between two cracks, are steps of their own or go by within one.

D rises with each opening and openings are convex in s, so that D < tau holds between two ends
around a load that dissipates nothing, or around the least one of an iteration. Which of them goes
on along the path `growth.py` tells.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.growth import GrowthLimit, roots
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import LawKernels

# How often the distance in which an end is looked for is doubled.
_DOUBLINGS = 60
# Share of what is left that the last steps of bonds dissipate.
_OF_THE_REST = 0.5
# An opening, relative to the length of its curve, at which a bond is broken.
_BROKEN = 1e3
# Absolute error of a load factor that counts for nothing beside its relative one.
_SMALLEST = 1e-300


@cache
def _cost_kernel(law: LawKernels):
    """Kernel: what the bonds of all points dissipate with jumps a + s b (J)."""
    algebra, cost = for_dimension(law.components), law.cost
    row, add, scale = algebra.row, algebra.add, algebra.scale

    @njit(nogil=True, **LEAN_ENTRY)
    def costs(jump, a, b, s, area, parameters, details):
        total = 0.0
        for i in range(len(jump)):
            end = add(row(a, i), scale(s, row(b, i)))
            total += cost(i, row(jump, i), end, area[i], parameters, details)
        return total

    return costs


class DissipationLimit(GrowthLimit):
    """The limit of a step, after its `begin_step`.

    Args:
        interactions: points at the start of the step, some of them with a law that has a `cost`.
        energy: tau (J; 2D: J per metre of depth), or half of what is left if that is less.
    """

    def __init__(self, interactions: Interactions, energy: float):
        super().__init__(interactions, growth=1.0, relative=np.inf)
        self._groups = [interactions.groups[n] for n in self._numbers]
        self._energy = energy
        self._asked: float | None = None

    def _cost(self, a: np.ndarray, b: np.ndarray) -> Callable[[float], float]:
        """D along jumps a + s b of all points, shape (n, components)."""
        ends = np.cumsum([len(g) for g in self._groups])
        parts = list(zip(self._groups, np.split(a, ends)[:-1], np.split(b, ends)[:-1], strict=True))

        def cost(s: float) -> float:
            own = sum(
                _cost_kernel(g.kernels)(
                    g.jump, start, slope, s, g.points.area, g.parameters, g.details
                )
                for g, start, slope in parts
            )
            return self._points.total(own)

        return cost

    @property
    def _most(self) -> float:
        """What the step is to dissipate (J)."""
        if self._asked is None:
            broken = np.zeros_like(self._start)
            broken[:, 0] = self._reached + _BROKEN * self._length
            left = self._cost(broken, np.zeros_like(broken))(0.0)
            self._asked = min(self._energy, _OF_THE_REST * left)
        return self._asked

    def _ends(self, a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
        at_rest = roots(a[self._grows], b[self._grows], self._opening_after(0.0))
        low, high = self._within(*at_rest)
        known = [s for s in (low, high) if np.isfinite(s)]
        if not known:
            return low, high
        cost, most = self._cost(a, b), self._most
        if low > high or max(map(cost, known)) >= most:
            between = min(known), max(known)
            low = high = float(minimize_scalar(cost, bounds=between, method="bounded").x)
            if cost(low) >= most:
                return low, high
        opened = roots(a[self._grows], b[self._grows], self._opening_after(1.0))
        with np.errstate(invalid="ignore"):  # of bonds that never reach their limits
            reaches = at_rest[0] - opened[0], opened[1] - at_rest[1]
        nearest = np.array([np.fmin.reduce(reach, initial=np.inf) for reach in reaches])
        below, above = -self._points.largest(-nearest)
        return self._end(cost, low, -below), self._end(cost, high, above)

    def _end(self, cost: Callable[[float], float], start: float, reach: float) -> float:
        """Where bonds dissipate what they may, beyond a start by a reach or by more."""
        if not np.isfinite(start):
            return start
        for _ in range(_DOUBLINGS):
            if cost(start + reach) >= self._most:
                between = start, start + reach
                return brentq(lambda s: cost(s) - self._most, *between, xtol=_SMALLEST, disp=False)
            reach *= 2.0
        return float(np.copysign(np.inf, reach))

    def _used(self, jumps: np.ndarray) -> float:
        return self._cost(jumps, np.zeros_like(jumps))(0.0) / self._most
