# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The matrix of bulk and interactions together: A + H K H^T over all unknowns.

A = M + C + h^2 theta^2 dF/dq is the bulk's iteration matrix, K the springs that stand for the laws
of the points (`nscd/point_tangents.py`), H the map from impulses at points to nodes. The pattern
does not change while the points stay, whatever opens, closes or breaks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.sparse_blocks import is_symmetric
from xper_fx.bulk.sparse_direct import Direct, SingularMatrixError, SparseDirect
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.point_group import PointGroup

# Difference from its transpose, relative to its entries, up to which a spring is symmetric:
# tangents are taken by differences.
_SYMMETRIC = 1e-5
# Share of the bulk's diagonal that is added to it, so that bodies which nothing holds for the
# moment do not end the iteration: what it leaves the next iteration corrects.
_SHIFT = 1e-12


class CoupledSystem:
    """Matrix and factorisations for the points that there are.

    Args:
        bulk: A of some state, in compressed rows with the pattern of all states; it has the first
            of the dofs, and ghosts of other ranks come after them (`parallel/coupled_rows.py`).
        prescribed: shape (num_dofs,), bool, dofs whose motion is given.
        dofs_of_slots: shape (num_slots * dim,), the unknown that each entry of the points'
            velocities is, -1 for the ground's.
        interactions: the points, None without any.
        gradient: shape (dim^2,), the unknowns of Fbar, with which lips of points turn; or none.
    """

    def __init__(
        self,
        bulk: sp.csr_array,
        prescribed: np.ndarray,
        dofs_of_slots: np.ndarray,
        interactions: Interactions | None,
        gradient: np.ndarray,
    ):
        self._size, self._own = len(prescribed), bulk.shape[0]
        self._free = ~prescribed
        groups = [] if interactions is None else interactions.groups
        self._springs = [_at_dofs(g, dofs_of_slots, gradient) for g in groups]
        keys = [np.repeat(np.arange(self._own), np.diff(bulk.indptr)) * self._size + bulk.indices]
        for dofs, _ in self._springs:
            pairs = dofs[:, :, None] * self._size + dofs[:, None, :]
            there = dofs >= 0
            keys.append(np.where(there[:, :, None] & there[:, None, :], pairs, 0).ravel())
        keys.append(np.arange(self._own) * (self._size + 1))
        unique, places = np.unique(np.concatenate(keys), return_inverse=True)
        ends = np.cumsum([len(k) for k in keys])
        self._of_bulk = places[: ends[0]]
        self._of_springs = [places[a:b] for a, b in zip(ends[:-2], ends[1:-1], strict=True)]
        self._diagonal = places[ends[-2] :]
        self._rows, self._columns = np.divmod(unique, self._size)
        self._left_out = np.flatnonzero(~(self._free[self._rows] & self._free[self._columns]))
        self._indptr = np.searchsorted(self._rows, np.arange(self._size + 1))
        self._solvers: dict[bool, Direct] = {}
        self._data = self._factorised = np.zeros(0)
        self._used: Direct | None = None
        self._looked_at: tuple[sp.csr_array, bool] | None = None

    def take(self, bulk: sp.csr_array, stiffness: Sequence[np.ndarray]) -> None:
        """Take the values; factorise them unless they are those of the last time.

        Args:
            bulk: A, of the pattern given.
            stiffness: K of each group, shape (n, components, components), or what points that turn
                have in its place (`nscd/turning_tangents.py`).

        Raises:
            SingularMatrixError: they cannot be factorised.
        """
        data = np.zeros(len(self._rows))
        data[self._of_bulk] = bulk.data  # one for each place
        shift = _SHIFT * np.abs(data[self._diagonal])
        if self._looked_at is None or self._looked_at[0] is not bulk:
            self._looked_at = bulk, is_symmetric(bulk)
        symmetric = self._looked_at[1]
        for (dofs, g), where, k in zip(self._springs, self._of_springs, stiffness, strict=True):
            entries = g.transpose(0, 2, 1) @ (k @ g)
            there = dofs >= 0
            entries *= there[:, :, None] & there[:, None, :]
            data += np.bincount(where, entries.ravel(), len(self._rows))
            apart = np.abs(k - k.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
            bound = _SYMMETRIC * np.abs(k).max(axis=(1, 2), initial=0.0)
            symmetric = symmetric and bool(np.all(apart <= bound))
        self._data = data
        masked = data.copy()
        masked[self._left_out] = 0.0
        diagonal = masked[self._diagonal]
        masked[self._diagonal] = np.where(self._free[: self._own], diagonal + shift, 1.0)
        known = self._used is not None and np.array_equal(masked, self._factorised)
        known, symmetric = self._on_all(known, symmetric)
        if known:
            return
        if symmetric not in self._solvers:
            self._solvers[symmetric] = self._direct(symmetric)
        self._used, self._factorised = None, masked
        self._solvers[symmetric].factorise(self._summed(masked))
        self._used = self._solvers[symmetric]

    def _on_all(self, *conditions: bool) -> Sequence[bool]:
        """Of each condition whether it holds on all ranks that have rows."""
        return conditions

    def _direct(self, symmetric: bool) -> Direct:
        """Factorisations of matrices of this pattern."""
        return SparseDirect(self._indptr, self._columns, symmetric)

    def _summed(self, data: np.ndarray) -> np.ndarray:
        """Entries of the matrix that is factorised, of those that points and bodies here give."""
        return data

    def _solved(self, right: np.ndarray) -> np.ndarray:
        """The factorised matrix's solution, both of shape (num_dofs,)."""
        return self._used.solve(right)

    def _times(self, x: np.ndarray) -> np.ndarray | float:
        """The matrix, prescribed rows and columns too, times x, both of shape (num_dofs,)."""
        if not np.any(x):
            return 0.0
        shape = self._size, self._size
        return sp.csr_array((self._data, self._columns, self._indptr), shape=shape) @ x

    def unstable_ways(self) -> int:
        """Negative eigenvalues of the last matrix; 0 if friction makes it unsymmetric."""
        return 0 if self._used is None else self._used.negative_pivots() or 0

    def solve(self, right: np.ndarray, given: np.ndarray) -> np.ndarray:
        """The solution x, shape (num_dofs,).

        Args:
            right: shape (num_dofs,), of which the free dofs count.
            given: shape (num_dofs,), x where the motion is prescribed.

        Raises:
            SingularMatrixError: the factors are of no use.
        """
        free = self._free[: self._own]
        x = np.where(free, 0.0, given)
        shifted = right - self._times(x)
        try:
            return self._solved(np.where(free, shifted, x))
        except SingularMatrixError:
            self._used = None
            raise

    def refined(self, right: np.ndarray, given: np.ndarray) -> np.ndarray:
        """As `solve`, corrected once for what was added to the diagonal: exact to rounding."""
        x = self.solve(right, given)
        return x + self.solve(right - self._times(x), np.zeros_like(x))

    @property
    def nbytes(self) -> int:
        """Memory held, factors apart, in bytes."""
        own = (self._of_bulk, self._rows, self._columns, self._left_out, self._data, self._diagonal)
        return sum(a.nbytes for a in (*own, *self._of_springs)) + sum(
            d.nbytes + g.nbytes for d, g in self._springs
        )


def _at_dofs(
    group: PointGroup, dofs_of_slots: np.ndarray, gradient: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unknowns at each point of a group, shape (n, m), and H^T there, (n, components, m).

    Of points that turn it is Q, (n, dim^2, m).
    """
    points, dim = group.points, group.sides.dim
    if group.turning is None:
        nodes, relative = points.nodes.reshape(-1, 2 * points.nodes.shape[2]), _relative(group)
    else:
        from xper_fx.nscd.turning_tangents import motion_of_lips

        nodes, relative = motion_of_lips(group, len(gradient))
    slots = nodes[..., None].astype(np.int64) * dim + np.arange(dim)
    dofs = dofs_of_slots[slots].reshape(-1, nodes.shape[1] * dim)
    if group.turning is not None:
        dofs = np.concatenate([dofs, np.tile(gradient, (len(group), 1))], axis=1)
    return dofs, relative


def _relative(group: PointGroup) -> np.ndarray:
    """H^T at the points of a group, shape (n, components, 2 k dim)."""
    frame = group.points.frame
    signed = group.points.weights * np.array([1.0, -1.0])[:, None]
    entries = 2 * signed.shape[2] * frame.shape[2]
    return np.einsum("psk,pid->piskd", signed, frame).reshape(*frame.shape[:2], entries)
