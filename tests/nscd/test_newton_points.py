# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton, mixed sweeps and the choice between them against converged sweeps."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse.linalg
from plates import crossed_plate
from solving import solve
from test_nlgs import check_velocity, dense_h, dense_w, gauss_scene, tetrahedra_scene

from xper_fx.nscd.algebra.krylov import gmres, orthomin
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb, Tresca
from xper_fx.nscd.solvers import (
    AcceleratedSweeps,
    Automatic,
    NewtonOnAllPoints,
    NonlinearGaussSeidel,
    SolveOptions,
    accelerated,
    newton,
    tangent,
)
from xper_fx.nscd.solvers.clusters import facing_clusters
from xper_fx.nscd.solvers.linearised import Linearised
from xper_fx.nscd.solvers.tangent import LinearisedProblem

SIZE, THETA = 50e-6, 0.5
BOND = CohesiveZone(2e18, 0.5, 1e9, friction=0.05)
SOLVERS = {"newton": NewtonOnAllPoints, "accelerated": AcceleratedSweeps, "auto": Automatic}


def plate_step(cells, factor, broken, laws=(BOND,), held=False):
    """A plate stretched along x (and pressed along y if half of its bonds are broken)."""
    plate = crossed_plate(cells, SIZE)
    step = factor * 3.1e-11 * np.sqrt(20 / cells)
    fixed = (plate.x[..., 0].ravel() < 1e-12).repeat(2) if held else None
    inverse = plate.inverse(step, THETA, fixed)
    rng = np.random.default_rng(0)
    which = rng.integers(0, len(laws), len(plate.points))
    scene = Interactions(plate.points, list(laws), which, inverse)
    x = np.repeat(plate.x.mean(axis=1), 3, axis=0) - SIZE / 2
    free = np.zeros((inverse.num_slots, 2))
    free[: len(x)] = 4e4 * x * [1, -1 if broken else 0] + 0.002 * rng.normal(size=x.shape)
    if held:
        free.reshape(-1)[: len(fixed)][fixed] = 0.0
    if broken:
        lost = rng.random(len(plate.points)) < 0.5
        for g in scene.groups:
            if "damage" in g.kernels.state_names:
                g.state[lost[g.indices], g.kernels.state_names.index("damage")] = 0.0
    scene.begin_step(step, THETA)
    return scene, free.ravel()


def solved(make, solver, **options):
    scene, free = make()
    velocity = free.copy()
    report = solve(scene, velocity, solver, num_threads=1, **options)
    return scene, free, velocity, report


@pytest.mark.slow
@pytest.mark.parametrize("broken", [False, True])
@pytest.mark.parametrize("name", SOLVERS)
def test_the_answer_is_that_of_sweeps(name, broken):
    """A step of 100 times the explicit limit: the impulses of sweeps converged to 1e-10."""
    make = lambda: plate_step(8, 100, broken)  # noqa: E731
    exact = solved(make, NonlinearGaussSeidel, tolerance=1e-10, max_sweeps=100_000, relaxation=1.3)
    assert exact[3].converged
    scene, free, velocity, report = solved(make, SOLVERS[name], tolerance=1e-6)
    assert report.converged and report.residual <= 1e-6
    r, expected = scene.gather("impulse"), exact[0].gather("impulse")
    assert np.linalg.norm(r - expected) <= 5e-6 * np.linalg.norm(expected)
    check_velocity(scene, free, velocity)
    size, total, _ = tangent.residual(scene, velocity)
    assert size <= 1e-6 * total
    assert report.sweeps < exact[3].sweeps / 5
    if broken:  # opens, sticks and slides
        scene.commit(velocity)
        assert np.bincount(scene.gather("status").astype(int), minlength=3).min() > 15


def test_newton_that_goes_in_circles_leaves_the_rest_to_mixed_sweeps(monkeypatch):
    """Two attempts, then the answer of sweeps; each fourth of them is mixed."""
    mixed, mix = [], accelerated.AndersonMixing.mix
    make = lambda: plate_step(8, 100, True)  # noqa: E731
    exact = solved(make, NonlinearGaussSeidel, tolerance=1e-8, max_sweeps=100_000, relaxation=1.3)
    monkeypatch.setattr(newton._Attempt, "run", lambda *_: False)
    monkeypatch.setattr(
        accelerated.AndersonMixing, "mix", lambda *parts: mixed.append(1) or mix(*parts)
    )
    _, _, velocity, report = solved(make, Automatic, tolerance=1e-6)
    assert report.converged and "2 times back to sweeps; accelerated" in report.reason
    np.testing.assert_allclose(velocity, exact[2], rtol=0, atol=1e-5 * np.abs(velocity).max())
    assert 40 < 4 * len(mixed) < report.sweeps < exact[3].sweeps / 5


