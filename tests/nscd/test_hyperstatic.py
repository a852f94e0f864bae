# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts in excess, near collapse, of very different masses, or without any solution."""

from __future__ import annotations

import numpy as np
import problems
import pytest
import scipy.sparse as sp
from problems import GRAVITY, STEP
from test_friction_problem import assert_honest

from xper_fx.nscd.friction import FrictionProblem


def solved(problem, **options):
    """The result of the default solver, found to solve the problem."""
    problem = FrictionProblem(*problem)
    result = problem.solve(**options)
    assert_honest(problem, result)
    assert result.converged, result.reason
    return result


STANDING = {
    "square pile": lambda: problems.square_pile(20),
    "pyramid": lambda: problems.pyramid(20),
    "box stack": lambda: problems.box_stack(30),
    "box wall": lambda: problems.box_wall(8, 4),
    "wall, mu 2": lambda: problems.box_wall(8, 4, mu=2.0),
    "column, masses 1 and 1e3": lambda: problems.column_with_mass_ratio(8, 1e3),
    "column, masses 1 and 1e6": lambda: problems.column_with_mass_ratio(8, 1e6),
    "column in 2D": lambda: problems.column_with_mass_ratio(8, 1e6, dim=2),
    "arch": lambda: problems.arch(40, 1.03 * 0.1075),
}


@pytest.mark.parametrize("make", STANDING.values(), ids=STANDING.keys())
def test_stands(make):
    problem = make()
    result = solved(problem)
    assert np.abs(result.velocity).max() <= 1e-7 * np.abs(problem.q).max()


@pytest.mark.parametrize("rows", [6, 20])
def test_ground_carries_a_pyramid(rows):
    """Whatever impulses are between the bricks, the ground carries their weight, rows^2 + rows."""
    result = solved(problems.pyramid(rows))
    r = result.reaction.reshape(-1, 2)
    on_ground = r[-2 * rows :]  # the ground comes last among what lies below
    weight = 1000.0 * (rows * rows + rows) * GRAVITY * STEP
    assert on_ground[:, 0].sum() == pytest.approx(weight, rel=1e-6)
    assert on_ground[:, 1].sum() == pytest.approx(0.0, abs=1e-6 * weight)


@pytest.mark.parametrize("blocks", [40, 61])
def test_a_thin_arch_falls(blocks):
    """3 % below the limit: some joint opens, four orders faster than in one that stands."""
    result = solved(problems.arch(blocks, 0.97 * 0.1075))
    assert np.abs(result.velocity).max() > 1e-3 * STEP * GRAVITY


def test_little_friction_lets_an_arch_slide():
    result = solved(problems.arch(20, 0.2, mu=0.1))
    assert np.abs(result.velocity).max() > 1e-2 * STEP * GRAVITY


def test_as_much_weight_above_each_face_of_a_column():
    """Light cubes below one 1e6 times heavier: sums over a face are statically determined."""
    result = solved(problems.column_with_mass_ratio(4, 1e6))
    normal = result.reaction[::3].reshape(-1, 4).sum(axis=1) / (1000.0 * GRAVITY * STEP)
    # faces between cubes from below, then the ground
    np.testing.assert_allclose(normal, 1e6 + np.array([3.0, 2.0, 1.0, 0.0, 4.0]), rtol=1e-7)


@pytest.mark.parametrize("copies", [2, 20])
def test_a_point_written_several_times(copies):
    """Its impulses add up to that of the point alone; the other points do not notice."""
    once = solved(problems.redundant_points(1), tolerance=1e-10)
    many = solved(problems.redundant_points(copies), tolerance=1e-10)
    np.testing.assert_allclose(
        many.velocity[: len(once.velocity)], once.velocity, atol=1e-7 * np.abs(once.velocity).max()
    )
    impulses = many.reaction.reshape(-1, 3).sum(axis=0)
    np.testing.assert_allclose(impulses[0], once.reaction.reshape(-1, 3).sum(axis=0)[0], rtol=1e-6)


def test_sliver():
    """A needle 1e4 times longer than thick slides on another: friction mu m g h along it."""
    mu, pushed = 0.5, 0.5
    problem = problems.sliver(1e4, mu)
    result = solved(problem, tolerance=1e-10)
    sliding = np.abs(problem.q.reshape(-1, 3)[:, 1:]).max(axis=1) > 0.1
    assert sliding.sum() == 4
    u = result.velocity.reshape(-1, 3)[sliding]
    slip = np.linalg.norm(u[:, 1:], axis=1)
    np.testing.assert_allclose(slip, pushed - mu * GRAVITY * STEP, rtol=1e-3)
    np.testing.assert_allclose(u[:, 0], 0.0, atol=1e-7)


def test_impact_dissipates():
    """A cube hits the topmost of a stack: impulses do negative work, and friction does."""
    problem = problems.impact(5)
    result = solved(problem)
    assert result.reaction @ (0.5 * (result.velocity + problem.q)) < -1.0
    assert result.reaction @ result.velocity < -1e-3


