# SPDX-License-Identifier: LGPL-3.0-or-later
"""Viscous damping of the bulk: C = a M + b K0, K0 the stiffness at rest."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.forms.loads import RayleighDamping


class ViscousDamping:
    """Forces of viscous damping.

    Args:
        coefficients: a (1/s) and b (s).
        mass: of the unknowns, shape (num_dofs,), kg (2D: kg/m); None without inertia.
        stiffness: K0, None if b is zero.

    Raises:
        ValueError: a mass is to be damped in a run without inertia.
    """

    def __init__(
        self, coefficients: RayleighDamping, mass: np.ndarray | None, stiffness: BlockMatrix | None
    ):
        if mass is None and coefficients.mass > 0.0:
            raise ValueError(
                f"Damping by {coefficients.mass:g} /s times the mass is asked for and "
                "inertia=False leaves no mass: take RayleighDamping(stiffness=...) or inertia=True."
            )
        self._coefficients, self._mass, self._stiffness = coefficients, mass, stiffness
        self._product = None if stiffness is None else stiffness.to_scipy()

    def force(self, velocity: np.ndarray) -> np.ndarray:
        """C v, shape (num_dofs,), N (2D: N/m)."""
        a, b = self._coefficients.mass, self._coefficients.stiffness
        force = np.zeros_like(velocity) if self._mass is None else a * self._mass * velocity
        return force + b * (self._product @ velocity) if b > 0.0 else force

    def rate(self, omega: float) -> float:
        """c = a + b omega^2 (1/s) of a vibration at omega (1/s), whose C is c M."""
        return self._coefficients.mass + self._coefficients.stiffness * omega**2

    def add_to(self, matrix: BlockMatrix, scaled: float) -> None:
        """Add the part of h theta C that the stiffness gives to an iteration matrix.

        Args:
            matrix: on the nodes, with the blocks of K0.
            scaled: h theta (s).
        """
        if self._coefficients.stiffness > 0.0:
            matrix.data[:] += scaled * self._coefficients.stiffness * self._stiffness.data

    def mass_factor(self, scaled: float) -> float:
        """1 + h theta a, which multiplies the mass in an iteration matrix."""
        return 1.0 + scaled * self._coefficients.mass
