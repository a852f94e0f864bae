# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bulk materials, one file each; `library.py` holds sourced constants."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.materials.hardening import Hardening as Hardening
    from xper_fx.materials.hardening import Linear as Linear
    from xper_fx.materials.hardening import Voce as Voce
    from xper_fx.materials.j2_finite_strain import J2FiniteStrain as J2FiniteStrain
    from xper_fx.materials.j2_small_strain import J2SmallStrain as J2SmallStrain
    from xper_fx.materials.linear_elastic import LinearElastic as LinearElastic
    from xper_fx.materials.material import InelasticMaterial as InelasticMaterial
    from xper_fx.materials.material import Material as Material
    from xper_fx.materials.material import Response as Response
    from xper_fx.materials.neo_hookean import NeoHookean as NeoHookean
    from xper_fx.materials.orthotropic import Cubic as Cubic
    from xper_fx.materials.orthotropic import Orthotropic as Orthotropic
    from xper_fx.materials.saint_venant_kirchhoff import (
        SaintVenantKirchhoff as SaintVenantKirchhoff,
    )
    from xper_fx.materials.viscoelastic import LinearViscoelastic as LinearViscoelastic

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