# W that is not what it should be.


@pytest.mark.parametrize("contacts", [[0], [2, 3, 9]])
def test_contacts_that_cannot_move(contacts):
    """Zero rows and columns of W: no impulse there, u = q, and the rest is solved."""
    problem = problems.with_zero_rows(problems.box_stack(4), contacts)
    result = solved(problem)
    r, u = result.reaction.reshape(-1, 3), result.velocity.reshape(-1, 3)
    np.testing.assert_array_equal(r[contacts], 0.0)
    np.testing.assert_array_equal(u[contacts], problem.q.reshape(-1, 3)[contacts])


@pytest.mark.parametrize("solver", ["auto", "nlgs", "interior_point", "newton"])
@pytest.mark.parametrize("make", [lambda: problems.square_pile(3), lambda: problems.box_stack(3)],
                         ids=["2D", "3D"])  # fmt: skip
def test_contacts_that_cannot_move_but_close(solver, make):
    """No solution: said so with the number of the contact, in the order given."""
    problem = problems.with_zero_rows(make(), [5, 7])
    problem.q[problem.dim * 7] = -0.25
    problem = FrictionProblem(*problem)
    for order in ("given", "shuffled"):
        result = problem.solve(solver, order=order, max_sweeps=300)
        assert_honest(problem, result)
        assert not result.converged
        assert "contact 7 " in result.reason and "-0.25" in result.reason
    if solver == "auto":  # what can be solved is
        u = result.velocity.reshape(-1, problem.dim)
        others = np.delete(u, 7, axis=0)
        assert others[:, 0].min() > -1e-6 * np.abs(problem.q).max()


def squeezed(dim):
    """A body between two plates that come nearer: what parts it from one presses on the other."""
    W = np.eye(2 * dim)
    W[0, dim] = W[dim, 0] = -1.0
    q = np.zeros(2 * dim)
    q[0] = q[dim] = -1.0
    return W, q, np.full(2, 0.3), dim


@pytest.mark.parametrize("solver", ["auto", "nlgs", "anderson", "newton",
                                    "proximal_point", "interior_point"])  # fmt: skip
@pytest.mark.parametrize("dim", [2, 3])
def test_a_body_squeezed_has_no_solution(solver, dim):
    """u_N0 + u_N1 = -2 whatever r: finite, not converged, a reason, within the sweeps allowed."""
    problem = FrictionProblem(*squeezed(dim))
    result = problem.solve(solver, max_sweeps=200)
    assert_honest(problem, result)
    assert not result.converged and result.error > 0.1
    assert result.sweeps <= 200
    assert len(result.history) <= 2000
    assert f"{result.error:.3g}" in result.reason


def test_one_part_without_solution_leaves_the_others_solved():
    W, q, mu, dim = squeezed(2)
    pile = problems.square_pile(5)
    problem = FrictionProblem(
        sp.block_diag([W * pile.W.diagonal().mean(), pile.W], format="csr"),
        np.concatenate([0.1 * q, pile.q]), np.concatenate([mu, pile.mu]), dim,
    )  # fmt: skip
    result = problem.solve(max_sweeps=200)
    assert_honest(problem, result)
    assert not result.converged
    assert np.abs(result.velocity[4:]).max() <= 1e-6 * np.abs(pile.q).max()


@pytest.mark.parametrize(
    "make",
    [lambda: problems.pyramid(6), lambda: problems.sphere_heap(20), lambda: problems.box_stack(6)],
    ids=["2D", "3D", "boxes"],
)
def test_slightly_unsymmetric(make):
    """W as measured, off by 1e-3: the problem as it is given is solved, not its symmetric part."""
    problem = make()
    rng = np.random.default_rng(0)
    W = problem.W.copy()
    W.data *= 1.0 + 1e-3 * rng.uniform(-1.0, 1.0, len(W.data))
    solved(problem._replace(W=W))
    symmetric = solved(problem._replace(W=0.5 * (W + W.T)))
    assert FrictionProblem(W, *problem[1:]).errors(symmetric.reaction).error > 1e-6


# How much work.


@pytest.mark.parametrize(
    "make, sizes",
    [(problems.square_pile, (5, 10, 20)), (problems.box_stack, (5, 20, 50))],
    ids=["2D", "3D"],
)
def test_interior_point_hardly_depends_on_the_size(make, sizes):
    for size in sizes:
        problem = FrictionProblem(*make(size))
        result = problem.solve("interior_point")
        assert_honest(problem, result)
        assert result.converged
        assert len(result.history) <= 30


def test_sweeps_alone_do_not_do():
    """What the interior point is for: a pile of 8 rows after 1000 sweeps."""
    problem = FrictionProblem(*problems.square_pile(8))
    assert problem.solve("nlgs", max_sweeps=1000).error > 1e-5
    result = problem.solve(max_sweeps=1000)
    assert result.converged and result.sweeps < 500
