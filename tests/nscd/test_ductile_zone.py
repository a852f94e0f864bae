# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strength and energy of a ductile bond from its triaxiality, against the equations integrated."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from point_mass import PointMass
from scenes import box_bodies
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import xper_fx as xf

C_N, YIELD, THICKNESS = 1e16, 450e6, 50e-6
Q1, JOINING, FINAL = 1.5, 0.15, 0.25


def ductile(porosity=2e-3, triaxiality=2.0, **options):
    options = {"yield_stress": YIELD, "thickness": THICKNESS} | options
    return xf.laws.DuctileZone(C_N, porosity=porosity, triaxiality=triaxiality, **options)


def effective(f):
    return f if f < JOINING else JOINING + (1 / Q1 - JOINING) / (FINAL - JOINING) * (f - JOINING)


def surface(mean, equivalent, f):
    """Gurson's function of stresses over the yield stress."""
    x = Q1 * effective(f)
    return equivalent**2 + 2 * x * np.cosh(1.5 * mean) - 1 - x * x


def drawn(porosity, triaxiality):
    """Traction at the start and work of the layer, by an integrator; the flow by differences."""

    def stress(f):
        root = brentq(lambda s: surface(triaxiality * s, s, f), 0.0, 1.0, xtol=1e-15)
        return triaxiality * root, root

    def rates(f, y):
        mean, equivalent = stress(f)
        d = 1e-6
        volume = (surface(mean + d, equivalent, f) - surface(mean - d, equivalent, f)) / (2 * d)
        shape = (surface(mean, equivalent + d, f) - surface(mean, equivalent - d, f)) / (2 * d)
        strain = (shape + volume / 3) / ((1 - f) * volume)
        return [strain, (mean + 2 / 3 * equivalent) * np.exp(y[0]) * strain]

    y = np.zeros(2)
    for ends in ((porosity, JOINING), (JOINING, FINAL - 1e-9)):
        y = solve_ivp(rates, ends, y, "LSODA", rtol=1e-8, atol=1e-10).y[:, -1]
    mean, equivalent = stress(porosity)
    return mean + 2 / 3 * equivalent, y[1]


@pytest.mark.parametrize("porosity", [2e-3, 5e-2])
@pytest.mark.parametrize("triaxiality", [1 / 3, 1.0, 3.0])
def test_strength_and_energy_are_those_of_the_layer(porosity, triaxiality):
    law = ductile(porosity, triaxiality)
    traction, work = drawn(porosity, triaxiality)
    assert law.strength == pytest.approx(traction * YIELD, rel=1e-9)
    assert law.fracture_energy == pytest.approx(work * YIELD * THICKNESS, rel=2e-6)


def test_a_larger_triaxiality_is_stronger_and_more_brittle():
    laws = [ductile(triaxiality=h) for h in (1 / 3, 1.0, 2.0, 3.0)]
    assert np.all(np.diff([law.strength for law in laws]) > 0.2 * YIELD)
    assert np.all(np.diff([law.fracture_energy for law in laws]) < 0.0)
    assert laws[0].strength == pytest.approx(YIELD, rel=5e-3)  # uniaxial tension


def test_it_spends_its_energy():
    law = ductile(viscosity=0.1)
    spent = law.fracture_energy
    bond = PointMass(law, 10.0 * spent, [0.8, 0.6], theta=0.5)
    total = np.zeros(6)
    while bond.damage > 0.0:
        total += bond.step(spent / law.strength / 20.0)
    assert total[1] == pytest.approx(spent, rel=1e-9)
    assert total[5] > 1e-3 * spent


@pytest.mark.slow
def test_the_triaxiality_is_a_field():
    bodies = box_bodies((1, 1), (3, 2))
    x = bodies.facet_nodes(1).reshape(-1, 2).T
    field = fem.Function(fem.functionspace(bodies.mesh, ("Lagrange", 1)))
    field.interpolate(lambda x: 1.0 + x[0])
    elastic = xf.materials.LinearElastic(200e9, 0.3, 7800.0)
    for triaxiality in (lambda x: 1.0 + x[0], field):
        scene = xf.Scene(bodies, {1: elastic}, default_interaction=ductile(triaxiality=triaxiality))
        interactions = xf.Simulation(scene, 1e-9).interactions
        (law,), (group,) = interactions.laws, interactions.groups
        wanted = [ductile(triaxiality=h).strength for h in 1.0 + x[0]]
        np.testing.assert_allclose(law.strength, wanted, rtol=1e-12)
        np.testing.assert_allclose(C_N * group.parameters[:, 3], np.take(wanted, group.indices))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"porosity": 0.2}, "porosity should be below 0.15, at which voids join, got 0.2"),
        ({"porosity": 0.0}, r"porosity should be a number in \(0, 1\]"),
        ({"triaxiality": -1.0}, "triaxiality should be a finite number above zero"),
        ({"triaxiality": 50.0}, "triaxiality should be at most 10, got 50"),
        ({"thickness": 1e-12}, "energy at the peak"),
        ({"curve": xf.laws.curves.Tvergaard()}, "stiffness of its own"),
        ({"yield_stress": "soft"}, "yield_stress should be a number"),
    ],
)
def test_bad_numbers_are_refused(options, words):
    with pytest.raises((TypeError, ValueError), match=words):
        ductile(**options)
