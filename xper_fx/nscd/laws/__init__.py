# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interaction laws, one file each; `law.py` says what a law is."""

from xper_fx.nscd.laws.cohesive_zone import CohesiveZone
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.laws.perfect_bond import PerfectBond
from xper_fx.nscd.laws.signorini_coulomb import SignoriniCoulomb, Tresca

__all__ = ["CohesiveZone", "Law", "PerfectBond", "SignoriniCoulomb", "Tresca"]
