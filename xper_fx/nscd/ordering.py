# SPDX-License-Identifier: LGPL-3.0-or-later
"""The order in which points are visited: tiles for the cache and the threads, colours within.

Consecutive bodies form a *tile* whose points are visited together, so that its velocities and
blocks of w stay in cache. Tiles of one colour share no body: threads take them at the same time,
and the numbers do not depend on how many threads there are. Within a tile, points are sorted by a
colour of their own: successive visits then touch different bodies and their arithmetic overlaps.

With one block of w a node, points couple only through nodes they share: the connected components
of the graph node - point - node, one a mesh vertex, are then tiles of one colour.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit

# Points a tile aims at: about 100 kB of point data and blocks of w.
_TILE_POINTS = 256


class Ordering(NamedTuple):
    """An order of points by colour of tile, tile, and colour of point.

    Attributes:
        order: shape (num_points,), int32.
        tile_offsets: shape (num_tiles + 1,), first point (in `order`) of each tile.
        color_offsets: shape (num_colors + 1,), first tile of each colour.
    """

    order: np.ndarray
    tile_offsets: np.ndarray
    color_offsets: np.ndarray


@njit
def _greedy_colors(offsets, members, num_members, ignored):
    """Smallest colour that no earlier item sharing a member has, item by item.

    `members[offsets[i]:offsets[i + 1]]` are the members of item i. Members remember the colours
    taken as bits; the 64th colour is shared by all that found none, which the caller splits.
    """
    taken = np.zeros(num_members, np.uint64)
    color = np.empty(len(offsets) - 1, np.int64)
    one = np.uint64(1)
    for i in range(len(offsets) - 1):
        used = np.uint64(0)
        for m in members[offsets[i] : offsets[i + 1]]:
            if m != ignored:
                used |= taken[m]
        c = 0
        while c < 63 and (used >> np.uint64(c)) & one:
            c += 1
        color[i] = c
        for m in members[offsets[i] : offsets[i + 1]]:
            if m != ignored:
                taken[m] |= one << np.uint64(c)
    return color


@njit
def _components(pairs, num_members, ignored):
    """Connected component of each pair; an ignored member connects nothing.

    Components are numbered in the order of their first member.
    """
    parent = np.arange(num_members)
    for i in range(len(pairs)):
        a, b = pairs[i]
        if a != ignored and b != ignored:
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            parent[max(a, b)] = min(a, b)
    number = np.full(num_members, -1)
    count = 0
    for m in range(num_members):  # a root comes before the members below it
        a = m
        while parent[a] != a:
            a = parent[a]
        if number[a] < 0 and m != ignored:
            number[a] = count
            count += 1
        number[m] = number[a]
    component = np.empty(len(pairs), np.int64)
    for i in range(len(pairs)):
        a, b = pairs[i]
        component[i] = number[b if a == ignored else a]
    return component


def vertex_of_points(blocks: np.ndarray, num_blocks: int) -> np.ndarray:
    """The component of the graph node - point - node that each point belongs to.

    Args:
        blocks: shape (num_points, 2), as in `order_points`, one block a node.
        num_blocks: number of blocks, the ground's (the last) included.

    Returns:
        Shape (num_points,), from 0, without a gap.
    """
    pairs = np.ascontiguousarray(blocks, dtype=np.int32)
    component = _components(pairs, num_blocks, num_blocks - 1)
    return np.unique(component, return_inverse=True)[1]


def order_by_vertex(
    blocks: np.ndarray, num_blocks: int, vertex: np.ndarray, num_vertices: int
) -> Ordering:
    """Order points vertex by vertex: the tiles are the vertices, and all have one colour.

    Args:
        blocks, num_blocks: as in `order_points`.
        vertex: shape (num_points,), from `vertex_of_points`.
        num_vertices: number of vertices; one without any of these points is an empty tile.

    Returns:
        The order; within a vertex, points of one colour share no node.
    """
    count = len(blocks)
    pairs = np.ascontiguousarray(blocks, dtype=np.int32)
    color = _greedy_colors(np.arange(count + 1) * 2, pairs.ravel(), num_blocks, num_blocks - 1)
    sizes = np.bincount(vertex, minlength=num_vertices)
    return Ordering(
        np.lexsort((np.arange(count), color, vertex)).astype(np.int32),
        np.concatenate([[0], np.cumsum(sizes)]),
        np.array([0, num_vertices]),
    )


def order_points(blocks: np.ndarray, num_blocks: int) -> Ordering:
    """Order the points between pairs of bodies.

    Args:
        blocks: shape (num_points, 2), block of the candidate and of the antagonist; the last
            block (num_blocks - 1) is the ground and conflicts with nothing.
        num_blocks: number of blocks, the ground's included.

    Returns:
        The order; it depends on the points alone.
    """
    count = len(blocks)
    if count == 0:
        zero = np.zeros(1, np.int64)
        return Ordering(np.zeros(0, np.int32), zero, zero)
    blocks = np.ascontiguousarray(blocks, dtype=np.int32)
    ground = num_blocks - 1
    point_color = _greedy_colors(np.arange(count + 1) * 2, blocks.ravel(), num_blocks, ground)

    bodies_a_tile = max(1, round(_TILE_POINTS * (num_blocks - 1) / count))
    tile = blocks.min(axis=1) // bodies_a_tile
    present = np.bincount(tile) > 0
    tile = (np.cumsum(present) - 1)[tile]
    num_tiles = int(np.count_nonzero(present))
    by_tile = np.argsort(tile, kind="stable") if np.any(tile[1:] < tile[:-1]) else np.arange(count)
    tile_offsets = np.concatenate([[0], np.cumsum(np.bincount(tile, minlength=num_tiles))])
    starts, touched = _touched(blocks, by_tile, tile_offsets, num_blocks, -1)
    tile_color = _greedy_colors(starts, touched, num_blocks, ground)
    crowded = tile_color == 63  # no colour was left: each such tile is a colour of its own
    tile_color[crowded] += np.arange(np.count_nonzero(crowded))

    by_color = np.lexsort((np.arange(num_tiles), tile_color))
    sizes = np.diff(tile_offsets)[by_color]
    return Ordering(
        _sorted_within(by_tile, tile_offsets, by_color, point_color),
        np.concatenate([[0], np.cumsum(sizes)]),
        np.concatenate([[0], np.cumsum(np.bincount(tile_color))]),
    )


@njit
def _sorted_within(by_tile, tile_offsets, tiles, color):
    """The points of the tiles in the order given, within a tile by colour and number."""
    order = np.empty(len(by_tile), np.int32)
    place = np.empty(65, np.int64)
    at = 0
    for tile in tiles:
        first, last = tile_offsets[tile], tile_offsets[tile + 1]
        place[:] = 0
        for i in by_tile[first:last]:
            place[color[i] + 1] += 1
        for c in range(64):
            place[c + 1] += place[c]
        for i in by_tile[first:last]:
            order[at + place[color[i]]] = i
            place[color[i]] += 1
        at += last - first
    return order


@njit
def _touched(blocks, order, tile_offsets, num_blocks, ignored):
    """The blocks that the points of each tile touch, once each: offsets and blocks."""
    offsets = np.zeros(len(tile_offsets), np.int64)
    members = np.empty(2 * len(order), np.int32)
    seen = np.full(num_blocks, -1)
    count = 0
    for tile in range(len(tile_offsets) - 1):
        for i in order[tile_offsets[tile] : tile_offsets[tile + 1]]:
            for s in range(2):
                b = blocks[i, s]
                if b != ignored and seen[b] != tile:
                    seen[b] = tile
                    members[count] = b
                    count += 1
        offsets[tile + 1] = count
    return offsets, members[:count].copy()


class TileBodies(NamedTuple):
    """The bodies that each tile touches.

    Attributes:
        offsets: shape (num_tiles + 1,), first entry of each tile in `blocks`.
        blocks: blocks touched, the ground's left out.
    """

    offsets: np.ndarray
    blocks: np.ndarray


def bodies_of_tiles(ordering: Ordering, blocks: np.ndarray, num_blocks: int) -> TileBodies:
    """The bodies that each tile touches.

    Args:
        ordering: the tiles.
        blocks: shape (num_points, 2), blocks of the points before they were put in order.
        num_blocks: number of blocks, the ground's (the last) included.
    """
    blocks = np.ascontiguousarray(blocks, dtype=np.int32)
    return TileBodies(
        *_touched(blocks, ordering.order, ordering.tile_offsets, num_blocks, num_blocks - 1)
    )


@njit
def mark_moved(moved, tile_bodies, stats, threshold):
    """Mark the bodies of tiles whose impulses changed by more than the threshold (squared)."""
    for tile in range(len(stats)):
        if stats[tile, 0] > threshold:
            for b in tile_bodies.blocks[tile_bodies.offsets[tile] : tile_bodies.offsets[tile + 1]]:
                moved[b] = True


@njit
def mark_tiles(marked, tile_bodies, moved):
    """Mark the tiles that touch a body that moved; returns how many."""
    count = 0
    for tile in range(len(marked)):
        marked[tile] = False
        for b in tile_bodies.blocks[tile_bodies.offsets[tile] : tile_bodies.offsets[tile + 1]]:
            if moved[b]:
                marked[tile] = True
                count += 1
                break
    return count
