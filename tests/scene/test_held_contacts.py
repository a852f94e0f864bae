# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts between nodes that are held on both sides bear nothing, and spoil nothing."""

import numpy as np
import pytest

import xper_fx as xf

WEIGHT = 9.81 * 2000.0


def two_and_one(dim, where, lower=0.0, into=0.0):
    """Blocks of 0.4 x 0.2 side by side, held below, and a third across both, of depth 0.4 in 3D.

    The foot of the second one lies lower, and lies in the first one, by as much as meshers leave.
    """
    corners = [(0.0, 0.0), (0.4, 0.0), (0.2, 0.2)]
    if dim == 2:
        meshes = [
            xf.crossed_rectangle((x + where, y), (x + 0.4 + where, y + 0.2), (4, 2))
            for x, y in corners
        ]
    else:
        from dolfinx.mesh import CellType, create_box
        from mpi4py import MPI

        meshes = [
            create_box(
                MPI.COMM_WORLD, [[x + where, 0.0, y], [x + 0.4 + where, 0.4, y + 0.2]], [4, 2, 2],
                CellType.tetrahedron,
            )
            for x, y in corners
        ]  # fmt: skip
    x = meshes[1].geometry.x
    x[:, 0] -= into
    x[x[:, dim - 1] < 1e-9, dim - 1] -= lower
    below = [xf.tag_facets(mesh, {1: lambda x: x[dim - 1] < 1e-9}) for mesh in meshes[:2]]
    joined = xf.join_meshes(meshes, facet_tags=[*below, None])
    return xf.explode(joined.mesh, joined.part, joined.cell_tags, joined.facet_tags)


@pytest.mark.parametrize(
    ("dim", "where", "apart", "solver"),
    [
        (2, 0.0, (), "auto"), (2, 3e3, (), "auto"), (3, 0.0, (), "auto"),
        (2, 0.0, (1e-8, 1e-10), "auto"), (2, 0.0, (1e-6, 1e-9), "auto"),
        (2, 0.0, (1e-8, 1e-10), "monolithic"),
    ],
)  # fmt: skip
def test_blocks_held_side_by_side(dim, where, apart, solver):
    """Nodes of both feet lie in each other's facets but for a rounding: a compliance of rounding
    squared had an impulse of 1e18 N, beside which all other contacts counted as solved.
    """
    law = xf.laws.SignoriniCoulomb(friction=0.6, contact="position")
    down = np.eye(dim)[dim - 1]
    scene = xf.Scene(
        two_and_one(dim, where, *apart),
        {1: xf.materials.LinearElastic(young=5e9, poisson=0.2, density=2000.0)},
        surfaces={"blocks": (1,)},
        contacts=[xf.Contact(("blocks", "blocks"), law)],
        loads=[
            xf.Gravity(tuple(-9.81 * down)),
            *(xf.PrescribedDisplacement(1, component, 0.0) for component in range(dim)),
        ],
    )
    simulation = xf.Simulation(scene, step=1e-3, theta=1.0, solver=solver, tolerance=1e-6)
    *_, step = simulation.steps(0.06)
    volume = 3 * 0.08 * 0.4 ** (dim - 2)
    assert simulation.reaction(1) @ down == pytest.approx(WEIGHT * volume, rel=1e-2)
    found = xf.output.find_contact_forces(simulation)
    upper = (found.bodies == 2).any(axis=1)
    carried = np.abs(found.force[upper] @ down).sum()
    assert carried == pytest.approx(WEIGHT * volume / 3, rel=1e-2)
    assert np.abs(found.force).max() < carried
    assert abs(step.energies["dissipated_impact"]) < 0.05 * step.energies["elastic"]


def test_bodies_that_fall_into_each_other_are_told(caplog):
    """A block is pressed on another one while its top is moved aside: a load of 1e5 Pa moves it by
    0.1 m in a step of 10 ms in which no point holds it."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (0.1, 0.1), (8, 8))
    middle = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 1] > 0.05
    sides = {1: lambda x: x[1] < 1e-9, 2: lambda x: x[1] > 0.1 - 1e-9}
    loads = [xf.PrescribedDisplacement(1, axis, 0.0) for axis in (0, 1)]
    loads.append(xf.PrescribedDisplacement(2, 0, lambda t: 1e-3 * t))
    scene = xf.Scene(
        xf.explode(mesh, middle.astype(int), facet_tags=xf.tag_facets(mesh, sides)),
        {1: xf.materials.LinearElastic(young=1e9, poisson=0.2, density=2000.0)},
        default_interaction=xf.laws.SlipWeakening(0.8, 0.5, 1e-4),
        loads=[*loads, xf.SurfaceTraction(2, (0.0, -1e5))],
    )
    simulation = xf.Simulation(scene, 1e-2, theta=1.0)
    gaps = [simulation.interactions.gather("jump")[:, 0].min() for _ in simulation.steps(0.25)]
    told = [record.message for record in caplog.records]
    assert min(gaps) < -1e-3
    assert any("moved into each other" in line and "contact" in line for line in told)
