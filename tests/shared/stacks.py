# SPDX-License-Identifier: LGPL-3.0-or-later
"""A stack of point masses that bounce on the ground under gravity, with what they must keep."""

from __future__ import annotations

import numpy as np
from solving import solve

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints, frame_from_normal


class Stack:
    """Masses above one another in 2D, each against the one below, theta = 1/2.

    Args:
        masses: from the ground up (kg), shape (n,).
        heights: above the ground (m), rising, shape (n,); masses are points.
        restitution: Newton's e of all contacts.
        velocity: upward (m/s), shape (n,); rest if not given.
        gravity: downward (m/s^2).

    Attributes:
        height, velocity: now, shape (n,), m, m/s.
        ground_impulse: sum of the normal impulses that the ground gave (N s).
    """

    def __init__(self, masses, heights, restitution, velocity=None, gravity=9.81):
        self.masses, self.gravity = np.asarray(masses, float), gravity
        self.height = np.array(heights, float)
        n = len(self.masses)
        self.velocity = np.zeros(n) if velocity is None else np.array(velocity, float)
        self.ground_impulse = 0.0
        below = np.array([n, *range(n - 1)])
        points = InteractionPoints(
            np.stack([np.arange(n), below], axis=1)[:, :, None].astype(np.int32),
            np.ones((n, 2, 1)),
            frame_from_normal(np.tile([0.0, 1.0], (n, 1))),
            np.ones(n),
            self.gaps,
        )
        inverse = BodyInverse.from_uniform(np.eye(2) / self.masses[:, None, None], 2)
        vertical = np.stack([0.0 * self.velocity, self.velocity], axis=1)
        self._interactions = Interactions(
            points, [SignoriniCoulomb(restitution=restitution)], np.zeros(n, int), inverse, vertical
        )

    @property
    def gaps(self) -> np.ndarray:
        """Distance of each mass to the one below (m), negative where they interpenetrate."""
        return np.diff(self.height, prepend=0.0)

    @property
    def momentum(self) -> float:
        """Upward momentum (N s)."""
        return float(self.masses @ self.velocity)

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, the latter zero on the ground (J)."""
        return float(self.masses @ (0.5 * self.velocity**2 + self.gravity * self.height))

    def step(self, h: float) -> None:
        """Advance by h (s); impulses are solved to rounding.

        Raises:
            RuntimeError: the sweeps did not converge.
        """
        slots = np.zeros((len(self.masses) + 1, 2))
        slots[:-1, 1] = self.velocity - h * self.gravity
        slots = slots.ravel()
        self._interactions.begin_step(h, 0.5)
        report = solve(self._interactions, slots, tolerance=1e-13, num_threads=1)
        if not report.converged:
            raise RuntimeError(f"sweeps left an error of {report.residual:.1e}")
        self._interactions.commit(slots)
        self.ground_impulse += self._interactions.gather("impulse")[0, 0]
        after = slots[1:-2:2]
        self.height += 0.5 * h * (self.velocity + after)
        self.velocity = after.copy()
