# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation of rigid bodies in 3D: conservation, exact motions, and an independent integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid import Polyhedron, RigidBodies, RigidBody, RigidMotion, Sphere

# Principal moments 13, 10, 5 for the mass 12.
BOX = Polyhedron.box((1.0, 2.0, 3.0))
MOMENTS = np.array([13.0, 10.0, 5.0])
# About the axis of the middle moment, which is unstable: the body flips over.
FLIPPING = (0.01, 3.0, 0.02)


def fly(motion, end_time, steps, theta=0.5):
    for k in range(steps):
        prediction = motion.predict(end_time / steps, theta, k * end_time / steps)
        motion.end(prediction.free)
        motion.commit()
    return motion


def boxes(spins, **options):
    return RigidBodies(
        [RigidBody(BOX, (0, 0, 0), "a", mass=12.0, spin=spin, **options) for spin in spins]
    )


def euler_rotation(rotation, spin, time, torque=None, moments=MOMENTS):
    """Rotation after a time, by a Runge-Kutta method of order 8 on quaternions (w, x, y, z)."""

    def rate(t, y):
        q, pi = y[:4], y[4:]
        x, y_, z = spin_ = pi / moments
        w0, x0, y0, z0 = q
        turning = 0.5 * np.array(
            [
                -x0 * x - y0 * y_ - z0 * z,
                w0 * x + y0 * z - z0 * y_,
                w0 * y_ + z0 * x - x0 * z,
                w0 * z + x0 * y_ - y0 * x,
            ]
        )
        r = Rotation.from_quat(q, scalar_first=True).as_matrix()
        return np.concatenate(
            [turning, np.cross(pi, spin_) + (0.0 if torque is None else r.T @ torque(r))]
        )

    q = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    start = np.concatenate([q, moments * (rotation.T @ spin)])
    end = solve_ivp(rate, (0.0, time), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return Rotation.from_quat(end[:4], scalar_first=True).as_matrix()


def test_free_bodies_keep_momentum_and_energy_over_ten_thousand_steps():
    motion = RigidMotion(boxes([FLIPPING, (1, 2, 3), (-2, 1, 3)], rotation=(0.1, 0.7, -0.3, 0.5)))
    start = motion.state.turn
    energy = np.sum(start.spin * start.momentum, axis=1)
    turn = fly(motion, 100.0, 10_000).state.turn
    size = np.linalg.norm(start.momentum, axis=1)[:, None]
    assert np.abs(turn.momentum - start.momentum).max() <= 1e-13 * size.min()
    assert np.sum(turn.spin * turn.momentum, axis=1) == pytest.approx(energy, rel=1e-12)
    # The momentum is that of the inertia as it has turned, and the rotation a rotation.
    inertia = turn.rotation @ np.diag(MOMENTS) @ np.swapaxes(turn.rotation, 1, 2)
    product = np.einsum("nij,nj->ni", inertia, turn.spin)
    assert np.abs(product - start.momentum).max() <= 1e-12 * size.min()
    gram = np.swapaxes(turn.rotation, 1, 2) @ turn.rotation
    assert np.abs(gram - np.eye(3)).max() <= 1e-14


def test_flip_of_a_box_converges_to_an_independent_integration_at_second_order():
    bodies = boxes([FLIPPING])
    time = 6.0
    exact = euler_rotation(bodies.rotation[0], bodies.spin[0], time)
    # It has flipped on the way: the middle axis points the other way in space.
    assert exact[1, 1] < -0.5
    errors = [
        np.abs(fly(RigidMotion(bodies), time, steps).state.turn.rotation[0] - exact).max()
        for steps in (400, 800, 1600)
    ]
    assert errors[2] < 2e-3
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ratios == pytest.approx(4.0, abs=0.2)


def test_any_theta_turns_a_free_body_at_second_order():
    bodies = boxes([(1.0, 2.0, 3.0)])
    exact = euler_rotation(bodies.rotation[0], bodies.spin[0], 1.0)
    errors = [
        np.abs(fly(RigidMotion(bodies), 1.0, n, theta=0.8).state.turn.rotation[0] - exact).max()
        for n in (50, 100)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.2)


def test_free_symmetric_top_precesses_at_l_over_its_transverse_moment():
    top = Polyhedron.box((1.0, 1.0, 0.4))
    inertia = top.mass_properties(1.0).inertia
    transverse, axial = inertia[0, 0], inertia[2, 2]
    spin = np.array([0.6, 0.0, 2.0])
    momentum = np.array([transverse * spin[0], 0.0, axial * spin[2]])
    rate = np.linalg.norm(momentum) / transverse
    time = 2.0 * np.pi / rate
    bodies = RigidBodies([RigidBody(top, (0, 0, 0), "a", density=1.0, spin=spin)])
    errors = []
    for steps in (100, 200):
        motion = fly(RigidMotion(bodies), time, steps)
        # After one period of precession the axis is back.
        errors.append(np.abs(motion.state.turn.rotation[0, :, 2] - [0, 0, 1]).max())
        axis = fly(RigidMotion(bodies), 0.5 * time, steps).state.turn.rotation[0, :, 2]
        unit = momentum / np.linalg.norm(momentum)
        assert axis == pytest.approx(2.0 * unit[2] * unit - [0, 0, 1], abs=1e-3)
    assert errors[0] < 3e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)


