# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows that each have one owner among the ranks, and that every rank knows."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from xper_fx.support.ranks import Ranks


class RowsOfAll:
    """Puts together what ranks have; arrays are flat, over all rows, and what follows them.

    Args:
        rank_of_row: shape (num_rows,), the owner of each.
        dofs: entries of a row.
    """

    def __init__(self, ranks: Ranks, rank_of_row: np.ndarray, dofs: int):
        self._comm, self._dofs = ranks.comm, dofs
        self._others = np.flatnonzero(rank_of_row != ranks.rank)
        self._own = np.flatnonzero(rank_of_row == ranks.rank)
        self._by_rank = np.argsort(rank_of_row, kind="stable")
        self._counts = np.bincount(rank_of_row, minlength=ranks.size) * dofs

    def _rows(self, values: np.ndarray) -> np.ndarray:
        count = len(self._by_rank)
        return values[: count * self._dofs].reshape(count, self._dofs)

    @property
    def bytes_sent(self) -> int:
        """Bytes of this rank's values."""
        return 8 * self._dofs * len(self._own)

    def clear(self, values: np.ndarray) -> None:
        """Set other ranks' rows to zero."""
        self._rows(values)[self._others] = 0.0

    def forward(self, values: np.ndarray) -> None:
        """All take the values of the rows' owners."""
        rows = self._rows(values)
        gathered = np.empty_like(rows)
        self._comm.Allgatherv(rows[self._own], [gathered, self._counts])
        rows[self._by_rank] = gathered

    def add_back(self, values: np.ndarray) -> None:
        """All take the sum over the ranks."""
        rows = self._rows(values)
        total = np.empty_like(rows)
        # one rank adds up: sums made on each could differ by rounding
        self._comm.Reduce(rows, total, MPI.SUM)
        self._comm.Bcast(total)
        rows[:] = total
