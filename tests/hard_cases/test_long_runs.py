# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bar that swings freely for 2e4 steps: what the ledger misses is rounding, and grows no faster.

Theta = 1/2 on a linear bulk closes the ledger exactly: what is left is a sum of roundings, at most
linear in the number of steps. Central differences keep a shadow energy, which the ledger holds.
"""

from __future__ import annotations

import numpy as np
import pytest
from scenes import LEFT, box_bodies

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

LENGTH, CELLS, SPEED, STEPS = 4.0, 4, 10.0, 20_000


def closures(scheme, steps) -> tuple[np.ndarray, float, float]:
    """Closure error over the energy at each step, first and last energies' ratio, amplitude."""
    scene = Scene(
        box_bodies((LENGTH, 1), (CELLS, 1), "quadrilateral", 0),
        {1: LinearElastic(100.0, 0.0, 1.0)},
        loads=[PrescribedVelocity(LEFT, 0, 0.0)],
        initial_velocity=lambda x: np.stack([0.1 * np.sin(0.5 * np.pi * x[0] / LENGTH), 0 * x[0]]),
    )
    simulation = Simulation(scene, 0.5 * LENGTH / CELLS / SPEED, scheme=scheme)
    start = simulation.ledger.energies.kinetic
    found = np.array(
        [r.energies["closure"] for r in simulation.steps(steps * simulation.step_size)]
    )
    energies = simulation.ledger.energies
    return found / start, (energies.kinetic + energies.elastic) / start, start


@pytest.mark.slow
def test_implicit_bar(figure):
    """Rounding: at most 1e-16 a step, and ten times the steps make it grow ten times at most."""
    found, left, _ = closures("implicit", STEPS)
    size = np.abs(found)
    rate = size.max() / STEPS
    growth = size.max() / size[: STEPS // 10].max()
    figure("free bar, implicit, 2e4 steps", "closure / energy / steps < 1e-16", rate)
    figure("free bar, implicit, 2e3 to 2e4 steps", "growth of closure < 15", growth)
    figure("free bar, implicit, 2e4 steps", "energy error < 1e-11", abs(left - 1.0))
    assert rate < 1e-16
    assert growth < 15.0
    assert abs(left - 1.0) < 1e-11


@pytest.mark.slow
def test_explicit_bar(figure):
    """Rounding too, as the ledger holds the shadow energy; the physical energy swings by it."""
    found, left, _ = closures("explicit", STEPS)
    size = np.abs(found)
    rate = size.max() / STEPS
    growth = size.max() / size[: STEPS // 10].max()
    figure("free bar, explicit, 2e4 steps", "closure / energy / steps < 1e-16", rate)
    figure("free bar, explicit, 2e3 to 2e4 steps", "growth of closure < 15", growth)
    assert rate < 1e-16
    assert growth < 15.0
    # first mode: (h^2 / 8) v.K.v over the energy is (h omega)^2 / 4 at most
    step = 0.5 * LENGTH / CELLS / SPEED
    omega = 0.5 * np.pi / LENGTH * SPEED
    assert abs(left - 1.0) < 1.05 * 0.25 * (step * omega) ** 2
