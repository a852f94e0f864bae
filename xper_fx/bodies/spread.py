# SPDX-License-Identifier: LGPL-3.0-or-later
"""The cells that a rank needs of a mesh that DOLFINx has spread over several.

A rank has the bodies that are its own, and as *neighbours* the cells of others that share a vertex
with them, in a periodic cell also across its boundary: all cells that meet at a vertex of one's own
bodies are then known, which is what decides where the interaction points at this vertex belong.
Nothing else of the mesh is held, and nothing is collected on one rank: who meets at a vertex is
found out by the rank that keeps its number (number modulo the number of ranks).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags, meshtags

from xper_fx.bodies.even_shares import rank_of_bodies
from xper_fx.bodies.meshes import facets_of_cells
from xper_fx.support.compat import create_exploded_mesh, geometry_dofmap, original_cells
from xper_fx.support.ranks import Ranks

if TYPE_CHECKING:
    from xper_fx.bodies.present_tags import PresentTags
    from xper_fx.bodies.spread_lattice import CellBorder

UNTAGGED = np.iinfo(np.int32).min
"""Tag of a facet that has none."""


@dataclass(frozen=True, eq=False)
class Spread:
    """How bodies are spread over ranks."""

    ranks: Ranks  #: those of the mesh
    #: rank of each body that is known here, shape (num_bodies,), int32
    rank_of_body: npt.NDArray[np.int32]
    num_bodies: int  #: of all ranks together
    num_cells: int  #: of all ranks together
    present: PresentTags  #: the tags that occur on any rank


class KnownCells(NamedTuple):
    """A rank's own cells and their neighbours, in the order of `number`."""

    mesh: Mesh  #: of these cells, on one process
    #: shape (num_cells,), int64, number of each cell in what the mesh was made from
    #: (`Topology.original_cell_index`), which no partition decides
    number: npt.NDArray[np.int64]
    vertex: npt.NDArray[np.int64]  #: shape (num_geometry_nodes,), int64, likewise of each vertex
    #: shape (num_cells,), int32, rank of the body that each cell belongs to
    rank: npt.NDArray[np.int32]
    label: npt.NDArray[np.int64]  #: shape (num_cells,), int64, body of each cell
    cell_tags: MeshTags  #: of all cells
    facet_tags: MeshTags  #: of those facets that bear one
    #: shape (num_cells, facets of a cell), as of `CellBorder`; None if the mesh is no periodic cell
    pair: npt.NDArray[np.int64] | None


def known_cells(
    ranks: Ranks,
    mesh: Mesh,
    label: npt.NDArray[np.int64] | None,
    material: npt.NDArray[np.int32],
    facet_tag: npt.NDArray[np.int32],
    border: CellBorder | None,
) -> KnownCells:
    """Bring each body to one rank, and tell ranks their neighbours; all call it together.

    A body goes to the rank that has most of its cells, of several the lowest; or to another one
    where ranks would have unlike work (`even_shares.py`).

    Args:
        ranks: those of the mesh.
        mesh: the mesh, as DOLFINx has spread it.
        label: shape (num_cells,), body of each cell that this rank owns; None if each is one.
        material: shape (num_cells,), tag of each such cell.
        facet_tag: shape (num_cells, facets of a cell), tags of its facets, or `UNTAGGED`.
        border: what its cells have on the boundary of a periodic cell, across which they are
            neighbours, too; None if the mesh is none.
    """
    count, tdim = len(material), mesh.topology.dim
    number = original_cells(mesh)[:count].astype(np.int64)
    dofmap = geometry_dofmap(mesh)[:count]
    nodes = mesh.geometry.input_global_indices[dofmap].astype(np.int64)
    if label is None:
        label, rank = number, np.full(count, ranks.rank, np.int32)
    else:
        rank = rank_of_bodies(ranks, mesh, label, None if border is None else border.lattice)
    which, to = ranks_in_need(ranks, nodes if border is None else border.vertex, rank)
    told = (number, rank, label, material, facet_tag, nodes, mesh.geometry.x[dofmap][:, :, :tdim])
    told += () if border is None else (border.pair,)
    heard = send(ranks, to, *(array[which] for array in told))
    columns = [np.concatenate(parts) for parts in zip(*heard, strict=True)]
    order = np.argsort(columns[0])
    number, rank, label, material, facet_tag, nodes, x, *pair = (c[order] for c in columns)

    vertices, place = np.unique(nodes, return_inverse=True)
    at = np.empty((len(vertices), tdim), x.dtype)
    at[place.ravel()] = x.reshape(-1, tdim)
    known = create_exploded_mesh(mesh, place.reshape(nodes.shape), at, number)
    known.name = mesh.name
    facets = facets_of_cells(known)
    tagged = facet_tag != UNTAGGED
    bearing, first = np.unique(facets[tagged], return_index=True)
    every = np.arange(len(number), dtype=np.int32)
    return KnownCells(
        known, number, vertices[known.geometry.input_global_indices], rank, label,
        meshtags(known, tdim, every, material),
        meshtags(known, tdim - 1, bearing.astype(np.int32), facet_tag[tagged][first]),
        pair[0] if pair else None,
    )  # fmt: skip


def send(ranks: Ranks, to: npt.NDArray[np.integer], *arrays: np.ndarray) -> list[tuple]:
    """Send rows of arrays to ranks, which call it together.

    Args:
        to: shape (n,), where each row goes.
        arrays: of n rows each.

    Returns:
        What each rank has sent here, arrays in the order given, rows in that of the sender.
    """
    order = np.argsort(to, kind="stable")
    ends = np.searchsorted(to[order], np.arange(ranks.size + 1))
    rows = [order[ends[rank] : ends[rank + 1]] for rank in range(ranks.size)]
    return ranks.comm.alltoall([tuple(array[mine] for array in arrays) for mine in rows])


def ranks_in_need(
    ranks: Ranks, nodes: npt.NDArray[np.int64], rank: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Cells of this rank and the ranks that need them: those with bodies at one of its vertices.

    Args:
        nodes: shape (num_cells, k), vertices of the cells.
        rank: shape (num_cells,), rank of each cell's body.
    """
    size, (count, k) = ranks.size, nodes.shape
    key = np.unique(nodes.ravel() * size + np.repeat(rank, k))
    heard = [keys for (keys,) in send(ranks, key // size % size, key)]
    everyone = np.unique(np.concatenate(heard))
    _, meeting = np.unique(everyone // size, return_counts=True)
    shared = everyone[np.repeat(meeting, meeting) > 1]
    told = [shared[np.isin(shared // size, asked // size)] for asked in heard]
    vertex, there = np.divmod(np.sort(np.concatenate(ranks.comm.alltoall(told))), size)
    first, last = (np.searchsorted(vertex, nodes.ravel(), side) for side in ("left", "right"))
    number = last - first
    cell = np.repeat(np.arange(count * k) // k, number)
    place = np.repeat(first - np.cumsum(number) + number, number) + np.arange(len(cell))
    needs = np.concatenate([cell * size + there[place], np.arange(count) * size + rank])
    return np.divmod(np.unique(needs), size)
