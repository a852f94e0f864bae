# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors (n,) and symmetric matrices (nn,): the normal alone; see `small.py`."""

from xper_fx.cache import njit


@njit(inline="always")
def row(a, i):
    return (a[i, 0],)


@njit(inline="always")
def set_row(a, i, x):
    a[i, 0] = x[0]


@njit(inline="always")
def dot(x, y):
    return x[0] * y[0]


@njit(inline="always")
def add(x, y):
    return (x[0] + y[0],)


@njit(inline="always")
def subtract(x, y):
    return (x[0] - y[0],)


@njit(inline="always")
def scale(c, x):
    return (c * x[0],)


@njit(inline="always")
def unit(j, size):
    return (size,)


@njit(inline="always")
def matrix_vector(a, i, x):
    return (a[i, 0, 0] * x[0],)


@njit(inline="always")
def sym_row(a, i):
    return (a[i, 0],)


@njit(inline="always")
def sym_vector(s, x):
    return (s[0] * x[0],)
