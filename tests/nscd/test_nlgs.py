# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gauss-Seidel on plates, tetrahedra and loose bodies against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from plates import crossed_plate
from point_mass import PointMass
from solving import solve

from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb
from xper_fx.nscd.points import InteractionPoints, frame_from_normal
from xper_fx.nscd.solvers import AcceleratedSweeps, NonlinearGaussSeidel, accelerated
from xper_fx.nscd.solvers.sweeps import amplification
from xper_fx.support.saved_rows import Rows

SIZE, STEP, THETA = 5e-6, 3e-11, 0.5
BOND = CohesiveZone(2e18, 0.5, 1e9)


# -- dense reference, from points and blocks alone


def dense_w(inverse):
    """w over all slots, the ground's included."""
    w = np.zeros((inverse.num_slots * inverse.dim,) * 2)
    for first, last, start in zip(
        inverse.node_offsets[:-1] * inverse.dim,
        inverse.node_offsets[1:] * inverse.dim,
        inverse.data_offsets[:-1],
        strict=True,
    ):
        n = last - first
        w[first:last, first:last] = inverse.data[start : start + n * n].reshape(n, n)
    return w


def dense_h(points, num_slots):
    """H, shape (num_slots * dim, num_points * dim); zero along tangents that frames lack."""
    dim = points.dim
    h = np.zeros((num_slots * dim, len(points) * dim))
    for p in range(len(points)):
        for side, sign in ((0, 1.0), (1, -1.0)):
            for node, weight in zip(points.nodes[p, side], points.weights[p, side], strict=True):
                axes = points.frame[p].T
                h[node * dim : node * dim + dim, p * dim : p * dim + axes.shape[1]] += (
                    sign * weight * axes
                )
    return h


def project(r, mu):
    size = np.linalg.norm(r[1:])
    if r[0] >= 0.0 and size <= mu * r[0]:
        return r
    if mu * size <= -r[0]:
        return np.zeros_like(r)
    normal = (r[0] + mu * size) / (1.0 + mu * mu)
    return np.concatenate([[normal], mu * normal * r[1:] / size])


def dense_contact(w, u_free, mu, dim, v_min=0.0, sweeps=20000):
    """Projected block relaxation on the natural map, until nothing moves."""
    r = np.zeros(len(u_free))
    count = len(r) // dim
    rho = [1.0 / np.linalg.eigvalsh(w[i : i + dim, i : i + dim])[-1] for i in range(0, len(r), dim)]
    for _ in range(sweeps):
        largest = 0.0
        for p in range(count):
            rows = slice(p * dim, (p + 1) * dim)
            u = u_free[rows] + w[rows] @ r
            u[0] += mu * np.linalg.norm(u[1:]) - v_min
            new = project(r[rows] - rho[p] * u, mu)
            largest = max(largest, np.abs(new - r[rows]).max())
            r[rows] = new
        if largest <= 1e-13 * np.abs(r).max():
            return r
    raise AssertionError("the reference did not converge")


# -- scenes


def plate_scene(n, law, *, step=STEP, fixed=None, seed=0, speed=1.0, inverse=None):
    """A plate whose cells fly apart or together at random; interactions and free velocity."""
    plate = crossed_plate(n, SIZE)
    if inverse is None:
        inverse = plate.inverse(step, THETA, fixed)
    rng = np.random.default_rng(seed)
    laws = law if isinstance(law, list) else [law]
    which = rng.integers(0, len(laws), len(plate.points))
    scene = Interactions(plate.points, laws, which, inverse)
    free = np.zeros(inverse.num_slots * 2)
    free[: inverse.num_nodes * 2] = speed * rng.normal(size=inverse.num_nodes * 2)
    scene.begin_step(step, THETA)
    return scene, free


