# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies that strike bodies whose vertices split."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import box_bodies
from scipy.spatial.transform import Rotation

import xper_fx as xf
from xper_fx.nscd.splitting.splitting_vertices import SplittingVertices

ELASTIC = xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)
LAW = xf.laws.SignoriniCoulomb(0.3)
UNBREAKABLE = xf.laws.RigidCohesiveZone(1e3, 1e3, friction=0.3)
BRITTLE = xf.laws.RigidCohesiveZone(1e-3, 1e-2, friction=0.3)
PLATES = {2: ("crossed", (2.0, 0.5), (8, 2)), 3: ("tetrahedron", (2.0, 2.0, 0.5), (3, 3, 1))}
in_both = pytest.mark.parametrize("dim", [2, 3])


def strikers(dim, speed):
    """A ball that spins and a box, both oblique, above a plate."""
    if dim == 2:
        ball, box = xf.rigid.Disc(0.2), xf.rigid.Polygon.box((0.3, 0.2))
        places, spins = ((0.53, 0.701), (1.41, 0.601)), (2.0, -0.3)
    else:
        ball, box = xf.rigid.Sphere(0.2), xf.rigid.Polyhedron.box((0.3, 0.5, 0.2))
        places = (0.53, 0.61, 0.701), (1.41, 1.21, 0.601)
        spins = (1.0, -2.0, 0.5), (0.1, 0.2, 1.0)
    ways = [speed * (x * np.eye(dim)[0] - np.eye(dim)[-1]) for x in (0.3, -0.2)]
    return [
        xf.RigidBody(shape, place, "thrown", density=3.0, velocity=way, spin=spin)
        for shape, place, way, spin in zip((ball, box), places, ways, spins, strict=True)
    ]


def struck(
    dim, bonds, rigid, *, label=None, among=LAW, joints=(), step=None, tolerance=1e-12
):  # fmt: skip
    kind, lengths, cells = PLATES[dim]
    group = rigid[0].group
    contacts = [xf.Contact((group, "plate"), LAW), xf.Contact(("plate", "plate"), LAW)]
    if len(rigid) > 1:
        contacts.append(xf.Contact((group, group), among))
    if joints:
        contacts += [xf.Contact((name, "arm"), None) for name in ("plate", group, "arm")]
    scene = xf.Scene(
        box_bodies(lengths, cells, kind, label), {1: ELASTIC}, default_interaction=bonds,
        rigid=rigid, surfaces={"plate": (1,)}, contacts=contacts, joints=joints,
    )  # fmt: skip
    options = {"tolerance": tolerance, "num_threads": 1, "forgiving": True}
    return xf.Simulation(scene, step, scheme="explicit", **options)


@in_both
def test_a_plate_that_holds_is_struck_as_one_piece(dim):
    """Contacts have the masses of whole vertices, and the spins of what strikes them."""
    split = struck(dim, UNBREAKABLE, strikers(dim, 0.1))
    one = struck(dim, None, strikers(dim, 0.1), label=0, step=split.step_size)
    assert isinstance(split.solver, SplittingVertices)
    assert not isinstance(one.solver, SplittingVertices)
    for simulation in (split, one):
        list(simulation.steps(60 * split.step_size))
    found, exact = (s.rigid.state for s in (split, one))
    assert found.velocity == pytest.approx(exact.velocity, abs=1e-11)
    spins = [s.interactions.rigid_part(s.last.slots)[1::2] for s in (split, one)]
    assert spins[0] == pytest.approx(spins[1], abs=1e-10)
    begun = struck(dim, UNBREAKABLE, strikers(dim, 0.1)).rigid.state.velocity
    assert np.abs(exact.velocity - begun).max(axis=1).min() > 0.05  # both have struck
    for name in ("kinetic", "elastic", "dissipated_impact", "dissipated_friction"):
        of_split, of_one = (getattr(s.ledger.energies, name) for s in (split, one))
        assert of_one > 1e-7
        assert of_split == pytest.approx(of_one, rel=1e-9)


