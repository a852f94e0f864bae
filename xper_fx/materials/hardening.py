# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isotropic hardening: the yield stress K(alpha) and the return to it.

alpha is the accumulated plastic strain, int sqrt(2/3 deps_p : deps_p). A return from a trial
equivalent stress q > K(alpha) finds the increment p > 0 of alpha in

    q - m p = K(alpha + p),        m = 3 mu.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import ufl

from xper_fx.materials.material import Expression, ToConstant
from xper_fx.support.checks import require_positive, take_numbers


class Curve(NamedTuple):
    """A hardening law in UFL."""

    stress: Callable  #: function K of alpha (Pa)
    increment: Callable  #: function of q, m and alpha that gives p; called where q > K(alpha) only


class Hardening(Protocol):
    """An isotropic hardening law."""

    def check(self, yield_stress: float, shear: float) -> None:
        """Raise ValueError if K reaches zero or the return is not unique.

        Args:
            yield_stress: K(0) (Pa).
            shear: mu (Pa).
        """

    def curve(self, yield_stress: float, shear: float, constant: ToConstant) -> Curve:
        """The law in UFL; arguments as in `check`, `constant` as in `Material.energy`."""


@dataclass(frozen=True)
class Linear:
    """K(alpha) = sigma_0 + H alpha, returned to in closed form.

    Args:
        modulus: H (Pa), zero for perfect plasticity.

    Raises:
        ValueError: a modulus below zero or not finite.
    """

    modulus: float

    def __post_init__(self) -> None:
        take_numbers(self, "modulus")
        _check_modulus(self.modulus)

    def check(self, yield_stress: float, shear: float) -> None:
        """See `Hardening`; nothing can go wrong."""

    def curve(self, yield_stress: float, shear: float, constant: ToConstant) -> Curve:
        """See `Hardening`."""
        K0, H = constant(yield_stress), constant(self.modulus)
        return Curve(
            lambda alpha: K0 + H * alpha, lambda q, m, alpha: (q - K0 - H * alpha) / (m + H)
        )


@dataclass(frozen=True)
class Voce:
    """K(alpha) = sigma_0 + H alpha + (sigma_inf - sigma_0) (1 - exp(-delta alpha)).

    The return is Newton's from p = 0, written out. With x = delta p it solves
    x + A (1 - exp(-x)) = b: a convex function falling to its root if A > 0, so that Newton climbs
    to it and never passes it; if -1 < A < 0 (softening) it passes once and comes down. How many
    iterations reach rounding for every b depends on A alone, which hardening, the rise of mu under
    finite strain and alpha > 0 all bring nearer to zero: 3 iterations for A = 0.02 (mild steel), 5
    for 1, 9 for 100, 8 for -0.99.

    Args:
        saturation: sigma_inf (Pa); below sigma_0 the material softens.
        rate: delta, above zero.
        modulus: H (Pa), zero or above.

    Raises:
        ValueError: a number out of range.
    """

    saturation: float
    rate: float
    modulus: float = 0.0

    def __post_init__(self) -> None:
        take_numbers(self, "saturation", "rate", "modulus")
        _check_modulus(self.modulus)
        for name in ("saturation", "rate"):
            require_positive(name, getattr(self, name))

    def check(self, yield_stress: float, shear: float) -> None:
        """See `Hardening`; K stays above zero as both sigma_0 and sigma_inf are."""
        slope = self.modulus + self.rate * (self.saturation - yield_stress)
        if slope <= -3.0 * shear:
            raise ValueError(
                f"The softening slope {slope:g} Pa at the start should stay above -3 mu = "
                f"{-3.0 * shear:g} Pa, else the stress after a strain is not unique; lower the "
                f"rate {self.rate:g} or raise the saturation {self.saturation:g} Pa."
            )

    def curve(self, yield_stress: float, shear: float, constant: ToConstant) -> Curve:
        """See `Hardening`."""
        iterations = _iterations(
            self.rate * (self.saturation - yield_stress) / (3.0 * shear + self.modulus)
        )
        K0, H = constant(yield_stress), constant(self.modulus)
        rise, rate = constant(self.saturation - yield_stress), constant(self.rate)

        def stress(alpha: Expression) -> Expression:
            return K0 + H * alpha + rise * (1.0 - ufl.exp(-rate * alpha))

        def increment(q: Expression, m: Expression, alpha: Expression) -> Expression:
            excess = q - stress(alpha)
            gap = rise * ufl.exp(-rate * alpha)
            p = excess / (m + H + rate * gap)
            for _ in range(iterations - 1):
                decay = ufl.exp(-rate * p)
                residual = excess - (m + H) * p - gap * (1.0 - decay)
                p = p + residual / (m + H + rate * gap * decay)
            return p

        return Curve(stress, increment)


def _check_modulus(modulus: float) -> None:
    if not (math.isfinite(modulus) and modulus >= 0.0):
        raise ValueError(
            f"modulus should be a finite number, zero or above, got {modulus}: the yield stress "
            "would fall to zero; for softening down to a residual stress take Voce with a "
            "saturation below the yield stress."
        )


def _iterations(A: float) -> int:
    """Newton iterations from zero that solve x + A (1 - exp(-x)) = b to rounding for all b > 0."""
    x = np.concatenate([np.geomspace(1e-6, 1e3, 500), abs(A) * np.linspace(0.0, 3.0, 301)[1:]])
    b = x - A * np.expm1(-x)
    guess, count, residual = np.zeros_like(x), 0, -b
    while np.any(np.abs(residual) > 4e-15 * np.maximum(b, 1.0)):
        guess -= residual / (1.0 + A * np.exp(-guess))
        residual = guess - A * np.expm1(-guess) - b
        count += 1
    return max(count, 1)
