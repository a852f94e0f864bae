# SPDX-License-Identifier: LGPL-3.0-or-later
"""The solver of the local Signorini problem at one point that a law asks for."""

from __future__ import annotations

from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.laws.signorini import frictionless_line, frictionless_plane, frictionless_space


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
            from xper_fx.nscd.laws.coulomb import coulomb_plane

            return coulomb_plane
        from xper_fx.nscd.laws.coulomb_space import coulomb_space

        return coulomb_space
    frictionless = (frictionless_line, frictionless_plane, frictionless_space)[components - 1]

    @njit(inline="always")
    def solve(b, w, v_min, shift, mu, bound):
        return frictionless(b, w, v_min)

    return solve
