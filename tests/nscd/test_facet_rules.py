# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shares and shape functions at the points of facets, against polynomials; normals of mortars."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import factorial

from xper_fx.nscd.facets import facet_points, facet_shapes, nodal_shares
from xper_fx.nscd.mortar import nonmatching_points

# Nodes of the reference facets in barycentric coordinates, vertices first.
EDGES = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)]}


def reference_nodes(dim, k):
    """Barycentric coordinates of the nodes of a segment or triangle, shape (k, dim)."""
    vertices = np.eye(dim)
    if k == dim:
        return vertices
    return np.concatenate([vertices, [0.5 * (vertices[a] + vertices[b]) for a, b in EDGES[dim]]])


def monomial(b, powers):
    return np.prod(b ** np.array(powers), axis=1)


def mean_of(powers):
    """Mean over a simplex of a product of barycentric coordinates."""
    n = len(powers) - 1
    return factorial(n) * np.prod(factorial(powers)) / factorial(n + sum(powers))


def powers_of(dim, degree):
    return [p for p in itertools.product(range(degree + 1), repeat=dim) if sum(p) == degree]


# What each rule integrates exactly: linear facets and Simpson's rule.
@pytest.mark.parametrize("dim, k, degree", [(2, 2, 1), (2, 3, 3), (3, 3, 1)])
def test_nodal_shares_integrate_polynomials(dim, k, degree):
    b, shares = reference_nodes(dim, k), nodal_shares(dim, k)
    for powers in powers_of(dim, degree):
        assert shares @ monomial(b, powers) == pytest.approx(mean_of(powers), rel=1e-14)


def test_nodal_shares_of_a_quadratic_triangle_are_those_of_its_mass_matrix():
    """int N_i^2 over their sum, N_i = b (2 b - 1) at vertices and 4 b b' on edges."""
    vertex = 4 * mean_of((4, 0, 0)) - 4 * mean_of((3, 0, 0)) + mean_of((2, 0, 0))
    edge = 16 * mean_of((2, 2, 0))
    expected = np.repeat([vertex, edge], 3) / (3 * (vertex + edge))
    np.testing.assert_allclose(nodal_shares(3, 6), expected, rtol=1e-14)


@pytest.mark.parametrize("dim, k, degree", [(2, 2, 3), (2, 3, 5), (3, 3, 2), (3, 6, 4)])
def test_gauss_points_integrate_polynomials_and_interpolate_fields(dim, k, degree):
    rng = np.random.default_rng(3)
    b = reference_nodes(dim, k)
    nodes = np.arange(2 * k).reshape(1, 2, k)
    normal = np.eye(dim)[:1]
    points = facet_points(nodes, normal, np.array([0.3]), "gauss")
    shapes, share = facet_shapes(dim, k, "gauss"), points.area / 0.3
    np.testing.assert_array_equal(points.weights, np.stack([shapes, shapes], axis=1))
    at = shapes @ b
    for powers in powers_of(dim, degree):
        assert share @ monomial(at, powers) == pytest.approx(mean_of(powers), rel=1e-13)
    order = 1 if k == dim else 2  # of the fields that the nodes hold
    for powers in powers_of(dim, order):
        factor = rng.normal()
        field = factor * monomial(b, powers)
        np.testing.assert_allclose(shapes @ field, factor * monomial(at, powers), atol=1e-13)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    turns=st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=6),
    lengths=st.lists(st.floats(0.2, 3.0), min_size=7, max_size=7),
    rule=st.sampled_from(["mortar", "nodes"]),
)
def test_the_normal_of_a_node_is_that_of_the_surface_around_it(turns, lengths, rule):
    """Weighed by their lengths, the normals of two segments are that of the chord of both."""
    angle = np.cumsum([0.0, *turns])
    edges = np.array(lengths[: len(angle)])[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    chain = np.concatenate([np.zeros((1, 2)), np.cumsum(edges, axis=0)])
    count = len(chain)
    x = np.concatenate([chain, chain])
    candidates = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    up = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    inside = x[candidates].mean(axis=1) + 0.05 * up
    body = np.repeat([0, 1], count)
    points = nonmatching_points(x, candidates, candidates + count, inside, body, rule)
    first, last = np.maximum(np.arange(count) - 1, 0), np.minimum(np.arange(count) + 1, count - 1)
    chord = chain[last] - chain[first]
    expected = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(points.frame[:, 0], expected, atol=1e-12)
    # each with half of its segments, against the node that lies on it
    size = np.linalg.norm(edges, axis=1)
    np.testing.assert_allclose(points.area, 0.5 * (np.append(size, 0) + np.append(0, size)))
    np.testing.assert_allclose(points.relative(np.concatenate([chain, chain])), 0.0, atol=1e-9)


@pytest.mark.parametrize("rule", ["mortar", "nodes"])
def test_the_normal_of_a_ridge_is_that_of_its_areas(rule):
    """Four triangles around a node, two of them three times as large as the others."""
    rim = np.array([[1.0, 0.0, 0.0], [0.0, 3.0, -0.5], [-1.0, 0.0, 0.0], [0.0, -1.0, -1.0]])
    x = np.concatenate([np.zeros((1, 3)), rim])
    facets = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
    area = 0.5 * np.cross(x[facets[:, 1]], x[facets[:, 2]])
    inside = x[facets].mean(axis=1) - 0.1 * area / np.linalg.norm(area, axis=1, keepdims=True)
    both = np.concatenate([x, x])
    points = nonmatching_points(both, facets, facets + 5, inside, np.repeat([0, 1], 5), rule)
    normal = -area.sum(axis=0) / np.linalg.norm(area.sum(axis=0))
    np.testing.assert_allclose(points.frame[0, 0], normal, atol=1e-12)
    np.testing.assert_allclose(points.area[0], np.linalg.norm(area, axis=1).sum() / 3.0)
