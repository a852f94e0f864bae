# SPDX-License-Identifier: LGPL-3.0-or-later
"""Large linear systems with a right preconditioner: Orthomin, and GMRES where it stalls.

**Orthomin** (Vinsome 1976; Eisenstat, Elman and Schultz 1983). Of a residual r, z = B r and
y = A z are made orthogonal to the images y_j of the last k directions,

    y -= s_j y_j,   z -= s_j z_j,   s_j = y_j . y / |y_j|^2,
    x += a z,       r -= a y,       a = y . r / |y|^2,

so that |r| falls as fast as along all directions where A B is symmetric (conjugate residuals: k = 1
is enough), and nearly so where only sliding with friction and the order of a sweep make it
unsymmetric: on half-broken plates of 40 x 40 to 160 x 160 quads iterations are as many as those of
GMRES. It reads few vectors in each, and keeps few. Where A B is far from symmetric it may stall.

**GMRES** (Saad and Schultz 1986; Saad 2003, section 9.3.2) does not, as it keeps all directions.

`scipy.sparse.linalg` is not called because its scalar products go through a threaded BLAS, whose
threads wait for each other at each: a whole Newton solve takes 1.1 to 1.4 times as long on a
machine at rest, 3 times where another process keeps one of two cores busy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from xper_fx.cache import njit

# Orthomin stalls if |r| stays above a share of what it was so many iterations before.
_PATIENCE, _STALLED = 5, 0.8
# Share of |y|^2 that images kept do not explain, below which it is rounding.
_ALIKE = 1e-10
# Entries of a vector that stay in the first cache beside those of others. Where their numbers are
# unsigned (`np.uintp`) loops over them are made of vectors.
_PIECE = 1024


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def square(x):
    """|x|^2, on this thread."""
    total = 0.0
    for i in range(len(x)):
        total += x[i] * x[i]
    return total


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def norm(x):
    """|x|, on this thread."""
    return np.sqrt(square(x))


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def products(rows, count, x, out):
    """out_j = rows_j . x for the first rows, four at a time and in pieces that stay in cache.

    As a kernel: threads of a BLAS wait for each other at every call, dearly on a busy machine.
    """
    for j in range(count):
        out[j] = 0.0
    for piece in range(0, len(x), _PIECE):
        first, last = np.uintp(piece), np.uintp(min(piece + _PIECE, len(x)))
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
    """x += sum_j factors_j rows_j for the first rows; returns |x|^2."""
    size = 0.0
    for piece in range(0, len(x), _PIECE):
        first, last = np.uintp(piece), np.uintp(min(piece + _PIECE, len(x)))
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
            size += x[i] * x[i]
    return size


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def _shares(images, kept, squares, new, residual, out):
    """out_k = y_k . y / |y_k|^2 of kept images and the new one; y . r / |y - sum out_k y_k|^2.

    The latter is NaN where y is one of the others but for rounding.
    """
    y = images[new]
    square, along = 0.0, 0.0
    for k in range(len(kept)):
        out[k] = 0.0
    for piece in range(0, len(residual), _PIECE):
        first, last = np.uintp(piece), np.uintp(min(piece + _PIECE, len(residual)))
        for k in range(len(kept)):
            j, total = kept[k], 0.0
            for i in range(first, last):
                total += images[j, i] * y[i]
            out[k] += total
        for i in range(first, last):
            square += y[i] * y[i]
            along += y[i] * residual[i]
    own = square
    for k in range(len(kept)):
        shared = out[k]
        out[k] /= squares[kept[k]]
        own -= out[k] * shared
    return along / own if own > _ALIKE * square else np.nan


@njit(fastmath=True, error_model="numpy", _nrt=False, nogil=True)
def _go_along(images, directions, kept, shares, new, factor, solution, residual):
    """Take shares of kept rows off the new ones; x += factor z, r -= factor y; |y|^2 and |r|."""
    y, z = images[new], directions[new]
    square, left = 0.0, 0.0
    for piece in range(0, len(residual), _PIECE):
        first, last = np.uintp(piece), np.uintp(min(piece + _PIECE, len(residual)))
        for k in range(len(kept)):
            j, share = kept[k], shares[k]
            for i in range(first, last):
                y[i] -= share * images[j, i]
                z[i] -= share * directions[j, i]
        for i in range(first, last):
            solution[i] += factor * z[i]
            value = residual[i] - factor * y[i]
            residual[i] = value
            square += y[i] * y[i]
            left += value * value
    return square, np.sqrt(left)


def orthomin(
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
        room: shape (2, k + 1, n), overwritten; images of k directions are kept. Nothing of the
            size of a vector is allocated: on some systems that costs more than the iteration.

    Returns:
        Iterations made, and the norm of the residual reached: above the bound where it stalls.
    """
    images, directions = room
    most = len(images)
    squares, shares = np.zeros(most), np.zeros(most)
    sizes, done = [norm(residual)], 0
    while sizes[-1] > bound and done < max_iterations:
        if done >= _PATIENCE and sizes[-1] > _STALLED * sizes[-1 - _PATIENCE]:
            break
        new = done % most
        kept = np.array([j for j in range(min(done, most)) if j != new], np.int64)
        precondition(residual, directions[new], images[new])
        factor = _shares(images, kept, squares, new, residual, shares)
        if not np.isfinite(factor):
            return done, np.inf
        squares[new], size = _go_along(
            images, directions, kept, shares, new, factor, solution, residual
        )
        sizes.append(size)
        done += 1
    return done, sizes[-1]


def gmres(
    precondition: Callable[[np.ndarray, np.ndarray, np.ndarray], None],
    residual: np.ndarray,
    solution: np.ndarray,
    bound: float,
    max_iterations: int,
    room: np.ndarray,
    total: Callable[[Any], Any] = lambda share: share,
) -> tuple[int, float]:
    """Reduce a residual, b - A x.

    Arguments and results are those of `orthomin`, but `room`: shape (m + 3, n), overwritten; m
    vectors are kept before a restart. Where ranks have parts of each vector `total` is the sum of
    what they have, numbers or arrays.
    """
    most = len(room) - 3
    basis, z, part = room[:-2], room[-2], room[-1]
    size = np.sqrt(total(square(residual)))
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
            column[: count + 1] = total(column[: count + 1])
            length = np.sqrt(total(add_combination(basis, count + 1, -column, w)))
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
        size = np.sqrt(total(square(residual)))
        if not size < start:
            break
    return done, size
