# SPDX-License-Identifier: LGPL-3.0-or-later
"""The differences between DOLFINx 0.9, 0.10 and 0.11, and the few private calls, in one place."""

from __future__ import annotations

import signal
import threading
from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import cpp as _cpp
from dolfinx.fem import CoordinateElement
from dolfinx.mesh import Mesh, MeshTags
from mpi4py import MPI

# PETSc takes a closed pipe for a crash, and aborts. Python's own answer is a BrokenPipeError.
if threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGPIPE, signal.getsignal(signal.SIGPIPE))


def geometry_dofmap(mesh: Mesh) -> npt.NDArray[np.int32]:
    """Return the geometry nodes of each cell, shape (num_cells, num_nodes_per_cell), int32.

    `Geometry.dofmap` up to 0.10, `Geometry.dofmaps[0]` from 0.11 on.
    """
    geometry = mesh.geometry
    if hasattr(geometry, "dofmaps"):
        return geometry.dofmaps[0]
    return geometry.dofmap


def coordinate_element(mesh: Mesh) -> CoordinateElement:
    """Return the element of the geometry.

    `Geometry.cmap` up to 0.10, `Geometry.cmaps[0]` from 0.11 on.
    """
    geometry = mesh.geometry
    if hasattr(geometry, "cmaps"):
        return geometry.cmaps[0]
    return geometry.cmap


def interpolation_points(element: Any) -> npt.NDArray[np.floating]:
    """Return the interpolation points of `V.element`, shape (num_points, topological dimension).

    A method up to 0.9, a property from 0.10 on.
    """
    points = element.interpolation_points
    return points() if callable(points) else points


def original_cells(mesh: Mesh) -> npt.NDArray[np.int64]:
    """Return the numbers of a rank's cells in what the mesh was made from, shape (num_cells,).

    Submeshes have none, and DOLFINx raises: theirs are those of the cells of all ranks.
    """
    try:
        return mesh.topology.original_cell_index
    except RuntimeError:
        cells = mesh.topology.index_map(mesh.topology.dim)
        return cells.local_to_global(np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32))


def create_exploded_mesh(
    parent: Mesh,
    cells: npt.NDArray[np.int64],
    x: npt.NDArray[np.floating],
    numbers: npt.NDArray[np.int64] | None = None,
) -> Mesh:
    """Build a first-order mesh on one process with its cells in the given order, in O(n).

    `mesh.create_mesh` reorders the cells along their dual graph; where most cells share no facet
    that graph is nearly empty and the reordering takes O(n^2). So the topology and the geometry
    are built by the calls `create_mesh` itself makes, which the Python layer keeps private.

    Args:
        parent: the mesh that gives cell type and coordinate element.
        cells: the nodes of each cell, shape (num_cells, num_vertices_per_cell); every node in
            0, ..., num_nodes - 1 is used.
        x: coordinates, shape (num_nodes, geometric dimension), m.
        numbers: what `topology.original_cell_index` has; those here if not given.

    Returns:
        The mesh; `geometry.input_global_indices` gives the row of `x` of each geometry node.
    """
    dtype = parent.geometry.x.dtype
    cells = np.ascontiguousarray(cells, dtype=np.int64)
    # nanobind turns lists of Python integers into vectors faster than it does arrays
    arguments = (
        MPI.COMM_SELF,
        [parent.topology.cell_type],
        [cells.ravel().tolist()],
        [list(range(len(cells))) if numbers is None else numbers.tolist()],
        [[]],
        [],
    )
    try:
        topology = _cpp.mesh.create_topology(*arguments)
    except TypeError:  # later versions also take the number of threads
        topology = _cpp.mesh.create_topology(*arguments, 1)
    geometry = _cpp.mesh.create_geometry(
        topology,
        [coordinate_element(parent)._cpp_object],
        np.arange(len(x), dtype=np.int64),
        cells.ravel(),
        np.ascontiguousarray(x, dtype=dtype).ravel(),
        x.shape[1],
    )
    mesh_type = _cpp.mesh.Mesh_float64 if dtype == np.float64 else _cpp.mesh.Mesh_float32
    # forms ask that the domain's element is the geometry's, its variant included (0.11)
    domain = ufl.Mesh(parent.ufl_domain().ufl_coordinate_element())
    return Mesh(mesh_type(MPI.COMM_SELF, topology, geometry), domain)


def gmsh_model_to_mesh(
    model: Any, comm: MPI.Comm, dim: int
) -> tuple[Mesh, MeshTags | None, MeshTags | None]:
    """Turn a Gmsh model into a mesh, its cell tags and its facet tags.

    `io.gmshio.model_to_mesh` gives a tuple in 0.9, `io.gmsh.model_to_mesh` a named tuple with
    more fields from 0.10 on.
    """
    try:
        from dolfinx.io import gmsh as gmsh_io
    except ImportError:
        from dolfinx.io import gmshio as gmsh_io
    data = gmsh_io.model_to_mesh(model, comm, 0, gdim=dim)
    if isinstance(data, tuple) and not hasattr(data, "cell_tags"):
        return data
    return data.mesh, data.cell_tags, data.facet_tags
