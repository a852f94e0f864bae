# SPDX-License-Identifier: LGPL-3.0-or-later
"""The frictional cohesive zone: its curve, its energy, and what it does over any step."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from point_mass import PointMass
from scipy.integrate import quad

from xper_fx.nscd.laws import CohesiveZone
from xper_fx.nscd.laws.curves import Parabolic
from xper_fx.nscd.laws.damage_curve import damage_functions
from xper_fx.nscd.point_tangents import PointTangents

# Zircaloy-4 (Perales et al. 2010, section 4.2.1).
C_N, W, R_MAX = 2e18, 0.5, 1e9
# By hand: d0 = Rmax / C_N, dc = (3/2)(0.5 nm + 0.5 nm / 6).
D0, DC = 5e-10, 8.75e-10
AREA = 1e-6
damage, mean_damage, _, _ = damage_functions(Parabolic.functions)
STEPS = [1e-11, 1e-10, 3e-10, 1e-9]
SPENT = W * AREA


def zircaloy(**options):
    return CohesiveZone(C_N, W, R_MAX, **options)


# -- the curve


def test_openings_by_hand():
    law = zircaloy()
    assert law.elastic_opening == pytest.approx(D0, rel=1e-14)
    assert law.critical_opening == pytest.approx(DC, rel=1e-14)
    assert law.softening_slope == pytest.approx(2e9 / 3.75e-10, rel=1e-14)
    skew = zircaloy(tangential_stiffness=1e18)
    assert skew.elastic_opening == pytest.approx(7.5e-10, rel=1e-14)
    assert skew.critical_opening == pytest.approx(1.5 * (5e-10 + 1.25e-10), rel=1e-14)


@pytest.mark.parametrize("beta0", [1.0, 0.4])
def test_damage_is_equation_37(beta0):
    assert damage(0.0, (D0, DC), beta0) == beta0
    assert damage(D0, (D0, DC), beta0) == beta0
    # half way down: y = 1/2, x = 6.875e-10, g = beta0 (5 / 6.875)(3 / 4)
    half_way = damage(6.875e-10, (D0, DC), beta0)
    assert half_way == pytest.approx(beta0 * 0.5454545454545454, rel=1e-13)
    assert damage(DC, (D0, DC), beta0) == 0.0
    assert damage(1.0, (D0, DC), beta0) == 0.0


@pytest.mark.parametrize("c_t", [2e18, 1e18, 8e18])
def test_peak_and_area_of_the_opening_curve(c_t):
    law = zircaloy(tangential_stiffness=c_t)
    d0, dc = law.elastic_opening, law.critical_opening
    traction = lambda x: damage(x, (d0, dc), 1.0) * C_N * x  # noqa: E731
    x = np.linspace(0.0, 1.1 * dc, 4001)
    ratio = 0.5 * (1.0 + C_N / c_t)
    # equal stiffnesses: exactly Rmax and w
    assert max(map(traction, x)) == pytest.approx(R_MAX * ratio, rel=1e-3)
    assert traction(d0) == pytest.approx(R_MAX * ratio, rel=1e-13)
    area = quad(traction, 0, d0)[0] + quad(traction, d0, dc, epsrel=1e-12)[0]
    assert area == pytest.approx(W * ratio, rel=1e-10)


@pytest.mark.parametrize(
    ("x0", "x1", "x_max"),
    [
        (0.0, 0.5 * D0, 0.0),
        (0.2 * D0, 1.1 * D0, 0.2 * D0),
        (1.1 * D0, 1.3 * D0, 1.1 * D0),
        (0.9 * D0, 2 * DC, 0.9 * D0),
        (0.0, 5 * DC, 0.0),
        (0.3 * D0, 1.4 * D0, 1.2 * D0),
        (0.3 * D0, 1.1 * D0, 1.2 * D0),
        (1.3 * D0, 0.1 * D0, 1.3 * D0),
        (0.0, 3 * DC, 1.5 * D0),
        (1.2 * D0, 1.4 * D0, 0.0),  # a gap at the start that no history knows of
        (2 * DC, 3 * DC, 0.0),
    ],
)
def test_mean_damage_against_quadrature(x0, x1, x_max):
    beta0 = 0.8
    beta = damage(max(x_max, D0), (D0, DC), beta0)

    def path(x):
        return beta if x <= x_max else min(beta, damage(x, (D0, DC), beta0))

    if x1 <= x0:
        expected = beta
    else:
        kinks = np.clip([D0, DC, x_max], x0, x1) / D0
        edges = np.unique(np.concatenate([[x0 / D0, x1 / D0], kinks]))
        integral = sum(
            quad(lambda y: path(y * D0) * y, a, b, epsabs=0, epsrel=1e-12)[0]
            for a, b in zip(edges[:-1], edges[1:], strict=True)
            if path(0.5 * (a + b) * D0) > 0.0
        )
        expected = 2.0 * integral / ((x1 / D0) ** 2 - (x0 / D0) ** 2)
    got = mean_damage(x1, x0, x_max, beta, (D0, DC), beta0)
    assert got == pytest.approx(expected, rel=1e-11, abs=1e-14)


def test_mean_damage_of_a_broken_bond_is_zero():
    assert mean_damage(2 * DC, 0.0, DC, 0.0, (D0, DC), 1.0) == 0.0


def test_mean_damage_of_a_vanishing_increment_does_not_cancel():
    for x0 in (D0, 1.2 * D0, 1.7 * D0):
        beta = damage(x0, (D0, DC), 1.0)
        for increment in 10.0 ** np.arange(-15.0, -3.0):
            x1 = x0 * (1.0 + increment)
            mean = mean_damage(x1, x0, x0, beta, (D0, DC), 1.0)
            ends = 0.5 * (beta + damage(x1, (D0, DC), 1.0))
            # a difference of energies would be off by 1e-16 / increment here
            assert mean == pytest.approx(ends, abs=20.0 * increment**2 + 2e-15)
            assert damage(x1, (D0, DC), 1.0) - 2e-15 <= mean <= beta + 2e-15


# -- one bond


def run_to_break(bond, step, max_steps=2000):
    """Totals of the energies and the least value of each over the steps."""
    total, least = np.zeros(6), np.zeros(6)
    for count in range(1, max_steps + 1):
        energies = np.array(bond.step(step))
        total += energies
        least = np.minimum(least, energies)
        if bond.damage == 0.0:
            return count, total, least
    raise AssertionError("the bond did not break")


@pytest.mark.parametrize(
    ("step", "theta", "masses"),
    [(1e-12, 0.5, 1), (1e-12, 1.0, 2), *itertools.product(STEPS, [0.5, 0.6, 1.0], [1, 2])],
)
def test_a_bond_torn_by_inertia_spends_its_fracture_energy(step, theta, masses):
    """Spent / w A - 1 is rounding, from 932 steps through the curve to a single one."""
    mass = 8.0 * SPENT
    law = zircaloy()
    if masses == 1:
        bond = PointMass(law, mass, [1.0, 0.0], area=AREA, theta=theta)
    else:
        bond = PointMass(
            law, [2 * mass, 2 * mass], [[0.5, 0.0], [-0.5, 0.0]], area=AREA, theta=theta
        )
    before = bond.kinetic
    count, total, least = run_to_break(bond, step)
    assert count <= 2 + 1e-9 / step
    assert total[1] == pytest.approx(SPENT, rel=1e-12)
    assert least[:4].min() >= -1e-15 * SPENT
    assert least[4] >= -1e-9 * SPENT  # what the local iteration on the damage leaves
    assert total[2] == 0.0
    if theta == 0.5:
        assert total[4] <= 1e-9 * SPENT
        assert before - bond.kinetic == pytest.approx(SPENT, rel=1e-10)
    else:
        assert total[4] > 0.0
    if masses == 2:
        assert np.abs(bond.velocity.sum(axis=0)).max() <= 1e-12


def test_lagged_damage_overspends_in_proportion_to_the_step():
    """1.2e-3 w too much at 1e-12 s (930 steps in the curve), 1.2e-2 at 1e-11, 0.13 at 1e-10."""
    excess = []
    for step in (1e-12, 1e-11, 1e-10):
        bond = PointMass(zircaloy(damage="lagged"), 8.0 * SPENT, [1.0, 0.0], area=AREA)
        _, total, least = run_to_break(bond, step)
        assert least.min() >= -1e-15 * SPENT
        excess.append(total[1] / SPENT - 1.0)
    np.testing.assert_allclose(excess, [1.241e-3, 1.244e-2, 0.1309], rtol=0.01)


@pytest.mark.parametrize("theta", [0.5, 1.0])
@pytest.mark.parametrize("number", [0.5, 0.99, 1.0, 1.01, 2.0, 10.0, 1e4])
def test_across_the_step_at_which_a_softening_bond_is_no_longer_unique(number, theta):
    """Force raised slowly to 1.2 times the strength; number = h^2 theta^2 A W 2 R / (dc - d0)."""
    step, law = 1e-10, zircaloy()
    mass = step**2 * theta**2 * AREA * law.softening_slope / number
    bond = PointMass(law, mass, [0.0, 0.0], area=AREA, theta=theta)
    total, least, stored = np.zeros(6), np.zeros(6), 0.0
    pulled_at_break = None
    for count in range(1, 200):
        factor = min(1.2, count / 100)
        force = np.array([[factor * R_MAX * AREA, 0.0]])
        before, kinetic = bond.velocity.copy(), bond.kinetic
        energies = np.array(bond.step(step, force))
        assert bond.report.converged or bond.report.residual < 1e-14
        total += energies
        least = np.minimum(least, energies)
        work = step * np.sum(force * (theta * bond.velocity + (1 - theta) * before))
        scheme = (theta - 0.5) * mass * np.sum((bond.velocity - before) ** 2)
        closure = work - (bond.kinetic - kinetic) - scheme
        closure -= energies[0] - stored + energies[1:].sum()
        stored = energies[0]
        assert abs(closure) <= 1e-9 * SPENT
        if bond.damage == 0.0:
            pulled_at_break = factor
            break
    assert total[1] == pytest.approx(SPENT, rel=1e-12)
    assert least.min() >= -1e-11 * SPENT
    assert 0.98 <= pulled_at_break <= 1.2


@pytest.mark.parametrize("c_t", [1e18, 8e18])
@pytest.mark.parametrize("dim", [2, 3])
def test_pure_opening_with_unequal_stiffnesses(dim, c_t):
    law = zircaloy(tangential_stiffness=c_t)
    expected = 0.5 * SPENT * (1.0 + C_N / c_t)
    bond = PointMass(law, 16.0 * SPENT, [1.0] + [0.0] * (dim - 1), area=AREA)
    _, total, _ = run_to_break(bond, 1e-10)
    assert total[1] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angle", [0.0, 30.0, 60.0, 90.0])
def test_mixed_mode_spends_the_same(angle, dim):
    """With equal stiffnesses the energy depends on |U| alone, shear included."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    direction = [c, s] if dim == 2 else [c, 0.6 * s, 0.8 * s]
    normal = np.array([0.6, 0.8] if dim == 2 else [0.6, 0.0, 0.8])
    bond = PointMass(zircaloy(), 8.0 * SPENT, np.zeros(dim), area=AREA, normal=normal)
    velocity = bond.frame.T @ direction
    bond = PointMass(zircaloy(), 8.0 * SPENT, velocity, area=AREA, normal=normal)
    _, total, least = run_to_break(bond, 5e-11)
    assert total[1] == pytest.approx(SPENT, rel=1e-10)
    assert least.min() >= -1e-12 * SPENT


