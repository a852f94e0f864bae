# SPDX-License-Identifier: LGPL-3.0-or-later
"""The curve of Tvergaard 1990, (27/4) s y (1 - y)^2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions

# Nodes of Gauss's rule of two points, exact here, from the middle in half lengths.
_NODE = 3.0**-0.5


@njit(**LEAN_INNER)
def _fall(x, p):
    left = 1.0 - x / p[1]
    return left * left


@njit(**LEAN_INNER)
def _area(a, b, g, p):
    middle, half = 0.5 * (a + b), 0.5 * (b - a)
    low, high = middle - _NODE * half, middle + _NODE * half
    per_length = 1.0 / p[1]
    at_low, at_high = 1.0 - low * per_length, 1.0 - high * per_length
    return half * (low * at_low * at_low + high * at_high * at_high)


@dataclass(frozen=True)
class Tvergaard:
    """Traction (27/4) s y (1 - y)^2, y = x / dc (Tvergaard 1990), with w = (9/16) s dc.

    Its stiffness is k = (27/4) s / dc: it weakens from the first opening.
    """

    constants: ClassVar = ()
    functions: ClassVar = CurveFunctions(_fall, _area)
    knees: ClassVar = ()

    def own_stiffness(self, strength, energy):
        """(27/4) s / dc (Pa/m)."""
        return 6.75 * strength / self.shape(None, strength, energy)[1]

    @staticmethod
    def shape(stiffness, strength, energy):
        """0, dc (m)."""
        dc = 16.0 * energy / (9.0 * strength)
        return 0.0 * dc, dc

    @staticmethod
    def steepest(shape, stiffness):
        """k / 3, at two thirds of dc."""
        return stiffness / 3.0
