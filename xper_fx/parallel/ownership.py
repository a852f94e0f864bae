# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which rank has which interaction point.

Sweeps visit facets: a facet between bodies of two ranks belongs to one of the two, which holds the
other body's velocities as *ghosts*. The pairs of ranks that share facets are coloured so that a
rank meets one other at a time (`Meetings`); while it does, nobody else moves the bodies of that
cut.

Where vertices are solved alone, all points that meet at a vertex are on one rank.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from xper_fx.bodies.explode import FacingFacets, facet_edges

_NOTHING = np.zeros(0, np.int64)


def owners_by_facet(facets: FacingFacets, rank_of_body: np.ndarray) -> np.ndarray:
    """Owner of each facing facet, shape (num_facets,)."""
    return owners_of_pairs(rank_of_body[facets.bodies])


def owners_of_pairs(pairs: np.ndarray) -> np.ndarray:
    """Which of two ranks, shape (n, 2), has what is between bodies of both, shape (n,).

    It is the lower one if the sum of both is even, else the higher: half of its cuts each.
    """
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    return np.where((low + high) % 2 == 0, low, high)


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


class Meetings:
    """In which phase two ranks meet: in each a rank meets one other at most.

    Pairs alone are kept: a table of all ranks and all others would be whole on each.

    Args:
        num_ranks: number of ranks.
        pairs: lower rank * num_ranks + higher rank, ascending, shape (n,); none by default.
        phases: of these pairs, from 1.
    """

    def __init__(self, num_ranks: int, pairs: np.ndarray = _NOTHING, phases: np.ndarray = _NOTHING):
        self._num_ranks, self._pairs, self._phases = num_ranks, pairs, phases
        self.num_phases = int(phases.max(initial=0))

    def with_pairs(self, ranks: np.ndarray) -> Meetings:
        """With more pairs; those that met before do so in the same phase.

        Args:
            ranks: shape (n, 2), on both sides of points, the same on all ranks; equal within one.
        """
        ranks = np.sort(ranks, axis=1)
        ranks = ranks[(ranks[:, 0] != ranks[:, 1]) & (self.of(*ranks.T) == 0)]
        taken = defaultdict(set)
        for pair, phase in zip(self._pairs.tolist(), self._phases.tolist(), strict=True):
            for rank in divmod(pair, self._num_ranks):
                taken[rank].add(phase)
        pairs, phases = self._pairs.tolist(), self._phases.tolist()
        for low, high in np.unique(ranks, axis=0).tolist():
            both = taken[low] | taken[high]
            phase = next(c for c in itertools.count(1) if c not in both)
            taken[low].add(phase)
            taken[high].add(phase)
            pairs.append(low * self._num_ranks + high)
            phases.append(phase)
        order = np.argsort(np.array(pairs, np.int64))
        return Meetings(
            self._num_ranks, np.array(pairs, np.int64)[order], np.array(phases, np.int64)[order]
        )

    def of(self, ranks: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Phases in which ranks meet others, arrays of one shape; 0 where they do not."""
        pairs = np.minimum(ranks, others) * self._num_ranks + np.maximum(ranks, others)
        place = np.searchsorted(self._pairs, pairs)
        known = np.append(self._pairs, -1)[place] == pairs
        return np.where(known, np.append(self._phases, 0)[place], 0)

    def partner(self, rank: int, phase: int) -> list[int]:
        """Whom a rank meets in a phase, if anybody."""
        here = np.stack(np.divmod(self._pairs[self._phases == phase], self._num_ranks), axis=1)
        return [int(pair.sum()) - rank for pair in here if rank in pair]

    def saved(self) -> dict:
        """All of it."""
        return {"ranks": self._num_ranks, "pairs": self._pairs, "phases": self._phases}

    def restored(self, saved: Mapping) -> Meetings:
        """What `saved` gave, if that was of as many ranks; else this."""
        if saved["ranks"] != self._num_ranks:
            return self
        return Meetings(self._num_ranks, saved["pairs"], saved["phases"])
