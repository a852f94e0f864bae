# SPDX-License-Identifier: LGPL-3.0-or-later
"""The generated problems against mechanics: closed forms, statics by linear programming, ranks."""

from __future__ import annotations

import numpy as np
import problems
import pytest
import scipy.sparse as sp
from problems import GRAVITY, STEP
from scipy.optimize import linprog, minimize

from xper_fx.nscd.friction.input_checks import checked

ALL = {
    "square pile": (problems.square_pile(4), 3 * 16),
    "pyramid": (problems.pyramid(4), 3 * 10),
    "arch": (problems.arch(12, 0.12), None),
    "box stack": (problems.box_stack(5), 6 * 5),
    "box wall": (problems.box_wall(3, 2), 6 * (2 + 3 + 2)),
    "column": (problems.column_with_mass_ratio(4, 1e6), None),
    "column 2D": (problems.column_with_mass_ratio(4, 1e6, dim=2), None),
    "impact": (problems.impact(4), 6 * 5),
    "capsules": (problems.capsule_heap(90), None),
    "spheres": (problems.sphere_heap(60), None),
    "driven": (problems.driven_heap(40), None),
    "disks": (problems.disks_on_wall(60), None),
    "one object": (problems.one_object(25), 6),
    "redundant": (problems.redundant_points(20), 6),
    "sliver": (problems.sliver(), None),
    "zero rows": (problems.with_zero_rows(problems.box_stack(4), [2, 3]), None),
}


@pytest.mark.parametrize("problem, rank", ALL.values(), ids=ALL.keys())
def test_is_a_delassus_operator(problem, rank):
    W = checked(*problem)[0].toarray()
    values = np.linalg.eigvalsh(0.5 * (W + W.T))
    assert values[0] >= -1e-12 * values[-1]
    assert np.abs(W - W.T).max() <= 1e-14 * np.abs(W).max()
    if rank is not None:
        assert (values > 1e-10 * values[-1]).sum() == rank


def test_one_square_on_two_points():
    """W and q by hand: m = 1000, I = m / 6, points at (-1/2, -1/2) and (1/2, -1/2)."""
    W, q, mu, dim = problems.square_pile(1)
    m, inertia, a = 1000.0, 1000.0 / 6.0, 0.5
    # t is n turned by +90 degrees, (-1, 0): a point at (x, y) has u_N = x spin, u_T = y spin
    H_T = np.array([[0, 1, -a], [-1, 0, -a], [0, 1, a], [-1, 0, -a]])
    np.testing.assert_allclose(W.toarray(), H_T @ np.diag([1 / m, 1 / m, 1 / inertia]) @ H_T.T)
    np.testing.assert_allclose(q, [-STEP * GRAVITY, 0, -STEP * GRAVITY, 0], atol=1e-17)
    contacts = problems.boxes_in_contact(np.zeros((1, 2)), np.ones((1, 2)))
    got = problems.transfer(np.array([[0.5, 0.5]]), contacts)
    np.testing.assert_array_equal(got.toarray(), H_T)
    # half the weight on each stops it, without friction
    np.testing.assert_allclose(W @ np.array([1, 0, 1, 0]) * m * GRAVITY * STEP / 2, -q, atol=1e-15)


def test_weight_stops_a_column():
    """Cubes of 1000 kg under 1e6 kg, 3D: each face carries what is above it, 4 equal parts."""
    W, q, mu, dim = problems.column_with_mass_ratio(3, 1e3)
    above = 1000.0 * np.array([1003.0, 1002.0, 1001.0, 1000.0])
    r = np.zeros(len(q))
    heights = np.repeat(np.append(np.arange(1, 4), 0), 4)  # the ground comes last
    r[::3] = above[heights] * GRAVITY * STEP / 4
    np.testing.assert_allclose(W @ r + q, 0.0, atol=1e-13)


def test_relative_velocity_of_two_bodies_in_3d():
    """H^T against v + w x lever at the point, candidate minus antagonist."""
    rng = np.random.default_rng(0)
    centres = rng.normal(size=(3, 3))
    normals = rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    contacts = problems.Contacts(
        rng.normal(size=(4, 3)), normals, np.array([0, 2, 1, 0]), np.array([1, 0, -1, 2])
    )
    velocity = rng.normal(size=(3, 6))
    got = (problems.transfer(centres, contacts) @ velocity.ravel()).reshape(4, 3)
    frame = problems.frames(normals)
    for k, (point, candidate, antagonist) in enumerate(
        zip(contacts.points, contacts.candidates, contacts.antagonists, strict=True)
    ):
        at = [
            velocity[body, :3] + np.cross(velocity[body, 3:], point - centres[body])
            for body in (candidate, antagonist)
        ]
        jump = at[0] - (at[1] if antagonist >= 0 else 0.0)
        np.testing.assert_allclose(got[k], frame[k] @ jump, rtol=1e-13)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)),
                               atol=1e-15)  # fmt: skip


def test_closest_points_of_segments():
    rng = np.random.default_rng(1)
    c1, a1, c2, a2 = rng.normal(size=(4, 200, 3))
    s, t = problems.closest_on_segments(c1, a1, c2, a2)
    for k in range(0, 200, 5):

        def distance(x, k=k):
            return np.linalg.norm(c1[k] + x[0] * a1[k] - c2[k] - x[1] * a2[k])

        best = minimize(lambda x: distance(x) ** 2, [0.0, 0.0], bounds=[(-1, 1)] * 2)
        assert distance([s[k], t[k]]) <= np.sqrt(best.fun) + 1e-6


def stands(problem, directions=8):
    """Whether some r in the cones (in 3D, pyramids inside them) gives W r + q = 0."""
    W, q, mu, dim = problem
    angle = 2 * np.pi * np.arange(directions) / directions
    sides = np.stack([np.cos(angle), np.sin(angle)], axis=1) if dim == 3 else [[-1.0], [1.0]]
    edges = [np.insert(value * np.asarray(sides), 0, 1.0, axis=1).T for value in mu]
    A = W @ sp.block_diag(edges, format="csr") / W.diagonal().mean()
    return linprog(np.ones(A.shape[1]), A_eq=A, b_eq=-q, bounds=(0, None)).status == 0


@pytest.mark.parametrize("name", ["square pile", "pyramid", "arch", "box stack", "box wall"])
def test_stands(name):
    assert stands(ALL[name][0])


def test_does_not_stand():
    assert not stands(problems.impact(3))
    assert not stands(problems.arch(30, 0.2, mu=0.1))  # it slides


def test_limit_thickness_of_an_arch():
    """0.1075 of the radius (Milankovitch 1907; 0.106 if the weight were along the centre line)."""
    assert not stands(problems.arch(60, 0.1070))
    assert stands(problems.arch(60, 0.1079))


def test_same_seed_same_problem():
    first, second, other = (problems.capsule_heap(30, seed) for seed in (4, 4, 5))
    assert (first.W != second.W).nnz == 0
    np.testing.assert_array_equal(first.q, second.q)
    assert np.abs(first.q - other.q).max() > 0.0


def test_capsules_have_the_statistics_of_the_files():
    """225 to 286 contacts, W of 0.67 to 0.71 of full rank; pairs of points along parallel ones."""
    W, _, mu, _ = problems.capsule_heap(90)
    assert len(mu) == 270
    assert 0.6 < np.linalg.matrix_rank(W.toarray(), hermitian=True) / (3 * 270) < 0.75
