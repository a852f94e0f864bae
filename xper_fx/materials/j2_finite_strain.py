# SPDX-License-Identifier: LGPL-3.0-or-later
"""Von Mises plasticity with isotropic hardening at finite strain, F = F_e F_p, det F_p = 1.

With J = det F, F_bar = J^(-1/3) F and b = F_bar C_p^-1 F_bar^T the isochoric elastic left
Cauchy-Green tensor, the Kirchhoff stress is

    tau = kappa / 2 (J^2 - 1) I + mu dev b,
    W = kappa / 2 ((J^2 - 1) / 2 - ln J) + mu / 2 (tr b - 3).

A step takes the trial b* = F_bar C_p,old^-1 F_bar^T and returns s* = mu dev b* radially to
q = sqrt(3/2 s : s) <= K(alpha), with m = mu tr b* and alpha_new = alpha + p (`radial_return`).

The deviator s / mu that the return leaves is that of one b with det b = 1 alone:

    b = s / mu + x I,    x the largest root of det(s / mu + x I) = 1,
    C_p^-1 = F_bar^-1 b F_bar^-T.

So plastic flow keeps the volume exactly, and the committed state answers with the stress it was
committed with. (Keeping x = tr b* / 3 and scaling C_p^-1 to the determinant one would change s.)

The dissipation is -mu / 2 C_bar : d(C_p^-1). With n the direction of s and d = s : n / mu it is

    sqrt(3/2) m c dp,    c = -n : b^-1 / tr b^-1 = d (x - d tr n^3) / (3 x^2 - d^2 / 2) >= 0,

close to K(alpha) dp, from which it differs by the elastic strain. A step takes the mean c of its
values at K(alpha) and at K(alpha + p), and divides by exp(e tr n^3), e = 3/2 (d* - d_old) / tr b*
being the strain of the step along n: the return is taken where that strain has carried b. So the
energy balance closes to second order in the step, and the dissipation is never below zero.

Simo J.C., Hughes T.J.R., Computational Inelasticity, Springer 1998, box 9.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import sqrt
from types import MappingProxyType

import ufl

from xper_fx.materials.hardening import Hardening
from xper_fx.materials.kinematics import deformation_gradient
from xper_fx.materials.material import (
    UNIT_TENSOR,
    Expression,
    Response,
    ToConstant,
    lame,
    take_plastic_constants,
)
from xper_fx.materials.radial_return import radial_return

# Newton from the trial's x: enough for steps that double the length.
_ITERATIONS = 6
# From the x at the end of a step to that at K(alpha), near by: a distance that is squared thrice.
_NEARBY = 3


@dataclass(frozen=True)
class J2FiniteStrain:
    """Von Mises plasticity at finite strain (plane strain in 2D).

    Args:
        young: Young's modulus at small strain (Pa).
        poisson: Poisson's ratio at small strain, in (-1, 0.5).
        yield_stress: sigma_0 (Pa), of the Kirchhoff stress in uniaxial tension.
        hardening: how the yield stress grows with the accumulated plastic strain.
        density: rho (kg/m^3) in the reference configuration.

    Attributes:
        variables: "inverse_plastic_metric" C_p^-1, the identity at first, and "accumulated"
            alpha, zero at first.

    Raises:
        ValueError: a constant out of range.
    """

    young: float
    poisson: float
    yield_stress: float
    hardening: Hardening
    density: float
    linear: bool = field(default=False, init=False)
    effects = ("finite strain",)
    variables = MappingProxyType({"inverse_plastic_metric": UNIT_TENSOR, "accumulated": 0.0})

    def __post_init__(self) -> None:
        take_plastic_constants(self)

    def response(
        self, u: Expression, old: Mapping[str, Expression], step: Expression, constant: ToConstant
    ) -> Response:
        """See `InelasticMaterial`."""
        lam, mu = lame(self.young, self.poisson)
        curve = self.hardening.curve(self.yield_stress, mu, constant)
        bulk, mu = constant(lam + 2.0 / 3.0 * mu), constant(mu)
        alpha = old["accumulated"]
        F = deformation_gradient(u)
        J, inverse = ufl.det(F), ufl.inv(F)
        b = J ** (-2.0 / 3.0) * F * old["inverse_plastic_metric"] * F.T
        mean = ufl.tr(b) / 3.0
        m = 3.0 * mu * mean
        s, p = radial_return(mu * ufl.dev(b), m, alpha, curve)
        tau = 0.5 * bulk * (J**2 - 1.0) * ufl.Identity(3) + s
        deviator = s / mu
        x = _unit_determinant(
            0.5 * ufl.inner(deviator, deviator), ufl.det(deviator), mean, _ITERATIONS
        )
        metric = J ** (2.0 / 3.0) * inverse * (deviator + x * ufl.Identity(3)) * inverse.T
        volumetric = 0.5 * bulk * (0.5 * (J**2 - 1.0) - ufl.ln(J))

        n = s / ufl.sqrt(ufl.inner(s, s))
        cubic = 3.0 * ufl.det(n)

        def flow_share(d: Expression, x: Expression) -> Expression:
            """c where s = mu d n, x being that of its b."""
            return d * (x - d * cubic) / (3.0 * x**2 - 0.5 * d**2)

        d, d_old = (sqrt(2.0 / 3.0) * curve.stress(a) / mu for a in (alpha + p, alpha))
        x_old = _unit_determinant(0.5 * d_old**2, d_old * d_old * d_old * cubic / 3.0, x, _NEARBY)
        share = 0.5 * (flow_share(d_old, x_old) + flow_share(d, x))
        excess = ufl.inner(ufl.dev(b), n) - d_old
        share *= ufl.exp(-0.5 * cubic * excess / mean)
        return Response(
            nominal_stress=tau * inverse.T,
            stress=tau / J,
            energy=volumetric + 1.5 * mu * (x - 1.0),
            new={"inverse_plastic_metric": metric, "accumulated": alpha + p},
            plastic=ufl.conditional(ufl.gt(p, 0.0), sqrt(1.5) * m * share * p, 0.0),
            increment=p,
        )


def _unit_determinant(
    half: Expression, det: Expression, start: Expression, iterations: int
) -> Expression:
    """The largest x with det(d + x I) = 1 for a traceless d, by Newton.

    det(d + x I) - 1 = x^3 - d : d / 2 x + det d - 1 is convex above its largest root, so that
    Newton comes down to it from any start above it, as the x of a larger deviator in the same
    direction is; from a little below it passes it once. A power of three would be a call of `pow`.

    Args:
        half: d : d / 2.
        det: det d.
        start: of the iterations.
        iterations: their number.
    """
    x = start
    for _ in range(iterations):
        x = x - ((x * x - half) * x + det - 1.0) / (3.0 * x * x - half)
    return x
