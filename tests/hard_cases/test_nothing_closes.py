# SPDX-License-Identifier: LGPL-3.0-or-later
"""No point, points of which none ever closes, one body: exact free flight, in one sweep."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, box_bodies, field, run

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

VELOCITY, GRAVITY, STEP, STEPS = np.array([3.0, 40.0]), np.array([0.5, -10.0]), 1e-3, 50
SCHEMES = [("implicit", s, 0.5) for s in ("nlgs", "newton", "accelerated", "auto")] + [
    ("implicit", "auto", 1.0),
    ("explicit", "auto", 0.5),
]
LAWS = {
    "velocity": SignoriniCoulomb(0.3, 0.5),
    "position": SignoriniCoulomb(0.3, contact="position"),
    "bond": CohesiveZone(1e6, 1.0, 1e3, friction=0.3),
}


def flying(bodies, laws=(None, None), scheme="implicit", solver="auto", theta=0.5):
    """Bodies thrown upwards, a floor below and a law between them, if any."""
    between, floor = laws
    scene = Scene(
        bodies,
        {1: LinearElastic(1e4, 0.3, 1.0)},
        {(1, 1): between} if len(bodies.facets) else {},
        walls=[Wall(BOTTOM, (0, -1e-6), (0, 1), floor)] if floor else [],
        loads=[Gravity(GRAVITY)],
        initial_velocity=lambda x: VELOCITY[:, None] + 0.0 * x[:2],
    )
    options = {"tolerance": 1e-10, "num_threads": 1}
    return Simulation(scene, STEP, scheme=scheme, solver=solver, theta=theta, **options)


def flight_error(simulation):
    """Largest distance from v t + g t^2 / 2 (theta = 1: + g t h / 2), beside the way flown."""
    time = simulation.time
    late = (simulation.theta - 0.5) * simulation.step_size * time
    exact = VELOCITY * time + GRAVITY * (0.5 * time**2 + late)
    speed = VELOCITY + GRAVITY * time
    return max(
        np.abs(field(simulation) - exact).max() / np.abs(exact).max(),
        np.abs(field(simulation, "velocity") - speed).max() / np.abs(speed).max(),
    )


@pytest.mark.parametrize("scheme, solver, theta", SCHEMES)
def test_one_body_without_any_point(scheme, solver, theta, figure):
    simulation = flying(box_bodies((2, 1), (2, 1), label=0), (None, None), scheme, solver, theta)
    assert simulation.interactions is None
    records = run(simulation, STEPS)
    assert all(record.sweeps == 0 for record in records)
    error = flight_error(simulation)
    figure(
        f"one body, no point, {scheme}, {solver}, theta {theta}", "off its parabola < 1e-12", error
    )
    assert error < 1e-12
    assert abs(simulation.ledger.closure) < 1e-12 * simulation.ledger.energies.kinetic


@pytest.mark.slow
@pytest.mark.parametrize("scheme, solver, theta", SCHEMES)
@pytest.mark.parametrize("between", [None, "velocity", "position", "bond"])
def test_points_that_never_close(between, scheme, solver, theta, figure):
    """A floor just below, and between the bodies a law that nothing calls for: as if alone.

    Bodies that touch without load push each other by rounding at most.
    """
    bodies = box_bodies((2, 1), (2, 1), label=lambda x: x[0] > 1.0)
    laws = (LAWS.get(between), SignoriniCoulomb(0.5, 0.8))
    simulation = flying(bodies, laws, scheme, solver, theta)
    assert len(simulation.interactions) > 2
    records = run(simulation, STEPS)
    if between is None:
        assert all(record.sweeps == 1 and record.residual == 0.0 for record in records)
    rounding = 1e-14 * simulation.bulk.mass.sum() * np.abs(VELOCITY).max()
    assert np.abs(simulation.interactions.gather("impulse")).max() <= rounding
    alone = flying(bodies, (None, None), scheme, solver, theta)
    assert alone.interactions is None
    run(alone, STEPS)
    error, off = flight_error(simulation), simulation.state.displacement - alone.state.displacement
    case = f"open points, {between}, {scheme}, {solver}, theta {theta}"
    figure(case, "off its parabola < 1e-12", error)
    assert error < 1e-12
    assert np.abs(off).max() <= (0.0 if between is None else 1e-14)
    energies = simulation.ledger.energies
    assert abs(simulation.ledger.closure) < 1e-12 * energies.kinetic
    lost = energies.dissipated_impact + energies.dissipated_friction
    assert abs(lost) <= (0.0 if between is None else 1e-13 * energies.kinetic)