def prescribed(law, path, step=1e-10, dim=2, theta=1.0):
    """Drive the jump along `path`; tractions of the end of each step (theta = 1)."""
    bond = PointMass(law, np.inf, np.zeros(dim), area=AREA, theta=theta)
    tractions, works, at = [], [], np.zeros(dim)
    for target in path:
        bond.velocity[:] = (np.asarray(target) - at) / step
        works.append(bond.step(step))
        assert bond.report.converged
        at = np.asarray(target)
        np.testing.assert_allclose(bond.jump, at, rtol=0, atol=1e-24)
        tractions.append(bond.impulse / (step * AREA))
    return bond, np.array(tractions), np.array(works)


def test_traction_follows_the_curve_when_the_jump_is_prescribed():
    x = np.linspace(0.0, 1.1 * DC, 1101)[1:]
    _, tractions, works = prescribed(zircaloy(), np.stack([x, 0 * x], axis=1))
    curve = np.array([-damage(v, (D0, DC), 1.0) * C_N * v for v in x])
    np.testing.assert_allclose(tractions[:, 0], curve, atol=0.01 * R_MAX)
    assert -tractions[:, 0].min() == pytest.approx(R_MAX, rel=5e-3)
    assert np.all(tractions[:, 1] == 0.0)
    assert works[:, 1].sum() == pytest.approx(SPENT, rel=1e-12)


