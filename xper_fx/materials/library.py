# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constants of Perales et al. 2010 (section 4.2): hydrided Zircaloy-4.

Perales F., Dubois F., Monerie Y., Piar B., Stainier L., A NonSmooth Contact Dynamics-based
multi-domain solver, European Journal of Computational Mechanics 19 (2010) 389-417,
doi:10.3166/ejcm.19.389-417. Stiffnesses are C_N = C_T in Pa/m, energies in J/m^2, strengths in Pa.
"""

from types import MappingProxyType

from xper_fx.materials.hardening import Linear
from xper_fx.materials.j2_finite_strain import J2FiniteStrain
from xper_fx.materials.j2_small_strain import J2SmallStrain
from xper_fx.materials.linear_elastic import LinearElastic
from xper_fx.materials.neo_hookean import NeoHookean
from xper_fx.nscd.laws.cohesive_zone import CohesiveZone

DENSITY = 7800.0
FRICTION = 0.05

ZIRCALOY_4 = LinearElastic(young=99e9, poisson=0.325, density=DENSITY)
"""Elastic part of Zircaloy-4."""

_DUCTILE = dict(
    young=99e9, poisson=0.325, yield_stress=450e6, hardening=Linear(850e6), density=DENSITY
)
ZIRCALOY_4_DUCTILE = J2SmallStrain(**_DUCTILE)
"""Zircaloy-4 with its plasticity, at small strain."""

ZIRCALOY_4_DUCTILE_FINITE = J2FiniteStrain(**_DUCTILE)
"""Zircaloy-4 with its plasticity, at finite strain."""

HYDRIDE = NeoHookean(young=135e9, poisson=0.32, density=DENSITY)
"""Zirconium delta-hydride."""

ZIRCALOY_BOND = CohesiveZone(2e18, 0.5, 1e9, friction=FRICTION)
HYDRIDE_BOND = CohesiveZone(4e18, 0.4, 1.25e9, friction=FRICTION)

INTERFACE_BONDS = MappingProxyType(
    {
        "weak": CohesiveZone(4e18, 5e-4, 4.5e7, friction=FRICTION),
        "strong": CohesiveZone(4e18, 500.0, 4.5e10, friction=FRICTION),
    }
)
"""Bond between Zircaloy-4 and hydride, weak and strong."""
