# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of rigid bodies against known motions: impact, friction, rocking, spin, stacks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from xper_fx.forms.loads import Gravity
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid.body import RigidBody, wall
from xper_fx.nscd.rigid.polygon import Polygon
from xper_fx.nscd.rigid.polyhedron import Polyhedron
from xper_fx.nscd.rigid.shapes import Disc, Sphere
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

G, RADIUS, STEP = 9.81, 0.1, 1e-3
BALL = {2: Disc(RADIUS), 3: Sphere(RADIUS)}
# Inertia of a ball over m r^2.
GYRATION = {2: 0.5, 3: 0.4}
both = pytest.mark.parametrize("dim", [2, 3])


def vector(dim, along, up=0.0):
    """(along, up) in 2D, (along, 0, up) in 3D."""
    return (along, *(0.0,) * (dim - 2), up)


def on_plane(body, law, angle=0.0, **options) -> Simulation:
    """A body on the plane through the origin, gravity turned by an angle (rad) towards +x."""
    dim = body.shape.dim
    scene = Scene(
        rigid=[body, wall((0.0,) * dim, vector(dim, 0.0, 1.0), "ground")],
        contacts=[Contact((body.group, "ground"), law)],
        loads=[Gravity(vector(dim, G * np.sin(angle), -G * np.cos(angle)))],
    )
    return Simulation(scene, **{"step": STEP, "tolerance": 1e-12, "num_threads": 1} | options)


def among(bodies, law, step=STEP, **options) -> Simulation:
    """Bodies of one group that touch each other."""
    scene = Scene(rigid=bodies, contacts=[Contact((bodies[0].group,) * 2, law)])
    return Simulation(scene, step, **{"tolerance": 1e-12, "num_threads": 1} | options)


def velocities(simulation, end):
    """Velocities along x of body 0 after each step, and the last record."""
    steps = [(simulation.rigid.state.velocity[0, 0], record) for record in simulation.steps(end)]
    return np.array([speed for speed, _ in steps]), steps[-1][1]


# -- impact


@both
@pytest.mark.parametrize("gap", [0.0, 0.01])
def test_a_cradle_of_five_balls(dim, gap):
    """Apart, the last one leaves with the speed of the first. In touch all obey Newton's law at
    once: v+ + v- is twice the projection of v- on what opens all points, where all go along.
    """
    bodies = [
        RigidBody(
            BALL[dim], vector(dim, i * (2 * RADIUS + gap)), "balls", density=1000.0,
            velocity=vector(dim, 1.3 if i == 0 else 0.0),
        )
        for i in range(5)
    ]  # fmt: skip
    simulation = among(bodies, SignoriniCoulomb(restitution=1.0))
    start = simulation.rigid.kinetic
    *_, last = simulation.steps(0.1 if gap else 0.005)
    expected = [0, 0, 0, 0, 1] if gap else [-0.6, 0.4, 0.4, 0.4, 0.4]
    velocity = simulation.rigid.state.velocity
    np.testing.assert_allclose(velocity[:, 0], 1.3 * np.array(expected), rtol=0, atol=1e-11)
    assert np.abs(velocity[:, 1:]).max() < 1e-14
    assert simulation.rigid.momentum()[0] == pytest.approx(1.3 * simulation.rigid.bodies.mass[0])
    assert last.energies["kinetic"] == pytest.approx(start, rel=1e-11)
    assert abs(last.energies["closure"]) < 1e-13 * start


@pytest.mark.slow
@both
def test_a_bouncing_ball(dim):
    """Each impact returns e of the speed; heights fall by e^2, to the first order in the step."""
    e, height = 0.8, 1.0
    body = RigidBody(BALL[dim], vector(dim, 0.0, RADIUS + height), "ball", density=1000.0)
    simulation = on_plane(body, SignoriniCoulomb(restitution=e))
    speed, z, lost = [0.0], [height], []
    for record in simulation.steps(2.5):
        lost.append(record.energies["closure"])
        speed.append(simulation.rigid.state.velocity[0, -1])
        z.append(simulation.rigid.state.position[0, -1] - RADIUS)
    speed, z = np.array(speed), np.array(z)
    rebound = np.flatnonzero((speed[1:] > 0.0) & (speed[:-1] < 0.0))
    assert len(rebound) >= 4
    np.testing.assert_allclose(speed[rebound + 1], -e * speed[rebound], rtol=1e-12)
    tops = z[1:-1][(z[1:-1] > z[2:]) & (z[1:-1] >= z[:-2])]
    np.testing.assert_allclose(tops[:4], height * e ** (2.0 * np.arange(1, 5)), rtol=5e-3)
    weight = G * simulation.rigid.bodies.mass[0]
    assert np.abs(lost).max() < 1e-12 * weight * height


