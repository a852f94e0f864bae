# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static loads that snap, in elastic and ductile bodies: the states beyond are found."""

import logging

import numpy as np
import pytest
from scenes import BOTTOM, TOP

import xper_fx as xf
from xper_fx.bodies.explode import EACH_CELL
from xper_fx.materials.hardening import Linear
from xper_fx.nscd.laws import CohesiveZone

YOUNG, YIELD, SIDE = 210e9, 400e6, 1e-3
DUCTILE = 0.3, YIELD, Linear(1e9), 7800.0
MATERIALS = {
    "elastic": xf.materials.LinearElastic(YOUNG, 0.3, 7800.0),
    "ductile": xf.materials.J2SmallStrain(YOUNG, *DUCTILE),
    "finite strain": xf.materials.J2FiniteStrain(YOUNG, *DUCTILE),
}


def square(material, share, count, moved, friction=0.0, halves=False):
    """A clamped square of crossed triangles whose upper side is moved (m), in a second.

    Bonds have a share of the yield stress and a cohesive length of one facet. With `halves` there
    are two bodies, else each triangle is one.
    """
    size = SIDE / count
    mesh = xf.crossed_rectangle((0, 0), (SIDE, SIDE), (count, count))
    sides = {BOTTOM: lambda x: x[1] < 1e-9, TOP: lambda x: x[1] > SIDE - 1e-9}
    upper = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.5 * SIDE
    labels = upper.astype(int) if halves else EACH_CELL
    strength = share * YIELD
    energy = size * strength**2 / YOUNG
    bond = CohesiveZone(50.0 * YOUNG / size, energy, strength, friction=friction)
    loads = [xf.PrescribedDisplacement(BOTTOM, i, 0.0) for i in range(2)]
    loads += [xf.PrescribedDisplacement(TOP, i, load) for i, load in enumerate(moved)]
    bodies = xf.explode(mesh, labels, facet_tags=xf.tag_facets(mesh, sides))
    scene = xf.Scene(bodies, {1: MATERIALS[material]}, default_interaction=bond, loads=loads)
    return scene, energy


def reactions(simulation, steps):
    """Those of the upper side in each step (N per metre of depth)."""
    return np.array([simulation.reaction(TOP) for _ in simulation.steps(0.05 * steps)])


@pytest.mark.parametrize("material", MATERIALS)
def test_halves_that_are_pulled_apart(material):
    """No force is left, but what positions are rounded by, and all of w is spent.

    The bodies stay elastic; no step is cut.
    """
    scene, energy = square(material, 0.5, 4, (0.0, lambda t: 1e-5 * t), halves=True)
    simulation = xf.Simulation(scene, 0.05, inertia=False, max_halvings=0)
    pulled = reactions(simulation, 4)[:, 1]
    np.testing.assert_allclose(pulled[0], 122595.0, rtol=2e-3)
    assert np.abs(pulled[1:]).max() < 1e-9 * pulled[0]
    energies = simulation.ledger.energies
    np.testing.assert_allclose(energies.dissipated_cohesion, energy * SIDE, rtol=1e-9)


@pytest.mark.parametrize(
    "material, share, friction, largest",
    [("elastic", 0.95, 0.0, (84710.3, 484871.0)), ("ductile", 0.5, 0.3, (70736.6, 456714.0))],
)
def test_cells_that_are_pressed_and_sheared_until_they_part(
    material, share, friction, largest, caplog
):
    """Steps are cut as far as states follow each other; there the load snaps, which is told.

    Loose triangles bear no force then, whatever moves on.
    """
    moved = (lambda t: 2e-5 * max(t - 0.2, 0.0), lambda t: -2e-6 * min(t / 0.2, 1.0))
    scene, _ = square(material, share, 4, moved, friction)
    simulation = xf.Simulation(scene, 0.05, inertia=False)
    with caplog.at_level(logging.WARNING):
        borne = reactions(simulation, 20)
    assert any("the load snaps" in record.getMessage() for record in caplog.records)
    np.testing.assert_allclose(np.abs(borne).max(axis=0), largest, rtol=1e-4)
    assert np.abs(borne[-1]).max() < 1e-8 * largest[1]
    energies = simulation.ledger.energies
    assert energies.dissipated_numerical > 0.5 * energies.dissipated_cohesion
    exact = 1e-8 if material == "elastic" else 1e-2  # of second order in steps with flow
    assert abs(simulation.ledger.closure) < exact * energies.external_work
