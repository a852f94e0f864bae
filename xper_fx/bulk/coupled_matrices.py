# SPDX-License-Identifier: LGPL-3.0-or-later
"""The matrices of a monolithic step: that of the bulk, and the system it makes with the points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.coupled_system import CoupledSystem
from xper_fx.nscd.interactions import Interactions

if TYPE_CHECKING:
    from xper_fx.bulk.shared_motion import SharedMotion


class CoupledMatrices:
    """Made when asked for, kept while they serve.

    Args:
        nodes: at which interactions act, shape (n,).
        theta: weight of the end of the step, in [1/2, 1].

    Attributes:
        bulk, nodes, theta: as given.
        weight: theta of each dof.
        shared: what moves as one; None where all points of bonds are there.
    """

    def __init__(self, bulk: Bulk, nodes: np.ndarray, theta: float):
        self.bulk, self.nodes, self.theta = bulk, np.asarray(nodes), theta
        self.weight = bulk.end_weight(theta)
        self._system: CoupledSystem | None = None
        self._renewals = self._split = -1
        self.shared: SharedMotion | None = None
        self._condensed: tuple[sp.csr_array, sp.csr_array] | None = None
        self._linear: tuple[float, sp.csr_array] | None = None

    def of_bulk(self, step: float, displacement: np.ndarray) -> sp.csr_array:
        """A = M + C + h^2 theta^2 dF/dq for a step size (s); its pattern is always the same."""
        bulk = self.bulk
        if bulk.linear and self._linear is not None and self._linear[0] == step:
            return self._linear[1]
        scaled = step * self.theta
        stiffness = (bulk.stiffness if bulk.linear else bulk.tangent(displacement)).copy()
        stiffness.data[:] *= scaled**2
        if bulk.damping is not None:
            bulk.damping.add_to(stiffness, scaled)
        matrix = bulk.unknowns.whole(stiffness)
        rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        if np.ndim(self.weight):
            ratio = self.weight / self.theta
            matrix.data *= ratio[rows] * ratio[matrix.indices]
        if bulk.inertia is not None:
            mass = bulk.mass
            if bulk.damping is not None:
                mass = mass * bulk.damping.mass_factor(scaled)
            matrix.data[np.flatnonzero(rows == matrix.indices)] += mass
        if bulk.linear:
            self._linear = step, matrix
        return matrix

    def share(self, interactions: Interactions) -> SharedMotion:
        """What moves as one of what the points leave whole (`Interactions.fused`)."""
        split = len(interactions.fused.split)
        if self.shared is None or split != self._split:
            from xper_fx.bulk.shared_motion import motion_of_whole_vertices

            prescribed = self.bulk.layout.prescribed
            self.shared = motion_of_whole_vertices(interactions, self.nodes, prescribed)
            self._split, self._system, self._condensed = split, None, None
        return self.shared

    def factorise(
        self,
        matrix: sp.csr_array,
        stiffness: Sequence[np.ndarray],
        interactions: Interactions | None,
    ) -> None:
        """Take the system of A and the points there are; `solve` is then for it.

        Args:
            matrix: A, as `of_bulk` gives it.
            stiffness: K of each group of points, shape (n, components, components).
            interactions: the points, None without any.

        Raises:
            SingularMatrixError: it cannot be factorised.
        """
        if self.shared is not None:
            if self._condensed is None or self._condensed[0] is not matrix:
                self._condensed = matrix, self.shared.of_motions(matrix)
            matrix = self._condensed[1]
        self._coupled(matrix, interactions).take(matrix, stiffness)

    def solve(self, right: np.ndarray, given: np.ndarray) -> np.ndarray:
        """As `CoupledSystem.solve`, of all dofs."""
        if self.shared is not None:
            return self.shared.solve(self._system, right, given)
        return self._system.solve(right, given)

    def _coupled(self, matrix: sp.csr_array, interactions: Interactions | None) -> CoupledSystem:
        renewals = 0 if interactions is None else interactions.renewals
        if self._system is None or self.bulk.ranks.max(renewals != self._renewals):
            layout, halo = self.bulk.layout, None
            dofs_of_slots = gradient = np.zeros(0, np.int64)
            if interactions is not None:
                dofs_of_slots = np.full(interactions.inverse.num_slots * self.bulk.dim, -1)
                dofs = layout.dofs(self.nodes)
                dofs_of_slots[: len(dofs)] = dofs
                halo = interactions.halo
                if interactions.turns:
                    size = self.bulk.num_dofs
                    gradient = np.arange(size - interactions.size_of_gradient, size)
            prescribed = layout.prescribed
            if self.shared is not None:
                prescribed, dofs_of_slots = self.shared.prescribed, self.shared.at(dofs_of_slots)
                gradient = self.shared.at(gradient)
            own = matrix, prescribed, dofs_of_slots, interactions, gradient
            if halo is None:
                self._system = CoupledSystem(*own)
            else:
                self._system = halo.coupled_system(*own, self.bulk.num_common)
            self._renewals = renewals
        return self._system

    def unstable_ways(self) -> int:
        """In how many ways the last state would move on by itself, under loads that stand still."""
        return 0 if self._system is None else self._system.unstable_ways()

    @property
    def nbytes(self) -> int:
        """Memory held, factors apart, in bytes."""
        linear = 0 if self._linear is None else 1.5 * self._linear[1].data.nbytes
        linear += 0 if self.shared is None else self.shared.nbytes
        linear += 0 if self._condensed is None else 1.5 * self._condensed[1].data.nbytes
        return int(linear) + (0 if self._system is None else self._system.nbytes)
