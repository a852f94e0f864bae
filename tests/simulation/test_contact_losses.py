# SPDX-License-Identifier: LGPL-3.0-or-later
"""What impacts take from the kinetic energy is booked as theirs, at any theta."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BOTTOM, box_bodies, run

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, RigidBody, wall
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

MASS, GRAVITY, STEP = 2.0, 10.0, 1e-2
THETAS = (0.5, 0.75, 1.0)


@pytest.mark.parametrize("theta", THETAS)
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_disc_that_bounces(theta, restitution):
    """Each step's losses are those of its impulse, m (dv_x, dv_y + g h), and the velocities.

    The disc falls obliquely and spins, with the slip v_x + omega times the arm. Friction has the
    work over the way, h times theta of the end's slip and 1 - theta of the start's; what it takes
    by the mean of both is the impact's where the disc arrives, and the scheme's where it slides on.
    """
    disc = RigidBody(Disc(0.5), (0.0, 0.7), "disc", mass=MASS, velocity=(1.0, -3.0), spin=2.0)
    scene = Scene(
        rigid=[wall((0.0, 0.0), (0.0, 1.0), "floor"), disc],
        contacts=[Contact(("disc", "floor"), SignoriniCoulomb(0.2, restitution))],
        loads=[Gravity((0.0, -GRAVITY))],
    )
    simulation = Simulation(scene, STEP, theta=theta, tolerance=1e-12, num_threads=1, healing=False)
    pushed = False
    before, told = simulation.rigid.state, dict.fromkeys(("impact", "friction", "numerical"), 0.0)
    for _ in range(60):
        run(simulation, 1)
        after, energies = simulation.rigid.state, simulation.ledger.energies
        change = after.velocity[1] - before.velocity[1] + (0.0, GRAVITY * STEP)
        height = before.position[1, 1] + STEP * (1.0 - theta) * before.velocity[1, 1]
        arm = 0.5 * (height + 0.5)  # to halfway between disc and floor
        slips = [s.velocity[1, 0] + arm * s.turn.spin[1, 0] for s in (before, after)]
        speeds = before.velocity[1, 1] + after.velocity[1, 1]
        beyond = (theta - 0.5) * MASS * change[0] * (slips[1] - slips[0])
        arrives = change[1] > 1e-9 and not pushed
        pushed = change[1] > 1e-9
        expected = {
            "impact": -0.5 * MASS * change[1] * speeds + (beyond if arrives else 0.0),
            "friction": -MASS * change[0] * (theta * slips[1] + (1.0 - theta) * slips[0]),
            "numerical": -(theta - 0.5) * MASS * GRAVITY * STEP * (change[1] - GRAVITY * STEP)
            + (0.0 if arrives else beyond),
        }
        for name, loss in expected.items():
            total = getattr(energies, f"dissipated_{name}")
            assert total - told[name] == pytest.approx(loss, abs=1e-10), name
            assert name == "numerical" or loss > -1e-10, name
            told[name] = total
        assert abs(simulation.ledger.closure) < 1e-11
        before = after
    if restitution == 0.0:
        assert told["impact"] == pytest.approx(0.5 * MASS * (9.0 + 2.0 * GRAVITY * 0.2), rel=0.15)


@pytest.mark.slow
def test_an_elastic_block_that_lands():
    """Impacts of nodes on a wall are no damping of the scheme: nearly the same at any theta."""
    impacts = []
    for theta in THETAS:
        scene = Scene(
            box_bodies((1.0, 1.0), (2, 2), label=0),
            {1: LinearElastic(young=1e5, poisson=0.3, density=1000.0)},
            walls=[Wall(BOTTOM, (0.0, -0.02), (0.0, 1.0), SignoriniCoulomb(0.3))],
            initial_velocity=lambda x: np.stack([0.5 + 0.0 * x[0], -1.0 + 0.0 * x[0]]),
            loads=[Gravity((0.0, -9.81))],
        )
        simulation = Simulation(scene, 2e-3, theta=theta, tolerance=1e-10, num_threads=1)
        records = run(simulation, 100)
        for name in ("impact", "friction"):
            history = np.array([0.0] + [r.energies[f"dissipated_{name}"] for r in records])
            assert np.diff(history).min() > -1e-8 * history[-1]
        assert abs(records[-1].energies["closure"]) < 1e-9
        impacts.append(simulation.ledger.energies.dissipated_impact)
    assert impacts[0] > 100.0 and impacts == pytest.approx([impacts[0]] * 3, rel=0.15)
