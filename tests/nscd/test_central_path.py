# SPDX-License-Identifier: LGPL-3.0-or-later
"""The interior point on velocities against converged sweeps."""

from __future__ import annotations

import numpy as np
import pytest
from solving import solve
from test_newton_points import BOND, plate_step, solved
from test_nlgs import check_velocity, tetrahedra_scene

from xper_fx.nscd.friction.interior_point import cone_kernels
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb, Tresca
from xper_fx.nscd.solvers import (
    NewtonOnAllPoints,
    NonlinearGaussSeidel,
    cone_points,
    newton,
    tangent,
)
from xper_fx.nscd.solvers.central_path import follow_path
from xper_fx.nscd.solvers.tangent import LinearisedProblem

MIXED = (
    BOND,
    SignoriniCoulomb(0.4),
    SignoriniCoulomb(contact="position"),
    CohesiveZone(2e18, 0.5, 1e9),
)


def followed(make, tolerance):
    """A scene after the path, begun from what ten sweeps know, its velocities, and iterations."""
    scene, free = make()
    velocity = free.copy()
    solve(scene, velocity, tolerance=1e-12, max_sweeps=10, num_threads=1)
    count = follow_path(scene, free, LinearisedProblem(scene), tolerance)
    velocity = free.copy()
    scene.add_velocity(velocity)
    return scene, free, velocity, count


@pytest.mark.parametrize(
    "make",
    [
        lambda: plate_step(6, 100, True),
        lambda: plate_step(6, 30, True, MIXED, held=True),
        lambda: tetrahedra_scene(SignoriniCoulomb(0.3)),
        lambda: tetrahedra_scene(SignoriniCoulomb(0.0), 2),
    ],
    ids=["half-broken", "laws", "space", "frictionless"],
)
def test_it_leads_to_the_velocities_of_sweeps(make):
    """Bonds and contacts, with friction and without, that open, stick and slide: 1e-5 off."""
    exact = solved(make, NonlinearGaussSeidel, tolerance=1e-12, max_sweeps=200_000)
    assert exact[3].converged
    scene, free, velocity, count = followed(make, 1e-7)
    assert 5 < count <= 30
    largest = np.abs(exact[2]).max()
    np.testing.assert_allclose(velocity, exact[2], rtol=0, atol=1.5e-5 * largest)
    assert np.abs(exact[2] - free).max() > 0.01 * largest  # impulses did something
    check_velocity(scene, free, velocity)


def test_iterations_hardly_grow_with_the_mesh():
    counts = [followed(lambda n=n: plate_step(n, 100, True), 1e-6)[3] for n in (5, 20)]
    assert counts[0] <= counts[1] <= counts[0] + 6 <= 22
    assert sum(counts) <= 26  # begun from the velocities of free bodies, 27


def test_the_last_linear_problems_are_not_solved_further_than_needed(monkeypatch):
    """Solved ten times further they take 151 iterations."""
    taken, improve = [], LinearisedProblem.improve

    def counted(*arguments):
        taken.append(improve(*arguments))
        return taken[-1]

    monkeypatch.setattr(LinearisedProblem, "improve", counted)
    count = followed(lambda: plate_step(30, 100, True), 1e-6)[3]
    assert count <= 16 and 2 * count < len(taken) <= 4 * count
    assert 90 < sum(taken) <= 130


def test_directions_that_are_recentred_lead_farther(monkeypatch):
    """A fifth of the matrices is saved."""
    make = lambda: plate_step(30, 100, True)  # noqa: E731
    count = followed(make, 1e-6)[3]
    monkeypatch.setattr(cone_points, "_RECENTRINGS", 0)
    assert count <= 0.85 * followed(make, 1e-6)[3]


@pytest.mark.parametrize("dim", [2, 3])
def test_recentring_brings_eigenvalues_between_its_bounds(dim):
    """What it adds to g is S^-1 (lambda \\ t), t from x o z after the step, by dense matrices."""
    rng, cones, centre, length = np.random.default_rng(3), cone_kernels(dim), 0.7, 0.9
    x, z, dx, dz = rng.normal(size=(4, 6, dim))
    for side in (x, z):
        side[:, 0] = np.linalg.norm(side[:, 1:], axis=1) + rng.uniform(0.1, 2.0, 6)
    scaling, g = np.empty((6, dim + 1)), np.zeros((6, dim))
    for a in range(6):
        cones.scale(x, z, a, scaling)
    cones.recentre(scaling, x, z, dx, dz, length, centre, g)

    def arrow(v):
        return (
            v[0] * np.eye(dim)
            + np.outer(np.eye(dim)[0], v * (np.arange(dim) > 0))
            + np.outer(v * (np.arange(dim) > 0), np.eye(dim)[0])
        )

    moved = 0
    for a, (*w, eta) in enumerate(scaling):
        w = np.array(w)
        s = (
            arrow(w)
            + np.outer(w, w) * (np.arange(dim) > 0) * (np.arange(dim) > 0)[:, None] / (1.0 + w[0])
            - (w[0] - 1.0) * np.diag(np.arange(dim) > 0)
        )
        s *= eta
        np.testing.assert_allclose(s @ z[a], np.linalg.solve(s, x[a]), rtol=1e-9)  # lambda
        product = arrow(np.linalg.solve(s, x[a] + length * dx[a])) @ (s @ (z[a] + length * dz[a]))
        size = np.linalg.norm(product[1:])
        axis = np.concatenate([[0.0], product[1:] / size])
        t = np.zeros(dim)
        for sign in (-1.0, 1.0):
            value = product[0] + sign * size
            change = max(np.clip(value, 0.2 * centre, 5.0 * centre) - value, -5.0 * centre)
            t += 0.5 * change * (np.eye(dim)[0] + sign * axis)
        moved += np.any(t != 0.0)
        expected = np.linalg.solve(s, np.linalg.solve(arrow(s @ z[a]), t))
        np.testing.assert_allclose(g[a], expected, rtol=1e-8, atol=1e-12)
    assert moved >= 3