def test_sphere_turns_by_the_exact_rotation():
    spin = np.array([1.0, -2.0, 0.5])
    turn = Rotation.from_rotvec([0.3, 0.2, 0.1])
    bodies = RigidBodies(
        [RigidBody(Sphere(0.5), (0, 0, 0), "a", density=3.0, spin=spin, rotation=turn)]
    )
    rotation = fly(RigidMotion(bodies), 7.0, 3, theta=0.7).state.turn.rotation[0]
    assert rotation == pytest.approx(
        (Rotation.from_rotvec(7.0 * spin) * turn).as_matrix(), abs=1e-14
    )


@pytest.mark.parametrize("step", [3.0, 100.0])
def test_a_body_that_turns_many_times_in_a_step_keeps_its_energy(step):
    needle = Polyhedron.box((0.01, 0.02, 1.0))
    bodies = RigidBodies(
        [RigidBody(needle, (0, 0, 0), "a", density=1.0, spin=s) for s in ((1, 2, 3), (9, 1, 0.1))]
    )
    motion = RigidMotion(bodies)
    start = motion.state.turn
    turn = fly(motion, 5 * step, 5).state.turn
    assert np.array_equal(turn.momentum, start.momentum)
    energy = np.sum(start.spin * start.momentum, axis=1)
    assert np.sum(turn.spin * turn.momentum, axis=1) == pytest.approx(energy, rel=1e-11)


def heavy_top(steps, time, theta=0.5):
    """A top about its tip: position and inertia are those of the tip, which does not move."""
    moments, arm, weight = np.array([2.0, 2.0, 1.0]), 0.5, 4.0
    bodies = RigidBodies(
        [
            RigidBody(
                Sphere(1.0),
                (0, 0, 0),
                "top",
                mass=1.0,
                inertia=np.diag(moments),
                rotation=Rotation.from_rotvec([0.5, 0.0, 0.0]),
                spin=Rotation.from_rotvec([0.5, 0.0, 0.0]).apply([0.3, 0.0, 6.0]),
                prescribed=dict.fromkeys(range(3), 0.0),
            )
        ]
    )
    motion = RigidMotion(bodies)

    def torque(rotation):
        return np.cross(arm * rotation[:, 2], [0.0, 0.0, -weight])

    def energy():
        return motion.kinetic + weight * arm * motion.state.turn.rotation[0, 2, 2]

    energies = [energy()]
    for k in range(steps):
        h = time / steps
        prediction = motion.predict(h, theta, k * h)
        slots = prediction.free.copy()
        slots[1] += motion.blocks[0, 3:, 3:] @ (h * torque(prediction.rotation[0]))
        motion.end(slots)
        motion.commit()
        energies.append(energy())
    exact = euler_rotation(bodies.rotation[0], bodies.spin[0], time, torque, moments)
    return np.abs(motion.state.turn.rotation[0] - exact).max(), np.array(energies), motion, bodies


def test_heavy_top_converges_at_second_order_and_keeps_its_vertical_momentum():
    (coarse, wide, motion, bodies), (fine, narrow, _, _) = (heavy_top(n, 4.0) for n in (400, 800))
    assert coarse < 5e-3
    assert coarse / fine == pytest.approx(4.0, abs=0.1)
    assert np.ptp(wide) / np.ptp(narrow) == pytest.approx(4.0, abs=0.2)
    assert motion.state.turn.momentum[0, 2] == pytest.approx(
        (bodies.rotation[0] @ np.diag([2.0, 2.0, 1.0]) @ bodies.rotation[0].T @ bodies.spin[0])[2],
        rel=1e-13,
    )


def test_a_mill_without_mass_turns_by_the_exact_rotation():
    """Beside a sphere, which has its own momentum to turn by."""
    spin = np.array([1.0, -2.0, 0.5])
    turn = Rotation.from_rotvec([0.3, 0.2, 0.1])
    driven = dict.fromkeys(range(3), 0.0) | dict(enumerate(spin, 3))
    mill = RigidBody(BOX, (0, 0, 0), "a", rotation=turn, prescribed=driven)
    sphere = RigidBody(Sphere(0.5), (9, 0, 0), "a", density=3.0, spin=2.0 * spin)
    motion = fly(RigidMotion(RigidBodies([mill, sphere])), 7.0, 3, theta=0.7)
    state = motion.state.turn
    expected = [Rotation.from_rotvec(7.0 * spin) * turn, Rotation.from_rotvec(14.0 * spin)]
    for body in range(2):
        assert state.rotation[body] == pytest.approx(expected[body].as_matrix(), abs=1e-14)
    assert np.array_equal(state.spin[0], spin) and not state.momentum[0].any()
    assert motion.blocks[1].any() and not motion.blocks[0].any()


