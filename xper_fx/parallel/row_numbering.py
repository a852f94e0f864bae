# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of a matrix over the node slots of all ranks.

A cluster of facing nodes (`nscd/solvers/clusters.py`), also one that the cut between ranks goes
through, has its rows side by side on one rank, that of its first node: its block can then be
inverted there.

Clusters that reach slots which are ghosts somewhere are told to all ranks, a share of the slots as
small as the cuts; all others are numbered by their rank alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.nscd.interactions import Interactions
from xper_fx.support.ranks import Ranks


class Rows(NamedTuple):
    """Where slots are in the matrix.

    Attributes:
        row: shape (num_slots,), row of the slots of this rank's nodes and of its ghosts, by nodes.
        sizes: shape (n,), nodes of the clusters whose rows this rank has, in the order of rows.
        cluster: shape (num_slots,), the cluster of these slots, as its first node's number.
    """

    row: np.ndarray
    sizes: np.ndarray
    cluster: np.ndarray


def number_rows(interactions: Interactions, cluster: np.ndarray) -> Rows:
    """Number the slots of all ranks, which call it together.

    Args:
        interactions: this rank's points.
        cluster: shape (num_slots,), clusters of this rank's slots and ghosts.
    """
    halo, ranks = interactions.halo, interactions.halo.ranks
    own = interactions.own_inverse.num_nodes
    first = ranks.before(own)
    firsts = np.array(ranks.comm.allgather(first))
    number = _numbers(interactions, first, own)
    cluster = cluster[: halo.num_slots]
    root = np.full(cluster.max(initial=-1) + 1, np.iinfo(np.int64).max)
    np.minimum.at(root, cluster, number)
    label = root[cluster]
    crossing = np.zeros(len(root), bool)
    crossing[cluster[_shared_slots(interactions, own)]] = True
    told = crossing[cluster]
    cut, label_of_cut = _joined(ranks, number[told], label[told])

    # of each rank first the clusters at cuts, by their labels, then its others
    owner = np.searchsorted(firsts, label_of_cut, side="right") - 1
    order = np.lexsort((cut, label_of_cut))
    at_cut = np.bincount(owner, minlength=ranks.size)
    inside = np.flatnonzero(~told[:own])
    counts = at_cut + np.array(ranks.comm.allgather(len(inside)))
    starts = np.cumsum(counts) - counts
    place = np.empty(len(cut), np.int64)
    place[order] = np.arange(len(cut)) - np.repeat(np.cumsum(at_cut) - at_cut, at_cut)
    row_of_cut = starts[owner] + place
    row = np.empty(halo.num_slots, np.int64)
    place = np.searchsorted(cut, number[told])
    row[told], label[told] = row_of_cut[place], label_of_cut[place]
    me = ranks.rank
    inside = inside[np.argsort(label[inside], kind="stable")]
    row[inside] = starts[me] + at_cut[me] + np.arange(len(inside))
    sizes = [
        np.unique(labels, return_counts=True)[1]
        for labels in (label_of_cut[owner == me], label[inside])
    ]
    return Rows(row, np.concatenate(sizes), label)


def _numbers(interactions: Interactions, first: int, own: int) -> np.ndarray:
    """Numbers of this rank's slots and ghosts among the slots of all ranks."""
    own_numbers = np.arange(first, first + own, dtype=float)
    spread = np.repeat(own_numbers[:, None], interactions.dim, axis=1)
    return interactions.halo.with_ghost_values(spread)[:, 0].astype(np.int64)


def _shared_slots(interactions: Interactions, own: int) -> np.ndarray:
    """Whether slots are ghosts, here or elsewhere."""
    marks = np.zeros((interactions.halo.num_slots, interactions.dim))
    marks[own:] = 1.0
    interactions.halo.everywhere.add_back(marks.reshape(-1))
    return marks[:, 0] > 0.0


def _joined(ranks: Ranks, numbers: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slots at the cuts, sorted, and the least of those that any rank joins each with."""
    parts = ranks.comm.allgather((numbers, labels))
    pairs = np.concatenate([np.stack(part) for part in parts], axis=1)
    slots, place = np.unique(pairs, return_inverse=True)
    a, b = place.reshape(2, -1)
    n = len(slots)
    joins = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(n, n))
    _, component = connected_components(joins, directed=False)
    least = np.full(component.max(initial=-1) + 1, np.iinfo(np.int64).max)
    np.minimum.at(least, component, slots)
    return slots, least[component]
