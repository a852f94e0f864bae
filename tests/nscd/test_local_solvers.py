# SPDX-License-Identifier: LGPL-3.0-or-later
"""Local solvers against known solutions, against the law, and against each other."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension, sym_indices
from xper_fx.nscd.laws.contact_solver import contact_solver
from xper_fx.nscd.local_solvers import (
    LOCAL_SOLVERS,
    bipotential,
    exact,
    explicit_applies,
    faceting_error,
    generalized_newton,
    lcp,
    local_solver,
    requires_diagonal,
)

FRICTIONS = [0.0, 1e-12, 0.3, 1.0, 2.0, 5.0]
STATUSES = ["open", "stick", "slip", "edge of contact", "edge of slip", "nothing", "light"]
FACETS = 8


@cache
def kernel(dim, solve, prepare, count=None):
    """Prepare all points, then solve them in the given order."""
    algebra = for_dimension(dim)
    row, set_row, sym_row = algebra.row, algebra.set_row, algebra.sym_row

    # as the callers compile: without reference counting
    @njit(error_model="numpy", _nrt=False)
    def prepare_all(w, mu, factors):
        for i in range(len(w)):
            prepare(sym_row(w, i), mu[i], factors, i)

    @njit(error_model="numpy", _nrt=False)
    def solve_all(order, b, w, mu, factors, r):
        for number in range(len(order)):
            i = np.uintp(order[number])
            set_row(r, i, solve(row(b, i), sym_row(w, i), factors, i, mu[i], row(r, i)))

    return prepare_all, solve_all


class Solver:
    """A local solver over arrays."""

    def __init__(self, dim, name, **options):
        self.dim, self.name = dim, name
        self.kernels = local_solver(dim, name, **options)
        self.prepare, self.solve = kernel(dim, self.kernels.solve, self.kernels.prepare)
        self.faceted = dim == 3 and name == "lcp"

    def __call__(self, b, w, mu, start=None, order=None, factors=None):
        """Impulses; w of shape (n, dim, dim). What `prepare` leaves unset is NaN."""
        n = len(b)
        packed = pack(w)
        mu = np.broadcast_to(np.asarray(mu, float), n)
        if factors is None:
            factors = np.full((n, self.kernels.num_factors), np.nan)
            self.prepare(packed, mu, factors)
        r = np.zeros_like(b) if start is None else start.copy()
        self.solve(np.arange(n) if order is None else order, b, packed, mu, factors, r)
        return r


@pytest.fixture(
    params=[(dim, name) for dim, names in LOCAL_SOLVERS.items() for name in names],
    ids=lambda p: f"{p[1]}-{p[0]}D",
    scope="module",
)
def solver(request):
    return Solver(*request.param)


def pack(w):
    return np.ascontiguousarray(w[(slice(None), *sym_indices(w.shape[1]))])


def compliances(rng, n, dim, diagonal=False, spread=4.0):
    """Symmetric positive definite, conditioned up to 10^spread."""
    values = 10.0 ** rng.uniform(-spread / 2, spread / 2, (n, dim))
    if diagonal:
        values[:, 2:] = values[:, 1:2]
        return values[:, :, None] * np.eye(dim)
    q, _ = np.linalg.qr(rng.normal(size=(n, dim, dim)))
    return np.einsum("nij,nj,nkj->nik", q, values, q)


def directions(rng, n, dim, faceted):
    """Unit tangential vectors; those of the polygon's vertices for a faceted cone."""
    if dim == 2:
        return rng.choice([-1.0, 1.0], (n, 1))
    angle = rng.uniform(0.0, 2 * np.pi, n)
    if faceted:
        angle = 2 * np.pi * rng.integers(0, FACETS, n) / FACETS
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def known(rng, status, w, mu, faceted=False):
    """Impulses and velocities that satisfy the law, in the given status."""
    n, dim = w.shape[:2]
    r, u = np.zeros((n, dim)), np.zeros((n, dim))
    along = directions(rng, n, dim, faceted)
    size = np.trace(w, axis1=1, axis2=2)[:, None]
    if status == "open":
        u = rng.normal(size=(n, dim)) * size
        u[:, 0] = np.abs(u[:, 0])
    elif status == "edge of contact":  # touches without impulse
        u[:, 1:] = rng.normal(size=(n, dim - 1)) * size
    elif status != "nothing":
        r[:, 0] = rng.uniform(0.1, 2.0, n) * (1e-9 if status == "light" else 1.0)
        share = rng.uniform(0.0, 0.99, n) if status == "stick" else np.ones(n)
        r[:, 1:] = (share * mu * r[:, 0])[:, None] * along
        if status in ("slip", "light"):
            u[:, 1:] = -along * size * 10.0 ** rng.uniform(-2, 1, (n, 1))
    return r, u


