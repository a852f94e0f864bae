# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic cells that the tests of `xper_fx.periodic` share."""

from __future__ import annotations

from collections.abc import Callable

import basix.ufl
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem
from dolfinx.mesh import create_mesh
from scenes import COMM, mesh_of, midpoints

from xper_fx.bodies.explode import EACH_CELL, Bodies, explode
from xper_fx.bodies.meshes import tag_cells, tag_facets
from xper_fx.forms.compiled import compiled_form
from xper_fx.nscd.facets import facet_points
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.periodic.two_field import CellBulk
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

ONE = 0
"""The label of a cell that is one body."""
VOID = 77
"""Facet tag of voids."""
EXACT = {"tolerance": 1e-12, "newton_tolerance": 1e-13, "num_threads": 1}


def mesh_from(cells: np.ndarray, x: np.ndarray, kind: str, comm=COMM):
    """First-order mesh of given cells, the first rank's; nodes that no cell names are left out."""
    if comm.rank > 0:
        cells, x = cells[:0], x[:0]
    used, cells = np.unique(cells, return_inverse=True)
    element = basix.ufl.element("Lagrange", kind, 1, shape=(x.shape[1],))
    cells = cells.reshape(-1, geometry_length(kind)).astype(np.int64)
    return create_mesh(comm, cells=cells, x=x[used], e=ufl.Mesh(element))


def geometry_length(kind: str) -> int:
    """Vertices of a cell."""
    return {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}[kind]


def without(mesh, hole: Callable, comm=COMM):
    """The mesh less the cells whose midpoints lie in a hole."""
    dofmap = geometry_dofmap(mesh)
    kept = ~hole(midpoints(mesh))
    x = mesh.geometry.x[:, : mesh.geometry.dim]
    return mesh_from(dofmap[kept], x, mesh.topology.cell_name(), comm)


def moved(mesh, shifts: np.ndarray):
    """The mesh with each cell moved by its own vector; vertices that then coincide are one.

    Args:
        mesh: first-order mesh.
        shifts: shape (num_cells, dim), m.
    """
    x = mesh.geometry.x[geometry_dofmap(mesh)][:, :, : mesh.geometry.dim] + shifts[:, np.newaxis]
    flat = x.reshape(-1, x.shape[2])
    _, first, inverse = np.unique(flat.round(9), axis=0, return_index=True, return_inverse=True)
    return mesh_from(inverse.reshape(x.shape[:2]), flat[first], mesh.topology.cell_name())


def wrap(x: np.ndarray, lattice: np.ndarray) -> np.ndarray:
    """Points moved into the cell at the origin, shape (n, dim); blind to rounding at its sides."""
    whole = np.floor(x @ np.linalg.inv(lattice) + 1e-9)
    return x - whole @ lattice


def cell_of(
    lengths,
    cells,
    kind: str = "crossed",
    label: Callable | int | None = ONE,
    material: dict | None = None,
    interior: dict | None = None,
    hole: Callable | None = None,
    shift=None,
) -> Bodies:
    """Bodies of a periodic box.

    Args:
        lengths, cells, kind: of the mesh, see `scenes.mesh_of`.
        label: function of midpoints giving labels, a number for one body, None for each cell.
        material: predicates of cell tags; tag 1 is the default.
        interior: predicates of facet tags.
        hole: predicate of the cells left out; the surfaces they leave are voids.
        shift: vector added to all coordinates.
    """
    mesh = mesh_of(lengths, cells, kind)
    facets = dict(interior or {})
    if hole is not None:
        full = mesh
        mesh = without(full, hole)
        facets[VOID] = _hole_surface(full, mesh, lengths)
    bodies = EACH_CELL
    if label is not None:
        where = midpoints(mesh)[:, : mesh.topology.index_map(mesh.topology.dim).size_local]
        bodies = label(where).astype(int) if callable(label) else np.full(where.shape[1], label)
    tags = tag_cells(mesh, material or {})
    facet_tags = tag_facets(mesh, facets) if facets else None
    if shift is not None:
        mesh.geometry.x[:, : len(shift)] += shift
    return explode(
        mesh, bodies, tags, facet_tags, lattice=lengths, voids=[VOID] if hole is not None else []
    )


