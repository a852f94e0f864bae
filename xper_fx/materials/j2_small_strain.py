# SPDX-License-Identifier: LGPL-3.0-or-later
"""Von Mises plasticity with isotropic hardening at small strain.

Strain eps = sym grad u, plastic strain e_p (traceless), accumulated plastic strain alpha:

    sigma = kappa tr(eps) I + 2 mu (dev eps - e_p),    q = sqrt(3/2 dev sigma : dev sigma) <= K,
    e_p' = 3/2 p' dev sigma / q,    alpha' = p' >= 0,    p' (q - K(alpha)) = 0.

Backward Euler is the radial return of `radial_return`, with s* = 2 mu (dev eps - e_p,old) and
m = 3 mu; e_p = dev eps - s / (2 mu). Stored is the elastic energy alone; the dissipation of a step,
(K(alpha_old) + K(alpha_old + p)) / 2 p >= 0, closes the energy balance to second order in the step.

Simo J.C., Hughes T.J.R., Computational Inelasticity, Springer 1998, box 3.1 (with isotropic
hardening only).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import ufl

from xper_fx.materials.hardening import Hardening
from xper_fx.materials.kinematics import small_strain
from xper_fx.materials.material import (
    ZERO_TENSOR,
    Expression,
    Response,
    ToConstant,
    lame,
    take_plastic_constants,
)
from xper_fx.materials.radial_return import radial_return


@dataclass(frozen=True)
class J2SmallStrain:
    """Von Mises plasticity at small strain (plane strain in 2D).

    Args:
        young: Young's modulus (Pa).
        poisson: Poisson's ratio, in (-1, 0.5).
        yield_stress: sigma_0 (Pa), in uniaxial tension.
        hardening: how the yield stress grows with the accumulated plastic strain.
        density: rho (kg/m^3).

    Attributes:
        variables: "plastic_strain" e_p and "accumulated" alpha, both zero at first.

    Raises:
        ValueError: a constant out of range.
    """

    young: float
    poisson: float
    yield_stress: float
    hardening: Hardening
    density: float
    linear: bool = field(default=False, init=False)
    variables = MappingProxyType({"plastic_strain": ZERO_TENSOR, "accumulated": 0.0})

    def __post_init__(self) -> None:
        take_plastic_constants(self)

    def response(
        self, u: Expression, old: Mapping[str, Expression], step: Expression, constant: ToConstant
    ) -> Response:
        """See `InelasticMaterial`."""
        lam, mu = lame(self.young, self.poisson)
        curve = self.hardening.curve(self.yield_stress, mu, constant)
        bulk, mu = constant(lam + 2.0 / 3.0 * mu), constant(mu)
        strain, alpha = small_strain(u), old["accumulated"]
        volume, deviator = ufl.tr(strain), ufl.dev(strain)
        s, p = radial_return(2.0 * mu * (deviator - old["plastic_strain"]), 3.0 * mu, alpha, curve)
        stress = bulk * volume * ufl.Identity(3) + s
        return Response(
            nominal_stress=stress,
            stress=stress,
            energy=0.5 * bulk * volume**2 + ufl.inner(s, s) / (4.0 * mu),
            new={"plastic_strain": deviator - s / (2.0 * mu), "accumulated": alpha + p},
            plastic=0.5 * (curve.stress(alpha) + curve.stress(alpha + p)) * p,
            increment=p,
        )
