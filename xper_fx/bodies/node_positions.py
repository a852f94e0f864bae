# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where the nodes of a space are, to the last digit the same for all cells that meet there."""

from __future__ import annotations

import basix
import numpy as np
from dolfinx.fem import FunctionSpace

from xper_fx.support.compat import geometry_dofmap


def node_positions(V: FunctionSpace) -> np.ndarray:
    """Positions of nodes: vertices of the mesh, and means of those of an edge, facet or cell.

    `V.tabulate_dof_coordinates` sums shape functions, whose values at nodes are 0 and 1 to
    rounding: what it gives for a position differs from cell to cell in the last digit.

    Args:
        V: continuous Lagrange space of order 1 or 2 on a mesh of straight edges.

    Returns:
        Shape (number of nodes, 3), m.
    """
    element = V.sub(0).element.basix_element
    nodes, corners = V.dofmap.list, V.mesh.geometry.x[geometry_dofmap(V.mesh)]
    index_map = V.dofmap.index_map
    positions = np.empty((index_map.size_local + index_map.num_ghosts, 3))
    for entities, dofs in zip(basix.topology(element.cell_type), element.entity_dofs, strict=True):
        for vertices, at in zip(entities, dofs, strict=True):
            # in the order of their size, so that the sum does not depend on the cell
            mean = np.sort(corners[:, vertices], axis=1).mean(axis=1)
            positions[nodes[:, at]] = mean[:, None]
    return positions
