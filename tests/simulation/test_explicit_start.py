# SPDX-License-Identifier: LGPL-3.0-or-later
"""A run that picks its scheme begins explicit and goes on implicit where long steps are enough."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies, field

import xper_fx as xf
from xper_fx.forms.loads import PrescribedVelocity, SurfaceTraction
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.scene import Scene
from xper_fx.simulation.simulation import Simulation

ELASTIC = {1: LinearElastic(1.0, 0.0, 1.0)}
# A wave takes 1 s from end to end of a bar; a load that is slow beside it.
END = 40.0


def pulled(speed=0.0, traction=lambda t: (1e-4 * np.sin(0.02 * t), 0.0), **options) -> Scene:
    """A bar that is held at its left, pulled at its right, and moves in its first mode."""
    return Scene(
        box_bodies((1.0, 0.2), (20, 4), label=0),
        ELASTIC,
        loads=[PrescribedVelocity(LEFT, 0, 0.0), SurfaceTraction(RIGHT, traction)],
        initial_velocity=lambda x: np.array([speed * np.sin(np.pi * x[0] / 2), 0.0 * x[0]]),
        **options,
    )


def test_waves_are_stepped_explicitly_and_a_slow_load_is_not():
    waves = Simulation(pulled(1e-3), accuracy=1e-4)
    steps = list(waves.steps(4.0))
    assert waves.options.scheme == "explicit"
    assert len(steps) == np.ceil(4.0 / waves.step_size - 1e-9)
    slow = Simulation(pulled(), accuracy=1e-2)
    sizes = [step.size for step in slow.steps(END)]
    assert slow.options.scheme == "implicit"
    count = sum(size == slow.step_size for size in sizes)
    # as long as eight implicit steps of 4 times the shortest, of 0.7 for 0.95 of the critical one
    assert 24 <= count < 60 and sizes[:count] == [slow.step_size] * count
    shortest = 0.7 / 0.95 * slow.step_size  # of the implicit bulk
    assert min(sizes[count : len(sizes) // 2]) == pytest.approx(2.0 * shortest, rel=1e-9)
    assert len(sizes) < 0.4 * END / slow.step_size


def test_explicit_waves_run_ahead_by_half_of_what_implicit_ones_lag():
    """And so it is told, within a factor of two."""
    told, fields = [], []
    for options in ({"step": 2e-3}, {"accuracy": 1e-3}):
        simulation = Simulation(pulled(1e-3, lambda t: (0.0, 0.0)), **options)
        for _ in simulation.steps(8.0):
            pass
        told.append(simulation.estimated_error)
        fields.append(field(simulation)[:, 0])
    assert simulation.options.scheme == "explicit"
    error = np.abs(fields[1] - fields[0]).max() / (1e-3 * 2.0 / np.pi)
    assert 0.5 * error < told[1] < 2.0 * error


def test_the_ledger_closes_over_the_change_and_keeps_its_columns():
    simulation = Simulation(pulled(), accuracy=1e-2)
    columns, given = [], 0.0
    for step in simulation.steps(END):
        columns.append(set(step.energies))
        given = max(given, step.energies["external_work"])
        assert abs(step.energies["closure"]) < 1e-10 * given
    assert simulation.options.scheme == "implicit" and step.energies["shadow"] == 0.0
    assert columns[0] == columns[-1]
    fine = Simulation(pulled(), 4e-3)
    for _ in fine.steps(END):
        pass
    error = np.abs(field(simulation) - field(fine)).max() / np.abs(field(fine)).max()
    assert error < 3e-2


def test_a_restarted_run_is_the_same():
    """To the bit, from before, at and after the change."""
    whole, saved, explicit = Simulation(pulled(), accuracy=1e-2), [], 0
    for step in whole.steps(END):
        explicit += step.size == whole.step_size
        if step.step < 80:
            saved.append(copy.deepcopy(whole.saved_in_order()))
    for place in (4, explicit, explicit + 1, 75):
        again = Simulation(pulled(), accuracy=1e-2)
        again.restore(saved[place - 1])
        assert again.model.begins_explicit == (place <= explicit)
        last = list(again.steps(END))[-1]
        assert again.step_number == whole.step_number and last.energies == step.energies
        np.testing.assert_array_equal(again.state.displacement, whole.state.displacement)
        assert again.estimated_error == whole.estimated_error


def test_no_impulse_of_a_load_is_lost_in_the_change():
    """The momentum changes by the impulses of load and supports in each step."""
    simulation = Simulation(pulled(), accuracy=1e-2)
    mass, time, momentum = simulation.bulk.mass[::2], 0.0, 0.0
    for step in simulation.steps(0.5 * END):
        now = float(mass @ simulation.state.velocity[::2])
        given = 0.2 * 1e-4 * (np.cos(0.02 * time) - np.cos(0.02 * step.time)) / 0.02
        supports = simulation.last.reactions[::2].sum()
        assert now - momentum - supports == pytest.approx(given, rel=1e-3)
        time, momentum = step.time, now
    assert simulation.options.scheme == "implicit"


@pytest.mark.parametrize("end_time", [0.2, END])
def test_another_scene_goes_on_from_either(end_time):
    """With an implicit bulk, and with one that begins explicit."""
    first = Simulation(pulled(), accuracy=1e-2)
    for _ in first.steps(end_time):
        pass
    for scheme in ("implicit", None):
        scene = replace(first.scene, after=first.snapshot())
        second = Simulation(scene, accuracy=1e-2, scheme=scheme)
        step = list(second.steps(end_time + 2.0))[-1]
        assert abs(step.energies["closure"]) < 1e-9 * abs(step.energies["external_work"])


@pytest.mark.parametrize(
    "options, of_scene",
    [
        ({"step": 1e-3, "tolerance": "auto"}, {}),
        ({"accuracy": 1e-2, "scheme": "implicit"}, {}),
        ({"accuracy": 1e-2, "theta": 0.6}, {}),
        ({"accuracy": 1e-2}, {"damping": xf.RayleighDamping(mass=1e-3)}),
    ],
)
def test_what_is_given_and_what_damps_stay_implicit(options, of_scene):
    simulation = Simulation(pulled(**of_scene), **options)
    assert simulation.options.scheme == "implicit" and not simulation.model.begins_explicit


def test_bonds_between_bodies_are_implicit():
    scene = Scene(
        box_bodies((2.0, 0.5), (8, 2), label=lambda x: x[0] > 1.0),
        ELASTIC,
        default_interaction=CohesiveZone(1e3, 1e-4, 1e-2),
        loads=[PrescribedVelocity(LEFT, 0, 0.0)],
    )
    assert not Simulation(scene, accuracy=1e-2).model.begins_explicit
