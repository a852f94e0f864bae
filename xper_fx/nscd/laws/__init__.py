# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interaction laws, one file each; `law.py` says what a law is."""

from xper_fx.lazy import importer

_MODULE_OF = {
    "CohesiveZone": "cohesive_zone",
    "Law": "law",
    "PerfectBond": "perfect_bond",
    "SignoriniCoulomb": "signorini_coulomb",
    "Tresca": "signorini_coulomb",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
