# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static bodies that nothing but contact holds: on a wall, on each other, by a search."""

import numpy as np
import pytest
from scenes import BOTTOM, TOP, box_bodies
from scipy.optimize import brentq

import xper_fx as xf

E, WIDTH, HEIGHT, MU = 1e9, 1.0, 0.5, 0.3
UPPER = 2


def halves(x):
    return (x[1] > HEIGHT / 2).astype(int)


def pressed(hold: str, material, load, contact="position"):
    """A block under a traction on its upper side; its lower half is another body but on a wall."""
    law = xf.laws.SignoriniCoulomb(MU, contact=contact)
    held = [xf.PrescribedDisplacement(BOTTOM, axis, 0.0) for axis in (0, 1)]
    loads = [xf.SurfaceTraction(TOP, load)]
    size, cells = (WIDTH, HEIGHT), (8, 4)
    if hold == "wall":
        bodies = box_bodies(size, cells, label=0)
        walls = [xf.Wall(BOTTOM, (0.0, 0.0), (0.0, 1.0), law)]
        return xf.Scene(bodies, {1: material}, walls=walls, loads=loads)
    loads += held
    if hold == "lips":
        bodies = box_bodies(size, cells, label=halves)
        return xf.Scene(bodies, {1: material}, default_interaction=law, loads=loads)
    above = {UPPER: lambda x: x[1] > HEIGHT / 2 - 1e-9}
    bodies = box_bodies(size, cells, label=halves, material=above)
    return xf.Scene(
        bodies, {1: material, UPPER: material}, interactions={(1, UPPER): None}, loads=loads,
        default_interaction=xf.laws.PerfectBond(), surfaces={"lower": (1,), "upper": (UPPER,)},
        contacts=[
            xf.Contact(("lower", "upper"), law), xf.Contact(("lower", "lower"), None),
            xf.Contact(("upper", "upper"), None),
        ],
    )  # fmt: skip


def stretch(material, pressure: float) -> float:
    """Of a column without lateral strain or stress (nu = 0) under a dead load."""
    if isinstance(material, xf.materials.LinearElastic):
        return 1.0 - pressure / E
    return brentq(lambda f: 0.5 * E * f * (f * f - 1.0) + pressure, 0.7, 1.0, xtol=1e-15)


@pytest.mark.parametrize("contact", ["position", "velocity"])
@pytest.mark.parametrize("hold", ["wall", "lips", "search"])
@pytest.mark.parametrize("kind", ["LinearElastic", "SaintVenantKirchhoff"])
def test_a_pressed_block_is_as_short_as_a_column(kind, hold, contact):
    """From rest no contact has an impulse yet, and without contact the block flies away."""
    material, pressure = getattr(xf.materials, kind)(E, 0.0, 1000.0), 0.05 * E
    scene = pressed(hold, material, lambda t: (0.0, -pressure * t), contact)
    simulation = xf.Simulation(scene, 0.5, inertia=False)
    steps = list(simulation.steps(1.0))
    assert len(steps) == 2 and steps[0].newton_iterations <= 8
    shorter = (1.0 - stretch(material, pressure)) * HEIGHT
    assert simulation.mean_displacement(TOP) == pytest.approx([0.0, -shorter], abs=1e-7 * shorter)


@pytest.mark.parametrize("hold", ["wall", "lips", "search"])
def test_a_block_slides_where_friction_says(hold):
    material, pressure = xf.materials.LinearElastic(E, 0.3, 1000.0), 1e-4 * E

    def load(t):
        return MU * pressure * max(t - 1.0, 0.0), -pressure * min(t, 1.0)

    simulation = xf.Simulation(pressed(hold, material, load), 0.1, inertia=False)
    with pytest.raises(xf.ConvergenceError, match="no equilibrium"):
        for _ in simulation.steps(2.1):
            pass
    assert simulation.time == pytest.approx(2.0, abs=0.002)


@pytest.mark.parametrize("contact", ["position", "velocity"])
def test_one_of_two_lips_bears_where_they_have_slid_and_turned(contact):
    """Facets that meet at a node have gaps of their own where they have turned apart."""
    material, pressure = xf.materials.SaintVenantKirchhoff(E, 0.3, 1000.0), 2e-3 * E

    def load(t):
        return 0.9 * MU * pressure * np.sin(0.5 * np.pi * max(t - 1, 0.0)), -pressure * min(t, 1.0)

    scene = pressed("lips", material, load, contact)
    simulation = xf.Simulation(scene, 0.25, inertia=False)
    steps = list(simulation.steps(3.0))
    assert len(steps) <= 16
    balance = simulation.reaction(BOTTOM) + WIDTH * np.array(load(steps[-1].time))
    assert balance == pytest.approx([0.0, 0.0], abs=1e-6 * WIDTH * pressure)
    assert steps[-1].energies["dissipated_friction"] > 1.0
    bears = simulation.interactions.groups[0].impulse[:, 0] > 0.0
    assert np.count_nonzero(bears) < len(bears)


def test_a_block_that_is_pulled_off_its_wall_is_told():
    material = xf.materials.LinearElastic(E, 0.3, 1000.0)
    scene = pressed("wall", material, lambda t: (0.0, 1e5 * t))
    with pytest.raises(xf.ConvergenceError, match="no equilibrium"):
        for _ in xf.Simulation(scene, 0.5, inertia=False).steps(1.0):
            pass


def test_a_block_between_no_walls_is_refused():
    material = xf.materials.LinearElastic(E, 0.3, 1000.0)
    bodies = box_bodies((WIDTH, HEIGHT), (2, 2), label=0)
    scene = xf.Scene(bodies, {1: material}, loads=[xf.SurfaceTraction(TOP, (0.0, -1.0))])
    with pytest.raises(ValueError, match="lean on a wall"):
        xf.Simulation(scene, 0.5, inertia=False)
