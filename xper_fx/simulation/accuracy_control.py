# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Step and tolerance for a relative error asked for, from what a run shows of itself.

The error asked for is that of global quantities: energies, work, largest force. Four things make
it, each has a cheap estimate, and none is made better than the others:

- **time integration**: with P = dE/dt of the external work, the kinetic and the elastic energy, a
  scheme of second order leaves about h^3 |P''| / 12 a step. P'' comes from the last three steps. It
  is held to the share `accuracy` of what the energies change by in the step. A vibration of one
  frequency omega is so stepped with (omega h)^2 / 3 = accuracy. A step that leaves much more is
  taken again, shorter. Below 0.7 of the critical step of the bulk it never goes for that: there
  the mesh's own dispersion is what is left, and `error` says so if it is more than asked for;
- **events**: what breaks, closes or slides does so somewhere within a step, so that a largest force
  is missed by the force's growth in a step: h <= accuracy * end time where there are interactions,
  and the square root of it where everything is smooth. A step in which power turns so suddenly that
  it moves more than 12 times `accuracy` of the energy held (an impact) is taken again, shorter;
- **weakening bonds**: where the softening number (`xper_fx/output/cohesive_scales.py`) exceeds one
  a bond may snap within a step; while bonds weaken the step stays below that, but not below 0.7 of
  the critical step either: what follows is then faster than the mesh can carry;
- **impulses**: their tolerance is a tenth of `accuracy`. What they leave of wrong sign
  (`StepWork.numerical`), summed over the run, is held to a tenth of `accuracy` of the largest
  energy: above, the tolerance is halved.

The closure of the energy ledger stands beside these in `error`: it is what the integration of the
materials and an explicit bulk leave.