def test_unloading_and_reloading_along_the_secant():
    opened = 1.4 * D0
    down = np.linspace(opened, 0.0, 8)[1:]
    x = np.concatenate([[0.5 * D0, opened], down, down[::-1], [opened]])
    bond, tractions, works = prescribed(zircaloy(), np.stack([x, 0 * x], axis=1))
    beta = damage(opened, (D0, DC), 1.0)
    np.testing.assert_allclose(tractions[2:, 0], -beta * C_N * x[2:], rtol=1e-10, atol=1e-3)
    assert np.abs(works[2:, 1]).max() <= 1e-14 * SPENT
    assert bond.damage == pytest.approx(beta, rel=1e-12)
    assert bond.opening_max == pytest.approx(opened, rel=1e-14)


def secant_of(x0, reached, x1):
    """Mean damage of opening from x0 to x1, by quadrature: a secant up to `reached`, then g."""
    beta = damage(reached, (D0, DC), 1.0)
    spent = quad(lambda x: x * damage(x, (D0, DC), 1.0), reached, x1, epsabs=0.0)[0]
    return (0.5 * beta * (reached**2 - x0**2) + spent) / (0.5 * (x1**2 - x0**2))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    reached=st.floats(1.05, 1.6), back=st.floats(0.0, 0.9), again=st.floats(1.0, 1.7),
    theta=st.sampled_from([0.5, 0.7, 1.0]),
)  # fmt: skip
def test_beyond_its_largest_opening_a_bond_goes_on_from_there(reached, back, again, theta):
    """Opened, unloaded and opened further in one step: the secant counts, not the curve again."""
    opened, x0, x1 = reached * D0, back * reached * D0, min(again * reached, 1.74) * D0
    beta = damage(opened, (D0, DC), 1.0)
    down = np.linspace(opened, x0, 4)[1:]
    path = np.concatenate([np.linspace(0.0, opened, 6)[1:], down])
    bond, _, works = prescribed(zircaloy(), np.stack([path, 0 * path], axis=1))
    assert bond.opening_max == pytest.approx(opened, rel=1e-12)
    assert bond.damage == pytest.approx(beta, rel=1e-12)
    before = works[:, 1].sum()
    mean = secant_of(x0, opened, x1)
    step, bond.theta = 1e-10, theta
    start = bond.velocity[0, 0]
    bond.velocity[0, 0] = ((x1 - x0) / step - (1.0 - theta) * start) / theta
    energies = bond.step(step)
    assert bond.jump[0] == pytest.approx(x1, rel=1e-9)
    pull = mean * C_N * (theta * x1 + (1.0 - theta) * x0) * AREA * step
    assert -bond.impulse[0] == pytest.approx(pull, rel=1e-8)
    # two ways lead to one damage: what it cost hangs on the largest opening alone
    straight, _, costs = prescribed(zircaloy(), [[x1, 0.0]])
    assert bond.damage == pytest.approx(straight.damage, rel=1e-9)
    assert before + energies.cohesion == pytest.approx(costs[0, 1], rel=1e-8, abs=1e-12 * SPENT)


