# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors of chosen quantities, from a second run, beside errors against far finer runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest
from scenes import box_bodies

from xper_fx.forms.loads import Gravity, PrescribedDisplacement
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws.cohesive_zone import CohesiveZone
from xper_fx.nscd.rigid import Disc, RigidBody
from xper_fx.output.gauges import TensileGauge
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.path import GrowthControl
from xper_fx.simulation.simulation import Simulation
from xper_fx.study.error_estimates import estimate_errors
from xper_fx.study.quantities import DisplacementL2, EnergyClosure, PeakStress

LEFT, RIGHT = 1, 2


@dataclass(frozen=True)
class Spent:
    """Share of the fracture energy that is spent at a time: a quantity of a user's own."""

    time: float
    has_reference: ClassVar[bool] = True

    def observe(self, simulation, step, seen):
        """Linear between steps."""
        time, spent = step.time, step.energies["dissipated_cohesion"] / 5e-5
        if seen is None or time <= self.time:
            return time, spent
        if seen[0] >= self.time:
            return seen
        share = (self.time - seen[0]) / (time - seen[0])
        return self.time, seen[1] + share * (spent - seen[1])

    def value(self, simulation, seen):
        """At the time."""
        return seen[1]

    def error(self, value, reference):
        """Absolute."""
        return abs(value - reference)


PEAK = PeakStress(TensileGauge(LEFT, RIGHT, 0, 1.0, 1.0))
QUANTITIES = {"peak": PEAK, "spent": Spent(0.7)}


def bonded() -> Scene:
    """Two halves of a square held by a bond that is torn."""
    loads = [PrescribedDisplacement(LEFT, i, 0.0) for i in (0, 1)]
    loads.append(PrescribedDisplacement(RIGHT, 0, lambda t: 2e-2 * t**2))
    return Scene(
        box_bodies((1.0, 1.0), (2, 2), label=lambda x: x[0] > 0.5),
        {1: LinearElastic(1.0, 0.0, 1e-3)},
        default_interaction=CohesiveZone(20.0, 5e-5, 6e-3),
        loads=loads,
    )


@dataclass(frozen=True)
class Kinetic:
    """Kinetic energy at the end (J/m)."""

    has_reference: ClassVar[bool] = True

    def observe(self, simulation, step, seen):
        """The present one."""
        return step.energies["kinetic"]

    def value(self, simulation, seen):
        """The last."""
        return seen

    def error(self, value, reference):
        """Relative."""
        return abs(value / reference - 1.0)


def falling() -> Scene:
    """A disc in free fall."""
    disc = RigidBody(Disc(1.0), (0.0, 0.0), "disc", density=1.0)
    alone = [Contact(("disc", "disc"), None)]
    return Scene(rigid=[disc], contacts=alone, loads=[Gravity((0.0, -1.0))])


MOVED = DisplacementL2()


@pytest.fixture(scope="module")
def exact():
    """Of a run with 1000 steps."""
    simulation, seen = Simulation(bonded(), 1e-3, tolerance=1e-7), dict.fromkeys(QUANTITIES)
    for step in simulation.steps(1.0):
        seen = {k: q.observe(simulation, step, seen[k]) for k, q in QUANTITIES.items()}
    return {k: q.value(simulation, seen[k]) for k, q in QUANTITIES.items()}


# an explicit bulk has no longer step for 1e-2 than for a quarter of it: the second has half of it
@pytest.mark.parametrize("options", [{"step": 1e-2}, {"accuracy": 1e-2, "scheme": "explicit"}])
def test_errors_are_those_against_a_far_finer_run(exact, options):
    found = estimate_errors(bonded, 1.0, QUANTITIES, **options)
    for name, quantity in QUANTITIES.items():
        true = quantity.error(found[name].value, exact[name])
        assert true > 1e-3 and 0.5 * true < found[name].error < 2.0 * true, (name, true, found)
        assert quantity.error(found[name].finer, exact[name]) < 0.7 * true, name


