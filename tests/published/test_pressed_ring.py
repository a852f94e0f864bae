# SPDX-License-Identifier: LGPL-3.0-or-later
"""A thin ring that two smooth plates press, static, against the elastica.

By symmetry a quarter is computed: its side moves up against a wall. The middle line of an
inextensible ring of radius 1 has, at the arc length s from the plate, the angle phi and the place
(x, y), and with the force f = F R^2 / (E' I) of each plate the moments balance as

    phi' = -(k + f x / 2),   x' = cos phi,   y' = sin phi,   phi(pi / 2) = -pi / 2,

with k the curvature at the plate. The plates touch at a line each while k > 0, f < 2.79.
"""

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import xper_fx as xf

THICKNESS, YOUNG, POISSON = 0.05, 1e6, 0.3  # of the radius; Pa
BENDING = YOUNG / (1.0 - POISSON**2) * THICKNESS**3 / 12.0
TOP, SIDE, OUTER = 1, 2, 3


def elastica(approach):
    """f and k of the ring whose plates have each come nearer to the middle by `approach`."""

    def misses(unknowns):
        f, k = unknowns
        curve = solve_ivp(
            lambda s, y: (np.cos(y[2]), np.sin(y[2]), -k - 0.5 * f * y[0]),
            (0.0, 0.5 * np.pi), np.zeros(3), rtol=1e-9, atol=1e-10,
        )  # fmt: skip
        _, y, phi = curve.y[:, -1]
        return phi + 0.5 * np.pi, 1.0 + y - approach

    return fsolve(misses, (10.0 * approach, 1.0 - 3.0 * approach))


@pytest.mark.slow
def test_force_is_that_of_the_elastica_until_the_ring_is_flat_at_the_plate():
    cells = 16
    mesh = create_rectangle(
        MPI.COMM_SELF, [(0.0, -0.5), (1.0, 0.5)], [cells, 1], CellType.quadrilateral
    )
    x = mesh.geometry.x
    angle, radius = 0.5 * np.pi * x[:, 0], 1.0 + THICKNESS * x[:, 1]
    x[:, 0], x[:, 1] = radius * np.sin(angle), radius * np.cos(angle)
    places = {
        TOP: lambda x: abs(x[0]) < 1e-9,
        SIDE: lambda x: abs(x[1]) < 1e-9,
        OUTER: lambda x: np.hypot(x[0], x[1]) > 1.0 + 0.4 * THICKNESS,
    }
    law = xf.laws.SignoriniCoulomb(friction=0.0, contact="position")
    scene = xf.Scene(
        xf.explode(mesh, np.zeros(cells, int), facet_tags=xf.tag_facets(mesh, places)),
        {1: xf.materials.NeoHookean(young=YOUNG, poisson=POISSON, density=1.0)},
        walls=[xf.Wall(OUTER, (0.0, 1.0 + 0.5 * THICKNESS), (0.0, -1.0), law)],
        loads=[
            xf.PrescribedDisplacement(TOP, 0, 0.0),
            xf.PrescribedDisplacement(SIDE, 1, lambda t: t),
        ],
        order=2,
    )
    simulation = xf.Simulation(scene, 0.05, inertia=False, tolerance=1e-6)
    for step in simulation.steps(0.25):
        force = 2.0 * simulation.reaction(SIDE)[1] / BENDING
        f, k = elastica(step.time)
        assert k > 0.0
        assert force == pytest.approx(f, rel=4e-3)
