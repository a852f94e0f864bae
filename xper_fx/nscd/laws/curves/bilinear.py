# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two straight lines: Petersson's curve of concrete, and the trapezoid of ductile bonds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions
from xper_fx.support.checks import require_between, take_numbers

# A shape is d0, dc, the opening d1 of the knee, and its traction over the strength.


@njit(**LEAN_INNER)
def _fall(x, p):
    if x <= p[2]:
        return p[0] / x * (1.0 - (1.0 - p[3]) * (x - p[0]) / (p[2] - p[0]))
    return p[0] / x * p[3] * (p[1] - x) / (p[1] - p[2])


@njit(**LEAN_INNER)
def _area(a, b, g, p):
    total = 0.0
    if a < p[2]:
        top = min(b, p[2])
        lost = (1.0 - p[3]) * (0.5 * (a + top) - p[0]) / (p[2] - p[0])
        total += p[0] * (top - a) * (1.0 - lost)
    if b > p[2]:
        start = max(a, p[2])
        total += p[0] * p[3] * (b - start) * (p[1] - 0.5 * (start + b)) / (p[1] - p[2])
    return total


def _steepest(shape, stiffness):
    d0, dc, d1, share = shape
    return stiffness * d0 * np.maximum((1.0 - share) / (d1 - d0), share / (dc - d1))


@dataclass(frozen=True)
class Petersson:
    """Two descending lines that meet in a knee (Petersson 1981).

    The widening of the crack x - T / k is `knee_opening` w / s at the knee and, so that the area is
    w, 3.6 w / s at the end with the values of Petersson.

    Args:
        knee_traction: traction at the knee, over the strength, in (0, 1).
        knee_opening: widening at the knee, over w / s.

    Raises:
        ValueError: a knee above the straight line to the end, whose curve would not be convex.
    """

    knee_traction: float = 1.0 / 3.0
    knee_opening: float = 0.8
    functions: ClassVar = CurveFunctions(_fall, _area)
    knees: ClassVar = (2,)

    def __post_init__(self) -> None:
        take_numbers(self, "knee_traction", "knee_opening")
        require_between("knee_traction", self.knee_traction, 0.0, 1.0)
        most = 2.0 * (1.0 - self.knee_traction)
        require_between("knee_opening", self.knee_opening, 0.0, most)

    @property
    def constants(self) -> tuple[float, ...]:
        """Traction and widening at the knee."""
        return self.knee_traction, self.knee_opening

    def own_stiffness(self, strength, energy) -> None:
        """The stiffness is free."""

    @staticmethod
    def shape(stiffness, strength, energy, share, knee):
        """d0, dc, d1 (m) and the share of the traction at d1."""
        d0, unit = strength / stiffness, energy / strength
        end = knee + (2.0 - knee * (1.0 + share)) / share
        return d0, end * unit, knee * unit + share * d0, share

    steepest = staticmethod(_steepest)


@dataclass(frozen=True)
class Trapezoidal:
    """A plateau at the strength, then a straight line (Tvergaard and Hutchinson 1992).

    Args:
        plateau: opening at the end of the plateau over dc, in (0, 1); w = s (dc (1 + plateau) - d0)
            / 2.
    """

    plateau: float = 0.5
    functions: ClassVar = CurveFunctions(_fall, _area)
    knees: ClassVar = (2,)

    def __post_init__(self) -> None:
        take_numbers(self, "plateau")
        require_between("plateau", self.plateau, 0.0, 1.0)

    @property
    def constants(self) -> tuple[float, ...]:
        """End of the plateau over dc."""
        return (self.plateau,)

    def own_stiffness(self, strength, energy) -> None:
        """The stiffness is free."""

    @staticmethod
    def shape(stiffness, strength, energy, plateau):
        """d0, dc, the end of the plateau (m), and 1."""
        d0 = strength / stiffness
        dc = (2.0 * energy / strength + d0) / (1.0 + plateau)
        return d0, dc, plateau * dc, 1.0

    steepest = staticmethod(_steepest)