def momentum_of(simulation):
    dim = simulation.bulk.dim
    mass = simulation.bulk.mass.reshape(-1, dim)
    meshed = (mass * simulation.state.velocity.reshape(-1, dim)).sum(axis=0)
    rigid = simulation.rigid
    return meshed + rigid.bodies.mass @ rigid.state.velocity


@in_both
def test_a_plate_that_breaks_keeps_momentum_and_energy(dim):
    simulation = struck(dim, BRITTLE, strikers(dim, 0.3), tolerance=1e-12)
    before, held = momentum_of(simulation), simulation.ledger.energies.kinetic
    for _ in simulation.steps(1.0 if dim == 2 else 0.6):
        assert abs(simulation.ledger.closure) < 1e-12 * held
    assert momentum_of(simulation) == pytest.approx(before, abs=1e-12 * np.abs(before).max())
    e = simulation.ledger.energies
    assert len(simulation.interactions.fused.split) > 10
    assert e.dissipated_cohesion > 5e-5
    assert e.dissipated_impact > 0.0
    assert e.dissipated_friction > 0.0


def test_bodies_that_fly_side_by_side_push_each_other_by_little():
    """Their impulses are found as far as the rounding of their velocities lets them."""
    fast, gain, arm, apart = np.array((0.73, 0.0, 2.37)), np.array((0.0, 0.0, 1e-3)), 0.3, 5e-5
    ball = replace(
        strikers(3, 0.1)[0], position=(0.53, 0.61, 3.0), velocity=fast + gain, spin=np.zeros(3)
    )
    bar = xf.RigidBody(
        xf.rigid.Polyhedron.box((3.0, 0.1, 0.1)), (0.53 + arm, 0.61, 3.25 + apart), "thrown",
        density=0.5, velocity=fast,
    )  # fmt: skip
    simulation = struck(3, UNBREAKABLE, [ball, bar], tolerance=1e-9)
    sizes = [step.size for step in simulation.steps(6 * simulation.step_size)]
    assert min(sizes) == pytest.approx(max(sizes))  # none is cut
    changed, bodies = simulation.rigid.state.velocity - fast, simulation.rigid.bodies
    soft = np.sum(1.0 / bodies.mass) + arm**2 / bodies.inertia[1, 1, 1]
    assert changed[1, 2] == pytest.approx(1e-3 / soft / bodies.mass[1], rel=1e-3)
    assert bodies.mass @ changed == pytest.approx(bodies.mass[0] * gain, abs=1e-15)


def test_heavy_bodies_that_touch_nothing_change_nothing():
    """What rounding lets through of contacts that are open is no measure of those that push."""
    found = []
    for density in (3.0, 3e12):
        far = {"density": density, "velocity": (-0.1, 0.0)}
        disc, places = xf.rigid.Disc(0.2), ((9.0, 9.0), (9.4003, 9.0))
        pair = [xf.RigidBody(disc, place, "thrown", **far) for place in places]
        simulation = struck(2, BRITTLE, [*strikers(2, 0.3), *pair], tolerance=1e-8)
        for _ in simulation.steps(0.6):
            pass
        found.append(simulation.state.velocity)
    assert found[1] == pytest.approx(found[0], abs=1e-7 * np.abs(found[0]).max())
    assert len(simulation.interactions.fused.split) > 3


