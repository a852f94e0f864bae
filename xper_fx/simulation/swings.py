# SPDX-License-Identifier: LGPL-3.0-or-later
r"""What swings lags, until it is out of phase: the error of the time integration, wave by wave.

A scheme of second order lets a wave of the frequency omega lag by (omega h)^2 / 12 of the time that
goes by (Hughes 1987, section 9.1.3). An energy e = A sin(2 omega t) so errs by h^3 |e'''| / 12 a
step, which `linear` sums: it grows with the run. Waves of the mesh's own frequency are out of phase
with the exact ones after a few swings, and from there on err by no more than the difference of two
waves of unrelated phases, 2^(1/2) times their root mean square a. Of a signal whose differences of
second and third order have the root mean squares d2 and d3, what makes the third ones is a wave of
2 sin(omega h) = d3 / d2 and of

    a = d2^3 / d3^2.

Waves that are slower by far are in the means of eight steps, and lag by what these show. The error
is the sum over all steps, or that of the means and 2^(1/2) a if it is less.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER

# Steps of a mean.
_A_MEAN = 8
# What is kept of each signal: rates of the last two steps, squares of differences of second and
# third order, summed, the change since the last mean, and the last two means.
_FIRST, _MIDDLE, _SECOND, _THIRD, _CHANGE, _FIRST_MEAN, _MIDDLE_MEAN = range(7)
# And of all: steps; middles of the last two (s); what `Swings` tells; since the last mean h, h^3,
# h t, summed; means, and the middles of the last two (s).
_STEPS, _T_FIRST, _T_MIDDLE, _LINEAR, _ERROR, _AMPLITUDE, _LOST = range(7)
_SLOW, _SPAN, _CUBES, _MOMENT, _MEANS, _T_FIRST_MEAN, _T_MIDDLE_MEAN = range(7, 14)


@njit(**LEAN_INNER)
def _lag(a, b, c, behind, ahead, cubes):
    """h^3 |rate''| / 12: what lags over the span of the last of three rates.

    Args:
        a, b, c: the rates.
        behind, ahead: time from the middle of the first to that of the second, to the third (s).
        cubes: h^3 summed over the steps of the span (s^3).
    """
    return cubes / 6.0 / (behind + ahead) * abs((c - b) / ahead - (b - a) / behind)


@njit(**LEAN_ENTRY)
def _look(now, kept, past, time, size):
    """Look at a step; `now` has the changes of the signals in it, and gets their rates."""
    left, turn, moved = 0.0, 0.0, 0.0
    known = past[_STEPS] >= 2.0
    behind, ahead = past[_T_MIDDLE] - past[_T_FIRST], time - past[_T_MIDDLE]
    for i in range(len(now)):
        one, change = kept[i], now[i]
        now[i] = change / size
        moved += abs(change)
        if known:
            left += _lag(one[_FIRST], one[_MIDDLE], now[i], behind, ahead, size * size * size)
            turn += abs(change - size * one[_MIDDLE])
    return left, turn, moved


@njit(**LEAN_ENTRY)
def _take(now, kept, past, time, size, lagging):
    """Take a step; see `Swings.take`."""
    past[_STEPS] += 1.0
    several = past[_STEPS] > 2.0
    cube, most = size * size * size, 0.0
    behind, ahead = past[_T_MIDDLE] - past[_T_FIRST], time - past[_T_MIDDLE]
    for i in range(len(now)):
        one, rate = kept[i], now[i]
        if several:
            lag = _lag(one[_FIRST], one[_MIDDLE], rate, behind, ahead, cube)
            most = max(most, lag)
            one[_SECOND] += (size * (rate - one[_MIDDLE])) ** 2
            one[_THIRD] += (12.0 * lag) ** 2
        one[_FIRST], one[_MIDDLE] = one[_MIDDLE], rate
        one[_CHANGE] += size * rate
    past[_T_FIRST], past[_T_MIDDLE] = past[_T_MIDDLE], time
    past[_LINEAR] += 0.5 * lagging * most  # amplitudes err by half as much
    past[_SPAN] += size
    past[_CUBES] += cube
    past[_MOMENT] += size * time
    if past[_STEPS] % _A_MEAN == 0.0:
        _take_mean(kept, past, lagging)
    swings = 0.0
    for i in range(len(now)):
        if kept[i, _THIRD] > 0.0:
            swings = max(swings, kept[i, _SECOND] ** 1.5 / kept[i, _THIRD])
    past[_AMPLITUDE] = swings / math.sqrt(past[_STEPS])
    past[_ERROR] = min(past[_LINEAR], past[_SLOW] + math.sqrt(2.0) * past[_AMPLITUDE])
    if past[_LINEAR] > 0.0:
        past[_LOST] = 1.0 - past[_ERROR] / past[_LINEAR]


@njit(**LEAN_INNER)
def _take_mean(kept, past, lagging):
    """Take the mean of the steps since the last one."""
    span, middle, most = past[_SPAN], past[_MOMENT] / past[_SPAN], 0.0
    behind = past[_T_MIDDLE_MEAN] - past[_T_FIRST_MEAN]
    for i in range(len(kept)):
        one = kept[i]
        mean = one[_CHANGE] / span
        if past[_MEANS] >= 2.0:
            ahead = middle - past[_T_MIDDLE_MEAN]
            lag = _lag(one[_FIRST_MEAN], one[_MIDDLE_MEAN], mean, behind, ahead, past[_CUBES])
            most = max(most, lag)
        one[_FIRST_MEAN], one[_MIDDLE_MEAN], one[_CHANGE] = one[_MIDDLE_MEAN], mean, 0.0
    past[_SLOW] += 0.5 * lagging * most
    past[_T_FIRST_MEAN], past[_T_MIDDLE_MEAN] = past[_T_MIDDLE_MEAN], middle
    past[_MEANS] += 1.0
    past[_SPAN] = past[_CUBES] = past[_MOMENT] = 0.0


class Swings:
    """Follows signals that swing together, as energies do that mirror each other.

    A step of a small scene takes some 50 us, which is why what is done in each is compiled.

    Args:
        count: of the signals, n.

    Attributes:
        now: mean rates of the signals in the step that is taken, shape (n,).
    """

    def __init__(self, count: int):
        self.now = np.zeros(count)
        self._kept, self._past = np.zeros((count, _MIDDLE_MEAN + 1)), np.zeros(_T_MIDDLE_MEAN + 1)

    @property
    def steps(self) -> int:
        """Steps taken."""
        return int(self._past[_STEPS])

    @property
    def last(self) -> np.ndarray:
        """Rates of the last step that was taken, shape (n,)."""
        return self._kept[:, _MIDDLE]

    @property
    def linear(self) -> float:
        """Lags of all steps, each of the largest of the signals."""
        return float(self._past[_LINEAR])

    @property
    def amplitude(self) -> float:
        """Root mean square a of what swings fastest, of the largest of the signals."""
        return float(self._past[_AMPLITUDE])

    @property
    def error(self) -> float:
        """What lags, as far as it can."""
        return float(self._past[_ERROR])

    @property
    def out_of_phase(self) -> float:
        """Share of the lags that is beyond the error: 0 in phase, 1 where phases are lost."""
        return float(self._past[_LOST])

    def look(self, time: float, size: float) -> tuple[float, float, float]:
        """Look at a step in which signals change by `now`, which becomes their rates.

        Args:
            time: middle of the step (s).
            size: h (s).

        Returns:
            What signals lag, how far they turn from their last rates (both zero in the first two
            steps), and how far they change; sums over them.
        """
        return _look(self.now, self._kept, self._past, time, size)

    def take(self, time: float, size: float, lagging: float = 1.0) -> None:
        """Take a step of the rates `now`; waves lag so much of what they lag here."""
        _take(self.now, self._kept, self._past, time, size, lagging)

    def saved(self) -> dict:
        """All of it."""
        return {name: values.copy() for name, values in vars(self).items()}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        vars(self).update({name: np.array(values) for name, values in saved.items()})