@pytest.mark.parametrize("damage", ["mean", "lagged"])
@pytest.mark.parametrize("dim", [2, 3])
def test_lips_driven_into_each_other_do_not_damage_their_bond(dim, damage):
    """Where both sides are prescribed nothing keeps them apart; only what opens a bond weakens it.

    With a slip, too: its part alone counts.
    """
    slip = [0.5 * D0] + [0.0] * (dim - 2)
    path = [[-0.5 * DC, *np.zeros(dim - 1)], [-2.0 * DC, *slip], [0.0, *slip], [-DC, *slip]]
    bond, tractions, works = prescribed(zircaloy(damage=damage), path, dim=dim)
    assert bond.damage == 1.0
    assert bond.opening_max == pytest.approx(0.5 * D0, rel=1e-12)
    assert np.all(works[:, 1] == 0.0)
    np.testing.assert_allclose(tractions[1:, 1], -C_N * 0.5 * D0, rtol=1e-12)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    gap=st.floats(0.0, 2.0), approach=st.floats(-2.0, 2.0), free=st.floats(-2.0, 2.0),
    theta=st.sampled_from([0.5, 0.6, 1.0]), damage=st.sampled_from(["mean", "lagged"]),
)  # fmt: skip
def test_broken_lips_end_a_step_closed_or_with_the_speed_that_nothing_changes(
    gap, approach, free, theta, damage
):
    """v1 = max(v_free, -gap_middle / (h theta)): also where they part, but too late to be apart."""
    step, unit = 1e-10, D0 / 1e-10
    bond = PointMass(zircaloy(damage=damage), 1e-8, [approach * unit, 0.0], area=AREA, theta=theta)
    group = bond.interactions.groups[0]
    group.state[:] = (2 * DC, 0.0)
    group.jump[0, 0] = gap * D0
    force = bond.masses[0] * (free - approach) * unit / step
    energies = bond.step(step, [[force, 0.0]])
    closing = -(gap * D0 + step * (1.0 - theta) * approach * unit) / (step * theta)
    assert bond.velocity[0, 0] == pytest.approx(max(free * unit, closing), abs=1e-9 * unit)
    assert bond.jump[0] >= -1e-9 * D0
    # what closing lips stop is an impact, not the scheme's
    lost = bond.impulse[0] * (gap * D0 - bond.jump[0]) / step
    size = bond.masses[0] * unit**2
    assert lost >= -1e-9 * size
    assert energies.impact == pytest.approx(lost, abs=1e-8 * size)
    assert abs(energies.numerical) <= 1e-8 * size


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("steps", [1, 7])
@pytest.mark.parametrize("c_t", [1e18, 8e18])
@pytest.mark.parametrize("angle", [0.0, 40.0, 90.0])
def test_damage_of_the_end_spends_what_its_direction_costs(angle, c_t, steps, dim):
    """Along one direction the energy is that of the curve, C_N and C_T weighed as U.C.U does."""
    law = zircaloy(tangential_stiffness=c_t, damage="end")
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    direction = np.array([c, s] if dim == 2 else [c, 0.6 * s, 0.8 * s])
    bond = PointMass(law, np.inf, np.zeros(dim), area=AREA, theta=1.0)
    (group,), step = bond.interactions.groups, 1e-10
    total = 0.0
    for _ in range(steps):
        velocity = np.zeros((2, dim))
        velocity[0] = bond.frame.T @ direction * (1.1 * law.critical_opening / steps / step)
        bond.interactions.begin_step(step, 1.0)
        answers = PointTangents(bond.interactions)
        answers.respond(velocity.ravel())
        group.impulse[:] = answers.response[0]
        total += bond.interactions.commit(velocity.ravel()).cohesion
    assert bond.damage == 0.0
    whole = 0.5 * W * (1.0 / C_N + 1.0 / c_t)
    assert total == pytest.approx(AREA * (c_t + (C_N - c_t) * c * c) * whole, rel=1e-9)


