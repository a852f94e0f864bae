# SPDX-License-Identifier: LGPL-3.0-or-later
"""Step and tolerances: what a user gave, and what an accuracy asked for is to pick."""

from __future__ import annotations

import logging
import math
from typing import NamedTuple

from xper_fx.support.checks import require_number, require_positive

logger = logging.getLogger(__name__)

# Share of an accuracy that impulses may make of the error, as tolerance and as energy; as tolerance
# of static steps, in each of which lips move by what it leaves.
IMPULSES, _STATIC_IMPULSES = 0.1, 1e-4
# A tolerance over the one that is picked from which it is looser.
_LOOSER = 1.5
# Without an accuracy: the tolerance of the impulses and of Newton's corrections, and the accuracy
# where only one of them is left to be picked. A static step finds impulses that bear all of a load,
# and what it leaves of them moves lips by so much of what the load moves, in each step again.
_TOLERANCE, _STATIC_TOLERANCE, _NEWTON_TOLERANCE, _ACCURACY = 1e-3, 1e-6, 1e-8, 1e-2
# Shortest step (s), and one over the longest.
_SHORTEST = 1e-150
# Newton's tolerance, relative to the accuracy.
_NEWTON = 1e-3


class RequestedAccuracy(NamedTuple):
    """What a user fixes and what is to be picked."""

    accuracy: float | None  #: relative error asked for, None if nothing is to be picked
    step: float | None  #: h (s), None if not given
    tolerance: float  #: of the impulses
    newton_tolerance: float  #: of the bulk
    adapts_step: bool  #: whether it is picked and adapted
    adapts_tolerance: bool  #: whether it is picked and adapted

    def doubt_tolerance(self) -> None:
        """Warn of a tolerance that leaves more, step after step, than the accuracy of a static run.

        The estimate of its error looks at each step alone.
        """
        picked = _STATIC_IMPULSES * (self.accuracy or math.inf)
        if self.tolerance > _LOOSER * picked:
            logger.warning(
                "a tolerance of %.3g is too loose for an accuracy of %.3g: what each static step "
                "leaves of the impulses moves lips, adds up over the steps and is not estimated; "
                "leave the tolerance out, or give %.2g",
                self.tolerance, self.accuracy, picked,
            )  # fmt: skip

    @classmethod
    def chosen(
        cls,
        accuracy: float | None,
        step: float | str | None,
        tolerance: float | str | None,
        newton_tolerance: float | None,
        inertia: bool = True,
    ) -> RequestedAccuracy:
        """From what was given: a number stays, None with an accuracy or "auto" is picked.

        Raises:
            ValueError: a number out of range, a word other than "auto".
        """
        for name, value in (("step", step), ("tolerance", tolerance)):
            if isinstance(value, str) and value != "auto":
                raise ValueError(f'{name} should be a number or "auto", got {value!r}.')
            if value is not None and not isinstance(value, str):
                require_positive(name, value)
        if step is not None and not isinstance(step, str) and not _SHORTEST < step < 1 / _SHORTEST:
            raise ValueError(
                f"step should lie between {_SHORTEST:g} and {1 / _SHORTEST:g} s, whose squares are "
                f"within the range of floats, got {step}."
            )
        if newton_tolerance is not None:
            newton_tolerance = require_positive("newton_tolerance", newton_tolerance)
        if accuracy is not None:
            accuracy = require_number("accuracy", accuracy)
        if accuracy is not None and not 0.0 < accuracy < 1.0:
            raise ValueError(f"accuracy should lie in (0, 1), a relative error; got {accuracy}.")
        picked = ("auto",) if accuracy is None else ("auto", None)
        adapts_step, adapts_tolerance = step in picked, tolerance in picked
        if accuracy is None and (adapts_step or adapts_tolerance):
            accuracy = _ACCURACY
        if adapts_tolerance:
            tolerance = (IMPULSES if inertia else _STATIC_IMPULSES) * accuracy
        elif tolerance is None:
            tolerance = _TOLERANCE if inertia else _STATIC_TOLERANCE
        if newton_tolerance is None:
            newton_tolerance = _NEWTON_TOLERANCE if accuracy is None else _NEWTON * accuracy
        return cls(
            accuracy,
            None if adapts_step else step,
            tolerance,
            newton_tolerance,
            adapts_step,
            adapts_tolerance,
        )
