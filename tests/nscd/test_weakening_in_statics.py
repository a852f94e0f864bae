# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slip weakening and Mohr-Coulomb's joints in static runs, along paths too."""

from __future__ import annotations

import numpy as np
import pytest
from point_mass import PointMass

import xper_fx as xf

LENGTH, HEIGHT, PRESSURE = 0.1, 0.02, 1e6
MU_S, MU_D, DISTANCE, COHESION, TENSION = 0.7, 0.4, 1e-3, 5e5, 3e5
BELOW, ABOVE = 1, 2


def fault(contact="position"):
    return xf.laws.SlipWeakening(MU_S, MU_D, DISTANCE, contact=contact)


def joint(contact="position", tension=TENSION):
    return xf.laws.MohrCoulomb(MU_S, COHESION, tension, DISTANCE, MU_D, contact=contact)


def shear_box(law, young, height, path, size, end, slip=lambda t: t):
    """Rows of time and mean shear (Pa), and the run: the block above is pushed aside."""
    mesh = xf.crossed_rectangle((0, -height), (LENGTH, height), (10, 4))
    tags = xf.tag_facets(
        mesh,
        {
            BELOW: lambda x: x[1] < (1e-9 - 1.0) * height,
            ABOVE: lambda x: x[1] > (1.0 - 1e-9) * height,
        },
    )
    above = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0
    loads = [
        *(xf.PrescribedDisplacement(BELOW, k, 0.0) for k in (0, 1)),
        xf.SurfaceTraction(ABOVE, (0.0, -PRESSURE)),
        xf.PrescribedDisplacement(ABOVE, 0, slip),
    ]
    scene = xf.Scene(
        xf.explode(mesh, above.astype(int), facet_tags=tags),
        {1: xf.materials.LinearElastic(young, 0.2, 2000.0)},
        default_interaction=law,
        loads=loads,
    )
    simulation = xf.Simulation(scene, size, inertia=False, path=path)
    rows = [(s.time, simulation.reaction(ABOVE)[0] / LENGTH) for s in simulation.steps(end)]
    return np.array(rows), simulation


def strength(slip, cohesion):
    left = np.maximum(1.0 - slip / DISTANCE, 0.0)
    return (MU_D + (MU_S - MU_D) * left) * PRESSURE + cohesion * left


@pytest.mark.parametrize(("law", "cohesion"), [(fault(), 0.0), (joint(), COHESION)])
@pytest.mark.parametrize(
    ("path", "fro"), [(None, 0.6), (xf.GrowthControl(), 2.0)], ids=["load", "path"]
)
def test_stiff_blocks_shear_along_the_curve(law, cohesion, path, fro):
    """Blocks that hardly deform slip as one, to and fro: all points are where the curve is."""

    def slip(t):
        return DISTANCE * np.interp(t, [0.0, fro, 3.0], [0.0, fro, 2.0 * fro - 3.0])

    rows, run = shear_box(law, 1e13, 0.1 * HEIGHT, path, 0.05, 1.4, slip)
    rows[:, 0] *= DISTANCE
    way = np.where(rows[:, 0] < (fro + 0.01) * DISTANCE, 1.0, -1.0)
    assert rows[:, 1] == pytest.approx(way * strength(rows[:, 0], cohesion), rel=1e-3)
    assert len(rows) > 15 and rows[-1, 1] == pytest.approx(way[-1] * MU_D * PRESSURE, rel=1e-6)
    energies = run.ledger.energies
    # pulled points have less of cohesion, by their friction: both are what the curve takes
    spent = 0.5 * (cohesion + (MU_S - MU_D) * PRESSURE) * DISTANCE
    total = LENGTH * (MU_D * PRESSURE * rows[-1, 0] + spent)
    taken = energies.dissipated_cohesion + energies.dissipated_friction
    assert taken == pytest.approx(total, rel=2e-3)
    assert (energies.dissipated_cohesion > 0.4 * cohesion * DISTANCE * LENGTH) == (cohesion > 0.0)


def test_growth_is_that_of_the_slip():
    """The first step ends at the peak, but for a slip of 0.3 x 0.005 D; then growth is of D.

    The block is stiff, so that its joint slips as a whole: it bears c + mu p less what that slip
    takes, and the next step goes on by a share of D.
    """
    path = xf.GrowthControl(longest=1.0)
    law = joint()
    rows, _ = shear_box(law, 1e13, 0.1 * HEIGHT, path, 0.05, 1.5, lambda t: DISTANCE * t)
    assert rows[0, 0] == pytest.approx(0.0015, rel=5e-3)
    assert rows[0, 1] == pytest.approx(strength(0.0015 * DISTANCE, law.cohesion), rel=1e-3)
    assert rows[1, 0] > 50.0 * rows[0, 0]


