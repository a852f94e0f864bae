# SPDX-License-Identifier: LGPL-3.0-or-later
"""The local solvers against the law itself: every answer is put back into the conditions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from xper_fx.nscd.algebra.small import for_dimension, sym_indices
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.laws.signorini import OPEN, SLIP, STICK

FRICTIONS = [0.0, 0.05, 1.0, 3.0]


def random_compliance(rng, dim, rank=None, spread=2.0):
    """Symmetric positive matrix with eigenvalues over 10^spread, of the given rank."""
    q, _ = np.linalg.qr(rng.normal(size=(dim, dim)))
    values = 10.0 ** rng.uniform(-spread / 2, spread / 2, dim)
    values[dim if rank is None else rank :] = 0.0
    return (q * values) @ q.T


def local_solve(w, b, v_min, shift, mu, bound):
    dim = len(b)
    packed = tuple(w[sym_indices(dim)])
    solver = contact_solver(dim, mu > 0.0 or bound > 0.0)
    r, status = solver(tuple(b), packed, v_min, tuple(shift), mu, bound)
    return np.array(r), status


def project(r, mu):
    """Projection on Coulomb's cone |r_T| <= mu r_N."""
    n, t = r[0], r[1:]
    size = np.linalg.norm(t)
    if size <= mu * n:
        return r
    if mu * size <= -n:
        return np.zeros_like(r)
    normal = (n + mu * size) / (1.0 + mu * mu)
    return np.concatenate([[normal], mu * normal * t / size])


def natural_map(w, b, v_min, shift, mu, r):
    """r - P_K(r - rho (u + mu |s| n)) (De Saxce, Feng 1998), zero exactly at a solution."""
    u = b + w @ r
    slip = u[1:] + shift
    rho = 1.0 / np.trace(w)
    de_saxce = np.concatenate([[u[0] - v_min + mu * np.linalg.norm(slip)], slip])
    return r - project(r - rho * de_saxce, mu)


def statuses_2d(w, b, v_min, shift, mu, bound):
    """Every solution in 2D, by trying open, stick and the two ways to slip."""
    found = []
    if b[0] >= v_min:
        return [np.zeros(2)]
    target = np.array([v_min, -shift[0]])
    r = np.linalg.solve(w, target - b)
    if r[0] >= 0.0 and abs(r[1]) <= mu * r[0] + bound:
        found.append(r)
    for sign in (-1.0, 1.0):
        # r_T = sign (mu r_N + bound)
        slope = w[0, 0] + sign * mu * w[0, 1]
        if slope != 0.0:
            n = (v_min - b[0] - sign * w[0, 1] * bound) / slope
            r = np.array([n, sign * (mu * n + bound)])
            if n >= 0.0 and sign * ((b + w @ r)[1] + shift[0]) <= 0.0:
                found.append(r)
    return found


@pytest.mark.parametrize("mu", FRICTIONS)
@pytest.mark.parametrize("dim", [2, 3])
def test_coulomb_satisfies_the_natural_map(dim, mu):
    rng = np.random.default_rng(dim)
    seen = set()
    for _ in range(500):
        size = 10.0 ** rng.uniform(-12, 12)
        w = size * random_compliance(rng, dim, spread=4.0)
        b = rng.normal(size=dim) * 10.0 ** rng.uniform(-1, 1, dim)
        v_min, shift = rng.choice([0.0, 0.7, -0.7]), rng.normal(size=dim - 1)
        if rng.random() < 0.5:  # so that sticking is not rare when mu is small
            held = rng.normal(size=dim) * (1.0, *[mu] * (dim - 1)) / size
            b = np.array([v_min, *-shift]) - w @ np.abs(held)
        r, status = local_solve(w, b, v_min, shift, mu, 0.0)
        residual = natural_map(w, b, v_min, shift, mu, r)
        # in velocities: the conditions are met to the rounding of W r
        assert np.linalg.norm(residual) <= 2e-11 * (np.linalg.norm(r) + np.linalg.norm(b) / size)
        seen.add(status)
        slip = (b + w @ r)[1:] + shift
        if status == OPEN:
            assert not r.any() and b[0] >= v_min
        elif status == STICK:
            assert np.linalg.norm(slip) <= 1e-10 * np.linalg.norm(size * r)
        else:
            assert np.linalg.norm(r[1:]) == pytest.approx(mu * r[0], rel=1e-12)
            assert r[1:] @ slip <= 0.0, "friction must dissipate"
    assert seen == ({OPEN, SLIP} if mu == 0.0 else {OPEN, STICK, SLIP})


