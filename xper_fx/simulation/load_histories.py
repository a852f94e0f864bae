# SPDX-License-Identifier: LGPL-3.0-or-later
"""What loads do within a step, so that steps are not taken over what no end of theirs shows.

A run without inertia knows no time but that of its loads. Steps that are picked from the states at
their ends alone would take a load of period T, in steps of T or T / 2, for none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from xper_fx.forms.loads import InitialStress, value_at
from xper_fx.scene.scene import Scene

# Where loads are looked at within a step, as shares of it that no period divides.
_WITHIN = np.array([0.137, 0.291, 0.382, 0.618, 0.709, 0.863])
# The same over a run, to tell how far they go.
_OVER = np.append(np.arange(100) * 0.6180339887498949 % 1.0, 1.0)
# How far a load may be from the line between the ends of a step, over its range: the middle of a
# quarter of a sine from its zero is 0.21 of the amplitude from it.
_BENT = 0.15
# Share of the largest component of a load that is rounding, as of velocities that are differences.
_ROUNDING = 1e-9


class LoadHistories:
    """Loads of a scene that are functions of time."""

    def __init__(self, scene: Scene):
        self._functions = list(_functions(scene))
        self._end_time, self._ranges = -1.0, [np.zeros(0)] * len(self._functions)

    def bend(self, time: float, size: float, end_time: float) -> bool:
        """Whether loads are far from linear in a step, as far as the run goes.

        Args:
            time, size: start of the step and h (s).
            end_time: of the run (s).
        """
        if self._end_time != end_time:
            self._end_time = end_time
            self._ranges = [_range(_values(f, end_time * _OVER)) for f in self._functions]
        size = min(size, end_time - time)
        for function, over_run in zip(self._functions, self._ranges, strict=True):
            first, last = _values(function, time + size * np.array([0.0, 1.0]))
            within = _values(function, time + size * _WITHIN)
            off = np.abs(within - first - _WITHIN[:, None] * (last - first))
            if np.any(off > _BENT * np.maximum(over_run, np.ptp(within, axis=0))):
                return True
        return False


def _range(values: np.ndarray) -> np.ndarray:
    """How far each component goes, and what would be rounding of the largest at least."""
    return np.maximum(np.ptp(values, axis=0), _ROUNDING / _BENT * np.abs(values).max())


def _values(function: Callable[[float], object], times: np.ndarray) -> np.ndarray:
    """Components of a load at times, shape (num_times, num_components)."""
    return np.array([_components(function(time), time) for time in times])


def _components(given: object, time: float) -> list[float]:
    """What a load's function gives, in all forms that loads take."""
    return [value_at(each, time) for each in (given if np.iterable(given) else (given,))]


def _functions(scene: Scene) -> Iterator[Callable[[float], object]]:
    """All functions of time among the loads' values."""
    drive = scene.macroscopic
    parts = () if drive is None else (drive.gradient, drive.rate, drive.stress)
    values = [value for part in parts for value in part.values()]
    values += [load.value for load in scene.loads if not isinstance(load, InitialStress)]
    for value in values:
        if callable(value):
            yield value
        elif np.iterable(value):
            yield from (component for component in value if callable(component))
