# SPDX-License-Identifier: LGPL-3.0-or-later
"""What each material's cells weigh, hold and bear, where several materials stand side by side."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import box_bodies

from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import BodyForce, Gravity
from xper_fx.materials import J2SmallStrain, Linear, LinearElastic

MATERIALS = {1: (1.0, 0.2, 2.0), 2: (3.0, 0.4, 5.0)}  # Young's modulus, Poisson's ratio, density


def three_cells(of_materials, forces=()):
    """Cells of materials 1, 2 and 2 along x, each a body of 1 m^2."""
    bodies = box_bodies(
        (3.0, 1.0), (3, 1), "quadrilateral", label=lambda x: np.floor(x[0]),
        material={2: lambda x: x[0] > 1.0},
    )  # fmt: skip
    return BulkForms(bodies, 1, of_materials, forces)


def elastic():
    return {
        tag: LinearElastic(young, poisson, density)
        for tag, (young, poisson, density) in MATERIALS.items()
    }


def plastic(yield_stress):
    return {
        tag: J2SmallStrain(
            young=young, poisson=poisson, yield_stress=yield_stress, hardening=Linear(0.1),
            density=density,
        )
        for tag, (young, poisson, density) in MATERIALS.items()
    }  # fmt: skip


@pytest.mark.parametrize("make", [elastic, lambda: plastic(1.0)])
def test_each_cell_has_its_own_weight(make):
    """Gravity acts on rho V of each cell, a body force on V alone: sums and first moments."""
    for force, densities in ((Gravity, [2.0, 5.0, 5.0]), (BodyForce, [1.0, 1.0, 1.0])):
        forms = three_cells(make(), [force((0.5, -3.0))])
        x = forms.V.tabulate_dof_coordinates()[:, 0]
        loads = forms.assemble_external(0.0).reshape(-1, 2)
        assert loads.sum(axis=0) == pytest.approx(np.sum(densities) * np.array([0.5, -3.0]))
        moment = np.dot(densities, [0.5, 1.5, 2.5])
        assert x @ loads == pytest.approx(moment * np.array([0.5, -3.0]))


def test_each_cell_holds_the_energy_of_its_own_material():
    """Below yield plastic materials are elastic ones; beyond, each holds and loses its own."""
    expected = three_cells(elastic())
    x = expected.V.tabulate_dof_coordinates()[:, :2]
    gradient = np.array([[2e-3, 1e-3], [0.0, -5e-4]])
    u = (x @ gradient.T).ravel()
    forms = three_cells(plastic(1.0))
    forms.set_step(1.0)
    assert forms.assemble_energy(u) == pytest.approx(expected.assemble_energy(u), rel=1e-12)
    np.testing.assert_allclose(
        forms.assemble_internal(u), expected.assemble_internal(u), atol=1e-12
    )
    assert forms.assemble_dissipation(u)["plastic"] == 0.0
    # a scene of both is the sum of scenes in which the others are far from yield
    both = plastic(1e-3)
    whole, parts, lost = three_cells(both), 0.0, 0.0
    whole.set_step(1.0)
    for tag in MATERIALS:
        alone = three_cells({t: both[t] if t == tag else plastic(1e3)[t] for t in MATERIALS})
        alone.set_step(1.0)
        parts += alone.assemble_energy(u) - expected.assemble_energy(u)
        lost += alone.assemble_dissipation(u)["plastic"]
    assert whole.assemble_energy(u) - expected.assemble_energy(u) == pytest.approx(parts, rel=1e-9)
    assert parts < -1e-3 * expected.assemble_energy(u)
    assert whole.assemble_dissipation(u)["plastic"] == pytest.approx(lost, rel=1e-12)
    assert lost > 0.0
