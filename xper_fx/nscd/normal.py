# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact without friction in the normal velocities of the points' sides.

Where nothing acts along the tangent, a sweep need not know the velocities of the bodies: what it
reads are the normal velocities of the sides, y = N^T v, N having a column for each side, its normal
spread on the nodes of the body by their weights; and what an impulse r adds is

    dy = G (r on the candidate's side, -r on the antagonist's),   G = N^T w N,

dense within each body. That is the exchange of `exchange.py` again, in one dimension, with G for w:
a visit moves one row a side, of one number a side of the body, for dim rows of dim numbers a node.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from xper_fx.nscd.exchange import VECTOR_DOFS, Couplings, couple
from xper_fx.nscd.inverse import BodyInverse
from xper_fx.nscd.points import InteractionPoints


@njit
def _read_sides(v, c, slots, y):
    """y = N^T v."""
    dim, k = c.frame.shape[2], c.start.shape[2]
    for i in range(len(slots)):
        for s in range(2):
            total = 0.0
            for j in range(k):
                for d in range(dim):
                    total += c.weights[i, s, j] * c.frame[i, 0, d] * v[c.start[i, s, j] + d]
            y[slots[i, s, 0]] = total


@njit
def _fill(c, slots, members, starts, offsets, sizes, data_offsets, data):
    """G = N^T w N, block by block; `members[starts[b]:starts[b + 1]]` are the sides of block b."""
    dim, k = c.frame.shape[2], c.start.shape[2]
    for b in range(len(starts) - 1):
        for p in members[starts[b] : starts[b + 1]]:
            i, s = p // 2, p % 2
            base, n = c.body[i, s], c.size[i, s]
            line = data_offsets[b] + (slots[i, s, 0] - offsets[b]) * sizes[b] - offsets[b]
            for q in members[starts[b] : starts[b + 1]]:
                j, t = q // 2, q % 2
                total = 0.0
                for e in range(k):
                    for f in range(k):
                        at = c.rows[i, s, e] + c.start[j, t, f] - base
                        weight = c.weights[i, s, e] * c.weights[j, t, f]
                        for x in range(dim):
                            for y in range(dim):
                                total += (
                                    weight
                                    * c.frame[i, 0, x]
                                    * c.w[at + x * n + y]
                                    * c.frame[j, 0, y]
                                )
                data[line + slots[j, t, 0]] = total


class NormalVelocities:
    """The sides of a group's points, and how impulses move them.

    Args:
        points: points whose frames are normals alone.
        couplings: of the points; `update` takes new values of w.
        inverse: blocks of w.

    Attributes:
        couplings: the same points between sides, in one dimension.
        block_size: common size of the blocks of G, or 0.
    """

    def __init__(self, points: InteractionPoints, couplings: Couplings, inverse: BodyInverse):
        block = inverse.block_of_node()[points.nodes[:, :, 0]].ravel()
        counts, ground = _sides_of_blocks(block, inverse)
        self._members = np.argsort(block, kind="stable")
        self._starts = np.concatenate([[0], np.cumsum(counts)])
        uniform = inverse.uniform_size > 0 and counts.max(initial=1) <= VECTOR_DOFS
        sizes = np.append(np.full(ground, counts.max(initial=1)) if uniform else counts, 1)
        if uniform:
            sizes[-1] = sizes[0]
        offsets = np.concatenate([[0], np.cumsum(sizes)])
        slots = np.full(len(block), offsets[ground], np.int32)
        own = self._members[: self._starts[-1]]
        rank = np.arange(len(own)) - np.repeat(self._starts[:-1], counts)
        slots[own] = np.repeat(offsets[:ground], counts) + rank
        data_offsets = np.concatenate([[0], np.cumsum(sizes**2)])
        blocks = BodyInverse(1, offsets, np.zeros(data_offsets[-1]), data_offsets)
        self._blocks, count = blocks, len(points)
        self.block_size = blocks.uniform_size if uniform else 0
        self.couplings = couple(
            InteractionPoints(
                slots.reshape(count, 2, 1), np.ones((count, 2, 1)), np.ones((count, 1, 1)),
                points.area, points.gap,
            ),
            blocks,
        )  # fmt: skip
        self._slots = slots.reshape(count, 2, 1)
        self.update(couplings)

    def update(self, couplings: Couplings) -> None:
        """Take new values of w."""
        blocks = self._blocks
        self._nodal = couplings
        _fill(
            couplings, self._slots, self._members, self._starts, blocks.node_offsets,
            np.diff(blocks.node_offsets), blocks.data_offsets, blocks.data,
        )  # fmt: skip

    def of(self, velocity: np.ndarray) -> np.ndarray:
        """Normal velocities of all sides (m/s) from the nodes', shape (num_slots * dim,)."""
        out = np.zeros(self._blocks.num_slots)
        _read_sides(velocity, self._nodal, self._slots, out)
        return out

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        own = self._members, self._starts, self._slots, *self.couplings
        return sum(a.nbytes for a in own)


def _sides_of_blocks(block: np.ndarray, inverse: BodyInverse) -> tuple[np.ndarray, int]:
    """Sides on each block but the ground's, and the number of the ground's."""
    ground = len(inverse.node_offsets) - 2
    return np.bincount(block, minlength=ground + 1)[:ground], ground


def fewer_numbers(points: InteractionPoints, inverse: BodyInverse) -> bool:
    """Whether a sweep moves fewer numbers by sides than by the nodes of the bodies."""
    block = inverse.block_of_node()[points.nodes[:, :, 0]].ravel()
    counts, ground = _sides_of_blocks(block, inverse)
    nodes = np.diff(inverse.node_offsets)[:ground]
    return int(counts @ counts) < inverse.dim**2 * int(counts @ nodes)
