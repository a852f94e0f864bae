# SPDX-License-Identifier: LGPL-3.0-or-later
"""States of other equations are refused before anything is done; those of other solvers go on."""

import numpy as np
import pytest
from scenes import BOTTOM, TOP, box_bodies

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import J2FiniteStrain, J2SmallStrain, LinearElastic, NeoHookean
from xper_fx.materials.hardening import Linear
from xper_fx.nscd.laws import PerfectBond
from xper_fx.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import CheckpointError

ELASTIC, PLASTIC = (100.0, 0.3, 1.0), (100.0, 0.3, 2.0, Linear(1.0), 1.0)
NEO, SMALL = NeoHookean(*ELASTIC), LinearElastic(*ELASTIC)
J2, J2_SMALL = J2FiniteStrain(*PLASTIC), J2SmallStrain(*PLASTIC)


def pulled(material=NEO, scheme="implicit", cells=2, order=1, step=0.005, **options):
    """Cells that are joined, pulled at a speed."""
    scene = Scene(
        box_bodies((1, 1), (cells, cells)),
        {1: material},
        order=order,
        default_interaction=PerfectBond(),
        loads=[
            PrescribedVelocity(BOTTOM, 0, 0.0),
            PrescribedVelocity(BOTTOM, 1, 0.0),
            PrescribedVelocity(TOP, 1, 0.1),
        ],
    )
    return Simulation(scene, step, scheme=scheme, num_threads=1, **options)


def after_two_steps(**options):
    simulation = pulled(**options)
    steps = simulation.steps(0.1)
    next(steps), next(steps)
    return simulation


@pytest.mark.parametrize(
    "then, now, told",
    [
        ({"scheme": "explicit"}, {}, "scheme='explicit'.*scheme='implicit'"),
        ({}, {"scheme": "explicit"}, "scheme='implicit'.*scheme='explicit'"),
        ({"material": J2}, {"material": J2, "scheme": "explicit"}, "scheme='explicit'"),
        ({}, {"theta": 0.6}, "theta=0.5.*theta=0.6"),
        ({"theta": 1.0}, {"inertia": False, "theta": 1.0}, "inertia=True.*inertia=False"),
        ({"scheme": "explicit"}, {"scheme": "explicit", "material": SMALL}, "LinearElastic"),
        ({"material": J2_SMALL}, {"material": J2}, "J2SmallStrain.*J2FiniteStrain"),
        ({}, {"cells": 3}, "16 cells of order 1.*36 cells"),
        ({}, {"order": 2}, "order 1 .*order 2"),
    ],
)
def test_a_state_of_other_equations_is_refused(then, now, told):
    saved = after_two_steps(**then).saved_in_order()
    simulation = pulled(**now)
    before = simulation.saved_in_order()
    with pytest.raises(CheckpointError, match=told):
        simulation.restore(saved)
    np.testing.assert_equal(simulation.saved_in_order(), before)
    assert next(simulation.steps(0.1)).step == 1


@pytest.mark.parametrize("material", [NEO, J2])
@pytest.mark.parametrize("solvers", [("nlgs", "monolithic"), ("monolithic", "nlgs")])
def test_another_solver_goes_on(material, solvers):
    """What a solver keeps of a bulk that is not linear is no other's."""
    then, now = ({"material": material, "solver": s, "tolerance": 1e-9} for s in solvers)
    first, second = after_two_steps(**then), pulled(**now)
    second.restore(first.saved_in_order())
    for simulation in (first, second):
        assert next(simulation.steps(0.1)).step == 3
    scale = np.abs(first.state.velocity).max()
    np.testing.assert_allclose(second.state.velocity, first.state.velocity, atol=1e-6 * scale)


@pytest.mark.parametrize("same", [True, False])
def test_a_solver_takes_what_was_kept_of_the_same_visits_alone(same):
    """Those of other points, or in another order, find the same without what others kept."""
    saved = after_two_steps(scheme="explicit", material=SMALL).saved_in_order()
    if not same:
        saved["solvers"]["visits"] = saved["solvers"]["visits"] + 1
    simulation = pulled(scheme="explicit", material=SMALL)
    simulation.restore(saved)
    assert bool(simulation.solver.kept()) is same
    going_on = after_two_steps(scheme="explicit", material=SMALL)
    for one in (going_on, simulation):
        assert next(one.steps(0.1)).step == 3
    expected, found = going_on.state.velocity, simulation.state.velocity
    assert np.abs(found - expected).max() <= (0.0 if same else 1e-6) * np.abs(expected).max()
