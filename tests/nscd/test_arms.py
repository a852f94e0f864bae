# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points on rigid bodies: H with lever arms, against dense matrices."""

import numpy as np
import pytest

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.solvers import NewtonOnAllPoints, NonlinearGaussSeidel, SolveOptions
from xper_fx.nscd.solvers.shared_tangent import dofs_of_points, springs_of_points
from xper_fx.nscd.solvers.tangent import LinearisedProblem

COUNT, STEP = 5, 1e-2


def cloud(dim, friction=0.3, meshed=3):
    """Rigid bodies that point at each other at random, and a meshed body of three nodes or none."""
    rng = np.random.default_rng(7)
    mesh = rng.normal(size=(meshed * dim, meshed * dim))
    mesh = 0.1 * mesh @ mesh.T + np.eye(meshed * dim)
    turns = 1 if dim == 2 else 3
    rigid = np.zeros((COUNT, 2 * dim, 2 * dim))
    for block in rigid:
        spin = rng.normal(size=(turns, turns))
        block[:dim, :dim] = rng.uniform(0.5, 2.0) * np.eye(dim)
        block[dim : dim + turns, dim : dim + turns] = spin @ spin.T + np.eye(turns)
    normal = rng.normal(size=(12, dim))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    nodes, weights = np.zeros((12, 2, 3), np.int32), np.zeros((12, 2, 3))
    lever_arms = rng.normal(size=(12, 2, dim))
    for p in range(12):
        a, b = rng.choice(COUNT, 2, replace=False)
        nodes[p] = meshed + 2 * np.array([[a], [b]])
        weights[p, :, 0] = 1.0
        if meshed and p % 3 == 0:  # the antagonist is the meshed body
            nodes[p, 1], weights[p, 1] = (0, 1, 2), rng.dirichlet(np.ones(3))
            lever_arms[p, 1] = 0.0
    points = InteractionPoints(
        nodes, weights, frame_from_normal(normal), np.ones(12), np.full(12, -1e-3), lever_arms
    )
    layer = Interactions(
        points, [SignoriniCoulomb(friction)], np.zeros(12, int),
        BodyInverse.from_blocks([mesh] if meshed else [], dim), rigid_blocks=rigid,
    )  # fmt: skip
    w = np.zeros((layer.inverse.num_slots * dim,) * 2)
    w[: meshed * dim, : meshed * dim] = mesh
    for b, block in enumerate(rigid):
        first = (meshed + 2 * b) * dim
        w[first : first + 2 * dim, first : first + 2 * dim] = block
    return layer, points, w, rng


def dense_map(points, slots):
    """H^T, row by row from the velocity of a body's point, v + omega x a."""
    dim, rows = points.dim, []
    for p in range(len(points)):
        row = np.zeros((dim, slots, dim))
        for s, sign in enumerate((1.0, -1.0)):
            for node, weight in zip(points.nodes[p, s], points.weights[p, s], strict=True):
                row[:, node] += sign * weight * np.eye(dim)
            arm = points.lever_arms[p, s]
            if arm.any():
                if dim == 2:
                    row[:, points.nodes[p, s, 0] + 1, 0] += sign * np.array([-arm[1], arm[0]])
                else:
                    row[:, points.nodes[p, s, 0] + 1] += sign * np.cross(np.eye(3), arm).T
        rows.append(points.frame[p] @ row.reshape(dim, -1))
    return np.concatenate(rows)


