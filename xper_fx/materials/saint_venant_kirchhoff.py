# SPDX-License-Identifier: LGPL-3.0-or-later
"""Saint-Venant-Kirchhoff solid: W = lambda / 2 (tr E)^2 + mu E : E, E = (F^T F - I) / 2."""

from __future__ import annotations

from dataclasses import dataclass, field

import ufl

from xper_fx.materials.kinematics import deformation_gradient
from xper_fx.materials.material import Expression, ToConstant, lame, take_elastic_constants


@dataclass(frozen=True)
class SaintVenantKirchhoff:
    """Linear elasticity in the Green-Lagrange strain (plane strain in 2D).

    For large rotations at small strain. It gives way in compression (in uniaxial strain below a
    stretch of 1 / sqrt(3)), where `NeoHookean` does not.

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
        E = _green_lagrange(deformation_gradient(u))
        return 0.5 * lam * ufl.tr(E) ** 2 + mu * ufl.inner(E, E)

    def stress(self, u: Expression, constant: ToConstant) -> Expression:
        """See `Material`."""
        lam, mu = (constant(m) for m in lame(self.young, self.poisson))
        F = deformation_gradient(u)
        E = _green_lagrange(F)
        second_piola = lam * ufl.tr(E) * ufl.Identity(3) + 2.0 * mu * E
        return F * second_piola * F.T / ufl.det(F)


def _green_lagrange(F: Expression) -> Expression:
    return 0.5 * (F.T * F - ufl.Identity(3))
