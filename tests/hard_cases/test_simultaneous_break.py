# SPDX-License-Identifier: LGPL-3.0-or-later
"""Thousands of bonds that break in the same step: a whole interface, a whole plate."""

from __future__ import annotations

import numpy as np
import pytest
from energies import bulk_energy, missing_energy
from scenes import box_bodies, field, nodes, run

from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError

SCHEMES = [("implicit", "nlgs"), ("implicit", "newton"), ("implicit", "auto"), ("explicit", "auto")]
MATERIAL = LinearElastic(1e4, 0.3, 1.0)
# d0 = 1e-5, dc = 1.5e-4: far less than what the bodies part by in a step.
W, LAW = 1e-2, CohesiveZone(1e7, 1e-2, 100.0, friction=0.3)


def simulation_of(bodies, velocity, scheme, solver, step=1e-4, forgiving=True):
    scene = Scene(
        bodies,
        {tag: MATERIAL for tag in np.unique(bodies.material_of_cell).tolist()},
        default_interaction=LAW,
        initial_velocity=velocity,
    )
    options = {"tolerance": 1e-10, "num_threads": 1, "max_halvings": 0}
    return Simulation(scene, step, scheme=scheme, solver=solver, forgiving=forgiving, **options)


def mirrored(simulation, axis):
    """Largest difference of the velocities from their mirror image about the middle, by cells."""
    x, v = nodes(simulation), field(simulation, "velocity")
    cells = simulation.forms.V.dofmap.list
    middle = 0.5 * (x[:, axis].min() + x[:, axis].max())
    ends = []
    for sign in (1.0, -1.0):
        y, u = x.copy(), v.copy()
        y[:, axis] = middle + sign * (y[:, axis] - middle)
        u[:, axis] *= sign
        centre = np.repeat(y[cells].mean(axis=1), cells.shape[1], axis=0)
        keys = np.concatenate([centre, y[cells.ravel()]], axis=1)
        ends.append(u[cells.ravel()][np.lexsort(np.round(keys, 6).T)])
    return np.abs(ends[0] - ends[1]).max()


def energies_of_breaking(simulation, area, steps):
    """Steps until no bond is left; spent / w A - 1, and what momentum and energy miss."""
    start = bulk_energy(simulation)
    mass = simulation.bulk.mass.reshape(-1, 2)
    momentum = (mass * field(simulation, "velocity")).sum(axis=0)
    scale = (mass * np.abs(field(simulation, "velocity"))).sum()
    for count in range(1, steps + 1):  # noqa: B007 - returned
        run(simulation, 1)
        if not simulation.interactions.gather("damage").any():
            break
    assert not simulation.interactions.gather("damage").any()
    run(simulation, 3)
    moved = np.abs((mass * field(simulation, "velocity")).sum(axis=0) - momentum).max() / scale
    energies = simulation.ledger.energies
    spent = energies.dissipated_cohesion / (W * area) - 1.0
    return count, spent, moved, missing_energy(simulation, start) / start


@pytest.mark.slow
@pytest.mark.parametrize("scheme, solver", SCHEMES)
def test_an_interface(scheme, solver, figure):
    """Two strips, 800 bonds between them, thrown apart at 20 m/s."""
    upper = lambda x: x[1] > 1.0  # noqa: E731
    bodies = box_bodies((400, 2), (400, 2), "quadrilateral", upper, {2: upper})
    velocity = {
        tag: lambda x, v=v: np.stack([0.0 * x[0], v + 0.0 * x[0]])
        for tag, v in {1: -10.0, 2: 10.0}.items()
    }
    simulation = simulation_of(bodies, velocity, scheme, solver)
    assert len(simulation.interactions) == 800
    count, spent, moved, missing = energies_of_breaking(simulation, 400.0, 2)
    assert count == 1
    sides = mirrored(simulation, 0), mirrored(simulation, 1)
    case = f"800 bonds broken in a step, {scheme}, {solver}"
    figure(case, "|spent / w A - 1| < 1e-12", abs(spent))
    figure(case, "momentum missing < 1e-13", moved)
    figure(case, "energy missing < 1e-12", missing)
    figure(case, "asymmetry of velocities < 1e-9", max(sides) / 10.0)
    assert abs(spent) < 1e-12 and moved < 1e-13 and missing < 1e-12
    assert max(sides) < 1e-9 * 10.0


@pytest.mark.parametrize(
    "scheme, solver, step, allowed",
    [(*scheme, 1e-4, 5e-3) for scheme in SCHEMES] + [("explicit", "auto", 3e-5, 1e-9)],
)
def test_a_plate(scheme, solver, step, allowed, figure):
    """1024 bodies, 3008 bonds, torn all over by a uniform rate of stretch.

    With 1e-4 s, in which bonds open by 10 dc, 2e-3 w too little is spent: those broken first unload
    the others within the step, and damage does not come back (see test_stiff_bonds.py).
    """
    n = 16
    rate = lambda x: 4000.0 * np.stack([x[0] - 8.0, x[1] - 8.0])  # noqa: E731
    simulation = simulation_of(box_bodies((n, n), (n, n)), rate, scheme, solver, step)
    assert len(simulation.interactions) == 3008
    area = simulation.scene.bodies.facets.measure.sum()
    _, spent, moved, missing = energies_of_breaking(simulation, area, 60)
    asymmetry = max(mirrored(simulation, 0), mirrored(simulation, 1)) / (4000.0 * 8.0)
    case = f"plate of 3008 bonds torn, {scheme}, {solver}, {step:g} s"
    figure(case, f"1 - spent / w A < {allowed:g}", -spent)
    figure(case, "momentum missing < 1e-13", moved)
    figure(case, "asymmetry of velocities < 1e-9", asymmetry)
    assert -allowed < spent < 1e-9
    assert moved < 1e-13 and missing < 1e-12 and asymmetry < 1e-9


def test_bonds_that_break_for_nothing_stop_a_run(caplog):
    """Unless asked otherwise."""
    rate = lambda x: 4000.0 * np.stack([x[0] - 4.0, x[1] - 4.0])  # noqa: E731
    bodies = box_bodies((8, 8), (8, 8))
    with pytest.raises(ConvergenceError, match="broke bonds that stay closed, for no energy"):
        run(simulation_of(bodies, rate, "implicit", "nlgs", forgiving=False), 20)
    with caplog.at_level("WARNING", logger="xper_fx"):
        run(simulation_of(bodies, rate, "implicit", "nlgs"), 20)
    (told,) = (r.getMessage() for r in caplog.records)
    assert told.startswith("step 1 at h = 0.0001 s: bonds broke that stay closed")
