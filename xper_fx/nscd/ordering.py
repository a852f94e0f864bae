# SPDX-License-Identifier: LGPL-3.0-or-later
"""The order in which points are visited: tiles for the cache and the threads, colours within.

Consecutive bodies form a *tile* whose points are visited together, so that its velocities and
blocks of w stay in cache. Tiles of one colour share no body: threads take them at the same time,
and the numbers do not depend on how many threads there are. Within a tile, points are sorted by a
colour of their own: successive visits then touch different bodies and their arithmetic overlaps.
A periodic cell of rigid bodies that deforms is moved by all points: each tile then has a colour of
its own, and one thread takes them all.

With one block of w a node, points couple only through nodes they share: the connected components
of the graph node - point - node, one a mesh vertex, are then tiles of one colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, MERGED

# Points a tile aims at: about 100 kB of point data and blocks of w.
_TILE_POINTS = 256
LAST_COLOR = 63


class Ordering(NamedTuple):
    """An order of points by colour of tile, tile, and colour of point."""

    order: np.ndarray  #: shape (num_points,), int32
    tile_offsets: np.ndarray  #: shape (num_tiles + 1,), first point (in `order`) of each tile
    color_offsets: np.ndarray  #: shape (num_colors + 1,), first tile of each colour


def greedy_colors(
    offsets: np.ndarray, members: np.ndarray, num_members: int, ignored: int
) -> np.ndarray:
    """Smallest colour that no earlier item sharing a member has, item by item.

    Args:
        offsets: shape (num_items + 1,), int64.
        members: shape (offsets[-1],), int32; `members[offsets[i]:offsets[i + 1]]` are those of
            item i.
        num_members: number of members there are.
        ignored: a member that may be shared.

    Returns:
        Shape (num_items,); `LAST_COLOR` is that of all that found none, which the caller splits.
    """
    color = np.empty(len(offsets) - 1, np.int64)
    _color(offsets, members, ignored, np.zeros(num_members, np.uint64), color)
    return color


@njit(**LEAN_ENTRY)
def _color(offsets, members, ignored, taken, color):
    """`greedy_colors` into `color`; members remember the colours taken as bits of `taken`."""
    one = np.uint64(1)
    for i in range(len(color)):
        used = np.uint64(0)
        for place in range(offsets[i], offsets[i + 1]):
            if members[place] != ignored:
                used |= taken[members[place]]
        c = 0
        while c < LAST_COLOR and (used >> np.uint64(c)) & one:
            c += 1
        color[i] = c
        for place in range(offsets[i], offsets[i + 1]):
            if members[place] != ignored:
                taken[members[place]] |= one << np.uint64(c)


@njit(**MERGED)
def root_of(parent, member):
    """The root of a member's tree, to which the way is made shorter."""
    while parent[member] != member:
        parent[member] = parent[parent[member]]
        member = parent[member]
    return member


@njit
def _components(pairs, num_members, ignored):
    """Connected component of each pair; an ignored member connects nothing.

    Components are numbered in the order of their first member.
    """
    parent = np.arange(num_members)
    for i in range(len(pairs)):
        a, b = pairs[i]
        if a != ignored and b != ignored:
            a, b = root_of(parent, a), root_of(parent, b)
            parent[max(a, b)] = min(a, b)
    number = np.full(num_members, -1)
    count = 0
    for m in range(num_members):  # a root comes before the members below it
        a = root_of(parent, m)
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
    color = greedy_colors(np.arange(count + 1) * 2, pairs.ravel(), num_blocks, num_blocks - 1)
    sizes = np.bincount(vertex, minlength=num_vertices)
    return Ordering(
        np.lexsort((np.arange(count), color, vertex)).astype(np.int32),
        np.concatenate([[0], np.cumsum(sizes)]),
        np.array([0, num_vertices]),
    )


def order_points(blocks: np.ndarray, num_blocks: int) -> Ordering:
    """Order the points between pairs of bodies.

    Args:
        blocks: shape (num_points, 2 or more), block of the candidate and of the antagonist, and
            those that all points move; the last block (num_blocks - 1) is the ground and
            conflicts with nothing.
        num_blocks: number of blocks, the ground's included.

    Returns:
        The order; it depends on the points alone.
    """
    count = len(blocks)
    if count == 0:
        zero = np.zeros(1, np.int64)
        return Ordering(np.zeros(0, np.int32), zero, zero)
    blocks = np.ascontiguousarray(blocks, dtype=np.int32)
    ground, sides = num_blocks - 1, blocks[:, :2]
    point_color = greedy_colors(np.arange(count + 1) * 2, sides.ravel(), num_blocks, ground)

    bodies_a_tile = max(1, round(_TILE_POINTS * (num_blocks - 1) / count))
    tile = sides.min(axis=1) // bodies_a_tile
    present = np.bincount(tile) > 0
    tile = (np.cumsum(present) - 1)[tile]
    num_tiles = int(np.count_nonzero(present))
    if num_tiles == 1:
        order = np.argsort(point_color, kind="stable").astype(np.int32)
        return Ordering(order, np.array([0, count]), np.array([0, 1]))
    by_tile = np.argsort(tile, kind="stable") if np.any(tile[1:] < tile[:-1]) else np.arange(count)
    by_tile = by_tile.astype(np.int32)
    tile_offsets = np.concatenate([[0], np.cumsum(np.bincount(tile, minlength=num_tiles))])
    starts, touched = _touched(blocks, by_tile, tile_offsets, num_blocks, -1)
    tile_color = greedy_colors(starts, touched, num_blocks, ground)
    crowded = tile_color == LAST_COLOR  # no colour was left: each such tile is a colour of its own
    tile_color[crowded] += np.arange(np.count_nonzero(crowded))

    by_color = np.lexsort((np.arange(num_tiles), tile_color))
    sizes = np.diff(tile_offsets)[by_color]
    return Ordering(
        _sorted_within(by_tile, tile_offsets, by_color, point_color),
        np.concatenate([[0], np.cumsum(sizes)]),
        np.concatenate([[0], np.cumsum(np.bincount(tile_color))]),
    )


