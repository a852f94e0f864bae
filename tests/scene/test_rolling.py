# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rolling resistance of discs and spheres against closed forms, balances and other solvers."""

from itertools import pairwise

import numpy as np
import pytest
from heaps import Heap, box, grains
from solving import solve

import xper_fx as xf
from xper_fx.nscd.laws.rolling import rolling_kernels
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.solvers import AcceleratedSweeps, NewtonOnAllPoints, NonlinearGaussSeidel

GRAVITY, RADIUS, STEP = 9.81, 0.1, 1e-3
BOTH = pytest.mark.parametrize("dim", [2, 3])


def ball(dim, radius, position, velocity, spin, group="balls"):
    shape = xf.rigid.Disc(radius) if dim == 2 else xf.rigid.Sphere(radius)
    return xf.RigidBody(
        shape, tuple(position), group, density=1000.0, velocity=tuple(velocity), spin=spin
    )


def inertia(dim):
    """I / (m R^2)."""
    return 0.5 if dim == 2 else 0.4


def on_plane(dim, law, slope, speed=0.0, **options):
    """A ball that rolls along x, downhill where the slope (its tangent) is above zero."""
    up, along = np.eye(dim)[-1], np.eye(dim)[0]
    spin = -speed / RADIUS if dim == 2 else (0.0, speed / RADIUS, 0.0)
    angle = np.arctan(slope)
    gravity = GRAVITY * (np.sin(angle) * along - np.cos(angle) * up)
    bodies = [
        ball(dim, RADIUS, RADIUS * up, speed * along, spin),
        xf.rigid.wall((0.0,) * dim, tuple(up), "plane"),
    ]
    scene = xf.Scene(
        rigid=bodies,
        contacts=[xf.Contact(("balls", "plane"), law)],
        loads=[xf.Gravity(tuple(gravity))],
    )
    return xf.Simulation(scene, step=STEP, tolerance=1e-9, **options)


def motion(simulation):
    """Speed along x, and the speed R |omega| of rolling."""
    state = simulation.rigid.state
    return state.velocity[0, 0], RADIUS * float(np.linalg.norm(state.turn.spin[0]))


@BOTH
def test_a_rolling_ball_slows_down_and_stops(dim):
    """m a = -F and I a / R = F R - mu_r R m g: a = -mu_r g / (1 + I / m R^2)."""
    rolling, start = 0.2, 0.3
    law = xf.laws.SignoriniCoulomb(friction=0.5, rolling=rolling)
    simulation = on_plane(dim, law, 0.0, start)
    slowing = rolling * GRAVITY / (1.0 + inertia(dim))
    lost, kinetic = [0.0], simulation.ledger.energies.kinetic
    for step in simulation.steps(100 * STEP):
        lost.append(step.energies["dissipated_friction"])
    speed = start - 100 * STEP * slowing
    np.testing.assert_allclose(motion(simulation), speed, rtol=1e-9)
    assert np.diff(lost).min() > 0.0
    assert lost[-1] == pytest.approx(kinetic * (1.0 - (speed / start) ** 2), rel=1e-9)
    *_, step = simulation.steps(1.05 * start / slowing)
    assert max(motion(simulation)) < 1e-12
    assert step.energies["dissipated_friction"] == pytest.approx(kinetic, rel=1e-9)


@BOTH
def test_a_ball_on_a_slope_rests_rolls_or_slides(dim):
    def speeds(slope, friction, rolling):
        law = xf.laws.SignoriniCoulomb(friction, rolling=rolling)
        simulation = on_plane(dim, law, slope)
        *_, step = simulation.steps(50 * STEP)
        assert step.sweeps <= 2  # from the impulses and the couple of the step before
        if slope < min(friction, rolling):
            found = xf.output.find_contact_forces(simulation)
            arm = found.position[0] - simulation.rigid.state.position[0]
            padded = [np.pad(x, (0, 3 - dim)) for x in (arm, found.force[0])]
            moment = np.cross(*padded)[2 if dim == 2 else 0 :]
            np.testing.assert_allclose(found.couple[0], -moment, atol=1e-6 * np.abs(moment).max())
        return motion(simulation)

    pull = 50 * STEP * GRAVITY * np.cos(np.arctan(0.3))
    assert max(speeds(0.3, 0.31, 0.301)) < 1e-6
    # it rolls beyond mu_r
    np.testing.assert_allclose(
        speeds(0.3, 0.31, 0.2), pull * (0.3 - 0.2) / (1.0 + inertia(dim)), rtol=1e-8
    )
    # it slides beyond mu, without a spin
    np.testing.assert_allclose(speeds(0.3, 0.29, 0.301), (pull * 0.01, 0.0), rtol=1e-7, atol=1e-12)


