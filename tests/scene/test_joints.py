# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints and tendons between rigid bodies against exact motions, forces and balances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipk

import xper_fx as xf

G, DENSITY = 9.81, 100.0


def bar(start, end, width=0.04, **options) -> xf.RigidBody:
    """A bar of the plane from one point to another."""
    start, end = np.array(start, float), np.array(end, float)
    way = end - start
    shape = xf.rigid.Polygon.box((np.hypot(*way), width))
    turned = {"angle": np.arctan2(way[1], way[0]), "density": DENSITY}
    return xf.RigidBody(shape, (start + end) / 2, "bars", **(turned | options))


def ball(position, **options) -> xf.RigidBody:
    return xf.RigidBody(xf.rigid.Disc(0.05), position, "balls", **({"mass": 1.0} | options))


def run(rigid, joints, step, end, gravity=G, each=None, **options):
    """A simulation at its end time, and what `each` read off it after each step."""
    dim = rigid[0].shape.dim
    loads = [xf.Gravity((*(0.0,) * (dim - 1), -gravity))] if gravity else []
    scene = options.pop("scene", {})
    scene = xf.Scene(rigid=rigid, joints=joints, loads=loads, **scene)
    simulation = xf.Simulation(scene, step, num_threads=1, **options)
    read = [each and each(simulation) for _ in simulation.steps(end)]
    return simulation, np.array(read)


def energy(simulation) -> float:
    """What a frictionless run keeps."""
    held = simulation.ledger.energies
    return held.kinetic + held.cohesive - held.external_work


# -- motions


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_a_pendulum_of_large_swings(dim):
    """Period of the elliptic integral, energy and gap of second order that do not grow."""
    angle, half = 2.0, 0.5
    place = (half * np.sin(angle), *(0.0,) * (dim - 2), -half * np.cos(angle))
    if dim == 2:
        shape, turned, joint = xf.rigid.Polygon.box((0.1, 1.0)), {"angle": angle}, {}
    else:
        shape, joint = xf.rigid.Polyhedron.box((0.1, 0.2, 1.0)), {"axis": (0.0, 2.0, 0.0)}
        turned = {"rotation": (0.0, -np.sin(angle / 2), 0.0, np.cos(angle / 2))}
    body = xf.RigidBody(shape, place, "bars", density=10.0, **turned)
    step, end = 0.01, 6.0

    def swing(simulation):
        state = simulation.rigid.state
        x, speed = state.position[0], np.linalg.norm(state.velocity[0])
        tip = abs(np.hypot(x[0], x[-1]) - half)
        return np.arctan2(x[0], -x[-1]), energy(simulation), tip, speed

    simulation, found = run(
        [body], [xf.Hinge((None, body), (0.0,) * dim, **joint)], step, end, each=swing
    )
    phi, kept, gap, speed = found.T
    at = np.flatnonzero((phi[:-1] > 0.0) & (phi[1:] <= 0.0))
    passes = step * (at + phi[at] / (phi[at] - phi[at + 1]))
    mass, inertia = body_mass(simulation)
    exact = 4.0 * np.sqrt((inertia / mass + half**2) / (G * half)) * ellipk(np.sin(angle / 2) ** 2)
    assert np.diff(passes).mean() / exact - 1.0 == pytest.approx(
        {2: -1.40e-4, 3: -1.33e-4}[dim], rel=0.02
    )
    most = 2.0 * mass * G * half
    assert np.abs(kept).max() < 1e-3 * most
    third = len(kept) // 3
    assert np.abs(kept[-third:]).max() == pytest.approx(np.abs(kept[:third]).max(), rel=0.02)
    assert np.all(gap <= 1.01 * (speed * step) ** 2 / (8.0 * half) + 1e-9)
    assert simulation.ledger.closure == pytest.approx(0.0, abs=1e-12 * most)


def body_mass(simulation, number=0):
    """Mass, and moment of inertia about the axis of the plane (3D: about y)."""
    bodies = simulation.rigid.bodies
    inertia = bodies.inertia[number]
    return bodies.mass[number], inertia if np.ndim(inertia) == 0 else inertia[1, 1]