@pytest.mark.parametrize("damage", ["mean", "lagged"])
@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("broken", [False, True])
def test_no_interpenetration_in_compression(broken, theta, damage):
    mass, step, force = 1e-8, 1e-10, 3e3 * AREA * 1e6
    bond = PointMass(zircaloy(damage=damage), mass, [0.0, 0.0], area=AREA, theta=theta)
    if broken:
        bond.step(step, [[1e12 * AREA, 0.0]])
        assert bond.damage == 0.0
    for _ in range(200):
        energies = bond.step(step, [[-force, 0.0]])
        assert bond.jump[0] >= -1e-15 * D0
        assert min(energies[1:]) >= -1e-12 * SPENT
    if not broken:
        assert bond.impulse[0] == pytest.approx(step * force, rel=1e-9)
        assert bond.damage == 1.0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("pull", [0.29, 0.31, 0.6])
def test_broken_lips_keep_friction(pull, dim):
    """Pressed by N and pulled by `pull` N along the lips, mu = 0.3: stick, or slide at once."""
    mu, mass, step, normal = 0.3, 1e-8, 1e-10, 1e-3
    bond = PointMass(zircaloy(friction=mu), mass, np.zeros(dim), area=AREA)
    group = bond.interactions.groups[0]
    group.state[:] = (2 * DC, 0.0)
    direction = np.array([0.0, 1.0] if dim == 2 else [0.0, 0.6, -0.8])
    force = pull * normal * direction
    force[0] = -normal
    heat = 0.0
    for _ in range(50):
        energies = bond.step(step, force[None])
        heat += energies.friction
        assert energies.friction >= 0.0 and energies.cohesion == 0.0
    speed = bond.velocity[0] @ direction
    # friction acts on the mean slip of the step: exact for a constant force at theta = 1/2
    assert speed == pytest.approx(max(pull - mu, 0.0) * normal / mass * 50 * step, abs=1e-12)
    slid = bond.jump @ direction
    assert heat == pytest.approx(mu * normal * slid, rel=1e-9, abs=1e-30)
    assert bond.status == (2 if pull > mu else 1)
    assert np.linalg.norm(bond.impulse[1:]) <= mu * bond.impulse[0] * (1 + 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["mean", "lagged"])