@BOTH
def test_the_effective_radius_and_the_sign_of_the_couple(dim):
    """A central impact of unequal balls, one of which spins fast: all impulses are known."""
    radii, speed, friction, rolling = np.array([0.1, 0.3]), 2.0, 0.2, 0.5
    place = np.zeros((2, dim))
    place[1, 0] = radii.sum() + 1e-4
    spin = (80.0, 0.0) if dim == 2 else ((30.0, 48.0, 64.0), (0.0, 0.0, 0.0))
    bodies = [
        ball(dim, radii[0], place[0], speed * np.eye(dim)[0], spin[0]),
        ball(dim, radii[1], place[1], np.zeros(dim), spin[1]),
    ]
    law = xf.laws.SignoriniCoulomb(friction, rolling=rolling)
    scene = xf.Scene(rigid=bodies, contacts=[xf.Contact(("balls", "balls"), law)])
    simulation = xf.Simulation(scene, step=STEP, tolerance=1e-12)
    before = simulation.rigid.angular_momentum()
    *_, step = simulation.steps(3 * STEP)
    np.testing.assert_allclose(
        simulation.rigid.angular_momentum(), before, atol=1e-12 * np.linalg.norm(before)
    )
    mass = simulation.scene.rigid_bodies.mass
    push = speed / (1.0 / mass).sum()  # r_N
    effective = 1.0 / (1.0 / radii).sum()
    # both arms end at the middle of the gap of -1e-3 m at most
    torque = np.array([-1.0, -1.0]) * radii * friction * push
    torque += np.array([-1.0, 1.0]) * rolling * effective * push
    change = torque / (inertia(dim) * mass * radii**2)
    state = simulation.rigid.state.turn.spin
    around = np.array([1.0]) if dim == 2 else np.array([0.0, 0.6, 0.8])
    turned = state - np.reshape(spin, state.shape)
    np.testing.assert_allclose(turned @ around, change, rtol=0.02)
    if dim == 3:  # what spins about the normal is not resisted
        np.testing.assert_allclose(turned[:, 0], 0.0, atol=1e-9)
    assert step.energies["dissipated_friction"] > 0.0
    assert abs(step.energies["closure"]) < 1e-10 * step.energies["kinetic"]


