# SPDX-License-Identifier: LGPL-3.0-or-later
"""How points move with the unknowns of a monolithic step, and with rigid bodies that are driven."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.coupled_matrices import CoupledMatrices
from xper_fx.bulk.state import State
from xper_fx.nscd.interactions import Interactions


class PointMotions:
    """Velocities at the nodes of points, and at points, from those of the unknowns.

    Args:
        matrices: of the bulk and of the system.
        interactions: the points, None without any.
        state: at the start of the step.
    """

    def __init__(self, matrices: CoupledMatrices, interactions: Interactions | None, state: State):
        self._matrices, self._points, self._state = matrices, interactions, state

    def slots(self, velocity: np.ndarray, driven: np.ndarray) -> np.ndarray:
        """Velocities at the points' nodes, shape (num_slots * dim,).

        Args:
            velocity: of all unknowns, shape (num_dofs,), m/s.
            driven: of rigid bodies, shape (2 n, dim), m/s and rad/s, or empty.
        """
        points, nodes = self._points, self._matrices.nodes
        slots = np.empty((points.inverse.num_slots, points.dim))
        slots[: len(nodes)] = velocity.reshape(-1, points.dim)[nodes]
        points.complete(slots.reshape(-1), driven if len(driven) else None)
        points.refresh_ghosts(slots.reshape(-1))
        return slots.reshape(-1)

    def changes(self, change: np.ndarray, driven: np.ndarray) -> list[np.ndarray]:
        """Change of the velocities u of each group, shape (n, components), m/s.

        Where frames turn it is that of the jumps' rates.

        Args:
            change, driven: of velocities, as of `slots`.
        """
        slots = self.slots(change, driven).reshape(-1, self._points.dim)
        groups = self._points.groups
        if not self._points.turns:
            return [g.points.relative(slots) for g in groups]
        from xper_fx.nscd.turning_tangents import changes_of_jumps

        motion = self._matrices.bulk.macroscopic_motion(self._state.displacement, change)
        return [
            g.points.relative(slots) if g.turning is None else changes_of_jumps(g, slots, motion)
            for g in groups
        ]

    def jumps(self, slots: np.ndarray, step: float) -> list[np.ndarray]:
        """Jumps of each group at the end of a step (s) with velocities of `slots` there, m."""
        theta = self._matrices.theta
        rest, scaled = step * (1.0 - theta), step * theta
        slots = slots.reshape(-1, self._points.dim)
        return [
            g.jump + rest * g.velocity + scaled * g.points.relative(slots)
            for g in self._points.groups
        ]
