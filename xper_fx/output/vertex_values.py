# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields of a meshed scene at the vertices of its bodies, for files and figures."""

from __future__ import annotations

import numpy as np

from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap


class VertexValues:
    """Values at the geometry nodes of the exploded mesh, those of all ranks on each.

    All ranks call it together. Of a mesh that is spread over ranks each has those of its own
    bodies, `Simulation.bodies`.

    Args:
        simulation: of a scene with a mesh.
    """

    def __init__(self, simulation: Simulation):
        self._simulation, mesh = simulation, simulation.bodies.mesh
        # a cell's first dofs are its vertices'
        cells = geometry_dofmap(mesh)
        self._node = np.empty(len(mesh.geometry.x), np.int64)
        self._node[cells] = simulation.forms.V.dofmap.list[:, : cells.shape[1]]

    def _of_vertices(self, nodal: np.ndarray) -> np.ndarray:
        """Values at the bodies' geometry nodes from those of this rank's dofs."""
        simulation = self._simulation
        values = nodal.reshape(-1, simulation.bulk.dim)[self._node]
        part = simulation.part
        if part is None or simulation.scene.bodies.spread is not None:
            return values
        return simulation.ranks.gather(part.nodes, values)

    def displacement(self) -> np.ndarray:
        """Shape (num_nodes, dim), m."""
        simulation = self._simulation
        return self._of_vertices(simulation.bulk.unknowns.expand(simulation.state.displacement))

    def velocity(self) -> np.ndarray:
        """Shape (num_nodes, dim), m/s."""
        return self._of_vertices(self._simulation.velocity.x.array)
