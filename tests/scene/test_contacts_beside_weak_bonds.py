# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices of an explicit bulk whose bonds weaken take turns with contacts."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import box_bodies
from test_rigid_bodies_on_splitting import ELASTIC, LAW, PLATES, momentum_of, strikers

import xper_fx as xf
from xper_fx.nscd.kernel_calls import make_call
from xper_fx.nscd.solvers.auto import Automatic
from xper_fx.nscd.solvers.solver import Solver
from xper_fx.nscd.solvers.sweeps import prepare_sweep
from xper_fx.nscd.solvers.vertex_blocks import VertexBlocks
from xper_fx.nscd.touching import touching_clusters

TOLERANCE = 1e-9
in_both = pytest.mark.parametrize("dim", [2, 3])


class Watched(Solver):
    """A solver, and what the laws still ask for at all points once it has ended."""

    name = "auto"

    def __init__(self, solver):
        self._solver, self.left = solver, []

    def solve(self, interactions, velocity, options):
        report = self._solver.solve(interactions, velocity, options)
        if report.converged:
            kept = [g.impulse.copy() for g in interactions.groups]
            sweep = prepare_sweep(interactions, velocity.copy(), options)
            for number in range(len(sweep.calls)):
                make_call(sweep.calls, number)
            for g, impulse in zip(interactions.groups, kept, strict=True):
                g.impulse[:] = impulse
            changed, total = sweep.stats[:, :2].sum(axis=0)
            self.left.append((changed / total) ** 0.5 if total > 0.0 else 0.0)
        return report


def struck(dim, strength, energy=1e-6, **options):
    """A plate that a ball and a box strike, and whose pieces may strike each other."""
    kind, lengths, cells = PLATES[dim]
    scene = xf.Scene(
        box_bodies(lengths, cells, kind), {1: ELASTIC},
        default_interaction=xf.laws.CohesiveZone(300.0, energy, strength),
        rigid=strikers(dim, 0.3), surfaces={"plate": (1,)},
        contacts=[
            xf.Contact(pair, LAW)
            for pair in (("thrown", "plate"), ("plate", "plate"), ("thrown", "thrown"))
        ],
    )  # fmt: skip
    return xf.Simulation(scene, scheme="explicit", tolerance=TOLERANCE, num_threads=1, **options)


@in_both
def test_all_laws_hold_where_a_plate_breaks(dim):
    simulation = struck(dim, 5e-3)
    assert isinstance(simulation.solver, VertexBlocks)
    watched = simulation._attempts.solver = Watched(simulation.solver)
    before, held = momentum_of(simulation), simulation.ledger.energies.kinetic
    pushing = 0
    for _ in simulation.steps(0.5):
        pushing = max(pushing, sum(map(len, simulation.interactions.contacts)))
        assert abs(simulation.ledger.closure) < 1e-12 * held
    assert max(watched.left) < TOLERANCE
    assert momentum_of(simulation) == pytest.approx(before, abs=1e-12 * np.abs(before).max())
    e = simulation.ledger.energies
    assert pushing >= 20
    assert e.dissipated_cohesion > 1e-5
    assert e.dissipated_friction > 1e-3
    assert e.dissipated_impact > 1e-3


def test_a_run_whose_lips_have_parted_is_taken_up_to_the_bit():
    whole = struck(2, 5e-3)
    points = len(whole.interactions)
    while sum(map(len, whole.interactions.permanent)) == points:
        next(whole.steps(1.0))
    again = struck(2, 5e-3)
    again.restore(whole.saved_in_order())
    end = whole.time + 10 * whole.step_size
    for simulation in (whole, again):
        list(simulation.steps(end))
    assert sum(map(len, whole.interactions.permanent)) < points
    assert np.array_equal(whole.state.velocity, again.state.velocity)
    assert np.array_equal(whole.rigid.state.velocity, again.rigid.state.velocity)


def test_sweeps_take_the_place_of_turns_that_do_not_end(monkeypatch, caplog):
    """The run goes on with the same motion."""
    turned = struck(2, 5.0, 10.0)
    step = turned.step_size
    list(turned.steps(16 * step))
    monkeypatch.setattr(touching_clusters, "_TURNS", 1)
    swept = struck(2, 5.0, 10.0, step=step, max_halvings=0)
    list(swept.steps(16 * step))
    assert isinstance(swept.solver, Automatic)
    assert caplog.text.count("contacts and vertices do not agree") == 1
    assert turned.ledger.energies.dissipated_friction > 1e-3
    speed = np.abs(turned.state.velocity).max()
    assert swept.state.velocity == pytest.approx(turned.state.velocity, abs=1e-6 * speed)
    assert swept.rigid.state.velocity == pytest.approx(turned.rigid.state.velocity, abs=1e-7)


def test_a_run_in_which_sweeps_have_taken_that_place_is_taken_up_to_the_bit(monkeypatch):
    monkeypatch.setattr(touching_clusters, "_TURNS", 1)
    whole, again = (struck(2, 5e-3, max_halvings=0, forgiving=True) for _ in range(2))
    step, points = whole.step_size, len(whole.interactions)
    list(whole.steps(25 * step))
    assert sum(map(len, whole.interactions.permanent)) < points
    again.restore(whole.saved_in_order())
    for simulation in (whole, again):
        assert isinstance(simulation.solver, Automatic)
        list(simulation.steps(35 * step))
    assert np.array_equal(whole.state.velocity, again.state.velocity)
    assert np.array_equal(whole.rigid.state.velocity, again.rigid.state.velocity)


@pytest.mark.parametrize("size", [1e-6, 1e-9])
def test_a_small_disc_spins_fast_and_a_plate_breaks_as_a_large_one(size):
    """The same speeds in metres and below: spins of 1e10 rad/s are no speeds."""

    def motion(size):
        disc = xf.RigidBody(
            xf.rigid.Disc(0.2 * size), (0.53 * size, 0.701 * size), "disc", density=3.0,
            velocity=(0.06, -0.2), spin=1.0 / size,
        )  # fmt: skip
        scene = xf.Scene(
            box_bodies((2.0 * size, 0.5 * size), (8, 2)), {1: ELASTIC},
            default_interaction=xf.laws.CohesiveZone(300.0 / size, 1e-6 * size, 5e-3, friction=0.3),
            rigid=[disc], surfaces={"plate": (1,)},
            contacts=[xf.Contact((name, "plate"), LAW) for name in ("disc", "plate")],
        )  # fmt: skip
        options = {"scheme": "explicit", "tolerance": TOLERANCE, "num_threads": 1}
        simulation = xf.Simulation(scene, **options)
        list(simulation.steps(16 * simulation.step_size))
        assert simulation.interactions.gather("damage").min() == 0.0
        return simulation.state.velocity

    assert motion(size) == pytest.approx(motion(1.0), abs=1e-8)
