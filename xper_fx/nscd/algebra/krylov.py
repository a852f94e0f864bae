# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES with a right preconditioner (Saad and Schultz 1986; Saad 2003, section 9.3.2).

`scipy.sparse.linalg.gmres` makes the same iterations. It is not called because its scalar products
go through a threaded BLAS, whose threads wait for each other at each: a whole Newton solve takes
1.1 to 1.4 times as long on a machine at rest (plates of 20 x 20 to 80 x 80 quads), 3 times where
another process keeps one of two cores busy.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xper_fx.cache import njit


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def norm(x):
    """|x|, on this thread."""
    total = 0.0
    for i in range(len(x)):
        total += x[i] * x[i]
    return np.sqrt(total)


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def products(rows, count, x, out):
    """out_j = rows_j . x for the first rows, four at a time and in pieces that stay in cache.

    As a kernel: threads of a BLAS wait for each other at every call, dearly on a busy machine.
    """
    n, piece = len(x), 4096
    for j in range(count):
        out[j] = 0.0
    for first in range(0, n, piece):
        last = min(first + piece, n)
        j = 0
        while j + 4 <= count:
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for i in range(first, last):
                value = x[i]
                a += rows[j, i] * value
                b += rows[j + 1, i] * value
                c += rows[j + 2, i] * value
                d += rows[j + 3, i] * value
            out[j] += a
            out[j + 1] += b
            out[j + 2] += c
            out[j + 3] += d
            j += 4
        while j < count:
            a = 0.0
            for i in range(first, last):
                a += rows[j, i] * x[i]
            out[j] += a
            j += 1


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def add_combination(rows, count, factors, x):
    """x += sum_j factors_j rows_j for the first rows; returns |x|."""
    n, piece = len(x), 4096
    square = 0.0
    for first in range(0, n, piece):
        last = min(first + piece, n)
        j = 0
        while j + 4 <= count:
            a, b, c, d = factors[j], factors[j + 1], factors[j + 2], factors[j + 3]
            for i in range(first, last):
                x[i] += (a * rows[j, i] + b * rows[j + 1, i]) + (
                    c * rows[j + 2, i] + d * rows[j + 3, i]
                )
            j += 4
        while j < count:
            a = factors[j]
            for i in range(first, last):
                x[i] += a * rows[j, i]
            j += 1
        for i in range(first, last):
            square += x[i] * x[i]
    return np.sqrt(square)


def gmres(
    precondition: Callable[[np.ndarray, np.ndarray, np.ndarray], None],
    residual: np.ndarray,
    solution: np.ndarray,
    bound: float,
    max_iterations: int,
    room: np.ndarray,
) -> tuple[int, float]:
    """Reduce a residual, b - A x.

    Args:
        precondition: `precondition(r, z, y)` sets z = B r, and y = A z, which may be had for less
            along with z than alone.
        residual: shape (n,), b - A x on entry and on return.
        solution: shape (n,), x, improved in place.
        bound: norm of the residual to reach.
        max_iterations: products with A after which to stop.
        room: shape (m + 3, n), overwritten; m vectors are kept before a restart. Nothing of the
            size of a vector is allocated: on some systems that costs more than the iteration.

    Returns:
        Iterations made, and the norm of the residual reached.
    """
    most = len(room) - 3
    basis, z, part = room[:-2], room[-2], room[-1]
    size = norm(residual)
    done = 0
    while size > bound and done < max_iterations:
        start = size
        np.divide(residual, size, out=basis[0])
        hessenberg = np.zeros((most, most + 1))  # by columns of the usual matrix
        turns = np.zeros((most, 2))
        right = np.zeros(most + 1)
        right[0] = size
        count = 0
        while count < min(most, max_iterations - done) and size > bound:
            w = basis[count + 1]
            precondition(basis[count], z, w)
            column = hessenberg[count]
            products(basis, count + 1, w, column)
            length = add_combination(basis, count + 1, -column, w)
            if not np.isfinite(length):
                return done + count, np.inf
            column[count + 1] = length
            if length > 0.0:
                w /= length
            for j, (c, s) in enumerate(turns[:count]):
                column[j], column[j + 1] = (
                    c * column[j] + s * column[j + 1],
                    c * column[j + 1] - s * column[j],
                )
            length = np.hypot(column[count], column[count + 1])
            if length == 0.0:
                break
            c, s = turns[count] = column[count] / length, column[count + 1] / length
            column[count], column[count + 1] = length, 0.0
            right[count], right[count + 1] = c * right[count], -s * right[count]
            count += 1
            size = abs(right[count])
        if count == 0:
            break
        done += count
        factors = np.linalg.solve(hessenberg[:count, :count].T, right[:count])
        part[:] = 0.0
        add_combination(basis, count, factors, part)
        precondition(part, z, basis[0])
        solution += z
        residual -= basis[0]
        size = norm(residual)
        if not size < start:
            break
    return done, size
