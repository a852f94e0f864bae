# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of fields in the order of the files of ranks, whoever has them now."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from xper_fx.bodies.spread import send
from xper_fx.support.ranks import Ranks


class FiledRows:
    """Brings rows to the rank whose file holds them; all ranks make and call it together.

    DOLFINx may partition a mesh otherwise each time it is made: a run that goes on has other
    bodies on a rank than those of which the rank has begun to write.

    Args:
        ranks: the ranks.
        own: shape (n,), numbers of the rows that this rank has, in no other rank's.
        filed: shape (m,), numbers of the rows in this rank's file.
    """

    def __init__(
        self, ranks: Ranks, own: npt.NDArray[np.int64], filed: npt.NDArray[np.int64]
    ) -> None:
        self._ranks, self._num_rows = ranks, len(filed)
        self.unchanged = ranks.all(np.array_equal(own, filed))
        if self.unchanged:
            return
        # the rank that keeps a number hears who has its row and whose file holds it
        had = send(ranks, own % ranks.size, own, np.arange(len(own)))
        held = send(ranks, filed % ranks.size, filed, np.arange(len(filed)))
        (number, row), owner = _joined(had)
        (wanted, place), file = _joined(held)
        order = np.argsort(number)
        found = order[np.searchsorted(number, wanted, sorter=order)]
        told = send(ranks, owner[found], row[found], file, place)
        (self._row, self._to, self._place), _ = _joined(told)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Rows of this rank's file, shape (m, ...), from the rows that ranks have, (n, ...)."""
        if self.unchanged:
            return values
        heard = send(self._ranks, self._to, values[self._row], self._place)
        (rows, place), _ = _joined(heard)
        filed = np.empty((self._num_rows, *values.shape[1:]), values.dtype)
        filed[place] = rows
        return filed


def _joined(heard: list[tuple]) -> tuple[list[np.ndarray], np.ndarray]:
    """Columns of what all ranks have sent, and the rank that each row came from."""
    columns = [np.concatenate(parts) for parts in zip(*heard, strict=True)]
    return columns, np.repeat(np.arange(len(heard)), [len(first) for first, *_ in heard])
