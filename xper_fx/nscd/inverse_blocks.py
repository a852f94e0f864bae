# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inverse w of the iteration matrix, body by body, on the nodes that interact.

`w` is block diagonal over bodies: interactions are the only thing that couples them. Each block
is dense and symmetric over the body's interacting nodes; prescribed degrees of freedom have zero
rows and columns. A lumped mass has one block a node.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from xper_fx.cache import njit


@dataclass(frozen=True)
class BodyInverse:
    """Blocks of w over the interacting nodes, in body order, and a zero block for the ground."""

    dim: int
    #: shape (num_blocks + 1,), first node of each block; the last block is the ground's, whose
    #: first node is the ground
    node_offsets: np.ndarray
    data: np.ndarray  #: all blocks by rows, flat (m/s per N s)
    data_offsets: np.ndarray  #: shape (num_blocks + 1,), first entry of each block in `data`
    #: whether there is one block a node, of which `data` has the diagonal alone. Such an inverse
    #: gives the compliances of points, and moves nothing.
    diagonal: bool = False

    @classmethod
    def from_uniform(cls, blocks: np.ndarray, dim: int) -> BodyInverse:
        """From blocks of one size, shape (num_bodies, n, n) with n = nodes a body times dim.

        The ground gets a block of the same size, so that kernels can be compiled for that size.
        """
        count, n = blocks.shape[:2]
        held, inverse = cls.empty_uniform(count, n, dim)
        held[:] = blocks
        return inverse

    @classmethod
    def empty_uniform(cls, count: int, size: int, dim: int) -> tuple[np.ndarray, BodyInverse]:
        """As `from_uniform`, with the view on the blocks, shape (count, size, size), to fill."""
        data = np.zeros((count + 1) * size**2)
        offsets = np.arange(count + 2, dtype=np.int64)
        inverse = cls(dim, offsets * (size // dim), data, offsets * size**2)
        return data[: count * size**2].reshape(count, size, size), inverse

    @classmethod
    def from_diagonal(cls, diagonal: np.ndarray, sizes: np.ndarray, dim: int) -> BodyInverse:
        """From diagonal blocks.

        Args:
            diagonal: entries, block after block.
            sizes: shape (num_blocks,), nodes of each block.
        """
        if len(sizes) and np.all(sizes == sizes[0]):
            n = int(sizes[0]) * dim
            held, inverse = cls.empty_uniform(len(sizes), n, dim)
            held[:, np.arange(n), np.arange(n)] = diagonal.reshape(-1, n)
            return inverse
        nodes = np.concatenate([[0], np.cumsum(np.append(sizes, 1))])
        offsets = np.concatenate([[0], np.cumsum(np.append(sizes * dim, dim) ** 2)])
        data = np.zeros(offsets[-1])
        dofs = sizes * dim
        place = np.arange(len(diagonal)) - np.repeat(nodes[:-2] * dim, dofs)
        data[np.repeat(offsets[:-2], dofs) + place * np.repeat(dofs + 1, dofs)] = diagonal
        return cls(dim, nodes, data, offsets)

    @classmethod
    def of_nodes(cls, entries: np.ndarray, dim: int) -> BodyInverse:
        """Diagonal, from the entries of each node, shape (num_nodes, dim)."""
        offsets = np.arange(len(entries) + 2, dtype=np.int64)
        data = np.append(entries.ravel(), np.zeros(dim))
        return cls(dim, offsets, data, offsets * dim, diagonal=True)

    def rows_and_columns(self) -> tuple[np.ndarray, np.ndarray]:
        """Degrees of freedom of each entry of `data`, where blocks are whole."""
        return _rows_and_columns(self.node_offsets * self.dim, len(self.data))

    def diagonal_of_nodes(self) -> BodyInverse:
        """The same, of one block a node, held as `of_nodes` holds it."""
        places, nodes = np.arange(self.dim) * (self.dim + 1), self.node_offsets
        data = self.data.reshape(-1, self.dim * self.dim)[:, places].ravel()
        return BodyInverse(self.dim, nodes, data, nodes * self.dim, diagonal=True)

    def compliance_of_slots(self) -> np.ndarray:
        """Of one block a node, the largest compliance of each in all directions not driven.

        Returns:
            Shape (num_slots, dim), m/s per N s; zero in directions that are driven.
        """
        diagonal = self if self.diagonal else self.diagonal_of_nodes()
        compliance = diagonal.data.reshape(-1, self.dim)
        most = compliance.max(axis=1, keepdims=True)
        if np.all((compliance == most) | (compliance == 0.0)):
            return compliance
        return np.where(compliance > 0.0, most, 0.0)

    @classmethod
    def from_blocks(cls, blocks: list[np.ndarray], dim: int) -> BodyInverse:
        """From dense blocks of any sizes (each a multiple of dim)."""
        sizes = np.array([len(b) for b in blocks] + [dim], dtype=np.int64)
        nodes = np.concatenate([[0], np.cumsum(sizes // dim)])
        data = np.concatenate([b.ravel() for b in blocks] + [np.zeros(dim * dim)])
        return cls(dim, nodes, data, np.concatenate([[0], np.cumsum(sizes**2)]))

    def joined(self, blocks: np.ndarray, by_node: bool = False) -> BodyInverse:
        """With blocks of one size behind these, shape (num_bodies, n, n); the ground stays last.

        The ground's block is as large as theirs, so that kernels can be compiled for that size.

        Args:
            blocks: of w.
            by_node: whether each node gets a block, which has the diagonal alone.
        """
        if by_node or self.diagonal:
            entries = np.einsum("bii->bi", blocks).reshape(-1, self.dim)
            if self.diagonal:
                own = self.data[: self.data_offsets[-2]].reshape(-1, self.dim)
                return self.of_nodes(np.concatenate([own, entries]), self.dim)
            blocks = entries[:, :, None] * np.eye(self.dim)
        count, n = blocks.shape[:2]
        nodes, data = self.node_offsets[:-1], self.data[: self.data_offsets[-2]]
        steps = np.arange(1, count + 2, dtype=np.int64)
        return BodyInverse(
            self.dim,
            np.concatenate([nodes, nodes[-1] + steps * (n // self.dim)]),
            np.concatenate([data, blocks.ravel(), np.zeros(n * n)]),
            np.concatenate([self.data_offsets[:-1], len(data) + steps * (n * n)]),
        )

    def with_blocks(self, sizes: np.ndarray, data: np.ndarray) -> BodyInverse:
        """With other blocks behind these; the ground, as large as they are if all are, stays last.

        Args:
            sizes: shape (n,), nodes of each block.
            data: the blocks, flat, held as these are.
        """
        own = np.diff(self.node_offsets)[:-1]
        sizes = np.concatenate([own, sizes])
        alike = len(sizes) > 0 and np.all(sizes == sizes[0])
        sizes = np.append(sizes, sizes[0] if alike else 1)
        entries = (sizes * self.dim) ** (1 if self.diagonal else 2)
        return BodyInverse(
            self.dim,
            np.concatenate([[0], np.cumsum(sizes)]),
            np.concatenate([self.data[: self.data_offsets[-2]], data, np.zeros(entries[-1])]),
            np.concatenate([[0], np.cumsum(entries)]),
            self.diagonal,
        )

    @property
    def num_nodes(self) -> int:
        """Number of nodes, the ground not counted."""
        return int(self.node_offsets[-2])

    @property
    def num_slots(self) -> int:
        """Length, in nodes, of a velocity array with the ground's padding."""
        return int(self.node_offsets[-1])

    @cached_property
    def uniform_size(self) -> int:
        """Common block size (degrees of freedom), or 0 when sizes differ."""
        sizes = np.diff(self.node_offsets)
        return int(sizes[0]) * self.dim if np.all(sizes == sizes[0]) else 0

    def still(self) -> np.ndarray:
        """Whether a block cannot be moved (prescribed, the ground's), shape (num_blocks,)."""
        return np.add.reduceat(np.abs(self.data), self.data_offsets[:-1]) == 0.0

    def even_nodes(self) -> np.ndarray | None:
        """Which slots an impulse moves along itself, whatever its direction.

        Returns:
            Shape (num_slots,), bool; None where w is not diagonal, or not held so.
        """
        nodal = self.of_lumped_mass()
        return None if nodal is None else np.all(nodal == nodal[:, :1], axis=1)

    def of_lumped_mass(self) -> np.ndarray | None:
        """The diagonal of w.

        Returns:
            Shape (num_slots, dim), 1/kg; None where w is not diagonal, or not held so.
        """
        n = self.uniform_size
        if self.diagonal or n == 0:
            return None
        blocks = self.data.reshape(-1, n, n)
        diagonal = np.einsum("bii->bi", blocks)
        if np.count_nonzero(blocks) > np.count_nonzero(diagonal):
            return None
        return diagonal.reshape(-1, self.dim)

    @cached_property
    def block_of_node(self) -> np.ndarray:
        """Block of each node slot, the ground's included; shape (num_slots,), int32."""
        sizes = np.diff(self.node_offsets)
        return np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)


@njit
def _rows_and_columns(offsets, count):
    rows, columns = np.empty(count, np.int64), np.empty(count, np.int64)
    at = 0
    for b in range(len(offsets) - 1):
        for i in range(offsets[b], offsets[b + 1]):
            for j in range(offsets[b], offsets[b + 1]):
                rows[at], columns[at] = i, j
                at += 1
    return rows, columns
