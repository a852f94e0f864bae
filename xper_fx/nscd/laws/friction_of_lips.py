# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction of bonded lips: none, Coulomb's from the start, or growing as the bond weakens."""

from __future__ import annotations

from enum import Enum
from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import MERGED
from xper_fx.nscd.laws.damage_curve import BETA0, MU


class Friction(Enum):
    """What rubs."""

    NONE = "none"
    WHOLE = "whole"
    GROWING = "growing"


@cache
def friction_by_damage(friction: Friction):
    """The compiled `friction_of(i, beta, parameters)`: mu of lips whose bond has a damage beta.

    Growing, it is mu (1 - beta / beta0): what is bonded does not rub (Raous, Cangemi and Cocou
    1999).
    """
    if friction is Friction.NONE:
        return njit(**MERGED)(lambda i, beta, parameters: 0.0)
    if friction is Friction.WHOLE:
        return njit(**MERGED)(lambda i, beta, parameters: parameters[i, MU])

    @njit(**MERGED)
    def growing(i, beta, parameters):
        return parameters[i, MU] * (1.0 - beta / parameters[i, BETA0])

    return growing
