# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which nodes each body owns, and which of them interact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class BodyLayout:
    """Nodes body by body.

    Attributes:
        nodes: shape (num_nodes,), nodes (DOLFINx numbering) in body order.
        offsets: shape (num_bodies + 1,), first entry of each body in `nodes`.
        dim: dofs a node.
        prescribed: shape (num_nodes * dim,), bool, dofs whose motion is given.
    """

    nodes: np.ndarray
    offsets: np.ndarray
    dim: int
    prescribed: np.ndarray

    @property
    def num_bodies(self) -> int:
        """Number of bodies."""
        return len(self.offsets) - 1

    @property
    def uniform(self) -> bool:
        """Whether all bodies have the same number of nodes, few enough to invert at once."""
        sizes = np.diff(self.offsets)
        return bool(np.all(sizes == sizes[0])) and int(sizes[0]) * self.dim <= 96

    def body_of_node(self) -> np.ndarray:
        """Body of each node, shape (num_nodes,)."""
        out = np.empty(len(self.nodes), np.int64)
        out[self.nodes] = np.repeat(np.arange(self.num_bodies), np.diff(self.offsets))
        return out

    def dofs(self, nodes: np.ndarray) -> np.ndarray:
        """Dofs of nodes, flat, node after node."""
        return (np.asarray(nodes)[:, None] * self.dim + np.arange(self.dim)).ravel()
