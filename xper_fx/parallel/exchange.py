# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values that ranks give each other, by DOLFINx index maps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from dolfinx import la

from xper_fx.support.compat import index_map
from xper_fx.support.ranks import Ranks


class Exchange:
    """Moves entries of velocity arrays between slots and their ghosts.

    Args:
        given: slots whose entries go to other ranks, by rank, in the order of their ghosts.
        ghosts: slots that take them, by the rank that they come from.
        dim: dofs a slot.
    """

    def __init__(
        self,
        ranks: Ranks,
        given: Mapping[int, np.ndarray],
        ghosts: Mapping[int, np.ndarray],
        dim: int,
    ):
        self._given = np.concatenate([np.zeros(0, np.int64), *given.values()])
        self._ghosts = np.concatenate([np.zeros(0, np.int64), *ghosts.values()])
        count, dims = len(self._given), np.arange(dim)
        first = ranks.comm.exscan(count) or 0
        starts = np.cumsum([first, *map(len, given.values())])
        told = ranks.comm.alltoall(
            [dict(zip(given, starts[:-1], strict=True)).get(r, 0) for r in range(ranks.size)]
        )
        numbers = [told[rank] + np.arange(len(slots)) for rank, slots in ghosts.items()]
        owners = [np.full(len(slots), rank, np.int32) for rank, slots in ghosts.items()]
        shared = index_map(
            ranks.comm,
            count,
            np.concatenate([np.zeros(0, np.int64), *numbers]),
            np.concatenate([np.zeros(0, np.int32), *owners]),
            [rank for rank, slots in given.items() if len(slots)],
        )
        self._vector = la.vector(shared, dim, dtype=np.float64)
        self._array = self._vector.array  # to make this view takes nearly as long as to exchange
        self._split = count * dim
        self._own = (self._given[:, None] * dim + dims).ravel()
        self._mirrored = (self._ghosts[:, None] * dim + dims).ravel()

    def forward(self, values: np.ndarray) -> None:
        """Ghosts take the values of their owners; `values` is flat, of all slots."""
        array = self._array
        array[: self._split] = values[self._own]
        self._vector.scatter_forward()
        values[self._mirrored] = array[self._split :]

    def back(self, values: np.ndarray) -> None:
        """Owners take the values of their ghosts, of which each has one."""
        array = self._array
        array[: self._split] = values[self._own]
        array[self._split :] = values[self._mirrored]
        self._vector.scatter_reverse(la.InsertMode.insert)
        values[self._own] = array[: self._split]

    def add_back(self, values: np.ndarray) -> None:
        """Owners add the values of their ghosts."""
        array = self._array
        array[: self._split] = 0.0
        array[self._split :] = values[self._mirrored]
        self._vector.scatter_reverse(la.InsertMode.add)
        np.add.at(values, self._own, array[: self._split])

    @property
    def nbytes(self) -> int:
        """Memory of the values exchanged and of where they are, in bytes."""
        arrays = (self._given, self._ghosts, self._own, self._mirrored, self._array)
        return sum(array.nbytes for array in arrays)

    @property
    def bytes_sent(self) -> int:
        """Bytes that this rank sends forward."""
        return 8 * self._split

    @property
    def bytes_returned(self) -> int:
        """Bytes that this rank sends back."""
        return 8 * len(self._mirrored)
