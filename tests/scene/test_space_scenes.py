# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every law in space: grains of tetrahedra, and each tetrahedron a body."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BACK, BOTTOM, FRONT, LEFT, RIGHT, TOP, box_bodies, field, nodes, run
from scipy.spatial import cKDTree

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb, Tresca
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

LENGTHS, CELLS = (5.0, 1.0, 1.0), (5, 1, 1)
JOINTS = {
    11: CohesiveZone(1e4, 1.0, 10.0, friction=0.1),
    12: SignoriniCoulomb(0.3, contact="position"),
    13: Tresca(0.5, contact="position"),
    14: PerfectBond(),
}
ELASTIC = LinearElastic(100.0, 0.3, 1.0)


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
def test_pressed_joints_of_every_law_move_as_one_body(grouping):
    """A bar cut by four laws, pressed, is the bar that was not cut, and nothing is lost in joints.

    The stress is the same everywhere, and the one with which the ends are pressed.
    """
    whole, reference = compressed(0, ELASTIC)
    simulation, records = compressed(GROUPINGS[grouping], ELASTIC, JOINTS)
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
