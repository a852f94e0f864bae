# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact without friction has its normal component alone, and the answers of contact with it."""

from __future__ import annotations

import numpy as np
import pytest
from plates import crossed_plate
from test_nlgs import STEP, check_velocity, plate_scene, tetrahedra_scene

from xper_fx.nscd import newton, nlgs, vertex_blocks
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse import BodyInverse
from xper_fx.nscd.laws import SignoriniCoulomb, Tresca
from xper_fx.nscd.points import InteractionPoints, frame_from_normal

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
    scalars = ("compliance", "jump", "velocity", "impulse", "committed_impulse", "energy", "terms",
               "parameters")  # fmt: skip
    for name in scalars:
        assert arrays[name].shape == (len(group), 1), name
    for frame in (arrays["points.frame"], arrays["couplings.frame"], scene.points.frame):
        assert frame.shape == (len(group), 1, dim)
    assert group.details.shape[1] == 0
    # the velocity level remembers what pushed, a closed gap is rounding; nothing remembers damage
    assert group.state.shape[1] == (1 if law.contact == "velocity" else 0)
    assert "damage" not in group.kernels.state_names
    assert scene.gather("impulse").shape == scene.gather("jump").shape == (len(group), dim)
    assert scene.gather("compliance").shape == (len(group), dim * (dim + 1) // 2)


def test_bytes_of_a_point():
    """In the plane: 8 for each scalar, two nodes, a normal, what leads to blocks of w; no more."""
    (group,) = plate_scene(6, SignoriniCoulomb())[0].groups
    tiles = sum(a.nbytes for a in group.ordering[1:])
    scalars = 8 * len(("number", "order", "e", "pushed", "least", "compliance", "jump", "velocity",
                       "impulse", "committed impulse", "impact", "area", "gap"))  # fmt: skip
    places = 4 * 2 * len(("node", "start", "body", "size", "row"))
    weights, normal, inverse_area, status = 16, 16, 4, 1
    expected = scalars + places + weights + normal + inverse_area + status
    assert group.nbytes - tiles - group.normal.nbytes == expected * len(group)
    (frictional,) = plate_scene(6, SignoriniCoulomb(0.3))[0].groups
    assert frictional.normal is None
    assert frictional.nbytes - tiles >= (expected + 100) * len(group)


@pytest.mark.parametrize("solve", [nlgs.solve, newton.solve])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_answer_is_that_of_friction_that_vanishes(dim, solve):
    answers = []
    for law in (SignoriniCoulomb(), ALMOST_NONE):
        scene, free = plate_scene(4, law) if dim == 2 else tetrahedra_scene(law, k=2)
        velocity = free.copy()
        assert solve(scene, velocity, tolerance=1e-12, num_threads=1).converged
        check_velocity(scene, free, velocity)
        work = scene.commit(velocity)
        scene.begin_step(STEP, 0.5)
        back = -0.5 * free
        solve(scene, back, tolerance=1e-12, num_threads=1)
        answers.append((velocity, back, scene.gather("impulse")[:, 0], work))
    (v, back, r, work), (v0, back0, r0, work0) = answers
    size = np.abs(v0).max()
    np.testing.assert_allclose(v, v0, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(back, back0, rtol=0, atol=1e-9 * size)
    assert np.count_nonzero(r) > 0 and np.abs(back + 0.5 * size).max() > 0.0
    np.testing.assert_allclose(work, work0, rtol=0, atol=1e-9 * size * np.abs(r0).sum())


def ragged_scene():
    """Bodies of 1 to 5 nodes in the plane, with chains of points and the ground."""
    rng = np.random.default_rng(7)
    sizes = np.array([2, 5, 1, 4, 3, 5])
    blocks = []
    for size in 2 * sizes:
        a = rng.normal(size=(size, size))
        blocks.append(a @ a.T / size + np.eye(size))
    first = np.concatenate([[0], np.cumsum(sizes)])
    pairs = np.array([(0, 1), (1, 3), (3, 4), (1, 5), (2, 5), (4, 6), (0, 3), (2, 4), (5, 6)] * 3)
    nodes = np.array(
        [[first[b] + rng.integers(sizes[b]) if b < 6 else first[6] for b in pair] for pair in pairs]
    )
    angle = rng.uniform(0, 2 * np.pi, len(pairs))
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = InteractionPoints(
        nodes[:, :, None].astype(np.int32), np.ones((len(pairs), 2, 1)), frame_from_normal(normal),
        np.ones(len(pairs)), np.zeros(len(pairs)),
    )  # fmt: skip
    inverse = BodyInverse.from_blocks(blocks, 2)
    scene = Interactions(points, [SignoriniCoulomb()], np.zeros(len(pairs), int), inverse)
    scene.begin_step(STEP, 0.5)
    free = np.zeros(inverse.num_slots * 2)
    free[:-2] = rng.normal(size=len(free) - 2)
    return scene, free


@pytest.mark.parametrize(
    "make", [lambda: plate_scene(4, SignoriniCoulomb()), ragged_scene], ids=["uniform", "ragged"]
)
def test_sweeps_by_normal_velocities_are_those_by_bodies(make):
    """The same sweeps to rounding, from a first guess, with new values of w too."""
    answers = []
    for by_bodies in (False, True):
        scene, free = make()
        (group,) = scene.groups
        assert group.normal is not None
        if by_bodies:
            group.normal = None
        first = free.copy()
        reports = [nlgs.solve(scene, first, tolerance=1e-11, num_threads=1)]
        doubled = scene.inverse.data * 2.0
        scene.update_inverse(BodyInverse(2, *(
            getattr(scene.inverse, n) if n != "data" else doubled
            for n in ("node_offsets", "data", "data_offsets")
        )))  # fmt: skip
        velocity = free.copy()
        reports.append(nlgs.solve(scene, velocity, tolerance=1e-11, num_threads=1))
        check_velocity(scene, free, velocity)
        answers.append((first, velocity, [r.sweeps for r in reports]))
    (first, velocity, sweeps), (first0, velocity0, sweeps0) = answers
    assert sweeps == sweeps0
    size = np.abs(first0).max()
    np.testing.assert_allclose(first, first0, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(velocity, velocity0, rtol=0, atol=1e-13 * size)


def test_nodes_of_many_points_are_swept_by_bodies():
    """A lumped mass has blocks of two numbers; the sides of a node are more."""
    plate = crossed_plate(3, 1.0)
    w = np.zeros((len(plate.mass) * 3, 2, 2))
    w[:, range(2), range(2)] = 1.0 / plate.mass.reshape(-1, 2)
    doubled = InteractionPoints(
        *(np.repeat(getattr(plate.points, n), 5, axis=0)
          for n in ("nodes", "weights", "frame", "area", "gap"))
    )  # fmt: skip
    inverse = BodyInverse.from_uniform(w, 2)
    scene = Interactions(doubled, [SignoriniCoulomb()], np.zeros(len(doubled), int), inverse)
    assert scene.groups[0].normal is None


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
