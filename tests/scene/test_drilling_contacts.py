# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts in 3D whose bodies spin about the normal: their tangents know no axis.

A cube that spins on a floor slides at its four corners, at r from the axis, each pressed by a
quarter of the weight: mu m g r brakes it, whatever angle it has turned by, until it stands.
"""

from __future__ import annotations

import numpy as np
import pytest
from scenes import box_bodies, field, mesh_of, nodes

import xper_fx as xf
from xper_fx.bodies.explode import EACH_CELL
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import tag_cells

MU, WEIGHT, SPIN = 0.3, 2.0, 3.0
ARM = np.sqrt(0.5)


def spinning_cube(meshed, step):
    """Of unit size and mass, meshed by a stiff hexahedron or rigid."""
    law = xf.laws.SignoriniCoulomb(MU)
    floor = xf.rigid.wall((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), "floor")
    cube, options = [], {}
    if meshed:
        options = {
            "bodies": box_bodies((1, 1, 1), (1, 1, 1), "hexahedron", 0),
            "materials": {1: xf.materials.NeoHookean(1e5, 0.3, 1.0)},
            "surfaces": {"cube": (1,)},
            "initial_velocity": lambda x: SPIN * np.stack([0.5 - x[1], x[0] - 0.5, 0.0 * x[0]]),
        }
    else:
        shape = xf.rigid.Polyhedron.box((1.0, 1.0, 1.0))
        cube = [
            xf.rigid.RigidBody(shape, (0.5, 0.5, 0.5), "cube", density=1.0, spin=(0.0, 0.0, SPIN))
        ]
    scene = xf.Scene(
        rigid=[*cube, floor],
        contacts=[xf.Contact(("cube", "floor"), law)],
        loads=[xf.Gravity((0.0, 0.0, -WEIGHT))],
        **options,
    )
    return xf.Simulation(scene, step, num_threads=1)


def angular_momentum(simulation, meshed):
    """About the axis of the cube."""
    if not meshed:
        return simulation.rigid.angular_momentum()[2] - 0.5 * (
            simulation.rigid.momentum()[1] - simulation.rigid.momentum()[0]
        )
    x = nodes(simulation) + field(simulation) - 0.5
    p = simulation.bulk.mass.reshape(x.shape) * field(simulation, "velocity")
    return float(np.sum(x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0]))


@pytest.mark.parametrize("meshed", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_spinning_cube_is_braked_by_its_corners(meshed):
    simulation = spinning_cube(meshed, 0.01 if meshed else 0.02)
    start, brake = angular_momentum(simulation, meshed), MU * WEIGHT * ARM
    inertia = 0.5 if meshed else 1.0 / 6.0
    assert start == pytest.approx(inertia * SPIN, rel=1e-12)
    end = start / brake
    turned, moment = 0.0, start
    for record in simulation.steps(0.9 * end):
        now = angular_momentum(simulation, meshed)
        turned += 0.5 * record.size * (moment + now) / inertia
        moment = now
    assert turned > 1.7
    bound = 5e-3 if meshed else 1e-9  # the mesh bounces as it takes its weight
    assert moment == pytest.approx(start - brake * record.time, abs=bound * start)
    *_, record = simulation.steps(1.2 * end)
    assert abs(angular_momentum(simulation, meshed)) < 1e-3 * start
    assert record.energies["dissipated_friction"] == pytest.approx(0.5 * SPIN * start, rel=2e-3)


def glued(spin, turns, step):
    """A cube that sticks to a table that spins; where it is in the table's axes, by step."""
    table = xf.rigid.RigidBody(
        xf.rigid.Polyhedron.box((6.0, 6.0, 1.0)), (0.0, 0.0, -0.5), "table",
        prescribed=dict.fromkeys(range(5), 0.0) | {5: spin},
    )  # fmt: skip
    cube = xf.rigid.RigidBody(
        xf.rigid.Polyhedron.box((1.0, 1.0, 1.0)), (1.0, 0.0, 0.5), "cube", density=1.0,
        velocity=(0.0, spin, 0.0), spin=(0.0, 0.0, spin),
    )  # fmt: skip
    glue = xf.laws.CohesiveZone(1e3, 1e3, 1e3)
    scene = xf.Scene(
        rigid=[table, cube], contacts=[xf.Contact(("table", "cube"), glue, reach=1e-2)],
        loads=[xf.Gravity((0.0, 0.0, -20.0))],
    )  # fmt: skip
    simulation = xf.Simulation(scene, step, tolerance=1e-6, num_threads=1)
    places = []
    for record in simulation.steps(turns * 2.0 * np.pi / spin):
        x, y = simulation.rigid.state.position[1, :2]
        c, s = np.cos(spin * record.time), np.sin(spin * record.time)
        places.append((c * x + s * y, c * y - s * x))
    return simulation, record, np.array(places)


