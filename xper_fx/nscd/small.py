# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors and symmetric matrices of dimension 2 and 3 as tuples, for use inside kernels.

A vector is `(n, t)` or `(n, t1, t2)`. A symmetric matrix holds its upper triangle by rows:
`(nn, nt, tt)` or `(nn, n1, n2, 11, 12, 22)`. Where nothing acts along the tangent, a local vector
is `(n,)` alone in either dimension, and a matrix `(nn,)`. Tuples live in registers: nothing is
allocated. `for_dimension` gives the set of functions for a dimension, so that a kernel compiled for
one dimension carries no trace of the other.
"""

from __future__ import annotations

from collections import namedtuple
from functools import cache

import numpy as np
from numba import njit

SmallAlgebra = namedtuple(
    "SmallAlgebra",
    "row set_row dot add subtract scale unit matrix_vector sym_row sym_vector to_local to_global "
    "multiply_diagonal compliance_with_springs",
)


@njit(inline="always")
def _row1(a, i):
    return (a[i, 0],)


@njit(inline="always")
def _row2(a, i):
    return a[i, 0], a[i, 1]


@njit(inline="always")
def _row3(a, i):
    return a[i, 0], a[i, 1], a[i, 2]


@njit(inline="always")
def _set_row1(a, i, x):
    a[i, 0] = x[0]


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
def _dot1(x, y):
    return x[0] * y[0]


@njit(inline="always")
def _dot2(x, y):
    return x[0] * y[0] + x[1] * y[1]


@njit(inline="always")
def _dot3(x, y):
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(inline="always")
def _add1(x, y):
    return (x[0] + y[0],)


@njit(inline="always")
def _add2(x, y):
    return x[0] + y[0], x[1] + y[1]


@njit(inline="always")
def _add3(x, y):
    return x[0] + y[0], x[1] + y[1], x[2] + y[2]


@njit(inline="always")
def _subtract1(x, y):
    return (x[0] - y[0],)


@njit(inline="always")
def _subtract2(x, y):
    return x[0] - y[0], x[1] - y[1]


@njit(inline="always")
def _subtract3(x, y):
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@njit(inline="always")
def _scale1(c, x):
    return (c * x[0],)


@njit(inline="always")
def _scale2(c, x):
    return c * x[0], c * x[1]


@njit(inline="always")
def _scale3(c, x):
    return c * x[0], c * x[1], c * x[2]


@njit(inline="always")
def _unit1(j, size):
    return (size,)


@njit(inline="always")
def _unit2(j, size):
    return (size, 0.0) if j == 0 else (0.0, size)


@njit(inline="always")
def _unit3(j, size):
    return size if j == 0 else 0.0, size if j == 1 else 0.0, size if j == 2 else 0.0


@njit(inline="always")
def _matrix_vector1(a, i, x):
    return (a[i, 0, 0] * x[0],)


@njit(inline="always")
def _matrix_vector2(a, i, x):
    return a[i, 0, 0] * x[0] + a[i, 0, 1] * x[1], a[i, 1, 0] * x[0] + a[i, 1, 1] * x[1]


@njit(inline="always")
def _matrix_vector3(a, i, x):
    return (
        a[i, 0, 0] * x[0] + a[i, 0, 1] * x[1] + a[i, 0, 2] * x[2],
        a[i, 1, 0] * x[0] + a[i, 1, 1] * x[1] + a[i, 1, 2] * x[2],
        a[i, 2, 0] * x[0] + a[i, 2, 1] * x[1] + a[i, 2, 2] * x[2],
    )


@njit(inline="always")
def _multiply_diagonal2(normal, tangential, x):
    return normal * x[0], tangential * x[1]


@njit(inline="always")
def _multiply_diagonal3(normal, tangential, x):
    return normal * x[0], tangential * x[1], tangential * x[2]


@njit(inline="always")
def _sym_row1(a, i):
    return (a[i, 0],)


@njit(inline="always")
def _sym_row2(a, i):
    return a[i, 0], a[i, 1], a[i, 2]


@njit(inline="always")
def _sym_row3(a, i):
    return a[i, 0], a[i, 1], a[i, 2], a[i, 3], a[i, 4], a[i, 5]


@njit(inline="always")
def _sym_vector1(s, x):
    return (s[0] * x[0],)


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
    """(I + W K)^-1 W for K = diag(kn, kt, kt), one spring after the other.

    A spring k on direction e turns W into W - k W e e^T W / (1 + k e^T W e): three rank-one
    updates lose less than Cramer's rule when W is nearly singular and the springs are stiff.
    """
    w0, w1, w2, w3, w4, w5 = w
    c = 1.0 / (1.0 + kn * w0)
    x1, x2 = c * w1, c * w2
    w0, w3, w4, w5 = c * w0, w3 - kn * x1 * w1, w4 - kn * x1 * w2, w5 - kn * x2 * w2
    w1, w2 = x1, x2
    c = 1.0 / (1.0 + kt * w3)
    x1, x4 = c * w1, c * w4
    w0, w2, w5 = w0 - kt * x1 * w1, w2 - kt * x1 * w4, w5 - kt * x4 * w4
    w1, w3, w4 = x1, c * w3, x4
    c = 1.0 / (1.0 + kt * w5)
    x2, x4 = c * w2, c * w4
    w0, w1, w3 = w0 - kt * x2 * w2, w1 - kt * x2 * w4, w3 - kt * x4 * w4
    return w0, w1, x2, w3, x4, c * w5


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


@njit(inline="always")
def _same(frame, i, x):
    return x


@njit(inline="always")
def _normal_part2(frame, i, x):
    return (frame[i, 0, 0] * x[0] + frame[i, 0, 1] * x[1],)


@njit(inline="always")
def _normal_part3(frame, i, x):
    return (frame[i, 0, 0] * x[0] + frame[i, 0, 1] * x[1] + frame[i, 0, 2] * x[2],)


@njit(inline="always")
def _along_normal2(frame, i, x):
    return frame[i, 0, 0] * x[0], frame[i, 0, 1] * x[0]


@njit(inline="always")
def _along_normal3(frame, i, x):
    return frame[i, 0, 0] * x[0], frame[i, 0, 1] * x[0], frame[i, 0, 2] * x[0]


@cache
def for_dimension(dim: int, components: int | None = None) -> SmallAlgebra:
    """The small-vector functions for dimension 2 or 3.

    Args:
        dim: dimension of space; 1 where all is along normals already and nothing has to turn.
        components: of a local vector: `dim`, which is meant if not given, or 1, the normal's.

    Returns:
        The functions; `to_local` and `to_global` lead from vectors of space to local ones and back.
        With one component there are no springs of two stiffnesses, and the last two are None.

    Raises:
        ValueError: any other dimension, or number of components.
    """
    if dim not in (1, 2, 3):
        raise ValueError(f"Interactions live in dimension 2 or 3, got {dim}.")
    if components not in (None, 1, dim):
        raise ValueError(f"Local vectors have 1 or {dim} components, got {components}.")
    if 1 in (dim, components):
        return SmallAlgebra(
            _row1, _set_row1, _dot1, _add1, _subtract1, _scale1, _unit1, _matrix_vector1,
            _sym_row1, _sym_vector1, (_same, _normal_part2, _normal_part3)[dim - 1],
            (_same, _along_normal2, _along_normal3)[dim - 1], None, None,
        )  # fmt: skip
    if dim == 2:
        return SmallAlgebra(
            _row2, _set_row2, _dot2, _add2, _subtract2, _scale2, _unit2, _matrix_vector2,
            _sym_row2, _sym_vector2, _to_local2, _to_global2, _multiply_diagonal2,
            _compliance_with_springs2,
        )  # fmt: skip
    return SmallAlgebra(
        _row3, _set_row3, _dot3, _add3, _subtract3, _scale3, _unit3, _matrix_vector3,
        _sym_row3, _sym_vector3, _to_local3, _to_global3, _multiply_diagonal3,
        _compliance_with_springs3,
    )  # fmt: skip


def sym_indices(components: int) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of each stored entry of a symmetric matrix, in storage order."""
    return np.triu_indices(components)
