# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sparse linear systems with the block pattern of W, factorised again and again by SuperLU."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from xper_fx.nscd.friction.blocks import BlockProblem

# Pivots off the diagonal only where it is this much smaller; the order has little fill as it is.
_OPTIONS = {
    "permc_spec": "NATURAL",
    "diag_pivot_thresh": 1e-3,
    "relax": 1,
    "options": {"SymmetricMode": True},
}


class Elimination:
    """A minimum-degree order of a problem's contacts, found when first asked for."""

    def __init__(self, problem: BlockProblem):
        self._problem = problem

    @cached_property
    def _factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Rank of each contact, and blocks in the column of L of the contact of each rank."""
        problem, n = self._problem, len(self._problem.mu)
        rows = np.repeat(np.arange(n), np.diff(problem.offsets))
        values = np.where(rows == problem.columns, n + 1.0, 1.0)
        graph = sp.csc_matrix((values, problem.columns, problem.offsets), (n, n))
        factors = splu(graph, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        return factors.perm_c, np.diff(factors.L.indptr)

    def order(self, contacts: np.ndarray) -> np.ndarray:
        """The contacts, whole components of the problem, in the order."""
        rank, _ = self._factors
        return contacts[np.argsort(rank[contacts])]

    def operations(self, contacts: np.ndarray) -> float:
        """Floating-point operations of a factorisation of their part of W, about."""
        rank, filled = self._factors
        return 2.0 * self._problem.dim**3 * float(np.sum(filled[rank[contacts]].astype(float) ** 2))


class SparseSystem:
    """A matrix with the pattern of a problem's W, its entries to be set in `data`.

    Attributes:
        data: shape (num_blocks dim^2,), entries by scalar rows: entry (i, j) of block k of contact
            a is number `dim^2 offsets[a] + i dim row_length[a] + (k - offsets[a]) dim + j`.
    """

    def __init__(self, problem: BlockProblem):
        dim, n = problem.dim, len(problem.mu)
        sizes = np.diff(problem.offsets)
        columns = (problem.columns[:, None] * dim + np.arange(dim)).astype(np.int32)
        lengths = np.repeat(sizes, dim)  # blocks in each scalar row
        starts = np.repeat(problem.offsets[:-1], dim)
        ends = np.cumsum(lengths)
        indices = columns[np.arange(ends[-1]) + np.repeat(starts - ends + lengths, lengths)].ravel()
        indptr = np.concatenate([[0], dim * ends]).astype(np.int32)
        # SuperLU takes columns: what it sees is the transpose.
        self._transpose = sp.csc_matrix((np.zeros(len(indices)), indices, indptr), (n * dim,) * 2)
        self._transpose.has_sorted_indices = True
        self.data = self._transpose.data
        self._factors = None
        self.factorisations = 0

    def factorise(self) -> bool:
        """Factorise; False if the matrix is singular or not finite."""
        self.factorisations += 1
        if not np.isfinite(self.data).all():
            return False
        try:
            self._factors = splu(self._transpose, **_OPTIONS)
        except RuntimeError:  # exactly singular
            return False
        return True

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Solution for a right-hand side of shape (n, dim), in the same shape."""
        return self._factors.solve(rhs.ravel(), trans="T").reshape(rhs.shape)
