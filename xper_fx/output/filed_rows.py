# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of fields in the order of the files of ranks, whoever has them now."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from xper_fx.bodies.spread import send
from xper_fx.support.ranks import Ranks


class FiledRows:
    """Brings rows to the rank that writes the file which holds them; all ranks make and call it.

    DOLFINx may partition a mesh otherwise each time it is made: a run that goes on has other
    bodies on a rank than those of which the rank has begun to write.

    Args:
        ranks: the ranks.
        own: shape (n,), numbers of the rows that this rank has, in no other rank's.
        files: shape (m,) each, numbers of the rows in each file that this rank writes.
    """

    def __init__(
        self, ranks: Ranks, own: npt.NDArray[np.int64], files: list[npt.NDArray[np.int64]]
    ) -> None:
        self._ranks = ranks
        self._unchanged = ranks.all(len(files) == 1 and np.array_equal(own, files[0]))
        if self._unchanged:
            return
        held_here = np.concatenate([np.zeros(0, np.int64), *files])
        self._num_rows = len(held_here)
        self._starts = np.cumsum([0] + [len(file) for file in files])
        # the rank that keeps a number hears who has its row and who writes it
        had = send(ranks, own % ranks.size, own, np.arange(len(own)))
        held = send(ranks, held_here % ranks.size, held_here, np.arange(self._num_rows))
        (number, row), owner = _joined(had)
        (wanted, place), writer = _joined(held)
        order = np.argsort(number)
        found = order[np.searchsorted(number, wanted, sorter=order)]
        told = send(ranks, owner[found], row[found], writer, place)
        (self._row, self._to, self._place), _ = _joined(told)

    def __call__(self, values: np.ndarray) -> list[np.ndarray]:
        """Rows of each file that this rank writes, from those that it has, shape (n, ...)."""
        if self._unchanged:
            return [values]
        heard = send(self._ranks, self._to, values[self._row], self._place)
        (rows, place), _ = _joined(heard)
        filed = np.empty((self._num_rows, *values.shape[1:]), values.dtype)
        filed[place] = rows
        return [filed[first:last] for first, last in pairwise(self._starts)]


def _joined(heard: list[tuple]) -> tuple[list[np.ndarray], np.ndarray]:
    """Columns of what all ranks have sent, and the rank that each row came from."""
    columns = [np.concatenate(parts) for parts in zip(*heard, strict=True)]
    return columns, np.repeat(np.arange(len(heard)), [len(first) for first, *_ in heard])