# -- friction


@both
@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_ball_rolls_down_an_incline_or_slips(dim, share):
    """It rolls up to tan(angle) = (1 + m r^2 / J) mu, with g sin(angle) / (1 + J / (m r^2))."""
    mu, k = 0.2, GYRATION[dim]
    angle = np.arctan(share * mu * (1.0 + 1.0 / k))
    rolls = share < 1.0
    body = RigidBody(BALL[dim], vector(dim, 0.0, RADIUS), "ball", density=1000.0)
    simulation = on_plane(body, SignoriniCoulomb(friction=mu), angle)
    speed, last = velocities(simulation, 0.1)
    slips = G * (np.sin(angle) - mu * np.cos(angle))
    expected = G * np.sin(angle) / (1.0 + k) if rolls else slips
    np.testing.assert_allclose(np.diff(speed, prepend=0.0), expected * STEP, rtol=1e-9)
    turned = np.abs(simulation.rigid.state.turn.spin[0]).max() * RADIUS
    # of the slipping ball friction turns it: J omega = mu m g cos(angle) t r
    assert turned == pytest.approx(speed[-1] if rolls else mu * G * np.cos(angle) / k * 0.1)
    lost = last.energies["dissipated_friction"]
    slid = 0.5 * (speed[-1] - turned) * 0.1
    expected = mu * simulation.rigid.bodies.mass[0] * G * np.cos(angle) * slid
    assert lost == pytest.approx(expected, rel=1e-8, abs=1e-12)
    assert abs(last.energies["closure"]) < 1e-11 * last.energies["kinetic"]


@both
def test_a_thrown_ball_slides_and_then_rolls(dim):
    """v0 / (1 + J / (m r^2)) is left, from the time v0 / ((1 + m r^2 / J) mu g) on."""
    mu, v0, k = 0.2, 2.0, GYRATION[dim]
    body = RigidBody(
        BALL[dim], vector(dim, 0.0, RADIUS), "ball", density=1000.0, velocity=vector(dim, v0)
    )
    simulation = on_plane(body, SignoriniCoulomb(friction=mu))
    rolls_at = v0 / ((1.0 + 1.0 / k) * mu * G)
    speed, last = velocities(simulation, 1.2 * rolls_at)
    time = STEP * np.arange(1, len(speed) + 1)
    slides = time < rolls_at
    np.testing.assert_allclose(speed[slides], v0 - mu * G * time[slides], rtol=1e-10)
    np.testing.assert_allclose(speed[~slides], v0 / (1.0 + k), rtol=1e-10)
    lost = 0.5 * simulation.rigid.bodies.mass[0] * v0**2 * (k / (1.0 + k))
    assert last.energies["dissipated_friction"] == pytest.approx(lost, rel=1e-4)
    assert abs(last.energies["closure"]) < 1e-12 * lost


def block(lengths, dim):
    """A block that stands on the plane; lengths along and up."""
    shape = Polygon.box(lengths) if dim == 2 else Polyhedron.box((lengths[0], *lengths))
    return RigidBody(shape, vector(dim, 0.0, 0.5 * lengths[1]), "block", density=1000.0)


@both
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_block_on_an_incline(dim, share):
    """It stays up to tan(angle) = mu, and slides with g (sin(angle) - mu cos(angle)) beyond."""
    mu = 0.5
    angle = np.arctan(share * mu)
    simulation = on_plane(block((1.0, 0.4), dim), SignoriniCoulomb(friction=mu), angle)
    speed, _ = velocities(simulation, 0.05)
    expected = max(0.0, G * (np.sin(angle) - mu * np.cos(angle)))
    np.testing.assert_allclose(np.diff(speed, prepend=0.0), expected * STEP, atol=1e-12)
    assert np.abs(simulation.rigid.state.turn.spin[0]).max() < 1e-12
    assert simulation.rigid.state.position[0, -1] == pytest.approx(0.2, abs=1e-14)