def test_more_refinements_come_closer(exact):
    """Of an error of first order one gives 2/3, two give 4/5; of one of second order 1."""
    found = estimate_errors(bonded, 1.0, QUANTITIES, refinements=2, step=1e-2)
    for name, quantity in QUANTITIES.items():
        true = quantity.error(found[name].value, exact[name])
        assert 0.75 * true < found[name].error < 1.4 * true, (name, true, found)
        assert quantity.error(found[name].finer, exact[name]) < 0.4 * true, name


@dataclass(frozen=True)
class Turning:
    """A quantity that goes another way in the second run of a scene than in the others."""

    runs: list
    has_reference: ClassVar[bool] = True

    def observe(self, simulation, step, seen):
        """Nothing but the end counts."""

    def value(self, simulation, seen):
        """1, in the second run 2, in the third 1.1."""
        self.runs.append(simulation)
        return [1.0, 2.0, 1.1][len(self.runs) - 1]

    def error(self, value, reference):
        """Absolute."""
        return abs(value - reference)


@pytest.mark.parametrize(
    ("options", "runs", "error"),
    [
        ({"accuracy": 0.04}, 3, 0.1 * 16 / 15),  # far more than the run tells: a third decides
        ({"accuracy": 0.9}, 2, 4 / 3),
        ({"accuracy": 0.04, "refinements": 1}, 2, 4 / 3),
        ({}, 2, 4 / 3),  # a run that estimates nothing
    ],
)
def test_a_third_run_decides_where_two_disagree(options, runs, error):
    turning = Turning([])
    found = estimate_errors(bonded, 0.1, {"which way": turning}, step=0.02, **options)
    assert len(turning.runs) == runs
    assert found["which way"].error == pytest.approx(error, rel=1e-9)


def test_the_finer_run_has_the_scheme_that_was_picked(monkeypatch):
    """Cells that are each a body step explicitly where the step is picked, else implicitly."""

    def cells():
        pull = [PrescribedDisplacement(RIGHT, 0, lambda t: 2e-2 * t**2)]
        return Scene(
            box_bodies((1.0, 1.0), (2, 2)),
            {1: LinearElastic(1.0, 0.0, 1e-3)},
            default_interaction=CohesiveZone(20.0, 5e-5, 6e-3),
            loads=[PrescribedDisplacement(LEFT, i, 0.0) for i in (0, 1)] + pull,
        )

    taken, make = [], Simulation.__init__

    def noted(self, *arguments, **options):
        make(self, *arguments, **options)
        taken.append(self.options.scheme)

    monkeypatch.setattr(Simulation, "__init__", noted)
    estimate_errors(cells, 0.2, {"peak": PEAK}, accuracy=1e-2)
    assert len(taken) >= 2 and set(taken) == {"explicit"}


def test_rigid_bodies_have_no_scheme():
    """The energy of a free fall, exact with any step."""
    quantities = {"kinetic": Kinetic()}
    found = estimate_errors(falling, 1.0, quantities, step=0.1)["kinetic"]
    assert found.value == pytest.approx(0.5 * 3.141592653589793, rel=1e-12) and found.error < 1e-12


@pytest.mark.parametrize(
    ("error", "match", "change"),
    [
        (TypeError, "build .* 3", {"build": 3}),
        (TypeError, "quantities .* PeakStress", {"quantities": PEAK}),
        (ValueError, "'c' is an error by itself", {"quantities": {"c": EnergyClosure()}}),
        (ValueError, "end_time", {"end_time": -1.0}),
        (ValueError, "refinements", {"refinements": 0}),
        (ValueError, "accuracy=", {"step": "auto", "accuracy": None}),
        (ValueError, "accuracy", {"accuracy": 2.0}),
        (
            ValueError,
            "DisplacementL2 .* none",
            {"build": falling, "quantities": {"u": MOVED}, "step": 0.1},
        ),
        (ValueError, "path", {"path": GrowthControl(), "inertia": False, "step": 1.0}),
    ],
)
def test_bad_input_is_refused(error, match, change):
    """Before a run, or at its first step."""
    given = {"build": bonded, "end_time": 1.0, "quantities": QUANTITIES, "accuracy": 1e-2}
    with pytest.raises(error, match=match):
        estimate_errors(**(given | change))