def tangential_size(x):
    return np.linalg.norm(x[:, 1:], axis=1)


def project(r, mu):
    """Projection on Coulomb's cone |r_T| <= mu r_N."""
    size, out = tangential_size(r), r.copy()
    outside = size > mu * r[:, 0]
    normal = np.maximum(r[:, 0] + mu * size, 0.0) / (1.0 + mu**2)
    shorter = mu * normal / np.where(size > 0.0, size, 1.0)
    out[outside, 0] = normal[outside]
    out[outside, 1:] = (shorter[:, None] * r[:, 1:])[outside]
    return out


def natural_map(b, w, mu, r):
    """|r - P_K(r - rho (u_N + mu |u_T|, u_T))| over the size of the impulses."""
    u = b + np.einsum("nij,nj->ni", w, r)
    trace = np.trace(w, axis1=1, axis2=2)[:, None]
    rho = 1.0 / np.where(trace > 0.0, trace, 1.0)
    corrected = u.copy()
    corrected[:, 0] += mu * tangential_size(u)
    size = np.linalg.norm(r, axis=1) + rho[:, 0] * np.linalg.norm(b, axis=1)
    gap = np.linalg.norm(r - project(r - rho * corrected, mu), axis=1)
    return gap / np.where(size > 0.0, size, 1.0)


def polygon_map(b, w, mu, r):
    """Violation of the faceted law, over the size of the impulses.

    u_N >= 0 complementary to r_N >= 0; r_T in the polygon of radius mu r_N and, of all its points,
    the one that dissipates most.
    """
    u = b + np.einsum("nij,nj->ni", w, r)
    rho = 1.0 / np.trace(w, axis1=1, axis2=2)
    size = np.linalg.norm(r, axis=1) + rho * np.linalg.norm(b, axis=1)
    angle = 2 * np.pi * np.arange(FACETS) / FACETS
    vertices = np.stack([np.cos(angle), np.sin(angle)])
    sides = np.stack([np.cos(angle + np.pi / FACETS), np.sin(angle + np.pi / FACETS)])
    reach = mu * r[:, 0]
    signorini = np.abs(np.minimum(r[:, 0], rho * u[:, 0]))
    leaves = ((r[:, 1:] @ sides).max(axis=1) - reach * np.cos(np.pi / FACETS)).clip(0.0)
    power = (u[:, 1:] * r[:, 1:]).sum(axis=1) - reach * (u[:, 1:] @ vertices).min(axis=1)
    size = np.where(size > 0.0, size, 1.0)
    return np.maximum.reduce([signorini, leaves, rho * np.abs(power) / size]) / size


def violation(solver, b, w, mu, r):
    return (polygon_map if solver.faceted else natural_map)(b, w, mu, r)