def test_what_glue_holds_turns_with_its_bodies():
    """It swings by the slip m omega^2 R / (C_T A) about it; slips that stayed would creep on.

    That is by as much times the angle: 0.025 m a turn.
    """
    simulation, record, places = glued(2.0, 1.0, 0.02)
    slip = 2.0**2 / 1e3
    assert len(simulation.interactions.contacts[0]) == 4
    assert np.abs(places - (1.0 + slip, 0.0)).max() < 2.1 * slip
    assert abs(record.energies["closure"]) < 1e-10
    assert abs(record.energies["dissipated_numerical"]) < 1e-5


@pytest.mark.slow
def test_what_glue_holds_between_meshed_bodies_turns_with_them():
    """A small block on a heavy one, both free, spins round its axis, held by the slip of the glue.

    Slips that stayed in space would let it creep by as much times the angle, 2 pi a turn.
    """
    speed, stiffness, away = 2.0, 2e3, 1.0
    table = mesh_of((4.0, 4.0, 1.0), (1, 1, 1), "hexahedron")
    block = mesh_of((1.0, 1.0, 0.5), (1, 1, 1), "hexahedron")
    block.geometry.x[:] += (1.5 + away, 1.5, 1.0)
    joined = join_meshes([table, block])
    tags = tag_cells(joined.mesh, {2: lambda x: x[2] > 1.0})
    glue = xf.laws.CohesiveZone(stiffness, 1e3, 1e3)
    scene = xf.Scene(
        xf.explode(joined.mesh, EACH_CELL, tags),
        {1: xf.materials.NeoHookean(1e5, 0.3, 50.0), 2: xf.materials.NeoHookean(1e5, 0.3, 1.0)},
        surfaces={"table": (1,), "block": (2,)},
        contacts=[xf.Contact(("table", "block"), glue, reach=5e-2)],
        initial_velocity=lambda x: speed * np.stack([2.0 - x[1], x[0] - 2.0, 0.0 * x[0]]),
    )
    simulation = xf.Simulation(scene, 0.02, tolerance=1e-8, num_threads=1)
    x, places = nodes(simulation), []
    for record in simulation.steps(2.0 * np.pi / speed):  # noqa: B007 - the last is looked at
        now = x + field(simulation)
        table, block = now[x[:, 2] < 0.5], now[x[:, 2] > 1.25].mean(axis=0)
        along = table[x[x[:, 2] < 0.5, 0] > 2.0].mean(axis=0) - table.mean(axis=0)
        along[2] = 0.0
        along /= np.linalg.norm(along)
        out = block - table.mean(axis=0)
        places.append((out @ along, along[0] * out[1] - along[1] * out[0]))
    places, slip = np.array(places), 0.5 * speed**2 * away / stiffness
    assert len(simulation.interactions.contacts[0]) == 4
    last = places[-len(places) // 3 :]
    assert np.ptp(last, axis=0).max() > 2.0 * slip  # it swings
    assert abs(last[:, 1].mean()) < 0.4 * slip
    assert record.energies["dissipated_cohesion"] == 0.0
