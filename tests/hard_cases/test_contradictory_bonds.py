# SPDX-License-Identifier: LGPL-3.0-or-later
"""Perfect bonds between driven nodes that start apart: no impulse can close them, and it is said.

Impulses then grow along what leaves all bodies where they are, so that an error relative to them
falls while nothing is solved: a run went on with impulses of 1e12 times those that it needs.
"""

from __future__ import annotations

import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import PerfectBond
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError


def driven(apart: float) -> Scene:
    """Cells joined by perfect bonds; copies of a driven node start at other speeds."""
    random = np.random.default_rng(2)

    def velocity(x):
        v = np.zeros((2, x.shape[1]))
        v[0] = apart * random.standard_normal(x.shape[1]) * (x[0] < 1e-9)
        return v

    return Scene(
        box_bodies((1.5, 1.5), (3, 3)),
        {1: LinearElastic(1.0, 0.3, 1.0)},
        default_interaction=PerfectBond(),
        loads=[PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 0.04)],
        initial_velocity=velocity,
    )


@pytest.mark.parametrize("solver", ["auto", "newton", "accelerated", "nlgs"])
def test_contradictory_bonds_are_refused(solver):
    """Some steps, then an error; impulses until then stay below 1e8 times all motion."""
    simulation = Simulation(
        driven(0.02), 0.03, tolerance=1e-4, solver=solver, max_sweeps=2000, max_halvings=2,
        num_threads=1,
    )  # fmt: skip
    with pytest.raises(ConvergenceError) as raised:
        for _ in simulation.steps(9.0):
            impulse = np.abs(simulation.interactions.gather("impulse")).max()
            assert impulse < 1e8
    if solver == "auto":
        assert "contradict" in str(raised.value) or "residual" in str(raised.value)


def test_bonds_that_agree_go_on():
    simulation = Simulation(driven(0.0), 0.03, tolerance=1e-4, num_threads=1)
    for step in simulation.steps(0.9):
        assert abs(step.energies["closure"]) < 1e-12
    assert np.abs(simulation.interactions.gather("impulse")).max() < 1.0
