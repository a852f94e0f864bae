# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact, friction, restitution and perfect bonds on problems with an exact answer."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws import (
    MohrCoulomb,
    PerfectBond,
    RigidCohesiveZone,
    SignoriniCoulomb,
    SlipWeakening,
    StribeckFriction,
    Tresca,
)

GRAVITY = 9.81


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_bouncing_point_without_gravity(e, theta, dim):
    """One impact: v+ = -e v-, tangential velocity kept, the loss of kinetic energy accounted."""
    approach = np.zeros(dim)
    approach[:2] = -2.0, 0.3
    mass, step = 3.0, 1e-2
    ball = PointMass(SignoriniCoulomb(restitution=e), mass, approach, gap=0.105, theta=theta)
    before, lost, impacts = ball.kinetic, np.zeros(6), 0
    for _ in range(20):
        at_start = ball.velocity.copy()
        lost += ball.step(step)
        if (ball.velocity != at_start).any():
            impacts += 1
            change = ball.velocity - at_start
            lost[4] += (theta - 0.5) * mass * np.sum(change**2)  # the scheme's own, but for
            lost[4] -= ball.interactions.from_scheme
    assert impacts == 1
    assert ball.velocity[0, 0] == pytest.approx(2.0 * e, abs=1e-15)
    assert ball.velocity[0, 1] == 0.3
    assert lost[1] == lost[2] == 0.0
    assert lost[3] + lost[4] == pytest.approx(before - ball.kinetic, rel=1e-12, abs=1e-15)
    assert lost[3] == pytest.approx(0.5 * mass * 4.0 * (1.0 - e * e), abs=1e-14)
    assert ball.jump[0] >= -2.0 * step


@pytest.mark.parametrize("e", [0.5, 1.0])
def test_time_of_flight_under_gravity(e):
    """Dropped from 1 m: impacts at t0, t0 (1 + 2 e), ..., with speeds v0 e^n; first order in h."""
    height = 1.0
    fall, speed = np.sqrt(2.0 * height / GRAVITY), np.sqrt(2.0 * height * GRAVITY)
    errors = []
    for step in (2e-3, 1e-3, 5e-4):
        ball = PointMass(SignoriniCoulomb(restitution=e), 2.0, [0.0, 0.0], gap=height)
        impacts = []
        for count in range(int(2.2 * fall * (1.0 + 2.0 * e) / step)):
            before = ball.velocity[0, 0]
            ball.step(step, [[-2.0 * GRAVITY, 0.0]])
            if ball.impulse[0] > 0.0:
                impacts.append((step * (count + 0.5), before, ball.velocity[0, 0]))
                # the velocity at the start of the step decides, exactly
                assert ball.velocity[0, 0] == pytest.approx(-e * before, rel=1e-14)
            if len(impacts) == 2:
                break
        (t0, v0, _), (t1, v1, _) = impacts
        assert v0 == pytest.approx(-speed, abs=2 * GRAVITY * step)
        assert v1 == pytest.approx(-speed * e, abs=4 * GRAVITY * step)
        errors.append(max(abs(t0 - fall), abs(t1 - t0 - 2.0 * e * fall)))
        assert errors[-1] <= 2.0 * step


@pytest.mark.parametrize("theta", [0.5, 0.6, 1.0])
def test_rest_under_gravity_does_not_bounce(theta):
    """Dropped from 1 mm without restitution: at rest, penetration bounded by the arrival."""
    step, mass = 1e-3, 2.0
    ball = PointMass(SignoriniCoulomb(), mass, [0.0, 0.0], gap=1e-3, theta=theta)
    for _ in range(200):
        ball.step(step, [[-mass * GRAVITY, 0.0]])
    speed = np.sqrt(2.0 * GRAVITY * 1e-3)
    assert ball.velocity[0, 0] == pytest.approx(0.0, abs=1e-15)
    assert ball.impulse[0] == pytest.approx(mass * GRAVITY * step, rel=1e-12)
    assert -speed * step <= ball.jump[0] <= 0.0


def test_what_pushed_stays_closed_where_a_solver_lifts_it():
    """At rest a gap of 1e-4 of what gravity adds to the speed, times the step, is closed."""
    step, mass = 1e-3, 2.0
    ball, weight = PointMass(SignoriniCoulomb(), mass, [0.0, 0.0]), [[-mass * GRAVITY, 0.0]]
    ball.step(step, weight)
    ball.interactions.groups[0].jump[0, 0] = 1e-4 * GRAVITY * step**2
    ball.step(step, weight)
    assert ball.velocity[0, 0] == 0.0


@pytest.mark.parametrize("law", [SignoriniCoulomb(0.3), SlipWeakening(0.3, 0.1, 0.2),
                                 StribeckFriction(0.3, 0.1, 0.2), MohrCoulomb(0.3, 5.0, 0.0, 0.2),
                                 RigidCohesiveZone(5.0, 0.1)])  # fmt: skip
