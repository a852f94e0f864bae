# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows that ranks share, written to a file and read from it block by block.

No rank holds all of them: the first one writes a block that all have put together, and who wants
some of the rows looks through the blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from xper_fx.support.ranks import Ranks
from xper_fx.support.saved_rows import Rows

# Bytes of a block.
_BLOCK = 1 << 22


def in_blocks(rows: Rows, ranks: Ranks) -> Iterator[tuple[int, int, Callable[[], np.ndarray]]]:
    """The rows of all ranks by ascending number, on the first rank; the others run through it.

    Where a block cannot be made the first rank is to run on to the end: the others wait for it.

    Args:
        rows: of this rank, one number a row where there are several ranks; every number from zero
            on is on some rank.
        ranks: the ranks.

    Yields:
        Number of the first row of a block, number of all rows, and what makes the block.
    """
    if ranks.alone:
        yield 0, len(rows.values), rows.in_order
        return
    order = np.argsort(rows.number, kind="stable")
    number = rows.number[order]
    count = int(ranks.max(number[-1] + 1 if len(number) else 0))
    a_block = _rows_of_a_block(rows.values)
    for first in range(0, max(count, 1), a_block):
        low, high = np.searchsorted(number, (first, first + a_block))
        given = (number[low:high] - first, rows.values[order[low:high]])
        heard = ranks.comm.gather(given)
        if heard is not None:
            yield first, count, partial(_joined, min(a_block, count - first), heard)


def _joined(size: int, parts: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """So many rows from places and rows of each rank."""
    block = np.empty((size, *parts[0][1].shape[1:]), parts[0][1].dtype)
    for place, values in parts:
        block[place] = values
    return block


class StoredRows:
    """Rows in a file, of which some are read: `stored[number]`, `stored[number, :3]`.

    Args:
        path: the HDF5 file.
        name: of the dataset.
    """

    def __init__(self, path: Path, name: str):
        self._path, self._name = path, name

    def __getitem__(self, key: np.ndarray | tuple) -> np.ndarray:
        number, *rest = key if isinstance(key, tuple) else (key,)
        order = np.argsort(number, kind="stable")
        wanted = number[order]
        with h5py.File(self._path, "r", locking=False) as h5:
            data = h5[self._name]
            values = np.empty((len(number), *data.shape[1:]), data.dtype)
            for first, last in _ranges(data):
                low, high = np.searchsorted(wanted, (first, last))
                if low < high:  # of a block no more is read than from the first to the last
                    least, most = wanted[low], wanted[high - 1]
                    values[order[low:high]] = data[least : most + 1][wanted[low:high] - least]
        return values[(slice(None), *rest)]

    def blocks(self) -> Iterator[tuple[int, np.ndarray]]:
        """Number of the first row of each block, and the block; an empty one where are no rows."""
        with h5py.File(self._path, "r", locking=False) as h5:
            data = h5[self._name]
            for first, last in _ranges(data):
                yield first, data[first:last]


def _ranges(data: h5py.Dataset) -> Iterator[tuple[int, int]]:
    """First row of each block, and the one after the last; an empty one where are no rows."""
    a_block = _rows_of_a_block(np.empty((0, *data.shape[1:]), data.dtype))
    for first in range(0, max(len(data), 1), a_block):
        yield first, first + a_block


def _rows_of_a_block(values: np.ndarray) -> int:
    row = values.itemsize * int(np.prod(values.shape[1:]))
    return max(1, _BLOCK // max(row, 1))
