# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plates of bonded cells turned by 90 degrees and spun: no stress, no damage, momenta kept.

Materials at finite strain; a small-strain material is stressed by rotation, and is not asked.
Each cell is a body: what turns must turn the bonds with it (`nscd/turning_frames.py`).
"""

from __future__ import annotations

import numpy as np
import pytest
from cells import cell_of, cell_run
from scenes import box_bodies, field, nodes

from xper_fx.materials import NeoHookean, SaintVenantKirchhoff
from xper_fx.nscd.laws import CohesiveZone, PerfectBond
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

YOUNG = 100.0
LAWS = {"perfect": PerfectBond(), "cohesive": CohesiveZone(1000.0, 0.05, 8.0, friction=0.3)}
KINDS = pytest.mark.parametrize("kind", [NeoHookean, SaintVenantKirchhoff])
BONDS = pytest.mark.parametrize("bond", LAWS)


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def stresses(simulation) -> float:
    """Largest Cauchy stress of any cell over Young's modulus."""
    _ = simulation.displacement  # which sets what the forms are evaluated at
    return np.abs(simulation.forms.stress_evaluator()()).max() / YOUNG


@KINDS
@BONDS
def test_prescribed_quarter_turn(bond, kind, figure):
    """A cell of bodies whose Fbar is a rotation, in 9 steps: no stress inside, nor in the bonds."""
    angle = lambda t: 0.5 * np.pi * t  # noqa: E731
    drive = MacroscopicDrive(
        gradient={
            "11": lambda t: np.cos(angle(t)), "12": lambda t: -np.sin(angle(t)),
            "21": lambda t: np.sin(angle(t)), "22": lambda t: np.cos(angle(t)),
        }
    )  # fmt: skip
    most = []

    def check(simulation, record):
        traction = np.abs(simulation.interactions.gather("traction")).max()
        most.append([stresses(simulation), traction / YOUNG])

    simulation = cell_run(
        cell_of((1, 1), (2, 2), label=None), {1: kind(YOUNG, 0.3, 1.0)}, drive, LAWS[bond],
        step=1 / 9, steps=9, theta=1.0, check=check,
    )  # fmt: skip
    assert simulation.macroscopic.gradient == pytest.approx(rotation(0.5 * np.pi), abs=1e-14)
    worst = np.max(most)
    figure(f"cell turned by 90 degrees, {bond}, {kind.__name__}", "stress / E < 1e-13", worst)
    assert worst < 1e-13
    if bond == "cohesive":
        assert np.all(simulation.interactions.gather("damage") == 1.0)


@KINDS
def test_a_turned_cell_answers_as_before(kind, figure):
    """Objectivity: P(R F) = R P(F) with R a turn by 90 degrees, a connected cell of two phases."""
    U, R = np.array([[1.1, 0.05], [0.05, 0.95]]), rotation(0.5 * np.pi)
    materials = {1: kind(YOUNG, 0.3, 1.0), 2: kind(3.0 * YOUNG, 0.2, 1.0)}
    inclusion = {2: lambda x: (x[0] < 0.5) & (x[1] < 0.5)}

    def stress(at):
        """Pibar at the end of a path of Fbar in time."""
        gradient = {
            f"{i + 1}{j + 1}": lambda t, i=i, j=j: at(t)[i, j] for i in (0, 1) for j in (0, 1)
        }
        cell = cell_of((1, 1), (2, 2), material=inclusion)
        drive = MacroscopicDrive(gradient=gradient)
        return cell_run(cell, materials, drive, step=0.1, steps=10).macroscopic.stress

    still = stress(lambda t: np.eye(2) + t * (U - np.eye(2)))
    turned = stress(lambda t: rotation(0.5 * np.pi * t) @ (np.eye(2) + t * (U - np.eye(2))))
    error = np.abs(turned - R @ still).max() / np.abs(still).max()
    figure(f"stress of a turned cell, {kind.__name__}", "|P(R F) - R P(F)| / |P| < 1e-11", error)
    assert error < 1e-11


SPIN = 0.1 * np.sqrt(YOUNG)
"""A tenth of the speed of sound over the side (1/s)."""


def spinning(bond, scheme) -> Simulation:
    """A square of bonded cells that spins about its middle."""
    scene = Scene(
        box_bodies((1, 1), (1, 1)),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=LAWS[bond],
        initial_velocity=lambda x: SPIN * np.stack([0.5 - x[1], x[0] - 0.5]),
    )
    step = None if scheme == "explicit" else 0.02 / SPIN
    # lips that are closed and stick in a ring converge slowly
    tolerance = 1e-11 if bond == "perfect" else 1e-7
    return Simulation(scene, step, scheme=scheme, tolerance=tolerance, num_threads=1)


def angular_momentum(simulation) -> float:
    x, v = nodes(simulation) + field(simulation), field(simulation, "velocity")
    mass = simulation.bulk.mass[::2]
    momentum = mass[:, None] * v
    return float(np.sum(x[:, 0] * momentum[:, 1] - x[:, 1] * momentum[:, 0]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "bond, scheme",
    [
        ("perfect", "explicit"), ("perfect", "implicit"), ("cohesive", "implicit"),
        ("cohesive", "explicit"),
    ],
)  # fmt: skip
def test_free_spin(bond, scheme, figure):
    """Half a turn at a tenth of the speed of sound, so that it stretches and swings.

    Central differences keep the angular momentum exactly: forces are those of mid-step, where
    sum x x f = 0, and bonds bring the couple that goes with their jumps. Theta = 1/2 takes the mean
    of the forces at both ends and keeps it to second order.
    """
    simulation = spinning(bond, scheme)
    start, energy = angular_momentum(simulation), simulation.ledger.energies.kinetic
    assert start == pytest.approx(SPIN / 3.0, rel=1e-12)
    momenta, totals = [], []
    for record in simulation.steps(np.pi / SPIN):
        momenta.append(angular_momentum(simulation) / start - 1.0)
        e = record.energies
        totals.append((e["kinetic"] + e["elastic"] + e["cohesive"]) / energy - 1.0)
    momentum, error = np.abs(momenta).max(), np.abs(totals).max()
    bound = 1e-11 if scheme == "explicit" else 1e-3
    figure(f"free spin, {bond}, {scheme}", f"angular momentum error < {bound:.0e}", momentum)
    figure(f"free spin, {bond}, {scheme}", "energy error < 5e-3", error)
    assert momentum < bound
    assert error < 5e-3
    linear = (simulation.bulk.mass * simulation.state.velocity).reshape(-1, 2).sum(axis=0)
    assert np.abs(linear).max() < 1e-11 * SPIN
    if bond == "cohesive":
        assert np.all(simulation.interactions.gather("damage") == 1.0)
