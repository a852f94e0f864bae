# SPDX-License-Identifier: LGPL-3.0-or-later
"""The matrix of bulk and points of all ranks, each with the rows of its own bodies.

A rank adds up what its bodies and its points give, as on one rank; its points reach ghosts, too.
Rows of ghosts then go to their owners, which add them in the order of the ranks. So do the rows of
unknowns that all ranks have, the gradient of a periodic cell, to the first rank: each rank gives
what its bodies add to them, and right-hand sides are whole on every rank.

MUMPS factors a large matrix over all ranks; a small one the first rank factors (`direct_on_first`).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.coupled_system import CoupledSystem
from xper_fx.bulk.sparse_direct import Direct, SparseDirect
from xper_fx.nscd.interactions import Interactions
from xper_fx.parallel.direct_on_first import DirectOnFirst

# Unknowns up to which the first rank factors the whole.
_ON_FIRST = 6_000


class SharedCoupledSystem(CoupledSystem):
    """A `CoupledSystem` of bodies that ranks divide; all ranks do everything together.

    Args:
        bulk: A of this rank's bodies.
        prescribed: shape (num_dofs,), bool, of this rank's dofs.
        dofs_of_slots: as of `CoupledSystem`, -1 for ghosts, too.
        interactions: this rank's points, with a halo.
        gradient: as of `CoupledSystem`.
        num_common: how many of the last dofs all ranks have (`Bulk.num_common`).
    """

    def __init__(
        self,
        bulk: sp.csr_array,
        prescribed: np.ndarray,
        dofs_of_slots: np.ndarray,
        interactions: Interactions,
        gradient: np.ndarray,
        num_common: int,
    ):
        halo, own, dim = interactions.halo, bulk.shape[0], interactions.dim
        self._halo, self._ranks, self._num_slot_dofs = halo, halo.ranks, len(dofs_of_slots)
        first, last = interactions.own_inverse.num_nodes * dim, halo.num_slots * dim
        self._of_slots, self._ghosts = dofs_of_slots[:first], slice(first, last)
        dofs_of_slots = dofs_of_slots.copy()
        dofs_of_slots[self._ghosts] = own + np.arange(last - first)
        held = self._with_ghosts(prescribed.astype(float)) > 0.0
        super().__init__(bulk, held, dofs_of_slots, interactions, gradient)

        self._common = slice(own - num_common, own)
        have = own if self._ranks.rank == 0 else own - num_common
        self._have = have
        firsts = np.array(self._ranks.comm.allgather(self._ranks.before(have)))
        mine = firsts[self._ranks.rank]
        numbers = mine + np.arange(own, dtype=float)
        numbers[self._common] = self._of_first(numbers[self._common])
        number = self._with_ghosts(numbers).astype(np.int64)
        rows, columns = number[self._rows], number[self._columns]
        owner = np.searchsorted(firsts, rows, side="right") - 1
        given = self._rows >= have
        given[self._left_out] = False
        self._given = [np.flatnonzero(given & (owner == r)) for r in range(self._ranks.size)]
        self._here = np.flatnonzero(self._rows < have)
        got = self._ranks.comm.alltoall([(rows[g], columns[g]) for g in self._given])
        rows, columns = (
            np.concatenate(parts)
            for parts in zip((rows[self._here], columns[self._here]), *got, strict=True)
        )
        self._whole_size = size = int(self._ranks.sum(have))
        unique, self._place = np.unique((rows - mine) * size + columns, return_inverse=True)
        rows, columns = np.divmod(unique, size)
        self._pattern = np.searchsorted(rows, np.arange(have + 1)), columns

    def _of_first(self, common: np.ndarray) -> np.ndarray:
        """The first rank's values at the unknowns that all ranks have."""
        return self._ranks.comm.bcast(common) if len(common) else common

    def _with_ghosts(self, values: np.ndarray) -> np.ndarray:
        """Values at this rank's dofs, shape (num_dofs,), and at ghosts behind them."""
        slots = np.zeros(self._num_slot_dofs)
        slots[: len(self._of_slots)] = values[self._of_slots]
        self._halo.everywhere.forward(slots)
        return np.concatenate([values, slots[self._ghosts]])

    def _on_all(self, *conditions: bool) -> list[bool]:
        return [not there for there in self._ranks.max(~np.array(conditions))]

    def _direct(self, symmetric: bool) -> Direct:
        kind = DirectOnFirst if self._whole_size <= _ON_FIRST else SparseDirect
        return kind(*self._pattern, symmetric, self._ranks)

    def _summed(self, data: np.ndarray) -> np.ndarray:
        got = self._ranks.comm.alltoall([data[g] for g in self._given])
        return np.bincount(
            self._place, np.concatenate([data[self._here], *got]), len(self._pattern[1])
        )

    def _solved(self, right: np.ndarray) -> np.ndarray:
        x = np.empty(self._own)
        x[: self._have] = self._used.solve(right[: self._have])
        x[self._common] = self._of_first(x[self._common])
        return x

    def _times(self, x: np.ndarray) -> np.ndarray | float:
        if not self._ranks.max(np.any(x)):
            return 0.0
        whole = self._with_ghosts(x)
        product = np.bincount(self._rows, self._data * whole[self._columns], self._size)
        slots = np.zeros(self._num_slot_dofs)
        slots[self._ghosts] = product[self._own :]
        self._halo.everywhere.add_back(slots)
        product = product[: self._own].astype(float, copy=False)  # of no rows: whole numbers
        product[self._of_slots] += slots[: len(self._of_slots)]
        if self._common.start < self._own:
            product[self._common] = self._ranks.sum(product[self._common])
        return product
