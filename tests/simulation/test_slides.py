# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static runs in which bodies slide on a wall: snaps are told, and contact stays where it is."""

import numpy as np
import pytest

import xper_fx as xf

E, LENGTH, HEIGHT, PRESSURE = 1e9, 10.0, 0.1, 1e6
STATIC, DYNAMIC = 0.6, 0.5
STIFFNESS = E * HEIGHT / LENGTH
FREED = 0.5 * ((STATIC - DYNAMIC) * PRESSURE) ** 2 / STIFFNESS
ON_WALL, LEFT_OUT, PRESSED, PULLED = 1, 2, 3, 4


def slider(law, pull):
    """A stiff block of 1 m that is pressed on a wall, and a bar of 10 m that pulls it."""
    end = 1.0 + LENGTH
    mesh = xf.crossed_rectangle((0, 0), (end, HEIGHT), (11, 1))
    tags = xf.tag_facets(
        mesh,
        {
            ON_WALL: lambda x: (x[1] < 1e-9) & (x[0] < 1.0 + 1e-9),
            LEFT_OUT: lambda x: (x[1] < 1e-9) & (x[0] > 2.0 - 1e-9),
            PRESSED: lambda x: (x[1] > HEIGHT - 1e-9) & (x[0] < 1.0 + 1e-9),
            PULLED: lambda x: x[0] > end - 1e-9,
        },
    )
    whole = np.zeros(len(xf.geometry_dofmap(mesh)), int)
    loads = [
        xf.PrescribedDisplacement(PULLED, 0, pull),
        xf.PrescribedDisplacement(LEFT_OUT, 1, 0.0),
        xf.SurfaceTraction(PRESSED, (0.0, -PRESSURE)),
    ]
    return xf.Scene(
        xf.explode(mesh, whole, xf.tag_cells(mesh, {2: lambda x: x[0] < 1.0}), tags),
        {k: xf.materials.LinearElastic(young, 0.0, 2400.0) for k, young in ((1, E), (2, 1e4 * E))},
        loads=loads,
        walls=[xf.Wall(ON_WALL, (0.0, 0.0), (0.0, 1.0), law)],
    )


def weakening(distance):
    return xf.laws.SlipWeakening(STATIC, DYNAMIC, distance, contact="position")


@pytest.mark.parametrize("size", [10.0, 50.0])
def test_a_snap_of_friction_is_told(size, caplog):
    """Friction falls within 0.1 mm, the bar lets the block slide by 10 mm: 500 J go nowhere."""
    simulation = xf.Simulation(slider(weakening(1e-4), lambda t: 1e-5 * t), size, inertia=False)
    with caplog.at_level("WARNING", logger="xper_fx"):
        *_, last = simulation.steps(7000.0)
    told = [r.message for r in caplog.records if "snaps" in r.message]
    assert len(told) == 1 and "bodies slide" in told[0]
    assert last.energies["dissipated_numerical"] == pytest.approx(FREED, rel=0.1)


@pytest.mark.parametrize(
    "law", [weakening(2e-2), xf.laws.SignoriniCoulomb(DYNAMIC, contact="position")]
)
def test_a_slide_in_balance_is_no_snap(law, caplog):
    """Friction that falls less steeply than the bar unloads, or not at all; pulled and let back."""

    def pull(time):
        return 1e-5 * np.interp(time, [0.0, 9000.0, 14000.0], [0.0, 9000.0, -9000.0])

    simulation = xf.Simulation(slider(law, pull), 50.0, inertia=False)
    with caplog.at_level("WARNING", logger="xper_fx"):
        *_, last = simulation.steps(14000.0)
    assert not [r.message for r in caplog.records if "snaps" in r.message]
    assert last.energies["dissipated_friction"] > 100.0 * FREED
    assert abs(last.energies["dissipated_numerical"]) < 0.1 * FREED


@pytest.mark.parametrize("contact", ["position", "velocity"])
def test_a_body_that_is_pressed_does_not_sink(contact):
    """At the default tolerance: what a step leaves of impulses adds up from step to step."""
    law = xf.laws.SignoriniCoulomb(DYNAMIC, contact=contact)
    simulation = xf.Simulation(slider(law, lambda t: 1e-5 * t), 50.0, inertia=False)
    for step in simulation.steps(3000.0):
        deepest = min(g.jump[:, 0].min() for g in simulation.interactions.groups)
        assert deepest > -1e-6
        assert abs(step.energies["dissipated_impact"]) < 1e-3 * step.energies["elastic"]
