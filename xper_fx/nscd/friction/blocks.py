# SPDX-License-Identifier: LGPL-3.0-or-later
"""W stored by rows of dim x dim blocks, scaled, its contacts sorted by connected component.

Contacts that share a body, directly or through others, form a *component*; components are problems
of their own. The stored problem is scaled by m = mean(diag W) and s = max |q|: W / m, q / s and
m r / s replace W, q and r, all of the order of one, and no solver meets a unit.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.ordering import LAST_COLOR, greedy_colors

ORDERS = ("given", "shuffled", "colored")
_SEED = 0


class BlockProblem(NamedTuple):
    """A frictional contact problem by blocks: u_a = sum_b W_ab r_b + q_a."""

    offsets: np.ndarray  #: shape (n + 1,), first block of each contact's row
    #: shape (num_blocks,), contact of each block; sorted in a row, pattern symmetric
    columns: np.ndarray
    blocks: np.ndarray  #: shape (num_blocks, dim, dim)
    #: shape (n, dim (dim + 1) / 2), symmetric part of the diagonal blocks, packed
    diagonal: np.ndarray
    q: np.ndarray  #: shape (n, dim)
    mu: np.ndarray  #: shape (n,)
    #: shape (num_components + 1,), first contact of each component; all contacts are one where they
    #: are sorted by colour
    components: np.ndarray

    @property
    def dim(self) -> int:
        return self.q.shape[1]


class Stored(NamedTuple):
    """A problem ready to be solved, and its way back."""

    problem: BlockProblem  #: scaled and sorted
    scale: float  #: s / m, the unit of the impulses (N s); m = 1 where W is zero, s = 1 where q is
    #: shape (n,), contact a of `problem` is contact `places[a]` of the given one
    places: np.ndarray
    #: shape (num_colors + 1,), first contact of each colour; None unless sorted by it
    colors: np.ndarray | None


def _colors(pattern: sp.csr_matrix) -> np.ndarray:
    """Smallest colour that no earlier contact has of those with a block in common."""
    edges = sp.triu(pattern, 1, "csr").astype(np.int32)
    edges.data[:] = np.arange(1, edges.nnz + 1)
    edges = edges + edges.T
    color = greedy_colors(edges.indptr.astype(np.int64), edges.data, edges.nnz // 2 + 1, 0)
    rest = np.flatnonzero(color == LAST_COLOR)
    if len(rest):
        color[rest] += _colors(pattern[rest][:, rest])
    return color


def store(W: sp.csr_matrix, q: np.ndarray, mu: np.ndarray, dim: int, order: str) -> Stored:
    """Scale, sort and store by blocks.

    Args:
        W: shape (n dim, n dim), checked.
        q: shape (n dim,).
        mu: shape (n,).
        dim: 2 or 3.
        order: one of `ORDERS`; by component, and within it as "given" or "shuffled" once and
            always alike; or "colored": by colours whose contacts share no body.
    """
    n = len(mu)
    mean = (float(W.diagonal().mean()) if n else 0.0) or 1.0
    size = float(np.abs(q).max(initial=0.0)) or 1.0
    by_block = sp.bsr_matrix(W, blocksize=(dim, dim))
    pattern = sp.csr_matrix(
        (np.ones(len(by_block.indices), np.int8), by_block.indices, by_block.indptr), shape=(n, n)
    )
    pattern = pattern + pattern.T
    colors, rank = None, np.arange(n)
    if order == "colored":
        label = _colors(pattern)
        colors = np.concatenate([[0], np.cumsum(np.bincount(label))])
        components = np.array([0, n])
    else:
        count, label = connected_components(pattern, directed=False)
        components = np.concatenate([[0], np.cumsum(np.bincount(label, minlength=count))])
        if order == "shuffled":
            rank = np.random.default_rng(_SEED).permutation(n)
    places = np.lexsort((rank, label))
    # Zero blocks make the pattern symmetric and the diagonal present.
    place = np.empty(n, np.int64)
    place[places] = np.arange(n)
    rows = np.repeat(place, np.diff(by_block.indptr))
    columns = place[by_block.indices]
    keys = np.concatenate([rows * n + columns, columns * n + rows, np.arange(n) * (n + 1)])
    keys, first = np.unique(keys, return_index=True)
    blocks = np.zeros((len(keys), dim, dim))
    given = first < len(rows)
    blocks[given] = by_block.data[first[given]] / mean
    rows, columns = keys // n, keys % n
    diagonal_blocks = blocks[rows == columns]
    i, j = sym_indices(dim)
    stored = BlockProblem(
        offsets=np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n))]),
        columns=columns,
        blocks=blocks,
        diagonal=0.5 * (diagonal_blocks[:, i, j] + diagonal_blocks[:, j, i]),
        q=q.reshape(n, dim)[places] / size,
        mu=np.ascontiguousarray(mu[places]),
        components=components,
    )
    return Stored(stored, size / mean, places, colors)


def part(problem: BlockProblem, contacts: np.ndarray) -> BlockProblem:
    """The problem of some whole components.

    Args:
        problem: the stored problem.
        contacts: numbers of the contacts, in the order wanted; rows must not reach beyond them.

    Returns:
        Their problem, as one component.
    """
    place = np.full(len(problem.mu), -1)
    place[contacts] = np.arange(len(contacts))
    sizes = problem.offsets[contacts + 1] - problem.offsets[contacts]
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    entries = np.repeat(problem.offsets[contacts] - offsets[:-1], sizes) + np.arange(offsets[-1])
    columns = place[problem.columns[entries]]
    rows = np.repeat(np.arange(len(contacts)), sizes)
    by_column = np.lexsort((columns, rows))
    return BlockProblem(
        offsets=offsets,
        columns=columns[by_column],
        blocks=problem.blocks[entries[by_column]],
        diagonal=problem.diagonal[contacts],
        q=problem.q[contacts],
        mu=problem.mu[contacts],
        components=np.array([0, len(contacts)]),
    )


@cache
def row_product(dim: int):
    """Kernel `multiply(a, problem, r, u) -> u + sum_b W_ab r_b`; u and the result are tuples."""

    @njit(inline="always")
    def multiply2(a, problem, r, u):
        offsets, columns, blocks = problem.offsets, problem.columns, problem.blocks
        x, y = u
        for k in range(np.uintp(offsets[a]), np.uintp(offsets[a + 1])):
            b = np.uintp(columns[k])
            r0, r1 = r[b, 0], r[b, 1]
            x += blocks[k, 0, 0] * r0 + blocks[k, 0, 1] * r1
            y += blocks[k, 1, 0] * r0 + blocks[k, 1, 1] * r1
        return x, y

    @njit(inline="always")
    def multiply3(a, problem, r, u):
        offsets, columns, blocks = problem.offsets, problem.columns, problem.blocks
        x, y, z = u
        for k in range(np.uintp(offsets[a]), np.uintp(offsets[a + 1])):
            b = np.uintp(columns[k])
            r0, r1, r2 = r[b, 0], r[b, 1], r[b, 2]
            x += blocks[k, 0, 0] * r0 + blocks[k, 0, 1] * r1 + blocks[k, 0, 2] * r2
            y += blocks[k, 1, 0] * r0 + blocks[k, 1, 1] * r1 + blocks[k, 1, 2] * r2
            z += blocks[k, 2, 0] * r0 + blocks[k, 2, 1] * r1 + blocks[k, 2, 2] * r2
        return x, y, z

    return multiply2 if dim == 2 else multiply3