@pytest.mark.parametrize("bound", [0.0, 0.3])
@pytest.mark.parametrize("mu", FRICTIONS)
def test_2d_is_one_of_the_enumerated_solutions(mu, bound):
    rng = np.random.default_rng(7)
    tried = 0
    for _ in range(500):
        w = random_compliance(rng, 2)
        b, v_min, shift = rng.normal(size=2), rng.normal(), rng.normal(size=1)
        solutions = statuses_2d(w, b, v_min, shift, mu, bound)
        if not solutions:  # Tresca's bound alone would open the point: tested below
            assert bound > 0.0
            continue
        r, _ = local_solve(w, b, v_min, shift, mu, bound)
        nearest = min(np.linalg.norm(r - s) for s in solutions)
        assert nearest <= 1e-11 * (1.0 + np.linalg.norm(r))
        tried += 1
    assert tried > 300


@pytest.mark.parametrize("bound", [1e-3, 0.3, 30.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_tresca_bound(dim, bound):
    """|r_T| <= bound while closed; where r_T alone would open the point, it stops at closed."""
    rng = np.random.default_rng(3)
    kinds = {"stick": 0, "slip": 0, "opened by its tangential impulse": 0}
    for _ in range(500):
        w = random_compliance(rng, dim)
        b, v_min, shift = rng.normal(size=dim), 0.2, rng.normal(size=dim - 1)
        r, status = local_solve(w, b, v_min, shift, 0.0, bound)
        u = b + w @ r
        slip, size = u[1:] + shift, np.linalg.norm(r[1:])
        if b[0] >= v_min:
            assert status == OPEN and not r.any()
            continue
        scale = 1e-11 * (1.0 + np.linalg.norm(w) * np.linalg.norm(r))
        assert r[0] >= 0.0
        assert u[0] == pytest.approx(v_min, abs=scale)
        assert size <= bound * (1.0 + 1e-12)
        if status == STICK:
            kinds["stick"] += 1
            assert np.linalg.norm(slip) <= scale
            continue
        # exactly against the slip
        assert r[1:] @ slip <= -(1.0 - 1e-9) * size * np.linalg.norm(slip) + scale
        if r[0] > 0.0:
            kinds["slip"] += 1
            assert size == pytest.approx(bound, rel=1e-12)
        else:
            kinds["opened by its tangential impulse"] += 1
    assert sum(kinds.values()) > 200
    if bound == 0.3:
        assert all(kinds.values()), kinds


@pytest.mark.parametrize("mu", [0.05, 1.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_edge_between_stick_and_slip(dim, mu):
    """b made so that sticking needs exactly, just less and just more than the cone holds."""
    rng = np.random.default_rng(11)
    for _ in range(50):
        w = random_compliance(rng, dim)
        direction = rng.normal(size=dim - 1)
        direction /= np.linalg.norm(direction)
        if w[0, 0] + mu * w[0, 1:] @ direction <= 0.1 * w[0, 0]:
            continue  # with so much coupling the open state is a solution too
        for factor, expected in ((1.0 - 1e-9, STICK), (1.0 + 1e-9, SLIP)):
            wanted = np.concatenate([[2.0], factor * 2.0 * mu * direction])
            r, status = local_solve(w, -w @ wanted, 0.0, np.zeros(dim - 1), mu, 0.0)
            assert status == expected
            np.testing.assert_allclose(r, wanted, rtol=0, atol=1e-6)
        wanted = np.concatenate([[2.0], 2.0 * mu * direction])
        r, _ = local_solve(w, -w @ wanted, 0.0, np.zeros(dim - 1), mu, 0.0)
        np.testing.assert_allclose(r, wanted, rtol=0, atol=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_edge_of_contact(dim):
    w, shift = np.eye(dim), np.zeros(dim - 1)
    b = np.ones(dim)
    b[0] = 0.5
    for v_min, expected in ((0.5, OPEN), (np.nextafter(0.5, 1), SLIP), (-np.inf, OPEN)):
        r, status = local_solve(w, b, v_min, shift, 0.3, 0.0)
        assert status == expected
        assert np.linalg.norm(r) <= 1e-15


@pytest.mark.parametrize("dim", [2, 3])
def test_frictionless_kernel_is_the_frictional_one_at_mu_zero(dim):
    rng = np.random.default_rng(5)
    plain, frictional = contact_solver(dim, False), contact_solver(dim, True)
    for _ in range(100):
        w = tuple(random_compliance(rng, dim)[sym_indices(dim)])
        b, shift = tuple(rng.normal(size=dim)), tuple(rng.normal(size=dim - 1))
        assert plain(b, w, 0.1, shift, 0.0, 0.0)[0] == pytest.approx(
            frictional(b, w, 0.1, shift, 0.0, 0.0)[0], rel=1e-14, abs=0
        )


@pytest.mark.parametrize("mu", FRICTIONS)
@pytest.mark.parametrize("dim", [2, 3])
def test_prescribed_directions_carry_no_impulse(dim, mu):
    b, shift = -np.ones(dim), np.zeros(dim - 1)
    r, _ = local_solve(np.zeros((dim, dim)), b, 0.0, shift, mu, 0.0)
    assert not r.any()
    for axes in itertools.product([0.0, 2.0], repeat=dim):
        r, _ = local_solve(np.diag(axes), b, 0.0, shift, mu, 0.0)
        assert np.all(np.isfinite(r))
        assert np.all(r[np.array(axes) == 0.0] == 0.0)
        if axes[0] > 0.0:
            assert r[0] == pytest.approx(0.5)
            free = np.flatnonzero(axes[1:])
            pull = min(0.5, mu * 0.5 / np.sqrt(max(len(free), 1)))
            np.testing.assert_allclose(r[1:][free], pull, rtol=1e-12)
        else:
            assert not r.any()


@pytest.mark.parametrize("rank", [1, 2])
@pytest.mark.parametrize("dim", [2, 3])
def test_singular_compliance_along_an_oblique_direction(dim, rank):
    """A node guided obliquely to the normal: friction still acts, nothing blows up."""
    if rank == dim:
        pytest.skip("regular")
    rng = np.random.default_rng(13)
    mu, slid = 0.2, 0
    for _ in range(200):
        w = random_compliance(rng, dim, rank=rank)
        if w[0, 0] < 0.3 * np.trace(w):  # too far from the normal: the point may jam
            continue
        # b within what the guided motion can do: closing it also stops the slip
        b = w @ rng.normal(size=dim)
        r, _ = local_solve(w, b, 0.0, np.zeros(dim - 1), mu, 0.0)
        assert np.linalg.norm(natural_map(w, b, 0.0, 0.0, mu, r)) <= 1e-9
        # and with a slip that closing does not stop
        shift = rng.normal(size=dim - 1)
        r, _ = local_solve(w, b, 0.0, shift, mu, 0.0)
        assert np.linalg.norm(natural_map(w, b, 0.0, shift, mu, r)) <= 1e-9
        slid += np.linalg.norm(r[1:]) > 0.0
    assert slid > 10


@pytest.mark.parametrize("dim", [2, 3])
def test_not_a_number_comes_back(dim):
    """A diverging solve must end, not hang."""
    no_shift = np.zeros(dim - 1)
    local_solve(np.eye(dim), [-1.0] + [np.nan] * (dim - 1), 0.0, no_shift, 0.3, 0.0)
    r, _ = local_solve(np.eye(dim), [np.nan] * dim, 0.0, no_shift, 0.3, 0.0)
    assert np.isnan(r).any()


@pytest.mark.parametrize("dim", [2, 3])
def test_compliance_with_springs(dim):
    rng = np.random.default_rng(17)
    soften = for_dimension(dim).compliance_with_springs
    rows, cols = sym_indices(dim)
    for rank in (None, dim - 1, 1, 0):
        w = random_compliance(rng, dim, rank)
        for kn, kt in ((0.0, 0.0), (3.0, 0.0), (0.0, 2.0), (50.0, 0.1), (1e6, 1e6)):
            k = np.diag([kn] + [kt] * (dim - 1))
            expected = np.linalg.solve(np.eye(dim) + w @ k, w)
            got = soften(tuple(w[rows, cols]), kn, kt)
            np.testing.assert_allclose(
                got, expected[rows, cols], rtol=0, atol=1e-9 * np.abs(expected).max()
            )


@pytest.mark.parametrize("dim", [2, 3])
def test_frames_turn_there_and_back(dim):
    rng = np.random.default_rng(19)
    q, _ = np.linalg.qr(rng.normal(size=(dim, dim)))
    q[-1] *= np.linalg.det(q)
    algebra = for_dimension(dim)
    x = rng.normal(size=dim)
    local = algebra.to_local(q[None], 0, tuple(x))
    np.testing.assert_allclose(local, q @ x, rtol=1e-14)
    np.testing.assert_allclose(algebra.to_global(q[None], 0, local), x, rtol=1e-14)
