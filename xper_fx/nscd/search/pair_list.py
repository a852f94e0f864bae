# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lists of pairs (row, facet), row by row, into which pairs can be put later."""

from __future__ import annotations

import numpy as np


class PairList:
    """Pairs of points and facets, sorted.

    Attributes:
        rows: points that have facets, shape (r,), ascending.
        start: first place of each in `listed`, shape (r + 1,).
        listed: facets, ascending for each point.

    Args:
        num_facets: how many facets there are.
    """

    def __init__(self, num_facets: int):
        self._num_facets = num_facets
        self._keys = np.empty(0, np.int64)
        self._sort_out()

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self._keys)

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(a.nbytes for a in (self._keys, self.rows, self.start, self.listed))

    def replace(self, pairs: np.ndarray) -> None:
        """Take these pairs instead, shape (n, 2), sorted lexicographically, none twice."""
        self._keys = self._key(pairs)
        self._sort_out()

    def insert(self, pairs: np.ndarray) -> None:
        """Take these pairs as well, shape (n, 2), in any order; those that are there stay once."""
        keys = np.unique(self._key(pairs))
        place = np.searchsorted(self._keys, keys)
        there = place < len(self._keys)
        there[there] = self._keys[place[there]] == keys[there]
        self._keys = np.insert(self._keys, place[~there], keys[~there])
        self._sort_out()

    def _key(self, pairs: np.ndarray) -> np.ndarray:
        return pairs[:, 0].astype(np.int64) * self._num_facets + pairs[:, 1]

    def _sort_out(self) -> None:
        row, facet = np.divmod(self._keys, max(self._num_facets, 1))
        self.listed = facet.astype(np.int32)
        begins = np.ones(len(row), bool)
        begins[1:] = row[1:] != row[:-1]
        first = np.flatnonzero(begins)
        self.rows = row[first].astype(np.int32)
        self.start = np.append(first, len(row)).astype(np.int32)
