# SPDX-License-Identifier: LGPL-3.0-or-later
r"""What a softening curve is: the traction of a bond that opens and never closes.

The traction is T(x) = k x g(x), x the opening (m), k the stiffness of the sound bond (Pa/m), with g
falling from 1 to 0:

    g = 1 for x <= d0,    g = fall(x, p) for d0 < x < dc,    g = 0 for x >= dc,

p = (d0, dc, ...) being the curve's *shape*, a tuple of numbers that differs from point to point.
`area(a, b, g, p)` is the integral of g x from a to b, d0 <= a <= b <= dc, g being given at a: it
makes bonds spend their fracture energy exactly, whatever the step, and takes no difference of
nearly equal numbers.
`opening(share, p)` is the x in (d0, dc) at which g is a share, if there is a formula for it.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, Protocol

Values = Any  # a float, or an array of floats over points
CurveFunctions = namedtuple("CurveFunctions", "fall area opening", defaults=(None,))


class Curve(Protocol):
    """A family of curves, told apart by stiffness, strength and energy."""

    constants: tuple[float, ...]
    """Numbers of this object that `shape` takes last."""
    functions: CurveFunctions
    """The compiled functions, those of all objects of the class."""

    knees: tuple[int, ...]
    """Which numbers of a shape are openings between d0 and dc at which the slope jumps."""

    def own_stiffness(self, strength: Values, energy: Values) -> Values | None:
        """k (Pa/m) where strength and energy tell it, None where it is free."""

    @staticmethod
    def shape(stiffness, strength, energy, *constants) -> tuple:
        """p = (d0, dc, ...), in arithmetic that arrays and kernels can do.

        Args:
            stiffness: k (Pa/m).
            strength: largest traction (Pa).
            energy: area below the curve (J/m^2).
            constants: those of the object.
        """

    @staticmethod
    def steepest(shape: tuple, stiffness: Values) -> Values:
        """Steepest descent of the traction (Pa/m), a positive number."""


def check_curve(curve: Any) -> None:
    """Raise a TypeError unless something is a curve of `curves/`, or like them."""
    if isinstance(curve, type) or not hasattr(curve, "own_stiffness"):
        raise TypeError(f"curve should be one of xper_fx.laws.curves, as Linear(), got {curve!r}.")
