# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a frictional contact problem says: errors, units, order, parts, arguments, determinism."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.sparse as sp
from problems import box_stack, disks_on_wall, pyramid, sphere_heap, square_pile

from xper_fx.nscd.friction import SOLVERS, FrictionProblem


def natural_errors(W, q, mu, dim, r):
    """Natural-map errors from their definition, contact by contact: unit-free, and Siconos's."""
    r, q = np.reshape(r, (-1, dim)), np.reshape(q, (-1, dim))
    u = np.reshape(W @ r.ravel(), r.shape) + q

    def size(rho):
        total = 0.0
        for ra, ua, m in zip(r, u, np.broadcast_to(mu, len(r)), strict=True):
            y = ra - rho * ua
            y[0] -= rho * m * np.linalg.norm(ua[1:])
            tangential = np.linalg.norm(y[1:])
            if tangential <= m * y[0]:
                projection = y
            elif m * tangential <= -y[0]:
                projection = 0.0 * y
            else:  # on the generatrix of the cone below y
                edge = np.array([1.0, *(m * y[1:] / tangential)]) / np.hypot(1.0, m)
                projection = (y @ edge) * edge
            total += np.sum((ra - projection) ** 2)
        return np.sqrt(total)

    mean = W.diagonal().mean() if W.shape[0] else 1.0
    rho = 1.0 / mean if mean > 0.0 else 1.0
    q_size = np.linalg.norm(q)
    largest = max(q_size, np.linalg.norm(r), np.linalg.norm(u))
    return size(rho) / (rho * (q_size or 1.0)), size(1.0) / (largest or 1.0)


def assert_honest(problem, result, tolerance=1e-8):
    """All that a result claims follows from its impulses, and a failure has a reason."""
    r, n, dim = result.reaction, len(problem), problem.dim
    assert r.shape == result.velocity.shape == (n * dim,)
    assert np.isfinite(r).all()
    velocity = problem.W @ r + problem.q
    rounding = 1e-14 * (abs(problem.W) @ abs(r) + abs(problem.q)).max(initial=0.0)
    np.testing.assert_allclose(result.velocity, velocity, rtol=0.0, atol=rounding)
    error, siconos = natural_errors(problem.W, problem.q, problem.mu, dim, r)
    # near a solution the map is a difference of impulses: some eps |r| is noise
    noise = 1e-15 * (1.0 + np.linalg.norm(r) * problem.W.diagonal().mean() if n else 0.0)
    noise /= np.linalg.norm(problem.q) or 1.0
    assert result.errors.error == pytest.approx(error, rel=1e-6, abs=noise)
    assert result.errors.siconos_error == pytest.approx(siconos, rel=1e-6, abs=1e-14)
    assert result.error == result.errors.error
    assert result.converged == (result.error <= tolerance)
    assert result.converged or result.reason
    r, u = r.reshape(n, dim), velocity.reshape(n, dim)
    violation = np.linalg.norm(r[:, 1:], axis=1) - problem.mu * r[:, 0]
    expected = [
        max(-u[:, 0].min(initial=0.0), 0.0),
        np.abs(u[:, 0] * r[:, 0]).max(initial=0.0),
        max(violation.max(initial=0.0), 0.0),
    ]
    largest_r = np.abs(r).max(initial=0.0)
    np.testing.assert_allclose(result.errors.penetration, expected[0], atol=2 * rounding)
    np.testing.assert_allclose(
        result.errors.complementarity, expected[1], atol=2 * rounding * largest_r
    )
    np.testing.assert_allclose(result.errors.cone_violation, expected[2], atol=1e-14 * largest_r)


ROTATED = np.array([0.6, 0.8])  # the tangent of the plane problem, in space


def in_space(plane):
    """Plane vectors, shape (n, 2), along one direction of the tangent plane."""
    return np.column_stack([plane[:, 0], plane[:, 1:] * ROTATED])


