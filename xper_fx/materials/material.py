# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a hyperelastic material is: a density and an energy in UFL.

Forces and tangents follow from the energy by differentiation, so a material of a user's own is a
class with the three members of `Material`, in any file.
"""

from __future__ import annotations

import math
from typing import Protocol


class Material(Protocol):
    """A hyperelastic material.

    Attributes:
        density: rho (kg/m^3) in the reference configuration.
        linear: whether the energy is quadratic in the displacement, so that its stiffness is
            formed once.
    """

    density: float
    linear: bool

    def energy(self, u, constant):
        """Stored energy density (J/m^3) of a displacement, in UFL.

        Args:
            u: displacement, a UFL coefficient (m).
            constant: function that turns a float into a `fem.Constant`, so that a change of the
                number needs no new compilation.
        """

    def stress(self, u, constant):
        """Cauchy stress (Pa), 3 x 3, in UFL."""


def lame(young: float, poisson: float) -> tuple[float, float]:
    """Lame's lambda and mu (Pa) from Young's modulus (Pa) and Poisson's ratio."""
    mu = young / (2.0 * (1.0 + poisson))
    return young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)), mu


def check_elastic_constants(young: float, poisson: float, density: float) -> None:
    """Raise ValueError unless the constants describe a stable isotropic solid."""
    for name, value in (("young", young), ("density", density)):
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} should be a finite number above zero, got {value}.")
    if not -1.0 < poisson < 0.5:
        raise ValueError(
            f"poisson should lie strictly between -1 and 0.5, got {poisson}; for a nearly "
            "incompressible solid take 0.49 and crossed triangles or order 2."
        )