@BOTH
def test_solvers_agree_on_a_heap_and_obey_the_law(dim):
    """Natural map of both kinds of points, in NumPy from the law as it is written."""
    rolling, friction = 0.2, 0.4
    law = xf.laws.SignoriniCoulomb(friction, rolling=rolling)
    heap = Heap(grains(12, 3 if dim == 2 else 2, pitch=2.02, dim=dim), law=law)
    heap.advance(60, NonlinearGaussSeidel, tolerance=1e-4)
    heap.search()
    free, ends = heap.free_velocity(), []
    for solver in (NonlinearGaussSeidel, AcceleratedSweeps, NewtonOnAllPoints):
        for g in heap.layer.groups:
            g.impulse[:] = 0.0
        velocity = free.copy()
        report = solve(heap.layer, velocity, solver, tolerance=1e-9, num_threads=1)
        assert report.converged
        ends.append(velocity)
        contact, roll = heap.layer.groups
        push = contact.impulse[:, 0]
        slots = velocity.reshape(-1, dim)
        spins = slots[contact.points.nodes[:, :, 0] + 1]
        radius = heap.bodies.shapes.radius[contact.points.nodes[:, :, 0] // 2]
        with np.errstate(divide="ignore"):
            radius = 1.0 / (1.0 / radius).sum(axis=1)
        relative = radius[:, None] * (spins[:, 0] - spins[:, 1])
        couple = roll.impulse
        if dim == 2:
            relative = relative[:, :1]
        else:  # along the tangents
            relative = np.einsum("ptd,pd->pt", contact.points.frame[:, 1:], relative)
            np.testing.assert_array_equal(couple[:, 0], 0.0)
            couple = couple[:, 1:]
        wanted = couple - heap.bodies.mass[0] * relative
        size = np.linalg.norm(wanted, axis=1)
        bound = rolling * push
        wanted *= np.minimum(1.0, bound / np.maximum(size, 1e-300))[:, None]
        assert np.abs(wanted - couple).max() < 1e-6 * push.max()
        assert np.count_nonzero(push) > 10
    assert max(np.abs(a - b).max() for a, b in pairwise(ends)) < 1e-7


@BOTH
def test_visits_by_turns_contract_as_derived(dim):
    """A ball at a wall that neither slides nor rolls: 2/3 a sweep for discs, 5/7 for spheres."""
    place = (*(0.5,) * (dim - 1), RADIUS)
    law = xf.laws.SignoriniCoulomb(0.9, rolling=0.9)
    free = ball(dim, RADIUS, place, np.zeros(dim), None, "grains")
    heap = Heap([free, *box(1.0, 0.0, dim)], law=law)
    heap.search()
    velocity = heap.free_velocity()
    velocity[0] += 1e-3
    report = solve(heap.layer, velocity, tolerance=1e-13, max_sweeps=12, num_threads=1)
    assert report.contraction == pytest.approx({2: 2.0 / 3.0, 3: 5.0 / 7.0}[dim], rel=1e-9)


def test_a_point_between_bodies_of_unequal_moments_is_solved():
    """A sphere on a polyhedron: the couple is the projection that its law asks for."""
    rng, rolling = np.random.default_rng(4), 0.3
    solve_point = rolling_kernels(3, 0).solve
    none, slid = np.zeros((1, 0)), 0
    for _ in range(40):
        root = rng.normal(size=(3, 3))
        W = root @ root.T
        r, u, push = np.array([0.0, *rng.normal(size=2)]), rng.normal(size=3), rng.exponential()
        packed = W[np.triu_indices(3)][None]
        found, _ = solve_point(
            0, tuple(u), tuple(r), packed, np.array([[rolling]]), none, np.array([[push]])
        )
        end = (u + W @ (np.array(found) - r))[1:]
        wanted = np.array(found[1:]) - end
        size = np.linalg.norm(wanted)
        wanted *= min(1.0, rolling * push / size)
        np.testing.assert_allclose(found, (0.0, *wanted), atol=1e-12)
        slid += size > rolling * push
    assert 10 < slid < 40


def test_radii_of_balls_are_those_of_bodies():
    parts = [xf.rigid.Part(xf.rigid.Disc(0.5), (place, 0.5)) for place in (0.5, 1.5)]
    eccentric = xf.rigid.Cluster([xf.rigid.Polygon.box((1.0, 1.0)), parts[1]])
    shapes = [xf.rigid.Cluster(parts), xf.rigid.Disc(0.2), eccentric, xf.rigid.Disc(0.3)]
    bodies = [xf.RigidBody(s, (9.0 * i, 0.0), "a", density=1.0) for i, s in enumerate(shapes)]
    found = RigidBodies(bodies).shapes.ball_radius
    np.testing.assert_array_equal(found, [0.0, 0.2, 0.0, 0.3])


def test_rolling_resistance_where_it_cannot_be_is_refused():
    law = xf.laws.SignoriniCoulomb(0.3, rolling=0.1)
    with pytest.raises(ValueError, match="goes with friction at the velocity level"):
        xf.laws.SignoriniCoulomb(rolling=0.1)
    with pytest.raises(ValueError, match="goes with friction at the velocity level"):
        xf.laws.SignoriniCoulomb(0.3, contact="position", rolling=0.1)
    with pytest.raises(ValueError, match="rolling should be a finite number, zero or above"):
        xf.laws.SignoriniCoulomb(0.3, rolling=-0.1)
    square = xf.rigid.Polygon([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    discs = [xf.rigid.Part(xf.rigid.Disc(0.5), (place, 0.5)) for place in (0.5, 1.5)]
    ground = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")
    for shape, place in ((square, None), (xf.rigid.Cluster(discs), (1.0, 0.5))):
        block = xf.RigidBody(shape, place, "blocks", density=1.0)
        with pytest.raises(ValueError, match="needs discs or spheres on one side"):
            xf.Scene(rigid=[block, ground], contacts=[xf.Contact(("blocks", "ground"), law)])
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (1, 1))
    elastic = {1: xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)}
    with pytest.raises(ValueError, match="facets have no spin"):
        xf.Scene(
            xf.explode(mesh, np.zeros(4, int)), elastic, rigid=[ground], surfaces={"square": (1,)},
            contacts=[xf.Contact(("square", "ground"), law)],
        )  # fmt: skip
    with pytest.raises(ValueError, match="meshed bodies, which have no spin"):
        xf.Simulation(xf.Scene(xf.explode(mesh), elastic, default_interaction=law), step=0.1)
    with pytest.raises(ValueError, match='"contact with friction and rolling resistance" is not'):
        next(on_plane(2, law, 0.0, solver="interior_point").steps(STEP))
