# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear softening (Camacho and Ortiz 1996; with an elastic part Geubelle and Baylor 1998)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions


@njit(**LEAN_INNER)
def _fall(x, p):
    return p[0] / x * (p[1] - x) / (p[1] - p[0])


@njit(**LEAN_INNER)
def _area(a, b, g, p):
    return p[0] * (b - a) * (p[1] - 0.5 * (a + b)) / (p[1] - p[0])


@njit(**LEAN_ENTRY)
def _opening(share, p):
    return p[0] * p[1] / (p[0] + share * (p[1] - p[0]))


@dataclass(frozen=True)
class Linear:
    """Traction s (dc - x) / (dc - d0), with dc = 2 w / s."""

    constants: ClassVar = ()
    functions: ClassVar = CurveFunctions(_fall, _area, _opening)
    knees: ClassVar = ()

    def own_stiffness(self, strength, energy) -> None:
        """The stiffness is free."""

    @staticmethod
    def shape(stiffness, strength, energy):
        """d0, dc (m)."""
        return strength / stiffness, 2.0 * energy / strength

    @staticmethod
    def steepest(shape, stiffness):
        """s / (dc - d0)."""
        d0, dc = shape
        return stiffness * d0 / (dc - d0)
