# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every material and every law in space: grains of tetrahedra, and each tetrahedron a body."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BACK, BOTTOM, FRONT, LEFT, RIGHT, TOP, box_bodies, field, nodes, run
from scipy.spatial import cKDTree

from xper_fx.forms.loads import PrescribedDisplacement, PrescribedVelocity
from xper_fx.materials import (
    Cubic,
    J2FiniteStrain,
    J2SmallStrain,
    Linear,
    LinearElastic,
    LinearViscoelastic,
    NeoHookean,
    Orthotropic,
    SaintVenantKirchhoff,
    Voce,
)
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb, Tresca
from xper_fx.scene import Scene
from xper_fx.simulation import Simulation

LENGTHS, CELLS = (5.0, 1.0, 1.0), (5, 1, 1)
JOINTS = {
    11: CohesiveZone(1e4, 1.0, 10.0, friction=0.1),
    12: SignoriniCoulomb(0.3, contact="position"),
    13: Tresca(0.5, contact="position"),
    14: PerfectBond(),
}
MATERIALS = [
    LinearElastic(100.0, 0.3, 1.0),
    NeoHookean(100.0, 0.3, 1.0),
    SaintVenantKirchhoff(100.0, 0.3, 1.0),
    Cubic(150.0, 90.0, 80.0, 1.0, rotation=-0.3),
    Orthotropic((100.0, 60.0, 20.0), (0.3, 0.1, 0.2), (30.0, 15.0, 10.0), 1.0),
    LinearViscoelastic(100.0, 0.3, [(0.5, 0.03)], 1.0),
    J2SmallStrain(100.0, 0.3, 0.3, Linear(10.0), 1.0),
    J2FiniteStrain(100.0, 0.3, 0.3, Voce(1.0, 10.0), 1.0),
]


def slabs(x):
    return np.floor(x[0])


GROUPINGS = {"grains": slabs, "cells": None}


def at_joint(tag):
    return lambda x: np.abs(x[0] - (tag - 10.0)) < 1e-9


def bar(label, material, loads, joints=None, **options):
    """Five slabs along x, a joint between any two; without joints one body."""
    interior = {tag: at_joint(tag) for tag in JOINTS}
    bodies = box_bodies(LENGTHS, CELLS, "tetrahedron", label, interior=interior)
    laws = {} if joints is None else {"default_interaction": PerfectBond()}
    return Scene(
        bodies, {1: material}, facet_interactions=joints or {}, loads=loads, **laws, **options
    )


def compressed(label, material, joints=None):
    """The ends approach at a strain rate of -0.1; 6 steps, to a strain of -0.6 %.

    The sides are guided, so that strain and stress are uniform and joints are pressed alone.
    """
    loads = [PrescribedVelocity(LEFT, 0, 0.25), PrescribedVelocity(RIGHT, 0, -0.25)]
    loads += [PrescribedVelocity(tag, 1, 0.0) for tag in (BOTTOM, TOP)]
    loads += [PrescribedVelocity(tag, 2, 0.0) for tag in (BACK, FRONT)]
    scene = bar(
        label, material, loads, joints,
        initial_velocity=lambda x: np.array([0.25 - 0.1 * x[0], 0.0 * x[0], 0.0 * x[0]]),
    )  # fmt: skip
    simulation = Simulation(scene, 0.01, theta=0.6, tolerance=1e-11, newton_tolerance=1e-11,
                            max_newton=60, num_threads=1)  # fmt: skip
    return simulation, run(simulation, 6)


@pytest.mark.parametrize("grouping", GROUPINGS)
@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: type(m).__name__)
def test_pressed_joints_of_every_law_move_as_one_body(material, grouping):
    """A bar cut by four laws, pressed, is the bar that was not cut, and nothing is lost in joints.

    The stress is the same everywhere, and the one with which the ends are pressed.
    """
    whole, reference = compressed(0, material)
    simulation, records = compressed(GROUPINGS[grouping], material, JOINTS)
    distance, same = cKDTree(nodes(whole)).query(nodes(simulation))
    assert distance.max() < 1e-12
    u = field(whole)
    assert np.abs(field(simulation) - u[same]).max() < 1e-7 * np.abs(u).max()
    # along the bar: across it, neighbours of the end's cells bear a part
    force = simulation.reaction(RIGHT)[0]
    assert force == pytest.approx(whole.reaction(RIGHT)[0], rel=1e-6)
    energies, expected = records[-1].energies, reference[-1].energies
    work = energies["external_work"]
    for name in ("cohesion", "friction", "impact"):
        assert abs(energies[f"dissipated_{name}"]) < 1e-8 * work
    for name, value in expected.items():
        assert energies[name] == pytest.approx(value, rel=1e-6, abs=1e-7 * work)
    assert abs(energies["closure"] - expected["closure"]) < 1e-8 * work
    simulation.displacement  # noqa: B018  brings the state into the forms
    stress = simulation.forms.stress_evaluator()()
    assert stress == pytest.approx(np.broadcast_to(stress.mean(axis=0), stress.shape), abs=1e-6)
    if simulation.forms.linear:  # a step's mean force stands for t0 + theta h
        share = (5.0 + simulation.theta) / 6.0
        assert simulation.reaction(RIGHT)[0] == pytest.approx(share * stress[0, 0, 0], rel=1e-6)
    momentum = (simulation.bulk.mass * simulation.state.velocity).reshape(-1, 3).sum(axis=0)
    assert momentum == pytest.approx(0.0, abs=1e-9)


