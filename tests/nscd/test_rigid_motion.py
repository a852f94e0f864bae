# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time steps of rigid bodies: exact flights, conservation, ledger, what is prescribed."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy.special import ellipk

from xper_fx.nscd.rigid import (
    Disc,
    Polygon,
    Polyhedron,
    RigidBodies,
    RigidBody,
    RigidMotion,
    Sphere,
    wall,
)


def step(motion, h, theta=0.5, time=0.0, kick=None):
    """One step; `kick` are impulses on the slots, shape (2 n, dim)."""
    prediction = motion.predict(h, theta, time)
    slots = prediction.free.copy()
    if kick is not None:
        rows = kick.reshape(len(motion.bodies), -1, 1)
        slots += (motion.blocks @ rows).reshape(slots.shape)
    motion.end(slots)
    work = motion.work(kick)
    reactions = motion.reactions(kick)
    motion.commit()
    return work, reactions


def crowd(dim, prescribed=({}, {}, {})):
    """Three different bodies in motion, the last one round."""
    if dim == 2:
        shapes = [Polygon([[0, 0], [2, 0], [0.3, 1]]), Polygon.box((1, 3)), Disc(0.7)]
        more = [{"angle": 0.3, "spin": 2.0}, {"spin": -1.0}, {"spin": 0.5}]
        velocities = [(1, 2), (0, -1), (-2, 0.5)]
    else:
        rng = np.random.default_rng(1)
        shapes = [Polyhedron.hull(rng.normal(size=(9, 3))), Polyhedron.box((1, 2, 3)), Sphere(0.7)]
        more = [{"rotation": (0.5, 0.1, -0.4, 0.7), "spin": (1, -2, 0.5)}, {"spin": (2, 1, 3)}]
        more.append({"spin": (0, 0.5, -1)})
        velocities = [(1, 2, 0), (0, -1, 3), (-2, 0.5, 1)]
    return RigidBodies(
        [
            RigidBody(s, np.arange(dim) + k, "a", density=1.5, velocity=v, prescribed=p, **m)
            for k, (s, v, p, m) in enumerate(zip(shapes, velocities, prescribed, more, strict=True))
        ]
    )


def kick_at(prediction, point, impulse):
    """Slots of an impulse on body 0 and its opposite on body 1, at one point of space."""
    dim = len(point)
    slots = np.zeros((3, 2, dim))
    for body, sign in ((0, 1.0), (1, -1.0)):
        arm = point - prediction.position[body]
        slots[body, 0] = sign * impulse
        torque = sign * np.cross(arm, impulse)
        slots[body, 1, : 1 if dim == 2 else 3] = torque
    return slots.reshape(-1, dim)


@pytest.mark.parametrize("theta", [0.5, 0.75, 1.0])
def test_projectile_flies_as_the_scheme_says_and_exactly_for_one_half(theta):
    gravity, h, steps = np.array([0.0, -9.81]), 0.03, 50
    bodies = RigidBodies(
        [RigidBody(Disc(0.2), (1, 2), "a", density=7.0, velocity=(3, 4), spin=-2.0, angle=0.1)]
    )
    motion = RigidMotion(bodies, gravity)
    for k in range(steps):
        work, _ = step(motion, h, theta, k * h)
    t = steps * h
    assert motion.state.velocity[0] == pytest.approx(np.array([3, 4]) + gravity * t, rel=1e-13)
    exact = np.array([1, 2]) + np.array([3, 4]) * t + 0.5 * gravity * t**2
    # theta v1 + (1 - theta) v0 is off the mean velocity by (theta - 1/2) g h in each step.
    assert motion.state.position[0] == pytest.approx(
        exact + (theta - 0.5) * gravity * h * t, rel=1e-13
    )
    assert motion.state.turn.rotation == pytest.approx([0.1 - 2.0 * t], rel=1e-13)


def test_loads_are_weighted_as_the_scheme_does():
    bodies = RigidBodies(
        [
            RigidBody(
                Disc(1.0),
                (0, 0),
                "a",
                mass=2.0,
                force=lambda t: (6.0 * t, 0.0),
                torque=lambda t: 4.0 + t**2,
            ),
            RigidBody(Disc(1.0), (0, 0), "a", mass=2.0, force=(0.0, 3.0), torque=-1.0),
        ]
    )
    motion = RigidMotion(bodies, gravity=(1.0, 0.0))
    step(motion, 0.5, 0.7, time=2.0)
    force = 0.7 * 6.0 * 2.5 + 0.3 * 6.0 * 2.0
    torque = 0.7 * (4.0 + 2.5**2) + 0.3 * 8.0
    assert motion.state.velocity == pytest.approx(
        np.array([[0.5 * (force / 2.0 + 1.0), 0.0], [0.5, 0.75]])
    )
    assert motion.state.turn.spin[:, 0] == pytest.approx([0.5 * torque, -0.5])


