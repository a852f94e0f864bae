# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes that face each other at interaction points: the vertices of the mesh before it was cut.

A point between node j of its candidate and node j of its antagonist with the same weight puts both
into one cluster; the ground joins nothing. Translating a cluster then opens no point. The two nodes
of a rigid body that a point acts on make a cluster of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.ordering import root_of

# Nodes a cluster may hold: what a mesh vertex has, and an end for chains of points between bodies.
_LARGEST = 48


class Clusters(NamedTuple):
    """A partition of the node slots."""

    nodes: np.ndarray  #: shape (num_slots,), the nodes of each cluster one after the other
    offsets: np.ndarray  #: shape (num_clusters + 1,), first entry of each in `nodes`
    cluster: np.ndarray  #: shape (num_slots,), cluster of each node
    position: np.ndarray  #: shape (num_slots,), place of each node within its cluster
    #: shape (num_clusters + 1,), first entry of each cluster's square matrix, where the matrices of
    #: all stand one after the other
    block_offsets: np.ndarray


@njit(**LEAN_ENTRY)
def _join(nodes, weights, ground, parent, size, largest):
    """Union-find over facing nodes; a union that would grow beyond `largest` is not made."""
    for i in range(len(nodes)):
        for j in range(nodes.shape[2]):
            a, b = nodes[i, 0, j], nodes[i, 1, j]
            if a >= ground or b >= ground or weights[i, 0, j] != weights[i, 1, j]:
                continue
            a, b = root_of(parent, a), root_of(parent, b)
            if a != b and size[a] + size[b] <= largest:
                low, high = min(a, b), max(a, b)
                parent[high] = low
                size[low] += size[high]


@njit(**LEAN_ENTRY)
def _mark_opened(nodes, weights, cluster, opened):
    """Mark clusters whose translation moves the sides of a point apart."""
    k = nodes.shape[2]
    for i in range(len(nodes)):
        for entry in range(2 * k):
            here = cluster[nodes[i, entry // k, entry % k]]
            jump = 0.0
            for other in range(2 * k):
                s, j = other // k, other % k
                if cluster[nodes[i, s, j]] == here:
                    jump += weights[i, s, j] if s == 0 else -weights[i, s, j]
            if abs(jump) > 1e-12:
                opened[here] = True


def facing_clusters(interactions: Interactions) -> tuple[Clusters, np.ndarray]:
    """The clusters of a scene's nodes.

    Returns:
        The clusters, and for each whether a translation of its nodes opens a point (shape
        (num_clusters,)): it touches the ground, or was too large and has been cut.
    """
    slots = interactions.inverse.num_slots
    parent = np.arange(slots)
    size = np.ones(slots, np.int64)
    ground = interactions.inverse.num_nodes
    for g in interactions.groups:
        if g.sides.lever_arms:
            first, turn = g.points.nodes[:, :, 0], g.points.rotation_nodes()
            parent[turn] = np.where(turn != first, first, parent[turn])
        else:
            _join(g.points.nodes, g.points.weights, ground, parent, size, _LARGEST)
    while True:
        root = parent[parent]
        if np.array_equal(root, parent):
            break
        parent = root
    _, cluster = np.unique(parent, return_inverse=True)
    return partition(cluster, interactions.dim), opened_clusters(interactions, cluster)


def partition(cluster: np.ndarray, dim: int) -> Clusters:
    """Clusters whose nodes are in ascending order.

    Args:
        cluster: shape (num_slots,), the cluster of each node, from 0 on.
        dim: degrees of freedom of a node.
    """
    nodes = np.argsort(cluster, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(np.bincount(cluster))])
    position = np.empty(len(cluster), np.int64)
    position[nodes] = np.arange(len(cluster)) - np.repeat(offsets[:-1], np.diff(offsets))
    blocks = np.concatenate([[0], np.cumsum((np.diff(offsets) * dim) ** 2)])
    return Clusters(nodes, offsets, cluster, position, blocks)


def opened_clusters(interactions: Interactions, cluster: np.ndarray) -> np.ndarray:
    """Whether a translation of a cluster's nodes opens a point, shape (num_clusters,).

    Args:
        cluster: shape (num_slots,), cluster of each node.
    """
    opened = np.zeros(cluster.max(initial=-1) + 1, np.bool_)
    for g in interactions.groups:
        _mark_opened(g.points.nodes, g.points.weights, cluster, opened)
    return opened


def springs_within(interactions: Interactions, cluster: np.ndarray) -> bool:
    """Whether each point acts on nodes of one cluster alone, beside the ground.

    Args:
        cluster: shape (num_slots,), cluster of each node.
    """
    ground = interactions.inverse.num_nodes
    for g in interactions.groups:
        if g.sides.lever_arms or g.points.branches is not None:
            return False
        nodes = g.points.nodes
        counts = (g.points.weights != 0.0) & (nodes < ground)
        first = np.where(counts, cluster[nodes], len(cluster)).min(axis=(1, 2))
        if np.any(counts & (cluster[nodes] != first[:, None, None])):
            return False
    return True
