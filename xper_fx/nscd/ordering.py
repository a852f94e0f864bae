# SPDX-License-Identifier: LGPL-3.0-or-later
"""The order in which points are visited: tiles for the cache and the threads, colours within.

Consecutive bodies form a *tile* whose points are visited together, so that its velocities and
blocks of w stay in cache. Tiles of one colour share no body: threads take them at the same time,
and the numbers do not depend on how many threads there are. Within a tile, points are sorted by a
colour of their own: successive visits then touch different bodies and their arithmetic overlaps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

# Points a tile aims at: about 100 kB of point data and blocks of w.
_TILE_POINTS = 256


class Ordering(NamedTuple):
    """An order of points by colour of tile, tile, and colour of point.

    Attributes:
        order: shape (num_points,).
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
        return Ordering(np.zeros(0, np.int64), zero, zero)
    blocks = np.ascontiguousarray(blocks, dtype=np.int64)
    ground = num_blocks - 1
    point_color = _greedy_colors(np.arange(count + 1) * 2, blocks.ravel(), num_blocks, ground)

    bodies_a_tile = max(1, round(_TILE_POINTS * (num_blocks - 1) / count))
    _, tile = np.unique(blocks.min(axis=1) // bodies_a_tile, return_inverse=True)
    touched = np.unique(np.repeat(tile, 2) * num_blocks + blocks.ravel())
    starts = np.concatenate([[0], np.cumsum(np.bincount(touched // num_blocks))])
    tile_color = _greedy_colors(starts, touched % num_blocks, num_blocks, ground)
    crowded = tile_color == 63  # no colour was left: each such tile is a colour of its own
    tile_color[crowded] += np.arange(np.count_nonzero(crowded))

    order = np.lexsort((np.arange(count), point_color, tile, tile_color[tile]))
    by_color = np.lexsort((np.arange(len(tile_color)), tile_color))
    sizes = np.bincount(tile)[by_color]
    return Ordering(
        order,
        np.concatenate([[0], np.cumsum(sizes)]),
        np.concatenate([[0], np.cumsum(np.bincount(tile_color))]),
    )