def test_pendulum_swings_with_its_exact_period_to_second_order():
    mass, length, gravity, amplitude = 2.0, 0.5, 9.81, 2.0
    body = RigidBody(
        Disc(0.1),
        (0, 0),
        "a",
        mass=mass,
        inertia=mass * length**2,
        angle=amplitude,
        prescribed={0: 0.0, 1: 0.0},
    )
    period = 4.0 * np.sqrt(length / gravity) * ellipk(np.sin(0.5 * amplitude) ** 2)
    lags = []
    for steps in (200, 400):
        motion = RigidMotion(RigidBodies([body]))
        h = 0.25 * period / steps
        for k in range(steps):
            angle = motion.predict(h, 0.5, k * h).rotation[0]
            torque = -mass * gravity * length * np.sin(angle)
            step(motion, h, kick=np.array([[0.0, 0.0], [h * torque, 0.0]]))
        # A quarter of a period after its turning point the pendulum hangs straight down.
        lags.append(motion.state.turn.rotation[0])
    assert abs(lags[0]) < 1e-3
    assert lags[0] / lags[1] == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
def test_opposite_impulses_at_one_point_change_no_momentum(dim, theta):
    motion = RigidMotion(crowd(dim))
    rng = np.random.default_rng(dim)
    linear, angular = motion.momentum(), motion.angular_momentum((3.0, -1.0, 2.0)[:dim])
    for k in range(50):
        prediction = motion.predict(0.05, theta, 0.05 * k)
        point = prediction.position[:2].mean(axis=0) + rng.normal(size=dim)
        step(motion, 0.05, theta, kick=kick_at(prediction, point, 5.0 * rng.normal(size=dim)))
    assert motion.state.velocity[0] != pytest.approx([1, 2, 0][:dim], abs=0.1)
    assert motion.momentum() == pytest.approx(linear, abs=1e-12)
    assert motion.angular_momentum((3.0, -1.0, 2.0)[:dim]) == pytest.approx(angular, abs=1e-11)


