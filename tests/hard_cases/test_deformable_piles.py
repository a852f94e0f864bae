# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hyperstatic piles of deformable bricks: they carry their weight and stay where they are."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, box_bodies, run

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError

GRAVITY = 10.0


def brick_wall(solver, contact, max_sweeps=20_000, rows=5, columns=3):
    """Bricks 2 x 1 half over half, half bricks at the ends, sides touching, on the ground."""
    law = SignoriniCoulomb(0.5, contact=contact)
    brick = lambda x: 100 * np.floor(x[1]) + np.floor(0.5 * (x[0] + np.floor(x[1]) % 2))  # noqa: E731
    scene = Scene(
        box_bodies((2 * columns, rows), (2 * columns, rows), "crossed", brick),
        {1: LinearElastic(1e8, 0.2, 1000.0)},
        default_interaction=law,
        walls=[Wall(BOTTOM, (0, 0), (0, 1), law)],
        loads=[Gravity((0.0, -GRAVITY))],
    )
    options = {"tolerance": 1e-11, "max_halvings": 0, "max_sweeps": max_sweeps}
    return Simulation(scene, 0.05, theta=1.0, solver=solver, num_threads=1, **options)


@pytest.mark.parametrize(
    "solver",
    [
        "monolithic",
        pytest.param(
            "auto",
            marks=pytest.mark.xfail(
                raises=ConvergenceError,
                strict=True,
                reason="redundant contacts at the position level: sweeps stall at some 1e-9",
            ),
        ),
    ],
)
def test_a_brick_wall_at_position_level(solver):
    """The ground bears its weight."""
    simulation = brick_wall(solver, "position", max_sweeps=300)
    run(simulation, 40)
    pushed = simulation.last.impulses.reshape(-1, 2)[:, 1].sum() / simulation.step_size
    weight = GRAVITY * simulation.bulk.mass.reshape(-1, 2)[:, 1].sum()
    assert pushed == pytest.approx(weight, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["nlgs", "newton", "accelerated", "auto"])
def test_a_brick_wall(solver, figure):
    """Each brick is in balance, the ground bears the weight, and nothing moves any more."""
    simulation = brick_wall(solver, "velocity")
    points = simulation.interactions
    run(simulation, 40)
    before, elastic = simulation.state.displacement.copy(), simulation.ledger.energies.elastic
    run(simulation, 20)
    size = np.abs(before).max()
    moved = np.abs(simulation.state.displacement - before).max() / size
    gained = simulation.ledger.energies.elastic / elastic - 1.0
    body = simulation.bulk.layout.body_of_node()
    mass = simulation.bulk.mass.reshape(-1, 2)[:, 0]
    weight = simulation.step_size * GRAVITY * np.bincount(body, mass)
    pushed = simulation.last.impulses.reshape(-1, 2)
    unbalanced = [np.bincount(body, pushed[:, axis]) - (weight if axis else 0.0) for axis in (0, 1)]
    error = np.abs(unbalanced / weight).max()
    ground = points.points.nodes[:, 1, 0] == points.inverse.num_nodes
    carried = points.gather("impulse")[ground, 0].sum() / weight.sum() - 1.0
    impulse = points.gather("impulse")
    figure(f"wall of {len(weight)} bricks, {solver}", "balance of a brick < 1e-9", error)
    figure(f"wall of {len(weight)} bricks, {solver}", "moved in 20 steps < 1e-9", moved)
    assert len(weight) == 17
    assert error < 1e-9 and abs(carried) < 1e-9
    assert moved < 1e-9 and abs(gained) < 1e-9
    assert np.all(impulse[:, 0] >= 0.0)
    assert np.all(np.abs(impulse[:, 1]) <= 0.5 * impulse[:, 0] + 1e-9 * weight.max())
