# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plastic cells driven by strain and by stress: limits, holds, unloading, steps far too large."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell_of, cell_run, phase
from scenes import LEFT, RIGHT, box_bodies

from xper_fx.forms.loads import PrescribedVelocity
from xper_fx.materials import (
    Cubic,
    J2FiniteStrain,
    J2SmallStrain,
    Linear,
    LinearElastic,
    LinearViscoelastic,
    NeoHookean,
)
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError

ZIRCALOY = dict(
    young=99e9, poisson=0.325, yield_stress=450e6, hardening=Linear(850e6), density=7800.0
)
KINDS = pytest.mark.parametrize("kind", (J2SmallStrain, J2FiniteStrain))
SHEARS = {"12": 0.0, "21": 0.0}


def whole(material=None):
    return cell_of((1, 1), (4, 4) if material else (1, 1), label=0, material=material)


def returned(strain, plastic, alpha):
    """Principal stresses, plastic strains and their size by the radial return, in NumPy."""
    mu, lam = 99e9 / 2.65, 99e9 * 0.325 / 1.325 / 0.35
    trial = (lam + 2 * mu * np.eye(3)) @ (strain - plastic)
    deviator = trial - trial.mean()
    q = np.sqrt(1.5 * deviator @ deviator)
    p = max(0.0, (q - 450e6 - 850e6 * alpha) / (3 * mu + 850e6))
    flow = 1.5 * p * deviator / q if q > 0.0 else 0.0 * deviator
    return trial - 2 * mu * flow, flow, p


def biaxial_strain(stress, steps=2000):
    """F11 - 1 at small strain under a stress beyond yield, P22 = 0, from steps in NumPy."""
    strain, plastic, alpha, h = np.zeros(3), np.zeros(3), 0.0, 1e-9
    for target in np.linspace(0.0, stress, steps)[1:]:
        for _ in range(30):
            sigma, flow, p = returned(strain, plastic, alpha)
            error = sigma[:2] - [target, 0.0]
            if np.abs(error).max() < 1e-3:
                break
            moved = [returned(strain + h * np.eye(2, 3)[i], plastic, alpha)[0] for i in (0, 1)]
            slope = np.stack([(m - sigma)[:2] / h for m in moved], axis=1)
            strain[:2] -= np.linalg.solve(slope, error)
        plastic, alpha = plastic + flow, alpha + p
    return strain[0]


def test_stress_beyond_yield():
    """P11 driven to 600 MPa, P22 = 0: the strain of an independent integration."""
    drive = MacroscopicDrive(gradient=SHEARS, stress={"11": lambda t: 600e6 * t, "22": 0.0})
    simulation = cell_run(whole(), {1: J2SmallStrain(**ZIRCALOY)}, drive, step=0.01, steps=100)
    found = simulation.macroscopic.gradient[0, 0] - 1.0
    assert found == pytest.approx(biaxial_strain(600e6), rel=1e-3)
    assert simulation.macroscopic.stress[0, 0] == pytest.approx(600e6, rel=1e-7)


@KINDS
def test_driven_by_the_stress_it_answers(kind):
    """F11 to 1 %, then the P11(t) it gave: the same F, in a cell with an elastic inclusion."""
    materials = {1: kind(**ZIRCALOY), 2: LinearElastic(135e9, 0.32, 7800.0)}
    bodies, rows = whole(phase(0.5)), [0.0]
    by_strain = MacroscopicDrive(rate={"11": 0.01}, gradient=SHEARS, stress={"22": 0.0})
    first = cell_run(
        bodies, materials, by_strain, step=0.05, steps=20, newton_tolerance=1e-12,
        check=lambda s, r: rows.append(s.macroscopic.stress[0, 0]),
    )  # fmt: skip
    times = np.linspace(0.0, 1.0, 21)
    given = {"11": lambda t: np.interp(t, times, rows), "22": 0.0}
    second = cell_run(
        bodies, materials, MacroscopicDrive(gradient=SHEARS, stress=given), step=0.05, steps=20,
        newton_tolerance=1e-12,
    )  # fmt: skip
    assert second.macroscopic.gradient == pytest.approx(first.macroscopic.gradient, abs=1e-9)


@KINDS
def test_a_flow_too_large_is_cut(kind):
    """20 % in one step: cut, and near what small steps give."""
    drive = MacroscopicDrive(rate={"11": 0.2}, gradient=SHEARS, stress={"22": 0.0})
    materials = {1: kind(**ZIRCALOY), 2: NeoHookean(135e9, 0.32, 7800.0)}
    bodies = whole(phase(0.25))
    once = cell_run(bodies, materials, drive, step=1.0)
    fine = cell_run(bodies, materials, drive, step=0.01, steps=100)
    assert once.step_number >= 4
    assert once.macroscopic.stress[0, 0] == pytest.approx(fine.macroscopic.stress[0, 0], rel=0.01)
    assert once.forms.history()["accumulated 1"].min() > 0.0


def test_a_limit_load_is_told():
    """Perfect plasticity bears 2 / sqrt(3) of its yield stress in plane strain, and no more."""
    perfect = J2SmallStrain(**(ZIRCALOY | {"hardening": Linear(0.0)}))
    drive = MacroscopicDrive(gradient=SHEARS, stress={"11": lambda t: 600e6 * t, "22": 0.0})
    with pytest.raises(ConvergenceError) as caught:
        cell_run(whole(), {1: perfect}, drive, step=0.02, steps=50)
    assert 600e6 * caught.value.time == pytest.approx(450e6 * 2 / np.sqrt(3), rel=1e-3)


