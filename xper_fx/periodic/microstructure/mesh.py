# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of periodic tessellations: conforming, periodic, each cell with its grain and phase."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags, meshtags
from mpi4py import MPI

from xper_fx.bodies.gmsh_session import gmsh_model
from xper_fx.bodies.meshes import check_model, mesh_of_model
from xper_fx.periodic.microstructure.tessellation import PieceFace, Tessellation
from xper_fx.support.checks import require_kind, require_positive
from xper_fx.support.ranks import Ranks

__all__ = ["Microstructure", "mesh_tessellation"]

# Cells that no machine meshes.
_MOST_CELLS = 1e9
# A vertex of the tessellation and the periods by which it is moved.
_Corner = tuple[int, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class Microstructure:
    """A mesh of grains that repeats along a lattice; made by `mesh_tessellation`.

    Attributes:
        mesh: triangles or tetrahedra of first order.
        cell_tags: the phase of each cell.
        grain: the grain of each cell, shape (num_cells,), int32, in the order of the mesh's cells;
            where it is spread over ranks, of those that the rank owns.
        lattice: the period vectors as rows, shape (dim, dim), m. Each exterior facet of the mesh
            has one translate by a sum of them, and their vertices match up to rounding.
    """

    mesh: Mesh
    cell_tags: MeshTags
    grain: npt.NDArray[np.int32]
    lattice: npt.NDArray[np.float64]


def mesh_tessellation(
    tessellation: Tessellation,
    size: float,
    phase: npt.ArrayLike | None = None,
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Microstructure:
    """Mesh the grains of a periodic tessellation, with Gmsh.

    Edges of grains are cut into equal pieces, as many as bring their length nearest to `size`; so
    all translates of an edge are cut alike. In 3D, of each face on the periodic cell's boundary
    one translate is meshed and copied to the other. Lengths are given to Gmsh in a unit near the
    mean size of the grains, for its tolerances are absolute.

    Edges much shorter than `size` give cells of bad quality: see `Tessellation.shortest_edge` and
    `xper_fx.periodic.microstructure.short_edges.lengthen_short_edges`.

    Args:
        tessellation: the grains.
        size: length of the cells' edges to aim at, m.
        phase: tag of each grain, shape (num_grains,), integers; by default 1 for all.
        comm: MPI.COMM_SELF gives every rank the whole mesh; of MPI.COMM_WORLD the first rank makes
            it, and DOLFINx spreads it over the ranks.

    Returns:
        The microstructure.

    Raises:
        ImportError: the Python module `gmsh` is missing.
        TypeError: phases are no integers, the size is no number, or there is no tessellation.
        ValueError: the size is not positive and finite, or so small that cells are too many; there
            is not one phase for each grain; a phase does not fit into 32 bits.
        RuntimeError: Gmsh failed.
    """
    require_kind("tessellation", tessellation, Tessellation)
    size = require_positive("size", size)
    cells = math.prod(float(period) / size for period in tessellation.periods)
    if not cells < _MOST_CELLS:
        raise ValueError(
            f"size is {size:g} m, which makes about {cells:.2g} cells in the box of "
            f"{tessellation.periods.tolist()} m; expected fewer than {_MOST_CELLS:.0e}."
        )
    phase_of_grain = _checked_phase(phase, tessellation.num_grains)
    dim = tessellation.dim
    unit = 2.0 ** np.rint(np.log2(tessellation.periods.prod() / tessellation.num_grains) / dim)
    ranks = Ranks(comm)
    with ExitStack() as stack:
        model = ranks.together(
            lambda: _meshed(stack, tessellation, size, unit) if ranks.rank == 0 else None
        )
        mesh, grain_tags, _ = mesh_of_model(model, dim, comm)
    mesh.geometry.x[:] *= unit  # a power of two: exact
    mesh.name = "microstructure"
    count = mesh.topology.index_map(dim).size_local
    own = grain_tags.indices < count
    grain = np.empty(count, dtype=np.int32)
    grain[grain_tags.indices[own]] = grain_tags.values[own] - 1
    cells = np.arange(count, dtype=np.int32)
    cell_tags = meshtags(mesh, dim, cells, phase_of_grain[grain])
    cell_tags.name = "cell_tags"
    return Microstructure(mesh, cell_tags, grain, tessellation.lattice)


def _meshed(stack: ExitStack, tessellation: Tessellation, size: float, unit: float) -> Any:
    """Return a Gmsh model of the mesh, of lengths divided by `unit`, that the stack closes."""
    options = {"Mesh.MeshSizeMax": size / unit}
    gmsh = stack.enter_context(gmsh_model("xper_fx: tessellation", options))
    model = _PeriodicModel(gmsh.model, tessellation, unit, size)
    try:
        model.build()
        gmsh.model.mesh.generate(tessellation.dim)
    except Exception as error:  # gmsh raises bare Exception
        raise RuntimeError(
            f"Gmsh cannot mesh these {tessellation.num_grains} grains: {error}. Their shortest "
            f"edge is {tessellation.shortest_edge:g} m, the size asked for {size:g} m: take "
            "other seeds, or rid them of short edges (lengthen_short_edges)."
        ) from error
    model.match()
    check_model(gmsh.model, tessellation.dim, "The Gmsh model")
    return gmsh.model


def _checked_phase(phase: npt.ArrayLike | None, num_grains: int) -> npt.NDArray[np.int32]:
    """Return the phase of each grain, or raise."""
    given = np.ones(num_grains, dtype=np.int32) if phase is None else np.asarray(phase)
    if not np.issubdtype(given.dtype, np.integer):
        raise TypeError(f"phase has dtype {given.dtype}; expected integers.")
    if given.shape != (num_grains,):
        raise ValueError(
            f"phase has shape {given.shape}; expected one for each grain, ({num_grains},)."
        )
    if given.min() < -(2**31) or given.max() >= 2**31:
        raise ValueError("A phase does not fit into 32 bits; take smaller tags.")
    return given.astype(np.int32)


class _PeriodicModel:
    """The entities of a tessellation in a Gmsh model, each known by its class and its shift."""

    def __init__(self, model: Any, tessellation: Tessellation, unit: float, size: float) -> None:
        """Prepare to fill the current model, lengths divided by `unit`."""
        self.model = model
        self.geo = model.geo
        self.tessellation = tessellation
        self.vertices = tessellation.vertices / unit
        self.periods = tessellation.periods / unit
        self.size = size / unit
        self.points: dict[_Corner, int] = {}
        self.lines: dict[tuple[_Corner, _Corner], int] = {}
        self.surfaces: dict[int, list[tuple[tuple[int, ...], int]]] = {}

    def build(self) -> None:
        """Make the geometry: one physical group a grain, of tag grain + 1, cuts and copies."""
        dim = self.tessellation.dim
        regions: list[list[int]] = [[] for _ in range(self.tessellation.num_grains)]
        pieces = zip(self.tessellation.grain_of_piece, self.tessellation.boundaries, strict=True)
        for grain, sides in pieces:
            if dim == 2:
                lines = [self._line(*self._corners(side)) for side in sides]
                loop = self.geo.addCurveLoop(lines, reorient=True)
                region = self.geo.addPlaneSurface([loop])
            else:
                shell = self.geo.addSurfaceLoop([self._surface(side) for side in sides])
                region = self.geo.addVolume([shell])
            regions[grain].append(region)
        for grain, parts in enumerate(regions):
            self.geo.addPhysicalGroup(dim, parts, grain + 1)
        self.geo.synchronize()
        for (start, end), line in self.lines.items():
            length = np.linalg.norm(self._position(end) - self._position(start))
            pieces = max(1, round(float(length) / self.size))
            self.model.mesh.setTransfiniteCurve(line, pieces + 1)
        for copy, master, translation in self._copies():
            affine = np.eye(4)
            affine[:3, 3] = translation
            self.model.mesh.setPeriodic(2, [copy], [master], affine.ravel())

    def match(self) -> None:
        """Move the nodes of the periodic boundary such that translates match up to rounding."""
        mesh = self.model.mesh
        for copy, _, translation in self._copies():
            _, nodes, masters, _ = mesh.getPeriodicNodes(2, copy)
            for node, master in zip(nodes, masters, strict=True):
                mesh.setNode(node, mesh.getNode(master)[0] + translation, [])
        for (start, end), line in self.lines.items():
            nodes, _, along = mesh.getNodes(1, line)
            a, b = self._position(start), self._position(end)
            pieces = len(nodes) + 1
            for node, u in zip(nodes, along, strict=True):
                mesh.setNode(node, a + np.rint(u * pieces) / pieces * (b - a), [])
        for corner, point in self.points.items():
            mesh.setNode(mesh.getNodes(0, point)[0][0], self._position(corner), [])

    def _copies(self) -> list[tuple[int, int, npt.NDArray[np.float64]]]:
        """Return surfaces that are there twice: the copy, its master and the way to the copy."""
        copies = []
        for places in self.surfaces.values():
            if len(places) == 2:
                (at, master), (there, copy) = places
                copies.append((copy, master, np.subtract(there, at) * self.periods))
        return copies

    def _position(self, corner: _Corner) -> npt.NDArray[np.float64]:
        """Return the coordinates of a corner, shape (3,)."""
        vertex, shift = corner
        x = np.zeros(3)
        x[: self.tessellation.dim] = self.vertices[vertex] + np.multiply(shift, self.periods)
        return x

    def _corners(self, side: PieceFace) -> list[_Corner]:
        """Return the corners of a piece's face."""
        face = self.tessellation.faces[side.face]
        shifts = (face.corner_shifts + side.shift).tolist()
        return [(c, tuple(k)) for c, k in zip(face.corners.tolist(), shifts, strict=True)]

    def _point(self, corner: _Corner) -> int:
        """Return the point at a corner."""
        if corner not in self.points:
            self.points[corner] = self.geo.addPoint(*self._position(corner), self.size)
        return self.points[corner]

    def _line(self, start: _Corner, end: _Corner) -> int:
        """Return the line between two corners, negative if it runs from the second to the first.

        Translates of a line run the same way.
        """
        if end < start:
            return -self._line(end, start)
        if (start, end) not in self.lines:
            line = self.geo.addLine(self._point(start), self._point(end))
            self.lines[start, end] = line
        return self.lines[start, end]

    def _surface(self, side: PieceFace) -> int:
        """Return the surface of a piece's face in 3D."""
        places = self.surfaces.setdefault(side.face, [])
        shift = tuple(side.shift.tolist())
        for place, surface in places:
            if place == shift:
                return surface
        corners = self._corners(side)
        following = corners[1:] + corners[:1]
        lines = [self._line(a, b) for a, b in zip(corners, following, strict=True)]
        surface = self.geo.addPlaneSurface([self.geo.addCurveLoop(lines)])
        places.append((shift, surface))
        return surface
