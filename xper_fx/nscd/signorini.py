# SPDX-License-Identifier: LGPL-3.0-or-later
"""The local Signorini problem at one point, with friction or without.

`coulomb.py` states it with friction. Without, it is explicit: r_N >= 0 brings dU_N to v_min. Where
the normal stands alone, a compliance that counts as zero is zero (`interactions.py`).
"""

from __future__ import annotations

from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.small import SINGULAR

OPEN, STICK, SLIP = 0, 1, 2

# Relative size below which a slip counts as zero where nothing could stop it.
NO_SLIP = 1e-12


@njit(inline="always")
def _frictionless_line(b, w, v_min):
    if b[0] >= v_min or w[0] == 0.0:
        return (0.0,), OPEN
    return ((v_min - b[0]) / w[0],), SLIP


@njit(inline="always")
def _frictionless_plane(b, w, v_min):
    if b[0] >= v_min or w[0] <= SINGULAR * w[2]:
        return (0.0, 0.0), OPEN
    return ((v_min - b[0]) / w[0], 0.0), SLIP


@njit(inline="always")
def _frictionless_space(b, w, v_min):
    if b[0] >= v_min or w[0] <= SINGULAR * (w[3] + w[5]):
        return (0.0, 0.0, 0.0), OPEN
    return ((v_min - b[0]) / w[0], 0.0, 0.0), SLIP


@cache
def contact_solver(components: int, friction: bool):
    """Kernel `solve(b, w, v_min, shift, mu, bound) -> (r, status)` for 2 or 3 components.

    Without friction the tangential part is neither imported nor compiled, and where nothing else
    acts along the tangent one component, the normal's, will do.

    Returns:
        A jitted function; `b`, `r` are `(n, t...)` tuples (m/s, N s), `w` a symmetric tuple
        (m/s per N s), `shift` a tuple of the tangential components (m/s).
    """
    if friction:
        if components == 2:
            from xper_fx.nscd.coulomb import coulomb_plane

            return coulomb_plane
        from xper_fx.nscd.coulomb_space import coulomb_space

        return coulomb_space
    frictionless = (_frictionless_line, _frictionless_plane, _frictionless_space)[components - 1]

    @njit(inline="always")
    def solve(b, w, v_min, shift, mu, bound):
        return frictionless(b, w, v_min)

    return solve
