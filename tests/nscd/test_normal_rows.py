# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of points with a normal alone against the relative velocities of the points themselves."""

from __future__ import annotations

import numpy as np
import pytest

from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.rigid.normal_rows import NormalRows

FIRST, COUNT = 5, 4  # nodes of a mesh before the rigid bodies, and those
GROUND = FIRST + 2 * COUNT


def rows_of(dim: int):
    """Points of forces and moments, between bodies or a body and the ground, some of one pair."""
    rng = np.random.default_rng(dim)
    body = np.array([[0, 1], [1, 0], [1, 2], [3, -1], [-1, 2], [0, 1], [2, 3]])
    on_spins = np.array([0, 0, 0, 0, 1, 1, 1])
    nodes = np.where(body >= 0, FIRST + 2 * body + on_spins[:, None], GROUND)
    armed = (body >= 0) & (on_spins[:, None] == 0)
    arms = rng.normal(size=(len(body), 2, dim)) * armed[..., None]
    normal = rng.normal(size=(len(body), dim))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    if dim == 2:
        normal[on_spins == 1] = (1.0, 0.0)  # the spin is the first component
    points = InteractionPoints(
        nodes[:, :, None].astype(np.int32), np.ones((len(body), 2, 1)), normal[:, None],
        np.ones(len(body)), np.zeros(len(body)), arms,
    )  # fmt: skip
    return points, NormalRows(points, FIRST, COUNT), rng


@pytest.mark.parametrize("dim", [2, 3])
def test_rows_close_as_their_points_do(dim):
    points, rows, rng = rows_of(dim)
    nodal = np.zeros((GROUND + 1, dim))
    nodal[FIRST:GROUND] = rng.normal(size=(2 * COUNT, dim))
    found = rows.closing(nodal[FIRST:GROUND].ravel())
    np.testing.assert_allclose(found, points.relative(nodal)[:, 0], atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_matrix_is_what_impulses_do_to_the_rows(dim):
    """Column by column, with w of full blocks that are symmetric; impulses act as `nodal` says."""
    points, rows, rng = rows_of(dim)
    blocks = rng.normal(size=(COUNT, 2 * dim, 2 * dim))
    blocks = blocks @ blocks.transpose(0, 2, 1)
    if dim == 2:
        blocks[:, 3], blocks[:, :, 3] = 0.0, 0.0
    pushed = rows.pushed(blocks)
    matrix = rows.times(pushed)
    np.testing.assert_array_equal(matrix.indices[matrix.indptr[:-1]], np.arange(len(points)))
    for column in range(len(points)):
        unit = np.eye(len(points))[column]
        moved = np.zeros(2 * dim * COUNT)
        pushed.push(unit, moved)
        impulses = points.nodal(unit[:, None], GROUND)[FIRST:GROUND].reshape(COUNT, -1)
        expected = np.einsum("bij,bj->bi", blocks, impulses)
        np.testing.assert_allclose(moved.reshape(COUNT, -1), expected, atol=1e-13)
        found = matrix.toarray()[:, column]
        np.testing.assert_allclose(found, rows.closing(moved), atol=1e-13)
