# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction that depends on speed: against roots by scanning, an ODE, and balances."""

import numpy as np
import pytest
from point_mass import PointMass
from scipy.integrate import solve_ivp

import xper_fx as xf

MU_S, MU_D, SPEED = 0.6, 0.3, 0.05
EACH = pytest.mark.parametrize("contact", ["velocity", "position"])


def curve(v):
    return MU_D + (MU_S - MU_D) * np.exp(-v / SPEED)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("viscosity", [0.0, 0.5])
def test_the_point_obeys_its_law_on_the_branch_it_comes_from(dim, viscosity):
    """All states by scanning speeds with Coulomb's exact solution, isotropic W; then the branch."""
    rng = np.random.default_rng(3)
    law = xf.laws.StribeckFriction(MU_S, MU_D, SPEED, viscosity)
    solve_point, num = law.kernels(dim).solve, law.kernels(dim).num_terms
    speeds = np.geomspace(1e-7, 1.0, 10001)
    seen = {"stick": 0, "slip": 0, "kept slipping": 0, "kept sticking": 0}
    for _ in range(300):
        w_t, push = rng.uniform(0.1, 1.0), rng.uniform(0.05, 1.0)
        drive = rng.uniform(0.7 * MU_D, 1.2 * MU_S) * w_t * push
        start, angle = rng.choice([0.0, 0.3]) * rng.uniform(), rng.uniform(0.0, 2.0 * np.pi)
        along = np.array([1.0]) if dim == 2 else np.array([np.cos(angle), np.sin(angle)])
        u = np.array([-push, *(drive * along)])
        w = np.zeros((1, dim * (dim + 1) // 2))
        w[0, [0, 2] if dim == 2 else [0, 3, 5]] = [1.0] + [w_t] * (dim - 1)
        terms = np.zeros((1, num))
        terms[0, dim : dim + 2] = start, SPEED  # after the least speed and the shift
        if viscosity:
            terms[0, dim + 2] = viscosity
        numbers = [MU_S, MU_D, SPEED] + [viscosity] * bool(viscosity)
        found, _ = solve_point(
            0, tuple(u), (0.0,) * dim, w, np.array([[*numbers, 0.0]]), terms, np.zeros((1, 0))
        )
        found = np.array(found)
        slip = u[1:] + w_t * found[1:]
        v = np.linalg.norm(slip)
        assert found[0] == pytest.approx(push, rel=1e-12)
        # G of the speeds: T(v) = drive - W (mu(v) r_N + eta v), or 0
        excess = np.maximum(drive - w_t * (curve(speeds) * push + viscosity * speeds), 0.0) - speeds
        sticks = drive <= w_t * MU_S * push
        roots = speeds[:-1][(excess[:-1] > 0.0) & (excess[1:] <= 0.0)]
        unstable = speeds[:-1][(excess[:-1] <= 0.0) & (excess[1:] > 0.0)]
        slips = len(roots) and (not sticks or start > unstable[-1])
        if sticks and len(roots):
            seen["kept slipping" if slips else "kept sticking"] += 1
        else:
            seen["slip" if slips else "stick"] += 1
        if slips:
            assert v == pytest.approx(roots[-1], rel=4e-3)
            wanted = -(curve(v) * push + viscosity * v) * slip / v
            np.testing.assert_allclose(found[1:], wanted, rtol=1e-9)
        else:
            assert v <= 1e-15
    assert min(seen.values()) > 6


@pytest.mark.parametrize("dim", [2, 3])
def test_the_point_obeys_its_law_where_normal_and_tangent_couple(dim):
    rng, eta = np.random.default_rng(5), 0.3
    law = xf.laws.StribeckFriction(MU_S, MU_D, SPEED, eta)
    solve_point, num = law.kernels(dim).solve, law.kernels(dim).num_terms
    counts = np.zeros(3, int)
    for _ in range(300):
        root = rng.normal(size=(dim, dim))
        W = root @ root.T + 0.2 * np.eye(dim)
        u, terms = rng.normal(size=dim) * [1.0, *(0.5,) * (dim - 1)], np.zeros((1, num))
        terms[0, dim:] = rng.choice([0.0, 0.5]), SPEED, eta
        found, _ = solve_point(
            0, tuple(u), (0.0,) * dim, W[np.triu_indices(dim)][None],
            np.array([[MU_S, MU_D, SPEED, eta, 0.0]]), terms, np.zeros((1, 0)),
        )  # fmt: skip
        r = np.array(found)
        end = u + W @ r
        v, size = np.linalg.norm(end[1:]), np.linalg.norm(r[1:])
        if size == 0.0 and r[0] == 0.0:
            assert end[0] >= 0.0
            counts[0] += 1
            continue
        assert abs(end[0]) < 1e-12
        if r[0] == 0.0:  # the film alone would open the point, and gives what keeps it
            assert size <= eta * v and r[1:] @ end[1:] == pytest.approx(-size * v, rel=1e-9)
            continue
        counts[1 + (v > 1e-12)] += 1
        if v > 1e-12:
            wanted = -(curve(v) * r[0] + eta * v) * end[1:] / v
            np.testing.assert_allclose(r[1:], wanted, atol=1e-9 * (r[0] + size))
        else:
            assert size <= MU_S * r[0] * (1.0 + 1e-12)
    assert counts.min() > 10


def stick_slip(mass, stiffness, pull, press, end):
    """Times at which slips of a block end, and their largest speeds, by an integration of its own.

    The block hangs on a spring whose other end is drawn away.
    """
    hold = MU_S * press
    time, place = 0.0, 0.0
    ends, peaks = [], []
    while True:
        time += (hold / stiffness - (pull * time - place)) / pull
        if time > end:
            return np.array(ends), np.array(peaks)

        def rate(t, y):
            force = stiffness * (pull * t - y[0]) - curve(max(y[1], 0.0)) * press
            return [y[1], force / mass]

        def stops(t, y):
            return y[1]

        stops.terminal, stops.direction = True, -1
        slip = solve_ivp(
            rate, (time, time + 10.0), [place, 1e-9], "DOP853", events=stops, rtol=1e-9, atol=1e-12,
            max_step=2e-3,
        )  # fmt: skip
        time, place = slip.t[-1], slip.y[0, -1]
        ends.append(time)
        peaks.append(slip.y[1].max())


@EACH
def test_stick_slip_of_a_block_on_a_spring(contact):
    mass, stiffness, pull, press, end = 2.0, 400.0, 0.02, 10.0, 2.6
    ends, peaks = stick_slip(mass, stiffness, pull, press, end)
    law = xf.laws.StribeckFriction(MU_S, MU_D, SPEED, contact=contact)
    block, step = PointMass(law, mass, [0.0, 0.0], theta=0.5), 1e-3
    speeds, lost, work = [0.0], 0.0, 0.0
    for n in range(round(end / step)):
        middle = block.jump[1] + 0.5 * step * block.velocity[0, 1]
        force = stiffness * (pull * (n + 0.5) * step - middle)
        before, at = block.kinetic, block.jump[1]
        energies = block.step(step, [-press, force])
        assert energies[2] >= -1e-12
        lost += energies[2]
        work += force * (block.jump[1] - at) - (block.kinetic - before)
        speeds.append(block.velocity[0, 1])
    assert lost == pytest.approx(work, rel=1e-12)
    moving = np.array(speeds) > 1e-3
    begins = np.flatnonzero(moving[1:] & ~moving[:-1])
    stops = np.flatnonzero(moving[:-1] & ~moving[1:])
    np.testing.assert_allclose(step * stops, ends, atol=5.0 * step)
    found = [max(speeds[a:b]) for a, b in zip(begins, stops, strict=True)]
    np.testing.assert_allclose(found, peaks, rtol=5e-4)


def test_beyond_the_step_of_one_state_history_decides():
    """The same free velocity of 0.5 m/s: what rested sticks, what slipped at 0.1 m/s slips on."""
    law = xf.laws.StribeckFriction(MU_S, MU_D, SPEED)
    rested, slipped = PointMass(law, 1.0, [0.0, 0.0]), PointMass(law, 1.0, [0.0, 0.1])
    rested.step(0.1, [-10.0, 5.0])
    assert rested.velocity[0, 1] == 0.0
    slipped.step(0.1, [-10.0, 4.0])
    v = slipped.velocity[0, 1]
    assert v == pytest.approx(0.5 - 0.1 * 10.0 * curve(v), rel=1e-12) and v > 0.19


@pytest.mark.parametrize(("dim", "contact"), [(2, "velocity"), (3, "position")])
def test_a_film_drags_in_proportion_to_speed(contact, dim):
    mass, press, mu, eta, area, step = 3.0, 10.0, 0.2, 40.0, 0.05, 1e-2
    law = xf.laws.StribeckFriction(mu, mu, 1.0, eta, contact=contact)
    theta = 1.0 if contact == "velocity" else 0.5
    block = PointMass(law, mass, [0.0, 3.0, 4.0][:dim], area=area, theta=theta)
    force, v = np.zeros(dim), np.linalg.norm(block.velocity)
    force[0] = -press
    for _ in range(20):
        block.step(step, force)
        # m (v1 - v0) = -h (mu N + eta A (theta v1 + (1 - theta) v0))
        drag = step * eta * area / mass
        v = (v * (1.0 - (1.0 - theta) * drag) - step * mu * press / mass) / (1.0 + theta * drag)
        assert np.linalg.norm(block.velocity) == pytest.approx(v, rel=1e-9)


def test_random_loads_dissipate_at_every_step():
    rng = np.random.default_rng(2)
    law = xf.laws.StribeckFriction(MU_S, MU_D, SPEED, 3.0, contact="position")
    point = PointMass(law, 5.0, np.zeros(3), theta=0.5)
    for _ in range(300):
        force = rng.normal(size=3) * np.array([5.0, 15.0, 15.0])
        force[0] -= 5.0
        energies = point.step(rng.choice([1e-3, 3e-2]), force)
        assert min(energies[2:4]) >= -1e-9


def test_numbers_out_of_range_are_refused():
    with pytest.raises(ValueError, match="should fall with speed"):
        xf.laws.StribeckFriction(0.2, 0.3, 0.1)
    with pytest.raises(ValueError, match="speed should be a finite number above zero"):
        xf.laws.StribeckFriction(0.3, 0.2, 0.0)
    with pytest.raises(ValueError, match="viscosity should be"):
        xf.laws.StribeckFriction(0.3, 0.2, 0.1, viscosity=-1.0)
    with pytest.raises(ValueError, match="velocity jump"):
        xf.laws.StribeckFriction(0.3, 0.2, 0.1, restitution=0.5, contact="position")