def tetrahedra_scene(law, k=1):
    """Two stacked cubes' worth of random bodies of 4 nodes in 3D, k nodes a side."""
    rng = np.random.default_rng(4)
    bodies, pairs = 6, 18
    a = rng.normal(size=(bodies, 12, 12))
    blocks = 1e8 * (a @ a.transpose(0, 2, 1) / 12 + np.eye(12))
    inverse = BodyInverse.from_uniform(blocks, 3)
    first = rng.integers(0, bodies, pairs)
    second = (first + rng.integers(1, bodies, pairs)) % bodies
    second[:4] = bodies  # on the ground
    nodes = np.stack(
        [4 * first[:, None] + rng.permuted(np.tile(np.arange(4), (pairs, 1)), axis=1)[:, :k],
         4 * second[:, None] + rng.permuted(np.tile(np.arange(4), (pairs, 1)), axis=1)[:, :k]],
        axis=1,
    )  # fmt: skip
    weights = rng.dirichlet(np.ones(k), size=(pairs, 2))
    normal = rng.normal(size=(pairs, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = InteractionPoints(
        nodes.astype(np.int32), weights, frame_from_normal(normal),
        rng.uniform(0.5e-6, 1e-6, pairs), np.zeros(pairs),
    )  # fmt: skip
    scene = Interactions(points, [law], np.zeros(pairs, int), inverse)
    free = np.zeros(inverse.num_slots * 3)
    free[: bodies * 12] = rng.normal(size=bodies * 12)
    scene.begin_step(STEP, THETA)
    return scene, free


def flat_impulses(scene):
    return scene.gather("impulse").ravel()


def check_velocity(scene, free, velocity):
    """velocity = v_free + w H r, the ground still, H r without resultant."""
    points, inverse = scene.points, scene.inverse
    h, w = dense_h(points, inverse.num_slots), dense_w(inverse)
    p = h @ flat_impulses(scene)
    np.testing.assert_allclose(velocity, free + w @ p, rtol=0, atol=1e-11 * np.abs(velocity).max())
    assert not velocity[inverse.num_nodes * inverse.dim :].any()
    nodal = scene.impulses()
    np.testing.assert_allclose(nodal.ravel(), p, rtol=0, atol=1e-12 * np.abs(p).max())
    assert np.abs(nodal.sum(axis=0)).max() <= 1e-12 * np.abs(nodal).sum()


def elastic_reference(scene, free):
    """Intact bonds: (I + W k) u = H^T v_free with r = -k u from a jump of zero at rest."""
    points = scene.points
    h = dense_h(points, scene.inverse.num_slots)
    w = h.T @ dense_w(scene.inverse) @ h
    k = np.repeat(STEP**2 * THETA**2 * points.area * BOND.normal_stiffness, points.dim)
    u = np.linalg.solve(np.eye(len(w)) + w * k, h.T @ free)
    return -k * u, u


# -- the answers


@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_compliance_of_a_point_is_dense(dim, k):
    scene = tetrahedra_scene(BOND, k)[0] if dim == 3 else gauss_scene(k, BOND, True)[0]
    h = dense_h(scene.points, scene.inverse.num_slots)
    w = h.T @ dense_w(scene.inverse) @ h
    rows, cols = sym_indices(dim)
    packed = scene.gather("compliance")
    for p in range(len(scene.points)):
        block = w[p * dim : (p + 1) * dim, p * dim : (p + 1) * dim]
        np.testing.assert_allclose(
            packed[p], block[rows, cols], rtol=0, atol=1e-13 * np.abs(block).max()
        )


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("dim", [2, 3])
def test_compliance_of_a_diagonal_is_dense(dim, k):
    """Points on several nodes, each with a w of its own: weights count twice."""
    rng = np.random.default_rng(6)
    entries = rng.uniform(1.0, 3.0, (16, dim))
    inverse = BodyInverse.of_nodes(entries, dim)
    first = np.array([0, 1, 2, 0, 3])
    second = np.array([1, 2, 3, 2, 4])  # the last on the ground
    nodes = np.zeros((5, 2, k), np.int32)
    for p in range(5):
        nodes[p, 0] = 4 * first[p] + rng.permutation(4)[:k]
        nodes[p, 1] = 16 if second[p] == 4 else 4 * second[p] + rng.permutation(4)[:k]
    normal = rng.normal(size=(5, dim))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = InteractionPoints(
        nodes, rng.dirichlet(np.ones(k), size=(5, 2)), frame_from_normal(normal), np.ones(5),
        np.zeros(5),
    )  # fmt: skip
    scene = Interactions(points, [BOND], np.zeros(5, int), inverse)
    h = dense_h(points, inverse.num_slots)
    w = (h.T * np.append(entries.ravel(), np.zeros(dim))) @ h
    rows, cols = sym_indices(dim)
    for own, p in zip(scene.groups[0].compliance, scene.groups[0].indices, strict=True):
        block = w[p * dim : (p + 1) * dim, p * dim : (p + 1) * dim]
        np.testing.assert_allclose(own, block[rows, cols], atol=1e-13)


def gauss_scene(k, law, uniform):
    """Bodies of unequal sizes (2, 3, 3, 4 nodes; or 3 each) in 2D, k nodes a side."""
    rng = np.random.default_rng(8)
    sizes = [3, 3, 3, 3, 3] if uniform else [2, 3, 3, 4, 3]
    blocks = []
    for size in sizes:
        a = rng.normal(size=(2 * size, 2 * size))
        blocks.append(1e8 * (a @ a.T / (2 * size) + np.eye(2 * size)))
    inverse = (
        BodyInverse.from_uniform(np.array(blocks), 2)
        if uniform
        else BodyInverse.from_blocks(blocks, 2)
    )
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    pairs = [(1, 2), (2, 4), (1, 4), (4, 2), (2, 1)]  # bodies of 3 nodes only, not the first ones
    pairs += [(0, 1), (3, 2), (0, 5), (1, 5), (5, 3)]  # 5 is the ground
    nodes = np.zeros((len(pairs), 2, k), np.int32)
    for p, pair in enumerate(pairs):
        for s, body in enumerate(pair):
            if body == 5:
                nodes[p, s] = offsets[-1]
            else:
                nodes[p, s] = offsets[body] + rng.permutation(sizes[body])[:k]
    normal = rng.normal(size=(len(pairs), 2))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = InteractionPoints(
        nodes, rng.dirichlet(np.ones(k), size=(len(pairs), 2)), frame_from_normal(normal),
        rng.uniform(0.5e-6, 1e-6, len(pairs)), np.zeros(len(pairs)),
    )  # fmt: skip
    # two laws, so that one group sees bodies of one size only
    which = np.array([0] * 5 + [1] * 5)
    laws = [law, CohesiveZone(2e18, 0.5, 1e9, friction=0.1)]
    scene = Interactions(points, laws, which, inverse)
    free = np.zeros(inverse.num_slots * 2)
    free[: inverse.num_nodes * 2] = 0.01 * rng.normal(size=inverse.num_nodes * 2)
    scene.begin_step(STEP, THETA)
    return scene, free


@pytest.mark.parametrize("uniform", [True, False])
@pytest.mark.parametrize("k", [1, 2])
def test_bodies_of_equal_and_unequal_sizes(k, uniform):
    """Elastic bonds through w blocks of any size, nodal and Gauss points."""
    scene, free = gauss_scene(k, BOND, uniform)
    v = free.copy()
    report = solve(scene, v, tolerance=1e-13, num_threads=1)
    assert report.converged or report.residual < 1e-14
    check_velocity(scene, free, v)
    points = scene.points
    h = dense_h(points, scene.inverse.num_slots)
    u = (h.T @ v).reshape(-1, 2)
    r = flat_impulses(scene).reshape(-1, 2)
    stiff = STEP**2 * THETA**2 * points.area * BOND.normal_stiffness
    hat = r + stiff[:, None] * u
    scale = np.abs(r).max()
    opened = u[:, 0] > 1e-9
    assert opened.any() and not opened.all()
    assert np.abs(hat[opened]).max() <= 1e-10 * scale
    assert np.all(hat[:, 0] >= -1e-10 * scale)
    assert np.all(u[:, 0] >= -1e-10)


def test_uniform_and_ragged_storage_give_the_same_answer():
    plate = crossed_plate(3, SIZE)
    inverse = plate.inverse(STEP, THETA)
    size = inverse.uniform_size
    blocks = inverse.data.reshape(-1, size, size)[:-1]
    ragged = BodyInverse.from_blocks(list(blocks), 2)
    assert size == 6 and ragged.uniform_size == 0
    answers = []
    for stored in (inverse, ragged):
        scene, free = plate_scene(3, [BOND, SignoriniCoulomb(0.3)], inverse=stored)
        solve(scene, free, tolerance=1e-12, num_threads=1)
        answers.append(flat_impulses(scene))
    np.testing.assert_allclose(
        answers[0], answers[1], rtol=0, atol=1e-11 * np.abs(answers[0]).max()
    )


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("n", [3, 5])
def test_elastic_plate_is_a_linear_solve(n, fixed):
    """Cells flying apart (all bonds in tension or shear): one dense linear system."""
    plate = crossed_plate(n, SIZE)
    held = (plate.x[..., 1].ravel() < 1e-12).repeat(2) if fixed else None
    inverse = plate.inverse(STEP, THETA, held)
    scene = Interactions(plate.points, [BOND], np.zeros(len(plate.points), int), inverse)
    free = np.zeros(inverse.num_slots * 2)
    x = plate.x.mean(axis=1, keepdims=True).repeat(3, axis=1)  # each cell with its centre's speed
    free[: 2 * inverse.num_nodes] = (1e4 * x).ravel()
    if fixed:
        free[: 2 * inverse.num_nodes][held] = 0.0
    scene.begin_step(STEP, THETA)
    expected, u = elastic_reference(scene, free)
    opening = u.reshape(-1, 2)[:, 0]
    assert (opening >= -1e-12 * opening.max()).all(), "the reference holds no contact"
    v = free.copy()
    report = solve(scene, v, tolerance=1e-12, num_threads=1)
    assert report.converged
    np.testing.assert_allclose(
        flat_impulses(scene), expected, rtol=0, atol=1e-10 * np.abs(expected).max()
    )
    check_velocity(scene, free, v)
    assert scene.commit(v).cohesion == 0.0


@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_contact_in_3d_against_a_dense_projected_solve(mu, k):
    scene, free = tetrahedra_scene(SignoriniCoulomb(friction=mu), k)
    h = dense_h(scene.points, scene.inverse.num_slots)
    w = h.T @ dense_w(scene.inverse) @ h
    expected = dense_contact(w, h.T @ free, mu, 3)
    v = free.copy()
    report = solve(scene, v, tolerance=1e-13, num_threads=1)
    assert report.converged or report.residual < 1e-14
    # impulses need not be unique, velocities are
    np.testing.assert_allclose(h.T @ v, h.T @ free + w @ expected, rtol=0, atol=1e-9)
    check_velocity(scene, free, v)
    assert (np.abs(expected.reshape(-1, 3)[:, 0]) > 0).sum() > 3


def test_frictional_plate_against_a_dense_projected_solve():
    scene, free = plate_scene(3, SignoriniCoulomb(friction=0.3))
    h = dense_h(scene.points, scene.inverse.num_slots)
    w = h.T @ dense_w(scene.inverse) @ h
    expected = h.T @ free + w @ dense_contact(w, h.T @ free, 0.3, 2)
    v = free.copy()
    assert solve(scene, v, tolerance=1e-12, num_threads=1).converged
    np.testing.assert_allclose(h.T @ v, expected, rtol=0, atol=1e-9)
    check_velocity(scene, free, v)


def test_perfectly_bonded_plate_moves_as_one():
    """Dual Schur: momentum, and no jump anywhere; impulses at a vertex are redundant."""
    scene, free = plate_scene(3, PerfectBond())
    v = free.copy()
    assert solve(scene, v, tolerance=1e-11, num_threads=1).converged
    h = dense_h(scene.points, scene.inverse.num_slots)
    assert np.abs(h.T @ v).max() <= 1e-9
    check_velocity(scene, free, v)
    # the velocity minimises the kinetic-elastic distance to v_free among those without a jump
    a = np.linalg.inv(dense_w(scene.inverse)[:-6, :-6])
    hb = h[:-6]
    u, s, _ = np.linalg.svd(hb)
    free_motions = u[:, np.linalg.matrix_rank(hb) :]
    q = np.linalg.solve(free_motions.T @ a @ free_motions, free_motions.T @ a @ free[:-6])
    np.testing.assert_allclose(v[:-6], free_motions @ q, rtol=0, atol=1e-8)


# -- threads, relaxation, tolerance, warm start


def mixed_scene(n=6, speed=0.5):
    laws = [CohesiveZone(2e18, 0.5, 1e9, friction=0.3), SignoriniCoulomb(0.2), PerfectBond()]
    return plate_scene(n, laws, speed=speed)


def test_threads_do_not_change_a_bit():
    answers = []
    for threads in (1, 2):
        scene, free = mixed_scene()
        report = solve(scene, free, tolerance=1e-6, num_threads=threads)
        assert report.converged
        answers.append((flat_impulses(scene), free, report.sweeps))
    np.testing.assert_array_equal(answers[0][0], answers[1][0])
    np.testing.assert_array_equal(answers[0][1], answers[1][1])
    assert answers[0][2] == answers[1][2]


def test_relaxation_changes_the_sweeps_not_the_answer():
    answers, sweeps = [], []
    for relaxation in (0.7, 1.0, 1.3):
        scene, free = plate_scene(5, BOND, step=2e-10, speed=0.01)
        report = solve(scene, free, tolerance=1e-11, relaxation=relaxation, num_threads=1)
        assert report.converged
        answers.append(flat_impulses(scene))
        sweeps.append(report.sweeps)
    scale = np.linalg.norm(answers[0])
    for other in answers[1:]:
        assert np.linalg.norm(other - answers[0]) <= 1e-9 * scale
    assert sweeps[0] > sweeps[1] > sweeps[2], sweeps


@pytest.mark.parametrize("step", [3e-11, 3e-10, 1e-9])
def test_the_tolerance_means_the_error(step):
    """The error against a converged solution is at most a few times what was asked for."""
    scene, start = plate_scene(5, BOND, step=step, speed=1e-3)
    free = start.copy()
    assert solve(scene, free, tolerance=1e-13, num_threads=1, max_sweeps=100_000).converged
    exact = flat_impulses(scene)
    for tolerance in (1e-2, 1e-4, 1e-6):
        scene, free = plate_scene(5, BOND, step=step, speed=1e-3)
        report = solve(scene, free, tolerance=tolerance, num_threads=1, max_sweeps=100_000)
        assert report.converged and report.residual <= tolerance
        error = np.linalg.norm(flat_impulses(scene) - exact) / np.linalg.norm(exact)
        assert error <= 5.0 * tolerance, (error, report)


def test_amplification_of_a_geometric_series_is_what_is_left():
    assert amplification(np.array([0.5])) == np.inf
    assert amplification(np.array([0.5, 0.0])) == 1.0
    rho = 0.99
    changes = [rho**i for i in range(20)]
    assert amplification(np.array(changes)) == pytest.approx(rho / (1 - rho), rel=1e-6)
    assert amplification(np.full(6, 1e-3)) == np.inf
    assert amplification(np.array([0.0, 1e-3])) == np.inf  # tiles at rest that others moved


@pytest.mark.parametrize("solver", [NonlinearGaussSeidel, AcceleratedSweeps])
def test_impulses_that_are_rounding_are_not_sought(solver):
    """Bodies that fly side by side at 1 km/s push each other by the rounding of velocities."""
    scene, free = plate_scene(5, BOND, step=3e-10, speed=0.0)
    rng = np.random.default_rng(2)
    moving = scene.inverse.num_nodes * 2
    free[:moving] = 1e3 * (1.0 + np.finfo(float).eps * rng.integers(-1, 2, moving))
    report = solve(scene, free, solver, tolerance=1e-9, num_threads=1)
    assert report.converged and report.sweeps <= 3


def test_sweeps_that_go_to_and_fro_have_not_converged(monkeypatch):
    """Each second one leads back to where it was: four in a row change nothing."""
    scene, free = plate_scene(5, BOND, step=3e-10)

    def turn_round(interactions, sweep, velocity):
        impulse = interactions.groups[0].impulse
        sweep.stats[:, 0] = 4.0 * np.vdot(impulse, impulse) / len(sweep.stats)
        impulse *= -1.0

    scene.groups[0].impulse[:] = 1.0
    monkeypatch.setattr(accelerated, "sweep_ranks", turn_round)
    assert not solve(scene, free, AcceleratedSweeps, tolerance=1e-9, num_threads=1).converged


@pytest.mark.parametrize("masses", [[np.inf], [np.inf, np.inf]])
def test_points_between_bodies_that_are_driven(masses):
    """Nothing that impulses do calls for another visit: it comes all the same."""
    velocity = np.zeros((len(masses), 2))
    velocity[0, 0] = 0.5 * BOND.elastic_opening / STEP
    bond = PointMass(BOND, masses, velocity, area=1e-6)
    for count in (1, 2, 3):
        bond.step(STEP)
        assert bond.report.converged and bond.report.sweeps < 100
        pull = -bond.impulse[0] / (STEP * 1e-6)
        if count < 3:  # elastic still, with the opening at the middle of the step
            middle = (count - 0.5) * 0.5 * BOND.elastic_opening
            assert pull == pytest.approx(BOND.normal_stiffness * middle, rel=1e-9)
    assert 0.0 < bond.damage < 1.0


def test_warm_start_from_the_answer_is_immediate():
    scene, free = mixed_scene()
    velocity = free.copy()
    first = solve(scene, velocity, tolerance=1e-6, num_threads=1)
    again = free.copy()
    second = solve(scene, again, tolerance=1e-4, num_threads=1)
    assert second.sweeps <= 3 < first.sweeps
    np.testing.assert_allclose(again, velocity, rtol=0, atol=1e-3 * np.abs(velocity).max())
    # the next step starts from these impulses, scaled by the step
    before = flat_impulses(scene)
    scene.commit(velocity)
    scene.begin_step(0.5 * STEP, THETA)
    np.testing.assert_array_equal(flat_impulses(scene), 0.5 * before)


def test_a_saved_layer_goes_on_as_it_was():
    """Jumps, velocities, histories, impulses and their step, into points just made."""
    scene, free = mixed_scene()
    velocity = free.copy()
    solve(scene, velocity, tolerance=1e-6, num_threads=1)
    scene.commit(velocity)
    saved = {n: v.in_order() if isinstance(v, Rows) else v for n, v in scene.saved().items()}
    again, _ = mixed_scene()
    names = ("jump", "velocity", "impulse", "status", "energy", "damage", "opening_max")
    assert not np.array_equal(again.gather("jump"), scene.gather("jump"))
    again.restore(saved)
    for name in names:
        np.testing.assert_array_equal(again.gather(name), scene.gather(name), err_msg=name)
    for step in (STEP, 0.5 * STEP):  # impulses of the last step, scaled to the next one's size
        for layer in (scene, again):
            layer.begin_step(step, THETA)
        assert flat_impulses(scene).any()
        np.testing.assert_array_equal(flat_impulses(again), flat_impulses(scene))
    answers = []
    for layer in (scene, again):
        velocity = free.copy()
        solve(layer, velocity, tolerance=1e-6, num_threads=1)
        answers.append((velocity, *layer.commit(velocity, static=True)))
    np.testing.assert_equal(answers[0], answers[1])


def test_the_change_of_traction_is_that_of_the_last_sweep():
    """The largest |dr| / (h area) of a point, from impulses before and after that sweep."""
    options = {"tolerance": 1e-4, "num_threads": 1}
    found = []
    for fewer in (0, 1):
        scene, free = plate_scene(5, BOND, step=3e-10, speed=1e-3)
        if fewer:
            options["max_sweeps"] = report.sweeps - 1  # noqa: F821 - of the first round
        report = solve(scene, free, **options)
        assert report.converged == (not fewer)
        found.append((report.traction_change, scene.gather("impulse")))
    change = np.linalg.norm(found[0][1] - found[1][1], axis=1)
    expected = (change / (scene.step_size * scene.gather("area"))).max()
    assert expected > 0.0
    assert found[0][0] == pytest.approx(expected, rel=1e-5)


def test_not_converged_is_reported():
    scene, free = mixed_scene()
    report = solve(scene, free, tolerance=1e-12, max_sweeps=3, num_threads=1)
    assert not report.converged
    assert report.sweeps == 3
    assert report.residual > 1e-12


def test_infinite_velocities_end_the_solve():
    scene, free = mixed_scene(3)
    free[5] = np.nan
    report = solve(scene, free, num_threads=1, max_sweeps=50)
    assert not report.converged and report.sweeps < 50


def test_no_points():
    plate = crossed_plate(2, SIZE)
    empty = plate.points.take(np.zeros(0, int))
    inverse = plate.inverse(STEP, THETA)
    scene = Interactions(empty, [BOND], np.zeros(0, int), inverse)
    scene.begin_step(STEP, THETA)
    v = np.arange(inverse.num_slots * 2, dtype=float)
    assert solve(scene, v, num_threads=1).converged
    np.testing.assert_array_equal(v, np.arange(inverse.num_slots * 2))
    assert not scene.impulses().any()
    assert sum(scene.commit(v)) == 0.0


def test_wrong_laws_are_refused():
    plate = crossed_plate(2, SIZE)
    inverse = plate.inverse(STEP, THETA)
    with pytest.raises(ValueError, match="one law a point"):
        Interactions(plate.points, [BOND], np.zeros(3, int), inverse)
    for bad in (1, -1):
        with pytest.raises(ValueError, match="laws given"):
            Interactions(plate.points, [BOND], np.full(len(plate.points), bad), inverse)
