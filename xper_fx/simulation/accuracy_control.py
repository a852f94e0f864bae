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
from dataclasses import dataclass
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
# Tightest tolerance, relative to the accuracy.
_TIGHTEST = 1e-3


@dataclass
class _Learnt:
    """What the run has shown of the step and of the tolerance.

    Attributes:
        base, least, size: of the ladder of steps, of its shortest step, of the next step (s).
        softening_step: in which a bond may snap (s).
        tolerance: of the impulses.
        same, tight_since: steps since the step, and the tolerance, were changed.
        smooth, ratio: estimate over what is allowed, of steps past and of the last one.
    """

    base: float
    least: float
    size: float
    softening_step: float
    tolerance: float
    same: int = 0
    tight_since: int = 0
    smooth: float = 0.0
    ratio: float = 0.0


@dataclass
class _Parts:
    """What the error is made of (J; 2D: J/m), but for `quiet`, steps without damage, and `missed`.

    Attributes:
        scale: largest energy held.
        quiet: steps since bonds were damaged.
        left, pending: by the time integration, by steps past and by the last one.
        numerical, closure: by impulses, and what the ledger misses.
        work: external.
        power: largest external power (W; 2D: W/m).
        missed: of a largest force, relative.
    """

    scale: float
    quiet: int
    left: float = 0.0
    pending: float = 0.0
    numerical: float = 0.0
    closure: float = 0.0
    work: float = 0.0
    power: float = 0.0
    missed: float = 0.0


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
        self._event_share = accuracy if interacting else math.sqrt(accuracy)
        self._interacting = interacting
        # what was learnt of the step and of the tolerance serves a control that starts alike
        self._starts_from = (accuracy, base or 0.0, largest, requested.tolerance)
        first = base or 0.0
        softest = max(softening_step, first)
        self._learnt = _Learnt(first, first, first, softest, requested.tolerance)
        self._parts = _Parts(energy, _REST)
        self._rates: deque[_Rate] = deque(maxlen=2)
        self._now = _Rate(0.0, np.zeros(3))

    @property
    def tolerance(self) -> float:
        """Of the impulses."""
        return self._learnt.tolerance

    @property
    def error(self) -> float:
        """Relative error estimated so far."""
        parts = self._parts
        if parts.scale == 0.0:
            return 0.0
        lost = max(parts.left, abs(parts.numerical), abs(parts.closure)) / parts.scale
        return max(lost, parts.missed)

    def size(self, time: float, end_time: float) -> float:
        """The next step (s), at most what is left to `end_time`."""
        learnt = self._learnt
        if learnt.base == 0.0:
            learnt.base = self._event_share * end_time
            learnt.least, learnt.size = learnt.base / _FINEST, learnt.base / _FIRST
        events = math.sqrt(2.0) * self._event_share * end_time  # the nearest of the ladder's steps
        most = min(learnt.size, self._largest, events)
        if self._parts.quiet < _REST:
            most = min(most, learnt.softening_step)
        size = learnt.base * 2.0 ** math.floor(math.log2(most / learnt.base) + 1e-9)
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
        learnt, parts = self._learnt, self._parts
        parts.pending, learnt.ratio = 0.0, 0.0
        if len(self._rates) == 2:
            first, second = self._rates
            bends = (now.rate - second.rate) / (now.time - second.time)
            bends -= (second.rate - first.rate) / (second.time - first.time)
            left = size**3 / 6.0 * np.abs(bends) / (now.time - first.time)
            # kinetic and elastic energy mirror each other; amplitudes err by half as much
            parts.pending = 0.5 * float(left.max())
            scale = max(parts.scale, energies.kinetic + energies.elastic)
            allowed = self._accuracy * max(float(np.abs(change).sum()), scale * size / end_time)
            learnt.ratio = float(left.sum()) / allowed if allowed > 0.0 else 0.0
            turn = float(np.abs(change - size * second.rate).sum())
            bound = _LARGEST_TURN * self._accuracy * scale
            coarse = learnt.ratio > _REJECT or turn > bound
            if self.adapts_step and size > learnt.least and coarse:
                learnt.ratio = max(learnt.ratio, (turn / bound) ** 2 if bound > 0.0 else 0.0)
                self._shorten(size)
                logger.info("step at %.3g s of h = %.3g s is too coarse", time, size)
                return False
        return True

    def _shorten(self, size: float) -> None:
        """Halve as often as the estimate asks for, but not below the shortest."""
        learnt = self._learnt
        halvings = 1
        if learnt.ratio > 0.0:
            halvings = min(max(1, round(0.5 * math.log2(learnt.ratio))), 3)
        learnt.size = max(size * 0.5**halvings, learnt.least)
        learnt.same, learnt.smooth = 0, 0.5

    def learn(
        self, size: float, energies: BulkEnergies, work: StepWork | None, closure: float
    ) -> None:
        """Take in a step that was committed, and what the energy ledger now misses."""
        learnt, parts = self._learnt, self._parts
        parts.closure = closure
        self._rates.append(self._now)
        parts.left += parts.pending
        held = energies.kinetic + energies.elastic
        parts.work += energies.work
        if work is not None:
            held += work.stored
            parts.quiet = 0 if work.cohesion > 0.0 else parts.quiet + 1
            parts.numerical += work.numerical
        parts.scale = max(parts.scale, held, abs(parts.work))
        if self._interacting and abs(energies.work) / size > parts.power:
            parts.power = abs(energies.work) / size
            parts.missed = 0.5 * abs(energies.work) / parts.scale
        self._adapt_tolerance()
        learnt.same += 1
        learnt.smooth += _FRESH * (learnt.ratio - learnt.smooth)
        spare = learnt.smooth < _SPARE and learnt.same >= _PATIENCE
        if learnt.smooth > 1.0:
            self._shorten(size)
        elif spare and size > 0.99 * learnt.size:
            learnt.size, learnt.same = min(2.0 * learnt.size, self._largest), 0

    def _adapt_tolerance(self) -> None:
        if not self._adapts_tolerance:
            return
        learnt, parts = self._learnt, self._parts
        learnt.tight_since += 1
        share = IMPULSES * self._accuracy
        if abs(parts.numerical) > share * parts.scale and learnt.tight_since >= _PATIENCE:
            learnt.tolerance = max(0.5 * learnt.tolerance, _TIGHTEST * self._accuracy)
            learnt.tight_since = 0

    def saved(self) -> dict:
        """What was learnt of the step and of the tolerance, and what the error is made of."""
        return {
            "starts_from": np.array(self._starts_from),
            "learnt": vars(self._learnt),
            "error": vars(self._parts),
            "rates": np.array([[r.time, *r.rate] for r in (*self._rates, self._now)]),
        }

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave; of another accuracy, step or tolerance only the error's parts."""
        if np.array_equal(np.array(self._starts_from), saved["starts_from"]):
            self._learnt = _Learnt(**saved["learnt"])
        self._parts = _Parts(**saved["error"])
        *rates, self._now = (_Rate(float(row[0]), row[1:].copy()) for row in saved["rates"])
        self._rates = deque(rates, maxlen=2)
