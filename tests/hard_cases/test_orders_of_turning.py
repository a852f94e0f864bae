# SPDX-License-Identifier: LGPL-3.0-or-later
"""What spinning bonded blocks lose with theta from 1/2 to 1, an implicit bulk, against the step."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import LEFT, RIGHT, box_bodies
from test_turned_bonds import YOUNG, momenta

from xper_fx.forms.loads import SurfaceTraction
from xper_fx.materials import NeoHookean
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

SPIN, TIME = 1.0, 1.6
STRENGTH, ENERGY = 1.0, 0.02


def spinning(bond, theta, step, spin, loads=()):
    """Two bonded blocks that spin about their middle."""
    scene = Scene(
        box_bodies((2, 1), (4, 2), label=lambda x: x[0] > 1),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=bond,
        loads=list(loads),
        initial_velocity=lambda x: spin * np.stack([0.5 - x[1], x[0] - 1.0]),
    )
    tight = {"tolerance": 1e-10, "newton_tolerance": 1e-11}
    return Simulation(scene, step, scheme="implicit", theta=theta, **tight, num_threads=1)


def losses(theta, step, tangential):
    """Of angular momentum, of the energy held, what is numerical and what is not closed.

    All are relative to what was there at the start.
    """
    simulation = spinning(CohesiveZone(1000.0, 0.5, 8.0, tangential), theta, step, SPIN)
    _, angular = momenta(simulation)
    kinetic = simulation.ledger.energies.kinetic
    *_, record = simulation.steps(TIME)
    linear, turned = momenta(simulation)
    assert np.abs(linear).max() < 1e-13 * angular
    energies = record.energies
    held = energies["kinetic"] + energies["elastic"] + energies["cohesive"]
    rest = [energies["dissipated_numerical"] / kinetic, energies["closure"] / kinetic]
    return np.abs([turned / angular - 1.0, held / kinetic - 1.0, *rest])


@pytest.mark.slow
@pytest.mark.parametrize(
    "theta, tangential", [(0.5, None), (0.5, 300.0), (0.6, 300.0), (1.0, None)]
)
def test_orders_of_what_is_lost(theta, tangential, figure):
    """Theta above 1/2 takes (2 theta - 1) h omega^2 of the angular momentum a second.

    q1 x M v1 - q0 x M v0 = q_m x M (v1 - v0) + h (2 theta - 1) v1 x M v0, and v1 - v0 is that of a
    body that spins, -h omega^2 x. Energy falls with it, and is booked; the rest is of second order.
    """
    step = 0.02
    once, twice = losses(theta, step, tangential), losses(theta, 0.5 * step, tangential)
    momentum, held, numerical, closure = np.log2(once / twice)
    what = f"spin with theta = {theta}, C_T = {tangential}"
    figure(what, "order of the angular momentum", momentum)
    figure(what, "order of the energy held", held)
    assert closure > 1.8
    assert twice[3] < 7e-5
    if theta == 0.5:
        assert min(momentum, held) > 1.8
        assert twice[0] < 5e-5
        # alike, bonds book nothing; with another C_T what jumps that are read anew bring
        assert twice[2] < (1e-10 if tangential is None else 2e-8)
        assert tangential is None or numerical > 2.2
    else:
        expected = (2.0 * theta - 1.0) * 0.5 * step * SPIN**2 * TIME
        assert twice[0] == pytest.approx(expected, rel=0.04)
        assert 0.9 < momentum < 1.05
        assert 0.85 < min(held, numerical) and max(held, numerical) < 1.05
        assert twice[2] == pytest.approx(twice[1], rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("theta, tangential", [(0.5, 400.0), (1.0, None)])
def test_a_bond_spends_its_energy_whatever_theta_is(theta, tangential, figure):
    """Turned by 90 degrees, then pulled apart: the area under the normal curve at any step.

    With C_N = C_T that is w, to the tolerance of the solver; else the bond shears a little besides.
    """
    spin, ramp = 0.5, 3.0
    start = 0.5 * np.pi / spin
    pull = 1.5 if tangential is None else 3.0

    def traction(t, component, sign):
        along = (np.cos(spin * t), np.sin(spin * t))[component]
        return sign * pull * np.clip((t - start) / ramp, 0.0, 1.0) * along

    loads = [
        SurfaceTraction(
            side, tuple(lambda t, c=c, s=sign: traction(t, c, s) for c in range(2))
        )
        for side, sign in ((RIGHT, 1.0), (LEFT, -1.0))
    ]  # fmt: skip
    bond = CohesiveZone(1000.0, ENERGY, STRENGTH, tangential, friction=0.3)
    area = ENERGY * (1.0 if tangential is None else 0.5 * (1.0 + 1000.0 / tangential))
    for step in (0.08, 0.04):
        simulation = spinning(bond, theta, step, spin, loads)
        for record in simulation.steps(start + ramp):  # noqa: B007 - the last is looked at
            if simulation.interactions.gather("damage").max() == 0.0:
                break
        assert simulation.interactions.gather("damage").max() == 0.0
        error = abs(record.energies["dissipated_cohesion"] / area - 1.0)
        what = f"turned and torn, theta = {theta}, C_T = {tangential}"
        bound = 1e-8 if tangential is None else 1e-3
        figure(what, f"energy spent beside the area: error < {bound:.0e}", error)
        assert error < bound