def test_where_orthomin_stalls_gmres_goes_on():
    """Sliding in space: alone it stays at 2e-7 of the source, however many directions it takes."""
    scene, free = tetrahedra_scene(CohesiveZone(2e18, 0.5, 1e9, friction=0.3))
    velocity = free.copy()
    solve(scene, velocity, tolerance=1e-12, max_sweeps=4, num_threads=1)
    problem = LinearisedProblem(scene)
    problem.linearise(velocity)
    source, product = np.zeros((2, len(free)))
    problem.tangents.spread_source(scene, source)
    problem.hold(source)
    left, step, bound = source.copy(), np.zeros_like(free), 1e-9 * np.linalg.norm(source)
    problem.improve(left, step, bound, 400)
    problem._apply(step, product)
    assert np.linalg.norm(source - product) <= 2.0 * bound


@pytest.mark.parametrize(
    "make",
    [
        lambda: plate_step(6, 30, True, MIXED, held=True),
        lambda: tetrahedra_scene(SignoriniCoulomb(0.3)),
    ],
)
def test_blocks_do_not_hang_on_the_portions_in_which_they_are_made(make, monkeypatch):
    blocks = []
    for portion in (10**9, 500):
        monkeypatch.setattr(tangent, "_IN_CACHE", portion)
        scene, free = make()
        problem = LinearisedProblem(scene)
        problem.linearise(free)
        assert (len(problem._portions) == 1) == (portion > 500)
        blocks.append(problem._blocks)
    np.testing.assert_array_equal(*blocks)


@pytest.mark.parametrize("law", [Tresca(1e5), PerfectBond()])
def test_other_laws_are_left_alone(law):
    scene, free = plate_step(3, 30, False, (law, BOND))
    for g in scene.groups:
        g.impulse[:] = 1e-9
    assert follow_path(scene, free, LinearisedProblem(scene), 1e-6) == 0
    assert all(np.all(g.impulse == 1e-9) for g in scene.groups)


def test_where_newton_goes_in_circles_it_goes_on(monkeypatch):
    """And what springs it leaves behind, the next linearised problem knows nothing of."""
    monkeypatch.setattr(newton._Attempt, "run", lambda *_: False)
    monkeypatch.setattr(newton, "_MANY", 0)
    make = lambda: plate_step(12, 100, True)  # noqa: E731
    scene, _, velocity, report = solved(make, NewtonOnAllPoints, tolerance=1e-6)
    assert report.converged and report.sweeps <= 30 and "of an interior point" in report.reason
    size, total, _ = tangent.residual(scene, velocity)
    assert size <= 5e-7 * total
    other, _ = make()
    for g, own in zip(other.groups, scene.groups, strict=True):
        g.impulse[:] = own.impulse
    fresh, used = LinearisedProblem(other), LinearisedProblem(scene)
    used.take_springs()
    steps = []
    for problem in (fresh, used):
        problem.linearise(velocity)
        steps.append(np.zeros_like(velocity))
        problem.solve(steps[-1], 0.0, 20)
    np.testing.assert_array_equal(*steps)


def test_the_path_begins_from_what_sweeps_know(monkeypatch):
    """Where many points open or slide and impulses are known no Newton step comes before it."""
    monkeypatch.setattr(newton, "_MANY", 0)
    scene, free = plate_step(12, 100, True)
    reasons = []
    for _ in range(2):
        velocity = free.copy()
        report = solve(scene, velocity, NewtonOnAllPoints, tolerance=1e-6, num_threads=1)
        assert report.converged
        reasons.append(report.reason)
        for g in scene.groups:  # as in a step that is a little larger
            g.impulse *= 0.9
    assert not reasons[0].startswith("0 Newton steps")
    assert reasons[1].startswith("0 Newton steps") and "interior" in reasons[1]
