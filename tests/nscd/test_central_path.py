# SPDX-License-Identifier: LGPL-3.0-or-later
"""The interior point on velocities against converged sweeps."""

from __future__ import annotations

import numpy as np
import pytest
from solving import solve
from test_newton_points import BOND, plate_step, solved
from test_nlgs import check_velocity, tetrahedra_scene

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
    """Solved ten times further they take 119 iterations of GMRES."""
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
