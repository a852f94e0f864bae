# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces of linear simplices, cell by cell, are those of the assembled stiffness."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box, create_rectangle
from mpi4py import MPI
from scenes import box_bodies

from xper_fx.bodies.explode import explode
from xper_fx.bulk.cell_forces import CellForces
from xper_fx.forms.loads import RayleighDamping
from xper_fx.materials import LinearElastic, Orthotropic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

SIZE = {2: (1.3, 0.7), 3: (1.3, 0.7, 0.9)}


def uneven(dim, cells):
    """Simplices of a box whose nodes are moved about, each a body."""
    corners = [np.zeros(dim), np.array(SIZE[dim])]
    make, kind = {
        2: (create_rectangle, CellType.triangle), 3: (create_box, CellType.tetrahedron)
    }[dim]  # fmt: skip
    mesh = make(MPI.COMM_SELF, corners, (cells,) * dim, kind)
    rng = np.random.default_rng(1)
    mesh.geometry.x[:, :dim] += 0.2 / cells * rng.uniform(-1.0, 1.0, (len(mesh.geometry.x), dim))
    return explode(mesh)


def bulk_of(bodies, material, damping=None, **options):
    law = SignoriniCoulomb(0.0)
    scene = Scene(bodies, {1: material}, default_interaction=law, damping=damping)
    return Simulation(scene, 1e-4, **options).bulk


@pytest.mark.parametrize(
    "dim, material",
    [
        (2, LinearElastic(100.0, 0.3, 1.0)),
        (3, LinearElastic(100.0, 0.3, 1.0)),
        (3, Orthotropic((100.0, 30.0, 10.0), (0.2, 0.1, 0.3), (20.0, 5.0, 8.0), 1.0)),
    ],
    ids=["plane", "space", "orthotropic"],
)
def test_forces_are_those_of_the_stiffness(dim, material):
    """On uneven cells, which no symmetry helps; a motion as a whole gives none."""
    bulk = bulk_of(uneven(dim, 4), material)
    forces = CellForces.of(bulk.stiffness, bulk.forms.V)
    u = np.random.default_rng(2).standard_normal(bulk.num_dofs)
    expected = bulk.stiffness.to_scipy() @ u
    np.testing.assert_allclose(forces(u), expected, atol=1e-12 * np.abs(expected).max())
    x = bulk.forms.V.tabulate_dof_coordinates()[:, :dim]
    spin = np.zeros((dim, dim))
    spin[0, 1], spin[1, 0] = 1.0, -1.0
    rigid = (x @ spin + 3.0).ravel()
    assert np.abs(forces(rigid)).max() < 1e-13 * np.abs(bulk.stiffness.data).max()


@pytest.mark.parametrize(
    "kind, label",
    [("quadrilateral", None), ("crossed", 0), ("crossed", lambda x: np.arange(x.shape[1]) // 2)],
    ids=["quadrilaterals", "one body", "pairs"],
)
def test_other_bodies_keep_their_matrix(kind, label):
    bulk = bulk_of(box_bodies((1, 1), (2, 2), kind, label), LinearElastic(100.0, 0.3, 1.0))
    assert CellForces.of(bulk.stiffness, bulk.forms.V) is None


@pytest.mark.parametrize("damping", [None, RayleighDamping(stiffness=1e-3)], ids=["", "damped"])
def test_an_explicit_bulk_holds_no_matrix_for_its_forces(damping):
    """K has 36 numbers and 9 indices a triangle, gradients and moduli are 10, and 3 nodes."""
    bodies, material = box_bodies((1, 1), (8, 8)), LinearElastic(100.0, 0.3, 1.0)
    implicit, explicit = (
        bulk_of(bodies, material, damping, scheme=s) for s in ("implicit", "explicit")
    )
    assert explicit.critical_step() == implicit.critical_step()
    u = np.random.default_rng(3).standard_normal(implicit.num_dofs)
    expected = implicit.internal(u)
    np.testing.assert_allclose(explicit.internal(u), expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(explicit.viscous(u), implicit.viscous(u), rtol=1e-12)
    if damping is None:
        matrix = implicit.nbytes - implicit.weights.nbytes
        assert explicit.nbytes - explicit.weights.nbytes < 0.3 * matrix
