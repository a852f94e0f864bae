# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of DOLFINx functions at positions, whichever rank has the cells there.

A position on a facet is in several cells. Its value is that of the cell with the lowest number in
what the mesh was made from (`Topology.original_cell_index`), which no partition decides: it is the
same on any rank that asks.
"""

from __future__ import annotations

from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt
from dolfinx import fem, geometry
from dolfinx.mesh import CellType, Mesh

from xper_fx.support.compat import geometry_dofmap, original_cells
from xper_fx.support.ranks import Ranks

# By how much of its size a cell holds positions beside it; iterations of their inverse map.
_BESIDE, _ITERATIONS = 1e-6, 25
_SIMPLICES = (CellType.interval, CellType.triangle, CellType.tetrahedron)
_NO_CELL, _NO_PAIRS = np.iinfo(np.int64).max, (np.zeros(0, np.intp), np.zeros(0, np.int32))


def is_function(given: Any) -> bool:
    """Whether something is a DOLFINx function, which can be called, but not with positions."""
    return isinstance(given, fem.Function)


def num_components(function: fem.Function) -> int:
    """Components of a function's values."""
    return int(np.prod(function.ufl_shape, dtype=int))


def function_values(function: fem.Function, x: np.ndarray, ranks: Ranks) -> np.ndarray:
    """Values of a function at positions of this rank; all ranks call it together.

    Args:
        function: of a mesh that is whole on each rank, or of which ranks have parts.
        x: positions, shape (3, n), m.
        ranks: those that know all of the mesh.

    Returns:
        Shape (n, number of components); NaN outside of the mesh.
    """
    positions, mesh = np.ascontiguousarray(x.T), function.function_space.mesh
    if len(set(ranks.comm.allgather(named(mesh)))) == 1:  # each has all of it
        return _own_values(function, positions)[1]
    from xper_fx.bodies.spread import send

    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    corners = mesh.geometry.x[geometry_dofmap(mesh)[:owned]].reshape(-1, 3)
    low, high = corners.min(axis=0, initial=np.inf), corners.max(axis=0, initial=-np.inf)
    beside = ranks.max(_BESIDE * (high - low).max() if owned else 0.0)
    asked = [
        np.flatnonzero(np.all((positions >= low_of - beside) & (positions <= high_of + beside), 1))
        for low_of, high_of in ranks.comm.allgather((low, high))
    ]
    to = np.repeat(np.arange(ranks.size), [len(which) for which in asked])
    heard = send(ranks, to, positions[np.concatenate(asked)])
    answers = ranks.comm.alltoall([_own_values(function, there) for (there,) in heard])
    number = np.full(len(positions), _NO_CELL)
    values = np.full((len(positions), num_components(function)), np.nan)
    for which, (cell, found) in zip(asked, answers, strict=True):
        lower = cell < number[which]
        number[which[lower]], values[which[lower]] = cell[lower], found[lower]
    return values


def named(mesh: Mesh) -> int:
    """What tells the cells of this rank from other cells: a sum over numbers and coordinates."""
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    corners = mesh.geometry.x[geometry_dofmap(mesh)[:owned]]
    return crc32(corners.tobytes(), crc32(original_cells(mesh)[:owned].tobytes()))


def _own_values(function: fem.Function, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the cells of this rank that have positions, `_NO_CELL` without, and values."""
    mesh = function.function_space.mesh
    which, cell = cells_at(mesh, positions)
    of_pair = original_cells(mesh)[cell]
    order = np.lexsort((of_pair, which))
    inside, first = np.unique(which[order], return_index=True)
    lowest = order[first]
    number = np.full(len(positions), _NO_CELL)
    values = np.full((len(positions), num_components(function)), np.nan)
    if len(inside):
        number[inside] = of_pair[lowest]
        found = function.eval(positions[inside], cell[lowest])
        values[inside] = np.reshape(found, (len(inside), -1))
    return number, values


def cells_at(
    mesh: Mesh, positions: np.ndarray
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int32]]:
    """Which cells of this rank hold positions, those on their boundary, too.

    Args:
        mesh: in as many dimensions as its cells have.
        positions: shape (n, 3), m.

    Returns:
        Pairs: the place of a position among those given, and a cell, shape (m,) each.
    """
    dim, owned = mesh.topology.dim, mesh.topology.index_map(mesh.topology.dim).size_local
    if not owned:
        return _NO_PAIRS
    beside = _BESIDE * float(np.ptp(mesh.geometry.x, axis=0).max())
    tree = geometry.bb_tree(mesh, dim, entities=np.arange(owned, dtype=np.int32), padding=beside)
    near = geometry.compute_collisions_points(tree, positions)
    if not len(near.array):
        return _NO_PAIRS
    which, cell = np.repeat(np.arange(len(positions)), np.diff(near.offsets)), near.array
    at = _in_reference_cell(mesh, positions[which, :dim], cell)
    beyond = at.sum(axis=1) if mesh.topology.cell_type in _SIMPLICES else at.max(axis=1)
    held = (at.min(axis=1) >= -_BESIDE) & (beyond <= 1.0 + _BESIDE)
    return which[held], cell[held]


def _in_reference_cell(mesh: Mesh, x: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """Where positions are in reference cells, shape (n, dim), by Newton's method.

    Of those outside of their cell it is known that they are.

    Args:
        x: shape (n, dim), m.
        cell: shape (n,), of each position.
    """
    element = mesh.ufl_domain().ufl_coordinate_element().sub_elements[0]
    nodes = mesh.geometry.x[geometry_dofmap(mesh)[cell], : x.shape[1]]
    at = np.full(x.shape, 1.0 / (1.0 + x.shape[1]))
    for _ in range(_ITERATIONS):
        shapes, *slopes = element.tabulate(1, at)
        off = x - np.einsum("nk,nkd->nd", shapes, nodes)
        slope = np.stack([np.einsum("nk,nkd->nd", one, nodes) for one in slopes], axis=2)
        # no cell is left far behind, where its map may not have an inverse
        then = np.clip(at + np.linalg.solve(slope, off[:, :, None])[:, :, 0], -0.1, 1.1)
        change, at = np.abs(then - at).max(initial=0.0), then
        if change < 1e-3 * _BESIDE:
            break
    return at
