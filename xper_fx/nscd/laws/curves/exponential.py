# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exponential curves: softening after an elastic part, and that of Xu and Needleman."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER
from xper_fx.nscd.laws.curves.curve import CurveFunctions

# Lengths of the curve after which it ends: what is left of the traction is 6e-6 of the strength
# (Xu and Needleman: 5e-6). The area up to there is w.
_END = 12.0
_END_OF_XU_NEEDLEMAN = 16.0
# Length over l below which series of sinh and cosh are exact to rounding.
_SHORT = 0.1


@njit(**LEAN_INNER)
def _fall(x, p):
    return p[0] / x * np.exp((p[0] - x) / p[2])


@njit(**LEAN_INNER)
def _area(a, b, p):
    return -p[0] * p[2] * np.exp((p[0] - a) / p[2]) * np.expm1((a - b) / p[2])


@dataclass(frozen=True)
class Exponential:
    """Traction s exp(-(x - d0) / l) after the elastic part, l = (w / s - d0 / 2) / (1 - e^-12)."""

    constants: ClassVar = ()
    functions: ClassVar = CurveFunctions(_fall, _area)
    knees: ClassVar = ()

    def own_stiffness(self, strength, energy) -> None:
        """The stiffness is free."""

    @staticmethod
    def shape(stiffness, strength, energy):
        """d0, dc, l (m)."""
        d0 = strength / stiffness
        length = (energy / strength - 0.5 * d0) / (1.0 - np.exp(-_END))
        return d0, d0 + _END * length, length

    @staticmethod
    def steepest(shape, stiffness):
        """s / l, at the peak."""
        d0, _, length = shape
        return stiffness * d0 / length


@njit(**LEAN_INNER)
def _fall_of_xu_needleman(x, p):
    return np.exp(-x / p[2])


@njit(**LEAN_INNER)
def _area_of_xu_needleman(a, b, p):
    h = (b - a) / p[2]
    if h < _SHORT:
        # 2 e^-c (c sinh d - (d cosh d - sinh d)), c the middle, d = h / 2: nothing cancels
        c, d = 0.5 * (a + b) / p[2], 0.5 * h
        s = d * d
        odd = 1.0 + s * (1.0 / 6.0 + s * (1.0 / 120.0 + s / 5040.0))
        even = s * (1.0 / 3.0 + s * (1.0 / 30.0 + s * (1.0 / 840.0 + s / 45360.0)))
        return p[2] * (b - a) * np.exp(-c) * (c * odd - even)
    y, left = a / p[2], np.exp(-h)
    return p[2] * p[2] * np.exp(-y) * ((1.0 + y) * (1.0 - left) - h * left)


@dataclass(frozen=True)
class XuNeedleman:
    """Traction e s (x / l) exp(-x / l): the normal curve of Xu and Needleman 1994, uncoupled.

    Its stiffness is k = e s / l, with w = e s l (1 - 17 e^-16): it weakens from the first opening.
    """

    constants: ClassVar = ()
    functions: ClassVar = CurveFunctions(_fall_of_xu_needleman, _area_of_xu_needleman)
    knees: ClassVar = ()

    def own_stiffness(self, strength, energy):
        """e s / l (Pa/m)."""
        return np.e * strength / self.shape(None, strength, energy)[2]

    @staticmethod
    def shape(stiffness, strength, energy):
        """0, dc, l (m)."""
        whole = 1.0 - (1.0 + _END_OF_XU_NEEDLEMAN) * np.exp(-_END_OF_XU_NEEDLEMAN)
        length = energy / (np.e * strength * whole)
        return 0.0 * length, _END_OF_XU_NEEDLEMAN * length, length

    @staticmethod
    def steepest(shape, stiffness):
        """k e^-2, at twice the opening of the peak."""
        return stiffness * np.exp(-2.0)
