# SPDX-License-Identifier: LGPL-3.0-or-later
"""H of points between rigid bodies that have a normal alone, a side a body.

A side s of a point moves with six components of its body (2D: four, of which the last is nothing),
a velocity and a spin: u = sum over both sides of h . v, where h is s n for the velocity and
s (arm x n) for the spin, s = 1 of the candidate and -1 of the antagonist. A point on spins has
nodes of rotations and no arms: there s n is that of the spin.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.points import InteractionPoints


class NormalRows:
    """The rows of some points.

    Args:
        points: of rigid bodies and what is at rest, with a normal alone.
        first: node of the first rigid body; each has two.
        count: of the rigid bodies; other nodes are at rest.
    """

    def __init__(self, points: InteractionPoints, first: int, count: int):
        dim = points.dim
        self._body = np.empty((len(points), 2), int)
        self._rows = np.zeros((len(points), 2, 2 * dim))
        arms = points.lever_arms
        if arms is None:
            arms = np.zeros((len(points), 2, dim))
        _fill(points.nodes[:, :, 0], points.frame[:, 0], arms, first, count, self._body, self._rows)

    def closing(self, velocity: np.ndarray) -> np.ndarray:
        """u of each point, shape (num_points,), m/s or rad/s.

        Args:
            velocity: and spin of the bodies, flat.
        """
        found = np.empty(len(self._body))
        _take(self._body, self._rows, velocity, found)
        return found

    def pushed(self, blocks: np.ndarray) -> NormalRows:
        """Rows whose `push` adds what impulses of these change velocities by.

        Args:
            blocks: w of each body, shape (num_bodies, 2 dim, 2 dim).
        """
        other = object.__new__(NormalRows)
        other._body, other._rows = self._body, np.zeros_like(self._rows)
        _apply(self._body, self._rows, blocks, other._rows)
        return other

    def push(self, impulse: np.ndarray, velocity: np.ndarray) -> None:
        """Add to what bodies have, flat, the rows' share of each point's impulse."""
        _add(self._body, self._rows, impulse, velocity)

    def times(self, pushed: NormalRows) -> sp.csc_array:
        """H^T w H, shape (num_points, num_points), with its whole diagonal."""
        count = len(self._body)
        order = np.argsort(self._body, axis=None, kind="stable")
        starts = np.searchsorted(self._body.ravel()[order], np.arange(self._body.max() + 2))
        met = np.diff(starts)[self._body[self._body >= 0]].sum()
        ends, mark = np.zeros(count + 1, int), np.full(count, -1)
        row, value = np.empty(met + count, int), np.empty(met + count)
        columns = ends, row, value
        _multiply(self._body, self._rows, pushed._rows, (order, starts), mark, columns)
        return sp.csc_array((value[: ends[-1]], row[: ends[-1]], ends), (count, count))


@njit(**LEAN_ENTRY)
def _fill(nodes, normal, arms, first, count, body, rows):
    dim = normal.shape[1]
    for i in range(len(body)):
        for side in range(2):
            place = nodes[i, side] - first
            body[i, side] = place // 2 if 0 <= place < 2 * count else -1
            sign, spins = 1.0 - 2.0 * side, dim * (place % 2)
            arm, row = arms[i, side], rows[i, side]
            for k in range(dim):
                row[spins + k] = sign * normal[i, k]
            if spins == 0 and dim == 2:
                row[2] = sign * (arm[0] * normal[i, 1] - arm[1] * normal[i, 0])
            elif spins == 0:
                for k in range(3):
                    j, m = (k + 1) % 3, (k + 2) % 3
                    row[3 + k] = sign * (arm[j] * normal[i, m] - arm[m] * normal[i, j])


@njit(**LEAN_ENTRY)
def _take(body, rows, velocity, found):
    size = rows.shape[2]
    for i in range(len(body)):
        found[i] = 0.0
        for side in range(2):
            if body[i, side] >= 0:
                for k in range(size):
                    found[i] += rows[i, side, k] * velocity[size * body[i, side] + k]


@njit(**LEAN_ENTRY)
def _add(body, rows, impulse, velocity):
    size = rows.shape[2]
    for i in range(len(body)):
        for side in range(2):
            if body[i, side] >= 0:
                for k in range(size):
                    velocity[size * body[i, side] + k] += rows[i, side, k] * impulse[i]


@njit(**LEAN_ENTRY)
def _apply(body, rows, blocks, pushed):
    size = rows.shape[2]
    for i in range(len(body)):
        for side in range(2):
            if body[i, side] >= 0:
                block = blocks[body[i, side]]
                for k in range(size):
                    for j in range(size):
                        pushed[i, side, k] += block[k, j] * rows[i, side, j]


@njit(**LEAN_ENTRY)
def _multiply(body, rows, pushed, rows_of_body, mark, columns):
    """Column by column, its own row first; `mark` tells where a row of the column is."""
    (order, starts), (ends, row, value) = rows_of_body, columns
    for column in range(len(body)):
        first = ends[column]
        row[first], value[first], mark[column] = column, 0.0, first
        last = first + 1
        for side in range(2):
            here = body[column, side]
            if here < 0:
                continue
            for k in range(starts[here], starts[here + 1]):
                i, other = order[k] // 2, order[k] % 2
                if mark[i] < first:
                    mark[i], row[last], value[last] = last, i, 0.0
                    last += 1
                for j in range(rows.shape[2]):
                    value[mark[i]] += rows[i, other, j] * pushed[column, side, j]
        ends[column + 1] = last