def test_hold_and_rest():
    """A held cell stays as it is, and Hill and Mandel's error does not take rest for an error."""
    rows = []
    drive = MacroscopicDrive(
        gradient={"11": lambda t: 1.0 + 0.02 * min(t, 1.0), **SHEARS}, stress={"22": 0.0}
    )
    cell_run(
        whole(phase(0.5)), {1: J2SmallStrain(**ZIRCALOY), 2: LinearElastic(135e9, 0.32, 7800.0)},
        drive, step=0.1, steps=20,
        check=lambda s, r: rows.append([s.macroscopic.stress[0, 0], s.macroscopic.hill_mandel]),
    )  # fmt: skip
    rows = np.array(rows)
    assert rows[10:, 0] == pytest.approx(np.full(10, rows[9, 0]), rel=1e-9)
    assert rows[:, 1].max() < 1e-5


@pytest.mark.slow
def test_stress_held_on_bodies_that_flow():
    """P11 raised beyond the matrix's yield and held, each triangle a body: no runaway."""
    end = 4e-5
    drive = MacroscopicDrive(
        gradient=SHEARS, stress={"11": lambda t: 560e6 * min(t / end, 1.0), "22": 0.0}
    )
    inclusion = {2: lambda x: (abs(x[0] - 5e-5) < 2.6e-5) & (abs(x[1] - 5e-5) < 2.6e-5)}
    materials = {1: J2SmallStrain(**ZIRCALOY), 2: LinearElastic(135e9, 0.32, 7800.0)}
    strains = []
    cell_run(
        cell_of((1e-4, 1e-4), (2, 2), label=None, material=inclusion), materials, drive,
        CohesiveZone(2e18, 5e6, 1e12), step=1e-6, steps=50, theta=1.0, tolerance=1e-6,
        check=lambda s, r: strains.append(s.macroscopic.gradient[0, 0] - 1.0),
    )  # fmt: skip
    one = cell_run(
        cell_of((1e-4, 1e-4), (2, 2), material=inclusion), materials, drive, step=1e-6, steps=50
    )
    # the bonds give a little besides
    assert 1.0 < strains[-1] / (one.macroscopic.gradient[0, 0] - 1.0) < 1.005
    assert np.ptp(strains[-10:]) < 2e-6


def test_rotation_leaves_the_cell_without_stress():
    drive = MacroscopicDrive(
        gradient={"11": np.cos, "12": lambda t: -np.sin(t), "21": np.sin}, stress={"22": 0.0}
    )
    simulation = cell_run(whole(), {1: J2FiniteStrain(**ZIRCALOY)}, drive, step=0.1, steps=10)
    assert np.abs(simulation.macroscopic.stress).max() < 1e-12 * 99e9
    assert simulation.macroscopic.gradient[1, 1] == pytest.approx(np.cos(1.0), abs=1e-9)


def test_a_body_free_to_turn_is_refused():
    """Without inertia, an island that no tie holds."""
    drive = MacroscopicDrive(rate={"11": 0.1}, gradient=SHEARS, stress={"22": 0.0})
    with pytest.raises(ValueError, match="free to turn"):
        cell_run(
            cell_of((1, 1), (4, 4), label=0, hole=lambda x: (x[1] > 0.75) | (x[0] > 0.75)),
            {1: LinearElastic(1.0, 0.3, 1.0)}, drive,
        )  # fmt: skip


def test_cubic_grains_in_a_cell():
    """P11 / F11 along the axes with P22 = 0 in plane strain: c11 - c12^2 / c11."""
    drive = MacroscopicDrive(rate={"11": 0.01}, gradient=SHEARS, stress={"22": 0.0})
    simulation = cell_run(whole(), {1: Cubic(155e9, 100e9, 67e9, 6500.0)}, drive)
    assert simulation.macroscopic.stress[0, 0] == pytest.approx(
        0.01 * (155e9 - 100e9**2 / 155e9), rel=1e-10
    )


def test_explicit_viscous_bulk_is_of_second_order():
    """Halving the step quarters the closure of the ledger."""
    material = LinearViscoelastic(100.0, 0.3, prony=((0.5, 0.1),), density=1.0)
    errors = []
    for step in (0.02, 0.01):
        scene = Scene(
            box_bodies((1, 1), (2, 2), label=0), {1: material},
            loads=[PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 0.1)],
            initial_velocity=lambda x: np.stack([0.1 * x[0], 0.0 * x[0]]),
        )  # fmt: skip
        simulation = Simulation(scene, step, scheme="explicit")
        energies = list(simulation.steps(0.4))[-1].energies
        errors.append(abs(energies["closure"]) / energies["external_work"])
    assert errors[1] < 0.35 * errors[0] and errors[0] < 1e-2


class Springy:
    """A material of a user's own that is not quite one."""

    density, linear, variables = 1.0, False, {}

    def __init__(self, **changes):
        for name, value in changes.items():
            setattr(self, name, value)

    def response(self, u, old, step, constant):
        return "soft"


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"linear": True}, "linear = False"),
        ({"variables": None}, "mapping `variables`"),
        ({"density": -5.0}, "density of .* got -5.0"),
        ({}, "expected a Response"),
    ],
)
def test_materials_that_are_none(changes, message):
    drive = MacroscopicDrive(rate={"11": 0.1}, gradient=SHEARS, stress={"22": 0.0})
    with pytest.raises((TypeError, ValueError), match=message):
        cell_run(whole(), {1: Springy(**changes)}, drive)
