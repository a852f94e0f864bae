# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monolithic steps of scenes with initially rigid bonds: which vertices are whole, step by step.

A step is solved with the vertices that are whole. Where one does not bear it, the step is made
again with the points of all those that bear little more; where all do, those get their points for
the steps to come. So what is found is what points on all facets find, and the factorisations
change by batches.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.coupled_matrices import CoupledMatrices
from xper_fx.bulk.state import State
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.splitting.strength_of_vertices import StrengthOfVertices

# Share of its strength at which a vertex is split. What it changes is time: the lower it is, the
# more points there are, and the fewer steps are made again.
_AHEAD = 0.6


class BreakingVertices:
    """The vertices of a scene that are whole until a step would break them.

    Args:
        matrices: of the bulk and of the system.
        interactions: points whose vertices split (`Interactions.fused`).
    """

    def __init__(self, matrices: CoupledMatrices, interactions: Interactions):
        self._matrices, self._interactions = matrices, interactions
        self._strength = StrengthOfVertices(interactions)

    def begin(self, state: State, step: float, theta: float) -> None:
        """Let the system be that of the vertices that are whole.

        Those are split that prescribed motions tear apart.

        Args:
            state: at the start of the step.
            step: h (s).
            theta: weight of its end.
        """
        bulk, shared = self._matrices.bulk, self._matrices.share(self._interactions)
        wanted, time = state.velocity.copy(), state.time + step
        bulk.prescribe(wanted, time, step, theta, state.displacement, state.velocity)
        apart = np.zeros(bulk.num_dofs, bool)
        apart[shared.apart(wanted)] = True
        if np.any(apart):
            slots = np.any(apart.reshape(-1, bulk.dim)[self._matrices.nodes], axis=1)
            vertices = self._interactions.fused.vertex_of_slot[: len(slots)][slots]
            self._interactions.wake(np.unique(vertices))
            self._matrices.share(self._interactions)

    def split(self, transmitted: np.ndarray, state: State) -> bool:
        """Split the vertices that a step shows to bear little more.

        Args:
            transmitted: shape (num_dofs,), impulses of the step between cells that move as one.
            state: at its start.

        Returns:
            Whether some vertex does not bear the step, which is to be made again.
        """
        strength, given = self._strength, self._on_slots(transmitted)
        weak = strength.beyond(given, _AHEAD)
        if not len(weak):
            return False
        again = len(strength.beyond(given, 1.0)) > 0
        if not again:
            strength.split(weak, given, "impulse")
            return False
        strength.split(weak, self._on_slots(self._before(transmitted, state)), "committed_impulse")
        return True

    def _before(self, transmitted: np.ndarray, state: State) -> np.ndarray:
        """What cells gave each other in the step before, shape (num_dofs,), N s.

        With inertia it is but a start for the iterations, and taken from this step.
        """
        bulk, points = self._matrices.bulk, self._interactions
        if bulk.inertia is not None:
            ratio = points.committed_step / points.step_size
            return (ratio if ratio > 0.0 else 1.0) * transmitted
        missing = state.external - state.internal - bulk.viscous(state.velocity)
        return self._matrices.shared.transmitted(points.committed_step * missing)

    def _on_slots(self, values: np.ndarray) -> np.ndarray:
        out = np.zeros((self._interactions.inverse.num_slots, self._matrices.bulk.dim))
        nodes = self._matrices.nodes
        out[: len(nodes)] = values.reshape(-1, out.shape[1])[nodes]
        return out

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self._strength.nbytes
