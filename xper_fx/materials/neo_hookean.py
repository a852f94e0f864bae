# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compressible neo-Hookean solid: W = mu / 2 (tr C - 3 - 2 ln J) + lambda / 2 (ln J)^2."""

from __future__ import annotations

from dataclasses import dataclass, field

import ufl

from xper_fx.materials.kinematics import deformation_gradient
from xper_fx.materials.material import Expression, ToConstant, lame, take_elastic_constants


@dataclass(frozen=True)
class NeoHookean:
    """Compressible neo-Hookean material at finite strain (plane strain in 2D).

    Args:
        young: Young's modulus at small strain (Pa).
        poisson: Poisson's ratio at small strain, in (-1, 0.5).
        density: rho (kg/m^3) in the reference configuration.

    Raises:
        ValueError: a constant out of range.
    """

    young: float
    poisson: float
    density: float
    linear: bool = field(default=False, init=False)
    effects = ("finite strain",)

    def __post_init__(self) -> None:
        take_elastic_constants(self)

    def energy(self, u: Expression, constant: ToConstant) -> Expression:
        """See `Material`."""
        lam, mu = (constant(m) for m in lame(self.young, self.poisson))
        F = deformation_gradient(u)
        log_j = ufl.ln(ufl.det(F))
        return 0.5 * mu * (ufl.inner(F, F) - 3.0 - 2.0 * log_j) + 0.5 * lam * log_j**2

    def stress(self, u: Expression, constant: ToConstant) -> Expression:
        """See `Material`."""
        lam, mu = (constant(m) for m in lame(self.young, self.poisson))
        F = deformation_gradient(u)
        J = ufl.det(F)
        return (mu * (F * F.T - ufl.Identity(3)) + lam * ufl.ln(J) * ufl.Identity(3)) / J
