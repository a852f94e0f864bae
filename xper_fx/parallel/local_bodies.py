# SPDX-License-Identifier: LGPL-3.0-or-later
"""The bodies of one rank, as bodies with a mesh of their own.

Bodies share no vertex, so the mesh of a rank's bodies is a mesh on one process: forms, mass,
stiffness and inverses of a rank need no other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx.mesh import meshtags

from xper_fx.bodies.even_shares import CELL, FACET
from xper_fx.bodies.explode import Bodies, CellFacets, FacingFacets
from xper_fx.bodies.meshes import facets_of_cells
from xper_fx.parallel.division import partition_bodies
from xper_fx.support.compat import create_exploded_mesh, geometry_dofmap
from xper_fx.support.ranks import Ranks

# Distance at which bodies may soon touch, as a share of their size.
_NEAR = 0.1


@dataclass(frozen=True, eq=False)
class LocalBodies:
    """What a rank has of bodies that several ranks divide.

    "All" bodies are those of the scene, of a mesh that is spread those that this rank knows.
    """

    rank_of_body: np.ndarray  #: shape (num_bodies of all,), int32
    bodies: Bodies  #: this rank's; its `facets` and `ties` are those with both sides here
    body_numbers: np.ndarray  #: shape (num_bodies,), which of all bodies they are
    cells: np.ndarray  #: shape (num_cells,), cells of the exploded mesh of all
    nodes: np.ndarray  #: shape (num_geometry_nodes,), geometry nodes of the exploded mesh of all
    #: shape (num_cells of all,), this rank's number of each cell, -1 if it is elsewhere
    cell_of: np.ndarray


def divide(
    bodies: Bodies, ranks: Ranks, touching: bool = False, rank_of_body: np.ndarray | None = None
) -> LocalBodies:
    """Divide bodies among ranks and take this rank's.

    Args:
        bodies: all bodies, the same on every rank; or those of a mesh that is spread, which stay
            where they are.
        touching: whether bodies that are near each other are tied or may come into contact, and
            should be on one rank.
        rank_of_body: shape (num_bodies,), as they are to be divided; None where that is to be
            found.
    """
    if bodies.spread is not None:
        return _take(bodies, bodies.spread.rank_of_body, ranks.rank)
    if rank_of_body is None:

        def found() -> np.ndarray:
            near = neighbours(bodies) if touching else None
            return bodies_by_rank(bodies, ranks.size, near)

        rank_of_body = ranks.from_first(found)
    return _take(bodies, rank_of_body, ranks.rank)


def neighbours(bodies: Bodies) -> np.ndarray:
    """Pairs of bodies no further apart than a share of their sizes, shape (n, 2), by their boxes.

    Sizes are those of the boxes, (their volume)^(1/dim).
    """
    from xper_fx.nscd.search.grid import box_pairs

    low, high = boxes_of(bodies)
    beyond = 0.5 * _NEAR * np.prod(high - low, axis=1, keepdims=True) ** (1.0 / low.shape[1])
    return box_pairs(low - beyond, high + beyond)


def boxes_of(bodies: Bodies) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corners of the boxes around bodies, each of shape (num_bodies, dim), m."""
    mesh, count = bodies.mesh, bodies.num_bodies
    dim = mesh.geometry.dim
    x, body = mesh.geometry.x[geometry_dofmap(mesh), :dim], bodies.body_of_cell
    low, high = np.full((count, dim), np.inf), np.full((count, dim), -np.inf)
    np.minimum.at(low, body, x.min(axis=1))
    np.maximum.at(high, body, x.max(axis=1))
    return low, high


def bodies_by_rank(
    bodies: Bodies,
    num_ranks: int,
    near: np.ndarray | None = None,
) -> np.ndarray:
    """Rank of each body, shape (num_bodies,), by their cells and facing facets; see `divide`.

    Pairs of bodies that are `near` each other, shape (n, 2), better stay together, too.
    """
    pairs = bodies.facets.bodies
    weights = CELL * np.bincount(bodies.body_of_cell, minlength=bodies.num_bodies)
    weights += FACET * np.bincount(pairs.ravel(), minlength=bodies.num_bodies)
    if near is not None:
        pairs = np.concatenate([pairs, near])
    return partition_bodies(weights, pairs, np.ones(len(pairs), int), num_ranks)


