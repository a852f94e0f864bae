# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors (n, t) and symmetric matrices (nn, nt, tt); see `small.py`."""

from xper_fx.cache import njit


@njit(inline="always")
def row(a, i):
    return a[i, 0], a[i, 1]


@njit(inline="always")
def set_row(a, i, x):
    a[i, 0] = x[0]
    a[i, 1] = x[1]


@njit(inline="always")
def part(a, i, first):
    return a[i, first], a[i, first + 1]


@njit(inline="always")
def tangent_part(a, i, first):
    return (a[i, first],)


@njit(inline="always")
def with_normal(x, normal):
    return normal, x[1]


@njit(inline="always")
def dot(x, y):
    return x[0] * y[0] + x[1] * y[1]


@njit(inline="always")
def add(x, y):
    return x[0] + y[0], x[1] + y[1]


@njit(inline="always")
def subtract(x, y):
    return x[0] - y[0], x[1] - y[1]


@njit(inline="always")
def scale(c, x):
    return c * x[0], c * x[1]


@njit(inline="always")
def unit(j, size):
    return (size, 0.0) if j == 0 else (0.0, size)


@njit(inline="always")
def matrix_vector(a, i, x):
    return a[i, 0, 0] * x[0] + a[i, 0, 1] * x[1], a[i, 1, 0] * x[0] + a[i, 1, 1] * x[1]


@njit(inline="always")
def multiply_diagonal(normal, tangential, x):
    return normal * x[0], tangential * x[1]


@njit(inline="always")
def sym_row(a, i):
    return a[i, 0], a[i, 1], a[i, 2]


@njit(inline="always")
def sym_part(a, i, first):
    return a[i, first], a[i, first + 1], a[i, first + 2]


@njit(inline="always")
def sym_vector(s, x):
    return s[0] * x[0] + s[1] * x[1], s[1] * x[0] + s[2] * x[1]


@njit(inline="always")
def compliance_with_springs(w, kn, kt):
    """(I + W K)^-1 W for K = diag(kn, kt): symmetric, and defined when W is singular.

    (I + W K)^-1 = adj(I + W K) / det; multiplied out so that no inverse of W or K appears.
    """
    det_w = w[0] * w[2] - w[1] * w[1]
    det = 1.0 + kn * w[0] + kt * w[2] + kn * kt * det_w
    inverse = 1.0 / det
    return (w[0] + kt * det_w) * inverse, w[1] * inverse, (w[2] + kn * det_w) * inverse


@njit(inline="always")
def sym_solve(s, x):
    """S^-1 x, by Cramer's rule."""
    inverse = 1.0 / (s[0] * s[2] - s[1] * s[1])
    return (s[2] * x[0] - s[1] * x[1]) * inverse, (s[0] * x[1] - s[1] * x[0]) * inverse


@njit(inline="always")
def to_local(frame, i, x):
    """Components along n and t, t being n turned by +90 degrees; only n is read."""
    n0, n1 = frame[i, 0, 0], frame[i, 0, 1]
    return n0 * x[0] + n1 * x[1], n0 * x[1] - n1 * x[0]


@njit(inline="always")
def to_global(frame, i, x):
    n0, n1 = frame[i, 0, 0], frame[i, 0, 1]
    return n0 * x[0] - n1 * x[1], n1 * x[0] + n0 * x[1]


@njit(inline="always")
def to_normal(frame, i, x):
    """Component along n, alone."""
    return (frame[i, 0, 0] * x[0] + frame[i, 0, 1] * x[1],)


@njit(inline="always")
def along_normal(frame, i, x):
    return frame[i, 0, 0] * x[0], frame[i, 0, 1] * x[0]
