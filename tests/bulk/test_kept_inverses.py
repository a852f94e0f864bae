# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inverses of the iteration matrix: what is made once for all step sizes, and what is not."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies

import xper_fx as xf
from xper_fx.bulk.body_inverse import CellwiseInverse

FLOWING = xf.materials.J2SmallStrain(1.0, 0.3, 1e-3, xf.materials.Linear(0.05), 1.0)


def run(count_factors, damping=None, **options) -> xf.Simulation:
    """A plate that is pulled; factorisations are counted."""
    scene = xf.Scene(
        box_bodies((1.0, 1.0), (2, 2), label=0),
        {1: FLOWING},
        loads=[
            xf.PrescribedDisplacement(RIGHT, 0, lambda t: 5e-3 * t),
            *(xf.PrescribedDisplacement(LEFT, i, 0.0) for i in (0, 1)),
        ],
        damping=damping,
    )
    simulation = xf.Simulation(scene, theta=1.0, **options)
    count_factors(simulation)
    return simulation


@pytest.fixture
def factors(monkeypatch):
    """How many matrices were factored."""
    made = []

    def count(simulation) -> None:
        kept = simulation.model.scheme._inverses
        factor = kept._factor
        monkeypatch.setattr(kept, "_factor", lambda *a: (made.append(1), factor(*a)))

    count.made = made
    return count


def test_a_static_matrix_of_one_step_size_serves_all(factors):
    """Elastic steps of three sizes, one factorisation: the same states as with fresh ones."""
    simulation = run(factors, inertia=False, step=0.01)
    displacement = simulation.state.displacement
    inverses = simulation.model.scheme._inverses
    residual = np.random.default_rng(0).normal(size=len(displacement))
    first = inverses.at(0.01, displacement).advance(residual)
    for step in (0.02, 0.005):
        other = inverses.at(step, displacement).advance(residual)
        np.testing.assert_allclose(other, first * (0.01 / step) ** 2, rtol=1e-12)
    assert len(factors.made) == 1
    fresh = run(factors, inertia=False, step=0.02).model.scheme._inverses.at(0.02, displacement)
    scaled = inverses.at(0.02, displacement).advance(residual)
    np.testing.assert_allclose(fresh.advance(residual), scaled, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("inertia, damping", [(True, None), (False, xf.RayleighDamping(0.0, 1e-3))])
def test_inertia_and_damping_have_a_matrix_for_each_step_size(factors, inertia, damping):
    simulation = run(factors, step=0.01, inertia=inertia, damping=damping)
    inverses, displacement = simulation.model.scheme._inverses, simulation.state.displacement
    for step in (0.01, 0.02, 0.005):
        inverses.at(step, displacement)
    assert len(factors.made) == 3


def test_newton_finds_each_increment_once(factors, monkeypatch):
    """What tells that it has not arrived is what it goes on with, if the tangent is the same."""
    found = []
    advance = CellwiseInverse.advance
    monkeypatch.setattr(CellwiseInverse, "advance", lambda *a: (found.append(1), advance(*a))[1])
    simulation = run(factors, step=0.05, inertia=False)
    records = list(simulation.steps(1.0))
    iterations = sum(record.newton_iterations for record in records)
    assert iterations > 3 * len(records) and len(factors.made) > 2
    # the first of a step, one that tells after each iteration, one for each new tangent
    assert len(found) == len(records) + iterations + len(factors.made) - 1
