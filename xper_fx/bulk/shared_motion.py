# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Unknowns that move as one: nodes of cells that meet at a whole vertex (`nscd/splitting`).

With u = N x, x the motions that unknowns share and N a matrix of zeros and ones, the equations
A u = f of free cells become N^T A N x = N^T f: those of ordinary finite elements where facets hold.
What the facets transmit is then what is missing at each node, f - A u, whose sum over the nodes
that share a motion is zero, or the reaction of what drives them.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.coupled_system import CoupledSystem
from xper_fx.nscd.interactions import Interactions


class SharedMotion:
    """Which unknowns have one motion: direction by direction those of the nodes of a vertex.

    Args:
        prescribed: shape (num_dofs,), bool, dofs whose motion is given.
        node: shape (n,), nodes that share their motions with others.
        vertex: shape (n,), where each of them is.
        dim: dofs a node.

    Attributes:
        root: shape (num_dofs,), for each dof the one that stands for all that move with it; a
            prescribed one where there is one.
        prescribed: shape (num_motions,), bool, motions that are given.
    """

    def __init__(self, prescribed: np.ndarray, node: np.ndarray, vertex: np.ndarray, dim: int):
        self._given = prescribed
        self.root = np.arange(len(prescribed))
        _, place = np.unique(vertex, return_inverse=True)
        for d in range(dim):
            dof = node * dim + d
            order = np.lexsort((dof, ~prescribed[dof], place))
            first = np.flatnonzero(np.diff(place[order], prepend=-1))
            self.root[dof] = dof[order[first]][place]
        self._roots = np.unique(self.root)
        self._place = np.searchsorted(self._roots, self.root)
        self.prescribed = prescribed[self._roots]

    def together(self, values: np.ndarray) -> np.ndarray:
        """Values of all dofs, (num_dofs,), with those of their roots where nothing is given."""
        return np.where(self._given, values, values[self.root])

    def sums(self, forces: np.ndarray) -> np.ndarray:
        """Forces on each motion at its root, zero elsewhere, shape (num_dofs,)."""
        return np.bincount(self.root, forces, len(forces))

    def transmitted(self, missing: np.ndarray) -> np.ndarray:
        """What cells that move as one give each other.

        Args:
            missing: shape (num_dofs,), impulses that all else gives (N s); of no account where a
                motion is not shared.

        Returns:
            Shape (num_dofs,), N s: the opposite; driven dofs share what is left of the others.
        """
        given, size = self._given, len(missing)
        shared = np.bincount(self.root, minlength=size)[self.root] > 1
        out = np.where(shared & ~given, -missing, 0.0)
        rest = np.bincount(self.root, out, size)
        drives = np.bincount(self.root, given, size)
        mine = shared & given
        out[mine] = -(rest / np.maximum(drives, 1.0))[self.root[mine]]
        return out

    def apart(self, wanted: np.ndarray) -> np.ndarray:
        """Prescribed dofs that are to move otherwise than their roots.

        Args:
            wanted: shape (num_dofs,), velocities, of which those prescribed count (m/s).
        """
        dofs = np.flatnonzero(self._given)
        return dofs[wanted[dofs] != wanted[self.root[dofs]]]

    def at(self, dofs: np.ndarray) -> np.ndarray:
        """Numbers of the motions of some dofs; -1 stays -1."""
        return np.where(dofs >= 0, self._place[dofs], -1)

    def of_motions(self, matrix: sp.csr_array) -> sp.csr_array:
        """N^T A N; its pattern hangs on that of A alone."""
        rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        size = len(self._roots)
        entries = matrix.data, (self._place[rows], self._place[matrix.indices])
        return sp.coo_array(entries, (size, size)).tocsr()

    def solve(self, system: CoupledSystem, right: np.ndarray, given: np.ndarray) -> np.ndarray:
        """N x of the system of the motions, as `CoupledSystem.refined` of all dofs."""
        right = np.bincount(self._place, right, len(self._roots))
        return system.refined(right, given[self._roots])[self._place]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self.root.nbytes + self._roots.nbytes + self._place.nbytes


def motion_of_whole_vertices(
    interactions: Interactions, nodes: np.ndarray, prescribed: np.ndarray
) -> SharedMotion:
    """What the cells at the vertices share that are whole.

    Args:
        interactions: points whose vertices split (`Interactions.fused`).
        nodes: the node that each slot of the points is, shape (n,).
        prescribed: shape (num_dofs,), bool.
    """
    fused = interactions.fused
    graphs = fused.graphs
    whole = np.repeat(fused.whole, np.diff(graphs.corner_offsets))
    vertex = np.repeat(np.arange(graphs.num_vertices), np.diff(graphs.corner_offsets))[whole]
    return SharedMotion(prescribed, nodes[graphs.corner[whole]], vertex, interactions.dim)