@pytest.mark.parametrize("mu", [0.0, 0.05, 1.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_random_loads_dissipate_at_every_step(dim, mu, damage):
    """Any force, step, theta, stiffness ratio: no dissipation below zero, and the books balance."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        theta = rng.choice([0.5, 0.6, 1.0])
        law = CohesiveZone(
            C_N, W, R_MAX, rng.choice([2e18, 1e18, 6e18]), mu, rng.choice([1.0, 0.5]), damage
        )
        mass, step = 10.0 ** rng.uniform(-9, -6), 10.0 ** rng.uniform(-11.5, -9)
        bond = PointMass(law, mass, 0.3 * rng.normal(size=dim), area=AREA, theta=theta)
        stored, beta = 0.0, law.initial_damage
        for count in range(40):
            if count % 5 == 0:
                force = rng.normal(size=(1, dim)) * AREA * R_MAX * 10.0 ** rng.uniform(-1, 0.5)
            before, kinetic = bond.velocity.copy(), bond.kinetic
            energies = bond.step(step, force, max_sweeps=200)
            assert bond.report.converged or bond.report.residual < 1e-14
            work = step * np.sum(force * (theta * bond.velocity + (1 - theta) * before))
            scheme = (theta - 0.5) * mass * np.sum((bond.velocity - before) ** 2)
            scale = max(abs(work), kinetic, bond.kinetic, energies.stored, 1e-3 * SPENT)
            closure = work - (bond.kinetic - kinetic) - scheme
            closure -= energies.stored - stored + sum(energies[1:])
            assert abs(closure) <= 1e-9 * scale
            assert min(energies) >= -1e-9 * scale
            assert bond.jump[0] >= -1e-11 * (D0 + np.linalg.norm(bond.jump))
            assert 0.0 <= bond.damage <= beta
            stored, beta = energies.stored, bond.damage


def test_a_step_can_begin_again_with_another_size():
    """Halving after a failed attempt gives the numbers of a run that never tried."""
    force = np.array([[0.8 * R_MAX * AREA, 0.3 * R_MAX * AREA]])
    runs = [PointMass(zircaloy(friction=0.1), 1e-8, [0.0, 0.0], area=AREA) for _ in range(2)]
    for count in range(30):
        if count % 3 == 0:  # an attempt at a step far too large, given up
            attempt = runs[0].interactions
            attempt.begin_step(1e-9, 0.5)
        jumps = []
        for bond in runs:
            bond.step(1e-10, force)
            jumps.append(bond.jump)
        np.testing.assert_array_equal(jumps[0], jumps[1])
    assert runs[0].damage < 1.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"normal_stiffness": -1.0}, "normal_stiffness"),
        ({"normal_stiffness": np.nan}, "normal_stiffness"),
        ({"fracture_energy": 0.0}, "fracture_energy"),
        ({"fracture_energy": np.inf}, "fracture_energy"),
        ({"strength": -1e9}, "strength"),
        ({"tangential_stiffness": 0.0}, "tangential_stiffness"),
        ({"friction": -0.1}, "friction"),
        ({"friction": np.nan}, "friction"),
        ({"initial_damage": 0.0}, "initial_damage"),
        ({"initial_damage": 1.5}, "initial_damage"),
        ({"initial_damage": np.nan}, "initial_damage"),
        ({"damage": "implicit"}, "mean"),
        # w = Rmax d0 / 2 = 0.25 exactly: breaks at its peak
        ({"fracture_energy": 0.25}, "Rmax d0 / 2"),
    ],
)
def test_bad_numbers_are_refused(options, words):
    numbers = {"normal_stiffness": C_N, "fracture_energy": W, "strength": R_MAX} | options
    with pytest.raises(ValueError, match=words):
        CohesiveZone(**numbers)


@pytest.mark.parametrize("damage", ["mean", "lagged"])
@pytest.mark.parametrize("dim", [2, 3])
def test_friction_that_grows_is_that_of_the_broken_part(dim, damage):
    """Pressed lips that are sheared apart: the traction is that of the bond and mu (1 - beta)."""
    law = zircaloy(friction=0.5, friction_grows=True, damage=damage)
    pressure, steps = 2e8, 400
    velocity = np.zeros(dim)
    velocity[1] = 1.0
    bond = PointMass(law, 1e9 * SPENT, velocity, area=AREA, theta=1.0)
    force = np.zeros(dim)
    force[0] = -pressure * AREA
    step, friction = 1.2 * DC / steps, 0.0
    for _ in range(steps):
        energies = bond.step(step, force)
        assert energies.friction >= 0.0
        friction += energies.friction
        beta, x = bond.damage, bond.jump[1]
        got = -bond.impulse[1] / (step * AREA)
        wanted = beta * C_N * x + 0.5 * (1.0 - beta) * pressure
        assert got == pytest.approx(wanted, rel=0.03, abs=0.02 * R_MAX)
    assert bond.damage == 0.0
    # mu sigma times the integral of 1 - g over the slip
    slip = bond.jump[1]
    lost = quad(lambda x: 1.0 - damage_of(x), 0.0, slip, points=[D0, DC], epsabs=0.0)[0]
    assert friction == pytest.approx(0.5 * pressure * AREA * lost, rel=0.02)


def damage_of(x):
    return damage(x, (D0, DC), 1.0)


def test_friction_that_grows_is_the_same_once_all_is_broken():
    whole, growing = (zircaloy(friction=0.4, friction_grows=grows) for grows in (False, True))
    ends = []
    for law in (whole, growing):
        bond = PointMass(law, 1e-9, [0.0, 3.0], area=AREA, theta=1.0)
        for _ in range(30):
            bond.step(1e-10, [0.0, 1e3])
        assert bond.damage == 0.0
        energies = bond.step(1e-10, [-1.0, 0.0])
        ends.append(energies.friction / (bond.velocity[0, 1] * 1e-10))
    assert ends[0] == pytest.approx(ends[1], rel=1e-2)


@pytest.mark.parametrize("dim", [2, 3])
def test_what_an_earlier_step_broke_beyond_the_curve_is_not_counted_again(dim):
    """A bond below its curve keeps its damage as it opens to the curve, and no step is blamed.

    Steps that were blamed were cut, however short, and the run stopped.
    """
    bond = PointMass(zircaloy(), 16.0 * SPENT, [1.0] + [0.0] * (dim - 1), area=AREA)
    bond.step(1.2 * D0)
    names, state = ("opening_max", "damage"), bond.interactions.groups[0].state
    assert bond.interactions.groups[0].kernels.state_names == names
    left = state[0, names.index("damage")] = 0.8 * bond.damage
    bond.step(0.01 * D0)
    assert bond.interactions.too_far == 0.0
    assert 1.1 * D0 < bond.opening_max < 1.3 * D0
    assert bond.damage == left
    bond.step(3.0 * DC)
    assert bond.interactions.too_far == 0.0 and bond.damage < left