def has_one_closed_solution(b, w, mu):
    """Whether stick and the slips, in 3D roots of a quartic in lambda, are one solution."""
    if w.shape[1] == 2:
        return np.ones(len(b), bool)
    c = w[:, 1:, 0] / w[:, :1, 0]
    s = w[:, 1:, 1:] - c[:, :, None] * w[:, 0, None, 1:]
    g, push = b[:, 1:] - c * b[:, :1], -b[:, 0] / w[:, 0, 0]
    unit = np.trace(s, axis1=1, axis2=2)
    s, g = s / unit[:, None, None], g / unit[:, None]
    # r_T det(S + lambda) = -(adj S + lambda) g, r_N det(S + lambda) = limit / mu
    adjoint = np.einsum("nij,nj->ni", np.linalg.inv(s), g) * np.linalg.det(s)[:, None]
    zero = np.zeros(len(b))
    limit = np.stack([zero + 1.0, np.trace(s, axis1=1, axis2=2), np.linalg.det(s)], 1)
    limit *= push[:, None]
    limit[:, 1] += (c * g).sum(axis=1)
    limit[:, 2] += (c * adjoint).sum(axis=1)
    limit *= mu[:, None]
    single = np.zeros(len(b), bool)
    for i in range(len(b)):
        if mu[i] < 1e-6 or not g[i].any():
            single[i] = True
            continue
        size = np.zeros(5)
        for k in range(2):
            size[2:] += np.convolve([g[i, k], adjoint[i, k]], [g[i, k], adjoint[i, k]])
        roots = np.roots(np.convolve(limit[i], limit[i]) - size)
        real = roots[np.abs(roots.imag) <= 1e-5 * np.abs(roots)].real
        slips = np.sum((real > -1e-9) & (np.polyval(limit[i], real) > 0.0))
        sticks = limit[i, 2] >= np.sqrt(size[4]) * (1.0 + 1e-9)
        single[i] = slips + sticks <= 1
    return single


@pytest.mark.slow
@pytest.mark.parametrize("mu", FRICTIONS)
@pytest.mark.parametrize("status", STATUSES)
def test_known_solution(solver, status, mu):
    rng = np.random.default_rng(STATUSES.index(status))
    n, dim = 150, solver.dim
    w = compliances(rng, n, dim, requires_diagonal(solver.name))
    mu = np.full(n, mu)
    expected, u = known(rng, status, w, mu, solver.faceted)
    if status == "stick" and solver.faceted:
        expected[:, 1:] *= 0.9  # inside the polygon whatever the rounding
    b = u - np.einsum("nij,nj->ni", w, expected)
    opens = b[:, 0] >= 0.0  # strong coupling: the open state is a solution too, and is taken
    expected[opens] = 0.0
    one = opens | has_one_closed_solution(b, w, mu)
    if solver.faceted:  # the polygon has its own solutions when coupled strongly
        one &= opens | (mu * np.linalg.norm(w[:, 0, 1:], axis=1) < 0.3 * w[:, 0, 0])
    assert one.sum() > (10 if solver.faceted else 0.7 * n)
    start = rng.normal(size=b.shape)
    r = solver(b, w, mu, start)
    size = np.linalg.norm(r, axis=1) + np.linalg.norm(expected, axis=1)
    # 1e-10 of r; where it is a small difference of large terms, to the rounding of b
    blur = 1e-15 * np.linalg.norm(b, axis=1) / np.linalg.eigvalsh(w)[:, 0]
    error = np.linalg.norm(r - expected, axis=1)
    assert np.all(error[one] <= 1e-10 * size[one] + blur[one])
    assert violation(solver, b, w, mu, r).max() <= 1e-10
    if status in ("open", "edge of contact", "nothing"):
        assert not r.any()
    elif status == "slip" and mu[0] > 0.0:
        limited = one & ~opens
        np.testing.assert_allclose(tangential_size(r)[limited], (mu * r[:, 0])[limited], rtol=1e-9)


@pytest.mark.parametrize("mu", FRICTIONS)
def test_any_velocity(solver, mu):
    """Random b, and units of w and b over 24 decades: the law holds, in proportion."""
    rng = np.random.default_rng(31)
    n, dim = 400, solver.dim
    w = compliances(rng, n, dim, requires_diagonal(solver.name))
    b = rng.normal(size=(n, dim)) * 10.0 ** rng.uniform(-1, 1, (n, dim))
    b[::3, 0] *= -1e3  # pressed hard: sticks
    r = solver(b, w, mu)
    assert violation(solver, b, w, mu, r).max() <= 1e-10
    coupled = mu * np.linalg.norm(w[:, 0, 1:], axis=1) > w[:, 0, 0]
    if mu >= 1.0 and solver.name != "explicit":
        assert np.sum(coupled & (b[:, 0] < 0.0)) > 30, "the hard case was not met"
    one = (b[:, 0] >= 0.0) | has_one_closed_solution(b, w, np.full(n, mu))
    if solver.faceted:
        one &= ~coupled
    for b_unit in (1e-12, 1.0, 1e12):
        for w_unit in (1e-12, 1e12):
            scaled = solver(b_unit * b, w_unit * w, mu) * (w_unit / b_unit)
            size = np.linalg.norm(r, axis=1)
            assert np.all(np.linalg.norm(scaled - r, axis=1)[one] <= 1e-9 * size[one])
            assert violation(solver, b, w, mu, scaled).max() <= 1e-10