@both
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_tall_block_topples(dim, share):
    """About its lower edge, once tan(angle) exceeds width over height; with J' about that edge."""
    width, height = 0.4, 1.0
    angle = np.arctan(share * width / height)
    simulation = on_plane(block((width, height), dim), SignoriniCoulomb(friction=2.0), angle)
    start = simulation.rigid.state.position[0].copy()
    *_, last = simulation.steps(0.02)
    # moment of the weight about the edge over J', both over the mass
    moment = 0.5 * G * (height * np.sin(angle) - width * np.cos(angle))
    inertia = (width**2 + height**2) / 3.0
    # the further it leans, the faster: sinh(k t) / k instead of t
    growth = 0.02 * np.sqrt(0.5 * G * np.hypot(width, height) / inertia)
    spin = np.abs(simulation.rigid.state.turn.spin[0]).max()
    fallen = max(0.0, moment / inertia) * 0.02 * np.sinh(growth) / growth
    assert spin == pytest.approx(fallen, rel=1e-4, abs=1e-12)
    if share < 1.0:
        np.testing.assert_allclose(simulation.rigid.state.position[0], start, atol=1e-12)
    assert abs(last.energies["closure"]) < 1e-12 * simulation.rigid.bodies.mass[0] * G


# -- spin


@pytest.mark.slow
def test_a_free_body_turns_as_euler_says():
    """About its middle axis, nearly: the spin in its axes, to the second order in the step."""
    lengths, spin, end = (0.3, 0.2, 0.1), np.array([0.05, 3.0, 0.0]), 6.0
    shape = Polyhedron.box(lengths)
    j = np.diag(shape.mass_properties(1000.0).inertia)

    def exact(steps):
        w, h = spin.copy(), end / steps

        def rate(w):
            return -np.cross(w, j * w) / j

        for _ in range(steps):
            a = rate(w)
            b = rate(w + 0.5 * h * a)
            c = rate(w + 0.5 * h * b)
            w = w + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(w + h * c))
        return w

    errors, expected = [], exact(1000)
    for step in (2e-2, 1e-2):
        body = RigidBody(shape, (0.0, 0.0, 0.0), "body", density=1000.0, spin=spin)
        scene = Scene(rigid=[body], contacts=[Contact(("body", "body"), None)])
        simulation = Simulation(scene, step)
        momentum, energy = simulation.rigid.angular_momentum(), simulation.rigid.kinetic
        *_, last = simulation.steps(end)
        turn = simulation.rigid.state.turn
        errors.append(np.abs(turn.rotation[0].T @ turn.spin[0] - expected).max())
        now = simulation.rigid.angular_momentum()
        np.testing.assert_allclose(now, momentum, rtol=0, atol=1e-13 * np.abs(momentum).max())
        assert last.energies["kinetic"] == pytest.approx(energy, rel=1e-13)
    assert errors[0] < 2e-3 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.slow
def test_a_heavy_top_precesses_on_its_tip():
    """Steady precession at the rate W of I1 W^2 cos(a) - I3 w3 W + m g l = 0, I1 about the tip.

    The tip is held by contact at the end velocity: errors are of the first order in the step.
    """
    base, height, tilt, own_spin = 0.05, 0.06, 0.4, 150.0
    angle = np.pi / 12.0 * np.arange(24)
    rim = np.column_stack([base * np.cos(angle), base * np.sin(angle), np.full(24, height)])
    cone = Polyhedron.hull(np.vstack([[[0.0, 0.0, 0.0]], rim]))
    mass, centre, inertia = cone.mass_properties(1000.0)
    arm = centre[2]
    i1, i3, weight = inertia[0, 0] + mass * arm**2, inertia[2, 2], mass * G * arm
    slow = i3 * own_spin - np.sqrt((i3 * own_spin) ** 2 - 4.0 * i1 * np.cos(tilt) * weight)
    rate = slow / (2.0 * i1 * np.cos(tilt))
    turned = Rotation.from_rotvec([0.0, tilt, 0.0])
    axis = turned.apply([0.0, 0.0, 1.0])
    spin = np.array([0.0, 0.0, rate]) + (own_spin - rate * np.cos(tilt)) * axis
    errors = []
    for step in (1e-3, 5e-4):
        body = RigidBody(
            cone, arm * axis, "top", density=1000.0, rotation=turned, spin=spin,
            velocity=np.cross(spin, arm * axis),
        )  # fmt: skip
        simulation = on_plane(body, SignoriniCoulomb(friction=1.0), step=step, tolerance=1e-8)
        phase, lean = [0.0], [tilt]
        for _ in simulation.steps(0.3):
            x, y, z = simulation.rigid.state.turn.rotation[0][:, 2]
            phase.append(np.arctan2(y, x))
            lean.append(np.arccos(z))
        errors.append(np.unwrap(phase)[-1] / (0.3 * rate) - 1.0)
    assert abs(errors[1]) < 0.03 and errors[0] / errors[1] == pytest.approx(2.0, rel=0.25)
    assert np.abs(np.array(lean) - tilt).max() < 0.05