def _sorted_within(
    by_tile: np.ndarray, tile_offsets: np.ndarray, tiles: np.ndarray, color: np.ndarray
) -> np.ndarray:
    """The points of the tiles in the order given, within a tile by colour and number."""
    order = np.empty(len(by_tile), np.int32)
    _sort_within(by_tile, tile_offsets, tiles, color, np.empty(65, np.int64), order)
    return order


@njit(**LEAN_ENTRY)
def _sort_within(by_tile, tile_offsets, tiles, color, place, order):
    at = 0
    for k in range(len(tiles)):
        first, last = tile_offsets[tiles[k]], tile_offsets[tiles[k] + 1]
        for c in range(65):
            place[c] = 0
        for n in range(first, last):
            place[color[by_tile[n]] + 1] += 1
        for c in range(64):
            place[c + 1] += place[c]
        for n in range(first, last):
            i = by_tile[n]
            order[at + place[color[i]]] = i
            place[color[i]] += 1
        at += last - first


def _touched(
    blocks: np.ndarray, order: np.ndarray, tile_offsets: np.ndarray, num_blocks: int, ignored: int
) -> tuple[np.ndarray, np.ndarray]:
    """The blocks that the points of each tile touch, once each: offsets and blocks."""
    if len(tile_offsets) == 2:
        members = np.unique(blocks)
        members = members[members != ignored]
        return np.array([0, len(members)]), members
    offsets, members = np.zeros_like(tile_offsets), np.empty(blocks.size, np.int32)
    _touch(blocks, order, tile_offsets, ignored, np.full(num_blocks, -1), offsets, members)
    return offsets, members[: offsets[-1]].copy()


@njit(**LEAN_ENTRY)
def _touch(blocks, order, tile_offsets, ignored, seen, offsets, members):
    count = 0
    for tile in range(len(tile_offsets) - 1):
        for n in range(tile_offsets[tile], tile_offsets[tile + 1]):
            for s in range(blocks.shape[1]):
                b = blocks[order[n], s]
                if b != ignored and seen[b] != tile:
                    seen[b] = tile
                    members[count] = b
                    count += 1
        offsets[tile + 1] = count


class TileBodies(NamedTuple):
    """The bodies that each tile touches."""

    offsets: np.ndarray  #: shape (num_tiles + 1,), first entry of each tile in `blocks`
    blocks: np.ndarray  #: blocks touched, the ground's left out


_NONE = np.zeros(1, np.int64)
# Of points that no sweep goes through.
NO_ORDER = Ordering(np.zeros(0, np.int32), _NONE, _NONE)
NO_TILES = TileBodies(_NONE, np.zeros(0, np.int32))


def bodies_of_tiles(ordering: Ordering, blocks: np.ndarray, num_blocks: int) -> TileBodies:
    """The bodies that each tile touches.

    Args:
        ordering: the tiles.
        blocks: shape (num_points, 2 or more), blocks of the points before they were put in order.
        num_blocks: number of blocks, the ground's (the last) included.
    """
    blocks = np.ascontiguousarray(blocks, dtype=np.int32)
    return TileBodies(
        *_touched(blocks, ordering.order, ordering.tile_offsets, num_blocks, num_blocks - 1)
    )


def join_tiles(tiles: Sequence[TileBodies]) -> TileBodies:
    """The bodies of all tiles, one group of tiles after another."""
    if len(tiles) < 2:
        return tiles[0] if tiles else NO_TILES
    starts = np.cumsum([0, *(len(t.blocks) for t in tiles)])
    offsets = [t.offsets[1:] + start for t, start in zip(tiles, starts, strict=False)]
    return TileBodies(np.concatenate([_NONE, *offsets]), np.concatenate([t.blocks for t in tiles]))


@njit(**LEAN_ENTRY)
def mark_next(marked, stats, tile_bodies, moved, threshold):
    """Mark the tiles that a sweep is to visit: those that touch a body which moved.

    Moved are, beside the bodies of `moved`, those of tiles whose impulses changed by more than the
    threshold (squared) in the last sweep. Tiles between bodies that nothing moves are marked too.
    """
    offsets, blocks = tile_bodies
    for tile in range(len(marked)):
        if stats[tile, 0] > threshold:
            for place in range(offsets[tile], offsets[tile + 1]):
                moved[blocks[place]] = True
    for tile in range(len(marked)):
        first, last = offsets[tile], offsets[tile + 1]
        marked[tile] = first == last  # else no body would ever call for its last visit
        for place in range(first, last):
            if moved[blocks[place]]:
                marked[tile] = True
                break
        if not marked[tile]:
            stats[tile, 0] = 0.0
