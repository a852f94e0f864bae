# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear viscoelastic solid: shear relaxes as a Prony series, the volume is elastic.

    sigma = kappa tr(eps) I + 2 mu_inf e + sum_i s_i,    e = dev eps,
    s_i' + s_i / tau_i = 2 mu_i e',    mu_i = g_i mu,    mu_inf = (1 - sum_i g_i) mu,

mu being the shear modulus of a fast test. Over a step h in which e changes linearly by de, with
x = h / tau and D = 2 mu_i de, the exact solution and what it dissipates are (index i left out)

    s_new = exp(-x) s + phi(x) D,    phi(x) = (1 - exp(-x)) / x,
    int s : s / (2 mu_i tau) dt
        = [ (1 - exp(-2 x)) / 2 s : s + x phi(x)^2 s : D + chi(x) D : D ] / (2 mu_i) >= 0,
    chi(x) = (x - 2 (1 - exp(-x)) + (1 - exp(-2 x)) / 2) / x^2.

Stored: kappa / 2 tr(eps)^2 + mu_inf e : e + sum_i s_i : s_i / (4 mu_i).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import ufl

from xper_fx.materials.kinematics import small_strain
from xper_fx.materials.material import (
    ZERO_TENSOR,
    Expression,
    Response,
    ToConstant,
    lame,
    take_elastic_constants,
)
from xper_fx.support.checks import require_number

# Below this h / tau the coefficients of a step are summed as series, where differences of
# exponentials would cancel; the terms leave an error under rounding.
_SMALL, _TERMS = 0.1, 10


@dataclass(frozen=True)
class LinearViscoelastic:
    """Viscoelastic solid at small strain (plane strain in 2D).

    Args:
        young: Young's modulus of a fast test (Pa).
        poisson: Poisson's ratio of a fast test, in (-1, 0.5).
        prony: (g, tau) of each term: the share of the shear modulus that relaxes, above zero,
            and its relaxation time (s); the shares sum to less than 1.
        density: rho (kg/m^3).

    Raises:
        ValueError: a constant out of range.
    """

    young: float
    poisson: float
    prony: Sequence[tuple[float, float]]
    density: float
    linear: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        take_elastic_constants(self)
        try:
            pairs = [(share, time) for share, time in self.prony]
        except (TypeError, ValueError):
            raise TypeError(
                f"prony should be pairs of a share and a time (s), got {self.prony!r}."
            ) from None
        pairs = [
            (require_number("A share of prony", share), require_number("A time of prony (s)", time))
            for share, time in pairs
        ]
        object.__setattr__(self, "prony", tuple(pairs))
        for share, time in self.prony:
            if not (share > 0.0 and math.isfinite(time) and time > 0.0):
                raise ValueError(
                    "prony should be pairs of a share and a time, both above zero, got "
                    f"({share}, {time})."
                )
        total = sum(share for share, _ in self.prony)
        if not 0.0 < total < 1.0:
            raise ValueError(
                f"The shares of prony should sum to more than 0 and less than 1, got {total}; "
                "a solid that does not relax is LinearElastic."
            )

    @property
    def variables(self) -> dict:
        """Deviatoric strain, and the stress of each term, all zero at first."""
        return {"deviator": ZERO_TENSOR} | dict.fromkeys(self._names, ZERO_TENSOR)

    @property
    def _names(self) -> list[str]:
        return [f"term_{i}" for i in range(1, len(self.prony) + 1)]

    def response(
        self, u: Expression, old: Mapping[str, Expression], step: Expression, constant: ToConstant
    ) -> Response:
        """See `InelasticMaterial`."""
        lam, mu = lame(self.young, self.poisson)
        bulk = constant(lam + 2.0 / 3.0 * mu)
        rest = constant(mu * (1.0 - sum(share for share, _ in self.prony)))
        strain = small_strain(u)
        volume, e = ufl.tr(strain), ufl.dev(strain)
        new = {"deviator": e}
        stress = bulk * volume * ufl.Identity(3) + 2.0 * rest * e
        stored, lost = 0.5 * bulk * volume**2 + rest * ufl.inner(e, e), 0.0
        for name, (share, time) in zip(self._names, self.prony, strict=True):
            twice, x, s = constant(2.0 * share * mu), step / constant(time), old[name]
            D = twice * (e - old["deviator"])
            phi = _phi(x)
            new[name] = ufl.exp(-x) * s + phi * D
            stress += new[name]
            stored += ufl.inner(new[name], new[name]) / (2.0 * twice)
            lost += (
                x * _phi(2.0 * x) * ufl.inner(s, s)
                + x * phi**2 * ufl.inner(s, D)
                + _chi(x) * ufl.inner(D, D)
            ) / twice
        return Response(stress, stress, stored, new, viscous=lost)


def _phi(x: Expression) -> Expression:
    """(1 - exp(-x)) / x."""
    return _series_or(x, lambda k: (-1.0) ** k / math.factorial(k + 1), (1.0 - ufl.exp(-x)) / x)


def _chi(x: Expression) -> Expression:
    """(x - 2 (1 - exp(-x)) + (1 - exp(-2 x)) / 2) / x^2."""
    closed = (x - 2.0 * (1.0 - ufl.exp(-x)) + 0.5 * (1.0 - ufl.exp(-2.0 * x))) / x**2
    return x * _series_or(
        x, lambda k: (-1.0) ** k * (2.0 ** (k + 2) - 2.0) / math.factorial(k + 3), closed / x
    )


def _series_or(
    x: Expression, coefficient: Callable[[int], float], closed: Expression
) -> Expression:
    """sum_k coefficient(k) x^k for small x, `closed` beyond."""
    series = 0.0
    for k in reversed(range(_TERMS)):
        series = coefficient(k) + x * series
    return ufl.conditional(ufl.lt(x, _SMALL), series, closed)
