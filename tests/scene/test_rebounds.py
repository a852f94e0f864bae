# SPDX-License-Identifier: LGPL-3.0-or-later
"""Restitution along the tangent: rough balls in closed form, and energies of coupled impacts."""

import numpy as np
import pytest

import xper_fx as xf

RADIUS = 0.1


def bounce(dim, friction, e, velocity, spin):
    """Velocity and spin of a ball after an impact on a floor; 3D has the plane of 2D as x and z."""
    shape = xf.rigid.Disc(RADIUS) if dim == 2 else xf.rigid.Sphere(RADIUS)
    up, start = np.eye(dim)[-1], np.zeros(dim)
    start[[0, -1]] = velocity
    ball = xf.RigidBody(
        shape, tuple((RADIUS + 1e-9) * up), "ball", density=1000.0, velocity=tuple(start),
        spin=spin if dim == 2 else (0.0, -spin, 0.0),
    )  # fmt: skip
    law = xf.laws.SignoriniCoulomb(friction, e, tangential_restitution=e)
    scene = xf.Scene(
        rigid=[ball, xf.rigid.wall((0.0,) * dim, tuple(up), "floor")],
        contacts=[xf.Contact(("ball", "floor"), law)],
    )
    simulation = xf.Simulation(scene, step=1e-7, tolerance=1e-12)
    *_, step = simulation.steps(2e-7)
    state = simulation.rigid.state
    turned = state.turn.spin[0].ravel()
    assert abs(step.energies["closure"]) < 1e-12 * step.energies["kinetic"]
    return state.velocity[0][[0, -1]], turned[0] if dim == 2 else -turned[1]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("e", [0.6, 1.0])
def test_a_rough_ball_bounces_as_in_closed_form(dim, e):
    """The slip s = v + R omega of the lowest point becomes -e s; Garwin (1969) for e = 1."""
    c = 0.5 if dim == 2 else 0.4  # I / m R^2
    velocity, spin = np.array([1.5, -2.0]), 12.0
    after, turned = bounce(dim, 10.0, e, velocity, spin)
    slip = velocity[0] + RADIUS * spin
    push = -(1.0 + e) * slip * c / (1.0 + c)  # r_T / m
    # the lowest point stands lower by the path of half a step
    np.testing.assert_allclose(after, (velocity[0] + push, 2.0 * e), rtol=1e-4)
    np.testing.assert_allclose(turned, spin + push / (c * RADIUS), rtol=1e-4)
    np.testing.assert_allclose(after[0] + RADIUS * turned, -e * slip, rtol=1e-4)
    # friction at its bound: it opposes the mean slip, which keeps its sign
    after, turned = bounce(dim, 0.1, e, velocity, spin)
    push = -0.1 * (1.0 + e) * 2.0
    np.testing.assert_allclose(after, (velocity[0] + push, 2.0 * e), rtol=1e-9)
    np.testing.assert_allclose(turned, spin + push / (c * RADIUS), rtol=1e-4)


def energies(bodies, state):
    """Kinetic energy of each free body."""
    return 0.5 * bodies.mass * np.sum(state.velocity**2, axis=1) + 0.5 * (
        bodies.inertia.ravel() * state.turn.spin.ravel() ** 2
    )


def thin_boxes(rng, count, place, speed):
    for i in range(count):
        angle, sides = rng.uniform(0.0, 2.0 * np.pi), (0.2, rng.uniform(0.02, 0.2))
        corners = 0.5 * np.array(sides) * [[1, 1], [-1, 1], [-1, -1], [1, -1]]
        low = (corners @ [[np.sin(angle)], [np.cos(angle)]]).min()
        yield xf.RigidBody(
            xf.rigid.Polygon.box(sides), place(i, low), "boxes", angle=angle, density=1000.0,
            velocity=speed(i), spin=10.0 * rng.normal(),
        )  # fmt: skip