def _take(bodies: Bodies, rank_of_body: np.ndarray, rank: int) -> LocalBodies:
    own = rank_of_body == rank
    cells = np.flatnonzero(own[bodies.body_of_cell])
    whole = bodies.mesh
    tdim = whole.topology.dim
    dofmap = geometry_dofmap(whole)[cells]
    nodes, numbered = np.unique(dofmap, return_inverse=True)
    x = whole.geometry.x[nodes, : whole.geometry.dim]
    mesh = create_exploded_mesh(whole, numbered.reshape(dofmap.shape), x)
    mesh.name = whole.name
    cell_of = np.full(len(bodies.body_of_cell), -1, np.int32)
    cell_of[cells] = np.arange(len(cells), dtype=np.int32)
    body_numbers = np.flatnonzero(own)
    body_of = np.cumsum(own) - 1
    material = bodies.material_of_cell[cells]
    tags = meshtags(mesh, tdim, np.arange(len(cells), dtype=np.int32), material)
    tags.name = bodies.cell_tags.name
    nodes = nodes[mesh.geometry.input_global_indices]

    def kept(facets: FacingFacets) -> FacingFacets:
        here = np.flatnonzero(np.all(own[facets.bodies], axis=1))
        arrays = {name: array[here] for name, array in vars(facets).items()}
        arrays["cells"] = cell_of[arrays["cells"]]
        arrays["bodies"] = body_of[arrays["bodies"]].astype(np.int32)
        return FacingFacets(**arrays)

    part = Bodies(
        mesh=mesh,
        num_bodies=len(body_numbers),
        labels=bodies.labels[body_numbers],
        body_of_cell=body_of[bodies.body_of_cell[cells]].astype(np.int32),
        parent_cell=bodies.parent_cell[cells],
        parent_vertex=bodies.parent_vertex[nodes],
        cell_tags=tags,
        material_of_cell=material,
        facet_tags=_facet_tags(bodies, mesh, cells),
        facets=kept(bodies.facets),
        lattice=bodies.lattice,
        ties=kept(bodies.ties),
    )
    return LocalBodies(rank_of_body, part, body_numbers, cells, nodes, cell_of)


def _facet_tags(bodies: Bodies, mesh, cells: np.ndarray):
    """Tags of the facets of some cells, which have the same facets in the same order."""
    whole, tdim = bodies.mesh, bodies.mesh.topology.dim
    old, new = facets_of_cells(whole)[cells], facets_of_cells(mesh)
    tag = np.zeros(whole.topology.index_map(tdim - 1).size_local, np.int32)
    there = tag.astype(bool)
    tag[bodies.facet_tags.indices] = bodies.facet_tags.values
    there[bodies.facet_tags.indices] = True
    tagged = there[old]
    facets, first = np.unique(new[tagged], return_index=True)
    tags = meshtags(mesh, tdim - 1, facets.astype(np.int32), tag[old[tagged]][first])
    tags.name = bodies.facet_tags.name
    return tags


def nodes_on_sides(part: LocalBodies, V, facets: FacingFacets, which: np.ndarray, side: int):
    """Nodes of this rank's V on one side of facing facets of all bodies, shape (n, k).

    Args:
        part: the rank's part.
        V: Lagrange space on the mesh of the part.
        facets: facing facets of all bodies.
        which: shape (n,), facets whose side is here.
        side: 0 for the candidate, 1 for the antagonist.
    """
    one = CellFacets(
        part.cell_of[facets.cells[which, side]][:, None],
        facets.local_facets[which, side][:, None],
        facets.local_vertices[which, side][:, None],
    )
    return part.bodies.nodes_on_facets(V, one)[:, 0]
