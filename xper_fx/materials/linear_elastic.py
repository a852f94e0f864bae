# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isotropic linear elasticity at small strain: W = lambda / 2 (tr eps)^2 + mu eps : eps."""

from __future__ import annotations

from dataclasses import dataclass, field

import ufl

from xper_fx.materials.kinematics import small_strain
from xper_fx.materials.material import Expression, ToConstant, lame, take_elastic_constants


@dataclass(frozen=True)
class LinearElastic:
    """Isotropic linear elastic material at small strain.

    Args:
        young: Young's modulus (Pa).
        poisson: Poisson's ratio, in (-1, 0.5).
        density: rho (kg/m^3).
        plane: in 2D, "strain" or "stress"; without effect in 3D.

    Raises:
        ValueError: a constant out of range.
    """

    young: float
    poisson: float
    density: float
    plane: str = "strain"
    linear: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        take_elastic_constants(self)
        if self.plane not in ("strain", "stress"):
            raise ValueError(f'plane should be "strain" or "stress", got {self.plane!r}.')

    def _moduli(
        self, u: Expression, constant: ToConstant
    ) -> tuple[Expression, Expression, Expression]:
        """Lame constants acting on the in-plane strain.

        Plane stress eliminates eps_33 = -lambda / (lambda + 2 mu) (eps_11 + eps_22), which
        replaces lambda by 2 lambda mu / (lambda + 2 mu).
        """
        lam, mu = lame(self.young, self.poisson)
        if self.plane == "stress" and len(u) == 2:
            lam = 2.0 * lam * mu / (lam + 2.0 * mu)
        return constant(lam), constant(mu)

    def energy(self, u: Expression, constant: ToConstant) -> Expression:
        """See `Material`."""
        lam, mu = self._moduli(u, constant)
        strain = small_strain(u)
        return 0.5 * lam * ufl.tr(strain) ** 2 + mu * ufl.inner(strain, strain)

    def stress(self, u: Expression, constant: ToConstant) -> Expression:
        """See `Material`."""
        lam, mu = self._moduli(u, constant)
        strain = small_strain(u)
        sigma = lam * ufl.tr(strain) * ufl.Identity(3) + 2.0 * mu * strain
        if self.plane == "stress" and len(u) == 2:
            return ufl.as_tensor(
                [[sigma[i, j] if max(i, j) < 2 else 0.0 for j in range(3)] for i in range(3)]
            )
        return sigma
