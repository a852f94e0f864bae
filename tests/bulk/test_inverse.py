# SPDX-License-Identifier: LGPL-3.0-or-later
"""The inverses of the iteration matrix against a dense one, prescribed dofs cut out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import ufl
from dolfinx import fem
from scenes import BOTTOM, LEFT, box_bodies

from xper_fx.bulk.body_inverse import CellwiseInverse, ClusterInverse, LumpedInverse
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.sparse_blocks import BlockMatrix
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic


def stripes(x):
    return np.floor(1.4 * x[0])


def alike(x):
    return np.floor(x[0])


CASES = {
    "cells": ("crossed", (2, 1), (2, 1), 1, None),
    "cells P2": ("crossed", (2, 1), (2, 1), 2, None),
    "grains alike": ("crossed", (2, 1), (2, 1), 1, alike),
    "grains": ("crossed", (2, 1), (4, 2), 1, stripes),
    "grains P2": ("crossed", (2, 1), (4, 2), 2, stripes),
    "quadrilaterals": ("quadrilateral", (2, 1), (4, 2), 1, stripes),
    "tetrahedra": ("tetrahedron", (2, 1, 1), (2, 1, 1), 1, None),
    "grains of tetrahedra": ("tetrahedron", (2, 1, 1), (3, 1, 1), 2, stripes),
}


@pytest.fixture(params=CASES)
def problem(request):
    kind, lengths, cells, order, label = CASES[request.param]
    bodies = box_bodies(lengths, cells, kind, label)
    forms = BulkForms(bodies, order, {1: LinearElastic(100.0, 0.3, 1.0)})
    bulk = Bulk(forms, [PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(BOTTOM, 1, 1.0)])
    matrix = bulk.stiffness.copy()
    dense = matrix.to_scipy().toarray() + np.diag(bulk.mass)
    blocks = sp.bsr_array(dense, blocksize=(bulk.dim, bulk.dim))
    return bulk, BlockMatrix(blocks.data, blocks.indices, blocks.indptr), dense


def dense_inverse(dense, prescribed):
    free = np.flatnonzero(~prescribed)
    w = np.zeros_like(dense)
    w[np.ix_(free, free)] = np.linalg.inv(dense[np.ix_(free, free)])
    return w


def check(inverse, bulk, w):
    residual = np.random.default_rng(0).standard_normal(bulk.num_dofs)
    scale = np.abs(w).max()
    exact = w @ residual
    assert inverse.apply(residual) == pytest.approx(exact, abs=1e-12 * np.abs(exact).max())
    blocks = inverse.blocks
    assert blocks.num_nodes == len(inverse.nodes)
    covered = 0
    for b in range(len(blocks.node_offsets) - 2):
        own = inverse.nodes[blocks.node_offsets[b] : blocks.node_offsets[b + 1]]
        dofs = bulk.layout.dofs(own)
        data = blocks.data[blocks.data_offsets[b] : blocks.data_offsets[b + 1]]
        block = data.reshape(len(dofs), len(dofs))
        assert block == pytest.approx(w[np.ix_(dofs, dofs)], abs=1e-12 * scale)
        assert np.array_equal(block, block.T)
        # nothing couples this body to the rest
        rest = np.setdiff1d(bulk.layout.dofs(inverse.nodes), dofs)
        assert np.abs(w[np.ix_(dofs, rest)]).max(initial=0.0) < 1e-14 * scale
        covered += len(own)
    assert covered == len(inverse.nodes)
    assert inverse.nbytes > 0


def test_clusters(problem):
    """On every other node, and on all."""
    bulk, matrix, dense = problem
    w = dense_inverse(dense, bulk.layout.prescribed)
    for every in (1, 2):
        inverse = ClusterInverse(bulk.layout, bulk.layout.nodes[::every])
        inverse.factor(matrix)
        check(inverse, bulk, w)


def test_cellwise(problem):
    bulk, matrix, dense = problem
    if not bulk.layout.uniform:
        pytest.skip("bodies of different sizes")
    inverse = CellwiseInverse(bulk.layout)
    for factor in (2.0, 1.0):
        inverse.factor(replace(matrix, data=factor * matrix.data))
    check(inverse, bulk, dense_inverse(dense, bulk.layout.prescribed))


def test_lumped(problem):
    bulk, _, _ = problem
    some = bulk.layout.nodes[::3]
    inverse = LumpedInverse(bulk.layout, bulk.mass, some)
    check(inverse, bulk, np.diag(np.where(bulk.layout.prescribed, 0.0, 1.0 / bulk.mass)))


def test_lumped_mass_is_positive_and_whole(problem):
    bulk, _, _ = problem
    volume = 2.0
    assert bulk.mass.min() > 0.0
    assert bulk.mass.sum() == pytest.approx(bulk.dim * volume, rel=1e-12)


def test_lumped_mass_is_shared_as_the_consistent_one(problem):
    """Of all nodes of cells of one size in proportion to int N_i^2."""
    bulk, _, _ = problem
    V = bulk.forms.V
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    consistent = fem.assemble_matrix(fem.form(ufl.inner(u, v) * ufl.dx)).to_scipy().diagonal()
    # one factor for all makes it whole, as all cells are of one size and shape
    expected = consistent * (bulk.mass.sum() / consistent.sum())
    np.testing.assert_allclose(bulk.mass, expected, rtol=1e-10)
