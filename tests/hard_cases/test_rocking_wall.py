# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wall of bricks in running bond between stiff beams, pressed and pushed until it rocks."""

import numpy as np
import pytest
from scenes import BOTTOM, TOP, box_bodies

import xper_fx as xf

BRICK, COURSE, COLUMNS, ROWS = 0.22, 0.0625, 4, 10
WIDTH, HEIGHT = COLUMNS * BRICK, ROWS * COURSE
PRESSURE, PUSH = 0.3e6, 4e-3


def in_a_beam(x):
    return (x[1] < COURSE + 1e-9) | (x[1] > HEIGHT - COURSE - 1e-9)


def bricks(x):
    """Of cells' midpoints; the first and the last row are beams."""
    row = (x[1] / COURSE).astype(int)
    column = ((x[0] + np.where(row % 2 == 1, 0.5 * BRICK, 0.0)) / BRICK).astype(int)
    return np.where(row == 0, 0, np.where(row == ROWS - 1, 1, 100 * row + column))


@pytest.mark.slow
@pytest.mark.parametrize("path", [xf.GrowthControl(), None], ids=["path", "steps"])
def test_a_wall_rocks_about_its_toe(path):
    """At the end F (H - c) = p W^2 / 2, the crack being the lowest bed joint, at a height of c.

    On the way lips flip between stick and slip by 5e-8 of the largest force: too little to matter.
    """
    joint = xf.laws.MixedMode(82e9, (0.25e6, 0.35e6), (18.0, 125.0), 2.0, friction=0.75)
    scene = xf.Scene(
        box_bodies((WIDTH, HEIGHT), (4 * COLUMNS, ROWS), "quadrilateral", label=bricks,
                   material={2: in_a_beam}),
        {1: xf.materials.LinearElastic(16.7e9, 0.15, 1900.0),
         2: xf.materials.LinearElastic(200e9, 0.15, 1900.0)},
        default_interaction=joint,
        loads=[xf.PrescribedDisplacement(BOTTOM, 0, 0.0), xf.PrescribedDisplacement(BOTTOM, 1, 0.0),
               xf.SurfaceTraction(TOP, (0.0, -PRESSURE)),
               xf.PrescribedDisplacement(TOP, 0, lambda t: PUSH * t)],
    )  # fmt: skip
    simulation = xf.Simulation(scene, 0.02 if path is None else 1.0, inertia=False, path=path)
    forces = [simulation.reaction(TOP)[0] for _ in simulation.steps(1.0)]
    rocking = 0.5 * PRESSURE * WIDTH**2 / (HEIGHT - COURSE)
    assert forces[-1] == pytest.approx(rocking, rel=1e-4)
    assert 1.2 * rocking < max(forces) < 1.5 * rocking


def block(friction, viscosity=0.0):
    """A block on a beam of its width; its facets are of 0.11 m."""
    joint = xf.laws.CohesiveZone(82e9, 18.0, 0.25e6, friction=friction, viscosity=viscosity)
    return xf.Scene(
        box_bodies((WIDTH, HEIGHT), (2 * COLUMNS, ROWS), "quadrilateral",
                   label=lambda x: x[1] > COURSE),
        {1: xf.materials.LinearElastic(16.7e9, 0.15, 1900.0)}, default_interaction=joint,
        loads=[xf.PrescribedDisplacement(BOTTOM, 0, 0.0), xf.PrescribedDisplacement(BOTTOM, 1, 0.0),
               xf.SurfaceTraction(TOP, (0.0, -PRESSURE)),
               xf.PrescribedDisplacement(TOP, 0, lambda t: PUSH * t)],
    )  # fmt: skip


# p W^2 / (2 (H - c)), at which the block rocks; p W mu is 0.84 to 1.02 times as much.
ROCKING = 0.5 * PRESSURE * WIDTH**2 / (HEIGHT - COURSE)


def test_a_block_rocks_where_friction_bears_it():
    simulation = xf.Simulation(block(0.8), 1.0, inertia=False, path=xf.GrowthControl())
    forces = [simulation.reaction(TOP)[0] for _ in simulation.steps(1.0)]
    assert forces[-1] == pytest.approx(ROCKING, rel=1e-6)


@pytest.mark.slow
def test_a_block_whose_toe_slides_has_no_equilibrium_on_the_way(monkeypatch):
    """Its friction is too small to rock about the toe, whose bond bears the rest.

    As the bond weakens the block comes down and slides, at a force of mu p W. In between there is
    no equilibrium at any load, and the path ends and names the toe; viscous bonds take the way.
    """
    monkeypatch.setattr("xper_fx.simulation.path._LEAST", 0.1)
    monkeypatch.setattr("xper_fx.bulk.augmented_lagrangian._STANDS", 5)
    simulation = xf.Simulation(block(0.7), 1.0, inertia=False, path=xf.GrowthControl())
    with pytest.raises(xf.ConvergenceError, match=r"The bond at \(0.825, 0.0625\) opens beyond"):
        for _ in simulation.steps(1.0):
            pass
    assert simulation.reaction(TOP)[0] == pytest.approx(ROCKING, rel=0.02)
    simulation = xf.Simulation(block(0.7, viscosity=0.2), 0.05, inertia=False, max_halvings=16)
    forces = [simulation.reaction(TOP)[0] for _ in simulation.steps(1.0)]
    assert forces[-1] == pytest.approx(0.7 * PRESSURE * WIDTH, rel=1e-6)
    assert max(forces) > 1.1 * forces[-1]