@pytest.mark.parametrize("dim", [2, 3])
def test_motion_impulses_and_compliances_are_those_of_dense_matrices(dim):
    layer, points, w, rng = cloud(dim)
    h = dense_map(points, layer.inverse.num_slots)
    v = rng.normal(size=w.shape[0])
    (group,) = layer.groups
    mine = points.relative(v.reshape(-1, dim))
    np.testing.assert_allclose(mine.ravel(), h @ v, atol=1e-13)
    r = rng.normal(size=mine.shape)
    np.testing.assert_allclose(
        points.nodal(r, layer.inverse.num_slots - 1).ravel(), h.T @ r.ravel(), atol=1e-13
    )
    group.impulse[:] = r[group.indices]
    np.testing.assert_allclose(layer.impulses().ravel(), h.T @ r.ravel(), atol=1e-13)
    moved = v.copy()
    layer.add_velocity(moved)
    np.testing.assert_allclose(moved, v + w @ h.T @ r.ravel(), atol=1e-12)
    whole = (h @ w @ h.T).reshape(12, dim, 12, dim)
    upper = np.triu_indices(dim)
    for own, p in zip(group.compliance, group.indices, strict=True):
        np.testing.assert_allclose(own, whole[p, :, p][upper], atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_springs_of_ranks_are_those_of_dense_matrices(dim):
    """H K H^T point by point, as `parallel/whole_matrix.py` adds it up; also of no points."""
    layer, points, _, rng = cloud(dim)
    h = dense_map(points, layer.inverse.num_slots)
    stiffness = rng.normal(size=(12, dim, dim))
    total = np.zeros((h.shape[1],) * 2)
    springs = springs_of_points(points, stiffness)
    for dofs, values in zip(dofs_of_points(points, dim), springs, strict=True):
        np.add.at(total, np.ix_(dofs, dofs), values)
    whole = np.zeros((12, dim, 12, dim))
    whole[np.arange(12), :, np.arange(12)] = stiffness
    expected = h.T @ whole.reshape(12 * dim, -1) @ h
    np.testing.assert_allclose(total, expected, atol=1e-12)
    none = points.take(np.zeros(0, int))
    assert dofs_of_points(none, dim).shape == (0, 8 * dim)
    assert springs_of_points(none, stiffness[:0]).shape == (0, 8 * dim, 8 * dim)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_sweeps_and_newton_find_impulses_that_obey_the_law(dim, friction):
    layer, points, w, rng = cloud(dim, friction)
    h = dense_map(points, layer.inverse.num_slots)
    free = rng.normal(size=w.shape[0])
    for solver in (NonlinearGaussSeidel(), NewtonOnAllPoints()):
        layer.begin_step(STEP, 0.5)
        for g in layer.groups:
            g.impulse[:] = 0.0
        v = free.copy()
        report = solver.solve(layer, v, SolveOptions(tolerance=1e-10))
        assert report.converged
        r = layer.gather("impulse")
        np.testing.assert_allclose(v, free + w @ h.T @ r.ravel(), atol=1e-9)
        u = points.relative(v.reshape(-1, dim))
        assert np.abs(np.minimum(u[:, 0], r[:, 0])).max() < 1e-7
        assert r[:, 0].max() > 0.1
        slip, push = u[:, 1:], r[:, 1:]
        bound = friction * r[:, 0]
        assert np.all(np.linalg.norm(push, axis=1) <= bound + 1e-8)
        power = np.einsum("pi,pi->p", push, slip)
        np.testing.assert_allclose(power, -bound * np.linalg.norm(slip, axis=1), atol=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_newton_of_rigid_bodies_takes_the_step_of_dense_matrices(dim, friction):
    """(w^-1 + H K H^T) dv = H g and dr = g - K H^T dv, with K and g of the points."""
    layer, points, w, rng = cloud(dim, friction, meshed=0)
    h = dense_map(points, layer.inverse.num_slots)
    layer.begin_step(STEP, 0.5)
    (group,) = layer.groups
    group.impulse[:] = np.abs(rng.normal(size=group.impulse.shape))
    v = rng.normal(size=w.shape[0])
    layer.add_velocity(v)
    problem = LinearisedProblem(layer)
    problem.linearise(v)
    ((_, stiffness, source, *_),) = problem.tangents.groups
    components = stiffness.shape[1]
    h = h.reshape(12, dim, -1)[group.indices, :components].reshape(12 * components, -1)
    springs = np.zeros((12 * components,) * 2)
    for i, block in enumerate(stiffness):
        own = slice(i * components, (i + 1) * components)
        springs[own, own] = block
    moves = w.diagonal() != 0.0
    matrix = np.linalg.inv(w[np.ix_(moves, moves)]) + (h.T @ springs @ h)[np.ix_(moves, moves)]
    expected = np.zeros(len(w))
    expected[moves] = np.linalg.solve(matrix, (h.T @ source.ravel())[moves])
    step = np.zeros_like(v)
    (change,), _ = problem.solve(step, 1e-12, 1)  # by its factors
    np.testing.assert_allclose(step, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(
        change.ravel(), source.ravel() - springs @ h @ expected, atol=1e-8 * np.abs(source).max()
    )