BOND = CohesiveZone(1e3, 0.5, 2.0)


@pytest.mark.parametrize("law, spent", [(BOND, 0.5), (SignoriniCoulomb(), 0.0), (Tresca(0.1), 0.0)])
@pytest.mark.parametrize("grouping", GROUPINGS)
def test_pulled_joints_open(grouping, law, spent):
    """One joint amid perfect bonds opens: a bond spends w on its area of 1, a contact nothing."""
    loads = [PrescribedVelocity(LEFT, 0, -1.0), PrescribedVelocity(RIGHT, 0, 1.0)]
    joints = {tag: PerfectBond() for tag in JOINTS} | {12: law}
    scene = bar(
        GROUPINGS[grouping], MATERIALS[0], loads, joints,
        initial_velocity=lambda x: np.array([0.4 * x[0] - 1.0, 0.0 * x[0], 0.0 * x[0]]),
    )  # fmt: skip
    simulation = Simulation(scene, 2e-2, tolerance=1e-10, num_threads=1)
    records = run(simulation, 50)
    energies = records[-1].energies
    jump = simulation.interactions.gather("jump")[:, 0]
    assert np.count_nonzero(jump > 0.5) == 6  # the points of the joint's two triangles
    assert np.abs(jump[jump < 0.5]).max() < 1e-6
    assert energies["dissipated_cohesion"] == pytest.approx(spent, abs=1e-7)
    assert energies["dissipated_friction"] == pytest.approx(0.0, abs=1e-9)
    assert abs(energies["closure"]) < 1e-7 * energies["external_work"]
    momentum = (simulation.bulk.mass * simulation.state.velocity).reshape(-1, 3).sum(axis=0)
    assert momentum == pytest.approx(0.0, abs=1e-8)


PRESS, SLIP = 0.02, (0.3, 0.4)


@pytest.mark.parametrize("grouping", GROUPINGS)
@pytest.mark.parametrize(
    "law, bound",
    [
        (SignoriniCoulomb(0.25, contact="position"), lambda pressure: 0.25 * pressure),
        (Tresca(0.3, contact="position"), lambda pressure: 0.3),
        (CohesiveZone(1e3, 1e-3, 0.2, friction=0.25), lambda pressure: 0.25 * pressure),
    ],
)
def test_a_joint_slides_against_the_slip_at_its_bound(grouping, law, bound):
    """Ends pressed together, then moved along (3, 4) / 5 across: traction, direction, work.

    The ends do not turn: both slabs stay what they are but for shear, uniform on the joint only on
    average, so that forces are compared, not points.
    """
    loads = [PrescribedDisplacement(LEFT, axis, 0.0) for axis in range(3)]
    loads += [PrescribedDisplacement(RIGHT, 0, lambda t: -PRESS * min(t, 1.0))]
    loads += [
        PrescribedDisplacement(RIGHT, 1 + a, lambda t, v=v: v * max(t - 1.0, 0.0))
        for a, v in enumerate(SLIP)
    ]
    joints = {tag: PerfectBond() for tag in JOINTS} | {12: law}
    scene = bar(GROUPINGS[grouping], LinearElastic(100.0, 0.0, 1e-3), loads, joints)
    simulation = Simulation(scene, 0.1, theta=1.0, tolerance=1e-10, num_threads=1)
    run(simulation, 15)
    early = simulation.ledger.energies.dissipated_friction
    start = simulation.mean_displacement(RIGHT)[1:]
    records = run(simulation, 5)
    force = simulation.reaction(RIGHT)
    assert -force[0] == pytest.approx(100.0 * PRESS / 5.0, rel=0.05)
    assert np.hypot(*force[1:]) == pytest.approx(bound(-force[0]), rel=1e-3)
    assert force[1:] / np.hypot(*force[1:]) == pytest.approx(np.array(SLIP) / 0.5, abs=2e-3)
    moved = np.hypot(*(simulation.mean_displacement(RIGHT)[1:] - start))
    lost = records[-1].energies["dissipated_friction"] - early
    assert lost == pytest.approx(bound(-force[0]) * moved, rel=1e-2)
    assert abs(records[-1].energies["closure"]) < 1e-8