# -- what collisions keep


def cloud(dim, kind, rng):
    """Bodies on a jittered grid that fly towards its centre, spinning."""
    side = 5 if dim == 2 else 3
    bodies = []
    for k in range(side**dim):
        place = 0.25 * np.array(np.unravel_index(k, (side,) * dim)) + rng.uniform(-0.02, 0.02, dim)
        size = rng.uniform(0.06, 0.1)
        turn = {"angle": rng.uniform(0, 6)} if dim == 2 else {}
        if dim == 3:
            turn = {"rotation": Rotation.from_quat(rng.normal(size=4))}
        if kind == "balls" or (kind == "mixed" and k % 2):
            shape = Disc(size) if dim == 2 else Sphere(size)
        elif dim == 2:
            shape = Polygon.regular(int(rng.integers(3, 8)), size)
        else:
            points = rng.normal(size=(9, 3))
            shape = Polyhedron.hull(size * points / np.linalg.norm(points, axis=1)[:, None])
        velocity = -4.0 * (place - 0.125 * (side - 1)) + rng.normal(size=dim)
        spin = 5.0 * rng.normal(size=() if dim == 2 else 3)
        bodies.append(
            RigidBody(shape, place, "cloud", density=1000.0, velocity=velocity, spin=spin, **turn)
        )
    return bodies


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dim", "kind", "theta"),
    [
        (2, "balls", 1.0), (2, "cornered", 0.5), (2, "mixed", 1.0),
        (3, "balls", 0.5), (3, "cornered", 1.0), (3, "mixed", 0.5),
    ],
)  # fmt: skip
def test_collisions_keep_momenta_and_lose_energy(dim, kind, theta):
    """With friction and restitution, whatever the impulses found: both momenta to rounding."""
    law = SignoriniCoulomb(friction=0.4, restitution=0.5)
    bodies = cloud(dim, kind, np.random.default_rng(3))
    simulation = among(bodies, law, theta=theta, tolerance=1e-9)
    motion = simulation.rigid
    momentum, angular, start = motion.momentum(), motion.angular_momentum(), motion.kinetic
    size = motion.bodies.mass @ np.linalg.norm(motion.state.velocity, axis=1)
    kinetic, pushed = [start], 0
    for record in simulation.steps(0.12):
        pushed += sum(int((g.impulse[:, 0] > 0).sum()) for g in simulation.interactions.contacts)
        kinetic.append(record.energies["kinetic"])
        np.testing.assert_allclose(motion.momentum(), momentum, rtol=0, atol=1e-12 * size)
        np.testing.assert_allclose(motion.angular_momentum(), angular, rtol=0, atol=1e-12 * size)
        assert abs(record.energies["closure"]) < 1e-12 * start
    assert pushed > 15
    assert np.diff(kinetic).max() < 1e-12 * start and kinetic[-1] < 0.85 * start


# -- stacks


@pytest.mark.slow
@both
def test_a_tower_stands(dim):
    """Fifty blocks on each other rest from the first step on, each bearing what is above."""
    count, step = 50, 5e-3
    shape = Polygon.box((1.0, 1.0)) if dim == 2 else Polyhedron.box((1.0, 1.0, 1.0))
    bodies = [
        RigidBody(shape, vector(dim, 0.0, 0.5 + i), "blocks", density=1000.0) for i in range(count)
    ]
    law = SignoriniCoulomb(friction=0.5)
    scene = Scene(
        rigid=[*bodies, wall((0.0,) * dim, vector(dim, 0.0, 1.0), "ground")],
        contacts=[Contact(("blocks", "blocks"), law), Contact(("blocks", "ground"), law)],
        loads=[Gravity(vector(dim, 0.0, -G))],
    )
    simulation = Simulation(scene, step, tolerance=1e-8, num_threads=1)
    start = simulation.rigid.state.position.copy()
    *_, last = simulation.steps(0.25)
    assert np.abs(simulation.rigid.state.position - start).max() < 1e-5
    assert last.energies["kinetic"] < 1e-3
    (group,) = simulation.interactions.contacts
    upper = group.points.nodes[:, 0, 0] // 2
    lower = group.points.nodes[:, 1, 0] // 2
    joint = np.where(lower == count, 0, np.maximum(upper, lower))
    borne = np.bincount(joint, group.impulse[:, 0], minlength=count)
    np.testing.assert_allclose(borne, 1000.0 * G * step * (count - np.arange(count)), rtol=1e-5)
