# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exponential curves: softening after an elastic part, and that of Xu and Needleman."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED
from xper_fx.nscd.laws.curves.curve import CurveFunctions

# Lengths of the curve after which it ends: what is left of the traction is 6e-6 of the strength
# (Xu and Needleman: 5e-6). The area up to there is w.
_END = 12.0
_END_OF_XU_NEEDLEMAN = 16.0
# Length over l below which series of sinh and cosh are exact to rounding, and cheaper.
_SHORT = 0.1


@njit(**MERGED)
def _of_half(d):
    """exp(-d), sinh d / d and cosh d - sinh d / d, of half a short length: nothing cancels."""
    s = d * d
    q = s * s
    odd = (1.0 + s * (1.0 / 6.0)) + q * (1.0 / 120.0 + s * (1.0 / 5040.0))
    rest = s * ((1.0 / 3.0 + s * (1.0 / 30.0)) + q * (1.0 / 840.0 + s * (1.0 / 45360.0)))
    return odd + rest - d * odd, odd, rest


@njit(**LEAN_INNER)
def _fall(x, p):
    return p[0] / x * np.exp((p[0] - x) / p[2])


@njit(**LEAN_INNER)
def _area(a, b, g, p):
    h = (b - a) / p[2]
    if h < _SHORT:
        middle, odd, _ = _of_half(0.5 * h)
        return g * a * (b - a) * middle * odd
    return -g * a * p[2] * np.expm1(-h)


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
def _area_of_xu_needleman(a, b, g, p):
    per_length = 1.0 / p[2]
    y, h = per_length * a, per_length * (b - a)
    if h < _SHORT:
        d = 0.5 * h
        middle, odd, rest = _of_half(d)
        return p[2] * (b - a) * g * middle * ((y + d) * odd - rest)
    left = np.exp(-h)
    return p[2] * p[2] * g * ((1.0 + y) * (1.0 - left) - h * left)


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
