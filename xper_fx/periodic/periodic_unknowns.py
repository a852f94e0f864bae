# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The unknowns of a periodic cell: the fluctuation, and the macroscopic gradient.

With G = Fbar - I and X measured from the middle of the cell,

    u = G X + u#,

u# being one unknown for all nodes of a body that are one node of the periodic medium. After the
nodes of u# come `dim` pseudo-nodes: the j-th is column j of G, so that u = u# + sum_j X_j g_j. The
forces that belong to it are column j of |Omega| Pibar, as X^T f_int = int Pi dx.

Where ranks divide the bodies, ties stay within a rank, as they join nodes of one body. G is there
on every rank, and so is the sum over all bodies X^T f_int = sum_r X_r^T f_r, the same to the bit.
All measure X from one middle: to take it from x0 + d moves a body's u by -G d and nothing else, as
its internal forces add up to zero, and would leave gaps in u where a rank ends.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from dolfinx.fem import FunctionSpace

from xper_fx.bodies.explode import Bodies
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.bulk.unknowns import NodalUnknowns
from xper_fx.support.ranks import ALONE, Ranks


class CellUnknowns(NodalUnknowns):
    """Fluctuation of the nodes and macroscopic gradient; see `NodalUnknowns`.

    Args:
        V: vector Lagrange space on `bodies.mesh`.
        bodies: bodies of a periodic cell.
        ranks: ranks that divide the cell's bodies, these being this rank's.

    Attributes:
        position: shape (num_nodes of V, dim), X (m).
        tied: whether nodes of V share their fluctuation.
    """

    def __init__(self, V: FunctionSpace, bodies: Bodies, ranks: Ranks = ALONE):
        super().__init__(V, bodies)
        self._ranks = ranks
        self.node_of, self.num_nodes = bodies.node_classes(V)
        self.tied = self.num_nodes < len(self.node_of)
        if self.tied:
            self._keep_first_of_class()
            ones = np.ones(len(self.node_of))
            places = (self.node_of, np.arange(len(self.node_of)))
            self._sum = sp.csr_array((ones, places), shape=(self.num_nodes, len(ones)))
        x = V.tabulate_dof_coordinates()[:, : self.dim]
        low, high = ranks.box(x)
        self.position = x - 0.5 * (low + high)
        self.num_dofs = (self.num_nodes + self.dim) * self.dim
        self._blocks_of = None

    @property
    def nbytes(self) -> int:
        """Memory of what a cell needs beside the bulk, in bytes."""
        ties = self.node_of.nbytes + self._sum.data.nbytes if self.tied else 0
        return self.position.nbytes + ties

    @property
    def macroscopic(self) -> slice:
        """Where the macroscopic gradient stands among the unknowns, column by column."""
        return slice(self.num_nodes * self.dim, None)

    def _keep_first_of_class(self) -> None:
        nodes = self.node_of[self.nodes]
        _, first = np.unique(nodes, return_index=True)
        kept = np.zeros(len(nodes), bool)
        kept[first] = True
        self.offsets = np.concatenate([[0], np.cumsum(kept)])[self.offsets].astype(np.int32)
        self.nodes = nodes[kept]

    def expand(self, unknowns: np.ndarray) -> np.ndarray:
        """See `NodalUnknowns`."""
        rows = unknowns.reshape(-1, self.dim)
        fluctuation = rows[self.node_of] if self.tied else rows[: self.num_nodes]
        return (fluctuation + self.position @ rows[self.num_nodes :]).ravel()

    def collect(self, forces: np.ndarray) -> np.ndarray:
        """See `NodalUnknowns`; the last dim^2 entries are int Pi dx of all bodies, by columns."""
        rows = forces.reshape(-1, self.dim)
        on_nodes = self._sum @ rows if self.tied else rows
        stresses = self._ranks.sum(self.position.T @ rows)
        return np.concatenate([on_nodes, stresses]).ravel()

    def condense(self, stiffness: BlockMatrix) -> BlockMatrix:
        """See `NodalUnknowns`."""
        if not self.tied:
            return stiffness
        if self._blocks_of is None:
            self._plan(stiffness)
        count, indices, indptr = self._structure
        data = (self._blocks_of @ stiffness.data.reshape(len(stiffness.data), -1)).reshape(
            count, self.dim, self.dim
        )
        return BlockMatrix(data, indices, indptr)

    def _plan(self, stiffness: BlockMatrix) -> None:
        """Find which blocks of K add up to which block among the unknowns."""
        rows = np.repeat(self.node_of, np.diff(stiffness.indptr)).astype(np.int64)
        keys = rows * self.num_nodes + self.node_of[stiffness.indices]
        unique, place = np.unique(keys, return_inverse=True)
        shape = (len(unique), len(keys))
        self._blocks_of = sp.csr_array(
            (np.ones(len(keys)), (place, np.arange(len(keys)))), shape=shape
        )
        counts = np.bincount(unique // self.num_nodes, minlength=self.num_nodes)
        indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self._structure = len(unique), (unique % self.num_nodes).astype(np.int32), indptr

    def whole(self, stiffness: BlockMatrix) -> sp.csr_array:
        """See `NodalUnknowns`: the rows and columns of G are full."""
        fields = self.fields(np.arange(self.dim**2))
        forces = stiffness.to_scipy() @ fields
        columns = self.sum_on_nodes(forces)
        rows, width = columns.shape
        indices = np.tile(np.arange(width), rows)
        parts = columns.ravel(), indices, np.arange(rows + 1) * width
        border = sp.csr_array(parts, shape=(rows, width))
        full = (np.repeat(np.arange(width), width), np.tile(np.arange(width), width))
        corner = sp.coo_array(((fields.T @ forces).ravel(), full), shape=(width, width))
        matrix = sp.block_array(
            [[self.condense(stiffness).to_scipy(), border], [border.T, corner]], format="csr"
        )
        matrix.sort_indices()
        return matrix

    def fields(self, components: np.ndarray) -> np.ndarray:
        """Displacements of the nodes of V under unit components of G.

        Args:
            components: which of the dim^2 entries of G, column by column, shape (m,).

        Returns:
            Shape (num_dofs of V, m), m.
        """
        out = np.zeros((*self.position.shape, len(components)))
        for column, component in enumerate(components):
            out[:, component % self.dim, column] = self.position[:, component // self.dim]
        return out.reshape(-1, len(components))

    def sum_on_nodes(self, columns: np.ndarray) -> np.ndarray:
        """The nodes' part of N^T c for columns c, shape (num_nodes * dim, m)."""
        if not self.tied:
            return columns
        rows = columns.reshape(len(self.node_of), -1)
        return (self._sum @ rows).reshape(-1, columns.shape[1])

    def by_cell(self, unknowns: np.ndarray) -> dict:
        """See `NodalUnknowns`; the macroscopic ones besides."""
        return super().by_cell(unknowns) | {"macroscopic": unknowns[self.macroscopic]}

    def from_cells(self, saved: Mapping) -> np.ndarray:
        """See `NodalUnknowns`."""
        unknowns = super().from_cells(saved)
        unknowns[self.macroscopic] = saved["macroscopic"]
        return unknowns