Steps are those of a ladder, `base` times powers of two, as a linear bulk keeps its factors for each
size.
"""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from xper_fx.nscd.stepped_points import StepWork
from xper_fx.simulation.energy_ledger import BulkEnergies
from xper_fx.simulation.requested_accuracy import IMPULSES, RequestedAccuracy

logger = logging.getLogger(__name__)

# Estimate over what is allowed, above which a step is taken again.
_REJECT = 4.0
# Energy by which a step may differ from going on at the last power, relative to accuracy and energy
# held: four times what a vibration stepped as asked for does.
_LARGEST_TURN = 12.0
# Estimate over what is allowed below which the step is doubled: it then grows fourfold.
_SPARE = 0.15
# Weight of the last step in the mean of the estimates.
_FRESH = 0.5
# Steps of a size before a larger one is tried, and before a tolerance is halved again.
_PATIENCE = 3
# A static run starts with this part of its longest step, and its shortest is that part.
_FIRST, _FINEST = 8, 64
# Steps without damage after which bonds count as at rest.
_REST = 20
# What a control keeps from step to step: of step and tolerance, and of the error.
_LEARNT = (
    "_base", "_least", "_size", "_softening_step", "tolerance", "_same", "_tight_since", "_smooth",
    "_ratio",
)  # fmt: skip
_ERROR = (
    "_scale", "_quiet", "_left", "_pending", "_numerical", "_closure", "_work", "_power", "_missed",
)  # fmt: skip
# Tightest tolerance, relative to the accuracy.
_TIGHTEST = 1e-3


class _Rate(NamedTuple):
    """Rates of external work, kinetic and elastic energy (W; 2D: W/m) at the middle of a step."""

    time: float
    rate: np.ndarray


class AccuracyControl:
    """Picks step sizes and the tolerance of the impulses.

    Args:
        requested: what is to be picked, and for which accuracy.
        base: a step of the ladder (s) and the shortest: 0.7 of the critical step of the bulk, 0.95
            where it is explicit and linear, or the step given. None for a
            static run, whose scale of time is the end time.
        largest: no step is longer (s).
        softening_step: step (s) above which weakening bonds may snap; infinite without such.
        interacting: whether the scene has interactions.
        energy: energy held at the start (J; 2D: J/m).

    Attributes:
        adapts_step: whether it picks the step.
        tolerance: of the impulses.
        error: relative error estimated so far: the largest of these.
    """

    def __init__(
        self,
        requested: RequestedAccuracy,
        base: float | None,
        *,
        largest: float,
        softening_step: float,
        interacting: bool,
        energy: float,
    ):
        accuracy = requested.accuracy
        self._accuracy = accuracy
        self.adapts_step, self._adapts_tolerance = requested.adapts_step, requested.adapts_tolerance
        self._largest = largest
        self._softening_step = softening_step
        self._event_share = accuracy if interacting else math.sqrt(accuracy)
        self._interacting = interacting
        # what was learnt of the step and of the tolerance serves a control that starts alike
        self._starts_from = (accuracy, base or 0.0, largest, requested.tolerance)
        self._base = self._least = self._size = 0.0
        if base is not None:
            self._base = self._least = self._size = base
            self._softening_step = max(softening_step, base)
        self.tolerance = requested.tolerance
        self._rates: deque[_Rate] = deque(maxlen=2)
        self._scale, self._quiet, self._same, self._tight_since = energy, _REST, 0, 0
        self._now, self._ratio, self._smooth = _Rate(0.0, np.zeros(3)), 0.0, 0.0
        self._left = self._pending = self._numerical = self._closure = 0.0
        self._work = self._power = self._missed = 0.0

    @property
    def error(self) -> float:
        """Relative error estimated so far."""
        if self._scale == 0.0:
            return 0.0
        lost = max(self._left, abs(self._numerical), abs(self._closure)) / self._scale
        return max(lost, self._missed)

    def size(self, time: float, end_time: float) -> float:
        """The next step (s), at most what is left to `end_time`."""
        if self._base == 0.0:
            self._base = self._event_share * end_time
            self._least, self._size = self._base / _FINEST, self._base / _FIRST
        events = math.sqrt(2.0) * self._event_share * end_time  # the nearest of the ladder's steps
        most = min(self._size, self._largest, events)
        if self._quiet < _REST:
            most = min(most, self._softening_step)
        size = self._base * 2.0 ** math.floor(math.log2(most / self._base) + 1e-9)
        left = end_time - time
        count = math.ceil(left / size - 1e-9)
        return left / count if count <= 2 else size

    def accepts(self, time: float, size: float, energies: BulkEnergies, end_time: float) -> bool:
        """Whether a step from `time` is as accurate as asked for; if not the next is shorter.

        Args:
            time: at the start of the step (s).
            size: h (s).
            energies: of the bulk at the end of the step.
            end_time: of the run (s), over which the error is spread.
        """
        change = np.array([energies.work, energies.kinetic_change, energies.elastic_change])
        now = self._now = _Rate(time + 0.5 * size, change / size)
        self._pending, self._ratio = 0.0, 0.0
        if len(self._rates) == 2:
            first, second = self._rates
            bends = (now.rate - second.rate) / (now.time - second.time)
            bends -= (second.rate - first.rate) / (second.time - first.time)
            left = size**3 / 6.0 * np.abs(bends) / (now.time - first.time)
            # kinetic and elastic energy mirror each other; amplitudes err by half as much
            self._pending = 0.5 * float(left.max())
            scale = max(self._scale, energies.kinetic + energies.elastic)
            allowed = self._accuracy * max(float(np.abs(change).sum()), scale * size / end_time)
            self._ratio = float(left.sum()) / allowed if allowed > 0.0 else 0.0
            turn = float(np.abs(change - size * second.rate).sum())
            bound = _LARGEST_TURN * self._accuracy * scale
            if self.adapts_step and size > self._least and (self._ratio > _REJECT or turn > bound):
                self._ratio = max(self._ratio, (turn / bound) ** 2 if bound > 0.0 else 0.0)
                self._shorten(size)
                logger.info("step at %.3g s of h = %.3g s is too coarse", time, size)
                return False
        return True

    def _shorten(self, size: float) -> None:
        """Halve as often as the estimate asks for, but not below the shortest."""
        halvings = min(max(1, round(0.5 * math.log2(self._ratio))), 3) if self._ratio > 0.0 else 1
        self._size = max(size * 0.5**halvings, self._least)
        self._same, self._smooth = 0, 0.5

    def learn(
        self, size: float, energies: BulkEnergies, work: StepWork | None, closure: float
    ) -> None:
        """Take in a step that was committed, and what the energy ledger now misses."""
        self._closure = closure
        self._rates.append(self._now)
        self._left += self._pending
        held = energies.kinetic + energies.elastic
        self._work += energies.work
        if work is not None:
            held += work.stored
            self._quiet = 0 if work.cohesion > 0.0 else self._quiet + 1
            self._numerical += work.numerical
        self._scale = max(self._scale, held, abs(self._work))
        if self._interacting and abs(energies.work) / size > self._power:
            self._power = abs(energies.work) / size
            self._missed = 0.5 * abs(energies.work) / self._scale
        self._adapt_tolerance()
        self._same += 1
        self._smooth += _FRESH * (self._ratio - self._smooth)
        if self._smooth > 1.0:
            self._shorten(size)
        elif self._smooth < _SPARE and self._same >= _PATIENCE and size > 0.99 * self._size:
            self._size, self._same = min(2.0 * self._size, self._largest), 0

    def _adapt_tolerance(self) -> None:
        if not self._adapts_tolerance:
            return
        self._tight_since += 1
        share = IMPULSES * self._accuracy
        if abs(self._numerical) > share * self._scale and self._tight_since >= _PATIENCE:
            self.tolerance = max(0.5 * self.tolerance, _TIGHTEST * self._accuracy)
            self._tight_since = 0

    def saved(self) -> dict:
        """What was learnt of the step and of the tolerance, and what the error is made of."""
        return {
            "starts_from": np.array(self._starts_from),
            "learnt": {name: getattr(self, name) for name in _LEARNT},
            "error": {name: getattr(self, name) for name in _ERROR},
            "rates": np.array([[r.time, *r.rate] for r in (*self._rates, self._now)]),
        }

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave; of another accuracy, step or tolerance only the error's parts."""
        learnt = saved["learnt"] if self._continues(saved["starts_from"]) else {}
        for name, value in {**learnt, **saved["error"]}.items():
            setattr(self, name, value)
        *rates, self._now = (_Rate(float(row[0]), row[1:].copy()) for row in saved["rates"])
        self._rates = deque(rates, maxlen=2)

    def _continues(self, starts_from: np.ndarray) -> bool:
        return np.array_equal(np.array(self._starts_from), starts_from)
