# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which rank has which interaction point.

Sweeps visit facets: a facet between bodies of two ranks belongs to one of the two, which holds the
other body's velocities as *ghosts*; which rank moves a body when, `turns.py` says.

Where vertices are solved alone, all points that meet at a vertex are on one rank.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bodies.explode import FacingFacets, facet_edges


def owners_by_facet(facets: FacingFacets, rank_of_body: np.ndarray) -> np.ndarray:
    """Owner of each facing facet, shape (num_facets,)."""
    return owners_of_pairs(rank_of_body[facets.bodies])


def owners_of_pairs(pairs: np.ndarray) -> np.ndarray:
    """Which of two ranks, shape (n, 2), has what is between bodies of both, shape (n,).

    It is the lower one if the sum of both is even, else the higher: half of its cuts each.
    """
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    return np.where((low + high) % 2 == 0, low, high)


def ranks_of_pairs(rank_of_body: np.ndarray, moves: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """Ranks of pairs of bodies, shape (n, 2); one that does not move is where the other one is."""
    sides = rank_of_body[bodies]
    return np.where(moves[bodies], sides, sides[:, ::-1])


def owners_by_vertex(
    facets: FacingFacets, vertices: np.ndarray, cell, num_nodes: int, rank_of_body: np.ndarray
) -> np.ndarray:
    """Owner of each nodal point on facing facets, shape (num_facets, num_nodes).

    It is the rank of the first of the bodies that meet at the node.

    Args:
        vertices: shape (num_facets, k), vertices of the facets in the mesh that was cut.
        cell: basix cell type.
        num_nodes: nodes of a facet, vertices first, as `Bodies.facing_nodes` orders them.
        rank_of_body: shape (num_bodies,).
    """
    count, corners = vertices.shape
    ends = np.empty((count, num_nodes, 2), np.int64)
    ends[:, :corners] = vertices[:, :, None]
    for node, edge in enumerate(facet_edges(cell)[: num_nodes - corners], start=corners):
        ends[:, node] = np.sort(vertices[:, edge], axis=1)
    if num_nodes > corners + len(facet_edges(cell)):  # a facet's centre meets nothing else
        ends[:, -1] = -1 - np.arange(count)[:, None]
    _, place = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    place = place.reshape(count, num_nodes)
    first = np.full(place.max(initial=-1) + 1, len(rank_of_body))
    np.minimum.at(first, place, facets.bodies.min(axis=1)[:, None])
    return rank_of_body[first[place]]
