# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the unknowns of the bulk are, and how the displacement of its nodes follows from them.

Displacements are u = N q, so forces on the unknowns are N^T f and stiffnesses N^T K N. Here N is
the identity; `periodic/periodic_unknowns.py` ties nodes and adds the macroscopic gradient.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from dolfinx.fem import FunctionSpace

from xper_fx.bodies.explode import Bodies
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.support.saved_rows import Rows

if TYPE_CHECKING:
    import scipy.sparse as sp


class NodalUnknowns:
    """The displacements of the nodes, in the numbering of the function space.

    Args:
        V: vector Lagrange space on `bodies.mesh`.

    Attributes:
        dim: dofs a node.
        num_nodes: number of nodes among the unknowns, which come first.
        num_dofs: number of unknowns.
        node_of: shape (num_nodes of V,), the node among the unknowns that each node of V is.
        nodes, offsets: nodes body by body, as `Bodies.node_permutation` gives them.
    """

    def __init__(self, V: FunctionSpace, bodies: Bodies):
        self.dim = V.dofmap.index_map_bs
        self.nodes, self.offsets = bodies.node_permutation(V)
        self.node_of = np.arange(len(self.nodes), dtype=np.int32)
        self.num_nodes = len(self.nodes)
        self.num_dofs = self.num_nodes * self.dim
        self._dofmap, self._parent_cell = V.dofmap.list, bodies.parent_cell

    def expand(self, unknowns: np.ndarray) -> np.ndarray:
        """N q: displacements (or velocities) of all nodes of V, shape (num_dofs of V,)."""
        return unknowns

    def collect(self, forces: np.ndarray) -> np.ndarray:
        """N^T f: forces on the unknowns, shape (num_dofs,)."""
        return forces

    def condense(self, stiffness: BlockMatrix) -> BlockMatrix:
        """The part of N^T K N on the nodes, in blocks of dim x dim."""
        return stiffness

    def whole(self, stiffness: BlockMatrix) -> sp.csr_array:
        """N^T K N over all unknowns, columns sorted; its pattern hangs on that of K alone."""
        matrix = stiffness.to_scipy().tocsr()
        matrix.sort_indices()
        return matrix

    def by_cell(self, unknowns: np.ndarray) -> dict:
        """Unknowns or forces on them in an order that no process decides.

        Args:
            unknowns: shape (num_dofs,).

        Returns:
            `nodes`: `Rows` over the cells of the parent mesh, (num_cells, nodes a cell, dim).
        """
        rows = unknowns.reshape(-1, self.dim)
        return {"nodes": Rows(self._parent_cell, rows[self.node_of[self._dofmap]])}

    def from_cells(self, saved: Mapping) -> np.ndarray:
        """The unknowns, shape (num_dofs,), that `by_cell` told of."""
        unknowns = np.zeros(self.num_dofs)
        nodes = self.node_of[self._dofmap]
        unknowns.reshape(-1, self.dim)[nodes] = saved["nodes"][self._parent_cell]
        return unknowns
