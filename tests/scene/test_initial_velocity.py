# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initial velocities that are DOLFINx functions."""

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle
from mpi4py import MPI

import xper_fx as xf


def made(mesh, initial_velocity):
    law = xf.laws.CohesiveZone(1e12, fracture_energy=10.0, strength=1e6)
    steel = xf.materials.LinearElastic(young=1e9, poisson=0.3, density=1000.0)
    scene = xf.Scene(
        xf.explode(mesh), {1: steel}, default_interaction=law, initial_velocity=initial_velocity
    )
    return xf.Simulation(scene, comm=MPI.COMM_SELF)


def meshes():
    yield create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (2.0, 1.0)], (3, 2))
    corners = [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)]
    yield create_box(MPI.COMM_SELF, corners, (2, 1, 1), CellType.tetrahedron)


@pytest.mark.parametrize("mesh", meshes(), ids=["2d", "3d"])
def test_a_dolfinx_function_gives_what_its_expression_gives(mesh):
    dim = mesh.topology.dim

    def field(x):
        return np.stack([0.1 + x[1], 2.0 * x[0] - x[1], x[2] + x[0]])[:dim]

    function = fem.Function(fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
    function.interpolate(field)
    wanted = made(mesh, field).state.velocity
    assert np.abs(wanted).max() > 1.0
    for given in (function, {1: function}):
        found = made(mesh, given).state.velocity
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-14)


def test_a_function_with_other_components_is_refused():
    mesh = create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (2.0, 1.0)], (3, 2))
    scalar = fem.Function(fem.functionspace(mesh, ("Lagrange", 1)))
    with pytest.raises(ValueError, match="2 components.*this function has 1"):
        made(mesh, scalar)


def test_a_function_of_a_mesh_that_is_too_small_is_refused():
    small = create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (1.0, 1.0)], (1, 1))
    mesh = create_rectangle(MPI.COMM_SELF, [(0.0, 0.0), (2.0, 1.0)], (3, 2))
    function = fem.Function(fem.functionspace(small, ("Lagrange", 1, (2,))))
    with pytest.raises(ValueError, match="not finite at"):
        made(mesh, function)
