# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors (n, t1, t2) and symmetric matrices (nn, n1, n2, 11, 12, 22); see `small.py`."""

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY


@njit(inline="always")
def row(a, i):
    return a[i, 0], a[i, 1], a[i, 2]


@njit(inline="always")
def set_row(a, i, x):
    a[i, 0] = x[0]
    a[i, 1] = x[1]
    a[i, 2] = x[2]


@njit(inline="always")
def part(a, i, first):
    return a[i, first], a[i, first + 1], a[i, first + 2]


@njit(inline="always")
def tangent_part(a, i, first):
    return a[i, first], a[i, first + 1]


@njit(inline="always")
def with_normal(x, normal):
    return normal, x[1], x[2]


@njit(inline="always")
def dot(x, y):
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(inline="always")
def add(x, y):
    return x[0] + y[0], x[1] + y[1], x[2] + y[2]


@njit(inline="always")
def subtract(x, y):
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@njit(inline="always")
def scale(c, x):
    return c * x[0], c * x[1], c * x[2]


@njit(inline="always")
def unit(j, size):
    return size if j == 0 else 0.0, size if j == 1 else 0.0, size if j == 2 else 0.0


@njit(inline="always")
def matrix_vector(a, i, x):
    return (
        a[i, 0, 0] * x[0] + a[i, 0, 1] * x[1] + a[i, 0, 2] * x[2],
        a[i, 1, 0] * x[0] + a[i, 1, 1] * x[1] + a[i, 1, 2] * x[2],
        a[i, 2, 0] * x[0] + a[i, 2, 1] * x[1] + a[i, 2, 2] * x[2],
    )


@njit(inline="always")
def multiply_diagonal(normal, tangential, x):
    return normal * x[0], tangential * x[1], tangential * x[2]


@njit(inline="always")
def sym_row(a, i):
    return a[i, 0], a[i, 1], a[i, 2], a[i, 3], a[i, 4], a[i, 5]


@njit(inline="always")
def sym_part(a, i, f):
    return a[i, f], a[i, f + 1], a[i, f + 2], a[i, f + 3], a[i, f + 4], a[i, f + 5]


@njit(inline="always")
def sym_vector(s, x):
    return (
        s[0] * x[0] + s[1] * x[1] + s[2] * x[2],
        s[1] * x[0] + s[3] * x[1] + s[4] * x[2],
        s[2] * x[0] + s[4] * x[1] + s[5] * x[2],
    )


@njit(**LEAN_ENTRY)
def compliance_with_springs(w, kn, kt):
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
def sym_solve(s, x):
    """S^-1 x, by Cramer's rule."""
    c0 = s[3] * s[5] - s[4] * s[4]
    c1 = s[2] * s[4] - s[1] * s[5]
    c2 = s[1] * s[4] - s[2] * s[3]
    c3 = s[0] * s[5] - s[2] * s[2]
    c4 = s[1] * s[2] - s[0] * s[4]
    c5 = s[0] * s[3] - s[1] * s[1]
    inverse = 1.0 / (s[0] * c0 + s[1] * c1 + s[2] * c2)
    return (
        (c0 * x[0] + c1 * x[1] + c2 * x[2]) * inverse,
        (c1 * x[0] + c3 * x[1] + c4 * x[2]) * inverse,
        (c2 * x[0] + c4 * x[1] + c5 * x[2]) * inverse,
    )


@njit(inline="always")
def to_local(frame, i, x):
    return (
        frame[i, 0, 0] * x[0] + frame[i, 0, 1] * x[1] + frame[i, 0, 2] * x[2],
        frame[i, 1, 0] * x[0] + frame[i, 1, 1] * x[1] + frame[i, 1, 2] * x[2],
        frame[i, 2, 0] * x[0] + frame[i, 2, 1] * x[1] + frame[i, 2, 2] * x[2],
    )


@njit(inline="always")
def to_global(frame, i, x):
    return (
        frame[i, 0, 0] * x[0] + frame[i, 1, 0] * x[1] + frame[i, 2, 0] * x[2],
        frame[i, 0, 1] * x[0] + frame[i, 1, 1] * x[1] + frame[i, 2, 1] * x[2],
        frame[i, 0, 2] * x[0] + frame[i, 1, 2] * x[1] + frame[i, 2, 2] * x[2],
    )


@njit(inline="always")
def to_normal(frame, i, x):
    """Component along n, alone."""
    return (frame[i, 0, 0] * x[0] + frame[i, 0, 1] * x[1] + frame[i, 0, 2] * x[2],)


@njit(inline="always")
def along_normal(frame, i, x):
    return frame[i, 0, 0] * x[0], frame[i, 0, 1] * x[0], frame[i, 0, 2] * x[0]
