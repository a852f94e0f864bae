# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an initially rigid bond bears while it is sound, whichever traction of a step it has."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.damage_curve import BETA0, C_N, C_T
from xper_fx.nscd.laws.friction_of_lips import Friction, friction_by_damage
from xper_fx.nscd.laws.weakening import Weakening

# Those of `rigid_kernels.py`; all but `bears` are None of laws that are for no explicit bulk.
RigidKernels = namedtuple("RigidKernels", "bears held insist rest rests", defaults=4 * (None,))

# Excess of a traction over the strength, relative, that is rounding.
_ROUNDING = 1e-12


@cache
def strength_of(dim: int, friction: Friction, weakening: Weakening) -> tuple[Callable, Callable]:
    """Kernels of a bond's strength.

    Args:
        friction: of the lips.
        weakening: how openings weaken the bond.

    Returns:
        `opening(jump)`, which closed lips have by shear alone (m), and `bears(i, r, step_area,
        parameters)`: whether a sound bond bears an impulse r (N s) over `step_area`, step times
        area (m^2 s). Pressed lips rub, which leaves the bond less to bear.
    """
    algebra, shape = for_dimension(dim), weakening.shape
    dot, scale, diagonal = algebra.dot, algebra.scale, algebra.multiply_diagonal
    friction_of = friction_by_damage(friction)

    @njit(inline="always")
    def opening(jump):
        x = max(jump[0], 0.0) ** 2 + jump[1] * jump[1]
        if dim == 3:
            x += jump[2] * jump[2]
        return np.sqrt(x)

    @njit(**LEAN_ENTRY)
    def bears(i, r, step_area, parameters):
        pull = scale(-1.0 / step_area, r)
        share = 1.0
        if pull[0] < 0.0:
            rubbed = -friction_of(i, parameters[i, BETA0], parameters) * pull[0]
            sheared = np.sqrt(dot(pull, pull) - pull[0] * pull[0])
            share = max(0.0, 1.0 - rubbed / sheared) if sheared > 0.0 else 0.0
        jump = diagonal(1.0 / parameters[i, C_N], share / parameters[i, C_T], pull)
        return opening(jump) <= shape(i, jump, parameters)[0] * (1.0 + _ROUNDING)

    return opening, bears
