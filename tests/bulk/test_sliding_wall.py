# SPDX-License-Identifier: LGPL-3.0-or-later
"""A wall of dry bricks that is pressed and pushed until it slides: its steps are hardly cut."""

import numpy as np
from dolfinx.mesh import CellType, create_box
from scenes import BOTTOM, COMM, TOP

import xper_fx as xf

BRICK, FRICTION, YOUNG = np.array([0.25, 0.12, 0.1]), 0.7, 10e9


def wall(courses, bricks):
    """Running bond of meshed bricks, pressed by 5e-5 in 0.1 s and then pushed by 1 mm in 0.9 s."""
    size = BRICK * (bricks, 1, courses)
    mesh = create_box(COMM, [np.zeros(3), size], [2 * bricks, 1, courses], CellType.hexahedron)
    x = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)
    course = np.floor(x[:, 2] / BRICK[2]).astype(int)
    brick = np.floor(x[:, 0] / BRICK[0] + 0.5 * (course % 2)).astype(int)
    sides = {BOTTOM: lambda x: x[2] < 1e-9, TOP: lambda x: x[2] > size[2] - 1e-9}
    tags = xf.tag_facets(mesh, sides)
    loads = [xf.PrescribedDisplacement(BOTTOM, i, 0.0) for i in range(3)]
    loads += [
        xf.PrescribedDisplacement(TOP, 0, lambda t: 1e-3 * max(t - 0.1, 0.0) / 0.9),
        xf.PrescribedDisplacement(TOP, 2, lambda t: -5e-5 * size[2] * min(t / 0.1, 1.0)),
    ]
    return xf.Scene(
        xf.explode(mesh, 100 * course + brick, facet_tags=tags),
        {1: xf.materials.LinearElastic(YOUNG, 0.2, 2000.0)},
        default_interaction=xf.laws.SignoriniCoulomb(FRICTION, contact="position"),
        loads=loads,
    )


def test_a_wall_that_slides_as_friction_says():
    """From rest all lips would stick: where that leads in circles, they slide on as before."""
    simulation = xf.Simulation(wall(4, 3), 0.05, inertia=False, num_threads=1)
    pushed, _, pressed = np.array([simulation.reaction(TOP) for _ in simulation.steps(0.5)]).T
    assert len(pushed) < 20
    np.testing.assert_allclose(pushed[-1], -FRICTION * pressed[-1], rtol=1e-4)
