# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonded cells whose macroscopic gradient turns: couples of bonds in Pibar, and the ledger."""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell_of, phase

from xper_fx.materials import NeoHookean
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

PRESS, DRAW, SHEAR = -5e-3, 4e-3, 5e-3
BONDS = {"alike": None, "other C_T": 300.0}


def gradient(t, dim):
    """R U: a quarter turn at time 1, pressed, drawn and sheared."""
    angle, R, U = 0.5 * np.pi * t, np.eye(dim), np.eye(dim)
    R[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    U[:2, :2] += t * np.array([[PRESS, SHEAR], [0.0, DRAW]])
    return R @ U


def turning_cell(dim, steps, tangential, stress=None, **options):
    """A cell of two materials, each element a body, some of whose bonds are open.

    Args:
        dim: 2 or 3.
        steps: to the quarter turn.
        tangential: C_T, None for that of C_N.
        stress: components that are driven by stress, the others by the gradient.
        options: of `Simulation`.
    """
    sides, kind = ((2, 2), "crossed") if dim == 2 else ((1, 1, 1), "tetrahedron")
    stress = stress or {}
    driven = {
        f"{i + 1}{j + 1}": lambda t, i=i, j=j: gradient(t, dim)[i, j]
        for i in range(dim)
        for j in range(dim)
        if f"{i + 1}{j + 1}" not in stress
    }
    cell = cell_of((1.0,) * dim, sides, kind, label=None, material=phase(0.5) if dim == 2 else None)
    hard = {2: NeoHookean(300.0, 0.2, 1.0)} if dim == 2 else {}
    scene = Scene(
        cell,
        {1: NeoHookean(100.0, 0.3, 1.0)} | hard,
        default_interaction=CohesiveZone(1000.0, 0.5, 8.0, tangential),
        macroscopic=MacroscopicDrive(gradient=driven, stress=stress),
    )
    given = {"tolerance": 1e-10, "newton_tolerance": 1e-12, "num_threads": 1} | options
    return Simulation(scene, 1.0 / steps, **given)


def turned(simulation):
    """The last record, and the largest error of Hill and Mandel's lemma."""
    worst = 0.0
    for record in simulation.steps(1.0):  # noqa: B007 - the last is returned
        worst = max(worst, simulation.macroscopic.hill_mandel)
    return record, worst


def unsymmetric(macroscopic):
    """How far Pibar Fbar^T is from symmetric, beside it."""
    kirchhoff = macroscopic.stress @ macroscopic.gradient.T
    return np.abs(kirchhoff - kirchhoff.T).max() / np.abs(kirchhoff).max()


STATIC = {"inertia": False, "theta": 1.0}


@pytest.mark.parametrize("bond", BONDS)
@pytest.mark.parametrize("dim", [2, 3])
def test_moments_of_a_cell_at_rest_are_in_balance(dim, bond):
    """Pibar Fbar^T is symmetric after a quarter turn, bonds being pressed, pulled and sheared."""
    simulation = turning_cell(dim, 10, BONDS[bond], **STATIC)
    _, hill_mandel = turned(simulation)
    jumps = simulation.interactions.gather("jump")
    assert (jumps[:, 0] > 1e-6).any() and np.abs(jumps[:, 1:]).max() > 1e-4
    error = unsymmetric(simulation.macroscopic)
    assert error < 1e-9
    assert hill_mandel < 1e-9
    # without what the couples bear it would not be so
    bulk = simulation.bulk
    borne = np.abs(bulk.borne).max() / (np.abs(simulation.macroscopic.stress).max() * bulk.volume)
    assert borne > 1e-4 or not BONDS[bond]


def test_stresses_that_are_given_are_those_with_couples():
    """A cell that is drawn along an axis which turns bears nothing across it."""
    simulation = turning_cell(2, 10, 300.0, {"12": 0.0, "22": 0.0}, **STATIC)
    turned(simulation)
    macroscopic = simulation.macroscopic
    size = np.abs(macroscopic.stress).max()
    assert np.abs(simulation.bulk.borne).max() > 1e-5 * size
    assert np.abs(macroscopic.stress[:, 1]).max() < 1e-9 * size
    assert unsymmetric(macroscopic) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("bond", BONDS)
def test_what_a_turning_static_cell_books_is_of_second_order(bond):
    """The state hangs on no step; numerical energy and closure fall with its square."""
    numerical, closure, elastic = [], [], []
    for steps in (10, 20):
        simulation = turning_cell(2, steps, BONDS[bond], **STATIC)
        record, _ = turned(simulation)
        elastic.append(record.energies["elastic"])
        numerical.append(abs(record.energies["dissipated_numerical"]))
        closure.append(abs(record.energies["closure"]))
    assert elastic[1] == pytest.approx(elastic[0], rel=1e-6)
    assert numerical[0] < 5e-3 * elastic[0]
    assert closure[1] == pytest.approx(0.25 * closure[0], rel=0.02)
    if BONDS[bond]:
        assert numerical[1] == pytest.approx(0.25 * numerical[0], rel=0.1)


@pytest.mark.parametrize("bond", BONDS)
def test_lips_that_stay_pressed_dissipate_nothing_as_they_turn(bond):
    """Steps of 2 degrees, with inertia: neither impacts nor numerical energy."""
    simulation = turning_cell(2, 50, BONDS[bond])
    record, _ = turned(simulation)
    jump = simulation.interactions.gather("jump")
    assert np.sum(simulation.interactions.gather("traction")[:, 0] > 0.0) > len(jump) // 3
    assert np.abs(jump[:, 1]).max() > 3e-4
    energies = record.energies
    assert abs(energies["dissipated_impact"]) < 1e-3 * energies["elastic"]
    assert abs(energies["dissipated_numerical"]) < 1e-3 * energies["elastic"]
    assert unsymmetric(simulation.macroscopic) < 1e-3


@pytest.mark.slow
def test_a_restarted_cell_knows_its_couples():
    """Pibar and the ledger go on as without a break."""
    whole = turning_cell(2, 10, 300.0, **STATIC)
    turned(whole)
    first = turning_cell(2, 10, 300.0, **STATIC)
    list(first.steps(0.5))
    second = turning_cell(2, 10, 300.0, **STATIC)
    second.restore(first.saved_in_order())
    assert np.array_equal(second.macroscopic.stress, first.macroscopic.stress)
    record, _ = turned(second)
    np.testing.assert_allclose(second.macroscopic.stress, whole.macroscopic.stress, rtol=1e-12)
    numerical = record.energies["dissipated_numerical"]
    expected = whole.ledger.energies.dissipated_numerical
    assert numerical == pytest.approx(expected, rel=1e-9)
