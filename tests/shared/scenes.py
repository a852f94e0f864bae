# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small scenes that the system tests share."""

from __future__ import annotations

import numpy as np
from dolfinx.mesh import CellType, create_box, create_rectangle
from mpi4py import MPI

from xper_fx.bodies.explode import EACH_CELL, Bodies, explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import crossed_rectangle, tag_cells, tag_facets

COMM = MPI.COMM_SELF
LEFT, RIGHT, BOTTOM, TOP, BACK, FRONT = 1, 2, 3, 4, 5, 6
# Solver options for tests that compare to rounding.
EXACT = {"tolerance": 1e-13, "num_threads": 1}


def mesh_of(lengths, cells, kind: str = "crossed"):
    """Rectangle or box from the origin: "crossed", or a DOLFINx cell type."""
    lengths, cells = tuple(map(float, lengths)), tuple(cells)
    if kind == "crossed":
        return crossed_rectangle((0.0, 0.0), lengths, cells, COMM)
    corners = [np.zeros(len(lengths)), np.array(lengths)]
    create = create_rectangle if len(lengths) == 2 else create_box
    return create(COMM, corners, cells, getattr(CellType, kind))


def unmatched_plates():
    """Two unit plates side by side whose nodes on x = 1 do not match; 7 and 8 are tagged there."""
    meshes = [mesh_of((1.0, 1.0), (n, n)) for n in (2, 3)]
    meshes[1].geometry.x[:, 0] += 1.0
    tags = [
        tag_facets(mesh, {tag: lambda x: np.abs(x[0] - 1.0) < 1e-9})
        for mesh, tag in zip(meshes, (7, 8), strict=True)
    ]
    return join_meshes(meshes, facet_tags=tags)


def side_tags(mesh, lengths, interior=None):
    """Tags of the sides, LEFT to FRONT, and those of `interior`."""
    predicates = dict(interior or {})
    for axis, length in enumerate(lengths):
        for end, value in enumerate((0.0, length)):
            predicates[1 + 2 * axis + end] = lambda x, axis=axis, value=value, size=max(lengths): (
                np.abs(x[axis] - value) < 1e-9 * size
            )
    return tag_facets(mesh, predicates)


def box_bodies(lengths, cells, kind="crossed", label=None, material=None, interior=None) -> Bodies:
    """Bodies of a box with its sides tagged.

    Args:
        lengths, cells, kind: of the mesh.
        label: function of cell midpoints, shape (3, n), giving body labels; each cell a body
            without it, one body for a number.
        material: predicates of cell tags; tag 1 is the default.
        interior: predicates of facet tags from 7 on.
    """
    mesh = mesh_of(lengths, cells, kind)
    count = mesh.topology.index_map(mesh.topology.dim).size_local
    bodies = EACH_CELL
    if callable(label):
        bodies = label(midpoints(mesh)).astype(int)[:count]  # without those of other ranks
    elif label is not None:
        bodies = np.full(count, label)
    cell_tags = tag_cells(mesh, material or {})
    return explode(mesh, bodies, cell_tags, side_tags(mesh, lengths, interior))


def midpoints(mesh) -> np.ndarray:
    """Midpoints of the cells, shape (3, num_cells)."""
    from xper_fx.support.compat import geometry_dofmap

    return mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1).T


def run(simulation, steps: int) -> list:
    """Make `steps` steps; their records."""
    return list(simulation.steps(simulation.time + steps * simulation.step_size))


def nodes(simulation) -> np.ndarray:
    """Coordinates of the nodes, shape (num_nodes, dim)."""
    return simulation.forms.V.tabulate_dof_coordinates()[:, : simulation.bulk.dim]


def field(simulation, name: str = "displacement") -> np.ndarray:
    """A state vector by nodes, shape (num_nodes, dim)."""
    return getattr(simulation.state, name).reshape(-1, simulation.bulk.dim)
