# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk materials, one file each; `library.py` holds sourced constants."""

from xper_fx.materials.hardening import Hardening, Linear, Voce
from xper_fx.materials.j2_finite_strain import J2FiniteStrain
from xper_fx.materials.j2_small_strain import J2SmallStrain
from xper_fx.materials.linear_elastic import LinearElastic
from xper_fx.materials.material import InelasticMaterial, Material, Response
from xper_fx.materials.neo_hookean import NeoHookean
from xper_fx.materials.orthotropic import Cubic, Orthotropic
from xper_fx.materials.saint_venant_kirchhoff import SaintVenantKirchhoff
from xper_fx.materials.viscoelastic import LinearViscoelastic

__all__ = [
    "Cubic",
    "Hardening",
    "InelasticMaterial",
    "J2FiniteStrain",
    "J2SmallStrain",
    "Linear",
    "LinearElastic",
    "LinearViscoelastic",
    "Material",
    "NeoHookean",
    "Orthotropic",
    "Response",
    "SaintVenantKirchhoff",
    "Voce",
]
