# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a run is on its way to an end time: which steps are left, and what is left of a cut one."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

logger = logging.getLogger(__name__)

# Steps of a picked explicit bulk above which a user is told that an implicit one may be cheaper.
_MANY_STEPS = 100_000
# Steps of a given size that hardly anyone waits for.
_TOO_MANY = 10**9
# Steps of an explicit bulk that begin in halves after one that had to be cut. Each change of the
# step feeds waves near the stability limit, where what the scheme conserves hangs on the step
# (`EnergyLedger`): steps that are cut now and then, and are whole between, are pumped.
_CAUTIOUS = 100
# Part of a step that may be rounding of the end time.
_LITTLE_LEFT = 1e-6


@dataclass
class Course:
    """The way to an end time."""

    end_time: float = math.nan  #: s
    step: float = 0.0  #: the step that was given (s)
    left: int = 0  #: whole steps left, where the step is given
    #: sizes (s) and halvings of what is left of a step that is cut, the next one last
    pieces: list[tuple[float, int]] = field(default_factory=list)
    resumes: bool = False  #: whether it was restored, and no step has been made since
    cautious: int = 0  #: steps to come that begin in halves

    def begin(self, size: float) -> None:
        """Begin the next step, of a size (s), in one piece or two."""
        if self.cautious > 0:
            self.cautious -= 1
            self.pieces += [(0.5 * size, 1)] * 2
        else:
            self.pieces.append((size, 0))

    def cut(self, size: float, halvings: int, explicit: bool) -> None:
        """Put two pieces in the place of one of a size (s) that has failed."""
        self.pieces += [(0.5 * size, halvings + 1)] * 2
        if explicit:
            self.cautious = _CAUTIOUS

    def rejoin(self, size: float) -> None:
        """Put one piece in the place of one of a size (s) that has failed and all that are left."""
        self.pieces[:] = [(size + sum(left for left, _ in self.pieces), 0)]

    def towards(self, time: float, end_time: float, step: float) -> Course:
        """The way from a time to an end time in steps of a size (s): this one where it resumes."""
        resumes, self.resumes = self.resumes, False
        if resumes and (self.end_time, self.step) == (end_time, step):
            return self
        count = math.ceil((end_time - time) / step - _LITTLE_LEFT)
        return Course(end_time, step, max(count, 0), cautious=self.cautious)

    def warn_of_units(self) -> None:
        """Warn of steps of a given size that hardly anyone waits for."""
        if self.left > _TOO_MANY:
            logger.warning(
                "%.3g steps of %.3g s to %g s: look at the units of step and end_time",
                self.left, self.step, self.end_time,
            )  # fmt: skip

    def suggest_implicit(self, time: float) -> None:
        """Tell that an implicit bulk may be cheaper than many explicit steps from a time (s) on."""
        count = (self.end_time - time) / self.step
        if count > _MANY_STEPS:
            logger.warning(
                '%.0f explicit steps to %g s: slow loads may be cheaper with scheme="implicit"',
                count, self.end_time,
            )  # fmt: skip

    def saved(self) -> dict:
        """All of it."""
        pieces = np.reshape(np.array(self.pieces, float), (-1, 2))
        return {
            "end_time": self.end_time, "step": self.step, "left": self.left, "pieces": pieces,
            "cautious": self.cautious,
        }  # fmt: skip

    @classmethod
    def restored(cls, saved: Mapping) -> Course:
        """From what `saved` gave."""
        pieces = [(size, int(halvings)) for size, halvings in saved["pieces"].tolist()]
        here = saved["end_time"], saved["step"], saved["left"]
        return cls(*here, pieces, True, saved["cautious"])
