# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initially rigid bonds that bear more the faster they open."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass
from scipy.integrate import solve_ivp

import xper_fx as xf

curves = xf.laws.curves
# w (J/m^2), s (Pa), eta (Pa s/m), and an area
W, S, ETA, AREA = 100.0, 3e6, 2e5, 1e-2
DC = 2.0 * W / S
CURVES = (curves.Parabolic(), curves.Petersson(), curves.Trapezoidal(), curves.Exponential())


def law(**options):
    return xf.laws.RigidCohesiveZone(S, W, **{"viscosity": ETA} | options)


@pytest.mark.parametrize(
    "direction", [(1.0, 0.0), (0.6, -0.8), (0.0, 1.0), (0.48, 0.6, 0.64)], ids=repr
)
def test_a_mass_pulled_off_moves_as_its_equation_says(direction):
    """M x'' = f - A T(x) (1 + eta x' / s) from the moment at which f reaches A s."""
    direction, mass, rate = np.array(direction), 5e-3, 2e9
    start = S * AREA / rate

    def rates(t, y):
        overstress = ETA * y[1] / S
        traction = S * max(0.0, 1.0 - y[0] / DC)
        pull = AREA * traction * (1.0 + overstress)
        return y[1], (rate * t - pull) / mass, AREA * traction * overstress * y[1]

    def nearly_broken(t, y):
        return y[0] - 0.9 * DC

    nearly_broken.terminal = True
    exact = solve_ivp(
        rates, (start, 2.0 * start), [0.0, 0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-20,
        events=nearly_broken, dense_output=True,
    )  # fmt: skip
    duration = exact.t[-1] - start
    assert 0.5 < ETA * exact.y[1, -1] / S < 2.0  # the overstress counts
    errors = []
    for steps in (20, 40, 80):
        bond, h, total = PointMass(law(), mass, 0.0 * direction, area=AREA), duration / steps, 0.0
        for n in range(steps):
            energies = bond.step(h, rate * (start + (n + 0.5) * h) * direction)
            total += np.array(energies)
        found = bond.jump @ direction / DC, bond.velocity[0] @ direction, total[5]
        errors.append(np.abs(np.array(found) / (exact.y[:, -1] * [1.0 / DC, 1.0, 1.0]) - 1.0))
        assert abs(total[4]) < 1e-10 * W * AREA
    errors = np.array(errors)
    assert errors[-1].max() < 1e-3
    assert (errors[:-1] / errors[1:]).min() > 3.4


@pytest.mark.parametrize("theta", [0.5, 0.8, 1.0])
def test_traction_of_a_linear_curve_is_its_mean_and_the_overstress(theta):
    """Driven apart at v: T (1 + eta v / s) in every step, and W of the ledger is W."""
    h, v = DC / 60.0, 1.0
    bond = PointMass(law(), np.inf, [v, 0.0], area=AREA, theta=theta)
    total, x0 = np.zeros(6), 0.0
    while bond.damage > 0.0:
        total += bond.step(h)
        x1 = bond.jump[0]
        if bond.damage > 0.0:
            mean = S * (1.0 - 0.5 * (x0 + x1) / DC)
            moved = (x1 - x0) / h
            traction = -bond.impulse[0] / (h * AREA)
            assert traction == pytest.approx(mean * (1.0 + ETA * moved / S), rel=2e-7)
        x0 = x1
    assert total[1] == pytest.approx(W * AREA, rel=1e-12)
    assert total[5] == pytest.approx(ETA * v * 0.5 * DC * AREA, rel=0.02)
    assert abs(total[4]) < 1e-12 * W * AREA


@pytest.mark.parametrize("curve", CURVES, ids=repr)
def test_other_curves_drag_by_the_share_of_their_strength(curve):
    """Slowly driven apart, the work of viscosity is eta v / s of the fracture energy."""
    bond = PointMass(law(curve=curve), np.inf, [0.6, 0.0, 0.8], area=AREA)
    h = law(curve=curve).critical_opening / 500.0
    total = sum(np.array(bond.step(h)) for _ in range(505))
    assert bond.damage == 0.0
    assert total[1] == pytest.approx(W * AREA, rel=1e-12)
    assert total[5] == pytest.approx(ETA / S * W * AREA, rel=2e-3)


def test_it_starts_to_open_at_its_strength_whatever_the_viscosity():
    bond, force = PointMass(law(viscosity=1e3 * ETA), 2.0, [0.0, 0.0], area=AREA), S * AREA
    bond.step(1e-6, [0.6 * (1.0 - 1e-9) * force, 0.8 * (1.0 - 1e-9) * force])
    assert np.abs(bond.jump).max() < 1e-22
    energies = bond.step(1e-6, [0.6 * 1.1 * force, 0.8 * 1.1 * force])
    moved = bond.jump @ [0.6, 0.8]
    # 0.1 s moves a drag of eta and a mass, whose velocity at the end is twice the mean
    assert moved == pytest.approx(0.1 * force * 1e-6 / (1e3 * ETA * AREA + 4e6), rel=1e-4)
    assert energies[5] == pytest.approx(1e3 * ETA * AREA * moved**2 / 1e-6, rel=1e-4)


@pytest.mark.parametrize("steps", [0.2, 7.0, 200.0])
@pytest.mark.parametrize("curve", CURVES, ids=repr)
def test_a_bond_torn_by_inertia_closes_its_balance_at_any_step(curve, steps):
    bond = PointMass(law(curve=curve), 400.0 * W * AREA, [0.6, 0.8], area=AREA)
    before, total = bond.kinetic, np.zeros(6)
    while bond.damage > 0.0:
        energies = np.array(bond.step(W / S / steps))
        assert min(energies[1], energies[5]) >= 0.0
        total += energies
    assert total[1] == pytest.approx(W * AREA, rel=1e-12)
    assert 0.0 < total[5] < 3.0 * ETA / S * W * AREA
    assert before - bond.kinetic == pytest.approx(total[1] + total[5], rel=1e-10)


def test_lips_that_close_are_dragged_and_their_secant_pulls():
    """Unloading from 0.4 dc at v: secant's mean traction, less eta T(0.4 dc) / s v."""
    bond, h = PointMass(law(), np.inf, [0.0, 0.0], area=AREA), 1e-6
    for opening in (0.4 * DC, 0.1 * DC):
        rate = (opening - bond.jump[0]) / h
        bond.velocity[0, 0] = 2.0 * rate - bond.interactions.gather("velocity")[0, 0]
        energies = bond.step(h)
    secant = S * 0.6 * 0.5 * (0.4 + 0.1) / 0.4
    expected = secant + ETA * 0.6 * rate
    assert rate < 0.0
    assert -bond.impulse[0] / (h * AREA) == pytest.approx(expected, rel=1e-7)
    assert energies[5] == pytest.approx(ETA * 0.6 * rate**2 * h * AREA, rel=1e-7)
    assert abs(energies[1]) < 1e-12 * W * AREA


def test_random_loads_dissipate_at_every_step():
    rng = np.random.default_rng(5)
    for dim in (2, 3):
        bond, stored = PointMass(law(friction=0.4), 2.0 * W * AREA, np.zeros(dim), area=AREA), 0.0
        while bond.damage > 0.0:
            h, before, start = DC * rng.choice([0.03, 0.2, 0.7]), bond.kinetic, bond.jump.copy()
            force = rng.normal(size=dim) * 2.0 * S * AREA
            energies = np.array(bond.step(h, force))
            assert energies[[1, 2, 3, 5]].min() >= -1e-12 * W * AREA
            assert energies[4] >= -1e-9 * W * AREA
            lost = force @ (bond.jump - start) + before - bond.kinetic + stored - energies[0]
            assert lost == pytest.approx(energies[1:].sum(), abs=1e-11 * W * AREA)
            stored = energies[0]


def test_without_viscosity_nothing_of_it_is_compiled():
    plain = xf.laws.RigidCohesiveZone(S, W)
    assert law(viscosity=0.0).kernels(2) is plain.kernels(2)
    assert "viscous bonds" not in dict(plain.kernels(2).effects)
    assert dict(law().kernels(2).effects)["viscous bonds"] == 2


@pytest.mark.parametrize("bad", [-1.0, np.inf, np.nan, "much", None])
def test_bad_viscosities_are_refused(bad):
    with pytest.raises((TypeError, ValueError), match="viscosity should be a"):
        law(viscosity=bad)
