# SPDX-License-Identifier: LGPL-3.0-or-later
"""The local Signorini problem at one point, without friction; `coulomb.py` states it with friction.

It is explicit: r_N >= 0 brings dU_N to v_min. Where the normal stands alone, a compliance that
counts as zero is zero (`nscd/interactions.py`).
"""

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import SINGULAR

OPEN, STICK, SLIP = 0, 1, 2

# Relative size below which a slip counts as zero where nothing could stop it.
NO_SLIP = 1e-12


@njit(inline="always")
def frictionless_line(b, w, v_min):
    if b[0] >= v_min or w[0] == 0.0:
        return (0.0,), OPEN
    return ((v_min - b[0]) / w[0],), SLIP


@njit(inline="always")
def frictionless_plane(b, w, v_min):
    if b[0] >= v_min or w[0] <= SINGULAR * w[2]:
        return (0.0, 0.0), OPEN
    return ((v_min - b[0]) / w[0], 0.0), SLIP


@njit(inline="always")
def frictionless_space(b, w, v_min):
    if b[0] >= v_min or w[0] <= SINGULAR * (w[3] + w[5]):
        return (0.0, 0.0, 0.0), OPEN
    return ((v_min - b[0]) / w[0], 0.0, 0.0), SLIP
