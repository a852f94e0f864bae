# SPDX-License-Identifier: LGPL-3.0-or-later
"""Step and tolerance for a relative error asked for, from what a run shows of itself.

None of what makes the error (`error_estimate.py`) is made better than the others:

- **time integration**: what a step leaves is held to the share `accuracy` of what the energies
  change by in the step. A vibration of one frequency omega is so stepped with
  (omega h)^2 / 3 = accuracy. A step that leaves much more is taken again, shorter. Below 0.7 of the
  critical step of the bulk it never goes for that: there the mesh's own dispersion is what is left.
  In static flow nothing lags (`error_estimate.py`): doubled steps say how long steps may be, and a
  power that bends only tells, sooner than they do, that the path turns. Where flow begins, cell by
  cell, it always bends, and counts a quarter. Where nothing but the bulk takes energy, what a
  static step misses of it counts, too;
- **loads** of static runs: a step ends before they have gone far from a line (`load_histories.py`);
- **events**: what breaks, closes or slides does so somewhere within a step: h <= accuracy * end
  time where there are interactions, and the square root of it where everything is smooth, as it is
  where contacts are searched until bodies touch: a longer step in which they do is taken again. A
  step in which power turns so suddenly that it moves more than 12 times `accuracy` of the energy
  held (an impact) is taken again, shorter;
- **weakening bonds**: where the softening number (`cohesive_scales.py`) exceeds one a bond may snap
  within a step; while bonds weaken the step stays below that, but not below 0.7 of the critical
  step either: what follows is then faster than the mesh can carry. Initially rigid bonds have
  several states beyond, not only fast ones: while they weaken the snap number
  (`nscd/laws/softening.py`), with the cells that move with them, is held below one, by steps of
  no less than a quarter of the shortest otherwise. The first bonds that open tell it, a step late.
  The step of an explicit bulk falls for it and does not rise again: each change near the critical
  step gives the fastest vibrations energy, and one that goes up and down feeds them without end;
- **impulses**: their tolerance is a tenth of `accuracy`, in static runs, where each step adds what
  it leaves to the motion, a ten-thousandth. What they leave of wrong sign
  (`StepWork.numerical`), summed over the run, is held to a tenth of `accuracy` of the largest
  energy: above, the tolerance is halved.

What theta above 1/2 damps is told and not fought: it is what such a theta is taken for.

Steps are those of a ladder, `base` times powers of two, as a linear bulk keeps its factors for each
size.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from xper_fx.bulk.state import StepOutcome
from xper_fx.nscd.stepped_points import StepWork
from xper_fx.simulation.energy_ledger import BulkEnergies
from xper_fx.simulation.error_estimate import REST, ErrorEstimate
from xper_fx.simulation.load_histories import LoadHistories
from xper_fx.simulation.requested_accuracy import IMPULSES, RequestedAccuracy

logger = logging.getLogger(__name__)

# Estimate over what is allowed, above which a step is taken again.
_REJECT = 4.0
# What a power that bends counts where static flow begins.
_BEGINS = 0.25
# Energy by which a step may differ from going on at the last power, relative to accuracy and energy
# held: four times what a vibration stepped as asked for does.
_LARGEST_TURN = 12.0
# Estimate over what is allowed, expected of a longer step, below which it is taken.
_SPARE = 0.6
# Weight of the last step in the mean of the estimates.
_FRESH = 0.5
# Steps of a size before a larger one is tried, and before a tolerance is halved again; of a static
# run before a larger one.
_PATIENCE, _STATIC_PATIENCE = 3, 2
# Steps of an implicit bulk in whose time none is too long, before it takes an explicit one's place.
_A_WHILE = 8
# An adapted step with inertia stays below this multiple of the first: rounding leaves the mass.
LARGEST_GROWTH = 1e5
# A static run starts with this part of its longest step, and its shortest is that part.
_FIRST, _FINEST = 4, 64
# Difference of steps, relative, that is rounding, as of what is left to the end time.
_ALIKE = 1e-9
# Shortest step for bonds that snap, over the shortest otherwise.
_SNAPPING = 0.25
# Tightest tolerance, relative to the accuracy, unless a run begins with a tighter one.
_TIGHTEST = 1e-3


@dataclass
class _Learnt:
    """What the run has shown of the step and of the tolerance."""

    #: base, least, size: of the ladder of steps, of its shortest step, of the next step (s)
    base: float
    least: float
    size: float
    largest: float  #: no step is longer (s)
    softening_step: float  #: in which a bond may snap (s)
    tolerance: float  #: of the impulses
    meets: bool  #: whether there are interactions; bodies that touched, if these are to be found
    end_time: float = 0.0  #: for which a static run has its ladder (s)
    #: time for which steps as long as `awaited` would have left little enough (s)
    calm: float = 0.0
    #: same, tight_since: steps since the step, and the tolerance, were changed
    same: int = 0
    tight_since: int = 0
    #: smooth, ratio: estimate over what is allowed, of steps past and of the last one
    smooth: float = 0.0
    ratio: float = 0.0
    rough: float = 0.0  #: the same of the last steps that were doubled
    #: snap_step, one_state: above which initially rigid bonds may snap that have weakened of late,
    #: or ever (s)
    snap_step: float = np.inf
    one_state: float = np.inf
    snapped: float = 0.0  #: largest snap number so far


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

    Attributes:
        adapts_step: whether it picks the step.
        tolerance: of the impulses.
        awaited: step (s) that an explicit bulk gives its place to an implicit one for; infinite
            for others.
    """

    def __init__(
        self,
        requested: RequestedAccuracy,
        base: float | None,
        *,
        largest: float,
        softening_step: float,
        interacting: bool,
        estimate: ErrorEstimate,
        histories: LoadHistories,
    ):
        accuracy = requested.accuracy
        self._accuracy, self._shares = accuracy, (math.sqrt(accuracy), accuracy)
        self.adapts_step, self._adapts_tolerance = requested.adapts_step, requested.adapts_tolerance
        self._tightest = min(requested.tolerance, _TIGHTEST * accuracy)
        self._static, self._histories = base is None, histories
        self._patience = _STATIC_PATIENCE if self._static else _PATIENCE
        self._interacting = interacting
        self._strikes = interacting or not self._static  # else power turns smoothly
        # what was learnt of the step and of the tolerance serves a control that starts alike
        self._starts_from = (accuracy, base or 0.0, largest, requested.tolerance)
        first = base or 0.0
        softest = max(softening_step, first)
        self._learnt = _Learnt(
            first, first, first, largest, softest, requested.tolerance, interacting
        )
        self.estimate, self.awaited = estimate, np.inf
        self._allowed = np.inf  # what the last step may leave (J; 2D: J/m)
        self._rest = np.inf  # of the run after the last step (s)
        self._counts = 1.0  # what its bends do

    @property
    def tolerance(self) -> float:
        """Of the impulses."""
        return self._learnt.tolerance

    @property
    def snapped(self) -> tuple[float, float]:
        """Largest snap number so far, and the step (s) that would have made it one."""
        return self._learnt.snapped, self._learnt.one_state

    @property
    def at_floor(self) -> bool:
        """Whether the step it picks is as short as it goes."""
        return self.adapts_step and self._learnt.size <= self._learnt.least

    def size(self, time: float, end_time: float) -> float:
        """The next step (s), at most what is left to `end_time`."""
        learnt = self._learnt
        if self._static and learnt.end_time != end_time:
            self._scale_with(end_time)
        most = min(learnt.size, learnt.largest, self._events(end_time))
        if self._static:
            while most > learnt.least and self._histories.bend(time, most, end_time):
                most *= 0.5
        weakens = self.estimate.quiet < REST
        if weakens:
            most = min(most, learnt.softening_step)
        if weakens or self._only_falls:
            most = min(most, max(learnt.snap_step, _SNAPPING * learnt.least))
        size = learnt.base
        if most != size:
            size *= 2.0 ** math.floor(math.log2(most / size) + _ALIKE)
        left = end_time - time
        count = math.ceil(left / size - _ALIKE)
        return left / count if count <= 2 else size

    def _scale_with(self, end_time: float) -> None:
        """Let the ladder of a static run, and where it stands on it, be those of an end time.

        The ladder moves by a power of two, so that its steps stay steps of it.
        """
        learnt, base = self._learnt, self._event_share(self._interacting) * end_time
        if learnt.base == 0.0:
            learnt.base, learnt.size = base, base / _FIRST
        times = 2.0 ** round(math.log2(base / learnt.base))
        learnt.base, learnt.size = times * learnt.base, times * learnt.size
        learnt.least, learnt.end_time = learnt.base / _FINEST, end_time

    def _event_share(self, meets: bool) -> float:
        """Longest step over the end time, where interactions bear or not."""
        return self._shares[meets]

    def _events(self, end_time: float) -> float:
        """Longest step (s) for events: the nearest of the ladder's."""
        return math.sqrt(2.0) * self._event_share(self._learnt.meets) * end_time

    @property
    def _only_falls(self) -> bool:
        """Whether the step is that of an explicit bulk."""
        return not self._static and self._learnt.largest <= self._learnt.base

    def outgrows(self, end_time: float) -> bool:
        """Whether steps may be as long as `awaited`, from what many left."""
        calm = self._learnt.calm >= _A_WHILE * self.awaited
        return calm and self.awaited <= self._events(end_time)

    def leave_explicit(self, least: float) -> None:
        """Pick steps of an implicit bulk from now on, the shortest `least` (s), first `awaited`."""
        learnt = self._learnt
        learnt.base, learnt.least, learnt.size = least, least, self.awaited
        learnt.largest, learnt.same = LARGEST_GROWTH * least, 0
        self.estimate.lagging = 1.0

    @property
    def waits(self) -> bool:
        """Whether nothing has touched yet of what is to be found."""
        return self._interacting and not self._learnt.meets

    def wait(self) -> None:
        """Let there be no interactions before bodies touch, as all are to be found."""
        self._learnt.meets = False

    def meet(self, size: float, end_time: float) -> bool:
        """Take it that bodies touch first in a step (s); whether it is too long to tell when."""
        self._learnt.meets = True
        return self.adapts_step and size > self._events(end_time)

    def accepts(
        self,
        time: float,
        size: float,
        energies: BulkEnergies,
        outcome: StepOutcome,
        end_time: float,
    ) -> bool:
        """Whether a step from `time` is as accurate as asked for; if not the next is shorter.

        Args:
            time: at the start of the step (s).
            size: h (s).
            energies: of the bulk at the end of the step.
            end_time: of the run (s), over which the error is spread.
        """
        learnt, estimate = self._learnt, self.estimate
        left, turn, moved = estimate.see(time, size, energies, outcome.state.displacement)
        scale = estimate.scale
        share = max(moved, scale * size / end_time, estimate.noise)
        self._allowed = self._accuracy * share or np.inf
        self._rest = end_time - time - size
        doubling = estimate.doubling
        self._counts = _BEGINS if doubling is not None and doubling.begins else 1.0
        if not self._strikes:  # nothing else takes energy: what is missing is the step's
            stored = energies.kinetic_change + energies.elastic_change
            lost = energies.plastic + energies.viscous
            left = max(left, abs(energies.work - stored - lost))
        learnt.ratio = left / self._allowed
        bound = _LARGEST_TURN * self._accuracy * scale if self._strikes else np.inf
        coarse = self._counts * learnt.ratio > _REJECT or turn > bound
        if self.adapts_step and size > (1.0 + _ALIKE) * learnt.least and coarse:
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
        learnt.rough *= (0.5 if self._static else 0.25) ** halvings

    def learn(
        self,
        size: float,
        energies: BulkEnergies,
        work: StepWork | None,
        closure: float,
        outcome: StepOutcome,
        snap: float,
    ) -> None:
        """Take in a step that was committed, what the energy ledger now misses, its snap number."""
        learnt, doubling = self._learnt, self.estimate.doubling
        self.estimate.take(size, energies, work, closure, outcome)
        if self.estimate.quiet >= REST and not self._only_falls:
            learnt.snap_step = np.inf
        elif snap > 0.0:
            learnt.snap_step = min(learnt.snap_step, size / math.sqrt(snap))
            learnt.one_state = min(learnt.one_state, learnt.snap_step)
            learnt.snapped = max(learnt.snapped, snap)
        if work is not None and self._adapts_tolerance:
            self._adapt_tolerance()
        if doubling is not None and doubling.take(size, energies, self._rest):
            learnt.rough = doubling.local / self._allowed
        if self.awaited < np.inf:
            calm = (self.awaited / size) ** 2 * learnt.ratio < _SPARE
            learnt.calm = learnt.calm + size if calm else 0.0
        learnt.same += 1
        learnt.smooth += _FRESH * (self._counts * learnt.ratio - learnt.smooth)
        if max(learnt.smooth, learnt.rough) > 1.0:
            self._shorten(size)
        elif learnt.same >= self._patience and 0.99 * learnt.size < size < learnt.largest:
            times = self._longer()
            if times > 1.0:
                learnt.size, learnt.same = min(times * learnt.size, learnt.largest), 0
                learnt.rough *= times

    def _longer(self) -> float:
        """How many times longer the next step may be, a power of two.

        What is left over what is allowed grows with the square of the step, as the time integration
        is of second order; what a material leaves in a static run is of first order and grows with
        the step (with inertia, waves grow beside it). A static run begins with a short step, which
        may grow faster.
        """
        learnt = self._learnt
        for times in (4.0, 2.0) if self._static else (2.0,):
            smooth, rough = times**2 * learnt.smooth, times**2 * learnt.rough
            if self._static:
                rough = times * learnt.rough * _SPARE  # may reach what is allowed
            if max(smooth, rough) < _SPARE:
                return times
        return 1.0

    def _adapt_tolerance(self) -> None:
        learnt = self._learnt
        learnt.tight_since += 1
        wrong = self.estimate.numerical
        if wrong > IMPULSES * self._accuracy and learnt.tight_since >= _PATIENCE:
            learnt.tolerance = max(0.5 * learnt.tolerance, self._tightest)
            learnt.tight_since = 0

    def saved(self) -> dict:
        """What was learnt of the step and of the tolerance, and what the error is made of."""
        return {
            "starts_from": np.array(self._starts_from),
            "learnt": vars(self._learnt),
            "estimate": self.estimate.saved(),
        }

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave; of another accuracy, step or tolerance only the errors."""
        if np.array_equal(np.array(self._starts_from), saved["starts_from"]):
            self._learnt = _Learnt(**saved["learnt"])
        self.estimate.restore(saved["estimate"])
