# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every solver on the same problems: closed forms, known solutions, problems nobody here wrote."""

from __future__ import annotations

import os
from pathlib import Path

import numba
import numpy as np
import pytest
import scipy.sparse as sp
from problems import disks_on_wall, pyramid, sphere_heap
from test_friction_problem import assert_honest, natural_errors

from xper_fx.nscd.friction import SOLVERS, FrictionProblem, colored, gauss_seidel
from xper_fx.nscd.friction.blocks import store
from xper_fx.nscd.local_solvers import LOCAL_SOLVERS, local_solver


@pytest.fixture(params=SOLVERS)
def solve(request):
    """Solve by the solver of the name; what it claims is checked."""

    def solve(problem, **options):
        result = problem.solve(request.param, max_sweeps=2000, **options)
        assert_honest(problem, result, options.get("tolerance", 1e-8))
        return result

    solve.solver = request.param
    return solve


# One contact, W coupled, by hand. Slip: r_T = -mu r_N sign(u_T), so that with s = sign(u_T) and
# u_N = 0, r_N = -q_N / (W_NN - mu s W_NT).

W2 = np.array([[2.0, 0.5], [0.5, 1.0]])
ONE_2D = {
    "sticks": ([-1.0, -0.1], [0.95 / 1.75, -0.3 / 1.75], [0.0, 0.0]),
    "slides up": ([-1.0, 1.0], [4 / 7, -2 / 7], [0.0, 1.0]),
    "slides down": ([-1.0, -2.0], [4 / 9, 2 / 9], [0.0, -14 / 9]),
    "lifts off": ([0.5, -3.0], [0.0, 0.0], [0.5, -3.0]),
    "grazes": ([0.0, 2.0], [0.0, 0.0], [0.0, 2.0]),
}


@pytest.mark.slow
@pytest.mark.parametrize("q, reaction, velocity", ONE_2D.values(), ids=ONE_2D.keys())
def test_block_on_a_line(solve, q, reaction, velocity):
    result = solve(FrictionProblem(W2, np.array(q), 0.5, 2))
    assert result.converged
    np.testing.assert_allclose(result.reaction, reaction, atol=1e-7)
    np.testing.assert_allclose(result.velocity, velocity, atol=1e-7)


W3 = np.array([[2.0, 0.5, 0.3], [0.5, 1.0, 0.2], [0.3, 0.2, 1.5]])
ONE_3D = {
    "sticks": ([1.0, 0.2, -0.3], [0.0, 0.0, 0.0]),
    "slides": ([1.0, -0.3, 0.4], [0.0, 0.6, -0.8]),  # against (0.6, -0.8), mu = 0.5
    "lifts off": ([0.0, 0.0, 0.0], [0.5, 3.0, -4.0]),
}


@pytest.mark.slow
@pytest.mark.parametrize("reaction, velocity", ONE_3D.values(), ids=ONE_3D.keys())
def test_block_on_a_plane(solve, reaction, velocity):
    q = np.array(velocity) - W3 @ reaction
    result = solve(FrictionProblem(W3, q, 0.5, 3))
    assert result.converged
    np.testing.assert_allclose(result.reaction, reaction, atol=1e-7)
    np.testing.assert_allclose(result.velocity, velocity, atol=1e-7)


# Many contacts, each of a known status.

FRICTIONS = (0.0, 1e-12, 0.3, 2.0)


def known(dim, seed, frictions=FRICTIONS, contacts=24, bodies=30):
    """A problem with a solution: bodies at random, W = H^T M^-1 H, u and r by status, q = u - W r.

    In turn by contact, for each friction: open, stick (where there is friction; else at rest),
    slide, and touching without impulse. Returns the problem, u and r.
    """
    rng = np.random.default_rng(seed)
    dofs = 3 * (dim - 1)
    H_T = np.zeros((contacts, dim, bodies, dofs))
    for a in range(contacts):
        i, j = rng.choice(bodies, 2, replace=False)
        for sign, body in ((1.0, i), (-1.0, j)):
            turn = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
            lever = 0.3 * rng.normal(size=(dim, dofs - dim))
            H_T[a, :, body] = sign * np.hstack([turn, lever])
    H_T = H_T.reshape(contacts * dim, bodies * dofs)
    W = H_T @ np.diag(rng.uniform(0.5, 2.0, bodies * dofs)) @ H_T.T
    mu = np.repeat(frictions, 4)[np.arange(contacts) % (4 * len(frictions))]
    u, r = np.zeros((2, contacts, dim))
    for a in range(contacts):
        direction = rng.normal(size=dim - 1)
        direction /= np.linalg.norm(direction)
        status = a % 4
        if status == 0:
            u[a] = [rng.uniform(0.1, 1.0), *rng.normal(size=dim - 1)]
        elif status in (1, 2):
            r[a, 0] = rng.uniform(0.5, 2.0)
            share = 0.5 if status == 1 else 1.0
            r[a, 1:] = -share * mu[a] * r[a, 0] * direction
            if status == 2:
                u[a, 1:] = rng.uniform(0.1, 1.0) * direction
    q = u.ravel() - W @ r.ravel()
    return FrictionProblem(W, q, mu, dim), u.ravel(), r.ravel()


