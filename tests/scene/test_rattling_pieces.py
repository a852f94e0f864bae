# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pieces that strike each other on and on: energies stay, and impulses converge."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import xper_fx as xf

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import rattling_plate  # noqa: E402


def run(scene, law, tolerance, steps, contact=None):
    """Make steps; energies after each over that of the start, by name."""
    contacts = [replace(c, law=contact) if c.law else c for c in scene.contacts]
    scene = replace(scene, default_interaction=law, contacts=contacts)
    simulation = rattling_plate.simulate(scene, tolerance)
    start, rows = simulation.ledger.energies.kinetic, []
    for _ in simulation.steps(steps * simulation.step_size):
        rows.append(simulation.ledger.as_columns())
    return {name: np.array([row[name] for row in rows]) / start for name in rows[0]}


@pytest.mark.parametrize(("friction", "restitution"), [(0.0, 1.0), (0.3, 0.5)])
def test_pieces_of_a_clamped_plate_rattle_without_gain(friction, restitution):
    """Wedged cells of a vertex creep in sweeps, and Newton steps lead to and fro: both converge."""
    law = replace(rattling_plate.bond(), friction=friction, restitution=restitution)
    found = run(rattling_plate.clamped(6), law, 1e-6, 500)
    assert len(found["closure"]) == 500  # no step was halved
    assert np.abs(found["closure"]).max() < 1e-14
    assert abs(found["dissipated_numerical"][-1]) < 1e-8
    assert found["dissipated_cohesion"][-1] > 0.1
    lost = sum(found[f"dissipated_{name}"] for name in ("cohesion", "impact", "friction"))
    assert np.diff(lost, prepend=0.0).min() > -1e-6
    assert (found["dissipated_friction"][-1] > 0.1) == (friction > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cells", "speed", "steps", "halved"), [(5, 0.03, 300, True), (3, 0.05, 100, False)]
)
def test_pieces_wedged_in_a_frame_converge(cells, speed, steps, halved):
    """Contacts and vertices take turns that creep where friction wedges pieces."""
    law = replace(rattling_plate.bond(), friction=0.3, restitution=0.5)
    lips = xf.laws.SignoriniCoulomb(0.3, restitution=0.5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rattling_plate, "LOOSE_SPEED", speed)
        found = run(rattling_plate.loose(cells), law, 1e-6, steps, lips)
    # with some compilers one is, and those after it stay as short
    assert halved or len(found["closure"]) <= 2 * steps
    assert np.abs(found["closure"]).max() < 1e-3
    assert found["dissipated_impact"][-1] > 0.1
