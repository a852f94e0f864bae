# SPDX-License-Identifier: LGPL-3.0-or-later
"""The matrix of bulk and points of all ranks, each with the rows of its own bodies.

A rank adds up what its bodies and its points give, as on one rank; its points reach ghosts, too.
Rows of ghosts then go to their owners, which add them in the order of the ranks.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.coupled_system import CoupledSystem
from xper_fx.bulk.sparse_direct import SparseDirect
from xper_fx.nscd.interactions import Interactions


class SharedCoupledSystem(CoupledSystem):
    """A `CoupledSystem` of bodies that ranks divide; all ranks do everything together.

    Args:
        bulk: A of this rank's bodies.
        prescribed: shape (num_dofs,), bool, of this rank's dofs.
        dofs_of_slots: as of `CoupledSystem`, -1 for ghosts, too.
        interactions: this rank's points, with a halo.
    """

    def __init__(
        self,
        bulk: sp.csr_array,
        prescribed: np.ndarray,
        dofs_of_slots: np.ndarray,
        interactions: Interactions,
    ):
        halo, own, dim = interactions.halo, bulk.shape[0], interactions.dim
        self._halo, self._ranks, self._num_slot_dofs = halo, halo.ranks, len(dofs_of_slots)
        first, last = interactions.own_inverse.num_nodes * dim, halo.num_slots * dim
        self._of_slots, self._ghosts = dofs_of_slots[:first], slice(first, last)
        dofs_of_slots = dofs_of_slots.copy()
        dofs_of_slots[self._ghosts] = own + np.arange(last - first)
        held = self._with_ghosts(prescribed.astype(float)) > 0.0
        super().__init__(bulk, held, dofs_of_slots, interactions)

        firsts = np.array(self._ranks.comm.allgather(self._ranks.before(own)))
        mine = firsts[self._ranks.rank]
        number = self._with_ghosts(mine + np.arange(own, dtype=float)).astype(np.int64)
        rows, columns = number[self._rows], number[self._columns]
        owner = np.searchsorted(firsts, rows, side="right") - 1
        given = (self._rows >= own) & self._kept
        self._given = [np.flatnonzero(given & (owner == r)) for r in range(self._ranks.size)]
        self._here = np.flatnonzero(self._rows < own)
        got = self._ranks.comm.alltoall([(rows[g], columns[g]) for g in self._given])
        rows, columns = (
            np.concatenate(parts)
            for parts in zip((rows[self._here], columns[self._here]), *got, strict=True)
        )
        size = int(self._ranks.sum(own))
        unique, self._place = np.unique((rows - mine) * size + columns, return_inverse=True)
        rows, columns = np.divmod(unique, size)
        self._pattern = np.searchsorted(rows, np.arange(own + 1)), columns

    def _with_ghosts(self, values: np.ndarray) -> np.ndarray:
        """Values at this rank's dofs, shape (num_dofs,), and at ghosts behind them."""
        slots = np.zeros(self._num_slot_dofs)
        slots[: len(self._of_slots)] = values[self._of_slots]
        self._halo.everywhere.forward(slots)
        return np.concatenate([values, slots[self._ghosts]])

    def _on_all(self, condition: bool) -> bool:
        return self._ranks.all(condition)

    def _direct(self, symmetric: bool) -> SparseDirect:
        return SparseDirect(*self._pattern, symmetric, self._ranks)

    def _summed(self, data: np.ndarray) -> np.ndarray:
        got = self._ranks.comm.alltoall([data[g] for g in self._given])
        return np.bincount(
            self._place, np.concatenate([data[self._here], *got]), len(self._pattern[1])
        )

    def _times(self, x: np.ndarray) -> np.ndarray | float:
        if not self._ranks.max(np.any(x)):
            return 0.0
        whole = self._with_ghosts(x)
        product = np.bincount(self._rows, self._data * whole[self._columns], self._size)
        slots = np.zeros(self._num_slot_dofs)
        slots[self._ghosts] = product[self._own :]
        self._halo.everywhere.add_back(slots)
        product = product[: self._own]
        product[self._of_slots] += slots[: len(self._of_slots)]
        return product
