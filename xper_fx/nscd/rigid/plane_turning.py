# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation of rigid bodies between kicks in 2D: the angle grows by tau omega."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies


class Turn(NamedTuple):
    """Where bodies have turned to, and how they spin; s = 1 in 2D, 3 in 3D."""

    #: angles, shape (n,), rad (2D); matrices from body to space, (n, 3, 3) (3D)
    rotation: np.ndarray
    #: angular momentum about the centre of mass, in space, shape (n, s), N m s
    momentum: np.ndarray
    spin: np.ndarray  #: in space, shape (n, s), rad/s
    inertia: np.ndarray  #: in space, shape (n, s, s), kg m^2


class PlaneTurning:
    """Rotation of bodies in 2D."""

    def __init__(self, bodies: RigidBodies):
        self.inertia = bodies.inertia[:, None, None]
        free = ~bodies.is_prescribed[:, 2]
        self.inverse = np.zeros_like(self.inertia)
        self.inverse[free, 0, 0] = 1.0 / bodies.inertia[free]
        self.guided = np.nonzero(~free)[0]
        spin = bodies.spin[:, None].copy()
        self.initial = Turn(
            bodies.rotation.copy(), bodies.inertia[:, None] * spin, spin, self.inertia
        )

    def drift(self, size: float, turn: Turn) -> Turn:
        """Bodies after a time `size` (s) without torques."""
        return turn._replace(
            rotation=turn.rotation + size * turn.spin[:, 0], momentum=self.inertia[:, 0] * turn.spin
        )

    def turned(self, angle: np.ndarray, turn: Turn) -> Turn:
        """Bodies turned at once by angles (rad), shape (n, 1)."""
        return turn._replace(rotation=turn.rotation + angle[:, 0])

    def update_inverse(self, turn: Turn, inverse: np.ndarray) -> None:
        """Write w of the spins into `inverse`, shape (n, 1, 1); it never changes in 2D."""