def test_axle_keeps_its_spin_exactly_and_bears_no_energy():
    turn = Rotation.from_rotvec([0.4, -0.9, 0.2])
    bodies = boxes([(0, 0, 2.0)], rotation=turn, prescribed={3: 0.0, 4: 0.0})
    motion = RigidMotion(bodies)
    energy = motion.kinetic
    fly(motion, 10.0, 100)
    state = motion.state.turn
    assert np.abs(state.spin[0] - [0, 0, 2.0]).max() < 1e-13
    assert motion.kinetic == pytest.approx(energy, rel=1e-13)
    assert state.rotation[0] == pytest.approx(
        (Rotation.from_rotvec([0, 0, 20.0]) * turn).as_matrix(), abs=1e-13
    )


def test_guided_body_with_two_free_components_converges_at_second_order():
    turn = Rotation.from_rotvec([0.4, -0.9, 0.2])
    bodies = boxes([(1.0, 2.0, 0.5)], rotation=turn, prescribed={5: 0.5})

    def rate(t, y):
        """Free components of d(J omega)/dt = 0 with omega_z = 0.5, J turning with the body."""
        r, spin = y[:9].reshape(3, 3), np.array([y[9], y[10], 0.5])
        j = r @ np.diag(MOMENTS) @ r.T
        cross = np.cross(np.eye(3), spin)
        gyroscopic = (cross @ j - j @ cross) @ spin
        return np.concatenate([(cross @ r).ravel(), np.linalg.solve(j[:2, :2], -gyroscopic[:2])])

    start = np.concatenate([bodies.rotation[0].ravel(), bodies.spin[0, :2]])
    exact = solve_ivp(rate, (0, 2.0), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    errors = []
    for steps in (100, 200):
        turn = fly(RigidMotion(bodies), 2.0, steps).state.turn
        assert turn.spin[0, 2] == pytest.approx(0.5, abs=1e-13)
        errors.append(
            max(
                np.abs(turn.rotation[0].ravel() - exact[:9]).max(),
                np.abs(turn.spin[0, :2] - exact[9:]).max(),
            )
        )
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.2)


def test_inverse_blocks_are_those_of_the_turned_inertia():
    turn = Rotation.from_rotvec([0.4, -0.9, 0.2])
    prescribed = [
        {},
        {0: 0.0},
        {3: 0.0},
        {3: 0.0, 5: 1.0},
        {1: 0.0, 4: 0.0},
        dict.fromkeys(range(6), 0),
    ]
    bodies = RigidBodies(
        [
            RigidBody(BOX, (0, 0, 0), "a", mass=12.0, rotation=turn, spin=(1, 2, 3), prescribed=p)
            for p in prescribed
        ]
    )
    motion = RigidMotion(bodies)
    prediction = motion.predict(0.3, 0.5, 0.0)
    for i, given in enumerate(prescribed):
        r = prediction.rotation[i]
        mass = np.zeros((6, 6))
        mass[:3, :3], mass[3:, 3:] = 12.0 * np.eye(3), r @ np.diag(MOMENTS) @ r.T
        free = [k for k in range(6) if k not in given]
        expected = np.zeros((6, 6))
        expected[np.ix_(free, free)] = np.linalg.inv(mass[np.ix_(free, free)])
        assert motion.blocks[i] == pytest.approx(expected, abs=1e-14)


def test_a_cube_made_of_triangles_turns_as_a_sphere_does():
    """Its moments are equal but for rounding; the bodies' own arrays are left alone."""
    cube = Polyhedron.hull(
        Rotation.from_rotvec([1, 2, 3]).apply(Polyhedron.box((1, 1, 1)).vertices.copy())
    )
    bodies = RigidBodies([RigidBody(cube, (0, 0, 0), "a", density=6.0, spin=(1, -2, 0.5))])
    inertia = bodies.inertia.copy()
    rotation = fly(RigidMotion(bodies), 7.0, 3).state.turn.rotation[0]
    assert rotation == pytest.approx(Rotation.from_rotvec([7.0, -14.0, 3.5]).as_matrix(), abs=1e-14)
    assert np.array_equal(bodies.inertia, inertia)


def test_a_spin_beyond_any_step_is_refused():
    motion = RigidMotion(boxes([(0, 0, 1), (1e9, 0, 1)]))
    with pytest.raises(FloatingPointError, match="rigid body 1 .* smaller step"):
        motion.predict(1.0, 0.5, 0.0)
