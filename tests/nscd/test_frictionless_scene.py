# SPDX-License-Identifier: LGPL-3.0-or-later
"""A frictionless elastic scene: one factorisation, normal components alone."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse.linalg
from dolfinx import fem
from scenes import BOTTOM, EXACT, TOP, box_bodies, run

from xper_fx.bulk import body_inverse as inverse
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.output.effects import effects_of
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

STEEL = LinearElastic(210e9, 0.3, 7800.0)
LENGTH, SPEED = 0.1, 1.0


def pressed(label, law, theta=0.5, cells=8):
    """A square whose bodies touch without friction, held below and pressed from above."""
    bodies = box_bodies((LENGTH, LENGTH), (cells, cells), label=label)
    loads = [PrescribedVelocity(BOTTOM, axis, 0.0) for axis in (0, 1)]
    loads += [PrescribedVelocity(TOP, 0, 0.2 * SPEED), PrescribedVelocity(TOP, 1, -SPEED)]
    scene = Scene(bodies, {1: STEEL}, default_interaction=law, loads=loads)
    return Simulation(scene, 2e-6, theta=theta, **EXACT)


def halves(x):
    """Two plates, one on the other."""
    return x[1] > LENGTH / 2


@pytest.mark.parametrize("label", [None, halves], ids=["each cell", "halves"])
def test_one_factorisation_serves_all_steps(monkeypatch, label):
    counts = dict.fromkeys(("factor", "inv", "splu", "assembled"), 0)

    def counted(owner, name, key):
        original = getattr(owner, name)

        def call(*args, **kwargs):
            counts[key] += 1
            return original(*args, **kwargs)

        monkeypatch.setattr(owner, name, call)

    counted(inverse.CellwiseInverse, "factor", "factor")
    counted(inverse.ClusterInverse, "factor", "factor")
    counted(np.linalg, "inv", "inv")
    counted(scipy.sparse.linalg, "splu", "splu")
    simulation = pressed(
        label, SignoriniCoulomb(contact="position"), cells=4 if label is None else 8
    )
    for name in ("assemble_matrix", "assemble_vector", "assemble_scalar"):
        counted(fem, name, "assembled")
    records = run(simulation, 100)
    assert len(records) == 100 and records[-1].energies["elastic"] > 0.0
    assert counts["factor"] == 1 and counts["assembled"] == 0
    assert (counts["inv"], counts["splu"]) == ((1, 0) if label is None else (0, 2))


@pytest.mark.parametrize("theta", [0.5, 0.75, 1.0])
def test_the_step_satisfies_its_equations(theta):
    """M dv = h [theta F1 + (1 - theta) F0] + H r + reactions, and the ledger closes."""
    simulation = pressed(halves, SignoriniCoulomb(), theta)
    bulk, step = simulation.bulk, simulation.step_size
    for _ in range(30):
        before = simulation.state
        run(simulation, 1)
        after, last = simulation.state, simulation.last
        forces = theta * (bulk.stiffness.to_scipy() @ after.displacement)
        forces += (1.0 - theta) * (bulk.stiffness.to_scipy() @ before.displacement)
        inertia = bulk.mass * (after.velocity - before.velocity)
        left = inertia + step * forces - last.impulses - last.reactions
        size = np.abs(step * forces).max() + np.abs(inertia).max()
        assert np.abs(left).max() <= 1e-11 * size
        moved = after.displacement - before.displacement
        mean = theta * after.velocity + (1.0 - theta) * before.velocity
        np.testing.assert_allclose(moved, step * mean, rtol=0, atol=1e-13 * np.abs(moved).max())
        assert not last.reactions[~bulk.layout.prescribed].any()
    pushed = simulation.interactions.gather("impulse")
    assert np.count_nonzero(pushed[:, 0]) >= len(pushed) / 2 and not pushed[:, 1:].any()
    energies = simulation.ledger.energies
    assert energies.external_work > 0.0 and energies.dissipated_friction == 0.0
    assert abs(simulation.ledger.closure) <= 1e-11 * energies.external_work


def test_effects_that_are_off_hold_nothing():
    simulation = pressed(halves, SignoriniCoulomb())
    off = {e.name for e in effects_of(simulation) if not e.on and not e.memory}
    assert {"friction", "cohesion", "internal variables", "external forces"} <= off
    (group,) = simulation.interactions.groups
    assert group.impulse.shape == group.jump.shape == (len(group), 1)
    assert simulation.interactions.points.frame.shape == (len(group), 1, 2)
    assert not simulation.interactions.gather("damage").any()
