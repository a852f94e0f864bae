# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where a run is on its way to an end time: which steps are left, and what is left of a cut one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

# Part of a step that may be rounding of the end time.
_LITTLE_LEFT = 1e-6


@dataclass
class Course:
    """The way to an end time.

    Attributes:
        end_time: s.
        step: the step that was given (s).
        left: whole steps left, where the step is given.
        pieces: sizes (s) and halvings of what is left of a step that is cut, the next one last.
    """

    end_time: float = math.nan
    step: float = 0.0
    left: int = 0
    pieces: list[tuple[float, int]] = field(default_factory=list)

    @classmethod
    def planned(cls, time: float, end_time: float, step: float) -> Course:
        """The way from a time (s) to an end time (s) in steps of a size (s)."""
        count = math.ceil((end_time - time) / step - _LITTLE_LEFT)
        return cls(end_time, step, max(count, 0))

    def is_to(self, end_time: float, step: float) -> bool:
        """Whether it leads to an end time with a step."""
        return self.end_time == end_time and self.step == step

    def saved(self) -> dict:
        """All of it."""
        pieces = np.reshape(np.array(self.pieces, float), (-1, 2))
        return vars(self) | {"pieces": pieces}

    @classmethod
    def restored(cls, saved: Mapping) -> Course:
        """From what `saved` gave."""
        pieces = [(size, int(halvings)) for size, halvings in saved["pieces"].tolist()]
        return cls(saved["end_time"], saved["step"], saved["left"], pieces)