@pytest.mark.parametrize("name", SOLVERS)
def test_mixed_laws_damage_and_prescribed_faces(name):
    """Two groups, three laws; bonds that break within the step follow as they do under sweeps."""
    weak = CohesiveZone(2e18, 0.5, 2e6, friction=0.3)
    laws = (weak, SignoriniCoulomb(0.2, restitution=0.5), Tresca(1e5))
    make = lambda: plate_step(6, 5, False, laws, held=True)  # noqa: E731
    exact = solved(make, NonlinearGaussSeidel, tolerance=1e-9, max_sweeps=10_000)
    assert exact[3].converged
    scene, free, velocity, report = solved(make, SOLVERS[name], tolerance=1e-8)
    assert report.converged
    np.testing.assert_allclose(velocity, exact[2], rtol=0, atol=1e-6 * np.abs(velocity).max())
    check_velocity(scene, free, velocity)
    works = [s.commit(v) for s, _, v, _ in ((scene, free, velocity, report), exact)]
    assert works[1].cohesion > 0.0
    np.testing.assert_allclose(works[0], works[1], rtol=1e-5, atol=1e-8 * works[1].stored)


def test_perfect_bonds_and_their_redundant_rings():
    """No compliance at all, W singular around every vertex: the velocity of converged sweeps."""
    make = lambda: plate_step(4, 10, False, (PerfectBond(),))  # noqa: E731
    exact = solved(make, NonlinearGaussSeidel, tolerance=1e-11, max_sweeps=20_000)
    scene, free, velocity, report = solved(make, NewtonOnAllPoints, tolerance=1e-8)
    assert exact[3].converged and report.converged and report.sweeps == 10
    np.testing.assert_allclose(velocity, exact[2], rtol=0, atol=1e-7 * np.abs(velocity).max())
    check_velocity(scene, free, velocity)


@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("name", ["newton", "auto"])
def test_contact_in_3d(name, mu, k):
    """Random tetrahedra with chains of points between bodies and the ground."""
    make = lambda: tetrahedra_scene(SignoriniCoulomb(mu), k)  # noqa: E731
    exact = solved(make, NonlinearGaussSeidel, tolerance=1e-12)
    scene, free, velocity, report = solved(make, SOLVERS[name], tolerance=1e-10)
    assert report.converged
    np.testing.assert_allclose(velocity, exact[2], rtol=0, atol=1e-8)
    check_velocity(scene, free, velocity)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_step_is_that_of_the_dense_linearised_problem(dim):
    """(I - D (W - diag W)) dr = S(b) - r, with D by differences of the laws, solved densely."""
    if dim == 2:
        scene, velocity = plate_step(3, 100, True)
    else:
        scene, velocity = tetrahedra_scene(CohesiveZone(2e18, 0.5, 1e9, friction=0.3))
    solve(scene, velocity, tolerance=1e-12, max_sweeps=4, num_threads=1)
    (group,) = scene.groups
    h = dense_h(group.points, scene.inverse.num_slots)
    w = h.T @ dense_w(scene.inverse) @ h
    u, old = (h.T @ velocity).reshape(-1, dim), group.impulse
    slopes, missing, own = np.zeros_like(w), np.zeros_like(old), np.zeros_like(w)
    arguments = group.compliance, group.parameters, group.terms, group.details
    for i in range(len(group)):
        rows = slice(i * dim, (i + 1) * dim)
        answer = lambda x: np.array(  # noqa: E731
            group.kernels.solve(i, tuple(x), tuple(old[i]), *arguments)[0]  # noqa: B023
        )
        missing[i] = answer(u[i]) - old[i]
        own[rows, rows] = w[rows, rows]
        reach = 1e-6 * np.linalg.norm(u[i] - w[rows, rows] @ old[i])
        for j in range(dim):
            moved = u[i] + reach * np.eye(dim)[j]
            slopes[rows, i * dim + j] = (answer(moved) - answer(u[i])) / reach
    expected = np.linalg.solve(np.eye(len(w)) - slopes @ (w - own), missing.ravel())
    problem = LinearisedProblem(scene)
    problem.linearise(velocity)
    size = np.linalg.norm(missing)
    (step,), _ = problem.solve(np.zeros_like(velocity), 1e-11 * size, 400)
    np.testing.assert_allclose(step.ravel(), expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["plane", "space", "across clusters"])
