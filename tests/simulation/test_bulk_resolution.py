# SPDX-License-Identifier: LGPL-3.0-or-later
"""The error of the bulk's stresses by recovery, against exact fields."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx.mesh import create_unit_cube
from mpi4py import MPI
from scenes import LEFT, RIGHT, box_bodies

from xper_fx.bodies.explode import explode
from xper_fx.forms.loads import InitialStress, PrescribedDisplacement, PrescribedVelocity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.scene.scene import Scene
from xper_fx.simulation.bulk_resolution import _energy, bulk_resolution
from xper_fx.simulation.simulation import Simulation

MATERIAL = LinearElastic(2.0, 0.3, 1.0)


def displaced(bodies, field, **interactions) -> Simulation:
    """A simulation whose nodes stand where a displacement field puts them."""
    simulation = Simulation(Scene(bodies, {1: MATERIAL}, **interactions), 1e-3)
    x = simulation.forms.V.tabulate_dof_coordinates().T
    nodal = np.array(field(x)[: simulation.bulk.dim]).T.ravel()
    simulation.state.displacement = simulation.bulk.unknowns.collect(nodal)
    simulation.state.forces = simulation.bulk.internal(simulation.state.displacement)
    return simulation


def bending(x):
    """u = (x y, -x^2 / 2): a beam bent to a circle, e_xx = y."""
    return np.array([x[0] * x[1], -0.5 * x[0] ** 2, 0.0 * x[0]])


@pytest.mark.parametrize("cells", [8, 16])
def test_bending_of_a_plate(cells):
    """Stress linear in y: the exact error of the nodal interpolant, which is of first order."""
    bodies = box_bodies((1.0, 1.0), (cells, cells), label=0)
    found = bulk_resolution(displaced(bodies, bending))
    # cell by cell, the error of e_xx = y and of the shear that interpolation makes
    mesh = bodies.mesh
    corners = mesh.geometry.x[mesh.geometry.dofmap][:, :, :2]
    exact = strained = 0.0
    young, nu = 2.0, 0.3
    lam, mu = young * nu / (1 + nu) / (1 - 2 * nu), young / 2 / (1 + nu)
    barycentric = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6.0
    for corner in corners:
        u = bending(corner.T)[:2].T
        edges = (corner[1:] - corner[0]).T
        gradient = (u[1:] - u[0]).T @ np.linalg.inv(edges)
        strain = 0.5 * (gradient + gradient.T)
        area = 0.5 * abs(np.linalg.det(edges))
        for weights in barycentric:
            true = np.diag([weights @ corner[:, 1], 0.0])
            for e, total in ((strain - true, "error"), (true, "energy")):
                value = area / 3.0 * (lam * np.trace(e) ** 2 + 2.0 * mu * np.sum(e * e))
                if total == "error":
                    exact += value
                else:
                    strained += value
    assert found == pytest.approx(np.sqrt(exact / strained), rel=0.25)


def test_energy_of_linear_stresses():
    """Of a pressure p: 3 (1 - 2 nu) p^2 / E; of a stress that is linear, by quadrature."""
    young, poisson = np.array([2.0]), np.array([0.3])
    pressure = np.broadcast_to(np.eye(3), (1, 4, 3, 3))
    expected = 3.0 * (1.0 - 0.6) / 2.0
    assert _energy(pressure, np.ones(1), young, poisson) == pytest.approx(expected)
    # a triangle whose s_xy is its first barycentric coordinate: int l^2 = 1 / 6 of its measure
    shear = np.zeros((1, 3, 3, 3))
    shear[0, 0, 0, 1] = shear[0, 0, 1, 0] = 1.0
    expected = 0.5 * 2.0 * (1.0 + 0.3) / 2.0 / 6.0
    assert _energy(shear, np.array([0.5]), young, poisson) == pytest.approx(expected)


def test_first_order_in_space():
    """Halving the cells halves the error, in 2D and 3D."""
    plane = [
        bulk_resolution(displaced(box_bodies((1.0, 1.0), (n, n), label=0), bending))
        for n in (6, 12)
    ]
    assert np.log2(plane[0] / plane[1]) == pytest.approx(1.0, abs=0.2)
    space = []
    for n in (3, 6):
        mesh = create_unit_cube(MPI.COMM_SELF, n, n, n)
        bodies = explode(mesh, np.zeros(mesh.topology.index_map(3).size_local, int))
        space.append(bulk_resolution(displaced(bodies, bending)))
    assert np.log2(space[0] / space[1]) == pytest.approx(1.0, abs=0.3)


def test_a_uniform_stress_is_resolved():
    simulation = displaced(box_bodies((1.0, 1.0), (3, 3), label=0), lambda x: 0.01 * x)
    assert bulk_resolution(simulation) < 1e-12
    assert bulk_resolution(displaced(box_bodies((1.0, 1.0), (2, 2), label=0), lambda x: 0 * x)) == 0


def test_a_stress_that_was_there_before_is_not_the_meshs():
    """Given exactly, it neither counts as resolved energy nor as an error of the mesh."""
    bodies = box_bodies((1.0, 1.0), (4, 4), label=0)
    given = InitialStress(lambda x: np.array([[3.0 + x[1], 0 * x[1]], [0 * x[1], x[0]]]))
    found = bulk_resolution(displaced(bodies, bending, loads=[given]))
    assert found > 0.1
    assert found == pytest.approx(bulk_resolution(displaced(bodies, bending)), rel=1e-12)


def test_stresses_jump_across_cracks_and_contacts_but_not_across_bonds():
    """Two halves with other uniform stresses: resolved if nothing joins them."""

    def field(x):
        return np.array([0.01 * np.abs(x[0] - 0.5), 0.0 * x[0], 0.0 * x[0]])

    def halves(law):
        bodies = box_bodies((1.0, 1.0), (4, 4), label=lambda x: x[0] > 0.5)
        return displaced(bodies, field, default_interaction=law)

    assert bulk_resolution(halves(SignoriniCoulomb())) < 1e-12
    bonded = halves(CohesiveZone(1e3, 1e-2, 1e-1))
    assert bulk_resolution(bonded) > 0.1
    spent = bonded.interactions.groups[0]
    spent.state[:, spent.kernels.state_names.index("damage")] = 0.0
    assert bulk_resolution(bonded) < 1e-12


def test_where_it_does_not_hold_there_is_none():
    """Order 2 and quadrilaterals; a run of them is judged without."""
    for bodies, order in (
        (box_bodies((1.0, 1.0), (2, 2), "quadrilateral", 0), 1),
        (box_bodies((1.0, 1.0), (2, 2), label=0), 2),
    ):
        loads = [PrescribedDisplacement(LEFT, i, 0.0) for i in (0, 1)]
        scene = Scene(
            bodies, {1: MATERIAL}, loads=[*loads, PrescribedVelocity(RIGHT, 0, 0.1)], order=order
        )
        simulation = Simulation(scene, accuracy=0.1)
        list(simulation.steps(0.1))
        assert bulk_resolution(simulation) is None
        assert simulation.verdict().bulk is None


def test_a_body_in_flight_has_no_stress_to_resolve():
    """What rounding leaves of stresses differs from cell to cell by all of it."""
    bodies = box_bodies((1.0, 1.0), (4, 4), label=0)
    thrown = lambda x: np.outer([1.0, 0.3], np.ones(x.shape[1]))  # noqa: E731
    simulation = Simulation(Scene(bodies, {1: MATERIAL}, initial_velocity=thrown), 1e-2)
    list(simulation.steps(1.7))
    assert simulation.ledger.energies.elastic != 0.0
    assert bulk_resolution(simulation) == 0.0
