# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors and symmetric matrices of dimension 2 and 3 as tuples, for use inside kernels.

A vector is `(n, t)` or `(n, t1, t2)`. A symmetric matrix holds its upper triangle by rows:
`(nn, nt, tt)` or `(nn, n1, n2, 11, 12, 22)`. Tuples live in registers: nothing is allocated.
`for_dimension` gives the set of functions for a dimension, so that a kernel compiled for one
dimension carries no trace of the other.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache

import numpy as np
from numba import njit

SmallAlgebra = namedtuple(
    "SmallAlgebra",
    "row set_row dot add subtract scale multiply_diagonal sym_row sym_vector "
    "compliance_with_springs to_local to_global",
)


@njit(inline="always")
def _row2(a, i):
    return a[i, 0], a[i, 1]


@njit(inline="always")
def _row3(a, i):
    return a[i, 0], a[i, 1], a[i, 2]


@njit(inline="always")
def _set_row2(a, i, x):
    a[i, 0] = x[0]
    a[i, 1] = x[1]


@njit(inline="always")
def _set_row3(a, i, x):
    a[i, 0] = x[0]
    a[i, 1] = x[1]
    a[i, 2] = x[2]


@njit(inline="always")
def _dot2(x, y):
    return x[0] * y[0] + x[1] * y[1]


@njit(inline="always")
def _dot3(x, y):
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(inline="always")
def _add2(x, y):
    return x[0] + y[0], x[1] + y[1]


@njit(inline="always")
def _add3(x, y):
    return x[0] + y[0], x[1] + y[1], x[2] + y[2]


@njit(inline="always")
def _subtract2(x, y):
    return x[0] - y[0], x[1] - y[1]


@njit(inline="always")
def _subtract3(x, y):
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@njit(inline="always")
def _scale2(c, x):
    return c * x[0], c * x[1]


@njit(inline="always")
def _scale3(c, x):
    return c * x[0], c * x[1], c * x[2]


@njit(inline="always")
def _multiply_diagonal2(normal, tangential, x):
    return normal * x[0], tangential * x[1]


@njit(inline="always")
def _multiply_diagonal3(normal, tangential, x):
    return normal * x[0], tangential * x[1], tangential * x[2]


@njit(inline="always")
def _sym_row2(a, i):
    return a[i, 0], a[i, 1], a[i, 2]


@njit(inline="always")
def _sym_row3(a, i):
    return a[i, 0], a[i, 1], a[i, 2], a[i, 3], a[i, 4], a[i, 5]


@njit(inline="always")
def _sym_vector2(s, x):
    return s[0] * x[0] + s[1] * x[1], s[1] * x[0] + s[2] * x[1]


@njit(inline="always")
def _sym_vector3(s, x):
    return (
        s[0] * x[0] + s[1] * x[1] + s[2] * x[2],
        s[1] * x[0] + s[3] * x[1] + s[4] * x[2],
        s[2] * x[0] + s[4] * x[1] + s[5] * x[2],
    )


@njit(inline="always")
def _compliance_with_springs2(w, kn, kt):
    """(I + W K)^-1 W for K = diag(kn, kt): symmetric, and defined when W is singular.

    (I + W K)^-1 = adj(I + W K) / det; multiplied out so that no inverse of W or K appears.
    """
    det_w = w[0] * w[2] - w[1] * w[1]
    det = 1.0 + kn * w[0] + kt * w[2] + kn * kt * det_w
    inverse = 1.0 / det
    return (w[0] + kt * det_w) * inverse, w[1] * inverse, (w[2] + kn * det_w) * inverse


@njit
def _compliance_with_springs3(w, kn, kt):
    """(I + W K)^-1 W for K = diag(kn, kt, kt), by Cramer's rule on I + W K."""
    a00, a01, a02 = 1.0 + w[0] * kn, w[1] * kt, w[2] * kt
    a10, a11, a12 = w[1] * kn, 1.0 + w[3] * kt, w[4] * kt
    a20, a21, a22 = w[2] * kn, w[4] * kt, 1.0 + w[5] * kt
    c00 = a11 * a22 - a12 * a21
    c01 = a02 * a21 - a01 * a22
    c02 = a01 * a12 - a02 * a11
    c10 = a12 * a20 - a10 * a22
    c11 = a00 * a22 - a02 * a20
    c12 = a02 * a10 - a00 * a12
    c20 = a10 * a21 - a11 * a20
    c21 = a01 * a20 - a00 * a21
    c22 = a00 * a11 - a01 * a10
    inverse = 1.0 / (a00 * c00 + a01 * c10 + a02 * c20)
    return (
        inverse * (c00 * w[0] + c01 * w[1] + c02 * w[2]),
        inverse * (c00 * w[1] + c01 * w[3] + c02 * w[4]),
        inverse * (c00 * w[2] + c01 * w[4] + c02 * w[5]),
        inverse * (c10 * w[1] + c11 * w[3] + c12 * w[4]),
        inverse * (c10 * w[2] + c11 * w[4] + c12 * w[5]),
        inverse * (c20 * w[2] + c21 * w[4] + c22 * w[5]),
    )


@njit(inline="always")
def _to_local2(frame, i, x):
    """Components along n and t, t being n turned by +90 degrees; only n is read."""
    n0, n1 = frame[i, 0, 0], frame[i, 0, 1]
    return n0 * x[0] + n1 * x[1], n0 * x[1] - n1 * x[0]


@njit(inline="always")
def _to_local3(frame, i, x):
    return (
        frame[i, 0, 0] * x[0] + frame[i, 0, 1] * x[1] + frame[i, 0, 2] * x[2],
        frame[i, 1, 0] * x[0] + frame[i, 1, 1] * x[1] + frame[i, 1, 2] * x[2],
        frame[i, 2, 0] * x[0] + frame[i, 2, 1] * x[1] + frame[i, 2, 2] * x[2],
    )


@njit(inline="always")
def _to_global2(frame, i, x):
    n0, n1 = frame[i, 0, 0], frame[i, 0, 1]
    return n0 * x[0] - n1 * x[1], n1 * x[0] + n0 * x[1]


@njit(inline="always")
def _to_global3(frame, i, x):
    return (
        frame[i, 0, 0] * x[0] + frame[i, 1, 0] * x[1] + frame[i, 2, 0] * x[2],
        frame[i, 0, 1] * x[0] + frame[i, 1, 1] * x[1] + frame[i, 2, 1] * x[2],
        frame[i, 0, 2] * x[0] + frame[i, 1, 2] * x[1] + frame[i, 2, 2] * x[2],
    )


@cache
def for_dimension(dim: int) -> SmallAlgebra:
    """The small-vector functions for dimension 2 or 3.

    Raises:
        ValueError: any other dimension.
    """
    if dim == 2:
        return SmallAlgebra(
            _row2, _set_row2, _dot2, _add2, _subtract2, _scale2, _multiply_diagonal2,
            _sym_row2, _sym_vector2, _compliance_with_springs2, _to_local2, _to_global2,
        )  # fmt: skip
    if dim == 3:
        return SmallAlgebra(
            _row3, _set_row3, _dot3, _add3, _subtract3, _scale3, _multiply_diagonal3,
            _sym_row3, _sym_vector3, _compliance_with_springs3, _to_local3, _to_global3,
        )  # fmt: skip
    raise ValueError(f"Interactions live in dimension 2 or 3, got {dim}.")


def sym_indices(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each stored entry of a symmetric matrix, in storage order."""
    return np.triu_indices(dim)
