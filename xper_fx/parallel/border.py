# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions of the clusters of facing nodes that ranks share, each as one."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy.sparse import coo_array

from xper_fx.bulk.sparse_direct import SingularMatrixError, SparseDirect
from xper_fx.support.ranks import Ranks

# Unknowns up to which every rank has their inverse, as of more without MUMPS.
_EVERYWHERE = 1500


class Border:
    """Motions of the clusters that ranks share (`nscd/solvers/clusters_as_one.py`).

    Up to some number of them each rank has the rows of S^-1 that it asks for; MUMPS factors a
    larger S over all ranks, and adds what comes first.

    Args:
        ranks: all.
        clusters: shape (n,), ascending, the clusters that this rank knows, among those of all.
        total: how many there are.
        dim: directions of each.

    Attributes:
        count: n.
    """

    def __init__(self, ranks: Ranks, clusters: np.ndarray, total: int, dim: int):
        self.count = len(clusters)
        self._ranks, self._size = ranks, total * dim
        self._all = (clusters[:, None] * dim + np.arange(dim)).ravel()

    def factor(self, dofs: np.ndarray, share: np.ndarray | None) -> bool:
        """As `EliminatedBorder.factor` of `clusters_as_one.py`."""
        if not self._ranks.all(share is not None):
            return False
        self._dofs = self._all[dofs]
        if self._size <= _EVERYWHERE or not PETSc.Sys.hasExternalPackage("mumps"):
            return self._invert(share)
        return self._factor(share)

    def _invert(self, share: np.ndarray) -> bool:
        parts = self._ranks.comm.allgather((self._dofs, share))
        matrix = np.zeros((self._size, self._size))
        for dofs, values in parts:
            matrix[np.ix_(dofs, dofs)] += values
        unused = np.flatnonzero(matrix.diagonal() == 0.0)
        matrix[unused, unused] = 1.0
        try:
            self._inverse = np.linalg.inv(matrix)[self._dofs]
        except np.linalg.LinAlgError:
            return False
        self._direct = None
        return True

    def _factor(self, share: np.ndarray) -> bool:
        """Give rows to ranks in turn, and factor."""
        ranks, size = self._ranks, self._size
        ends = size * np.arange(ranks.size + 1) // ranks.size
        first, last = self._rows = ends[ranks.rank], ends[ranks.rank + 1]
        to = np.searchsorted(ends, self._dofs, side="right") - 1
        told = [(self._dofs[to == r], self._dofs, share[to == r]) for r in range(ranks.size)]
        ones = np.arange(last - first)
        rows, columns, values = [ones], [first + ones], [np.zeros(len(ones))]
        for r, c, v in ranks.comm.alltoall(told):
            rows.append(np.repeat(r - first, len(c)))
            columns.append(np.tile(c, len(r)))
            values.append(v.ravel())
        entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
        matrix = coo_array(entries, shape=(last - first, size)).tocsr()
        matrix.sort_indices()
        unused = matrix[ones, first + ones] == 0.0
        matrix[ones[unused], first + ones[unused]] = 1.0
        self._direct = SparseDirect(matrix.indptr, matrix.indices, True, ranks)
        try:
            self._direct.factorise(matrix.data)
        except SingularMatrixError:
            return False
        return True

    def solve(self, force: np.ndarray) -> np.ndarray:
        """As `EliminatedBorder.solve` of `clusters_as_one.py`."""
        whole = np.zeros(self._size)
        whole[self._dofs] = force
        whole = self._ranks.sum(whole)
        if self._direct is None:
            return self._inverse @ whole
        own = whole[slice(*self._rows)]
        try:
            own = self._direct.solve(own)
        except SingularMatrixError:  # or forces that are no numbers: the step is given up
            own = np.full(len(own), np.nan)
        return np.concatenate(self._ranks.comm.allgather(own))[self._dofs]
