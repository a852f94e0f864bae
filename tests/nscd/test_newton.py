# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton's backtracking: increments that invert cells on the way."""

import numpy as np
import pytest

import xper_fx.bulk.implicit_step as implicit_step
from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle, tag_facets
from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import NeoHookean
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError


def stretched(stretch):
    """A unit square, one body, stretched and sheared in one step that may not be cut."""
    mesh = crossed_rectangle((0.0, 0.0), (1.0, 1.0), (4, 4))
    tags = tag_facets(mesh, {1: lambda x: x[1] < 1e-9, 2: lambda x: x[1] > 1 - 1e-9})
    scene = Scene(
        explode(mesh, np.zeros(64, int), facet_tags=tags),
        {1: NeoHookean(1e3, 0.3, 1e-3)},
        loads=[
            PrescribedVelocity(1, 0, 0.0),
            PrescribedVelocity(1, 1, 0.0),
            PrescribedVelocity(2, 0, 0.2),
            PrescribedVelocity(2, 1, stretch),
        ],
    )
    return Simulation(scene, 1.0, theta=1.0, max_halvings=0)


@pytest.mark.parametrize("stretch", [1.0, 3.0])
def test_backtracking_rescues_a_large_increment(stretch, monkeypatch):
    simulation = stretched(stretch)
    (step,) = simulation.steps(1.0)
    assert step.newton_residual <= 1e-8 and step.newton_iterations <= 20
    monkeypatch.setattr(implicit_step, "_CUTS", 0)
    with pytest.raises(ConvergenceError, match="Newton|internal forces"):
        list(stretched(stretch).steps(1.0))
