# SPDX-License-Identifier: LGPL-3.0-or-later
"""Any body against any body: each cell a body, grains, rigid, against each of these.

Two blocks fly at each other off centre, without gravity: what interactions do must leave linear and
angular momentum as they are, and may only take energy.
"""

from itertools import combinations_with_replacement

import numpy as np
import pytest
from scenes import BOTTOM, box_bodies, run

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb
from xper_fx.nscd.rigid import Polygon, Polyhedron, RigidBody
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.scene.wall import Wall
from xper_fx.simulation.simulation import Simulation

KINDS = ("cells", "grains", "rigid")
SPEED, GAP = 1e-2, 1e-3
MATERIAL = LinearElastic(young=1.0, poisson=0.3, density=1.0)


def offset(dim):
    """What the second block is moved by: apart, and aside so that no nodes face each other."""
    return np.array([GAP, 0.23, 0.17][:dim])


def meshed_blocks(dim, kinds):
    """The blocks that are meshed: cell tags 1 and 2, unit size, side by side from the origin."""
    there = [number for number, kind in enumerate(kinds) if kind != "rigid"]
    if not there:
        return None, {}
    lengths = (float(len(there)), 1.0, 1.0)[:dim]
    cells = (2 * len(there), 2) if dim == 2 else (len(there), 2, 1)
    first = there[0]

    def label(x):
        block = np.minimum(x[0].astype(int), len(there) - 1) + first
        cell = np.arange(len(block)) + 10
        grain = 2 * block + (x[1] > 0.5)
        return np.where(np.array([kinds[b] == "cells" for b in block]), cell, grain)

    bodies = box_bodies(
        lengths, cells, "crossed" if dim == 2 else "tetrahedron", label,
        {2: lambda x: x[0] > 1.0 - first - 1e-9} if 1 in there else None,
    )  # fmt: skip
    x = bodies.mesh.geometry.x
    if first == 1:
        x[:, 0] += 1.0
    second = np.unique(
        bodies.mesh.geometry.dofmap[np.flatnonzero(bodies.material_of_cell == 2)]
        if hasattr(bodies.mesh.geometry, "dofmap")
        else bodies.mesh.geometry.dofmaps[0][np.flatnonzero(bodies.material_of_cell == 2)]
    )
    x[second, :dim] += offset(dim)
    return bodies, {"ab"[number]: (number + 1,) for number in there}


def collision(dim, kinds, law):
    """The scene of two blocks."""
    bodies, surfaces = meshed_blocks(dim, kinds)
    shape = Polygon.box((1.0, 1.0)) if dim == 2 else Polyhedron.box((1.0, 1.0, 1.0))
    velocities = SPEED * np.eye(dim)[0], -SPEED * np.eye(dim)[0]
    rigid = [
        RigidBody(
            shape, np.full(dim, 0.5) + number * (np.eye(dim)[0] + offset(dim)), "ab"[number],
            density=1.0, velocity=velocities[number],
        )
        for number, kind in enumerate(kinds)
        if kind == "rigid"
    ]  # fmt: skip
    meshed = {}
    if bodies is not None:
        tags = np.unique(bodies.material_of_cell).tolist()
        meshed = {
            "bodies": bodies,
            "materials": dict.fromkeys(tags, MATERIAL),
            "interactions": {(1, 2): None} if len(tags) == 2 else {},
            "default_interaction": PerfectBond(),
            "surfaces": surfaces,
            "initial_velocity": {
                tag: lambda x, v=velocities[tag - 1]: np.outer(v, np.ones(x.shape[1]))
                for tag in tags
            },
        }
    return Scene(rigid=rigid, contacts=[Contact(("a", "b"), law)], **meshed)