def test_a_kick_at_an_arm_has_the_velocities_of_the_textbook():
    motion = RigidMotion(RigidBodies([RigidBody(Polygon.box((1, 2)), (3, 4), "a", mass=2.0)]))
    step(motion, 0.1, kick=np.array([[0.0, 5.0], [0.5 * 5.0, 0.0]]))
    assert motion.state.velocity[0] == pytest.approx([0.0, 2.5])
    assert motion.state.turn.spin[0, 0] == pytest.approx(2.5 / (2.0 * 5.0 / 12.0))
    box = RigidBody(Polyhedron.box((1, 2, 3)), (0, 0, 0), "a", mass=12.0)
    motion = RigidMotion(RigidBodies([box]))
    motion.predict(0.1, 1.0, 0.0)
    arm, impulse = np.array([0.5, 1.0, 1.5]), np.array([1.0, -2.0, 3.0])
    velocity = motion.blocks[0] @ np.concatenate([impulse, np.cross(arm, impulse)])
    assert velocity[:3] == pytest.approx(impulse / 12.0)
    assert velocity[3:] == pytest.approx(np.cross(arm, impulse) / [13, 10, 5])
    end = motion.end(velocity)
    assert end.turn.momentum[0] == pytest.approx(np.cross(arm, impulse), rel=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_step_tried_again_is_as_if_never_tried(dim):
    tried, once = (
        RigidMotion(crowd(dim, ({}, {dim: 1.0}, {})), (0.0, -9.0, 1.0)[:dim]) for _ in "ab"
    )
    for motion in (tried, once):
        step(motion, 0.02)
    for h, theta in ((0.3, 1.0), (0.001, 0.5)):
        tried.end(tried.predict(h, theta, 0.02).free + 1.0 * (theta == 1.0))
    for motion in (tried, once):
        step(motion, 0.05, 0.6, 0.02)
    for a, b in zip(
        tried.state[:2] + tried.state.turn, once.state[:2] + once.state.turn, strict=True
    ):
        assert np.array_equal(a, b)
    assert np.array_equal(tried.blocks, once.blocks)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("theta", [0.5, 0.6, 1.0])
def test_ledger_closes_to_rounding_whatever_is_prescribed(dim, theta):
    spun = {dim: lambda t: 1.0 + np.sin(3.0 * t)}
    prescribed = (spun, {0: 2.0, 1: lambda t: t}, dict.fromkeys(range(dim, 3 * (dim - 1)), 0.7))
    motion = RigidMotion(crowd(dim, prescribed), (0.0, -9.0, 1.0)[:dim])
    rng = np.random.default_rng(5)
    for k in range(20):
        before = motion.kinetic
        kick = rng.normal(size=(6, dim))
        if dim == 2:
            kick[1::2, 1] = 0.0
        work, _ = step(motion, 0.05, theta, 0.05 * k, kick)
        assert work.kinetic == motion.kinetic
        gain = work.loads + work.contacts + work.prescribed - work.scheme
        assert work.kinetic - before == pytest.approx(gain, abs=1e-12 * work.kinetic)
        assert work.scheme == 0.0 if theta == 0.5 else work.scheme > 0.0
        assert abs(work.prescribed) > 1e-6


def test_work_of_gravity_is_the_potential_energy_lost():
    motion = RigidMotion(crowd(3), (0.0, 0.0, -9.81))
    for k in range(10):
        height = motion.bodies.mass @ motion.state.position[:, 2]
        work, _ = step(motion, 0.1, 0.8, 0.1 * k)
        fall = height - motion.bodies.mass @ motion.state.position[:, 2]
        assert work.loads == pytest.approx(9.81 * fall, rel=1e-12)


def test_prescribed_velocities_hold_at_the_end_of_the_step_and_report_their_forces():
    body = RigidBody(Disc(1.0), (0, 0), "a", mass=2.0, prescribed={0: lambda t: 3.0 * t, 2: 1.5})
    motion = RigidMotion(RigidBodies([body]), (0.0, -10.0))
    kick = np.array([[0.4, 0.2], [0.3, 0.0]])
    _, reactions = step(motion, 0.1, 0.5, 0.0, kick)
    assert motion.state.velocity[0] == pytest.approx([0.3, -1.0 + 0.1])
    assert motion.state.turn.spin[0, 0] == 1.5
    # m a less the contact's mean force; what holds the spin, the contact's torque alone.
    assert reactions == pytest.approx(np.array([[2.0 * 3.0 - 4.0, 0.0], [-3.0, 0.0]]))


def test_walls_move_as_prescribed_and_feel_the_contacts():
    motion = RigidMotion(
        RigidBodies([wall((0, 0, 1), (0, 0, 1), "piston", velocity=(0, 0, lambda t: -t))]),
        (0, 0, -9.81),
    )
    kick = np.array([[0, 0, -2.0], [0.1, 0, 0]])
    for k in range(10):
        work, reactions = step(motion, 0.1, 0.5, 0.1 * k, kick)
    assert not motion.blocks.any()
    assert motion.state.position[0] == pytest.approx([0, 0, 1.0 - 0.5], rel=1e-14)
    assert reactions == pytest.approx(np.array([[0, 0, 20.0], [-1.0, 0, 0]]))
    assert work.kinetic == 0.0
    assert work.contacts == pytest.approx(2.0 * 0.95)
    assert work.prescribed == pytest.approx(-2.0 * 0.95)


def _calls_of_a_step(motion):
    calls = 0

    def count(frame, event, argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    step(motion, 0.1)
    sys.setprofile(count)
    try:
        step(motion, 0.1)
    finally:
        sys.setprofile(None)
    return calls


@pytest.mark.parametrize("shape", [Disc(1.0), Sphere(1.0), Polyhedron.box((1, 2, 3))])
def test_a_step_calls_python_no_more_often_for_many_bodies(shape):
    few, many = (
        _calls_of_a_step(
            RigidMotion(
                RigidBodies(
                    [RigidBody(shape, (k,) * shape.dim, "a", density=1.0) for k in range(n)]
                )
            )
        )
        for n in (2, 2000)
    )
    assert few == many


def test_what_predict_and_end_refuse():
    motion = RigidMotion(crowd(2))
    with pytest.raises(RuntimeError, match="call predict first"):
        motion.end(np.zeros((6, 2)))
    for h in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="step must be finite and positive"):
            motion.predict(h, 0.5, 0.0)
    for theta in (0.4, 1.1, np.nan):
        with pytest.raises(ValueError, match="theta must be in"):
            motion.predict(0.1, theta, 0.0)
    motion.predict(0.1, 0.5, 0.0)
    with pytest.raises(RuntimeError, match="no end yet"):
        motion.commit()
    with pytest.raises(ValueError, match=r"Velocities have shape \(6, 2\), got \(3, 2\)"):
        motion.end(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="gravity"):
        RigidMotion(crowd(2), (0, 0, -9.81))
    motion = {0: lambda t: 0.0 if t < 1.0 else np.nan}
    late = RigidBody(Disc(1.0), (0, 0), "a", mass=1.0, prescribed=motion)
    with pytest.raises(ValueError, match="component 0 at t = 1.5 s"):
        RigidMotion(RigidBodies([late])).predict(1.0, 0.5, 0.5)
