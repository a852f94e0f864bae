# SPDX-License-Identifier: LGPL-3.0-or-later
"""The matrices of a monolithic step: that of the bulk, and the system it makes with the points."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.coupled_system import CoupledSystem
from xper_fx.nscd.interactions import Interactions


class CoupledMatrices:
    """Made when asked for, kept while they serve.

    Args:
        bulk: the bulk.
        nodes: at which interactions act, shape (n,).
        theta: weight of the end of the step, in [1/2, 1].

    Attributes:
        bulk, nodes, theta: as given.
        weight: theta of each dof.
    """

    def __init__(self, bulk: Bulk, nodes: np.ndarray, theta: float):
        self.bulk, self.nodes, self.theta = bulk, np.asarray(nodes), theta
        self.weight = bulk.end_weight(theta)
        self._system: CoupledSystem | None = None
        self._renewals = -1
        self._linear: tuple[float, sp.csr_array] | None = None

    def of_bulk(self, step: float, displacement: np.ndarray) -> sp.csr_array:
        """A = M + C + h^2 theta^2 dF/dq for a step size (s); its pattern is always the same."""
        bulk = self.bulk
        if bulk.linear and self._linear is not None and self._linear[0] == step:
            return self._linear[1]
        scaled = step * self.theta
        stiffness = (bulk.stiffness if bulk.linear else bulk.tangent(displacement)).copy()
        stiffness.data *= scaled**2
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

    def coupled(self, matrix: sp.csr_array, interactions: Interactions | None) -> CoupledSystem:
        """The system of A and the points there are."""
        renewals = 0 if interactions is None else interactions.renewals
        if self._system is None or self.bulk.ranks.max(renewals != self._renewals):
            layout, halo = self.bulk.layout, None
            dofs_of_slots = np.zeros(0, np.int64)
            if interactions is not None:
                dofs_of_slots = np.full(interactions.inverse.num_slots * self.bulk.dim, -1)
                dofs = layout.dofs(self.nodes)
                dofs_of_slots[: len(dofs)] = dofs
                halo = interactions.halo
            own = matrix, layout.prescribed, dofs_of_slots, interactions
            if halo is None:
                self._system = CoupledSystem(*own)
            else:
                self._system = halo.coupled_system(*own, self.bulk.num_common)
            self._renewals = renewals
        elif interactions is not None and interactions.turns:
            self._system.turn(interactions)
        return self._system

    def unstable_ways(self) -> int:
        """In how many ways the last state would move on by itself, under loads that stand still."""
        return 0 if self._system is None else self._system.unstable_ways()

    @property
    def nbytes(self) -> int:
        """Memory held, factors apart, in bytes."""
        linear = 0 if self._linear is None else 1.5 * self._linear[1].data.nbytes
        return int(linear) + (0 if self._system is None else self._system.nbytes)
