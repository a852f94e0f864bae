# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a material is, in UFL: an energy, or a response with internal variables.

Forces and tangents follow by differentiation, so a material of a user's own is a class with the
members of `Material` or of `InelasticMaterial`, in any file. It may have `effects`, names for the
table of effects (`xper_fx/output/effects.py`) such as "finite strain"; that it is plastic, viscous
or has internal variables its response tells. A Maxwell-like solid, say, whose stress relaxes with
time t, is

    class Relaxing:
        density, linear, variables = 1000.0, False, {"flow": ((0.0,) * 3,) * 3}

        def response(self, u, old, step, constant):
            E, t = constant(1e6), constant(2.0)
            strain = small_strain(u)
            flow = (old["flow"] + step / t * strain) / (1.0 + step / t)
            stress = E * (strain - flow)
            stored = 0.5 * ufl.inner(stress, strain - flow)
            lost = ufl.inner(stress, flow - old["flow"])
            return Response(stress, stress, stored, {"flow": flow}, viscous=lost)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

from xper_fx.support.checks import require_positive, take_numbers

Expression = Any
"""An expression of UFL; its operators have no types."""
ToConstant = Callable[[float], Expression]
"""Function that turns a float into a `fem.Constant`."""

ZERO_TENSOR = ((0.0, 0.0, 0.0),) * 3
UNIT_TENSOR = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Material(Protocol):
    """A hyperelastic material.

    Attributes:
        density: rho (kg/m^3) in the reference configuration.
        linear: whether the energy is quadratic in the displacement, so that its stiffness is
            formed once.
    """

    @property
    def density(self) -> float: ...
    @property
    def linear(self) -> bool: ...

    def energy(self, u: Expression, constant: ToConstant) -> Expression:
        """Stored energy density (J/m^3) of a displacement, in UFL.

        Args:
            u: displacement, a UFL coefficient (m).
            constant: function that turns a float into a `fem.Constant`, so that a change of the
                number needs no new compilation.
        """

    def stress(self, u: Expression, constant: ToConstant) -> Expression:
        """Cauchy stress (Pa), 3 x 3, in UFL."""


class Response(NamedTuple):
    """What an inelastic material answers to a displacement at the end of a step, in UFL.

    Attributes:
        nominal_stress: first Piola-Kirchhoff stress P (Pa), 3 x 3, work-conjugate to grad u.
        stress: Cauchy stress (Pa), 3 x 3.
        energy: energy density stored at the end of the step (J/m^3).
        new: value of each internal variable at the end of the step, by name.
        plastic: density of the energy dissipated by plasticity in the step (J/m^3), or None.
        viscous: density of the energy dissipated by viscosity in the step (J/m^3), or None.
        increment: inelastic strain of the step, or None; a step in which it is large is cut.
    """

    nominal_stress: Any
    stress: Any
    energy: Any
    new: Mapping[str, Any]
    plastic: Any = None
    viscous: Any = None
    increment: Any = None


class InelasticMaterial(Protocol):
    """A material with internal variables, whose response depends on where the step began.

    Attributes:
        density: rho (kg/m^3) in the reference configuration.
        linear: False.
        variables: initial value of each internal variable by name: a float, or 3 x 3 nested
            tuples for a symmetric tensor. In 2D only the components 11, 22, 33 and 12 of a tensor
            are kept.
    """

    @property
    def density(self) -> float: ...
    @property
    def linear(self) -> bool: ...
    @property
    def variables(self) -> Mapping[str, Any]: ...

    def response(
        self, u: Expression, old: Mapping[str, Expression], step: Expression, constant: ToConstant
    ) -> Response:
        """Stresses, energies and new internal variables at the end of a step.

        With a step of zero and the displacement of the start the response is that of the start.

        Args:
            u: displacement at the end of the step, a UFL coefficient (m).
            old: internal variables at the start of the step, by name, scalars or 3 x 3 in UFL.
            step: h (s), a UFL constant, zero or above.
            constant: as in `Material.energy`.
        """


def lame(young: float, poisson: float) -> tuple[float, float]:
    """Lame's lambda and mu (Pa) from Young's modulus (Pa) and Poisson's ratio."""
    mu = young / (2.0 * (1.0 + poisson))
    return young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)), mu


def take_elastic_constants(material: Any) -> None:
    """Turn `young`, `poisson` and `density` of a frozen material into floats.

    Raises:
        ValueError: they do not describe a stable isotropic solid.
        TypeError: one is no number.
    """
    take_numbers(material, "young", "poisson", "density")
    young, poisson = material.young, material.poisson
    require_positive("young", young)
    require_positive("density", material.density)
    if not -1.0 < poisson < 0.5:
        raise ValueError(
            f"poisson should lie strictly between -1 and 0.5, got {poisson}; for a nearly "
            "incompressible solid take 0.49 and crossed triangles or order 2."
        )
    lam, mu = lame(young, poisson)
    if not (math.isfinite(lam) and mu > 0.0):
        raise ValueError(
            f"young {young:g} Pa and poisson {poisson!r} give Lame's lambda = {lam:g} Pa and mu = "
            f"{mu:g} Pa, beyond the range of floats; take other units."
        )


def take_plastic_constants(material: Any) -> None:
    """Turn `yield_stress` and the elastic constants of a frozen material into floats.

    Raises:
        ValueError: as `take_elastic_constants`, or yield stress and `hardening` do not suit them.
        TypeError: one is no number.
    """
    take_numbers(material, "yield_stress")
    take_elastic_constants(material)
    require_positive("yield_stress", material.yield_stress)
    if not hasattr(material.hardening, "curve"):
        raise ValueError(
            "hardening should be a law such as Linear(modulus) or Voce(saturation, rate), got "
            f"{material.hardening!r}."
        )
    material.hardening.check(material.yield_stress, lame(material.young, material.poisson)[1])
