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
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

# Steps of a mean.
_A_MEAN = 8
_ROWS = ("rates", "_means")


class Rate(NamedTuple):
    """Rates of n signals at a time.

    Attributes:
        time: middle of a step, or of several (s).
        rate: mean rates in them, shape (n,).
    """

    time: float
    rate: np.ndarray


def lag(before: deque[Rate], now: Rate, cubes: float) -> np.ndarray:
    """h^3 |rate''| / 12: what lags of each signal over the span of a rate, shape (n,).

    Args:
        before: the two rates before; with less nothing is known, and zero.
        now: the rate.
        cubes: h^3 summed over the steps of its span (s^3).
    """
    if len(before) < 2:
        return np.zeros(len(now.rate))
    first, second = before
    bends = (now.rate - second.rate) / (now.time - second.time)
    bends -= (second.rate - first.rate) / (second.time - first.time)
    return cubes / 6.0 * np.abs(bends) / (now.time - first.time)


class Swings:
    """Follows signals that swing together, as energies do that mirror each other.

    Args:
        count: of the signals, n.

    Attributes:
        linear: lags of all steps, each of the largest of the signals.
        rates: of the last two steps.
    """

    def __init__(self, count: int):
        self.linear = self._slow = 0.0
        self.rates: deque[Rate] = deque(maxlen=2)
        self._means: deque[Rate] = deque(maxlen=2)
        self._steps = 0
        self._squares = np.zeros((2, count))  # of differences of second and third order
        self._since = np.zeros(count + 3)  # the last mean: h, h^3, h t, changes of the signals

    @property
    def amplitude(self) -> float:
        """Root mean square a of what swings fastest, of the largest of the signals."""
        second, third = self._squares
        some = third > 0.0
        swings = second[some] ** 1.5 / third[some]
        return float(swings.max(initial=0.0)) / math.sqrt(max(self._steps, 1))

    @property
    def error(self) -> float:
        """What lags, as far as it can."""
        return min(self.linear, self._slow + math.sqrt(2.0) * self.amplitude)

    @property
    def out_of_phase(self) -> float:
        """Share of the lags that is beyond the error: 0 in phase, 1 where phases are lost."""
        return 1.0 - self.error / self.linear if self.linear > 0.0 else 0.0

    def take(self, now: Rate, size: float) -> None:
        """Take a step of a size (s) and its rates."""
        self._steps += 1
        if len(self.rates) == 2:
            lags = lag(self.rates, now, size**3)
            turns = size * (now.rate - self.rates[-1].rate)
            self.linear += 0.5 * float(lags.max())  # amplitudes err by half as much
            self._squares += np.array([turns, 12.0 * lags]) ** 2
        self.rates.append(now)
        self._since += np.array([size, size**3, size * now.time, *(size * now.rate)])
        if self._steps % _A_MEAN == 0:
            span, cubes, moment = self._since[:3]
            mean = Rate(moment / span, self._since[3:] / span)
            self._slow += 0.5 * float(lag(self._means, mean, cubes).max())
            self._means.append(mean)
            self._since[:] = 0.0

    def saved(self) -> dict:
        """All of it."""
        rows = {k: np.array([[r.time, *r.rate] for r in vars(self)[k]]) for k in _ROWS}
        return vars(self) | rows

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        vars(self).update({k: np.copy(v) if np.ndim(v) else v for k, v in saved.items()})
        for name in _ROWS:
            rows = (Rate(float(row[0]), row[1:].copy()) for row in saved[name])
            vars(self)[name] = deque(rows, maxlen=2)