def momenta(simulation):
    """Linear and angular momentum about the origin, and the momentum of the second block."""
    dim = simulation.bulk.dim
    linear, angular, second = np.zeros(dim), np.zeros(2 * dim - 3), np.zeros(dim)
    if simulation.scene.bodies is not None:
        V = simulation.forms.V
        x = V.tabulate_dof_coordinates()[:, :dim] + simulation.state.displacement.reshape(-1, dim)
        p = (simulation.bulk.mass * simulation.state.velocity).reshape(-1, dim)
        linear += p.sum(0)
        angular += (
            np.cross(x, p).sum(0)
            if dim == 3
            else (x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0]).sum(keepdims=True)
        )
        second += p[V.dofmap.list[simulation.scene.bodies.material_of_cell == 2].ravel()].sum(0)
    if simulation.rigid is not None:
        linear += simulation.rigid.momentum()
        angular += simulation.rigid.angular_momentum()
    return linear, angular, second


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("a", "b"), combinations_with_replacement(KINDS, 2))
def test_any_body_against_any_body(dim, a, b):
    simulation = Simulation(
        collision(dim, (a, b), SignoriniCoulomb(friction=0.4)), 0.02, tolerance=1e-6,
        num_threads=1,
    )  # fmt: skip
    linear, angular, _ = momenta(simulation)
    size = SPEED * 1.0
    held, touched = simulation.ledger.energies.held_and_lost, False
    lost = 0.0
    for record in simulation.steps(0.8):
        energies = simulation.ledger.energies
        touched |= any(np.any(g.impulse[:, 0] > 0.0) for g in simulation.interactions.contacts)
        assert abs(record.energies["closure"]) < 1e-12 * held
        now = energies.dissipated_impact + energies.dissipated_friction
        assert now > lost - 1e-6 * held  # the tolerance
        lost = now
        after, turned, _ = momenta(simulation)
        assert np.abs(after - linear).max() < 1e-12 * size
    assert touched and lost > 0.05 * held
    # small strain is not indifferent to rotation, and a meshed side's arm is its facet's
    bound = 1e-12 if (a, b) == ("rigid", "rigid") else 1e-2
    assert np.abs(turned - angular).max() < bound * size


@pytest.mark.slow
@pytest.mark.parametrize("kinds", [("rigid", "cells"), ("grains", "cells")])
def test_explicit_bulk(kinds):
    """A facet's nodes have one block of w, though the mass is lumped."""
    scene = collision(2, kinds, SignoriniCoulomb(friction=0.4))
    simulation = Simulation(scene, 0.02, scheme="explicit", tolerance=1e-6, num_threads=1)
    linear, _, second = momenta(simulation)
    held, several = simulation.ledger.energies.held_and_lost, False
    for record in simulation.steps(0.8):
        for group in simulation.interactions.contacts:
            w, x = 1.0 / simulation.bulk.mass.reshape(-1, 2)[:, 0], group.points
            slots = np.concatenate([w[simulation.model.slot_nodes], np.full(2, np.nan)])
            meshed = np.all(x.nodes < len(simulation.model.slot_nodes), axis=(1, 2))
            expected = (x.weights**2 * slots[np.minimum(x.nodes, len(slots) - 1)]).sum((1, 2))
            assert group.compliance[meshed, 0] == pytest.approx(expected[meshed])
            several |= bool(np.any((x.weights > 1e-3).sum(2).max(1)[meshed] > 1))
        linear_now, _, second_now = momenta(simulation)
        assert np.abs(linear_now - linear).max() < 1e-12 * SPEED
        assert abs(record.energies["closure"]) < 0.02 * held
    assert several == (kinds[0] == "grains")
    assert (second_now - second)[0] > 0.5 * SPEED


@pytest.mark.parametrize("material", [LinearElastic, NeoHookean])
def test_lips_that_turn_go_over_to_the_search(material):
    """Two halves of a spinning plate, loose, whose own points keep the frames of the start.

    At finite strain frames turn with the lips, and points stay while the lips face each other.
    """
    bodies = box_bodies((2.0, 1.0), (2, 1), "quadrilateral")
    scene = Scene(
        bodies,
        {1: material(young=1e3, poisson=0.3, density=1.0)},
        default_interaction=SignoriniCoulomb(),
        surfaces={"halves": (1,)},
        contacts=[Contact(("halves", "halves"), SignoriniCoulomb())],
        initial_velocity=lambda x: np.array([0.5 - x[1], x[0] - 1.0]),
    )
    simulation = Simulation(scene, 0.01, tolerance=1e-8, num_threads=1)

    def kept():
        return sum(map(len, simulation.interactions.groups)) - sum(
            map(len, simulation.interactions.contacts)
        )

    run(simulation, 18)
    assert kept() == 2
    apart = np.abs(simulation.interactions.gather("jump")).max()
    run(simulation, 4)
    assert apart < 0.1
    if material is LinearElastic:
        assert kept() == 0
    else:
        assert kept() == 2
        normal = simulation.interactions.points.frame[0, 0]
        angle = np.arctan2(normal[1], normal[0])
        assert angle == pytest.approx(simulation.time - 0.5 * simulation.step_size, abs=0.01)


