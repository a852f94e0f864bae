# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sparse direct solution of small systems of all ranks, by the first of them.

Factors that are spread over ranks are messages, one after the other along the elimination tree:
hundreds of microseconds where ranks have a core each, and a slice of time for each message where
another process has the core. The first rank factors a small matrix in less, and tells the solution.
Its digits hang on no order of arrival, and what it cannot factorise all ranks hear of.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.sparse_direct import SingularMatrixError, SparseDirect
from xper_fx.support.ranks import Ranks


class DirectOnFirst:
    """As `SparseDirect`, which the first rank has of all rows.

    Args:
        indptr, indices: of this rank's rows, as of `SparseDirect`.
        symmetric: whether the values will be symmetric.
        ranks: that have the rows, in their order; they do everything together.
    """

    def __init__(self, indptr: np.ndarray, indices: np.ndarray, symmetric: bool, ranks: Ranks):
        self._ranks = ranks
        self._rows = np.array(ranks.comm.allgather(len(indptr) - 1))
        self._entries = np.array(ranks.comm.allgather(len(indices)))
        parts = zip(*ranks.comm.allgather((np.diff(indptr), indices)), strict=True)
        lengths, columns = map(np.concatenate, parts)
        starts = np.concatenate([[0], np.cumsum(lengths)])
        self._whole: SparseDirect | None = None  # on other ranks
        ranks.at_root(lambda: self._take(SparseDirect(starts, columns, symmetric)))

    def _take(self, whole: SparseDirect) -> None:
        self._whole = whole

    def _gathered(self, own: np.ndarray, counts: np.ndarray) -> np.ndarray:
        """On the first rank what all ranks have, one after the other."""
        whole = np.empty(counts.sum())
        self._ranks.comm.Gatherv(np.ascontiguousarray(own, np.float64), [whole, counts])
        return whole

    def factorise(self, data: np.ndarray) -> None:
        """As of `SparseDirect`."""
        whole = self._gathered(data, self._entries)
        self._ranks.at_root(lambda: self._whole.factorise(whole))

    def negative_pivots(self) -> int | None:
        """As of `SparseDirect`."""
        own = None if self._whole is None else self._whole.negative_pivots()
        return self._ranks.comm.bcast(own)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """As of `SparseDirect`."""
        whole = self._gathered(right, self._rows)
        if self._whole is not None:
            try:
                whole = self._whole.solve(whole)
            except SingularMatrixError:
                whole[:] = np.nan
        self._ranks.comm.Bcast(whole)
        if not np.all(np.isfinite(whole)):
            raise SingularMatrixError("The matrix is singular.")
        first = int(self._rows[: self._ranks.rank].sum())
        return whole[first : first + len(right)].copy()
