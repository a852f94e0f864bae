# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Closed contacts that ranks divide, put together on all of them.

Each rank tells all ranks the rows of H^T of its contacts, with columns numbered over the slots of
all: a ghost has the number that its owner gives it. Of

    W = sum over the ranks of H^T w H,

w that of a rank's own bodies, each then adds up the part of its bodies, and tells that to all. Two
contacts share two bodies at most, so that an entry of W does not hang on the order of the ranks.

Rows are in the order of the laws and, of each, of what contacts are known by, whatever the number
of ranks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, vstack

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.opening_matrix import inverse_matrix


class ClosedRows(NamedTuple):
    """What n closed contacts give to a `FrictionProblem`, dim rows each."""

    opening: csr_array  #: H^T, shape (n dim, num_dofs), rows of tangents without friction empty
    padding: np.ndarray  #: shape (n, dim), what stands for these rows on the diagonal of W
    tip: np.ndarray  #: shape (n, dim), tips of the cones (N s)
    wanted: np.ndarray  #: shape (n, dim), velocities that the laws ask for (m/s)
    free: np.ndarray  #: shape (n dim,), H^T v_free (m/s)
    friction: np.ndarray  #: shape (n,)

    @classmethod
    def joined(cls, parts: Sequence[ClosedRows], dim: int, num_dofs: int) -> ClosedRows:
        """The rows of several parts, one after the other, or of none."""
        none = cls(csr_array((0, num_dofs)), *np.zeros((3, 0, dim)), *np.zeros((2, 0)))
        opening, *others = zip(none, *parts, strict=True)
        return cls(vstack(opening).tocsr(), *map(np.concatenate, others))


def share(
    interactions: Interactions, rows: ClosedRows, closed: Sequence[np.ndarray]
) -> tuple[ClosedRows, csr_array, np.ndarray]:
    """Put the contacts of all ranks together, which call it together.

    Args:
        interactions: points of meshed bodies, and of rigid ones beside them, with a halo.
        rows: of this rank's closed contacts.
        closed: of each group of points, which are, shape (n,).

    Returns:
        The rows of all contacts, W, and the places of this rank's contacts among them, shape (n,).
    """
    ranks, inverse, dim = interactions.halo.ranks, interactions.own_inverse, interactions.dim
    own = inverse.num_nodes * dim
    counts = ranks.comm.allgather(own)
    first, total = sum(counts[: ranks.comm.rank]), sum(counts)
    number = np.full(rows.opening.shape[1], float(total))  # that of the ground, which is still
    number[:own] = first + np.arange(own)
    interactions.halo.everywhere.forward(number)
    opening = rows.opening
    columns = number.astype(np.int64)[opening.indices]
    opening = csr_array((opening.data, columns, opening.indptr), (opening.shape[0], total + 1))
    names = _names(interactions, closed)
    told = ranks.comm.allgather((names, rows._replace(opening=opening)))
    of_all = ClosedRows.joined([told_rows for _, told_rows in told], dim, total + 1)
    order = np.lexsort(np.concatenate([of_rank for of_rank, _ in told]).T[::-1])
    by_row = (order[:, None] * dim + np.arange(dim)).ravel()
    of_all = ClosedRows(
        of_all.opening[by_row], *(a[order] for a in of_all[1:4]), of_all.free[by_row],
        of_all.friction[order],
    )  # fmt: skip
    mine = of_all.opening[:, first : first + own]
    part = mine @ inverse_matrix(inverse)[:own, :own] @ mine.T
    W = sum(ranks.comm.allgather(part), csr_array(part.shape))
    before = sum(len(of_rank) for of_rank, _ in told[: ranks.comm.rank])
    return of_all, W, np.argsort(order)[before : before + len(names)]


def _names(interactions: Interactions, closed: Sequence[np.ndarray]) -> np.ndarray:
    """What tells closed contacts apart on all ranks, shape (n, 6)."""
    kernels = [law.kernels(interactions.dim) for law in interactions.laws]
    parts = [np.zeros((0, 6), np.int64)]
    for group, which in zip(interactions.groups, closed, strict=True):
        known = interactions.known_by(group)[which]
        kind = kernels.index(group.kernels), group.sides.k, int(group.sides.lever_arms)
        parts.append(np.concatenate([np.broadcast_to(kind, known.shape), known], axis=1))
    return np.concatenate(parts)
