# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gravity that is a function of time, on rigid bodies and on meshed ones."""

from __future__ import annotations

import numpy as np
import pytest
from misused_scenes import disc
from scenes import box_bodies

import xper_fx as xf

SOFT = xf.materials.LinearElastic(young=1e6, poisson=0.3, density=1e3)


def ramp(time):
    """An acceleration (m/s^2) linear in time."""
    return np.array([2.0, -6.0 * time])


@pytest.mark.parametrize(("scheme", "theta"), [("implicit", 0.5), ("implicit", 0.8),
                                               ("explicit", 0.5)])  # fmt: skip
@pytest.mark.parametrize("gravity", [ramp, (2.0, lambda t: -6.0 * t)])
def test_bodies_fall_as_the_integral_says(scheme, theta, gravity):
    """A meshed block and a disc that do not touch fall alike."""
    step, count = 2e-3, 50
    scene = xf.Scene(
        box_bodies((1.0, 1.0), (2, 2), label=0),
        {1: SOFT},
        surfaces={"block": (1,)},
        rigid=[disc((5.0, 0.0), "disc")],
        contacts=[xf.Contact(("block", "disc"), None)],
        loads=[xf.Gravity(gravity), xf.Gravity((0.0, -1.0))],
    )
    simulation = xf.Simulation(scene, step, scheme=scheme, theta=theta, num_threads=1)
    *_, last = simulation.steps(step * count)

    t = step * count
    # of a step theta of its end counts, which is h (theta - 1/2) later than its middle
    exact = np.array([2.0 * t, -1.0 * t - 3.0 * t**2 - 6.0 * (theta - 0.5) * step * t])
    assert simulation.rigid.state.velocity[0] == pytest.approx(exact, rel=1e-11)
    assert simulation.velocity.x.array.reshape(-1, 2).mean(axis=0) == pytest.approx(exact, rel=1e-9)
    kinetic = 0.5 * (1e3 * np.pi + 1e3) * exact @ exact
    assert last.energies["kinetic"] == pytest.approx(kinetic, rel=1e-9)
    assert abs(last.energies["closure"]) < 1e-10 * kinetic


@pytest.mark.slow
def test_a_block_slides_once_the_table_is_steeper_than_friction():
    friction, rate = 0.3, 0.5

    def tilting(time):
        return 9.81 * np.sin(rate * time), -9.81 * np.cos(rate * time)

    scene = xf.Scene(
        rigid=[
            xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "table"),
            xf.RigidBody(xf.rigid.Polygon.box((2.0, 0.2)), (0.0, 0.1), "block", density=1e3),
        ],
        contacts=[xf.Contact(("block", "table"), xf.laws.SignoriniCoulomb(friction))],
        loads=[xf.Gravity(tilting)],
    )
    simulation = xf.Simulation(scene, 1e-3, tolerance=1e-12, num_threads=1)
    slips = np.arctan(friction) / rate
    *_, _ = simulation.steps(slips - 0.002)
    assert abs(simulation.rigid.state.position[1, 0]) < 1e-9
    *_, last = simulation.steps(slips + 0.4)

    # v' = g (sin - mu cos)
    end = rate * last.time
    start = rate * slips
    speed = 9.81 / rate * (np.cos(start) - np.cos(end) - friction * (np.sin(end) - np.sin(start)))
    assert simulation.rigid.state.velocity[1, 0] == pytest.approx(speed, rel=2e-3)
    assert abs(last.energies["closure"]) < 1e-9 * last.energies["kinetic"]
