# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interaction laws, one file each; `law.py` says what a law is."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.laws import curves as curves
    from xper_fx.nscd.laws.adhesion import Adhesion as Adhesion
    from xper_fx.nscd.laws.cohesive_curve import CohesiveCurve as CohesiveCurve
    from xper_fx.nscd.laws.cohesive_zone import CohesiveZone as CohesiveZone
    from xper_fx.nscd.laws.ductile_zone import DuctileZone as DuctileZone
    from xper_fx.nscd.laws.law import Law as Law
    from xper_fx.nscd.laws.mixed_mode import MixedMode as MixedMode
    from xper_fx.nscd.laws.perfect_bond import PerfectBond as PerfectBond
    from xper_fx.nscd.laws.rigid_cohesive_zone import RigidCohesiveZone as RigidCohesiveZone
    from xper_fx.nscd.laws.rigid_mixed_mode import RigidMixedMode as RigidMixedMode
    from xper_fx.nscd.laws.signorini_coulomb import SignoriniCoulomb as SignoriniCoulomb
    from xper_fx.nscd.laws.signorini_coulomb import Tresca as Tresca
    from xper_fx.nscd.laws.stribeck import StribeckFriction as StribeckFriction
    from xper_fx.nscd.laws.weakening_friction import MohrCoulomb as MohrCoulomb
    from xper_fx.nscd.laws.weakening_friction import SlipWeakening as SlipWeakening

_MODULE_OF = {
    "Adhesion": "adhesion",
    "CohesiveCurve": "cohesive_curve",
    "CohesiveZone": "cohesive_zone",
    "DuctileZone": "ductile_zone",
    "Law": "law",
    "MixedMode": "mixed_mode",
    "MohrCoulomb": "weakening_friction",
    "PerfectBond": "perfect_bond",
    "RigidCohesiveZone": "rigid_cohesive_zone",
    "RigidMixedMode": "rigid_mixed_mode",
    "SignoriniCoulomb": "signorini_coulomb",
    "SlipWeakening": "weakening_friction",
    "StribeckFriction": "stribeck",
    "Tresca": "signorini_coulomb",
}

_NAMESPACES = {"curves": "curves"}

__all__ = [*_MODULE_OF, *_NAMESPACES]
__getattr__ = importer(__name__, _MODULE_OF, _NAMESPACES)
