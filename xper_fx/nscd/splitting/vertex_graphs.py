# SPDX-License-Identifier: LGPL-3.0-or-later
"""The graph of a mesh vertex: its corners, a node of each cell there, joined by bonds.

A bond is an interaction point. Corners and bonds are numbered vertex by vertex; bonds of a vertex
law by law, so that the points of a law follow each other there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import ENTRY
from xper_fx.nscd.points import InteractionPoints


class VertexGraphs(NamedTuple):
    """Corners and bonds of all vertices."""

    corner_offsets: np.ndarray  #: shape (num_vertices + 1,), first corner of each vertex
    bond_offsets: np.ndarray  #: shape (num_vertices + 1,), first bond of each vertex
    corner: np.ndarray  #: shape (num_corners,), slot of each
    #: shape (num_bonds, 2), corners of candidate and antagonist, counted in the vertex
    sides: np.ndarray
    point: np.ndarray  #: shape (num_bonds,), number among the points
    normal: np.ndarray  #: shape (num_bonds, dim), from antagonist to candidate
    area: np.ndarray  #: shape (num_bonds,), m^2 (2D: m)
    #: shape (num_bonds,), smallest force that a rigid bond may not bear, N; zero where a bond is
    #: not initially rigid
    least: np.ndarray
    #: shape (num_slots, dim), 1 / m of each slot, zero where it is driven; where an implicit bulk
    #: has others in other directions, the largest of them
    compliance: np.ndarray
    mass: np.ndarray  #: shape (num_corners,), of each corner that is not driven (kg; 2D: kg/m)
    #: shape (num_vertices,), one over the mass of all its corners; zero where one of them is driven
    compliance_of_vertex: np.ndarray
    weakest: np.ndarray  #: shape (num_vertices,), smallest of `least`
    #: shape (num_vertices,), N; while the root of the sum of squares of what the corners are given
    #: is below step times this, some flow is borne (`holding.py`)
    easy: np.ndarray
    #: shape (num_corners, 3), the corners of a vertex, those farthest from its first one first:
    #: corner, the bond on the shortest way there, and the corner beyond it; the first corner itself
    #: comes last
    tree: np.ndarray
    ring_offsets: np.ndarray  #: shape (num_vertices + 1,), first ring of each vertex
    ring_ends: np.ndarray  #: shape (num_rings,), one beyond the last entry of each ring in `ring`
    #: shape (n, 2), bonds that close a ring of corners, counted in the vertex, and 1 where one goes
    #: round from antagonist to candidate, -1 elsewhere
    ring: np.ndarray
    #: shape (n,), float32, the same sign times 1 / least^2, over the sum of that along the ring
    ring_weight: np.ndarray

    @property
    def num_vertices(self) -> int:
        """How many there are."""
        return len(self.bond_offsets) - 1

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(array.nbytes for array in self)


def vertex_graphs(
    points: InteractionPoints,
    vertex: np.ndarray,
    group_of_point: np.ndarray,
    strength: np.ndarray,
    inverse: BodyInverse,
) -> VertexGraphs:
    """The graphs of a scene.

    Args:
        points: one node a side.
        vertex: shape (num_points,), where they are.
        group_of_point: shape (num_points,), which of the groups of laws they belong to.
        strength: shape (num_points,), smallest traction that a bond may not bear (Pa); zero where
            it is not initially rigid.
        inverse: one block a node, of which it holds the diagonal.
    """
    count = int(vertex.max(initial=-1)) + 1
    order = np.lexsort((group_of_point, vertex))
    slots = points.nodes[order, :, 0].astype(np.int64)
    at = vertex[order].astype(np.int64)
    # a slot is at one vertex, but for the ground, which counts as a corner of each
    keys = at[:, None] * inverse.num_slots + slots
    corners, sides = np.unique(keys.ravel(), return_inverse=True)
    corner_offsets = np.searchsorted(corners, np.arange(count + 1) * inverse.num_slots)
    local = sides.reshape(-1, 2) - corner_offsets[at][:, None]
    corner = (corners % inverse.num_slots).astype(np.int32)
    compliance = inverse.compliance_of_slots()
    driven = np.any(compliance[corner] == 0.0, axis=1)
    mass = np.divide(1.0, compliance[corner, 0], out=np.zeros(len(corner)), where=~driven)
    first = corner_offsets[:-1]
    whole_mass = np.where(
        np.logical_or.reduceat(driven, first), np.inf, np.add.reduceat(mass, first)
    )
    bond_offsets = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=count))])
    least = strength[order] * points.area[order]
    sides = np.ascontiguousarray(local, np.int16)
    ways = _trees_and_rings(corner_offsets, bond_offsets, sides, least)
    weakest, counts = np.minimum.reduceat(least, bond_offsets[:-1]), np.diff(corner_offsets)
    through_all = _one_ring_through_all(counts, ways["ring_offsets"], ways["ring_ends"])
    return VertexGraphs(
        corner_offsets=corner_offsets,
        bond_offsets=bond_offsets,
        corner=corner,
        sides=sides,
        point=order.astype(np.int32),
        normal=np.ascontiguousarray(points.frame[order, 0]),
        area=points.area[order],
        least=least,
        compliance=compliance,
        mass=mass,
        compliance_of_vertex=1.0 / whole_mass,
        weakest=weakest,
        easy=np.where(through_all, 4.0, 2.0) * weakest / np.sqrt(counts),
        **ways,
    )


def _one_ring_through_all(corners, offsets, ends) -> np.ndarray:
    """Whether a vertex has one ring, on which all of its corners lie, shape (num_vertices,)."""
    single = np.diff(offsets) == 1
    ring = offsets[:-1][single]
    length = np.diff(ends, prepend=0)[ring]
    out = np.zeros(len(corners), bool)
    out[single] = length == corners[single]
    return out


def _trees_and_rings(corner_offsets, bond_offsets, sides, least) -> dict[str, np.ndarray]:
    """`tree` and the rings of `VertexGraphs`: one for each bond that is not of the tree."""
    corners, bonds = int(corner_offsets[-1]), int(bond_offsets[-1])
    tree = np.zeros((corners, 3), np.int16)
    rings = np.zeros(len(bond_offsets), np.int64)
    room = 0
    while True:  # rings seldom have more entries than three a bond
        room += 3 * bonds
        ends, ring = np.zeros(bonds, np.int64), np.zeros((room, 2), np.int16)
        count = _find_rings(corner_offsets, bond_offsets, sides, tree, rings, ends, ring)
        if count >= 0:
            break
    ends, ring = ends[: rings[-1]].copy(), ring[:count].copy()
    weight = np.zeros(count, np.float32)
    _weigh_rings(bond_offsets, least, rings, ends, ring, weight)
    return {
        "tree": tree, "ring_offsets": rings, "ring_ends": ends, "ring": ring, "ring_weight": weight,
    }  # fmt: skip


@njit(**ENTRY)
def _weigh_rings(bond_offsets, least, rings, ends, ring, weight):
    """Fills the last; zero where not all bonds of a ring are rigid."""
    for b in range(len(bond_offsets) - 1):
        for m in range(rings[b], rings[b + 1]):
            start, total = ends[m - 1] if m > 0 else 0, 0.0
            for n in range(start, ends[m]):
                here = least[bond_offsets[b] + ring[n, 0]]
                total += 1.0 / (here * here) if here > 0.0 else np.inf
            for n in range(start, ends[m]):
                here = least[bond_offsets[b] + ring[n, 0]]
                if here > 0.0:
                    weight[n] = ring[n, 1] / (total * here * here)


@njit(**ENTRY)
def _find_rings(corner_offsets, bond_offsets, sides, tree, rings, ends, ring):
    """Fills what comes last; returns the number of entries of `ring`, -1 if it has no room."""
    widest = 0
    for b in range(len(corner_offsets) - 1):
        widest = max(widest, corner_offsets[b + 1] - corner_offsets[b])
    depth, up = np.empty(widest, np.int64), np.empty(widest, np.int64)
    by, queue = np.empty(widest, np.int64), np.empty(widest, np.int64)
    count = number = 0
    for b in range(len(corner_offsets) - 1):
        first, k = corner_offsets[b], corner_offsets[b + 1] - corner_offsets[b]
        low, high = bond_offsets[b], bond_offsets[b + 1]
        for c in range(k):
            depth[c] = -1
        depth[0], up[0], by[0], queue[0] = 0, -1, -1, 0
        found, at = 1, 0
        while at < found:
            c = queue[at]
            at += 1
            for q in range(low, high):
                for s in range(2):
                    if sides[q, s] == c and depth[sides[q, 1 - s]] < 0:
                        other = sides[q, 1 - s]
                        depth[other], up[other], by[other] = depth[c] + 1, c, q - low
                        queue[found] = other
                        found += 1
        for n in range(k):  # a corner that nothing joins to the first is not of the tree
            c = queue[k - 1 - n] if k - 1 - n < found else -1
            tree[first + n, 0] = c
            tree[first + n, 1] = by[c] if c >= 0 else -1
            tree[first + n, 2] = up[c] if c >= 0 else -1
        for q in range(low, high):
            c, a = sides[q, 0], sides[q, 1]
            if depth[c] < 0 or by[c] == q - low or by[a] == q - low:
                continue
            if count + 2 * k + 1 > len(ring):
                return -1
            ring[count, 0], ring[count, 1] = q - low, 1
            count += 1
            # from the candidate back to the antagonist, up to where both ways meet
            while c != a:
                if depth[c] >= depth[a]:
                    ring[count, 0] = by[c]
                    ring[count, 1] = 1 if sides[low + by[c], 0] == up[c] else -1
                    c = up[c]
                else:
                    ring[count, 0] = by[a]
                    ring[count, 1] = 1 if sides[low + by[a], 0] == a else -1
                    a = up[a]
                count += 1
            ends[number] = count
            number += 1
        rings[b + 1] = number
    return count