@pytest.mark.parametrize("dim", [2, 3])
def test_they_agree(dim):
    """One solution, whoever finds it (the faceted cone apart); b and starts at random."""
    rng = np.random.default_rng(37)
    n = 300
    mu = rng.choice(FRICTIONS, n)
    for diagonal in (False, True):
        w = compliances(rng, n, dim, diagonal)
        b = rng.normal(size=(n, dim))
        one = (b[:, 0] >= 0.0) | has_one_closed_solution(b, w, mu)
        answers = {
            name: Solver(dim, name)(b, w, mu, rng.normal(size=b.shape))[one]
            for name in LOCAL_SOLVERS[dim]
            if (diagonal or not requires_diagonal(name)) and (dim, name) != (3, "lcp")
        }
        assert one.sum() > 0.8 * n and len(answers) == (4 if diagonal else 3)
        reference = answers.pop("graph" if dim == 2 else "exact")
        size = np.linalg.norm(reference, axis=1)
        for name, r in answers.items():
            assert np.all(np.linalg.norm(r - reference, axis=1) <= 1e-10 * size), name


def test_points_keep_to_themselves(solver):
    """Visits in any order, and a row of factors, belong to one point."""
    rng = np.random.default_rng(41)
    n, dim = 60, solver.dim
    w = compliances(rng, n, dim, requires_diagonal(solver.name), spread=1.0)
    b = rng.normal(size=(n, dim)) - np.eye(dim)[0]
    mu = rng.uniform(0.1, 0.5, n)
    together = solver(b, w, mu)
    np.testing.assert_array_equal(solver(b, w, mu, order=rng.permutation(n)), together)
    alone = np.concatenate([solver(b[i : i + 1], w[i : i + 1], mu[i : i + 1]) for i in range(n)])
    np.testing.assert_array_equal(alone, together)
    factors = np.full((n, solver.kernels.num_factors), np.nan)
    solver.prepare(pack(w), mu, factors)
    before = factors.copy()
    chosen = np.arange(1, n, 2)
    solver(b, w, mu, order=chosen, factors=factors)
    np.testing.assert_array_equal(factors[::2], before[::2])
    # a warm start from another problem's memory leads to the same solution
    other = rng.normal(size=(n, dim))
    solver(other, w, mu, factors=factors)
    warm = solver(b, w, mu, start=solver(other, w, mu), factors=factors)
    np.testing.assert_allclose(warm, together, rtol=0, atol=1e-11 * np.abs(together).max())


