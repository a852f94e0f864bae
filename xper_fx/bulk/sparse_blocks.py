# SPDX-License-Identifier: LGPL-3.0-or-later
"""Products of a vector with the blocks of bodies and with sparse matrices of small blocks.

Kernels over a range of bodies, or of rows, that write nothing outside it: `support/threads.py` runs
them in threads. And whether a sparse matrix is symmetric.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy.sparse as sp

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import ENTRY, LEAN_ENTRY
from xper_fx.support.threads import in_ranges

# Difference from its transpose, relative to its largest entry, up to which a matrix is symmetric:
# the softest motions of bodies may be many times softer than their cells.
_SYMMETRIC = 1e-12


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


def multiply(matrix: sp.bsr_array, x: np.ndarray) -> np.ndarray:
    """A x for a matrix in blocks of 2 x 2 or 3 x 3, in threads where there are many rows."""
    out = np.empty(matrix.shape[0])
    kernel = _rows_kernel(matrix.data.shape[1])
    in_ranges(kernel, len(matrix.indptr) - 1, matrix.indptr, matrix.indices, matrix.data, x, out)
    return out
