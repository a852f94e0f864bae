# SPDX-License-Identifier: LGPL-3.0-or-later
"""Clusters of facing nodes (`nscd/solvers/clusters.py`) that the cut between ranks goes through.

A cluster is cut if a rank's points act on a node of it that is another rank's. Every rank that
knows a node of a cut cluster has room for its whole block, adds up what its bodies and points give,
and is told the sum; it is told, too, what a residual is at the cluster's nodes, and solves the
block for its own. All other clusters are one rank's.

Cut clusters are told to all ranks, a share of the slots as small as the cuts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.clusters import Clusters, facing_clusters, opened_clusters, partition
from xper_fx.parallel.border import Border
from xper_fx.parallel.exchange import Exchange
from xper_fx.support.ranks import Ranks


class CutClusters(NamedTuple):
    """Clusters of a rank's slots, of those behind them that others have, and what ranks exchange.

    Attributes:
        clusters: those that are cut come first; those of ghosts that nothing acts on, and of the
            ground, come last.
        cut, own: how many are cut, and how many are cut or this rank's.
        opened: shape (num_clusters,), whether a translation of a cluster opens a point.
        nodes: exchange of what is at the nodes of cut clusters, in the order of `clusters.nodes`.
        blocks: exchange of the entries of their blocks.
        border: motions of cut clusters, each as one.
    """

    clusters: Clusters
    cut: int
    own: int
    opened: np.ndarray
    nodes: Exchange
    blocks: Exchange
    border: Border


def cut_clusters(interactions: Interactions) -> CutClusters:
    """The clusters of all ranks' points, as a rank knows them; they find them together.

    Args:
        interactions: this rank's points.
    """
    ranks, dim = interactions.halo.ranks, interactions.dim
    own, known = interactions.own_inverse.num_nodes, interactions.halo.num_slots
    slots = interactions.inverse.num_slots
    cluster = facing_clusters(interactions)[0].cluster[:known]
    at_cuts = cut_nodes(interactions, cluster)
    nodes, labels, cut = at_cuts.nodes, at_cuts.labels, at_cuts.cut
    count = max(slots, nodes.max(initial=-1) + 1)

    names = np.empty(count, np.int64)
    most = cluster.max(initial=-1) + 1
    names[:known] = len(labels) + cluster
    names[known:slots] = len(labels) + most + np.arange(slots - known)
    names[own:known] += most + slots  # ghosts that nothing acts on come last
    present, first, names[nodes] = np.unique(labels, return_index=True, return_inverse=True)
    clusters = partition(np.unique(names, return_inverse=True)[1], dim)
    # nodes of a cluster are by numbers, on all ranks
    clusters.nodes[: len(nodes)] = nodes
    clusters.position[nodes] = np.arange(len(nodes)) - np.repeat(
        clusters.offsets[: len(present)], np.diff(clusters.offsets[: len(present) + 1])
    )
    inside = len(np.unique(names[:own][names[:own] >= len(labels)]))

    opened = opened_clusters(interactions, clusters.cluster[:slots])
    opened = np.append(opened, np.zeros(len(clusters.offsets) - 1 - len(opened), bool))
    of_any = ranks.union(present[opened[: len(present)]])
    opened[: len(present)] = np.isin(present, of_any)

    home = at_cuts.owner[first]
    entries = np.diff(clusters.block_offsets[: len(present) + 1])
    return CutClusters(
        clusters, len(present), len(present) + inside, opened,
        at_cuts.exchange,
        cut.exchange(ranks, np.repeat(present, entries), np.repeat(home, entries), 1),
        Border(ranks, np.searchsorted(cut.labels, present), len(cut.labels), dim),
    )  # fmt: skip


class CutNodes(NamedTuple):
    """Nodes of the cut clusters that a rank knows, by cluster and number, alike on all ranks.

    Attributes:
        nodes: shape (n,), their slots; those that are none here have numbers after the last.
        numbers: shape (n,), among the slots of all ranks.
        labels: shape (n,), the least number of the cluster of each.
        owner: shape (n,), rank of each.
        cut: the cut clusters of all ranks.
        exchange: of what is at these nodes.
    """

    nodes: np.ndarray
    numbers: np.ndarray
    labels: np.ndarray
    owner: np.ndarray
    cut: _Cut
    exchange: Exchange

    def told(self, rank: int) -> np.ndarray:
        """Which of these nodes another rank knows, too, shape (n,)."""
        return self.cut.known[np.searchsorted(self.cut.labels, self.labels), rank]


def cut_nodes(interactions: Interactions, cluster: np.ndarray) -> CutNodes:
    """The nodes of clusters that are cut; all ranks find them together.

    Args:
        interactions: this rank's points.
        cluster: shape (num_slots,), those that this rank's points make of its slots and ghosts.
    """
    ranks, own = interactions.halo.ranks, interactions.own_inverse.num_nodes
    first = ranks.before(own)
    firsts = np.array(ranks.comm.allgather(first))
    number = _numbers(interactions, first, own)
    root = np.full(cluster.max(initial=-1) + 1, np.iinfo(np.int64).max)
    np.minimum.at(root, cluster, number)
    crossing = np.zeros(len(root), bool)
    crossing[cluster[_shared_slots(interactions, own)]] = True
    told = np.flatnonzero(crossing[cluster])
    cut = _Cut.of(ranks, number[told], root[cluster[told]])

    label = cut.label_of(number[told])
    here = np.flatnonzero(np.isin(cut.label, label))
    here = here[np.lexsort((cut.number[here], cut.label[here]))]
    numbers, labels = cut.number[here], cut.label[here]
    slot_of = np.full(len(cut.number), -1)
    slot_of[np.searchsorted(cut.number, number[told])] = told
    nodes = slot_of[here]
    unknown = np.flatnonzero(nodes < 0)
    nodes[unknown] = interactions.inverse.num_slots + np.arange(len(unknown))
    owner = np.searchsorted(firsts, numbers, side="right") - 1
    exchange = cut.exchange(ranks, labels, owner, interactions.dim)
    return CutNodes(nodes, numbers, labels, owner, cut, exchange)


class _Cut(NamedTuple):
    """The cut clusters of all ranks: slots by their numbers, and the ranks that know each."""

    number: np.ndarray  #: shape (n,), slots, ascending
    label: np.ndarray  #: shape (n,), the least of those in a slot's cluster
    labels: np.ndarray  #: of all clusters, ascending
    known: np.ndarray  #: shape (num_clusters, num_ranks), whether a rank knows a cluster

    @classmethod
    def of(cls, ranks: Ranks, numbers: np.ndarray, labels: np.ndarray) -> _Cut:
        """From slots of a rank, and the least of those that it joins each with."""
        parts = ranks.comm.allgather((numbers, labels))
        pairs = np.concatenate([np.stack(part) for part in parts], axis=1)
        slots, place = np.unique(pairs, return_inverse=True)
        a, b = place.reshape(2, -1)
        n = len(slots)
        joins = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(n, n))
        _, component = connected_components(joins, directed=False)
        least = np.full(component.max(initial=-1) + 1, np.iinfo(np.int64).max)
        np.minimum.at(least, component, slots)
        label = least[component]
        found, of = np.unique(label, return_inverse=True)
        known = np.zeros((len(found), ranks.size), bool)
        known[of[a], np.repeat(np.arange(ranks.size), [len(part[0]) for part in parts])] = True
        return cls(slots, label, found, known)

    def label_of(self, numbers: np.ndarray) -> np.ndarray:
        """Labels of slots."""
        return self.label[np.searchsorted(self.number, numbers)]

    def exchange(self, ranks: Ranks, labels: np.ndarray, owner: np.ndarray, dim: int) -> Exchange:
        """Exchange of entries of clusters, each of which has an owner.

        Args:
            ranks: all.
            labels: shape (n,), the cluster of each of this rank's entries, in an order that is the
                same on all ranks.
            owner: shape (n,), a rank.
            dim: numbers an entry.
        """
        mine, known = owner == ranks.rank, self.known[np.searchsorted(self.labels, labels)]
        others = [rank for rank in range(ranks.size) if rank != ranks.rank]
        given = {rank: np.flatnonzero(mine & known[:, rank]) for rank in others}
        taken = {rank: np.flatnonzero(owner == rank) for rank in others}
        return Exchange(
            ranks,
            {rank: where for rank, where in given.items() if len(where)},
            {rank: where for rank, where in taken.items() if len(where)},
            dim,
        )


def _numbers(interactions: Interactions, first: int, own: int) -> np.ndarray:
    """Numbers of this rank's slots and ghosts among the slots of all ranks."""
    own_numbers = np.arange(first, first + own, dtype=float)
    spread = np.repeat(own_numbers[:, None], interactions.dim, axis=1)
    return interactions.halo.with_ghost_values(spread)[:, 0].astype(np.int64)


def _shared_slots(interactions: Interactions, own: int) -> np.ndarray:
    """Whether slots are ghosts, here or elsewhere, that points act on where they are ghosts."""
    marks = np.zeros((interactions.inverse.num_slots, interactions.dim))
    for g in interactions.groups:
        marks[g.points.nodes] = 1.0
        if g.sides.lever_arms:
            marks[g.points.rotation_nodes()] = 1.0
    marks = marks[: interactions.halo.num_slots]
    marks[:own] = 0.0
    interactions.halo.everywhere.add_back(marks.reshape(-1))
    return marks[:, 0] > 0.0
