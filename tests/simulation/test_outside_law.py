# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels from outside the package beside the curve of the catalogue that they spell out."""

from __future__ import annotations

import numpy as np
import pytest
from outside_law import LinearSoftening
from scenes import LEFT, RIGHT, box_bodies, field

import xper_fx as xf

STIFFNESS, STRENGTH, ENERGY = 10.0, 1e-2, 1e-4
OUTSIDE = LinearSoftening(STIFFNESS, STRENGTH, ENERGY)
CATALOGUE = xf.laws.CohesiveZone(STIFFNESS, ENERGY, STRENGTH, curve=xf.laws.curves.Linear())


def pulled_apart(law, dim, **options):
    """Cells that are pulled until a quarter of their bonds is broken."""
    kind, cells = ("crossed", (3, 2)) if dim == 2 else ("tetrahedron", (2, 1, 1))
    loads = [xf.PrescribedVelocity(LEFT, 0, -0.05), xf.PrescribedVelocity(RIGHT, 0, 0.05)]
    scene = xf.Scene(
        box_bodies((1.5, 1.0, 1.0)[:dim], cells, kind),
        {1: xf.materials.LinearElastic(1.0, 0.3, 1.0)}, default_interaction=law, loads=loads,
    )  # fmt: skip
    simulation = xf.Simulation(scene, tolerance=1e-12, num_threads=1, **options)
    return simulation, len(list(simulation.steps(2.0)))


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("solver", ["explicit", "nlgs", "accelerated", "newton", "monolithic"])
def test_every_solver_finds_what_the_catalogues_law_finds(dim, solver):
    given = {"scheme": "explicit"} if solver == "explicit" else {"step": 0.1, "solver": solver}
    (own, steps), (known, same) = (pulled_apart(law, dim, **given) for law in (OUTSIDE, CATALOGUE))
    assert steps == same
    damage = known.interactions.gather("damage")
    assert 0.2 < np.mean(damage == 0.0) < 0.5 and np.any((0.0 < damage) & (damage < 1.0))
    np.testing.assert_allclose(own.interactions.gather("damage"), damage, atol=1e-11)
    np.testing.assert_allclose(field(own), field(known), atol=1e-11)
    spent = known.ledger.energies.dissipated_cohesion
    assert own.ledger.energies.dissipated_cohesion == pytest.approx(spent, rel=1e-11)