def test_a_punch_gives_what_it_is_driven_with():
    """The impulse of what drives it is the momentum of the plate."""
    shape = xf.rigid.Polygon.box((0.4, 0.2))
    punch = xf.RigidBody(
        shape, (1.0, 0.601), "punch", density=1.0, prescribed={0: 0.0, 1: -0.2, 2: 0.0}
    )
    simulation = struck(2, BRITTLE, [punch], tolerance=1e-8)
    given, last = np.zeros(2), 0.0
    for step in simulation.steps(0.5):
        given += simulation.reaction_of("punch") * (step.time - last)
        last = step.time
    plate = (simulation.bulk.mass * simulation.state.velocity).reshape(-1, 2).sum(axis=0)
    assert plate[1] < -0.01
    assert given == pytest.approx(plate, abs=1e-12)
    assert simulation.rigid.state.velocity[0] == pytest.approx((0.0, -0.2), abs=0.0)
    assert simulation.ledger.energies.external_work == pytest.approx(-0.2 * plate[1], rel=1e-9)


@in_both
def test_a_run_that_is_taken_up_goes_on_to_the_bit(dim):
    whole = struck(dim, BRITTLE, strikers(dim, 0.3), tolerance=1e-6)
    list(whole.steps(0.3))
    saved = whole.saved_in_order()
    again = struck(dim, BRITTLE, strikers(dim, 0.3), tolerance=1e-6)
    again.restore(saved)
    for simulation in (whole, again):
        list(simulation.steps(0.5))
    assert len(whole.interactions.fused.split) > 0
    assert np.array_equal(whole.state.velocity, again.state.velocity)
    assert np.array_equal(whole.rigid.state.velocity, again.rigid.state.velocity)


@in_both
def test_joints_and_what_resists_rolling_act_beside_vertices_that_split(dim):
    """A ball that tows an arm rolls on one that strikes a plate, which is cut or one body."""

    def run(bonds, **options):
        ball = strikers(dim, 0.1)[0]
        side, *_, up = np.eye(dim)
        at = np.array(ball.position) + 0.401 * up
        still = {2: 0.0, 3: np.zeros(3)}[dim]
        other = replace(ball, position=at, velocity=-0.15 * up, spin=still)
        shape, turn, along = xf.rigid.Polygon.box((0.6, 0.1)), {"angle": 0.3}, {}
        if dim == 3:
            shape, along = xf.rigid.Polyhedron.box((0.6, 0.1, 0.2)), {"axis": (0.2, 1.0, 0.1)}
            turn = {"rotation": Rotation.from_rotvec((0.3, -0.4, 0.2))}
        arm = xf.RigidBody(
            shape, at + 0.4 * side, "arm", density=3.0, velocity=other.velocity, **turn
        )
        lifted = dict.fromkeys(range(3 * dim - 3), 0.0) | {dim - 1: 0.1}
        hook = xf.RigidBody(ball.shape, at, "arm", prescribed=lifted)
        joints = [
            xf.Hinge((arm, other), at=at + 0.2 * side, friction=1e-3, **along),
            xf.Tendon((hook, ball), at=[at, ball.position], stiffness=0.1, prestress=0.01),
        ]
        rolls, rigid = xf.laws.SignoriniCoulomb(0.3, rolling=0.02), [ball, other, arm, hook]
        simulation = struck(dim, bonds, rigid, among=rolls, joints=joints, **options)
        list(simulation.steps(60 * simulation.step_size))
        return simulation

    split = run(UNBREAKABLE)
    one = run(None, label=0, step=split.step_size)
    assert isinstance(split.solver, SplittingVertices)
    assert not isinstance(one.solver, SplittingVertices)
    states = [s.rigid.state for s in (split, one)]
    assert states[0].velocity == pytest.approx(states[1].velocity, abs=1e-10)
    forces = [np.column_stack(xf.output.find_joint_forces(s)) for s in (split, one)]
    assert np.abs(forces[1]).max() > 1e-3
    assert forces[0] == pytest.approx(forces[1], abs=1e-8)
    assert abs(split.ledger.closure) < 1e-12
    for name in ("kinetic", "elastic", "external_work", "dissipated_friction"):
        of_split, of_one = (getattr(s.ledger.energies, name) for s in (split, one))
        assert of_split == pytest.approx(of_one, rel=1e-8)
