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
    """Rates of n signals at a time; plain floats, as there are few and a step asks often.

    Attributes:
        time: middle of a step, or of several (s).
        rate: mean rates in them, n of them.
    """

    time: float
    rate: list[float]


def lag(before: deque[Rate], now: Rate, cubes: float) -> list[float]:
    """h^3 |rate''| / 12: what lags of each signal over the span of a rate, n of them.

    Args:
        before: the two rates before; with less nothing is known, and zero.
        now: the rate.
        cubes: h^3 summed over the steps of its span (s^3).
    """
    if len(before) < 2:
        return [0.0] * len(now.rate)
    (start, first), (middle, second) = before
    end, third = now
    ahead, behind, share = end - middle, middle - start, cubes / 6.0 / (end - start)
    return [
        share * abs((c - b) / ahead - (b - a) / behind)
        for a, b, c in zip(first, second, third, strict=True)
    ]


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
        # squares of differences of second and third order, summed
        self._second, self._third = [0.0] * count, [0.0] * count
        # since the last mean: h, h^3, h t; changes of the signals
        self._since, self._changes = [0.0] * 3, [0.0] * count

    @property
    def amplitude(self) -> float:
        """Root mean square a of what swings fastest, of the largest of the signals."""
        squares = zip(self._second, self._third, strict=True)
        swings = (second**1.5 / third for second, third in squares if third > 0.0)
        return max(swings, default=0.0) / math.sqrt(max(self._steps, 1))

    @property
    def error(self) -> float:
        """What lags, as far as it can."""
        return min(self.linear, self._slow + math.sqrt(2.0) * self.amplitude)

    @property
    def out_of_phase(self) -> float:
        """Share of the lags that is beyond the error: 0 in phase, 1 where phases are lost."""
        return 1.0 - self.error / self.linear if self.linear > 0.0 else 0.0

    def take(self, now: Rate, size: float, lagging: float = 1.0) -> None:
        """Take a step of a size (s) and its rates; waves lag so much of what they lag here."""
        self._steps += 1
        cube = size * size * size
        if len(self.rates) == 2:
            lags, last = lag(self.rates, now, cube), self.rates[-1].rate
            self.linear += 0.5 * lagging * max(lags)  # amplitudes err by half as much
            for i, (c, b) in enumerate(zip(now.rate, last, strict=True)):
                self._second[i] += (size * (c - b)) ** 2
                self._third[i] += (12.0 * lags[i]) ** 2
        self.rates.append(now)
        span, cubes, moment = self._since
        self._since = [span + size, cubes + cube, moment + size * now.time]
        self._changes = [a + size * b for a, b in zip(self._changes, now.rate, strict=True)]
        if self._steps % _A_MEAN == 0:
            span, cubes, moment = self._since
            mean = Rate(moment / span, [change / span for change in self._changes])
            self._slow += 0.5 * lagging * max(lag(self._means, mean, cubes))
            self._means.append(mean)
            self._since, self._changes = [0.0] * 3, [0.0] * len(now.rate)

    def saved(self) -> dict:
        """All of it."""
        rows = {k: np.array([[r.time, *r.rate] for r in vars(self)[k]]) for k in _ROWS}
        return {k: np.array(v) if isinstance(v, list) else v for k, v in vars(self).items()} | rows

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        vars(self).update({k: v.tolist() if np.ndim(v) else v for k, v in saved.items()})
        for name in _ROWS:
            rows = (Rate(float(row[0]), row[1:].tolist()) for row in saved[name])
            vars(self)[name] = deque(rows, maxlen=2)
