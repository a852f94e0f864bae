# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes to cut into bodies: rectangles, Gmsh models, tags by geometry, and their checks."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import basix
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, DiagonalType, Mesh, MeshTags, create_rectangle, meshtags
from mpi4py import MPI

from xper_fx.bodies.gmsh_session import gmsh_model
from xper_fx.support.checks import refuse_expression, require_numbers
from xper_fx.support.compat import coordinate_element, geometry_dofmap, gmsh_model_to_mesh
from xper_fx.support.ranks import Ranks

logger = logging.getLogger(__name__)

Predicate = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.bool_]]

_CELLS = {
    CellType.triangle: basix.CellType.triangle,
    CellType.quadrilateral: basix.CellType.quadrilateral,
    CellType.tetrahedron: basix.CellType.tetrahedron,
    CellType.hexahedron: basix.CellType.hexahedron,
}

# A corner's Jacobian determinant below this, relative to the cell's size to the power of the
# dimension, is that of a cell without volume.
_DEGENERATE = 1e-12


class SerialOnlyError(NotImplementedError, ValueError):
    """A mesh spread over several processes was given where each rank needs the whole mesh."""


def crossed_rectangle(
    lower: Sequence[float],
    upper: Sequence[float],
    cells: tuple[int, int],
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Mesh:
    """Create a rectangle of crossed triangles: quadrilaterals cut along both diagonals.

    Args:
        lower: lower left corner (x, y), m.
        upper: upper right corner (x, y), m.
        cells: number of quadrilaterals along x and y; each gives four triangles.
        comm: MPI.COMM_SELF gives every rank the whole mesh, MPI.COMM_WORLD spreads it over the
            ranks: a `Simulation` divides the bodies either way.

    Returns:
        The mesh, `4 * cells[0] * cells[1]` triangles.

    Raises:
        TypeError: corners that are no numbers, `cells` that are not integers.
        ValueError: the rectangle is empty or not finite, or a number of cells is below 1 or so
            large that cells cannot be counted in 32 bits.
    """
    corners = np.zeros((2, 2))
    for row, (name, corner) in enumerate((("lower", lower), ("upper", upper))):
        values = require_numbers(f"The corner `{name}`", corner)
        if values.shape != (2,):
            raise ValueError(f"The corner `{name}` should be a pair (x, y), got {corner!r}.")
        corners[row] = values
    if not np.all(np.isfinite(corners)) or not np.all(corners[1] > corners[0]):
        raise ValueError(
            f"The rectangle from {tuple(lower)} to {tuple(upper)} is empty or not finite; "
            "expected lower < upper in x and in y."
        )
    if not isinstance(cells, Sequence | np.ndarray) or len(cells) != 2:
        raise TypeError(f"cells should be two integers, got {cells!r}.")
    for n in cells:
        if not isinstance(n, int | np.integer) or isinstance(n, bool):
            raise TypeError(f"cells should be two integers, got {cells!r}.")
    if min(cells) < 1:
        raise ValueError(f"cells is {tuple(cells)}; expected at least 1 along x and along y.")
    if 4 * math.prod(map(int, cells)) >= 2**31:
        raise ValueError(
            f"cells is {tuple(cells)}, {4 * math.prod(map(int, cells)):.3g} triangles; expected "
            "fewer than 2^31."
        )
    return create_rectangle(
        comm,
        list(corners),
        [int(n) for n in cells],
        CellType.triangle,
        diagonal=DiagonalType.crossed,
    )


def read_gmsh(
    model_or_path: Any, dim: int, comm: MPI.Comm = MPI.COMM_SELF
) -> tuple[Mesh, MeshTags, MeshTags]:
    """Read a mesh with its tags from a Gmsh model or a .msh file.

    Tags are those of the physical groups: those of dimension `dim` for the cells (each cell in
    exactly one), those of dimension `dim - 1` for the facets.

    Args:
        model_or_path: `gmsh.model` with its mesh generated, or the path of a .msh file.
        dim: dimension of the space and of the cells, 2 or 3; a 2D mesh lies in a plane z = const.
        comm: MPI.COMM_SELF gives every rank the whole mesh; of MPI.COMM_WORLD the first rank reads
            it, and DOLFINx spreads it over the ranks.

    Returns:
        The mesh, its cell tags and its facet tags (empty if there is no group of facets).

    Raises:
        ImportError: the Python module `gmsh` is missing.
        TypeError: neither a model nor a path.
        FileNotFoundError: there is no such file.
        ValueError: the mesh is empty, of another dimension, of higher order, of several cell
            types or not planar; a cell is in no physical group or in two.
    """
    if dim not in (2, 3):
        raise ValueError(f"dim is {dim!r}; expected 2 or 3.")
    ranks = Ranks(comm)
    with ExitStack() as stack:
        model = ranks.together(
            lambda: _checked_model(stack, model_or_path, dim) if ranks.rank == 0 else None
        )
        return mesh_of_model(model, dim, comm)


def _checked_model(stack: ExitStack, model_or_path: Any, dim: int) -> Any:
    """Return a Gmsh model that fits, of a file one that the stack closes."""
    if not isinstance(model_or_path, str | Path):
        if not hasattr(model_or_path, "mesh"):
            raise TypeError(
                f"Expected `gmsh.model` or the path of a .msh file, got {model_or_path!r}."
            )
        check_model(model_or_path, dim, "The Gmsh model")
        return model_or_path
    path = Path(model_or_path)
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    gmsh = stack.enter_context(gmsh_model(f"xper_fx: {path}", {"General.Verbosity": 1}))
    try:
        gmsh.merge(str(path))
        check_model(gmsh.model, dim, str(path))
    except ValueError:
        raise
    except Exception as error:  # gmsh raises bare Exception
        raise ValueError(f"Gmsh cannot read {path} as a mesh: {error}") from error
    return gmsh.model


def check_model(model: Any, dim: int, name: str) -> None:
    """Raise a ValueError unless a Gmsh model has a mesh of `read_gmsh`.

    Args:
        model: `gmsh.model`, whose nodes may be numbered anew.
        dim: of the mesh.
        name: of the model, for messages.
    """
    types, elements, _ = model.mesh.getElements(dim)
    if len(types) == 0:
        raise ValueError(
            f"{name} has no cells of dimension {dim}; generate the mesh "
            f"(gmsh.model.mesh.generate({dim})) and save all its elements."
        )
    if model.getDimension() > dim:
        raise ValueError(f"{name} has dimension {model.getDimension()}; expected dim = {dim}.")
    properties = [model.mesh.getElementProperties(t) for t in types]
    if len(types) > 1:
        raise ValueError(
            f"{name} mixes the cells {', '.join(p[0] for p in properties)}; expected one type."
        )
    if properties[0][2] != 1:
        raise ValueError(
            f"{name} has cells of order {properties[0][2]} ({properties[0][0]}); "
            "expected first order: gmsh.model.mesh.setOrder(1)."
        )
    grouped = [
        tags
        for _, group in model.getPhysicalGroups(dim)
        for entity in model.getEntitiesForPhysicalGroup(dim, group)
        for tags in model.mesh.getElements(dim, entity)[1]
    ]
    grouped = np.sort(np.concatenate(grouped)) if grouped else np.empty(0, dtype=np.uint64)
    if np.any(np.diff(grouped) == 0):
        twice = int(grouped[1:][np.diff(grouped) == 0][0])
        raise ValueError(f"In {name}, cell {twice} is in two physical groups; expected one.")
    if len(grouped) != len(elements[0]):
        raise ValueError(
            f"In {name}, {len(elements[0]) - len(grouped)} of {len(elements[0])} cells are in no "
            f"physical group of dimension {dim}; put each into one: "
            f"gmsh.model.addPhysicalGroup({dim}, [...], tag)."
        )
    nodes, points, _ = model.mesh.getNodes()
    points = points.reshape(-1, 3)
    if dim == 2 and np.ptp(points[:, 2]) > 1e-12 * np.ptp(points, axis=0).max():
        raise ValueError(f"{name} does not lie in a plane z = const; expected a planar 2D mesh.")
    if nodes.max() != len(nodes):
        model.mesh.renumberNodes()  # DOLFINx takes the nodes to be numbered without holes


def mesh_of_model(model: Any | None, dim: int, comm: MPI.Comm) -> tuple[Mesh, MeshTags, MeshTags]:
    """Turn a Gmsh model into a mesh with tags, those of `read_gmsh`; ranks call it together.

    Args:
        model: a checked one on the first rank.
        dim: of the mesh.
        comm: ranks over which the mesh is spread.
    """
    mesh, cell_tags, facet_tags = gmsh_model_to_mesh(model, comm, dim)
    check_mesh(mesh, spread=True)
    if facet_tags is None or len(facet_tags.indices) == 0:
        none = np.empty(0, dtype=np.int32)
        mesh.topology.create_entities(dim - 1)
        facet_tags = meshtags(mesh, dim - 1, none, none)
    cell_tags.name, facet_tags.name = "cell_tags", "facet_tags"
    return mesh, cell_tags, facet_tags


def tag_cells(mesh: Mesh, predicates: Mapping[int, Predicate], default: int = 1) -> MeshTags:
    """Tag cells by predicates on their midpoints.

    Args:
        mesh: the mesh; where it is spread over ranks, all of them call this.
        predicates: for each tag a function of the midpoints x, shape (3, num_cells), m, that says
            of each whether it bears the tag, shape (num_cells,), bool.
        default: tag of the cells that no predicate claims.

    Returns:
        Tags of all cells.

    Raises:
        TypeError: a tag is no int32, or a predicate does not return booleans.
        ValueError: two tags claim one cell; a predicate returns another shape.
    """
    check_mesh(mesh, geometry=False, spread=True)
    _check_tag(default)
    midpoints = midpoints_of(mesh.geometry.x, geometry_dofmap(mesh)).T
    num_cells = midpoints.shape[1]
    tag = np.full(num_cells, default, dtype=np.int32)
    _apply(mesh, predicates, lambda f, t: _evaluate(f, t, midpoints), tag, midpoints, "cell")
    tags = meshtags(mesh, mesh.topology.dim, np.arange(num_cells, dtype=np.int32), tag)
    tags.name = "cell_tags"
    return tags


def in_rectangles(rectangles: npt.ArrayLike) -> Predicate:
    """Return a predicate for `tag_cells`: whether a point lies inside one of some rectangles.

    Args:
        rectangles: x0, y0, x1, y1 of each, shape (n, 4), m; n may be zero.

    Raises:
        TypeError: no numbers.
        ValueError: another shape, or a rectangle without area.
    """
    corners = require_numbers("rectangles", rectangles)
    if corners.size and corners.shape[-1:] != (4,):
        raise ValueError(f"rectangles should have shape (n, 4), got {corners.shape}.")
    corners = corners.reshape(-1, 4)
    x0, y0, x1, y1 = corners.T[:, :, np.newaxis]
    if not (np.all(x0 < x1) and np.all(y0 < y1)):
        raise ValueError("Rectangles should have x0 < x1 and y0 < y1.")

    def inside(x: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        return np.any((x[0] > x0) & (x[0] < x1) & (x[1] > y0) & (x[1] < y1), axis=0)

    return inside


def tag_facets(mesh: Mesh, predicates: Mapping[int, Predicate]) -> MeshTags:
    """Tag facets, interior and exterior, all of whose vertices and whose midpoint fit.

    Args:
        mesh: the mesh; where it is spread over ranks, all of them call this.
        predicates: for each tag a function of points x, shape (3, num_points), m, that says of
            each whether it lies where the tag is, shape (num_points,), bool. Points carry
            rounding: prefer `np.isclose(x[0], 0)` to `x[0] == 0`.

    Returns:
        Tags of the facets found.

    Raises:
        TypeError: a tag is no int32, or a predicate does not return booleans.
        ValueError: two tags claim one facet; a predicate returns another shape.
    """
    check_mesh(mesh, geometry=False, spread=True)
    cells, local = facet_cells(mesh)
    nodes = facet_geometry_nodes(mesh, cells[:, 0], local[:, 0])
    x = mesh.geometry.x
    midpoints = midpoints_of(x, nodes).T

    def fits(predicate: Predicate, tag: int) -> npt.NDArray[np.bool_]:
        at_vertices = _evaluate(predicate, tag, x.T)[nodes].all(axis=1)
        return at_vertices & _evaluate(predicate, tag, midpoints)

    tag = np.zeros(len(nodes), dtype=np.int32)
    claimed = _apply(mesh, predicates, fits, tag, midpoints, "facet")
    tags = meshtags(mesh, mesh.topology.dim - 1, claimed, tag[claimed])
    tags.name = "facet_tags"
    return tags


def _check_tag(tag: int) -> None:
    """Raise unless a tag is an integer of 32 bits."""
    if isinstance(tag, bool) or not isinstance(tag, int | np.integer):
        raise TypeError(f"Tag {tag!r} is a {type(tag).__name__}; tags should be integers.")
    if not -(2**31) <= tag < 2**31:
        raise TypeError(f"Tag {tag} does not fit into 32 bits; take a smaller one.")


def _evaluate(
    predicate: Predicate, tag: int, points: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Return what a predicate says of points, shape (3, n), or raise if that is no answer."""
    if not callable(predicate):
        raise TypeError(
            f"The predicate of tag {tag} is {predicate!r}; expected a function of points."
        )
    refuse_expression(f"The predicate of tag {tag}", predicate, "a function of points")
    try:
        says = np.asarray(predicate(points))
    except Exception as error:
        error.add_note(f"The predicate of tag {tag} was called with points of {points.shape}.")
        raise
    if says.dtype != np.bool_:
        raise TypeError(f"The predicate of tag {tag} returned {says.dtype}; expected bool.")
    if says.shape != (points.shape[1],):
        raise ValueError(
            f"The predicate of tag {tag} returned shape {says.shape}; expected one bool a point, "
            f"shape ({points.shape[1]},), for points of shape {points.shape}."
        )
    return says


def _apply(
    mesh: Mesh,
    predicates: Mapping[int, Predicate],
    fits: Callable[[Predicate, int], npt.NDArray[np.bool_]],
    tag: npt.NDArray[np.int32],
    midpoints: npt.NDArray[np.float64],
    entity: str,
) -> npt.NDArray[np.int32]:
    """Write the tags of the entities that fit into `tag`; return which entities were claimed."""
    if not isinstance(predicates, Mapping):
        raise TypeError(
            "predicates should be a mapping from tags to functions, such as "
            f"{{1: lambda x: x[0] > 0}}, got {predicates!r}."
        )
    for t in predicates:
        _check_tag(t)
    claimed = np.zeros(len(tag), dtype=bool)

    def claim() -> list[int]:
        """Return the tags that entities of this rank bear."""
        claiming = []
        for t, predicate in predicates.items():
            fit = fits(predicate, t)
            twice = np.flatnonzero(fit & claimed)
            if twice.size:
                raise ValueError(
                    f"Tags {tag[twice[0]]} and {t} both claim {entity} {twice[0]} at "
                    f"{midpoints[:, twice[0]].tolist()} ({twice.size} in all); make their "
                    "predicates exclude each other."
                )
            if fit.any():
                claiming.append(t)
            tag[fit] = t
            np.logical_or(claimed, fit, out=claimed)
        return claiming

    ranks = Ranks(mesh.comm)
    found = set().union(*ranks.comm.allgather(ranks.together(claim)))
    for t in predicates:
        if t not in found and ranks.rank == 0:
            logger.warning("Tag %d claims no %s.", t, entity)
    return np.flatnonzero(claimed).astype(np.int32)


def require_whole(comm: MPI.Comm) -> None:
    """Raise a SerialOnlyError if a mesh's communicator has several processes."""
    if comm.size > 1:
        raise SerialOnlyError(
            f"The mesh is spread over {comm.size} processes: build it on MPI.COMM_SELF, whole on "
            "every rank; a Simulation divides the bodies among the ranks."
        )


def reference_cell(mesh: Mesh) -> basix.CellType:
    """Return the reference cell of a mesh.

    Raises:
        ValueError: the cells are none of triangles, quadrilaterals, tetrahedra and hexahedra.
    """
    cell_type = mesh.topology.cell_type
    if cell_type not in _CELLS:
        raise ValueError(
            f"The mesh has cells of type {cell_type.name}; expected one of "
            f"{', '.join(c.name for c in _CELLS)}."
        )
    return _CELLS[cell_type]


def check_mesh(mesh: Mesh, geometry: bool = True, spread: bool = False) -> None:
    """Raise unless a mesh can be cut into bodies.

    Args:
        geometry: whether to look at each cell's volume.
        spread: whether it may be spread over ranks; all of them call this together then.

    Raises:
        TypeError: it is no mesh.
        SerialOnlyError: it is spread over several processes and may not be.
        ValueError: its cells are of an unknown type or of higher order, it is curved in space, it
            has no cells, or a cell is degenerate or folded.
    """
    if not isinstance(mesh, Mesh):
        raise TypeError(f"mesh is a {type(mesh).__name__}; expected dolfinx.mesh.Mesh.")
    if not spread:
        require_whole(mesh.comm)
    Ranks(mesh.comm).together(lambda: _check_share(mesh, geometry))


def _check_share(mesh: Mesh, geometry: bool) -> None:
    """What `check_mesh` looks at on each rank."""
    reference_cell(mesh)
    tdim, gdim = mesh.topology.dim, mesh.geometry.dim
    if tdim != gdim:
        raise ValueError(
            f"The mesh has cells of dimension {tdim} in space of dimension {gdim}; "
            "expected the same dimension."
        )
    if (degree := coordinate_element(mesh).degree) != 1:
        raise ValueError(
            f"The mesh has a geometry of order {degree}; expected order 1, straight edges."
        )
    if mesh.topology.index_map(tdim).size_global == 0:
        raise ValueError("The mesh has no cells.")
    if geometry:
        _check_cells(mesh)


def _check_cells(mesh: Mesh) -> None:
    """Raise a ValueError that names the first degenerate or folded cell."""
    dim = mesh.topology.dim
    cell = reference_cell(mesh)
    x = mesh.geometry.x[:, :dim][geometry_dofmap(mesh)]
    # columns one by one: reductions over short axes are several times slower in NumPy
    size = np.zeros(len(x))
    for v in range(1, x.shape[1]):
        for i in range(dim):
            np.maximum(size, np.abs(x[:, v, i] - x[:, 0, i]), out=size)
    simplex = x.shape[1] == dim + 1
    corners = [(0, list(range(1, dim + 1)), 1.0)]
    if not simplex:
        # vertex v of the unit square or cube has the bits of v as coordinates
        corners = [
            (v, [v ^ (1 << i) for i in range(dim)], (-1.0) ** v.bit_count())
            for v in range(len(basix.topology(cell)[0]))
        ]
    good = np.ones(len(x), dtype=bool)
    first_sign = None
    for v, others, sign in corners:
        determinant = sign * determinants(x[:, others] - x[:, [v]])
        if first_sign is None:  # cells may be left- or right-handed, but at all corners alike
            first_sign = np.where(determinant < 0, -1.0, 1.0)
        good &= first_sign * determinant > _DEGENERATE * size**dim  # false for NaN
    bad = np.flatnonzero(~good)
    if bad.size:
        vertices = ", ".join(str(tuple(p)) for p in x[bad[0]].tolist())
        kind = "has zero volume" if simplex else "has zero volume or is folded"
        raise ValueError(
            f"Cell {bad[0]} {kind} ({bad.size} such cells in all); its vertices are {vertices}. "
            "Remove it or move its vertices."
        )


def determinants(matrices: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Determinants, shape (n,), of matrices, shape (n, dim, dim), dim 2 or 3.

    `numpy.linalg.det` is an exp of a sum of logs, and rounds more the smaller the unit is.
    """
    if matrices.shape[1] == 2:
        return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return np.einsum("ij,ij->i", matrices[:, 0], np.cross(matrices[:, 1], matrices[:, 2]))


def midpoints_of(
    x: npt.NDArray[np.float64], nodes: npt.NDArray[np.integer]
) -> npt.NDArray[np.float64]:
    """Return the mean of the points of each row of nodes.

    Args:
        x: points, shape (num_points, dim).
        nodes: points of each entity, shape (n, k).

    Returns:
        Shape (n, dim).
    """
    total = x[nodes[:, 0]]
    for column in nodes.T[1:]:
        total += x[column]
    return total / nodes.shape[1]


def local_facet_vertices(mesh: Mesh) -> npt.NDArray[np.int32]:
    """Return the vertices of each facet of the reference cell.

    Returns:
        Shape (num_facets_per_cell, num_vertices_per_facet), int32.
    """
    return np.array(basix.topology(reference_cell(mesh))[mesh.topology.dim - 1], dtype=np.int32)


def facet_geometry_nodes(
    mesh: Mesh, cells: npt.NDArray[np.int32], local_facets: npt.NDArray[np.int32]
) -> npt.NDArray[np.int32]:
    """Return the geometry nodes of facets.

    Args:
        mesh: mesh of first order.
        cells: a cell of each facet, shape (n,).
        local_facets: the number of each facet within its cell, shape (n,).

    Returns:
        Shape (n, num_vertices_per_facet), int32.
    """
    return geometry_dofmap(mesh)[cells[:, np.newaxis], local_facet_vertices(mesh)[local_facets]]


def facets_of_cells(mesh: Mesh) -> npt.NDArray[np.int32]:
    """Return the facets of each cell that is known here, shape (num_cells, num_facets), int32.

    Cells and facets are connected both ways, as tags of facets need it.
    """
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    facets = mesh.topology.connectivity(tdim, tdim - 1).array
    return facets.reshape(-1, len(local_facet_vertices(mesh)))


def facet_cells(mesh: Mesh) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the cells of every facet.

    Args:
        mesh: the mesh; of one that is spread over ranks, the facets and cells that are known here.

    Returns:
        `cells`, shape (num_facets, 2), int32, and `local_facets`, of the same shape, the number of
        the facet within each of them; -1 for the second one of an exterior facet.

    Raises:
        ValueError: a facet is shared by more than two cells.
    """
    tdim, facets_of_cell = mesh.topology.dim, facets_of_cells(mesh)
    to_cells = mesh.topology.connectivity(tdim - 1, tdim)
    offsets, links = to_cells.offsets, to_cells.array
    count = np.diff(offsets)
    if len(count) and count.max() > 2:
        facet = int(np.argmax(count))
        shared = links[offsets[facet] : offsets[facet + 1]]
        x = midpoints_of(mesh.geometry.x, geometry_dofmap(mesh)[shared])
        raise ValueError(
            f"Facet {facet} is shared by {count[facet]} cells, {shared.tolist()}, with midpoints "
            f"{x.tolist()}; expected at most two: remove the cells that are there twice or "
            "overlap."
        )
    cells = np.full((len(count), 2), -1, dtype=np.int32)
    cells[:, 0] = links[offsets[:-1]]
    inner = count == 2
    cells[inner, 1] = links[offsets[:-1][inner] + 1]
    local = np.full(cells.shape, -1, dtype=np.int32)
    facets = np.arange(len(count))[:, np.newaxis]
    local[:, 0] = np.argmax(facets_of_cell[cells[:, 0]] == facets, axis=1)
    local[inner, 1] = np.argmax(facets_of_cell[cells[inner, 1]] == facets[inner], axis=1)
    return cells, local


def cell_measure(cell: str, x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Length, area or volume of first-order cells.

    Args:
        cell: DOLFINx's name of the cell.
        x: shape (num_cells, num_vertices, 3), m.

    Returns:
        Shape (num_cells,).

    Raises:
        ValueError: no such cell.
    """
    kind = getattr(basix.CellType, cell, None)
    if kind is None:
        raise ValueError(f'There are no cells {cell!r}; take a name such as "triangle".')
    element = basix.create_element(basix.ElementFamily.P, kind, 1)
    affine = kind in (basix.CellType.interval, basix.CellType.triangle, basix.CellType.tetrahedron)
    points, weights = basix.make_quadrature(kind, 0 if affine else 3)
    gradients = element.tabulate(1, points)[1:, :, :, 0]
    jacobian = np.einsum("tqv,cvx->cqxt", gradients, x, optimize=True)
    first, *others = np.moveaxis(jacobian, -1, 0)
    # not by `numpy.linalg.det`, an exp of a sum of logs: it rounds more the smaller the unit
    if not others:
        size = np.linalg.norm(first, axis=-1)
    elif len(others) == 1:
        size = np.linalg.norm(np.cross(first, others[0]), axis=-1)
    else:
        size = np.abs(np.sum(first * np.cross(*others), axis=-1))
    return size @ weights
