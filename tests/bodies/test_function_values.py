# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of DOLFINx functions at positions."""

import numpy as np
import pytest
from dolfinx import fem
from scenes import mesh_of

from xper_fx.bodies.function_values import cells_at, function_values
from xper_fx.support.compat import geometry_dofmap, original_cells
from xper_fx.support.ranks import ALONE

KINDS = {"crossed": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


@pytest.mark.parametrize("size", [1e-6, 1.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_position_has_the_value_of_its_cell(kind, size):
    """Of cells that are no parallelograms, too, and as small as grains are."""
    dim, rng = KINDS[kind], np.random.default_rng(1)
    mesh = mesh_of((1.0,) * dim, (5, 4, 3)[:dim], kind)
    x = mesh.geometry.x
    x[:, 0] += 0.3 * x[:, 0] * x[:, 1]
    x *= size
    corners = x[geometry_dofmap(mesh)]
    count = len(corners)
    # with weights of like size positions are well within convex cells
    weights = rng.uniform(0.5, 1.0, (count, corners.shape[1]))
    inside = np.einsum("ck,ckd->cd", weights / weights.sum(axis=1, keepdims=True), corners)
    of_cell = fem.Function(fem.functionspace(mesh, ("DG", 0)))
    of_cell.x.array[:] = rng.normal(size=count)
    found = function_values(of_cell, inside.T, ALONE)[:, 0]
    np.testing.assert_array_equal(found, of_cell.x.array)
    assert np.isnan(function_values(of_cell, inside.T + 3.0 * size, ALONE)).all()
    # at a corner that of the cell with the lowest number among those that meet there
    nodes = geometry_dofmap(mesh)
    which, cell = cells_at(mesh, x)
    pairs = np.unique(np.column_stack([which, cell]), axis=0)
    wanted = np.column_stack([nodes.ravel(), np.repeat(np.arange(count), nodes.shape[1])])
    np.testing.assert_array_equal(pairs, np.unique(wanted, axis=0))
    number, lowest = original_cells(mesh), np.full(len(x), count)
    np.minimum.at(lowest, nodes, number[:, None])
    found = function_values(of_cell, x.T, ALONE)[:, 0]
    np.testing.assert_array_equal(found, of_cell.x.array[np.argsort(number)][lowest])
