# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which nodes each body owns, and which of them interact."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from xper_fx.bulk.sparse_blocks import BlockMatrix


@dataclass(frozen=True)
class BodyLayout:
    """Nodes body by body."""

    nodes: np.ndarray  #: shape (num_nodes,), nodes (DOLFINx numbering) in body order
    offsets: np.ndarray  #: shape (num_bodies + 1,), first entry of each body in `nodes`
    dim: int  #: dofs a node
    prescribed: np.ndarray  #: shape (num_nodes * dim,), bool, dofs whose motion is given

    @property
    def num_bodies(self) -> int:
        """Number of bodies."""
        return len(self.offsets) - 1

    @property
    def uniform(self) -> bool:
        """Whether there are bodies, of the same number of nodes, few enough to invert at once."""
        sizes = np.unique(np.diff(self.offsets))
        return len(sizes) == 1 and int(sizes[0]) * self.dim <= 96

    @cached_property
    def prescribed_dofs(self) -> np.ndarray:
        """Numbers of the prescribed dofs."""
        return np.flatnonzero(self.prescribed)

    def body_of_node(self) -> np.ndarray:
        """Body of each node, shape (num_nodes,)."""
        out = np.empty(len(self.nodes), np.int64)
        out[self.nodes] = np.repeat(np.arange(self.num_bodies), np.diff(self.offsets))
        return out

    def dofs(self, nodes: np.ndarray) -> np.ndarray:
        """Dofs of nodes, flat, node after node."""
        return (np.asarray(nodes)[:, None] * self.dim + np.arange(self.dim)).ravel()

    def place_in_body(self) -> np.ndarray:
        """Of each node, its place among the nodes of its body, shape (num_nodes,), int32."""
        out = np.empty(len(self.nodes), np.int32)
        first = np.repeat(self.offsets[:-1], np.diff(self.offsets))
        out[self.nodes] = np.arange(len(self.nodes)) - first
        return out

    def dense_blocks(
        self, matrix: BlockMatrix, bodies: np.ndarray, place: np.ndarray
    ) -> np.ndarray:
        """Blocks of bodies of one size in a matrix that couples nothing across bodies.

        Args:
            matrix: in blocks of dim x dim.
            bodies: which bodies.
            place: what `place_in_body` gives.

        Returns:
            Shape (len(bodies), n, n), n dofs a body in the order of `nodes`.
        """
        n = len(self.nodes) // self.num_bodies
        rows = self.nodes.reshape(-1, n)[bodies].ravel()
        starts = matrix.indptr[rows]
        counts = matrix.indptr[rows + 1] - starts
        row = np.repeat(np.arange(len(rows)), counts)
        entries = np.arange(len(row)) + (starts - np.cumsum(counts) + counts)[row]
        body, at = np.divmod(row, n)
        blocks = np.zeros((len(bodies), n, self.dim, n, self.dim))
        blocks[body, at, :, place[matrix.indices[entries]], :] = matrix.data[entries]
        return blocks.reshape(len(bodies), n * self.dim, n * self.dim)
