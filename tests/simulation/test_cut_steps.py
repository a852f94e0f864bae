# SPDX-License-Identifier: LGPL-3.0-or-later
"""Explicit steps that are cut now and then: their energy, their sizes, a run that is taken up."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import box_bodies

import xper_fx as xf
from xper_fx.nscd.solvers.vertex_blocks import VertexBlocks

FIRM = xf.laws.CohesiveZone(1e2, fracture_energy=1e3, strength=1e2)


def shaken(accuracy=None):
    """A bonded square whose cells move at random, at a step near the critical one."""
    bodies = box_bodies((1.0, 1.0), (4, 4))
    random = np.random.default_rng(3)
    scene = xf.Scene(
        bodies, {1: xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)},
        default_interaction=FIRM,
        initial_velocity=lambda x: 1e-3 * random.standard_normal((2, x.shape[1])),
    )  # fmt: skip
    if accuracy is not None:
        return xf.Simulation(scene, scheme="explicit", num_threads=1, accuracy=accuracy)
    critical = xf.Simulation(scene, scheme="explicit").bulk.critical_step()
    return xf.Simulation(scene, 0.95 * critical, scheme="explicit", num_threads=1, tolerance=1e-10)


def fails(monkeypatch, every, size):
    """Let each so manieth solution of a step of a size fail."""
    solve, count = VertexBlocks.solve, [0]

    def failing(self, interactions, *arguments):
        report = solve(self, interactions, *arguments)
        if interactions.step_size < 0.99 * size:
            return report
        count[0] += 1
        return report._replace(converged=count[0] % every != 0)

    monkeypatch.setattr(VertexBlocks, "solve", failing)


@pytest.mark.parametrize("accuracy", [None, 0.5])
def test_a_run_whose_steps_are_cut_now_and_then_gains_little_energy(monkeypatch, accuracy):
    """A quarter of the start's; with whole steps between, bonds turned by 15 degrees in 160."""
    simulation = shaken(accuracy)
    start, h = simulation.ledger.energies.kinetic, simulation.step_size
    fails(monkeypatch, 9, h)
    sizes = np.diff([0.0] + [step.time for step in simulation.steps(1500 * h)])
    halves = np.count_nonzero(sizes < 0.75 * h)
    assert halves > 1000
    e = simulation.ledger.energies
    assert abs(simulation.ledger.closure) < 1e-12 * start
    assert e.dissipated_numerical > -0.3 * start
    assert e.kinetic + e.elastic < 2.0 * start


def test_steps_after_a_cut_begin_in_halves(monkeypatch):
    simulation = shaken()
    h = simulation.step_size
    fails(monkeypatch, 9, h)
    times = [0.0] + [step.time for step in simulation.steps(200 * h)]
    sizes = np.diff(times) / h
    assert sizes[:8] == pytest.approx(1.0)
    assert sizes[8:210] == pytest.approx(0.5)
    assert sizes[210:218] == pytest.approx(1.0)
    assert times[-1] == pytest.approx(200 * h)


def test_a_run_that_is_taken_up_is_as_cautious(monkeypatch):
    whole, again = shaken(), shaken()
    h = whole.step_size
    fails(monkeypatch, 9, h)
    list(whole.steps(50 * h))
    again.restore(whole.saved_in_order())
    sizes = [
        np.diff([simulation.time] + [step.time for step in simulation.steps(150 * h)])
        for simulation in (whole, again)
    ]
    assert np.array_equal(*sizes)
    assert sizes[0][0] == pytest.approx(0.5 * h)
    assert np.array_equal(whole.state.velocity, again.state.velocity)