END = np.array([0.8, 0.1, 0.9])  # of a tendon on the second body
JOINED = {
    "ball": lambda pair, at: xf.Hinge(pair, at),
    "hinge": lambda pair, at: xf.Hinge(pair, at, axis=(1.0, 1.0, 0.0)),
    "slider": lambda pair, at: xf.Slider(pair, at, axis=(0.0, 1.0, 2.0)),
    "weld": lambda pair, at: xf.Weld(pair, at),
    "tendon": lambda pair, at: xf.Tendon(pair, (at, END)),
    "elastic": lambda pair, at: xf.Tendon(pair, (at, END), stiffness=1e3, prestress=9.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", JOINED)
def test_two_joined_bodies_tumble(kind):
    """Momenta to rounding; energy to second order; what the joint holds stays where it is."""
    shape, spin = xf.rigid.Polyhedron.box((0.2, 0.3, 0.6)), np.array([1.0, -2.0, 1.5])
    at, second = np.array([0.1, 0.2, 0.3]), np.array([0.3, 0.2, 0.7])
    velocity = np.cross(spin, second)
    if kind == "tendon":
        velocity = velocity + (0.2, 0.0, 0.3)
    if kind == "slider":
        velocity = velocity + np.array([0.0, 0.3, 0.6])
    first = xf.RigidBody(shape, (0.0, 0.0, 0.0), "bodies", density=30.0, spin=spin)
    own_spin = spin + {"ball": (0.5, 1.0, 0.0), "hinge": (0.6, 0.6, 0.0)}.get(kind, (0.0, 0.0, 0.0))
    if kind in ("ball", "hinge"):
        velocity = np.cross(spin, at) + np.cross(own_spin, second - at)
    other = xf.RigidBody(shape, second, "bodies", density=20.0, velocity=velocity, spin=own_spin)
    joint = JOINED[kind]((first, other), at)
    start = xf.Simulation(xf.Scene(rigid=[first, other], joints=[joint]), 0.01)
    simulation, kept = run([first, other], [joint], 0.01, 2.0, gravity=0.0, each=energy)
    before, after = start.rigid, simulation.rigid
    np.testing.assert_allclose(after.momentum(), before.momentum(), atol=1e-11)
    np.testing.assert_allclose(after.angular_momentum(), before.angular_momentum(), atol=1e-11)
    if kind != "tendon":  # whose wire gets taut by impacts
        assert np.ptp(kept) < 1e-3 * kept[0]
    R, x = after.state.turn.rotation, after.state.position
    ends = x[0] + R[0] @ at, x[1] + R[1] @ (at - second)
    turned = R[0].T @ R[1]
    if kind in ("ball", "hinge", "weld"):
        np.testing.assert_allclose(*ends, atol=3e-4)
    if kind == "hinge":
        axis = np.array([1.0, 1.0, 0.0])
        np.testing.assert_allclose(turned @ axis, axis, atol=2e-4)
    if kind in ("slider", "weld"):
        np.testing.assert_allclose(turned, np.eye(3), atol=1e-9)
    if kind == "slider":
        way = R[0].T @ (ends[1] - ends[0])
        assert way[2] > 0.1 and np.allclose(way, (0.0, 0.5 * way[2], way[2]), atol=3e-4)
    if kind == "tendon":
        end = x[1] + R[1] @ (END - second)
        length = np.linalg.norm(END - at)
        assert np.linalg.norm(end - ends[0]) <= length + 3e-4


@pytest.mark.slow
def test_a_slider_crank():
    """A crank that is driven; the slider is where the triangle of crank and rod says."""
    crank_radius, rod, spin, step = 0.3, 1.0, 6.0, 2e-3
    crank = xf.RigidBody(
        xf.rigid.Disc(0.1), (0.0, 0.0), "crank", prescribed={0: 0.0, 1: 0.0, 2: spin}
    )
    start = (crank_radius, 0.0), (crank_radius + rod, 0.0)
    link = bar(*start)
    slider = ball(start[1], mass=2.0)
    joints = [
        xf.Hinge((crank, link), start[0]),
        xf.Hinge((link, slider), start[1]),
        xf.Slider((None, slider), start[1], axis=(1.0, 0.0)),
    ]
    _, found = run(
        [crank, link, slider], joints, step, 0.7, gravity=0.0,
        each=lambda s: (s.time, *s.rigid.state.position[2], s.rigid.state.turn.rotation[2]),
    )  # fmt: skip
    time, x, y, angle = found.T
    phi = spin * time
    exact = crank_radius * np.cos(phi) + np.sqrt(rod**2 - (crank_radius * np.sin(phi)) ** 2)
    assert np.abs(x - exact).max() < 2.0 * (spin * step) ** 2 / 8.0 * crank_radius
    assert np.abs([y, angle]).max() < 1e-8


def test_a_chain_of_bars_hangs_in_its_funicular_shape():
    """With H the horizontal force, bar i of n has the slope V_i / H at its middle; at rest."""
    count, span = 10, 1.0
    weight = DENSITY * 0.04 * (length := 0.15) * G
    vertical = weight * (np.arange(count) - 0.5 * (count - 1))

    def shape(pull):
        slope = np.arctan2(vertical, pull)
        steps = length * np.stack([np.cos(slope), np.sin(slope)], axis=1)
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    pull = brentq(lambda h: shape(h)[-1, 0] - span, 1e-3 * weight, 1e3 * weight)
    nodes = shape(pull)
    bars = [bar(nodes[i], nodes[i + 1]) for i in range(count)]
    pairs = zip([None, *bars], [*bars, None], strict=True)
    joints = [xf.Hinge(pair, node) for pair, node in zip(pairs, nodes, strict=True)]
    simulation, _ = run(bars, joints, 1e-3, 0.01, tolerance=1e-6)
    state, forces = simulation.rigid.state, xf.output.find_joint_forces(simulation)
    assert np.abs(state.velocity).max() < 1e-6 * G * 0.01
    np.testing.assert_allclose(forces.force[:, 0], -pull, rtol=1e-5)
    borne = weight * (0.5 * count - np.arange(count + 1))
    np.testing.assert_allclose(forces.force[:, 1], borne, atol=1e-5 * weight)
    assert not forces.moment.any()


def test_a_weld_bears_the_moment_of_a_cantilever():
    beam = bar((0.0, 0.0), (2.0, 0.0))
    simulation, _ = run([beam], [xf.Weld((None, beam), (0.0, 0.0))], 1e-3, 5e-3)
    weight = DENSITY * 0.08 * G
    force, moment = xf.output.find_joint_forces(simulation)
    np.testing.assert_allclose(force, [[0.0, weight]], atol=1e-6 * weight)
    np.testing.assert_allclose(moment, [[weight * 1.0]], rtol=1e-6)


# -- friction and limits


@pytest.mark.parametrize("kind", ["plane", "space", "slider"])
def test_friction_stops_what_moves(kind):
    """After I omega / M, having turned by I omega^2 / 2 M; a slider alike; to first order."""
    bound, speed, step = 0.5, 3.0, 3e-3
    if kind == "space":
        shape = xf.rigid.Polyhedron.box((0.2, 0.2, 0.2))
        body = xf.RigidBody(shape, (0.0,) * 3, "bodies", density=1e3, spin=(0.0, 0.0, speed))
        joint = xf.Hinge((None, body), (0.0,) * 3, axis=(0.0, 0.0, 1.0), friction=bound)
        inertia = 8.0 * 0.2**2 / 6.0
    elif kind == "plane":
        body = ball((0.0, 0.0), mass=80.0, spin=speed)
        joint = xf.Hinge((body, None), (0.0, 0.0), friction=bound)
        inertia = 80.0 * 0.05**2 / 2.0
    else:
        body, inertia = ball((0.0, 0.0), mass=0.1, velocity=(speed, 0.0)), 0.1
        joint = xf.Slider((None, body), (0.0, 0.0), axis=(1.0, 0.0), friction=bound)
    stop = inertia * speed / bound
    simulation, _ = run([body], [joint], step, 0.9 * stop, gravity=0.0)
    left = 0.5 * inertia * (0.1 * speed) ** 2
    assert simulation.rigid.kinetic == pytest.approx(left, rel=0.05)
    for _ in simulation.steps(1.1 * stop):
        pass
    assert simulation.rigid.kinetic == pytest.approx(0.0, abs=1e-12)
    spent = simulation.ledger.energies.dissipated_friction
    assert spent == pytest.approx(0.5 * inertia * speed**2, rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plane", "space", "slider"])
def test_limits_send_back(kind):
    """With the restitution, at the limit that is met, and not before."""
    low, high, speed, step = -0.3, 0.2, 1.0, 4e-3
    limits = {"limits": (low, high), "restitution": 0.5}
    if kind == "space":
        shape = xf.rigid.Polyhedron.box((0.2, 0.2, 0.2))
        body = xf.RigidBody(shape, (0.0,) * 3, "bodies", density=1e3, spin=(0.0, 0.0, speed))
        joint = xf.Hinge((None, body), (0.0,) * 3, axis=(0.0, 0.0, 2.0), **limits)
    elif kind == "plane":
        body = ball((0.0, 0.0), spin=speed)
        joint = xf.Hinge((None, body), (0.0, 0.0), **limits)
    else:
        body = ball((0.0, 0.0), velocity=(0.0, speed))
        joint = xf.Slider((None, body), (0.0, 0.0), axis=(0.0, 3.0), **limits)

    def way(simulation):
        state = simulation.rigid.state
        turn = state.turn.rotation[0]
        if kind == "slider":
            return state.position[0, 1], state.velocity[0, 1]
        angle = turn if kind == "plane" else np.arctan2(turn[1, 0], turn[0, 0])
        return angle, state.turn.spin[0, -1]

    simulation, found = run([body], [joint], step, 1.5, gravity=0.0, each=way)
    place, rate = found.T
    assert high - 2.0 * speed * step < place.max() <= high + 1e-12
    assert low - 1e-12 <= place.min() < low + 2.0 * speed * step
    np.testing.assert_allclose(np.unique(rate.round(9)), [-0.5, 0.25, 1.0])
    assert simulation.ledger.closure == pytest.approx(0.0, abs=1e-14)


# -- tendons


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_wire_catches_what_falls(restitution):
    """Slack without force; the speed at which it becomes taut comes back by the restitution."""
    drop, step = 0.5, 2e-3
    body = ball((0.0, -0.5))
    wire = xf.Tendon((None, body), ((0.0, 0.0), (0.0, -0.5)), length=1.0, restitution=restitution)
    fall = np.sqrt(2.0 * drop / G)

    def hang(simulation):
        tension = xf.output.find_joint_forces(simulation).force[0, 1]
        return simulation.rigid.state.position[0, 1], simulation.time, tension

    simulation, found = run([body], [wire], step, 2.5 * fall, each=hang)
    height, time, tension = found.T
    assert np.all(tension[time < fall - 2 * step] == 0.0) and tension.min() >= 0.0
    assert height.min() >= -1.0 - 1e-9
    rebound = height[(time > fall) & (time < 2.1 * fall)].max()
    assert rebound + 1.0 == pytest.approx(restitution**2 * drop, abs=1.2e-2)
    if restitution == 0.0:
        assert tension[-1] == pytest.approx(G, rel=1e-6)
        assert simulation.ledger.energies.dissipated_impact == pytest.approx(G * drop, rel=1e-3)


@pytest.mark.slow
def test_a_taut_wire_swings_without_loss():
    """As a pendulum: neither longer nor with another energy, whatever its restitution."""
    start = np.array([np.sin(1.0), -np.cos(1.0)])
    body = ball(start)
    wire = xf.Tendon((None, body), ((0.0, 0.0), start), restitution=0.8)
    simulation, found = run(
        [body], [wire], 0.01, 8.0,
        each=lambda s: (np.linalg.norm(s.rigid.state.position[0]), energy(s)),
    )  # fmt: skip
    length, kept = found.T
    assert np.abs(length - 1.0).max() < 1.2e-4
    assert np.abs(kept).max() < 3.5e-3
    assert np.abs(kept[-200:]).max() == pytest.approx(np.abs(kept[:300]).max(), rel=0.02)


def test_an_elastic_wire_is_a_spring_in_tension():
    """Thrown up from its prestress: sqrt(k / m) while taut, then free flight; energy is exact."""
    stiffness, mass, pull = 400.0, 1.0, 20.0
    body = ball((0.0, -1.0), mass=mass, velocity=(0.0, 1.5))
    wire = xf.Tendon((None, body), ((0.0, 0.0), (0.0, -1.0)), stiffness=stiffness, prestress=pull)
    step, omega = 1e-3, np.sqrt(stiffness / mass)
    simulation, found = run(
        [body], [wire], step, 0.5,
        each=lambda s: (s.time, s.rigid.state.position[0, 1], s.ledger.energies.cohesive),
    )  # fmt: skip
    time, height, stored = found.T
    middle = -1.0 + pull / stiffness - mass * G / stiffness
    exact = middle + (-1.0 - middle) * np.cos(omega * time) + 1.5 / omega * np.sin(omega * time)
    taut = np.flatnonzero(exact > -1.0 + pull / stiffness)[0]
    assert taut > 20
    np.testing.assert_allclose(height[:taut], exact[:taut], atol=1e-5)
    np.testing.assert_allclose(
        stored, 0.5 * stiffness * np.minimum(height + 1.0 - pull / stiffness, 0.0) ** 2, atol=1e-9
    )
    held = simulation.ledger.energies
    assert stored.min() == 0.0 and held.dissipated_numerical == pytest.approx(0.0, abs=1e-12)
    assert simulation.ledger.closure == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_prestressed_column_decompresses(share):
    """A block rocks where F h = (W + T) b / 2, and not before."""
    width, height, pull = 0.4, 1.0, 300.0
    weight = DENSITY * width * height * G
    push = share * (weight + pull) * width / height
    block = xf.RigidBody(
        xf.rigid.Polygon.box((width, height)), (0.0, height / 2), "block", density=DENSITY,
        force=(push, 0.0),
    )  # fmt: skip
    ground = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")
    contact = xf.Contact(("block", "ground"), xf.laws.SignoriniCoulomb(friction=1.0))
    tendon = xf.Tendon((None, block), ((0.0, -1.0), (0.0, height)), stiffness=1e4, prestress=pull)
    simulation, _ = run(
        [block, ground], [tendon], 1e-3, 0.05, scene={"contacts": [contact]}, tolerance=1e-6
    )
    spin = simulation.rigid.state.turn.spin[0, 0]
    assert (abs(spin) < 1e-9) if share < 1.0 else (spin < -1e-3)
    np.testing.assert_allclose(
        np.linalg.norm(xf.output.find_joint_forces(simulation).force), pull, rtol=1e-2
    )


# -- with contacts


def test_what_a_joint_joins_does_not_touch():
    """Bars that overlap at their hinge; a third one of their group is struck all the same."""
    first, second = bar((0.0, 0.0), (1.0, 0.0)), bar((0.98, 0.0), (2.0, 0.0))
    struck = bar((0.7, -0.2), (0.9, -0.2), velocity=(0.0, 2.0))
    law = xf.laws.SignoriniCoulomb()
    scene = xf.Scene(
        rigid=[first, second, struck],
        joints=[xf.Hinge((None, first), (0.0, 0.0)), xf.Hinge((first, second), (0.99, 0.0))],
        contacts=[xf.Contact(("bars", "bars"), law)],
        loads=[xf.Gravity((0.0, -G))],
    )
    with pytest.raises(ValueError, match="overlap at the start: 0 and 1"):
        replace(scene, joints=scene.joints[:1])
    simulation = xf.Simulation(scene, 2e-3)
    for _ in simulation.steps(0.2):
        pass
    assert simulation.rigid.state.velocity[2, 1] < 2.0 - G * 0.2 - 0.5
    assert np.linalg.norm(simulation.rigid.state.position[0]) == pytest.approx(0.5, abs=1e-3)


# -- mistakes


def test_a_step_in_which_bodies_turn_too_far_is_cut():
    """Half a radian; the energy of a pendulum is then that of smaller steps."""
    body = bar((0.0, 0.0), (1.0, 0.0))
    simulation, kept = run([body], [xf.Hinge((None, body), (0.0, 0.0))], 0.25, 2.0, each=energy)
    assert simulation.step_number > 8
    assert np.abs(kept).max() < 0.1 * DENSITY * 0.04 * G


def test_bodies_that_part_at_the_start_are_doubted(caplog):
    """And stopped in the first steps, as the ledger says."""
    body = bar((0.0, 0.0), (1.0, 0.0), velocity=(3.0, 0.0))
    simulation, _ = run([body], [xf.Hinge((None, body), (0.0, 0.0))], 1e-3, 3e-3, gravity=0.0)
    assert "joint 0, a Hinge, part at 3 m/s" in caplog.text
    lost = simulation.ledger.energies.dissipated_numerical
    assert lost == pytest.approx(0.5 * DENSITY * 0.04 * 3.0**2, rel=1e-6)
    caplog.clear()
    body = bar((0.0, 0.0), (1.0, 0.0), velocity=(0.0, 1.0), spin=2.0)
    run([body], [xf.Hinge((None, body), (0.0, 0.0))], 1e-3, 1e-3)
    assert "part at" not in caplog.text


FIRST, SECOND = bar((0.0, 0.0), (1.0, 0.0)), bar((0.0, 0.0), (1.0, 0.0))
SPACE = xf.RigidBody(xf.rigid.Sphere(1.0), (0.0,) * 3, "balls", density=1.0)
MISTAKES = {
    "between two": lambda: xf.Hinge(FIRST, (0.0, 0.0)),
    "RigidBody objects": lambda: xf.Hinge((0, 1), (0.0, 0.0)),
    "one twice": lambda: xf.Weld((FIRST, FIRST), (0.0, 0.0)),
    "shape \\(2,\\) in 2D": lambda: xf.Hinge((None, FIRST), 0.0),
    "leave its axis out": lambda: xf.Hinge((None, FIRST), (0.0, 0.0), axis=(0.0, 0.0, 1.0)),
    "not zero": lambda: xf.Slider((None, FIRST), (0.0, 0.0), axis=(0.0, 0.0)),
    "A ball joint": lambda: xf.Hinge((None, SPACE), (0.0,) * 3, friction=1.0),
    "place the bodies within": lambda: xf.Hinge((None, FIRST), (0.0, 0.0), limits=(0.1, 0.2)),
    "give limits": lambda: xf.Hinge((None, FIRST), (0.0, 0.0), restitution=0.5),
    "in \\[0, 1\\]": lambda: xf.Tendon((None, FIRST), ((0, 0), (1, 0)), restitution=2.0),
    "friction should be": lambda: xf.Hinge((None, FIRST), (0.0, 0.0), friction=-1.0),
    "does not reach": lambda: xf.Tendon((None, FIRST), ((0.0, 0.0), (1.0, 0.0)), length=0.5),
    "give them apart": lambda: xf.Tendon((None, FIRST), ((0.0, 0.0), (0.0, 0.0))),
    "give it a stiffness": lambda: xf.Tendon((None, FIRST), ((0, 0), (1, 0)), prestress=1.0),
    "no length without": lambda: xf.Tendon(
        (None, FIRST), ((0, 0), (1, 0)), stiffness=1.0, prestress=2.0
    ),
    "not both": lambda: xf.Tendon(
        (None, FIRST), ((0, 0), (1, 0)), length=1.0, stiffness=1e3, prestress=2.0
    ),
    "should be an xf.Hinge": lambda: xf.Scene(rigid=[FIRST], joints=["hinge"]),
    "not in the scene": lambda: xf.Scene(
        rigid=[FIRST], joints=[xf.Hinge((FIRST, SECOND), (0.0, 0.0))]
    ),
    "in 3D, the rigid bodies in 2D": lambda: xf.Scene(
        rigid=[FIRST], joints=[xf.Hinge((None, FIRST), (0.0, 0.0, 0.0))]
    ),
    "every motion is prescribed": lambda: xf.Scene(
        rigid=[held := replace(FIRST, prescribed={0: 0.0, 1: 0.0, 2: 0.0})],
        joints=[xf.Weld((None, held), (0.0, 0.0))],
    ),
    "the scene has none": lambda: xf.Scene(
        xf.explode(xf.crossed_rectangle((0, 0), (1, 1), (1, 1)), np.zeros(4, int)),
        {1: xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)},
        joints=[xf.Weld((None, FIRST), (0.0, 0.0))],
    ),
    "needs PerfectBond": lambda: run(
        [FIRST], [xf.Hinge((None, FIRST), (0.0, 0.0))], 1e-3, 1e-3, solver="subdomains"
    ),
    "joint 0 does, between the same": lambda: xf.Scene(
        rigid=[FIRST], joints=[xf.Hinge((None, FIRST), (0.0, 0.0))] * 2
    ),
    "scene has joints": lambda: xf.study.equilibrium(
        xf.Scene(rigid=[FIRST], joints=[xf.Weld((None, FIRST), (0.0, 0.0))])
    ),
}  # fmt: skip


@pytest.mark.parametrize("message", MISTAKES)
def test_a_mistake_is_named(message):
    with pytest.raises((TypeError, ValueError), match=message):
        MISTAKES[message]()


def test_the_same_joint_with_its_bodies_turned_round_is_one_too_many():
    """Its rows are those of the first, turned: forces of both are not unique, and grew."""
    ends = (-0.4, 0.0), (2.4, 0.1)
    for joint, again in (
        (xf.Hinge((FIRST, SECOND), (1.0, 0.0)), xf.Hinge((SECOND, FIRST), (1.0, 0.0))),
        (xf.Weld((None, FIRST), (0.0, 0.0)), xf.Weld((FIRST, None), (0.0, 0.0))),
        (xf.Tendon((FIRST, SECOND), ends), xf.Tendon((SECOND, FIRST), ends[::-1])),
    ):
        with pytest.raises(ValueError, match="joint 0 does, between the same"):
            xf.Scene(rigid=[FIRST, SECOND], joints=[joint, again])
    crossing = xf.Tendon((FIRST, SECOND), ends), xf.Tendon((SECOND, FIRST), ends)
    xf.Scene(rigid=[FIRST, SECOND], joints=crossing)


def test_a_loop_of_parallel_hinges_holds():
    """Four hinges about one direction leave a plane mechanism that three rows hold twice, in space:
    impulses along these rows grew twentyfold a step, until the run broke off after 12."""
    box = xf.rigid.Polyhedron.box((0.4, 0.2, 0.1))
    centres = (0.25, 0.0), (0.5, 0.3), (0.25, 0.6), (0.0, 0.3)
    bars = [xf.RigidBody(box, (x, 0.0, z), "bars", density=50.0) for x, z in centres]
    corners = (0.5, 0.0), (0.5, 0.6), (0.0, 0.6), (0.0, 0.0)
    joints = [
        xf.Hinge((bars[i], bars[(i + 1) % 4]), (x, 0.0, z), axis=(0.0, 1.0, 0.0))
        for i, (x, z) in enumerate(corners)
    ]
    joints.append(xf.Hinge((None, bars[0]), (0.25, 0.0, 0.0), axis=(0.0, 1.0, 0.0)))
    contacts = [xf.Contact(("bars", "bars"), None)]
    scene = xf.Scene(
        rigid=bars, joints=joints, contacts=contacts, loads=[xf.Gravity((0.3, 0.1, -9.81))]
    )
    simulation = xf.Simulation(scene, 5e-3, num_threads=1)
    *_, last = simulation.steps(0.5)
    assert last.step == 100
    assert last.energies["kinetic"] == pytest.approx(last.energies["external_work"], rel=1e-3)
    assert last.energies["kinetic"] == pytest.approx(0.05093, rel=1e-3)
    assert np.abs(simulation.rigid.state.position[:, 1]).max() < 1e-6