@pytest.mark.parametrize("e", [0.95, 1.0])
def test_one_restitution_for_both_never_gains_energy(e):
    """Boxes that land on a corner; restitution of the normal alone gains (Kane and Levinson)."""

    def gains(along):
        rng = np.random.default_rng(0)
        boxes = thin_boxes(
            rng, 60, lambda i, low: (float(i), 1e-9 - low),
            lambda i: (2.0 * rng.normal(), -rng.uniform(0.5, 2.0)),
        )  # fmt: skip
        law = xf.laws.SignoriniCoulomb(0.5, e, tangential_restitution=along)
        scene = xf.Scene(
            rigid=[xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor"), *boxes],
            contacts=[xf.Contact(("boxes", "floor"), law), xf.Contact(("boxes", "boxes"), None)],
        )
        simulation = xf.Simulation(scene, step=1e-6, tolerance=1e-10)
        before = energies(scene.rigid_bodies, simulation.rigid.state)[1:]
        *_, step = simulation.steps(2e-6)
        lost = step.energies["dissipated_friction"] + step.energies["dissipated_impact"]
        after = energies(scene.rigid_bodies, simulation.rigid.state)[1:]
        assert lost == pytest.approx((before - after).sum(), rel=1e-9, abs=1e-12 * before.sum())
        return after / before - 1.0

    never = gains(e)
    assert np.count_nonzero(never) > 10 and never.max() < 1e-12
    alone = gains(0.0)
    assert np.count_nonzero(alone > 1e-12) == {0.95: 7, 1.0: 11}[e]
    assert alone.max() == pytest.approx({0.95: 0.18, 1.0: 0.25}[e], abs=0.01)


def test_boxes_that_hit_each_other_never_gain_energy():
    rng, e = np.random.default_rng(1), 0.97
    site = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2)
    boxes = thin_boxes(
        rng, 16, lambda i, low: tuple(0.25 * site[i]),
        lambda i: tuple(-2.0 * (site[i] - 1.5) + rng.normal(size=2)),
    )  # fmt: skip
    law = xf.laws.SignoriniCoulomb(0.5, e, tangential_restitution=e)
    scene = xf.Scene(
        rigid=list(boxes), contacts=[xf.Contact(("boxes", "boxes"), law)], resolve_overlaps=True
    )
    simulation = xf.Simulation(scene, step=1e-3, tolerance=1e-10)
    before, angular = simulation.rigid.kinetic, simulation.rigid.angular_momentum()
    held = [before]
    for step in simulation.steps(0.25):
        held.append(step.energies["kinetic"])
    changes = np.diff(held)
    assert np.count_nonzero(changes) > 20
    assert changes.max() < 1e-9 * before and held[-1] < 0.99 * before
    np.testing.assert_allclose(simulation.rigid.angular_momentum(), angular, atol=1e-9)


def test_restitutions_that_differ_are_refused():
    for along, e in ((0.5, 0.0), (0.5, 0.6)):
        with pytest.raises(ValueError, match="0 or equal to restitution"):
            xf.laws.SignoriniCoulomb(0.3, e, tangential_restitution=along)
    with pytest.raises(ValueError, match="exclude each other"):
        xf.laws.SignoriniCoulomb(0.3, 0.5, tangential_restitution=0.5, rolling=0.1)
    with pytest.raises(ValueError, match="needs friction"):
        xf.laws.SignoriniCoulomb(0.0, 0.5, tangential_restitution=0.5)
    with pytest.raises(ValueError, match="lie in"):
        xf.laws.SignoriniCoulomb(0.3, 1.5, tangential_restitution=1.5)
    with pytest.raises(ValueError, match="0 or equal to restitution"):
        xf.laws.SignoriniCoulomb(0.3, [0.2, 0.8], tangential_restitution=0.5)
    xf.laws.SignoriniCoulomb(0.3, [0.2, 0.8], tangential_restitution=[0.2, 0.8])
