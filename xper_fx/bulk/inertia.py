# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inertia of the bulk, lumped; a static run has none, nor this module."""

from __future__ import annotations

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY


@njit(fastmath={"reassoc", "contract"}, **LEAN_ENTRY)
def _weighted_square(mass, velocity):
    total = 0.0
    for i in range(len(mass)):
        total += mass[i] * velocity[i] * velocity[i]
    return total


class Inertia:
    """A mass for each unknown.

    Args:
        mass: shape (num_dofs,), kg (2D: kg/m); zero for what has none.
    """

    def __init__(self, mass: np.ndarray):
        self.mass = mass

    def momentum(self, velocity: np.ndarray) -> np.ndarray:
        """M v, shape (num_dofs,), N s (2D: N s/m)."""
        return self.mass * velocity

    def energy(self, velocity: np.ndarray) -> float:
        """v . M . v / 2, J (2D: J/m)."""
        return 0.5 * _weighted_square(self.mass, velocity)
