# SPDX-License-Identifier: LGPL-3.0-or-later
"""The parabolic curve of Perales et al. 2010 (eq. 37; MP3_CZM of LMGC90)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions


@njit(**LEAN_INNER)
def _fall(x, p):
    y = (x - p[0]) / (p[1] - p[0])
    return p[0] / x * (1.0 - y * y)


@njit(**LEAN_INNER)
def _area(a, b, g, p):
    per_length = 1.0 / (p[1] - p[0])
    y0, y1 = (a - p[0]) * per_length, (b - p[0]) * per_length
    return p[0] * (b - a) * (1.0 - (y1 * y1 + y1 * y0 + y0 * y0) * (1.0 / 3.0))


@dataclass(frozen=True)
class Parabolic:
    """Traction s (1 - y^2), y = (x - d0) / (dc - d0), with dc = (3/2)(w / s + d0 / 6)."""

    constants: ClassVar = ()
    functions: ClassVar = CurveFunctions(_fall, _area)
    knees: ClassVar = ()

    def own_stiffness(self, strength, energy) -> None:
        """The stiffness is free."""

    @staticmethod
    def shape(stiffness, strength, energy):
        """d0, dc (m)."""
        d0 = strength / stiffness
        return d0, 1.5 * (energy / strength + d0 / 6.0)

    @staticmethod
    def steepest(shape, stiffness):
        """2 s / (dc - d0), at the end."""
        d0, dc = shape
        return 2.0 * stiffness * d0 / (dc - d0)
