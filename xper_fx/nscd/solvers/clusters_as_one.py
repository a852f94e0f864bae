# SPDX-License-Identifier: LGPL-3.0-or-later
"""Velocities that open no point: each cluster of facing nodes moves as one.

P^T w^-1 P, of which P gives all nodes of a cluster its velocity, is factored, A = L D L^T. Where
ranks divide the bodies each has a share of A, that of its bodies, of which it eliminates the
clusters i that it has alone; those at the border, b, which it shares with others, come last:

    A = [L_i 0; L_bi I] [D_i 0; 0 S] [L_i 0; L_bi I]^T.

The shares of S, L_b D_b L_b^T, are added up over all ranks (the Schur complement of substructuring:
Smith, Bjorstad and Gropp 1996, section 4.1). A solution is L_i^-1 on each rank, a sum of forces at
the border, S^-1, and L_i^-T on each rank: each entry of L is read twice, as without a border.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from xper_fx.cache import njit
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import LEAN_ENTRY

_KERNEL = njit(fastmath={"contract", "reassoc"}, nogil=True, **LEAN_ENTRY)


class EliminatedBorder(Protocol):
    """Clusters that ranks share; all ranks do everything together (`parallel/border.py`)."""

    @property
    def count(self) -> int:
        """How many of them this rank knows, the first of its clusters."""

    def factor(self, dofs: np.ndarray, share: np.ndarray | None) -> bool:
        """Factor the sum of all ranks' shares of S.

        Args:
            dofs: ascending, which degrees of freedom of the border, shape (n,).
            share: shape (n, n); None where this rank could not make its own.

        Returns:
            Whether it could be factored.
        """

    def solve(self, force: np.ndarray) -> np.ndarray:
        """Velocities at the rank's degrees of freedom from its shares of the forces there."""


class ClustersAsOne:
    """P^T w^-1 P, factored: P gives all nodes of a cluster its velocity.

    Args:
        cluster: shape (num_slots,), the cluster of each slot of `inverse`.
        held: shape (num_clusters, dim), directions that are left out: those that are prescribed,
            and clusters whose translation opens a point.
        inverse: where the blocks of w are.
        blocks: of w^-1, flat as those of w.
        border: of clusters that ranks share, the first ones; None on one rank.
    """

    def __init__(
        self,
        cluster: np.ndarray,
        held: np.ndarray,
        inverse: BodyInverse,
        blocks: np.ndarray,
        border: EliminatedBorder | None = None,
    ):
        self._border = border
        count = 0 if border is None else border.count
        at_border, inside = np.flatnonzero(~held[:count]), np.flatnonzero(~held[count:])
        size = self._inside = len(inside)
        number = np.full(held.shape, -1)
        number.ravel()[count * inverse.dim + inside] = np.arange(size)
        number.ravel()[at_border] = size + np.arange(len(at_border))
        number = number[cluster].ravel()
        rows, columns = (number[dofs] for dofs in inverse.rows_and_columns())
        kept = (rows >= 0) & (columns >= 0)
        rows, columns, entries = rows[kept], columns[kept], blocks[kept]
        total = size + len(at_border)
        within = (rows < size) & (columns < size)
        self._number, self._x = number, np.zeros(total)
        self._lower = self._pivots = None
        place, factors = np.arange(total), None
        if size > 0:
            factors = _factors(
                entries[within], rows[within], columns[within], size, "MMD_AT_PLUS_A"
            )
            if factors is not None:
                place[:size] = factors.perm_c
                self._number = np.where(number >= 0, place[number], -1)
        if border is not None:
            if size == 0 or factors is not None:
                factors = _factors(entries, place[rows], place[columns], total, "NATURAL")
            self.there = border.factor(at_border, self._share(factors))
        else:
            self.there = factors is not None
        if self.there and factors is not None:
            lower = factors.L.tocsc()
            lower.sort_indices()
            self._lower = lower.indptr, lower.indices, lower.data
            self._pivots = 1.0 / factors.U.diagonal()

    def _share(self, factors) -> np.ndarray | None:
        """This rank's share of S."""
        if factors is None:
            return None if len(self._x) else np.zeros((0, 0))
        lower = factors.L[self._inside :, self._inside :].toarray()
        return (lower * factors.U.diagonal()[self._inside :]) @ lower.T

    def solve(self, r: np.ndarray, z: np.ndarray) -> None:
        """z = P (P^T w^-1 P)^-1 P^T r."""
        x, inside = self._x, self._inside
        x[:] = 0.0
        _restrict(self._number, r, x)
        if self._lower is not None:
            _eliminate(*self._lower, inside, x)
        if self._border is not None:
            x[inside:] = self._border.solve(x[inside:])
        if self._lower is not None:
            _substitute(*self._lower, self._pivots, inside, x)
        _prolong(self._number, x, z)


def held_directions(cluster: np.ndarray, opened: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Directions that `ClustersAsOne` leaves out, shape (num_clusters, dim).

    Args:
        cluster: shape (num_slots,), cluster of each slot.
        opened: shape (num_clusters,), whether translation of a cluster opens a point.
        fixed: shape (num_slots * dim,), degrees of freedom that are prescribed.
    """
    fixed = fixed.reshape(len(cluster), -1)
    held = np.repeat(opened[:, None], fixed.shape[1], axis=1)
    slot, axis = np.nonzero(fixed)
    held[cluster[slot], axis] = True
    return held


def _factors(entries: np.ndarray, rows: np.ndarray, columns: np.ndarray, size: int, order: str):
    """L and D L^T of a symmetric matrix; None where pivots are not on the diagonal."""
    if size == 0:
        return None
    matrix = coo_array((entries, (rows, columns)), shape=(size, size)).tocsc()
    try:
        factors = splu(
            matrix, permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:  # singular
        return None
    return factors if np.array_equal(factors.perm_r, factors.perm_c) else None


@_KERNEL
def _eliminate(starts, rows, entries, count, x):
    """x = L^-1 x for the first columns of L."""
    for j in range(count):
        factor = x[j]
        for e in range(np.uintp(starts[j] + 1), np.uintp(starts[j + 1])):
            x[np.uintp(rows[e])] -= entries[e] * factor


@_KERNEL
def _substitute(starts, rows, entries, pivots, count, x):
    """x = L^-T D^-1 x for these columns; what comes after them is known."""
    for back in range(count):
        j = count - 1 - back
        total = 0.0
        for e in range(np.uintp(starts[j] + 1), np.uintp(starts[j + 1])):
            total += entries[e] * x[np.uintp(rows[e])]
        x[j] = x[j] * pivots[j] - total


@_KERNEL
def _restrict(number, r, x):
    for i in range(len(r)):
        if number[i] >= 0:
            x[number[i]] += r[i]


@_KERNEL
def _prolong(number, x, z):
    for i in range(len(z)):
        z[i] = x[number[i]] if number[i] >= 0 else 0.0