@pytest.mark.parametrize("pressure", [0.2e6, 1e6])
def test_bricks_that_slide_as_a_whole_pass_their_peak(pressure):
    """The middle one of three bricks: 2 H (c + mu p), 1.5 % less as joints slip from their ends.

    Without a bound of what slips first a path's largest load was 163 of 200 kN/m.
    """
    width, height, cohesion, mu = 0.05, 0.2, 0.35e6, 0.75
    mesh = xf.crossed_rectangle((0, 0), (3 * width, height), (6, 8))
    x = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 0]
    tags = xf.tag_facets(
        mesh,
        {
            1: lambda x: x[0] < 1e-9,
            2: lambda x: x[0] > 3 * width - 1e-9,
            3: lambda x: (x[1] < 1e-9) & (abs(x[0] - 1.5 * width) > 0.5 * width - 1e-9),
            4: lambda x: (x[1] > height - 1e-9) & (abs(x[0] - 1.5 * width) < 0.5 * width + 1e-9),
        },
    )
    loads = [
        xf.PrescribedDisplacement(1, 0, 0.0),
        xf.PrescribedDisplacement(3, 1, 0.0),
        xf.SurfaceTraction(2, lambda t: (-pressure * min(t, 1.0), 0.0)),
        xf.PrescribedDisplacement(4, 1, lambda t: -1e-3 * max(t - 1.0, 0.0)),
    ]
    scene = xf.Scene(
        xf.explode(mesh, (x / width).astype(int), facet_tags=tags),
        {1: xf.materials.LinearElastic(15e9, 0.2, 2000.0)},
        default_interaction=xf.laws.MohrCoulomb(mu, cohesion, 0.25e6, 0.3e-3, mu),
        loads=loads,
    )
    simulation = xf.Simulation(scene, 0.02, inertia=False, path=xf.GrowthControl())
    pushes = np.array([-simulation.reaction(4)[1] for _ in simulation.steps(2.0)])
    assert 0.98 < pushes.max() / (2.0 * height * (cohesion + mu * pressure)) < 1.0
    assert pushes[-1] == pytest.approx(2.0 * height * mu * pressure, rel=1e-4)
    assert len(pushes) < 30


@pytest.mark.parametrize("contact", ["position", "velocity"])
@pytest.mark.parametrize("path", [None, xf.GrowthControl()], ids=["load", "path"])
@pytest.mark.parametrize("law", [fault, joint])
def test_soft_blocks_come_down_to_residual_friction(law, path, contact, caplog):
    """The joint parts at the edge that lifts, where its tension is lost at once."""
    rows, run = shear_box(law(contact), 1e9, HEIGHT, path, 1e-4, 1.8e-3)
    assert rows[-1, 1] == pytest.approx(MU_D * PRESSURE, rel=1e-4)
    assert run.step_number < 30 and run.ledger.closure == pytest.approx(0.0, abs=1e-6)
    assert np.all(np.diff(rows[:, 0]) > 0.0)
    peak = rows[:, 1].max() / PRESSURE
    assert (0.6 < peak < 0.7) if law is fault else (0.9 < peak < 1.1)
    assert not caplog.records


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("tension", [0.0, TENSION])
def test_a_point_holds_what_its_cone_lets_it(dim, tension):
    direction = np.array([1.0]) if dim == 2 else np.array([0.6, -0.8])
    area, law = 0.02, joint(tension=tension).in_statics()
    for pull in (-2e4, 0.5 * tension * area):
        shear = COHESION * area - MU_S * pull
        for share in (0.999, 1.001):
            point = PointMass(law, 100.0, np.zeros(dim), area=area, theta=1.0)
            for _ in range(20):
                point.step(1e-3, np.array([pull, *(share * shear * direction)]))
            assert (point.damage > 1.0 - 1e-12) == (share < 1.0)
            assert (np.abs(point.velocity).max() < 1e-9) == (share < 1.0)
    parts = PointMass(law, 100.0, np.zeros(dim), area=area, theta=1.0)
    for _ in range(5):
        parts.step(1e-3, np.array([1.01 * tension * area + 1.0, *(0.1 * MU_S * 1e4 * direction)]))
    assert parts.damage == 0.0 and np.abs(parts.impulse).max() < 1e-12