@pytest.mark.parametrize("mu", [0.0, 0.2, 3.0])
def test_singular_compliance(solver, mu):
    """Directions of no compliance, on the axes and oblique: finite, and as the scene's solver."""
    dim = solver.dim
    reference = contact_solver(dim, True)
    rng = np.random.default_rng(43)
    if requires_diagonal(solver.name):
        w = np.array([np.diag([x, *[y] * (dim - 1)]) for x in (0.0, 2.0) for y in (0.0, 3.0)])
    else:
        w = [np.diag(v) for v in np.ndindex(*[2] * dim)]
        for rank in range(1, dim):
            q, _ = np.linalg.qr(rng.normal(size=(40, dim, dim)))
            w += list(np.einsum("nij,nkj->nik", q[:, :, :rank], q[:, :, :rank]))
        w = np.array(w, float)
    for guided in (False, True):
        b = rng.normal(size=(len(w), dim)) - 0.5 * np.eye(dim)[0]
        if guided:  # closing stops the slip
            b = np.einsum("nij,nj->ni", w, b)
        r = solver(b, w, mu)
        assert np.all(np.isfinite(r))
        free = np.einsum("nii->ni", w) == 0.0
        assert not r[free].any()
        still = (0.0,) * (dim - 1)
        expected = np.array([
            reference(tuple(x), tuple(packed), 0.0, still, mu, 0.0)[0]
            for x, packed in zip(b, pack(w), strict=True)
        ])  # fmt: skip
        regular = np.linalg.matrix_rank(w) == dim
        # guided almost tangentially, a point may jam: no impulse does then, or one of 1e14
        solvable = (natural_map(b, w, mu, expected) <= 1e-9) & ~(solver.faceted & regular)
        solvable &= np.abs(expected).max(axis=1) < 1e8
        coupling = mu * np.linalg.norm(w[:, 0, 1:], axis=1)
        same = solvable & ((coupling < 0.5 * w[:, 0, 0]) | guided)
        assert natural_map(b, w, mu, r)[solvable].max() <= 1e-9
        np.testing.assert_allclose(r[same], expected[same], rtol=1e-9, atol=1e-9)
        assert same.any() and (not guided or solvable.sum() >= 0.5 * len(w))


def test_finite_in_finite_out(solver):
    rng = np.random.default_rng(47)
    n, dim = 4000, solver.dim
    w = compliances(rng, n, dim, requires_diagonal(solver.name), spread=12.0)
    rank_one = rng.normal(size=(n, dim))
    w[::4] = np.einsum("ni,nj->nij", rank_one, rank_one)[::4]
    w[::7] = 0.0
    w *= 10.0 ** rng.uniform(-12, 12, (n, 1, 1))
    b = rng.choice([-1.0, 0.0, 1.0], (n, dim)) * 10.0 ** rng.uniform(-30, 30, (n, dim))
    start = rng.normal(size=(n, dim)) * 10.0 ** rng.uniform(-30, 30, (n, 1))
    mu = rng.choice([*FRICTIONS, 1e-300, 1e6], n)
    r = solver(b, w, mu, start)
    assert np.all(np.isfinite(r))
    assert np.all(r[:, 0] >= 0.0)


def test_explicit_needs_uncoupled_directions():
    assert [n for n in ("explicit", "graph", "bipotential", "lcp", "newton", "exact")
            if requires_diagonal(n)] == ["explicit"]  # fmt: skip
    w = np.array([[2.0, 0, 0, 3.0, 0, 3.0], [2.0, 0, 0, 3.0, 0, 3.1], [2.0, 0, 0, 3.0, 0.1, 3.0],
                  [2.0, 0.1, 0, 3.0, 0, 3.0], [2.0, 0, 0.1, 3.0, 0, 3.0]])  # fmt: skip
    assert explicit_applies(w).tolist() == [True, False, False, False, False]
    assert explicit_applies(np.array([[2.0, 0, 1.0], [2.0, 1e-6, 1.0]])).tolist() == [True, False]
    # why: with two tangential compliances slip turns away from b_T
    w = np.diag([1.0, 1.0, 4.0])[None]
    b = np.array([[-1.0, 3.0, 3.0]])
    assert natural_map(b, w, 0.3, Solver(3, "explicit")(b, w, 0.3)) > 1e-3
    assert natural_map(b, w, 0.3, Solver(3, "exact")(b, w, 0.3)) < 1e-14


def counts(dim, solver, count, status, spread, near=False, n=200):
    """Iterations of each closed point, negative where a sure solver finished; mu = 0.3."""
    rng = np.random.default_rng(53)
    w, mu = compliances(rng, n, dim, spread=spread), 0.3
    r, u = known(rng, status, w, np.full(n, mu))
    b = u - np.einsum("nij,nj->ni", w, r)
    factors = np.zeros((1, solver.num_factors))
    found, first = [], np.uint64(0)  # unsigned as in `kernel`: compiled once
    for i in np.flatnonzero(b[:, 0] < 0.0):
        packed, start = tuple(pack(w[i : i + 1])[0]), (0.0,) * dim
        solver.prepare(packed, mu, factors, 0)
        if near:  # the visit before, 0.1 % away
            away = tuple(b[i] * (1.0 + 1e-3 * rng.normal(size=dim)))
            start, _ = count(away, packed, factors, first, mu, start)
        found.append(count(tuple(b[i]), packed, factors, first, mu, start)[1])
    assert len(found) > 0.5 * n
    return np.array(found)


