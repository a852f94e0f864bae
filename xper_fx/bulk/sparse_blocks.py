# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sparse matrices of small blocks, and products of a vector with them and with blocks of bodies.

A start without SciPy's sparse matrices takes a tenth less time, and bodies that are cells need none
of their algebra: who needs it asks for it (`BlockMatrix.to_scipy`).

Kernels over a range of bodies, or of rows, that write nothing outside it: `support/threads.py` runs
them in threads. And whether a sparse matrix is symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import ENTRY, LEAN_ENTRY
from xper_fx.support.threads import in_ranges

if TYPE_CHECKING:
    import scipy.sparse as sp

# Difference from its transpose, relative to its largest entry, up to which a matrix is symmetric:
# the softest motions of bodies may be many times softer than their cells.
_SYMMETRIC = 1e-12


@dataclass(frozen=True)
class BlockMatrix:
    """A square matrix in sparse rows of dim x dim blocks."""

    data: np.ndarray  #: the blocks row by row, shape (num_blocks, dim, dim)
    #: the column of each block among the nodes, ascending in a row, shape (num_blocks,)
    indices: np.ndarray
    #: the first block of each row, and the number of blocks, shape (num_nodes + 1,)
    indptr: np.ndarray

    @property
    def size(self) -> int:
        """Rows of numbers."""
        return (len(self.indptr) - 1) * self.data.shape[1]

    def copy(self) -> BlockMatrix:
        """With blocks of its own."""
        return replace(self, data=self.data.copy())

    def to_scipy(self) -> sp.bsr_array:
        """The same of SciPy; the blocks are shared."""
        from scipy.sparse import bsr_array

        return bsr_array((self.data, self.indices, self.indptr), shape=(self.size, self.size))


def is_symmetric(matrix: sp.sparray) -> bool:
    """Whether a matrix is, as tangents of the bulk but those of flow at finite strain are."""
    apart = np.abs((matrix - matrix.T).data).max(initial=0.0)
    return bool(apart <= _SYMMETRIC * np.abs(matrix.data).max(initial=0.0))


@cache
def apply_blocks(dim: int):
    """Kernel `apply(first, last, w, nodes, r, out)`: out = w r for bodies of one size.

    `w` has shape (num_bodies, n, n), `nodes` are those of the bodies in turn, `r` and `out` are in
    the numbering of the nodes.
    """

    @njit(nogil=True, **ENTRY)
    def apply(first, last, w, nodes, r, out):
        size = w.shape[1]
        own = np.empty(size)
        for body in range(first, last):
            start = body * (size // dim)
            for a in range(size // dim):
                for x in range(dim):
                    own[a * dim + x] = r[nodes[start + a] * dim + x]
            for a in range(size // dim):
                for x in range(dim):
                    total = 0.0
                    for b in range(size):
                        total += w[body, a * dim + x, b] * own[b]
                    out[nodes[start + a] * dim + x] = total

    return apply


@cache
def _rows_kernel(dim: int):
    @njit(nogil=True, **LEAN_ENTRY)
    def rows(first, last, indptr, indices, data, x, out):
        for row in range(first, last):
            p, q, s = 0.0, 0.0, 0.0
            for entry in range(indptr[row], indptr[row + 1]):
                column = indices[entry] * dim
                for d in range(dim):
                    p += data[entry, 0, d] * x[column + d]
                    q += data[entry, 1, d] * x[column + d]
                    if dim == 3:
                        s += data[entry, 2, d] * x[column + d]
            out[row * dim], out[row * dim + 1] = p, q
            if dim == 3:
                out[row * dim + 2] = s

    return rows


def multiply(matrix: BlockMatrix, x: np.ndarray) -> np.ndarray:
    """A x for blocks of 2 x 2 or 3 x 3, in threads where there are many rows."""
    out = np.empty(matrix.size)
    kernel = _rows_kernel(matrix.data.shape[1])
    in_ranges(kernel, len(matrix.indptr) - 1, matrix.indptr, matrix.indices, matrix.data, x, out)
    return out
