# SPDX-License-Identifier: LGPL-3.0-or-later
"""The energy ledger: it closes, and no dissipation is negative at any step."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies, run

from xper_fx.forms.loads import (
    BodyForce,
    Gravity,
    PrescribedVelocity,
    RayleighDamping,
    SurfaceTraction,
)
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

MATRIX, INCLUSION = LinearElastic(100.0, 0.3, 1.0), LinearElastic(300.0, 0.2, 2.0)
LOSSES = ("cohesion", "friction", "impact", "viscous", "numerical")


def plate(theta, scheme="implicit", damping=RayleighDamping(0.5, 1e-3), tolerance=1e-8):
    """Five by five crossed squares with an inclusion, pulled apart until many bonds break."""
    scene = Scene(
        box_bodies((2, 2), (5, 5), material={2: lambda x: (np.abs(x[:2] - 1) < 0.5).all(axis=0)}),
        {1: MATRIX, 2: INCLUSION},
        {(2, 2): CohesiveZone(2000.0, 0.2, 20.0, friction=0.3)},
        default_interaction=CohesiveZone(1000.0, 0.05, 8.0, friction=0.3),
        loads=[
            PrescribedVelocity(BOTTOM, 1, lambda t: -2.0 * min(t / 0.02, 1.0)),
            PrescribedVelocity(TOP, 1, lambda t: 2.0 * min(t / 0.02, 1.0)),
            PrescribedVelocity(TOP, 0, 0.5),
            BodyForce((3.0, lambda t: 2.0 * np.cos(50.0 * t))),
            Gravity((0.0, -1.0)),
            SurfaceTraction(LEFT, (lambda t: 2.0 * np.sin(30.0 * t), 0.5)),
            SurfaceTraction(RIGHT, (0.5, 0.5)),
        ],
        damping=damping,
    )
    step = 4e-3 if scheme == "implicit" else None
    return Simulation(scene, step, scheme=scheme, theta=theta, tolerance=tolerance, num_threads=1)


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
def test_ledger_closes_while_bonds_break(theta):
    """Closure below 1e-10 of the external work, each loss >= 0 at every step.

    Closure is an identity here, whatever the tolerance; the signs are not.
    """
    simulation = plate(theta)
    records = run(simulation, 60)
    damage = simulation.interactions.gather("damage")
    assert np.count_nonzero(damage == 0.0) > 20
    work = max(abs(r.energies["external_work"]) for r in records)
    assert max(abs(r.energies["closure"]) for r in records) < 1e-10 * work
    for name in LOSSES:
        history = np.array([0.0] + [r.energies[f"dissipated_{name}"] for r in records])
        assert np.diff(history).min() >= -1e-8 * work, name
        if name in ("cohesion", "viscous", "friction"):
            assert history[-1] > 1e-4 * work, name
    numerical = records[-1].energies["dissipated_numerical"]
    assert numerical > 1e-3 * work if theta > 0.5 else abs(numerical) < 1e-8 * work
    assert all(r.energies["kinetic"] >= 0.0 and r.energies["elastic"] >= 0.0 for r in records)


@pytest.mark.parametrize("damping", [None, RayleighDamping(0.5, 1e-5)])
def test_ledger_of_the_explicit_bulk_closes(damping):
    """Closure to rounding, the shadow energy is -(h^2 / 8) v.K.v, and no loss is negative."""
    scene = plate(0.5, "explicit", damping).scene
    simulation = Simulation(scene, 1e-3, scheme="explicit", tolerance=1e-8, num_threads=1)
    start = simulation.state
    records = list(simulation.steps(0.2))
    energies = simulation.ledger.energies
    work = max(abs(r.energies["external_work"]) for r in records)
    assert max(abs(r.energies["closure"]) for r in records) < 1e-13 * work
    v = simulation.state.velocity
    shadow = -(1e-3**2) / 8.0 * float(v @ simulation.bulk.internal(v))
    assert energies.shadow == pytest.approx(shadow, rel=1e-9)
    assert shadow < -1e-5 * work and not start.velocity.any()
    assert np.count_nonzero(simulation.interactions.gather("damage") == 0.0) > 20
    for name in LOSSES:
        history = np.array([0.0] + [r.energies[f"dissipated_{name}"] for r in records])
        assert np.diff(history).min() >= -1e-7 * work, name


def test_a_change_of_an_explicit_step_is_booked():
    """What is conserved hangs on the step: its change is numerical, from motion at the start on."""
    scene = Scene(
        box_bodies((1, 1), (4, 4), label=0),
        {1: MATRIX},
        initial_velocity=lambda x: np.stack([np.sin(9.0 * x[1]), x[0] * x[1]]),
    )
    simulation = Simulation(scene, 2e-3, scheme="explicit")
    kinetic = simulation.ledger.energies.kinetic
    run(simulation, 7)
    v, before = simulation.state.velocity, simulation.ledger.energies.dissipated_numerical
    assert abs(before) < 1e-14 * kinetic
    simulation.step_size = 1e-3
    closures = [abs(r.energies["closure"]) for r in run(simulation, 8)]
    assert max(closures) < 1e-13 * kinetic
    booked = -(2e-3**2 - 1e-3**2) / 8.0 * float(v @ simulation.bulk.internal(v))
    numerical = simulation.ledger.energies.dissipated_numerical
    assert numerical == pytest.approx(booked, rel=1e-9)
    assert booked < -1e-5 * kinetic


def test_energies_are_those_of_a_known_motion():
    """A free body thrown under gravity, rigidly: kinetic, work, and nothing else."""
    scene = Scene(
        box_bodies((2, 1), (2, 1), label=0),
        {1: INCLUSION},
        loads=[Gravity((0.0, -9.81))],
        initial_velocity=lambda x: np.stack([3.0 + 0 * x[0], 4.0 + 0 * x[0]]),
    )
    simulation = Simulation(scene, 0.01)
    assert simulation.ledger.energies.kinetic == pytest.approx(0.5 * 4.0 * 25.0)
    energies = run(simulation, 50)[-1].energies
    height = 4.0 * 0.5 - 0.5 * 9.81 * 0.25
    assert energies["external_work"] == pytest.approx(-4.0 * 9.81 * height, rel=1e-12)
    assert energies["kinetic"] == pytest.approx(50.0 - 4.0 * 9.81 * height, rel=1e-12)
    assert energies["elastic"] == pytest.approx(0.0, abs=1e-12)
    assert abs(energies["closure"]) < 1e-11


def test_work_of_a_steady_pull_is_force_times_displacement():
    """theta = 1, to rest: external work of a velocity given on a face against its reaction."""
    scene = Scene(
        box_bodies((1, 1), (1, 1), "quadrilateral", 0),
        {1: LinearElastic(100.0, 0.0, 1.0)},
        loads=[PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 0.01)],
    )
    simulation = Simulation(scene, 0.01)
    work = 0.0
    for record in simulation.steps(0.5):
        mean = 0.005 if record.step == 1 else 0.01
        work += simulation.reaction(RIGHT)[0] * mean * record.size
    energies = record.energies
    assert energies["external_work"] == pytest.approx(work, rel=1e-12)
    stretched = 0.01 * (0.5 - 0.005)
    assert energies["elastic"] == pytest.approx(0.5 * 100.0 * stretched**2, rel=1e-12)
    assert -simulation.reaction(LEFT)[0] == pytest.approx(100.0 * (stretched - 0.5e-4), rel=1e-9)


def test_rayleigh_damping_decays_as_exp():
    """C = a M: a free body loses exp(-a t) of its velocity, its energy is found as viscous."""
    scene = Scene(
        box_bodies((1, 1), (1, 1), label=0),
        {1: MATRIX},
        damping=RayleighDamping(mass=2.0, stiffness=0.01),
        initial_velocity=lambda x: np.stack([1.0 + 0 * x[0], 0 * x[0]]),
    )
    simulation = Simulation(scene, 1e-3)
    energies = run(simulation, 500)[-1].energies
    assert simulation.state.velocity[::2] == pytest.approx(np.exp(-1.0), rel=1e-6)
    lost = 0.5 * (1.0 - np.exp(-2.0))
    assert energies["dissipated_viscous"] == pytest.approx(lost, rel=1e-6)


def test_neo_hookean_closure_is_of_second_order():
    """(f0 + f1)/2 . dq is the increment of energy to second order: closure falls with h^2."""
    errors = []
    for steps in (10, 20, 40):
        scene = Scene(
            box_bodies((1, 1), (1, 1), label=0),
            {1: NeoHookean(100.0, 0.3, 1.0)},
            loads=[PrescribedVelocity(BOTTOM, 1, 0.0)],
            initial_velocity=lambda x: np.stack([2.0 * x[1], 3.0 * x[1]]),
        )
        simulation = Simulation(scene, 0.1 / steps, newton_tolerance=1e-12)
        records = run(simulation, steps)
        errors.append(max(abs(r.energies["closure"]) for r in records))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.25)
    assert errors[-1] < 2e-3 * records[0].energies["kinetic"]