@pytest.mark.parametrize("dim", [2, 3])
def test_known_solutions_are_solutions(dim):
    problem, u, r = known(dim, 0)
    assert natural_errors(problem.W, problem.q, problem.mu, dim, r)[0] <= 1e-14
    assert problem.errors(r).error <= 1e-14
    np.testing.assert_allclose(problem.W @ r + problem.q, u, atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_known_impulses_are_found(solve, dim):
    """Friction moderate or nil: one solution. The interior point alone wants a little friction."""
    problem, u, r = known(dim, 1, frictions=(0.0, 1e-12, 0.3))
    assert np.linalg.matrix_rank(problem.W.toarray()) == len(u)
    result = solve(problem, tolerance=1e-10)
    assert result.converged or solve.solver == "interior_point"
    close = 1e-7 if result.converged else 1e-4
    np.testing.assert_allclose(result.velocity, u, atol=close)
    np.testing.assert_allclose(result.reaction, r, atol=close)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_all_frictions_in_one_problem(solve, dim, seed):
    """mu from 0 to 2, more contacts than bodies can give a regular W for."""
    problem, _, _ = known(dim, seed, contacts=48, bodies=12)
    result = solve(problem)
    assert result.converged or solve.solver not in ("auto", "proximal_point")


# Local solvers.

EVERY_LOCAL = [(dim, name) for dim, names in LOCAL_SOLVERS.items() for name in names]
ROUND = {2: lambda: disks_on_wall(20, mu=0.2), 3: lambda: sphere_heap(12, mu=0.2)}


def sweep_with(problem, name, velocity, **options):
    """Error of the velocities by this local solver, relative to the largest of all."""
    faceted = (problem.dim, name) == (3, "lcp")
    result = problem.solve(
        "nlgs", name, tolerance=1e-9, max_sweeps=150 if faceted else 5000, **options
    )
    assert_honest(problem, result, 1e-9)
    assert result.local_solver == name
    assert result.converged != faceted
    return np.abs(result.velocity - velocity).max() / np.abs(velocity).max()


@pytest.mark.parametrize("dim, name", EVERY_LOCAL)
def test_local_solvers_agree_on_round_bodies(dim, name):
    """Directions are uncoupled at each contact, where "explicit" is right too."""
    problem = FrictionProblem(*ROUND[dim]())
    reference = problem.solve("proximal_point", tolerance=1e-10)
    assert reference.converged
    error = sweep_with(problem, name, reference.velocity)
    if (dim, name) == (3, "lcp"):
        assert 1e-4 < error < 0.1
    else:
        assert error < 1e-6


@pytest.mark.parametrize("dim, name", [pair for pair in EVERY_LOCAL if pair[1] != "explicit"])
def test_local_solvers_find_known_impulses(dim, name):
    """Directions are coupled, impulses unique, friction 0, 1e-12 and 0.3."""
    problem, u, _ = known(dim, 1, frictions=(0.0, 1e-12, 0.3))
    error = sweep_with(problem, name, u)
    if (dim, name) == (3, "lcp"):
        finer = sweep_with(problem, name, u, facets=32)
        assert 1e-4 < finer < 0.5 * error < 0.1
    else:
        assert error < 1e-7


@pytest.mark.parametrize("dim", [2, 3])
def test_explicit_is_refused_where_it_is_wrong(dim):
    problem, _, _ = known(dim, 1)
    with pytest.raises(ValueError, match="explicit"):
        problem.solve(local_solver="explicit")


# How much work.


def test_mixing_saves_sweeps():
    """A pyramid of 20 rows: 2.5 times fewer at least than plain sweeps."""
    problem = FrictionProblem(*pyramid(20))
    mixed = problem.solve("anderson", max_sweeps=400)
    assert mixed.converged and 0 < mixed.sweeps <= 400
    plain = problem.solve("nlgs", max_sweeps=1000)
    assert not plain.converged and plain.sweeps == 1000


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_newton_squares_its_error(dim, seed):
    """Its last step, the derivatives being right, goes far below what is asked for."""
    problem, _, _ = known(dim, seed, frictions=(0.3,))
    result = problem.solve("newton", tolerance=1e-5)
    assert result.converged and result.error < 1e-7


WAYS = {
    "relaxation 1.3": {"relaxation": 1.3},
    "relaxation 0.7": {"relaxation": 0.7},
    "symmetric": {"symmetric": True},
    "shuffled": {"order": "shuffled"},
    "colored": {"order": "colored"},
}


@pytest.mark.parametrize("options", WAYS.values(), ids=WAYS.keys())
def test_ways_of_sweeping_lead_to_the_same_velocities(options):
    """And each is another way: the sweeps differ."""
    problem = FrictionProblem(*pyramid(8))
    plain = problem.solve("nlgs", tolerance=1e-10)
    result = problem.solve("nlgs", tolerance=1e-10, **options)
    assert_honest(problem, result, 1e-10)
    assert plain.converged and result.converged
    assert np.abs(result.reaction - plain.reaction).max() > 0.0
    assert result.sweeps != plain.sweeps
    np.testing.assert_allclose(result.velocity, plain.velocity, atol=1e-6 * np.abs(problem.q).max())


@pytest.fixture
def threads():
    """Set the number of Numba's threads, for one test."""
    before = numba.get_num_threads()
    yield numba.set_num_threads
    numba.set_num_threads(before)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one core")
@pytest.mark.parametrize("relaxation", [1.0, 1.3])
@pytest.mark.parametrize(
    "make", [lambda: disks_on_wall(40, mu=0.3), lambda: sphere_heap(30, mu=0.3)], ids=["2D", "3D"]
)
def test_coloured_sweeps_are_the_serial_ones(make, relaxation, threads):
    """Up to rounding; and the same bits whatever the number of threads."""
    W, q, mu, dim = make()
    problem, _, _, colors = store(W, q, mu, dim, "colored")
    local = local_solver(dim, "graph" if dim == 2 else "exact")
    how = {"tolerance": 1e-15, "max_sweeps": 12, "relaxation": relaxation}
    serial = np.zeros((len(mu), dim))
    gauss_seidel.sweep(problem, local, serial, **how)
    found = []
    for number in (1, 2):
        threads(number)
        found.append(np.zeros_like(serial))
        report = colored.sweep(problem, colors, local, found[-1], **how)
        assert report.sweeps == [12] and not report.converged
    np.testing.assert_array_equal(*found)
    assert np.abs(serial).max() > 1.0
    np.testing.assert_allclose(found[0], serial, atol=1e-12)


def test_contacts_of_a_colour_share_no_body():
    """One body under a hundred others, and some apart: more colours than a word has bits."""
    coupled = sp.random(300, 300, 0.01, random_state=1).tolil()
    coupled[:100, :100] = 1.0
    W = sp.kron(coupled + coupled.T + 400.0 * sp.eye(300), np.eye(2)).tocsr()
    problem, _, places, colors = store(W, -np.ones(600), np.full(300, 0.3), 2, "colored")
    rows = np.repeat(np.arange(300), np.diff(problem.offsets))
    color = np.searchsorted(colors, np.arange(300), side="right")
    apart = rows != problem.columns
    assert apart.any() and (color[rows] != color[problem.columns])[apart].all()
    assert sorted(places) == list(range(300))
    assert 100 <= len(colors) - 1 < 110


# Problems from elsewhere, if they are there.

CASES = Path(
    os.environ.get("XPER_FX_CASES", Path(__file__).resolve().parents[2].parent / "shared" / "cases")
)
FILES = sorted(CASES.glob("*.npz"))


@pytest.mark.skipif(not FILES, reason="no folder of problems (XPER_FX_CASES)")
@pytest.mark.parametrize("path", FILES or [None], ids=lambda path: path and path.stem[:30])
def test_problems_from_elsewhere(path):
    """Solved to 1e-8 by both measures; velocities are those of other solvers that converge.

    But for one object that slides on many points: it has several solutions, one a solver.
    """
    problem = FrictionProblem.read(path)
    result = problem.solve()
    assert_honest(problem, result)
    assert result.converged, result.reason
    assert result.errors.siconos_error <= 1e-8
    compared = 0
    for solver in ("proximal_point", "interior_point", "nlgs"):
        other = problem.solve(solver, max_sweeps=1000)
        assert_honest(problem, other)
        if other.converged:
            compared += 1
            difference = np.linalg.norm(result.velocity - other.velocity)
            unique = not path.stem.startswith("OneObject")
            assert not unique or difference <= 1e-5 * np.linalg.norm(problem.q), solver
    assert compared > 0
