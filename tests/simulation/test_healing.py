# SPDX-License-Identifier: LGPL-3.0-or-later
"""Overlaps of rigid bodies that impacts leave are taken back, for no energy but what they cost."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import run
from scipy.optimize import nnls

from xper_fx.forms.loads import Gravity
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, Polygon, Polyhedron, RigidBodies, RigidBody, Sphere, wall
from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.nscd.separation import Separation
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

OPTIONS = {"num_threads": 1, "tolerance": 1e-10}


def scene_of(rigid, law=None, gravity=None, **options):
    groups = sorted({body.group for body in rigid})
    pairs = [(a, b) for i, a in enumerate(groups) for b in groups[i:]]
    law = law or SignoriniCoulomb(0.3)
    loads = [] if gravity is None else [Gravity(gravity)]
    return Scene(rigid=rigid, contacts=[Contact(pair, law) for pair in pairs], loads=loads)


def deepest(simulation) -> float:
    """Largest depth of a contact, of the bodies where they are (m)."""
    bodies, state = simulation.scene.rigid_bodies, simulation.rigid.state
    groups = [c.between for c in simulation.scene.contacts]
    found = Separation(bodies, groups).find(state.position, state.turn.rotation)
    return max(0.0, -float(found.gap.min(initial=0.0)))


@pytest.mark.parametrize("dim", [2, 3])
def test_a_fall_into_the_ground_is_taken_back(dim):
    """A box thrown down by 0.6 of its size in a step rises to the depth that is left; no more.

    Gravity grows in time: the work is that of its value at the end of the step.
    """
    up = np.eye(dim)[-1]
    shape = Polygon.box((1.0,) * 2) if dim == 2 else Polyhedron.box((1.0,) * 3)
    box = RigidBody(shape, 0.6 * up, "box", mass=2.0, velocity=-6.0 * up)
    gravity = lambda t: -(3.0 + 50.0 * t) * up  # noqa: E731
    rigid = [wall((0.0,) * dim, up, "ground"), box]
    healed = Simulation(scene_of(rigid, gravity=gravity), 0.1, **OPTIONS)
    left = Simulation(scene_of(rigid, gravity=gravity), 0.1, healing=False, **OPTIONS)
    run(left, 1)
    allowed = healed.model.healing.depth
    height, energy, moves = left.rigid.state.position[1, -1], 0.0, 0
    assert 0.5 - height == pytest.approx(deepest(left)) and deepest(left) > 0.15
    for number in range(1, 8):
        run(healed, 1)
        now = healed.rigid.state.position[1, -1]
        energy += 2.0 * (3.0 + 50.0 * 0.1 * number) * (now - height)
        moves += now > height + 1e-9
        height = now
        assert np.abs(healed.rigid.state.velocity[1]).max() < 1e-9
        columns = healed.ledger.as_columns()
        assert columns["healing"] == pytest.approx(energy, rel=1e-9)
        assert abs(columns["closure"]) < 1e-12 * 36.0
    assert 0.4 * allowed < 0.5 - height <= allowed
    # by half of the search's reach, a tenth of the box's radius, at once
    expected = np.ceil(deepest(left) / (0.1 * healed.scene.rigid_bodies.shapes.bounding_radius[1]))
    assert moves == healed.model.healing.count == expected
    assert "healing" not in left.ledger.as_columns()
    run(left, 6)
    assert deepest(left) > 0.15


def crowd(dim):
    """Bodies of several shapes and masses that overlap, one of them fixed."""
    random = np.random.default_rng(4)
    bodies = []
    for number, place in enumerate(np.ndindex((3, 2) if dim == 2 else (2, 2, 1))):
        size = random.uniform(0.5, 0.6)
        if dim == 2:
            shape = Disc(size) if number % 2 else Polygon.box((2.0 * size, 1.9 * size))
            turn = {"angle": random.uniform(-0.1, 0.1)}
        else:
            shape = Sphere(size) if number % 2 else Polyhedron.box((2.0 * size,) * 3)
            turn = {"rotation": (*random.uniform(-0.05, 0.05, 3), 1.0)}
        held = dict.fromkeys(range(3 * (dim - 1)), 0.0) if number == 0 else {}
        bodies.append(
            RigidBody(shape, np.array(place, float), "all", mass=random.uniform(1.0, 9.0),
                      prescribed=held, **turn)
        )  # fmt: skip
    return RigidBodies(bodies)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_least_motion(dim):
    """Gaps open, and M d is a sum of pushes of those that are just closed: optimal, if convex."""
    bodies = crowd(dim)
    separation = Separation(bodies, [("all", "all")])
    contacts = separation.find(bodies.position, bodies.rotation)
    assert contacts.gap.min() < -0.1
    gap = 0.02 * contacts.gap  # small, so that the motion is not cut
    found = separation.motion(contacts, gap, bodies.position, RigidMotion(bodies).blocks)
    dofs, turns = 2 * dim, 3 if dim == 3 else 1
    rows, mass = np.zeros((len(gap), len(bodies), dofs)), np.zeros((len(bodies), dofs, dofs))
    for c, pair in enumerate(contacts.body):
        for sign, body in zip((1.0, -1.0), pair, strict=True):
            arm = contacts.point[c] - bodies.position[body]
            moment = np.atleast_1d(np.cross(arm, contacts.normal[c])) if dim == 3 else [
                arm[0] * contacts.normal[c, 1] - arm[1] * contacts.normal[c, 0]
            ]  # fmt: skip
            rows[c, body, :dim] += sign * contacts.normal[c]
            rows[c, body, dim : dim + turns] += sign * np.asarray(moment)
    for body in range(len(bodies)):
        turned = bodies.rotation[body]
        inertia = bodies.inertia[body]
        mass[body, :dim, :dim] = bodies.mass[body] * np.eye(dim)
        mass[body, dim:, dim:] = np.eye(dim)
        mass[body, dim : dim + turns, dim : dim + turns] = (
            turned @ inertia @ turned.T if dim == 3 else inertia
        )
    flat = found.reshape(-1)
    opened = gap + rows.reshape(len(gap), -1) @ flat
    scale = -gap.min()
    assert opened.min() > -2e-3 * scale and np.abs(found).max() > 0.5 * scale
    assert not found[0].any()
    pushing = rows[opened < 2e-3 * scale, 1:].reshape(-1, flat.size - dofs).T
    asked = np.einsum("bij,bj->bi", mass[1:], found.reshape(-1, dofs)[1:]).ravel()
    _, missing = nnls(pushing, asked)
    assert missing < 1e-9 * np.linalg.norm(asked)


def test_a_crowd_of_a_thousand_grains_is_moved_apart():
    """Discs as deep in each other as a deposit that fell for a second: apart in a few rounds."""
    random = np.random.default_rng(3)
    places = [(x + 0.5 * (y % 2), 0.87 * y) for y in range(32) for x in range(32)]
    grains = [
        RigidBody(Disc(0.5 * random.uniform(0.85, 1.05)), place, "grains", density=1.0)
        for place in places
    ]
    sides = [((0.0, -0.45), (0.0, 1.0)), ((-0.5, 0.0), (1.0, 0.0)), ((32.0, 0.0), (-1.0, 0.0))]
    rigid = [*grains, *(wall(point, normal, "box") for point, normal in sides)]
    contacts = [Contact(("grains", group), SignoriniCoulomb()) for group in ("grains", "box")]
    with pytest.raises(ValueError, match="overlap at the start"):
        Scene(rigid=rigid, contacts=contacts)
    moved = Scene(rigid=rigid, contacts=contacts, resolve_overlaps=True).rigid_bodies.position[:-3]
    assert np.linalg.norm(moved - places, axis=1).max() < 2.0
    radius = np.array([grain.shape.radius for grain in grains])
    distance = np.linalg.norm(moved[:, None] - moved, axis=2) + 9.0 * np.eye(len(moved))
    assert (distance - radius[:, None] - radius).min() > -1e-6
    assert (moved[:, 1] + 0.45 - radius).min() > -1e-6


def test_a_cloud_that_nothing_holds_is_left_alone():
    """Discs that collide in flight above a floor: the same bits as without healing."""
    random, states = np.random.default_rng(2), []
    discs = [
        RigidBody(Disc(0.1), (0.21 * i, 5.0 + 0.21 * j), "discs", density=1.0,
                  velocity=(2.0 - 2.0 * i, 0.3 * random.normal()), spin=random.normal())
        for i in range(3) for j in range(3)
    ]  # fmt: skip
    for healing in (True, False):
        scene = scene_of([wall((0.0, 0.0), (0.0, 1.0), "floor"), *discs])
        simulation = Simulation(scene, 2e-2, healing=healing, **OPTIONS)
        run(simulation, 30)
        assert deepest(simulation) > 1e-3
        states.append(simulation.rigid.state)
    assert np.array_equal(states[0].position, states[1].position)
    assert np.array_equal(states[0].turn.rotation, states[1].turn.rotation)


def test_a_rebound_gains_no_height():
    """A box leaves the floor by its spin while a stone beside it is lifted out: by the same bits.

    The corner that was hit is 0.3 off the centre, which goes on down after the impact.
    """
    boxes, depths = [], []
    for healing in (True, False):
        rigid = [
            wall((0.0, 0.0), (0.0, 1.0), "floor"),
            RigidBody(Polygon.box((1.0, 1.0)), (0.0, 0.65), "box", density=1.0, angle=0.3,
                      velocity=(0.0, -4.0)),
            RigidBody(Disc(0.5), (4.0, 0.65), "stone", density=1.0, velocity=(0.0, -20.0)),
        ]  # fmt: skip
        contacts = [
            Contact(("box", "floor"), SignoriniCoulomb(restitution=0.1)),
            Contact(("stone", "floor"), SignoriniCoulomb()),
            Contact(("stone", "box"), None),
        ]
        scene = Scene(rigid=rigid, contacts=contacts)
        simulation = Simulation(scene, 2e-2, healing=healing, **OPTIONS)
        run(simulation, 2)
        boxes.append(simulation.rigid.state.position[1])
        depths.append(deepest(simulation))
        assert simulation.rigid.state.velocity[1, 1] < -0.1
    assert np.array_equal(*boxes)
    assert depths[0] < depths[1] - 0.04


def test_a_guided_body_is_healed():
    """The kinetic energy that it gains as its inertia turns is in the ledger."""
    guided = RigidBody(
        Polyhedron.box((1.0, 2.0, 0.5)), (0.0, 0.0, 0.9), "box", density=1.0,
        rotation=(0.1, 0.3, 0.05, 1.0), velocity=(0.0, 0.0, -6.0), prescribed={3: 2.0},
    )  # fmt: skip
    scene = scene_of([wall((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "ground"), guided])
    simulation = Simulation(scene, 5e-2, **OPTIONS)
    healed = 0.0
    for _ in range(8):
        run(simulation, 1)
        healed = max(healed, abs(simulation.ledger.energies.healing))
        assert abs(simulation.ledger.closure) < 1e-11 * 18.0
    assert healed > 1e-3


def test_bodies_turn_without_kinetic_energy():
    """Spins turn with the axes of tumbling bodies; of guided ones the gain is told."""
    random, box = np.random.default_rng(1), Polyhedron.box((1.0, 2.0, 3.0))
    bodies = RigidBodies([
        RigidBody(box, (4.0 * i, 0.0, 0.0), "boxes", density=1.0, spin=random.normal(size=3),
                  rotation=random.normal(size=4), prescribed={3: 2.0} if i else {})
        for i in range(2)
    ])  # fmt: skip
    motion = RigidMotion(bodies, (0.0, 0.0, -10.0))
    moved = np.zeros((2, 2, 3))
    moved[0] = random.normal(size=(2, 3))
    moved[1, 1, 1:] = random.normal(size=2)
    before, start = motion.kinetic, motion.state.turn
    work, gained = motion.displace(moved, 0.0)
    after = motion.state.turn
    assert work == pytest.approx(-10.0 * bodies.mass[0] * moved[0, 0, 2], rel=1e-12)
    assert motion.kinetic - before == pytest.approx(gained, rel=1e-9)
    assert abs(gained) > 1e-2 * before
    spins = [np.linalg.norm(turn.spin[0]) for turn in (start, after)]
    assert spins[0] == pytest.approx(spins[1]) and not np.allclose(start.spin[0], after.spin[0])
    assert after.spin[1, 0] == 2.0
    inertia = after.rotation @ bodies.inertia @ np.swapaxes(after.rotation, 1, 2)
    assert np.allclose(after.inertia, inertia) and not np.allclose(start.rotation, after.rotation)
    assert np.allclose(after.momentum, np.einsum("nij,nj->ni", inertia, after.spin))
    motion.renew_blocks()
    assert np.allclose(motion.blocks[0, 3:, 3:] @ inertia[0], np.eye(3))


def test_a_heap():
    """Discs that fall into a box: overlaps end below the depth that is left, at a small price."""
    random = np.random.default_rng(0)
    discs = [
        RigidBody(Disc(random.uniform(0.07, 0.1)), (0.12 + 0.21 * i, 0.1 + 0.21 * j), "discs",
                  density=1000.0)
        for i in range(5) for j in range(6)
    ]  # fmt: skip
    sides = [((0, 0), (0, 1)), ((0, 0), (1, 0)), ((1.1, 0), (-1, 0))]
    rigid = discs + [wall(point, normal, "box") for point, normal in sides]
    scene, depths = scene_of(rigid, gravity=(0.0, -9.81)), {}
    for healing in (True, False):
        simulation = Simulation(scene, 4e-3, num_threads=1, healing=healing)
        run(simulation, 250)
        depths[healing] = deepest(simulation)
        energies = simulation.ledger.energies
        assert abs(simulation.ledger.closure) < 1e-9 * energies.dissipated_impact
        assert energies.kinetic < 1e-4 * energies.dissipated_impact
        if healing:
            allowed = simulation.model.healing.depth
            assert 0.0 < energies.healing < 0.1 * energies.dissipated_impact
            count = simulation.model.healing.count
            run(simulation, 50)
            assert simulation.model.healing.count - count <= 5
    assert depths[True] <= allowed and depths[False] > 20.0 * allowed


def test_asked_for_in_words():
    rigid = [wall((0.0, 0.0), (0.0, 1.0), "ground")]
    rigid.append(RigidBody(Disc(0.5), (0.0, 0.5), "disc", density=1.0))
    with pytest.raises(TypeError, match="healing should be True or False"):
        Simulation(scene_of(rigid), 0.1, healing="yes")
