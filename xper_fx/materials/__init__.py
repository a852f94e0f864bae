# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk materials, one file each; `library.py` holds sourced constants."""

from xper_fx.lazy import importer

_MODULE_OF = {
    "Cubic": "orthotropic",
    "Hardening": "hardening",
    "InelasticMaterial": "material",
    "J2FiniteStrain": "j2_finite_strain",
    "J2SmallStrain": "j2_small_strain",
    "Linear": "hardening",
    "LinearElastic": "linear_elastic",
    "LinearViscoelastic": "viscoelastic",
    "Material": "material",
    "NeoHookean": "neo_hookean",
    "Orthotropic": "orthotropic",
    "Response": "material",
    "SaintVenantKirchhoff": "saint_venant_kirchhoff",
    "Voce": "hardening",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
