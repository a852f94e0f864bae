# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of a mesh that is spread over ranks, brought to other ranks.

What a rank knows of the mesh then is what it would if `explode` had brought it these bodies
(`spread.py`). Cells take along what has been made of them since: where their nodes are now, and
the facets by which they face others as these were when the mesh was cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags, meshtags

from xper_fx.bodies.explode import Bodies, FacingFacets
from xper_fx.bodies.meshes import facets_of_cells
from xper_fx.bodies.spread import UNTAGGED, ranks_in_need, send
from xper_fx.support.compat import create_exploded_mesh, geometry_dofmap
from xper_fx.support.ranks import Ranks

# What of a facing facet is the same on all ranks.
_OF_FACET = (
    "local_facets", "tag", "normal", "measure", "midpoint", "materials", "local_vertices",
)  # fmt: skip


def moved(
    bodies: Bodies, rank_of_cell: npt.NDArray[np.integer], tables: Sequence[np.ndarray] = ()
) -> tuple[Bodies, list[np.ndarray]]:
    """Bring bodies to other ranks; all ranks call it together.

    Args:
        bodies: those that this rank knows of a mesh that is spread and no periodic cell.
        rank_of_cell: shape (num_cells of this rank's own bodies,), where each is to go, the same
            for all cells of a body.
        tables: shape (num_facing_facets, ...) each, what else is to go with the facing facets.

    Returns:
        The bodies that this rank knows then, and the tables for their facing facets.
    """
    spread, mesh, tdim = bodies.spread, bodies.mesh, bodies.mesh.topology.dim
    ranks = spread.ranks
    own_body = spread.rank_of_body == ranks.rank
    own = np.flatnonzero(own_body[bodies.body_of_cell])
    dofmap = geometry_dofmap(mesh)[own]
    nodes = bodies.parent_vertex[dofmap]
    which, to = ranks_in_need(ranks, nodes, rank_of_cell)
    heard = _sent(
        ranks, to, which, bodies.parent_cell[own], rank_of_cell,
        bodies.labels[bodies.body_of_cell[own]], bodies.material_of_cell[own],
        _tag_of_facets(bodies)[own], nodes, mesh.geometry.x[dofmap][:, :, :tdim],
    )  # fmt: skip
    order = np.lexsort((heard[0], heard[2]))  # body by body, as `explode` has them
    number, rank, label, material, facet_tag, nodes, x = (column[order] for column in heard)
    labels, body = np.unique(label, return_inverse=True)
    body = body.astype(np.int32)
    rank_of_body = np.empty(len(labels), np.int32)
    rank_of_body[body] = rank

    # one vertex for each pair (body, parent vertex)
    key = body[:, None] * (1 + nodes.max(initial=0)) + nodes
    _, first, place = np.unique(key, return_index=True, return_inverse=True)
    exploded = create_exploded_mesh(
        mesh, place.reshape(nodes.shape), x.reshape(-1, tdim)[first], number
    )
    exploded.name = mesh.name
    cell_tags = meshtags(exploded, tdim, np.arange(len(number), dtype=np.int32), material)
    cell_tags.name = bodies.cell_tags.name
    cells, columns = _facets_sent(bodies, np.flatnonzero(own_body), own[which], to, number, tables)
    facets, tables = columns[: len(_OF_FACET)], columns[len(_OF_FACET) :]
    there = Bodies(
        mesh=exploded,
        num_bodies=len(labels),
        labels=labels,
        body_of_cell=body,
        parent_cell=number,
        parent_vertex=nodes.ravel()[first][exploded.geometry.input_global_indices],
        cell_tags=cell_tags,
        material_of_cell=material,
        facet_tags=_facet_tags(exploded, facet_tag, bodies.facet_tags.name),
        facets=FacingFacets(
            cells=cells, bodies=body[cells], **dict(zip(_OF_FACET, facets, strict=True))
        ),
        lattice=None,
        ties=bodies.ties,
        spread=replace(spread, rank_of_body=rank_of_body),
    )
    order = there.order_of_facets()
    facets = FacingFacets(**{name: array[order] for name, array in vars(there.facets).items()})
    return replace(there, facets=facets), [table[order] for table in tables]


def _facets_sent(
    bodies: Bodies,
    own: np.ndarray,
    cell: np.ndarray,
    to: np.ndarray,
    number: np.ndarray,
    tables: Sequence[np.ndarray],
) -> tuple[npt.NDArray[np.int32], list[np.ndarray]]:
    """Facing facets whose cells are known here, in some order; all ranks call it together.

    Those of a body go to all who know the candidate's cell, which keep them if they know both.

    Args:
        own: this rank's bodies, which are moved.
        cell, to: shape (n,), their cells and the ranks to which each goes.
        number: shape (m,), numbers of the cells that have come here, by their new places.
        tables: as of `moved`.

    Returns:
        New places of the cells, shape (num_facets, 2); what is named in `_OF_FACET`, then tables.
    """
    facets, ranks = bodies.facets, bodies.spread.ranks
    given = np.flatnonzero(np.isin(facets.bodies[:, 0], own))
    candidate = facets.cells[given, 0]
    order = np.argsort(cell, kind="stable")
    first, last = (np.searchsorted(cell[order], candidate, side) for side in ("left", "right"))
    count = last - first
    place = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    columns = [getattr(facets, name) for name in _OF_FACET]
    cells, *heard = _sent(
        ranks, to[order[place]], np.repeat(given, count),
        bodies.parent_cell[facets.cells], *columns, *tables,
    )  # fmt: skip
    order = np.argsort(number)
    place = np.searchsorted(number, cells, sorter=order)
    place = order[np.minimum(place, len(number) - 1)]
    known = np.all(number[place] == cells, axis=1)
    return place[known].astype(np.int32), [column[known] for column in heard]


def _sent(ranks: Ranks, to: np.ndarray, which: np.ndarray, *arrays: np.ndarray) -> list[np.ndarray]:
    """Rows of arrays that all ranks have sent here.

    Args:
        to: shape (n,), where to send rows.
        which: shape (n,), rows to send.
    """
    heard = send(ranks, to, *(array[which] for array in arrays))
    return [np.concatenate(parts) for parts in zip(*heard, strict=True)]


def _tag_of_facets(bodies: Bodies) -> np.ndarray:
    """Tag of each facet of each cell, `UNTAGGED` where it has none, shape (num_cells, k)."""
    topology = bodies.mesh.topology
    facets = facets_of_cells(bodies.mesh)
    tag = np.full(topology.index_map(topology.dim - 1).size_local, UNTAGGED, np.int32)
    tag[bodies.facet_tags.indices] = bodies.facet_tags.values
    return tag[facets]


def _facet_tags(mesh: Mesh, tag: np.ndarray, name: str) -> MeshTags:
    """Tags of facets, by what `_tag_of_facets` gives."""
    there = tag != UNTAGGED
    facets, first = np.unique(facets_of_cells(mesh)[there], return_index=True)
    tags = meshtags(mesh, mesh.topology.dim - 1, facets.astype(np.int32), tag[there][first])
    tags.name = name
    return tags