@pytest.mark.parametrize("dim", [2, 3])
def test_errors_of_given_impulses(dim):
    """By hand, W = 2: a contact that closes, slips and has too much friction, and an open one.

    Contact 0: u = (-1, 2.1). With rho = 1/2, r - rho u~ = (0.975, -0.25), in the cone: F = (0.025,
    1.05). With rho = 1, (0.95, -1.3) goes to (1.28, -0.64): F = (-0.28, 1.44). Contact 1, pulled:
    F = (0.125, 0) with both.
    """
    q, r = np.array([[-3.0, 0.5], [0.25, 0.0]]), np.array([[1.0, 0.8], [0.125, 0.0]])
    if dim == 3:
        q, r = in_space(q), in_space(r)
    problem = FrictionProblem(2.0 * sp.eye(2 * dim), q.ravel(), 0.5, dim)
    errors = problem.errors(r.ravel())
    size_q = np.sqrt(9.3125)
    assert errors.error == pytest.approx(np.sqrt(0.025**2 + 1.05**2 + 0.125**2) / (0.5 * size_q))
    assert errors.siconos_error == pytest.approx(np.sqrt(0.28**2 + 1.44**2 + 0.125**2) / size_q)
    assert errors.penetration == pytest.approx(1.0)
    assert errors.complementarity == pytest.approx(1.0)
    assert errors.cone_violation == pytest.approx(0.3)
    assert natural_errors(problem.W, problem.q, 0.5, dim, r) == pytest.approx(errors[:2])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_little_friction_too_much(dim):
    """1e-9 beside a normal impulse of 1: the difference of their squares would not show it."""
    problem = FrictionProblem(sp.eye(dim), np.zeros(dim), 0.0, dim)
    r = np.zeros(dim)
    r[0], r[-1] = 0.1, 1e-9
    assert problem.errors(r).cone_violation == pytest.approx(1e-9)


@pytest.mark.parametrize("make", [lambda: disks_on_wall(15), lambda: sphere_heap(15)])
def test_errors_of_any_impulses(make):
    """Inside, outside and beyond the cone, mu = 0 too, against the definition."""
    W, q, mu, dim = make()
    rng = np.random.default_rng(0)
    mu = rng.choice([0.0, 1e-12, 0.3, 2.0], len(mu))
    problem = FrictionProblem(W, q, mu, dim)
    for size in 10.0 ** np.arange(-2.0, 7.0):
        r = size * rng.normal(size=len(q))
        np.testing.assert_allclose(
            problem.errors(r)[:2], natural_errors(W, q, mu, dim, r), rtol=1e-9
        )


# Units.

PROBLEMS = {
    "pyramid": lambda: pyramid(4),  # sweeps
    "square pile": lambda: square_pile(5),  # and an interior point
    "spheres": lambda: sphere_heap(15),
    "box stack": lambda: box_stack(6),
}