@pytest.mark.parametrize(("dim", "area"), [(2, 1e-3), (3, 1e-6)])
def test_a_gap_of_rounding_is_closed(law, dim, area):
    """What touches takes an impact at once, on an area 1 mm wide, whatever rounding leaves open."""
    speeds = []
    for gap in (-1e-15, 1e-15, 1e-9):
        ball = PointMass(law, 2.0, np.zeros(dim), gap=gap, area=area)
        if isinstance(law, RigidCohesiveZone):
            ball.interactions.groups[0].state[0, :2] = 1.0, 0.0  # broken
        ball.step(1e-3, np.eye(1, dim) * -1e-3)
        speeds.append(ball.velocity[0, 0])
    np.testing.assert_allclose(speeds, [0.0, 0.0, -5e-7], atol=1e-20)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("contact", ["velocity", "position"])
@pytest.mark.parametrize("theta", [0.5, 1.0])
@pytest.mark.parametrize("angle", [5.0, 16.6, 16.8, 40.0])
def test_block_on_an_incline(angle, theta, contact, dim):
    """mu = 0.3, atan(mu) = 16.699 degrees: it sticks below, slides at g (sin - mu cos) above."""
    mu, mass, step, count = 0.3, 2.0, 1e-3, 50
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    # gravity is vertical, the ground's normal inclined
    down = np.array([0.0, -1.0] if dim == 2 else [0.0, 0.0, -1.0])
    normal = np.array([s, c] if dim == 2 else [0.6 * s, 0.8 * s, c])
    slope = (down + c * normal) / s
    law = SignoriniCoulomb(friction=mu, contact=contact)
    block = PointMass(law, mass, np.zeros(dim), normal=normal, theta=theta)
    heat = 0.0
    for _ in range(count):
        work = block.step(step, mass * GRAVITY * down[None])
        assert work.friction >= -1e-18 and abs(work.impact) <= 1e-18
        heat += work.friction
    acceleration = GRAVITY * max(s - mu * c, 0.0)
    expected = acceleration * count * step
    np.testing.assert_allclose(block.velocity[0], expected * slope, rtol=0, atol=1e-12)
    assert block.impulse[0] == pytest.approx(mass * GRAVITY * c * step, rel=1e-12)
    assert np.linalg.norm(block.impulse[1:]) == pytest.approx(
        mass * GRAVITY * min(s, mu * c) * step, rel=1e-12
    )
    assert block.status == (2 if s > mu * c else 1)
    distance = np.linalg.norm(block.jump[1:])
    late = (theta - 0.5) * step * expected  # of the scheme
    assert distance == pytest.approx(0.5 * acceleration * (count * step) ** 2 + late, abs=1e-13)
    assert heat == pytest.approx(mass * GRAVITY * mu * c * distance, rel=1e-9, abs=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("contact", ["velocity", "position"])
@pytest.mark.parametrize("push", [0.9, 1.1, 3.0])
def test_tresca_slide(push, contact, dim):
    """A fixed bound on the tangential stress, whatever the pressure."""
    bound, area, mass, step, count = 40.0, 0.25, 2.0, 1e-3, 20
    direction = np.array([0.0, -1.0] if dim == 2 else [0.0, 0.8, 0.6])
    for pressure in (1.0, 1e4):
        law = Tresca(bound, contact=contact)
        block = PointMass(law, mass, np.zeros(dim), area=area)
        force = push * bound * area * direction
        force[0] = -pressure * area
        for _ in range(count):
            block.step(step, force[None])
        expected = max(push - 1.0, 0.0) * bound * area / mass * count * step
        np.testing.assert_allclose(block.velocity[0], expected * direction, rtol=0, atol=1e-13)
        assert np.linalg.norm(block.impulse[1:]) == pytest.approx(
            min(push, 1.0) * bound * area * step, rel=1e-12
        )


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("theta", [0.5, 0.6, 1.0])
def test_position_level_never_penetrates_and_never_gives_work(theta, friction):
    rng = np.random.default_rng(1)
    mass, step = 2.0, 1e-2
    law = SignoriniCoulomb(friction=friction, contact="position")
    for dim in (2, 3):
        block = PointMass(law, mass, rng.normal(size=dim), gap=0.1, theta=theta)
        closed = 0
        for count in range(300):
            if count % 7 == 0:
                force = 500.0 * rng.normal(size=(1, dim))
                force[0, 0] -= 400.0
            work = block.step(step, force)
            assert block.jump[0] >= -1e-14
            if block.impulse[0] > 0.0:
                closed += 1
                assert block.jump[0] <= 1e-14  # neither held off before it closes
            scale = block.kinetic + np.abs(block.impulse).max()
            assert work.impact >= -1e-13 * scale
            assert work.friction >= -1e-13 * scale
        assert 8 < closed < 300


@pytest.mark.parametrize("friction", [0.2, 1.0])
def test_velocity_level_friction_never_gives_work_at_theta_one(friction):
    """At theta = 1 the end velocity is the mean one of the step."""
    rng = np.random.default_rng(2)
    block = PointMass(SignoriniCoulomb(friction=friction), 2.0, [0.0, 0.0, 0.0], theta=1.0)
    for _ in range(200):
        force = 100.0 * rng.normal(size=(1, 3))
        force[0, 0] -= 50.0
        assert block.step(1e-2, force).friction >= 0.0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("theta", [0.5, 0.6, 1.0])
def test_perfect_bond_keeps_the_jump_zero(theta, dim):
    rng = np.random.default_rng(3)
    normal = rng.normal(size=dim)
    normal /= np.linalg.norm(normal)
    masses, step = np.array([2.0, 5.0]), 1e-3
    pair = PointMass(PerfectBond(), masses, np.zeros((2, dim)), normal=normal, theta=theta)
    momentum = np.zeros(dim)
    for _ in range(100):
        force = rng.normal(size=(2, dim))
        pair.step(step, force)
        momentum += step * force.sum(axis=0)
        assert np.abs(pair.jump).max() <= 1e-18
        assert np.abs(pair.velocity[0] - pair.velocity[1]).max() <= 1e-15
        # the two masses move as one
        np.testing.assert_allclose(pair.velocity[0], momentum / 7.0, rtol=0, atol=1e-14)
        expected = step * (force[0] * 5.0 - force[1] * 2.0) / 7.0
        np.testing.assert_allclose(pair.frame.T @ pair.impulse, -expected, rtol=1e-10, atol=1e-17)


@pytest.mark.parametrize("theta", [0.5, 0.6, 1.0])
def test_perfect_bond_takes_back_a_drift(theta):
    pair = PointMass(PerfectBond(), [2.0, 5.0], np.zeros((2, 2)), gap=1e-6, theta=theta)
    sizes = []
    for _ in range(60):
        pair.step(1e-3)
        sizes.append(np.linalg.norm(pair.jump))
    assert sizes[-1] <= 1e-12
    assert max(sizes) <= 1e-6


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("rank", [1, 2])
@pytest.mark.parametrize("law", [PerfectBond(), SignoriniCoulomb(0.3, contact="position")])
def test_a_node_guided_obliquely_to_the_normal_converges(law, rank, dim):
    """Prescribed directions leave W singular: no rounding may be blown up into impulses."""
    rng = np.random.default_rng(5)
    free = np.zeros(dim)
    free[1 : 1 + rank] = 1.0  # x is prescribed, and z too when rank is 1
    mass = 4e-9
    for _ in range(5):
        normal = rng.normal(size=dim)
        normal /= np.linalg.norm(normal)
        block = PointMass(law, mass, free, normal=normal, area=1e-6)
        block.inverse = BodyInverse.from_uniform(np.diag(free)[None] / mass, dim)
        block.interactions.update_inverse(block.inverse)
        for _ in range(20):
            block.step(1e-10, tolerance=1e-9, max_sweeps=50)
            assert block.report.converged or block.report.residual < 1e-14
            assert np.all(block.velocity[0][free == 0.0] == 0.0)
            assert np.abs(block.impulse).max() <= 100.0 * mass
        if isinstance(law, PerfectBond):
            assert np.abs(block.velocity).max() <= 1e-2


def test_ground_takes_the_impulse_and_does_not_move():
    block = PointMass(SignoriniCoulomb(friction=0.5), 2.0, [0.0, 0.0])
    block.step(1e-3, [[-30.0, 4.0]])
    total = block.interactions.impulses()
    np.testing.assert_allclose(total[0], [30e-3, -4e-3], rtol=1e-12)
    np.testing.assert_array_equal(total[-1], -total[0])
    v = np.zeros(4)
    block.interactions.add_velocity(v)
    assert not v[2:].any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SignoriniCoulomb(friction=-0.1), "friction"),
        (lambda: SignoriniCoulomb(friction=np.nan), "friction"),
        (lambda: SignoriniCoulomb(restitution=1.1), "restitution"),
        (lambda: SignoriniCoulomb(restitution=np.nan), "restitution"),
        (lambda: SignoriniCoulomb(contact="gap"), "contact"),
        (lambda: SignoriniCoulomb(restitution=0.5, contact="position"), "velocity"),
        (lambda: Tresca(-1.0), "bound"),
        (lambda: Tresca(np.inf), "bound"),
        (lambda: Tresca(1.0, restitution=-0.1), "restitution"),
    ],
)
def test_bad_numbers_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
