# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the contact of a bond's lips takes from the energy: sliding, impact, the solver's error."""

from __future__ import annotations

from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.laws.law import FRICTION, IMPACT, NUMERICAL

# Difference of the squares of friction and its bound, relative, at which lips slide: impulses have
# the tolerance of the solver.
_SLIDES = 2e-3


@cache
def contact_losses(dim: int, friction: bool):
    """The function that books them, with or without friction."""
    dot = for_dimension(dim).dot

    @njit(inline="always")
    def book(i, hat, moved, step, pressing, numerical, mu, energy):
        """Book friction, impact and numerical energy of a step; returns the status.

        Args:
            i: the point.
            hat: impulse of the contact alone (N s).
            moved: change of the jump (m).
            step: h (s).
            pressing: whether the lips are closed.
            numerical: energy of the bond that nothing else takes up (J).
            mu: friction of the lips (not read without friction).
            energy: of the law.
        """
        lost_n = -hat[0] * moved[0] / step
        lost_t = -(dot(hat, moved) - hat[0] * moved[0]) / step
        sliding = pressing
        if friction:
            size = dot(hat, hat) - hat[0] * hat[0]
            bound = mu * hat[0]
            sliding = pressing and size >= (1.0 - _SLIDES) * bound * bound
        energy[i, FRICTION] = max(lost_t, 0.0) if friction and sliding else 0.0
        energy[i, IMPACT] = max(lost_n, 0.0) if pressing else 0.0
        energy[i, NUMERICAL] = numerical + lost_t - energy[i, FRICTION] + lost_n - energy[i, IMPACT]
        return 2 if sliding else (1 if pressing else 0)

    return book