def _hole_surface(full, mesh, lengths) -> Callable:
    """Predicate of facets that had cells of the periodic medium on both sides and lost one."""
    dim = mesh.geometry.dim
    lattice = np.diag(np.asarray(lengths, float))

    def mids(mesh, exterior_only):
        from xper_fx.bodies.meshes import facet_cells, facet_geometry_nodes, midpoints_of

        cells, local = facet_cells(mesh)
        if exterior_only:
            keep = cells[:, 1] < 0
            cells, local = cells[keep], local[keep]
        nodes = facet_geometry_nodes(mesh, cells[:, 0], local[:, 0])
        return midpoints_of(mesh.geometry.x, nodes)[:, :dim]

    outer = mids(mesh, True)
    places, count = np.unique(wrap(outer, lattice).round(9), axis=0, return_counts=True)
    lonely = {tuple(p) for p in places[count == 1]}
    alone = np.array([tuple(p) in lonely for p in wrap(outer, lattice).round(9)], bool)
    surface = outer[alone]
    vertices = mesh.geometry.x[:, :dim]

    def predicate(x):
        # facets are found by their midpoints; vertices pass
        points = x[:dim].T
        near = np.abs(points[:, None] - surface[None]).max(axis=2).min(axis=1) < 1e-9
        at_vertex = np.abs(points[:, None] - vertices[None]).max(axis=2).min(axis=1) < 1e-9
        return near | at_vertex

    return predicate


def phase(fraction: float, period: float = 1.0, axis: int = 0, shift: float = 0.0) -> dict:
    """Cell tag 2 on a share of each period along an axis."""
    return {2: lambda x: ((x[axis] - shift) / period + 1e-9) % 1.0 < fraction}


def cell_run(
    bodies: Bodies,
    materials: dict,
    drive: MacroscopicDrive,
    law=None,
    *,
    step: float = 1.0,
    steps: int = 1,
    order: int = 1,
    facet_interactions=None,
    check=None,
    **options,
) -> Simulation:
    """A run of a cell, at its end; one body runs without inertia.

    Args:
        bodies, materials, drive, law, order, facet_interactions: of the scene.
        step, steps: h (s) and their number.
        check: called with the simulation and the record after each step.
        options: of `Simulation`.
    """
    if bodies.num_bodies == 1:
        options = {"inertia": False, "theta": 1.0} | options
    scene = Scene(
        bodies, materials, default_interaction=law, facet_interactions=facet_interactions or {},
        macroscopic=drive, order=order,
    )  # fmt: skip
    simulation = Simulation(scene, step, **(EXACT | options))
    for record in simulation.steps(steps * step):
        if check is not None:
            check(simulation, record)
    return simulation


def ramp(gradient) -> MacroscopicDrive:
    """Fbar driven linearly from the identity to a matrix at time 1."""
    gradient = np.asarray(gradient, float)
    dim = len(gradient)
    return MacroscopicDrive(
        gradient={
            f"{i + 1}{j + 1}": lambda t, i=i, j=j: (
                float(i == j) + t * (gradient[i, j] - float(i == j))
            )
            for i in range(dim)
            for j in range(dim)
        }
    )


def averaged_gradient(bulk: CellBulk, displacement: np.ndarray) -> np.ndarray:
    """Fbar from its definition: the bulk's mean and the jumps on all facing facets.

    Args:
        bulk: the cell, without voids, on one rank.
        displacement: unknowns, shape (num_dofs,), m.

    Returns:
        Shape (dim, dim); equal to `CellBulk.macroscopic_gradient` to rounding.
    """
    dim, V, bodies = bulk.dim, bulk.forms.V, bulk.forms.bodies
    direction = fem.Constant(bodies.mesh, default_scalar_type(np.zeros((dim, dim))))
    gradient = ufl.grad(ufl.TestFunction(V))
    mean = compiled_form(ufl.inner(direction, gradient) * ufl.dx(bodies.mesh))
    u = bulk.unknowns.expand(displacement)
    total = np.zeros((dim, dim))
    for i in range(dim):
        for j in range(dim):
            direction.value[:] = 0.0
            direction.value[i, j] = 1.0
            total[i, j] = fem.assemble_vector(mean).array @ u
    if len(bodies.facets):
        nodes = bulk.unknowns.node_of[bodies.facing_nodes(V)]
        rule = "nodal" if nodes.shape[2] == 4 else "gauss"
        points = facet_points(nodes, bodies.facets.normal, bodies.facets.measure, rule)
        fluctuation = displacement[: bulk.unknowns.num_nodes * dim].reshape(-1, dim)
        jumps = np.einsum("pij,pi->pj", points.frame, points.relative(fluctuation))
        total += np.einsum("p,pi,pj->ij", points.area, jumps, points.frame[:, 0])
    return np.eye(dim) + total / bulk.volume
