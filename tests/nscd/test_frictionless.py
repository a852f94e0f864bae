# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact without friction has its normal component alone, and the answers of contact with it."""

from __future__ import annotations

import numpy as np
import pytest
from solving import solve
from test_nlgs import STEP, check_velocity, plate_scene, tetrahedra_scene

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import SignoriniCoulomb, Tresca
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.solvers import (
    NewtonOnAllPoints,
    NonlinearGaussSeidel,
    vertex_blocks,
)

ALMOST_NONE = SignoriniCoulomb(1e-300)


def arrays_of(group):
    """All arrays of a group by name, those of its points and couplings too."""
    named = {n: a for n, a in vars(group).items() if isinstance(a, np.ndarray)}
    named |= {f"points.{n}": a for n, a in vars(group.points).items()}
    return named | {f"couplings.{n}": a for n, a in group.couplings._asdict().items()}


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("law", [SignoriniCoulomb(), Tresca(0.0, contact="position")])
def test_no_array_has_a_tangential_column(law, dim):
    scene, _ = plate_scene(3, law) if dim == 2 else tetrahedra_scene(law)
    (group,) = scene.groups
    arrays = arrays_of(group)
    scalars = ("compliance", "jump", "velocity", "impulse", "committed_impulse", "energy", "terms")
    for name in scalars:
        assert arrays[name].shape == (len(group), 1), name
    for frame in (arrays["points.frame"], arrays["couplings.frame"], scene.points.frame):
        assert frame.shape == (len(group), 1, dim)
    assert group.details.shape[1] == 0
    # the velocity level has a restitution and remembers what pushed; nothing remembers damage
    impact = 1 if law.contact == "velocity" else 0
    assert group.state.shape[1] == group.parameters.shape[1] == impact
    assert "damage" not in group.kernels.state_names
    assert scene.gather("impulse").shape == scene.gather("jump").shape == (len(group), dim)
    assert scene.gather("compliance").shape == (len(group), dim * (dim + 1) // 2)


def test_bytes_of_a_point():
    """In the plane: 8 for each scalar, two nodes, a normal, what leads to blocks of w; no more."""
    (group,) = plate_scene(6, SignoriniCoulomb())[0].groups
    tiles = sum(a.nbytes for a in (*group.ordering[1:], *group.tile_bodies))
    numbers = 4 * len(("number", "order"))
    scalars = 8 * len(("e", "pushed", "least", "compliance", "jump", "velocity",
                       "impulse", "committed impulse", "impact", "area", "gap"))  # fmt: skip
    places = 4 * 2 * len(("node", "start", "body", "size", "row"))
    weights, normal, inverse_area, status = 16, 16, 4, 1
    expected = numbers + scalars + places + weights + normal + inverse_area + status
    assert group.nbytes - tiles == expected * len(group)
    (frictional,) = plate_scene(6, SignoriniCoulomb(0.3))[0].groups
    assert frictional.nbytes - tiles >= (expected + 100) * len(group)


@pytest.mark.parametrize("solver", [NonlinearGaussSeidel, NewtonOnAllPoints])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_answer_is_that_of_friction_that_vanishes(dim, solver):
    answers = []
    for law in (SignoriniCoulomb(), ALMOST_NONE):
        scene, free = plate_scene(4, law) if dim == 2 else tetrahedra_scene(law, k=2)
        velocity = free.copy()
        assert solve(scene, velocity, solver, tolerance=1e-12, num_threads=1).converged
        check_velocity(scene, free, velocity)
        work = scene.commit(velocity)
        scene.begin_step(STEP, 0.5)
        back = -0.5 * free
        solve(scene, back, solver, tolerance=1e-12, num_threads=1)
        answers.append((velocity, back, scene.gather("impulse")[:, 0], work))
    (v, back, r, work), (v0, back0, r0, work0) = answers
    size = np.abs(v0).max()
    np.testing.assert_allclose(v, v0, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(back, back0, rtol=0, atol=1e-9 * size)
    assert np.count_nonzero(r) > 0 and np.abs(back + 0.5 * size).max() > 0.0
    np.testing.assert_allclose(work, work0, rtol=0, atol=1e-9 * size * np.abs(r0).sum())


@pytest.mark.parametrize("solver", [NonlinearGaussSeidel, NewtonOnAllPoints])
@pytest.mark.parametrize("normal", [(0.6, 0.8), (0.0, 0.6, 0.8)])
def test_a_node_guided_across_the_normal_carries_nothing(normal, solver):
    """W_NN is rounding: an impulse that should stop the node would be as large as you like."""
    normal, dim = np.array(normal), len(normal)
    w = np.eye(dim) - (1.0 - 1e-15) * np.outer(normal, normal)
    inverse = BodyInverse.from_blocks([w], dim)
    points = InteractionPoints(
        np.array([[[0], [1]]], np.int32), np.ones((1, 2, 1)), frame_from_normal(normal[None]),
        np.ones(1), np.zeros(1),
    )  # fmt: skip
    scene = Interactions(points, [SignoriniCoulomb()], np.zeros(1, int), inverse)
    scene.begin_step(STEP, 0.5)
    free = np.concatenate([-normal, np.zeros(dim)])
    velocity = free.copy()
    solve(scene, velocity, solver, tolerance=1e-9, num_threads=1)
    assert not scene.gather("impulse").any() and np.array_equal(velocity, free)


def test_vertices_mix_points_of_one_and_of_three_components():
    """In space, frictionless points beside others at a vertex: the answer of sweeps."""
    from test_vertex_blocks import corner_points_3d, run, velocities

    points, x, inverse = corner_points_3d()
    laws = [SignoriniCoulomb(), SignoriniCoulomb(0.5)]
    law_of_point = np.arange(len(points)) % 2
    free = velocities(x, np.diag([1.0, -2.0, 0.5]), 0.5, steps=2)
    options = {"tolerance": 1e-11, "num_threads": 1}
    expected, _ = run(points, inverse, laws, law_of_point, free, by_vertex=False, **options)
    found, reports = run(points, inverse, laws, law_of_point, free, by_vertex=True, **options)
    assert all(r.converged for r in reports) and vertex_blocks._NEWTON_DOFS >= 24
    for (v0, *_), (v1, *_) in zip(expected, found, strict=True):
        np.testing.assert_allclose(v1, v0, rtol=0, atol=1e-8 * np.abs(v0).max())