def test_gmres_sweeps_over_clusters_and_knows_the_product_of_what_it_finds(name):
    """z = (L + D)^-1 r and y = A z, from the entries of A = w^-1 + H K H^T."""
    if name == "plane":
        scene, velocity = plate_step(3, 100, True, held=True)
    elif name == "space":
        scene, velocity = tetrahedra_scene(CohesiveZone(2e18, 0.5, 1e9, friction=0.3))
    else:
        scene, velocity = gauss_scene(2, CohesiveZone(2e18, 0.5, 1e9), False)[:2]
    solve(scene, velocity, tolerance=1e-12, max_sweeps=4, num_threads=1)
    problem, n = LinearisedProblem(scene), len(velocity)
    problem.linearise(velocity)
    a, bodies = np.empty((2, n, n))
    for i, unit in enumerate(np.eye(n)):
        problem._apply(unit, a[:, i])
        problem.momentum(unit, bodies[:, i])
    r = np.random.default_rng(0).normal(size=n)
    problem.hold(r)
    z, y, product = np.empty((3, n))
    problem._precondition(r, z, y)
    problem._apply(z, product)
    np.testing.assert_allclose(y, product, rtol=0, atol=1e-10 * np.abs(product).max())
    assert problem._first(r, z, y) == (name == "plane")  # whether y is no product made anew
    cluster = np.repeat(facing_clusters(scene)[0].cluster, scene.dim)
    lower = np.where(cluster[:, None] > cluster, bodies, a * (cluster[:, None] == cluster))
    still = np.diag(lower) == 0.0
    lower[still] = np.eye(n)[still]
    expected = np.linalg.solve(lower, r)
    np.testing.assert_allclose(z, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_the_residual_is_told_as_impulse_and_as_traction():
    """|S(b) - r| of all points, |r|, and the largest of a point over h times its area."""
    scene, velocity = tetrahedra_scene(CohesiveZone(2e18, 0.5, 1e9, friction=0.3))
    solve(scene, velocity, tolerance=1e-12, max_sweeps=2, num_threads=1)
    missing, tractions = [], []
    (group,) = scene.groups
    u = group.points.relative(velocity.reshape(-1, 3))
    arguments = group.compliance, group.parameters, group.terms, group.details
    for i in range(len(group)):
        answer, _ = group.kernels.solve(i, tuple(u[i]), tuple(group.impulse[i]), *arguments)
        missing.append(np.linalg.norm(np.array(answer) - group.impulse[i]))
        tractions.append(missing[-1] / (scene.step_size * group.points.area[i]))
    size, impulse, traction = tangent.residual(scene, velocity)
    assert size == pytest.approx(np.linalg.norm(missing), rel=1e-12)
    assert impulse == pytest.approx(np.linalg.norm(group.impulse), rel=1e-12)
    assert traction == pytest.approx(max(tractions), rel=1e-6)


def test_iterations_do_not_grow_with_the_mesh():
    """An intact plate far beyond the explicit limit: as many iterations with 16 times the cells."""
    counts = []
    for cells in (10, 40):
        scene, velocity = plate_step(cells, 100, False)
        solve(scene, velocity, tolerance=1e-9, max_sweeps=10, num_threads=1)
        problem = LinearisedProblem(scene)
        problem.linearise(velocity)
        size, _, _ = tangent.residual(scene, velocity)
        _, iterations = problem.solve(np.zeros_like(velocity), 1e-3 * size, 200)
        counts.append(iterations)
    assert counts[1] <= 1.6 * counts[0] and counts[1] <= 30, counts


def test_the_matrix_is_factored_once_iterations_are_many(monkeypatch):
    """Until the next solve; the step of the impulses is that of iterations."""
    scene, velocity = plate_step(8, 100, True)
    solve(scene, velocity, tolerance=1e-9, max_sweeps=10, num_threads=1)
    problem = LinearisedProblem(scene)
    bound = 1e-9 * tangent.residual(scene, velocity)[0]
    found, counts = [], []
    for _ in range(2):
        problem.begin()
        for _ in range(2):
            problem.linearise(velocity)
            (change,), iterations = problem.solve(np.zeros_like(velocity), bound, 400)
            found.append(change.copy())
            counts.append(iterations)
    assert counts[0] == counts[2] >= tangent.MANY and max(counts[1::2]) <= 1
    for change in found[1:]:
        np.testing.assert_allclose(change, found[0], atol=1e-6 * np.abs(found[0]).max())
    # large ones are not factored
    monkeypatch.setattr(tangent, "DIRECT", {2: 100})
    problem = LinearisedProblem(scene)
    for _ in range(2):
        problem.linearise(velocity)
        assert problem.solve(np.zeros_like(velocity), bound, 400)[1] == counts[0]


def test_newton_begins_each_solve_anew(monkeypatch):
    """As points may have turned; a factorisation is for the solve that has asked for it."""
    begun, begin = [], LinearisedProblem.begin
    monkeypatch.setattr(LinearisedProblem, "begin", lambda own: begun.append(own) or begin(own))
    solver = NewtonOnAllPoints()
    for count in (1, 2):
        scene, velocity = plate_step(8, 100, True)
        assert solver.solve(scene, velocity, SolveOptions(tolerance=1e-6, num_threads=1)).converged
        assert len(begun) == count


def test_what_is_kept_belongs_to_the_w_of_the_last_step():
    """Once another w came nothing is kept, or saved: a restarted run knows but the last."""
    scene, velocity = plate_step(3, 30, False)
    known, w = Linearised(), scene.bulk_inverse
    assert known.saved(scene) == {}
    known.problem(scene).linearise(velocity)
    slopes = known.saved(scene)["linearised"]["slopes"]
    assert np.all(np.isfinite(slopes)) and known.problem(scene) is known.problem(scene)
    assert np.array_equal(known.saved(scene)["linearised"]["slopes"], slopes)
    for inverse in (plate_step(3, 10, False)[0].bulk_inverse, w):
        scene.update_inverse(inverse)
        assert known.saved(scene) == {}
    known.problem(scene)
    assert np.all(np.isinf(known.saved(scene)["linearised"]["slopes"]))
    known.problem(scene).linearise(velocity)
    assert np.array_equal(known.saved(scene)["linearised"]["slopes"], slopes)


def test_the_safeguard_saves_newton_from_cycling(monkeypatch):
    """Half of the bonds broken: whole steps alone do not come to rest in thrice the steps."""
    make = lambda: plate_step(20, 100, True)  # noqa: E731
    *_, report = solved(make, NewtonOnAllPoints, tolerance=1e-6)
    steps = int(report.reason.split()[0])
    assert report.converged and steps <= 30
    assert "0 times back to sweeps" in report.reason  # halved steps were enough
    scene, velocity = make()
    solve(scene, velocity, tolerance=1e-9, max_sweeps=10, num_threads=1)
    monkeypatch.setattr(newton, "_LEAP", np.inf)
    monkeypatch.setattr(newton, "_DECREASE", -np.inf)  # any whole step is accepted
    attempt = newton._Attempt(scene, velocity, LinearisedProblem(scene))
    assert not attempt.run(1e-6, 2 * steps) or attempt.steps > 1.5 * steps


def test_auto_sweeps_where_few_are_needed_and_says_why():
    *_, small = solved(lambda: plate_step(8, 1, True), Automatic, tolerance=1e-6)
    assert small.converged and small.solver == "nlgs" and "enough" in small.reason
    *_, large = solved(lambda: plate_step(8, 100, True), Automatic, tolerance=1e-6)
    assert large.converged and large.solver == "newton" and "sweeps left" in large.reason


def test_where_w_is_singular_newton_leaves_it_to_sweeps():
    """A body that is guided along an oblique line has a w without an inverse."""
    scene, velocity = plate_step(3, 30, True)
    blocks = scene.inverse.data.reshape(-1, 6, 6)[:-1].copy()
    blocks[0] = 1e7 * np.outer([1, 1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1])
    inverse = BodyInverse.from_uniform(blocks, 2)
    for solver in (NewtonOnAllPoints(), Automatic()):
        scene, velocity = plate_step(3, 30, True)
        scene.update_inverse(inverse)
        scene.prepare()
        free = velocity.copy()
        options = SolveOptions(tolerance=1e-8, num_threads=1)
        assert solver.solve(scene, velocity, options).converged
        assert not LinearisedProblem(scene).regular
        check_velocity(scene, free, velocity)


def test_without_a_point_there_is_nothing_to_solve():
    plate = crossed_plate(2, SIZE)
    points, laws = plate.points.take(np.arange(0)), np.zeros(0, np.int64)
    scene = Interactions(points, [BOND], laws, plate.inverse(1e-9, THETA))
    scene.begin_step(1e-9, THETA)
    velocity = np.zeros(scene.inverse.num_slots * 2)
    problem = LinearisedProblem(scene)
    problem.linearise(velocity)
    assert problem.solvable and problem.solve(velocity, 0.0, 10)[1] == 0


def test_new_values_of_w_are_taken():
    scene, free = plate_step(5, 100, False)
    velocity = free.copy()
    solver, options = NewtonOnAllPoints(), SolveOptions(tolerance=1e-9, num_threads=1)
    assert solver.solve(scene, velocity, options).converged
    inverse = crossed_plate(5, SIZE).inverse(50 * 6.2e-11, THETA)
    scene.update_inverse(inverse)
    scene.begin_step(50 * 6.2e-11, THETA)
    velocity = free.copy()
    assert solver.solve(scene, velocity, options).converged
    check_velocity(scene, free, velocity)
    size, total, _ = tangent.residual(scene, velocity)
    assert size <= 1e-8 * total


def test_clusters_are_the_vertices_of_the_mesh():
    scene, _ = plate_step(3, 1, False)
    clusters, opened = facing_clusters(scene)
    sizes = np.diff(clusters.offsets)
    assert len(sizes) == 16 + 9 + 3  # vertices, centres, slots of the ground
    assert sorted(sizes)[-4:] == [8, 8, 8, 8] and not opened.any()
    for g in scene.groups:
        ends = clusters.cluster[g.points.nodes[:, :, 0]]
        assert np.all(ends[:, 0] == ends[:, 1])
    grounded = gauss_scene(1, BOND, True)[0]
    clusters, opened = facing_clusters(grounded)
    touching = grounded.points.nodes[(grounded.points.nodes == 15).any(axis=1)[:, 0]]
    assert np.all(opened[clusters.cluster[touching]])


@pytest.mark.parametrize("kept", [1, 2, 4])
def test_orthomin_falls_like_minres_where_the_matrix_is_symmetric(kept):
    """scipy's MINRES takes the least residual of all directions; two terms are enough for it."""
    rng = np.random.default_rng(2)
    half = rng.normal(size=(60, 60))
    a = half @ half.T + 20.0 * np.eye(60)
    b = rng.normal(size=60)
    x, left = np.zeros(60), b.copy()

    def precondition(r, z, y):
        z[:] = r
        y[:] = a @ z

    iterations, size = orthomin(precondition, left, x, 1e-8, 500, np.empty((2, kept + 1, 60)))
    assert 10 < iterations < 60 and size <= 1e-8
    np.testing.assert_allclose(x, np.linalg.solve(a, b), rtol=0, atol=1e-9)
    np.testing.assert_allclose(left, b - a @ x, rtol=0, atol=1e-12)
    reached = []
    scipy.sparse.linalg.minres(
        a, b, rtol=1e-14, maxiter=iterations, callback=lambda x: reached.append(b - a @ x)
    )
    assert np.linalg.norm(reached[-2]) > 1e-8 >= 0.8 * np.linalg.norm(reached[-1])


def test_orthomin_solves_what_is_not_symmetric():
    rng = np.random.default_rng(2)
    a = np.diag(np.linspace(1.0, 50.0, 60)) + 0.3 * rng.normal(size=(60, 60))
    b = rng.normal(size=60)
    x, left = np.zeros(60), b.copy()

    def precondition(r, z, y):
        z[:] = r / np.diag(a)
        y[:] = a @ z

    iterations, size = orthomin(precondition, left, x, 1e-10, 500, np.empty((2, 3, 60)))

    assert 10 < iterations < 120 and size <= 1e-10
    np.testing.assert_allclose(x, np.linalg.solve(a, b), rtol=0, atol=1e-9)
    np.testing.assert_allclose(left, b - a @ x, rtol=0, atol=1e-12)


def test_gmres_solves_with_restarts_as_scipy_does():
    rng = np.random.default_rng(2)
    a = np.diag(np.linspace(1.0, 50.0, 60)) + 0.3 * rng.normal(size=(60, 60))
    b = rng.normal(size=60)
    x, left = np.zeros(60), b.copy()

    def precondition(r, z, y):
        z[:] = r / np.diag(a)
        y[:] = a @ z

    iterations, size = gmres(precondition, left, x, 1e-10, 500, np.empty((13, 60)))
    assert 10 < iterations < 500 and size <= 1e-10
    np.testing.assert_allclose(x, np.linalg.solve(a, b), rtol=0, atol=1e-9)
    np.testing.assert_allclose(left, b - a @ x, rtol=0, atol=1e-12)
    norms = []
    scipy.sparse.linalg.gmres(
        a / np.diag(a), b, rtol=0.0, atol=1e-10, restart=10, callback=norms.append,
        callback_type="pr_norm",
    )  # fmt: skip
    assert len(norms) == iterations