@pytest.mark.parametrize("make", PROBLEMS.values(), ids=PROBLEMS.keys())
def test_units_do_not_matter(make):
    """W and q in other units, powers of two so as to add no rounding: the same to the last bit."""
    W, q, mu, dim = make()
    reference = FrictionProblem(W, q, mu, dim).solve()
    assert reference.converged
    for log_w, log_q in [(-40, -30), (-40, 30), (40, -30), (40, 30)]:  # 1e-12, 1e-9 ...
        result = FrictionProblem(W * 2.0**log_w, q * 2.0**log_q, mu, dim).solve()
        assert result.converged
        assert (result.sweeps, result.solver) == (reference.sweeps, reference.solver)
        np.testing.assert_array_equal(result.velocity, reference.velocity * 2.0**log_q)
        np.testing.assert_array_equal(result.reaction, reference.reaction * 2.0 ** (log_q - log_w))
        assert result.error == pytest.approx(reference.error, rel=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
def test_units_of_each_solver(solver):
    W, q, mu, dim = disks_on_wall(15)
    reference = FrictionProblem(W, q, mu, dim).solve(solver)
    for scale_w, scale_q in [(1e-12, 1e-9), (1e12, 1e9), (1e-12, 1e9), (1e12, 1e-9)]:
        result = FrictionProblem(W * scale_w, q * scale_q, mu, dim).solve(solver)
        assert result.converged and reference.converged
        assert result.sweeps == reference.sweeps
        size = scale_q * np.abs(q).max()
        np.testing.assert_allclose(
            result.velocity, reference.velocity * scale_q, rtol=0.0, atol=1e-7 * size
        )


# The order of contacts, and other problems beside.


def random_order(problem, seed):
    W, q, mu, dim = problem
    order = np.random.default_rng(seed).permutation(len(mu))
    rows = (dim * order[:, None] + np.arange(dim)).ravel()
    return rows, FrictionProblem(W[rows][:, rows], q[rows], mu[order], dim)


@pytest.mark.parametrize("make", PROBLEMS.values(), ids=PROBLEMS.keys())
def test_order_of_contacts_does_not_matter(make):
    problem = make()
    reference = FrictionProblem(*problem).solve(tolerance=1e-10)
    assert reference.converged
    for seed in (0, 1):
        rows, permuted = random_order(problem, seed)
        result = permuted.solve(tolerance=1e-10)
        assert result.converged
        np.testing.assert_allclose(
            result.velocity, reference.velocity[rows], atol=1e-6 * np.abs(problem.q).max()
        )


@pytest.mark.parametrize("order", ["given", "shuffled"])
def test_impulses_stay_with_their_contacts(order):
    """Disks on a wall: W is regular, so that impulses are unique, and each mu is another."""
    W, q, _, dim = disks_on_wall(20)
    rng = np.random.default_rng(0)
    mu = rng.uniform(0.05, 0.3, len(q) // dim)
    reference = FrictionProblem(W, q, mu, dim).solve("newton", tolerance=1e-11)
    rows, permuted = random_order((W, q, mu, dim), 1)
    result = permuted.solve("nlgs", tolerance=1e-11, order=order)
    assert result.converged and reference.converged
    r = reference.reaction
    np.testing.assert_allclose(result.reaction, r[rows], atol=1e-7 * np.abs(r).max())


@pytest.mark.parametrize("first, second", [(pyramid(4), disks_on_wall(15)),
                                           (box_stack(3), sphere_heap(10))])  # fmt: skip
def test_unrelated_problems_solved_together(first, second):
    """Contacts of both in turn, or at random: each has its own velocities."""
    dim = first.dim
    joined = first._replace(
        W=sp.block_diag([first.W, second.W], format="csr"),
        q=np.concatenate([first.q, second.q]),
        mu=np.concatenate([first.mu, second.mu]),
    )
    own = [FrictionProblem(*p).solve(tolerance=1e-10) for p in (first, second)]
    assert all(result.converged for result in own)
    expected = np.concatenate([result.velocity for result in own])
    for solver in ("auto", "nlgs", "proximal_point"):
        rows, mixed = random_order(joined, 3)
        result = mixed.solve(solver, tolerance=1e-9)
        assert result.converged, solver
        np.testing.assert_allclose(
            result.velocity, expected[rows], atol=1e-6 * np.abs(joined.q).max()
        )
    assert len(rows) == dim * len(joined.mu)


# Little or nothing to solve.


@pytest.fixture(params=SOLVERS)
def solver(request):
    return request.param


@pytest.mark.parametrize("dim", [2, 3])
def test_no_contact(solver, dim):
    problem = FrictionProblem(sp.csr_matrix((0, 0)), np.zeros(0), 0.3, dim)
    result = problem.solve(solver)
    assert result.converged and result.error == 0.0
    assert result.reaction.shape == result.velocity.shape == (0,)


@pytest.mark.parametrize("problem", [square_pile(2), box_stack(2)], ids=["2D", "3D"])
def test_all_open(solver, problem):
    """The piles thrown up with the spin of their bodies: no impulse, u = q."""
    q = np.abs(problem.q) + 0.1
    result = FrictionProblem(problem.W, q, problem.mu, problem.dim).solve(solver)
    assert result.converged
    np.testing.assert_array_equal(result.reaction, 0.0)
    np.testing.assert_array_equal(result.velocity, q)


@pytest.mark.parametrize("problem", [square_pile(2), box_stack(2)], ids=["2D", "3D"])
def test_nothing_moves(solver, problem):
    """q = 0, from rest and from impulses that are not the answer."""
    still = FrictionProblem(problem.W, 0.0 * problem.q, problem.mu, problem.dim)
    for guess in (None, np.ones(len(problem.q))):
        result = still.solve(solver, guess=guess)
        assert_honest(still, result)
        assert result.converged


def test_nothing_tangential(solver):
    """Two disks side by side, W uncoupled and q_T = 0: the normal impulses of the frictionless."""
    W = sp.diags([2.0, 3.0, 4.0, 5.0])
    problem = FrictionProblem(W, np.array([-1.0, 0.0, -2.0, 0.0]), 0.3, 2)
    result = problem.solve(solver)
    assert_honest(problem, result)
    np.testing.assert_allclose(result.reaction, [0.5, 0.0, 0.5, 0.0], atol=2e-8)


def test_sizes_at_the_ends_of_what_floats_hold(solver):
    """Squares of q and of W may not be representable: found, or said not to be."""
    for scale_w in (1e-200, 1.0, 1e200):
        for scale_q in (1e-200, 1.0, 1e200):
            problem = FrictionProblem(scale_w * np.eye(2), scale_q * np.array([-1.0, 0.2]), 0.5, 2)
            with np.errstate(all="ignore"):
                result = problem.solve(solver, max_sweeps=20)
            exact = np.array([1.0, -0.2]) * (scale_q / scale_w)
            close = np.allclose(result.reaction, exact, rtol=1e-6, atol=0.0)
            assert close or not result.converged, (scale_w, scale_q)


# The course of a solve.


@pytest.mark.parametrize("make", [lambda: pyramid(5), lambda: box_stack(5)], ids=["2D", "3D"])
def test_same_bits_each_time(solver, make):
    first, second = (FrictionProblem(*make()) for _ in range(2))
    results = [p.solve(solver, max_sweeps=500) for p in (first, first, second)]
    for other in results[1:]:
        np.testing.assert_array_equal(results[0].reaction, other.reaction)
        assert other.history == results[0].history and other.errors == results[0].errors


def test_solve_leaves_its_arguments_alone(solver):
    W, q, mu, dim = disks_on_wall(15)
    problem = FrictionProblem(W, q, mu, dim)
    guess = np.ones(len(q))
    before = [W.data.copy(), q.copy(), mu.copy(), guess.copy()]
    problem.solve(solver, guess=guess)
    for array, copy in zip([W.data, q, mu, guess], before, strict=True):
        np.testing.assert_array_equal(array, copy)


@pytest.mark.parametrize("make", [lambda: pyramid(8), lambda: box_stack(6)], ids=["2D", "3D"])
def test_history_leads_to_the_error(solver, make):
    """Errors are positive; the least is that of the result, but after sweeps, looked at late."""
    result = FrictionProblem(*make()).solve(solver)
    names, iterations, errors = zip(*result.history, strict=True)
    assert min(errors) > 0.0 and np.isfinite(errors).all()
    assert set(names) <= set(result.solver.split(" + "))
    for name in set(names):
        own = [k for n, k in zip(names, iterations, strict=True) if n == name]
        assert own == sorted(set(own))
    if names[-1] == "nlgs":
        assert result.error <= (1.0 + 1e-5) * errors[-1]
    else:
        assert result.error == pytest.approx(min(errors), rel=1e-2)


@pytest.mark.parametrize("make", [lambda: pyramid(5), lambda: box_stack(3)], ids=["2D", "3D"])
@pytest.mark.parametrize("order", ["given", "shuffled"])
def test_a_guess_that_solves_needs_one_look(solver, make, order):
    problem = FrictionProblem(*make())
    solution = problem.solve(tolerance=1e-9)
    assert solution.converged
    result = problem.solve(solver, guess=solution.reaction, order=order)
    assert result.converged
    if solver in ("auto", "nlgs"):
        assert result.sweeps <= 2
    if solver != "interior_point":  # which cannot start from the boundary of the cones
        assert len(result.history) <= 1


def test_sweeps_end_where_told():
    problem = FrictionProblem(*square_pile(8))
    for count in (1, 7, 16, 50):
        result = problem.solve("nlgs", max_sweeps=count)
        assert result.sweeps == count
        assert_honest(problem, result)
        assert not result.converged and "1e-08" in result.reason


def test_auto_stops_its_sweeps_where_told_and_goes_on():
    problem = FrictionProblem(*square_pile(8))
    result = problem.solve(max_sweeps=5)
    assert result.sweeps <= 5
    assert result.converged and "interior_point" in result.solver


def test_the_tolerance_asked_for_is_reached(solver):
    """Looser is not solved further than need be by sweeps; tighter is solved further by all."""
    problem = FrictionProblem(*disks_on_wall(20))
    results = [problem.solve(solver, tolerance=t) for t in (1e-3, 1e-6, 1e-9)]
    for result, tolerance in zip(results, (1e-3, 1e-6, 1e-9), strict=True):
        assert_honest(problem, result, tolerance)
        assert result.converged
    if solver == "nlgs":
        assert results[0].sweeps < results[1].sweeps < results[2].sweeps


# Arguments.

BAD = {
    "solver": ({"solver": "nsgs"}, "solver.*" + ", ".join(SOLVERS) + ".*'nsgs'"),
    "local solver": ({"local_solver": "exact"}, "local_solver.*explicit, graph.*'exact'"),
    "facets of another": ({"local_solver": "graph", "facets": 8}, "'graph'.*facets"),
    "symmetric": ({"solver": "nlgs", "symmetric": "no"}, "symmetric should be True.*'no'"),
    "order": ({"order": "random"}, "order.*given, shuffled.*'random'"),
    "tolerance 0": ({"tolerance": 0.0}, "tolerance.*between 0 and 1, got 0"),
    "tolerance 2": ({"tolerance": 2.0}, "tolerance.*between 0 and 1, got 2"),
    "tolerance NaN": ({"tolerance": np.nan}, "tolerance.*between 0 and 1, got nan"),
    "no sweeps": ({"max_sweeps": 0}, "max_sweeps.*1 or more, got 0"),
    "relaxation 0": (
        {"solver": "nlgs", "relaxation": 0.0}, "relaxation.*between 0 and 2, got 0"),
    "relaxation 2": (
        {"solver": "nlgs", "relaxation": 2.0}, "relaxation.*between 0 and 2, got 2"),
    "relaxation NaN": (
        {"solver": "nlgs", "relaxation": np.nan}, "relaxation.*between 0 and 2, got nan"),
    "relaxation of auto": ({"relaxation": 1.3}, "relaxation.*nlgs.*'auto'"),
    "symmetric of newton": (
        {"solver": "newton", "symmetric": True}, "symmetric.*nlgs.*'newton'"),
    "short guess": ({"guess": np.zeros(3)}, re.escape("guess") + r".*\(24,\).*\(3,\)"),
    "guess as a table": ({"guess": np.zeros((12, 2))}, r"guess.*\(24,\).*\(12, 2\)"),
    "NaN in the guess": ({"guess": np.full(24, np.nan)}, "guess.*finite"),
}  # fmt: skip


@pytest.mark.parametrize("options, message", BAD.values(), ids=BAD.keys())
def test_refused(options, message):
    problem = FrictionProblem(*square_pile(2)[:3], 2)
    assert len(problem.q) == 24
    with pytest.raises(ValueError, match=message):
        problem.solve(**options)


@pytest.mark.parametrize("facets", [2, 10**9])
def test_facets_of_the_cone_are_countable(facets):
    problem = FrictionProblem(np.eye(3), np.array([-1.0, 0.0, 0.0]), 0.3, 3)
    with pytest.raises(ValueError, match=f"facets should lie between 3 and 1000, got {facets}"):
        problem.solve(local_solver="lcp", facets=facets)


@pytest.mark.parametrize("scale", [1e307, 1e-310])
def test_numbers_at_the_very_end_of_the_floats_are_refused(scale):
    """The sum of two such is infinite, or the rest of a division zero."""
    with pytest.raises(ValueError, match="W has entries up to .* range of floats"):
        FrictionProblem(scale * np.eye(2), np.array([-1.0, 0.2]), 0.3, 2)


def test_what_a_problem_is_made_of_is_checked():
    W, q, mu, dim = square_pile(2)
    with pytest.raises(ValueError, match=r"here: q should have shape \(24,\).*\(23,\)"):
        FrictionProblem(W, q[:-1], mu, dim, source="here")


def test_written_and_read_again(tmp_path):
    problem = FrictionProblem(*square_pile(3))
    problem.write(tmp_path / "pile.npz")
    again = FrictionProblem.read(tmp_path / "pile.npz")
    assert len(again) == len(problem) == 30 and again.dim == 2
    np.testing.assert_array_equal(again.solve().reaction, problem.solve().reaction)
    assert repr(again) == f"FrictionProblem(30 contacts, dim 2, {problem.W.nnz} entries in W)"
