# SPDX-License-Identifier: LGPL-3.0-or-later
"""The interaction points of one rank, on its own nodes and on ghosts of others'.

Which facets face each other is known to the ranks of both sides and, where vertices are solved
alone, to those of all bodies at their vertices; what number a node has only to the rank of its
body, which tells those that have points there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.bodies.explode import Bodies, FacingFacets
from xper_fx.bodies.meshes import reference_cell
from xper_fx.nscd.facets import facet_points, facet_shapes, with_lips
from xper_fx.nscd.points import InteractionPoints
from xper_fx.parallel.local_bodies import LocalBodies, nodes_on_sides
from xper_fx.parallel.ownership import owners_by_facet, owners_by_vertex
from xper_fx.support.compat import geometry_dofmap
from xper_fx.support.ranks import Ranks


class SharedPoints(NamedTuple):
    """This rank's points on facing facets."""

    points: InteractionPoints  #: on this rank's nodes, then on ghosts, numbered rank by rank
    law_of_point: np.ndarray  #: shape (num_points,)
    #: shape (num_points,), facet after facet of all that have a law, on all ranks
    numbers: np.ndarray
    #: shape (num_facets with a law that are known here,), those of these facets
    facet_numbers: np.ndarray
    num_points_of_all: int  #: points on all ranks
    asked: dict[int, np.ndarray]  #: by rank, nodes of this rank that are ghosts there
    ghosts: dict[int, np.ndarray]  #: by rank, nodes of it that are ghosts here, ascending
    points_a_facet: int  #: points on each facet
    #: as of `Halo`, where vertices are solved alone and points have lips
    at_points: tuple[dict[int, np.ndarray], dict[int, np.ndarray]] | None


def shared_points(
    bodies: Bodies,
    part: LocalBodies,
    ranks: Ranks,
    V,
    node_of: np.ndarray,
    num_nodes: int,
    law_of_facet: np.ndarray,
    rule: str,
    by_vertex: bool,
    turns: bool,
) -> SharedPoints:
    """Points of the facing facets that have a law; all ranks call it together.

    Args:
        bodies: all bodies, or those that this rank knows.
        part: this rank's.
        V: Lagrange space on this rank's mesh.
        node_of: unknown's node of each node of V.
        num_nodes: nodes among this rank's unknowns, those that belong to no body included; ghosts
            are numbered after them.
        law_of_facet: shape (num_facets,), -1 for none.
        rule: "nodal" or "gauss".
        by_vertex: whether all points that meet at a vertex shall be on one rank.
        turns: whether the points' frames turn with their facets.
    """
    with_law = np.flatnonzero(law_of_facet >= 0)
    facets = FacingFacets(**{name: array[with_law] for name, array in vars(bodies.facets).items()})
    law_of_facet, me = law_of_facet[with_law], ranks.rank
    fdim = bodies.mesh.topology.dim - 1
    k = len(V.dofmap.dof_layout.entity_closure_dofs(fdim, 0))
    a_facet = len(facet_shapes(fdim + 1, k, rule))
    sides = part.rank_of_body[facets.bodies]
    facet_numbers = _numbers(bodies, with_law, ranks)
    if by_vertex:
        corners = geometry_dofmap(bodies.mesh)[facets.cells[:, :1], facets.local_vertices[:, 0]]
        owner = owners_by_vertex(
            facets, bodies.parent_vertex[corners], reference_cell(bodies.mesh), k,
            part.rank_of_body,
        )  # fmt: skip
    else:
        owner = np.repeat(owners_by_facet(facets, part.rank_of_body)[:, None], a_facet, axis=1)

    def nodes_of(which, side):
        return node_of[nodes_on_sides(part, V, facets, which, side)]

    # tell the owners of points at this rank's bodies the nodes there
    told = [None] * ranks.size
    foreign = np.flatnonzero(np.any(sides == me, axis=1) & np.any(owner != me, axis=1))
    for rank in np.setdiff1d(owner[foreign], [me]):
        theirs = foreign[np.any(owner[foreign] == rank, axis=1)]
        told[rank] = np.concatenate(
            [nodes_of(theirs[sides[theirs, s] == me], s).ravel() for s in range(2)]
        )
    heard = ranks.comm.alltoall(told)

    mine = np.flatnonzero(np.any(owner == me, axis=1))
    nodes = np.empty((len(mine), 2, k), np.int64)
    key = np.full(nodes.shape, -1)
    step = 1 + max((int(h.max(initial=0)) for h in heard if h is not None), default=0)
    for s in range(2):
        here = sides[mine, s] == me
        nodes[here, s] = nodes_of(mine[here], s)
    for rank, numbers in enumerate(heard):
        at = 0
        for s in range(2):
            here = np.flatnonzero(sides[mine, s] == rank) if numbers is not None else ()
            count = len(here) * k
            if count:
                key[here, s] = rank * step + numbers[at : at + count].reshape(-1, k)
                at += count
    ghost = key >= 0
    keys, place = np.unique(key[ghost], return_inverse=True)
    nodes[ghost] = num_nodes + place
    points = facet_points(nodes, facets.normal[mine], facets.measure[mine], rule)
    if turns:
        order = 1 if k == facets.local_vertices.shape[2] else 2
        points = with_lips(points, nodes, bodies.facet_nodes(order)[with_law[mine]], rule)
    own = np.flatnonzero((owner[mine] == me).ravel())
    points = points.take(own)
    named = [points.nodes] if points.lips is None else [points.nodes, points.lips.nodes]
    used = np.unique(np.concatenate([n[n >= num_nodes] for n in named])) - num_nodes
    renumbered = np.full(len(keys), -1, np.int32)
    renumbered[used] = np.arange(len(used))
    for there in named:
        ghosts = there >= num_nodes
        there[ghosts] = num_nodes + renumbered[there[ghosts] - num_nodes]

    rank_of_ghost, node = np.divmod(keys[used], step)
    of_point = np.isin(num_nodes + np.arange(len(used)), points.nodes)
    theirs = [rank_of_ghost == rank for rank in range(ranks.size)]
    wanted = {rank: (node[here], of_point[here]) for rank, here in enumerate(theirs) if here.any()}
    told = ranks.comm.alltoall([wanted.get(rank) for rank in range(ranks.size)])
    asked: dict[int, tuple[np.ndarray, np.ndarray]]
    asked = {rank: both for rank, both in enumerate(told) if both is not None}
    at_points = None
    if by_vertex and turns:
        at_asked, at_wanted = ({r: at for r, (_, at) in of.items()} for of in (asked, wanted))
        at_points = at_asked, at_wanted
    return SharedPoints(
        points,
        np.repeat(law_of_facet[mine], a_facet)[own],
        (facet_numbers[mine][:, None] * a_facet + np.arange(a_facet)).ravel()[own],
        facet_numbers,
        int(ranks.sum(len(points))),
        {rank: own_nodes for rank, (own_nodes, _) in asked.items()},
        {rank: its_nodes for rank, (its_nodes, _) in wanted.items()},
        a_facet,
        at_points,
    )


def _numbers(bodies: Bodies, which: np.ndarray, ranks: Ranks) -> np.ndarray:
    """Numbers of some facing facets among such facets of all ranks, in the order of the scene."""
    if bodies.spread is None:
        return np.arange(len(which))
    from xper_fx.bodies.keepers import places_in_order

    places = bodies.facet_places()[0]
    # those that coincide come by their cells, as in `Bodies.facets`
    lower = bodies.parent_cell[bodies.facets.cells].min(axis=1, initial=bodies.spread.num_cells)
    return places_in_order(ranks, (places * bodies.spread.num_cells + lower)[which])[0]