@pytest.mark.parametrize(
    "spread, near, mean, most", [(1.0, False, 3.3, 6), (4.0, False, 4.2, 8), (1.0, True, 2.05, 3)]
)
def test_exact_takes_few_steps(spread, near, mean, most):
    steps = counts(3, local_solver(3, "exact"), exact.solve_and_count, "slip", spread, near)
    assert np.mean(steps) <= mean and np.max(steps) <= most


def test_exact_from_any_memory():
    """Whatever root the visit before left behind."""
    solver, rng, n = Solver(3, "exact"), np.random.default_rng(59), 3000
    for spread in (1.0, 4.0):
        w = compliances(rng, n, 3, spread=spread)
        mu = 10.0 ** rng.uniform(-3, 1, n)
        b = rng.normal(size=(n, 3)) * 10.0 ** rng.uniform(-2, 2, (n, 3))
        factors = np.zeros((n, solver.kernels.num_factors))
        solver.prepare(pack(w), mu, factors)
        assert not factors[:, -1].any()
        factors[:, -1] = 10.0 ** rng.uniform(-10, 20, n)
        r = solver(b, w, mu, factors=factors)
        assert natural_map(b, w, mu, r).max() <= 1e-12
        assert np.count_nonzero(factors[:, -1] < 1e-2) > 0.02 * n  # it did move


def test_sure_solver_seldom_finishes():
    """It may not do the work of the others."""
    newton, solve = local_solver(3, "newton"), generalized_newton.solve_and_count
    for status, mean in (("stick", 3.0), ("slip", 4.5)):
        assert np.all(counts(3, newton, solve, status, 1.0) > 0)
        found = counts(3, newton, solve, status, 4.0)
        assert np.mean(np.abs(found)) <= mean + 1.5 and np.mean(found < 0) <= 0.03
    for dim in (2, 3):
        solve = lcp.kernels(dim, 2 if dim == 2 else FACETS)[3]
        for status in ("stick", "slip"):
            found = counts(dim, local_solver(dim, "lcp"), solve, status, 4.0)
            assert np.all(found > 0) and np.mean(found) <= 7.0, (dim, status)
        solve = bipotential.kernels(dim)[2]
        found = counts(dim, local_solver(dim, "bipotential"), solve, "slip", 1.0)
        assert np.mean(found < 0) <= 0.02 and np.mean(np.abs(found)) <= 20


def test_faceted_cone_converges():
    """The impulse to first order in 1/m, the friction power and |r_T| to second."""
    errors = np.array([faceting_error(m, samples=90) for m in (6, 18)])
    orders = np.log(errors[0] / errors[1]) / np.log(3.0)
    np.testing.assert_allclose(orders, [1.0, 2.0, 2.0], atol=0.15)
    assert 0.1 < errors[0, 0] < 0.2
    # what the polygon's sides are short of, and reached to a tenth
    worst = 1.0 - np.cos(np.pi / np.array([6, 18]))
    for error in errors[:, 1:].T:
        assert np.all((0.7 * worst <= error) & (error <= worst * (1.0 + 1e-9)))


def test_what_is_refused():
    with pytest.raises(ValueError, match="dimension 2 or 3"):
        local_solver(4, "exact")
    with pytest.raises(ValueError, match="choose among explicit, graph"):
        local_solver(2, "newton")
    with pytest.raises(ValueError, match="no option facets"):
        local_solver(3, "exact", facets=8)
    with pytest.raises(ValueError, match="at least 3"):
        local_solver(3, "lcp", facets=2)
    with pytest.raises(ValueError, match="two sides"):
        local_solver(2, "lcp", facets=6)
    assert local_solver(3, "lcp", facets=6) is local_solver(3, "lcp", facets=6)