@pytest.mark.parametrize("broken", [0, 1])
def test_a_half_broken_facet_touches_rigid_bodies(broken):
    """A half that has swung about what is left of its bond stands on its lip, on a block.

    The bond's own points stay; the sides of the lip face elsewhere, so that it alone can touch.
    """
    block = RigidBody(Polygon.box((2.0, 1.0)), (0.5, -5.0), "block", density=1.0)
    scene = Scene(
        box_bodies((2.0, 1.0), (2, 1), "quadrilateral"),
        {1: NeoHookean(young=1e3, poisson=0.3, density=1.0)},
        default_interaction=CohesiveZone(1e4, 1.0, 1e2),
        surfaces={"halves": (1,)},
        contacts=[Contact(pair, SignoriniCoulomb()) for pair in
                  (("halves", "halves"), ("halves", "block"))],
        rigid=[block],
    )  # fmt: skip
    simulation = Simulation(scene, 1e-4, num_threads=1)
    detection, (group,) = simulation.detection, simulation.interactions.groups
    x = simulation.forms.V.tabulate_dof_coordinates()[:, :2]
    dofs = simulation.forms.V.dofmap.list
    left = dofs[np.argmin(x[dofs].mean(axis=1)[:, 0])]
    moved = x.copy()  # a quarter turn clockwise about (1, 1): the lip lies along y = 1
    moved[left] = np.array([1.0, 1.0]) + (x[left] - 1.0) @ np.array([[0.0, -1.0], [1.0, 0.0]])
    lip = left[np.abs(moved[left, 1] - 1.0) < 1e-12]

    def touching():
        found = detection._surfaces.find(moved, np.array([[0.5, 0.499]]), np.zeros(1))
        on_block = found.take(np.flatnonzero(found.body[:, 1] == 0))
        return set(lip) & set(on_block.nodes[:, 0, 0].tolist()), on_block

    assert len(lip) == 2 and touching()[0] == set()
    group.state[broken, group.kernels.state_names.index("damage")] = 0.0
    detection.release(simulation.interactions, 2, (moved - x).ravel())
    nodes, contacts = touching()
    assert nodes == set(lip) and len(simulation.interactions.groups[0]) == 2
    own = np.isin(contacts.nodes[:, 0, 0], lip)
    np.testing.assert_allclose(contacts.gap[own], 1e-3, atol=1e-12)
    np.testing.assert_allclose(contacts.normal[own], [[0.0, 1.0]] * 2, atol=1e-12)


def test_a_wall_stays_where_it_is_beside_rigid_bodies():
    """A block rests on a wall while a rigid one falls freely beside it."""
    beside = RigidBody(Polygon.box((1.0, 1.0)), (5.0, 5.0), "beside", density=1.0)
    law, fall = SignoriniCoulomb(), -1e-3
    scene = Scene(
        box_bodies((1.0, 1.0), (2, 2), label=0), {1: MATERIAL}, rigid=[beside],
        walls=[Wall(BOTTOM, (0.0, 0.0), (0.0, 1.0), law)], surfaces={"block": (1,)},
        contacts=[Contact(("block", "beside"), law)], loads=[Gravity((0.0, fall))],
    )  # fmt: skip
    simulation = Simulation(scene, step=0.05)
    run(simulation, 20)
    assert simulation.rigid.state.velocity[0] == pytest.approx([0.0, fall], rel=1e-9)
    below = simulation.forms.V.tabulate_dof_coordinates()[:, 1] < 1e-9
    down = simulation.state.displacement.reshape(-1, 2)[below, 1]
    assert np.abs(down).max() < 1e-2 * abs(fall) / 2.0  # half of |fall| is that of free fall
