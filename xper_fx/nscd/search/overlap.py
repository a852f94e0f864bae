# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where two faces of polyhedra overlap: clipping, names of corners, the four that are kept.

Both faces are projected along the normal n; in the coordinates (u, w, h), h along n, the reference
face is cut out of the incident one, edge by edge (Sutherland and Hodgman 1974). A corner of the
overlap is a vertex of either body or the crossing of an edge of each, and named so, whichever face
was the reference: 4 v for vertex v of the first body, 4 v + 1 of the second, 4 (e m^2 + f) + 2 for
a crossing, with m the vertices of the second body and an edge e numbered by its ends, low m + high.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED
from xper_fx.nscd.rigid.bodies import ShapeTables


class Overlap(NamedTuple):
    """Room for an overlap and for clipping it."""

    place: np.ndarray  #: shape (2, room, 3), corners (u, w, h): the overlap in [0]
    edge: np.ndarray  #: shape (2, room), int64, the edge that leaves a corner; clipping edges as ~e
    #: shape (2, room, 2), int64, edges that cross at a corner: incident and reference
    crossed: np.ndarray
    name: np.ndarray  #: shape (room,), int64
    gap: np.ndarray  #: shape (room,)
    kept: np.ndarray  #: shape (room,), int64, corners that are kept


def overlap_room(tables: ShapeTables) -> Overlap:
    """Room for the overlap of any two faces."""
    room = 2 * int(np.diff(tables.loop_offsets).max(initial=0)) + 4
    return Overlap(
        np.empty((2, room, 3)),
        np.empty((2, room), np.int64),
        np.empty((2, room, 2), np.int64),
        np.empty(room, np.int64),
        np.empty(room),
        np.empty(room, np.int64),
    )


@njit(**MERGED)
def edge_number(p, q, count):
    """Number of the edge between two vertices of a body that has `count`."""
    return min(p, q) * count + max(p, q)


@njit(**MERGED)
def plane_axes(x, y, z):
    """Two unit vectors that make a right-handed frame with a unit normal (Duff et al. 2017)."""
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return (1.0 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)


@njit(**LEAN_INNER)
def clip(overlap, count, x0, y0, x1, y1, number, rounding):
    """Cut off what lies to the right of the line from (x0, y0) to (x1, y1).

    Args:
        overlap: the polygon in [0], counter-clockwise, replaced by what is left.
        count: its corners.
        x0, y0, x1, y1: ends of an edge of the reference.
        number: of that edge.
        rounding: distance (m) beyond the line that still counts as on it.

    Returns:
        How many corners are left.
    """
    place, edge, crossed = overlap.place, overlap.edge, overlap.crossed
    length = math.hypot(x1 - x0, y1 - y0)
    if length <= rounding:
        return count
    tx, ty = (x1 - x0) / length, (y1 - y0) / length
    left = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        here = tx * (place[0, i, 1] - y0) - ty * (place[0, i, 0] - x0)
        there = tx * (place[0, j, 1] - y0) - ty * (place[0, j, 0] - x0)
        inside = here >= -rounding
        if inside:
            for d in range(3):
                place[1, left, d] = place[0, i, d]
            edge[1, left] = edge[0, i]
            crossed[1, left, 0], crossed[1, left, 1] = crossed[0, i, 0], crossed[0, i, 1]
            left += 1
        if inside != (there >= -rounding):
            t = min(max(here / (here - there), 0.0), 1.0)
            for d in range(3):
                place[1, left, d] = place[0, i, d] + t * (place[0, j, d] - place[0, i, d])
            edge[1, left] = ~number if inside else edge[0, i]
            crossed[1, left, 0] = edge[0, i]
            crossed[1, left, 1] = number
            left += 1
    for i in range(left):
        for d in range(3):
            place[0, i, d] = place[1, i, d]
        edge[0, i] = edge[1, i]
        crossed[0, i, 0], crossed[0, i, 1] = crossed[1, i, 0], crossed[1, i, 1]
    return left


@njit(**LEAN_INNER)
def area_of(overlap, count):
    """Area of the overlap (m^2)."""
    place = overlap.place[0]
    twice = 0.0
    for i in range(1, count - 1):
        ux, uy = place[i, 0] - place[0, 0], place[i, 1] - place[0, 1]
        vx, vy = place[i + 1, 0] - place[0, 0], place[i + 1, 1] - place[0, 1]
        twice += ux * vy - uy * vx
    return 0.5 * abs(twice)


@njit(**LEAN_INNER)
def distinct(overlap, count):
    """Of corners with one name keep the deepest; returns how many are left."""
    left = 0
    for i in range(count):
        place = 0
        while place < left and overlap.name[place] != overlap.name[i]:
            place += 1
        if place == left or overlap.gap[i] < overlap.gap[place]:
            for d in range(3):
                overlap.place[0, place, d] = overlap.place[0, i, d]
            overlap.name[place] = overlap.name[i]
            overlap.gap[place] = overlap.gap[i]
        left = max(left, place + 1)
    return left


@njit(**LEAN_INNER)
def keep_four(overlap, count, x, y, near, rounding):
    """Choose at most four corners, by where they are in the plane, and sort them by name.

    The extreme ones along two directions fixed to the direction (x, y) of an edge are kept, then
    those furthest from all that are, an earlier corner unless a later one is further by more than
    `near`. The deepest is kept, instead of its nearest, if it is deeper than those by more than
    `rounding`: as long as the faces are parallel up to rounding, the choice does not change.

    Returns:
        How many are in `overlap.kept`.
    """
    place, name, gap, kept = overlap.place[0], overlap.name, overlap.gap, overlap.kept
    chosen = 0
    if count <= 4:
        for i in range(count):
            kept[i] = i
        chosen = count
    else:
        # Off the edge's direction, so that the two ends of an edge are not level.
        x, y = 0.95 * x - 0.31 * y, 0.31 * x + 0.95 * y
        for _ in range(4):
            x, y = -y, x
            best = 0
            for i in range(1, count):
                ahead = x * (place[i, 0] - place[best, 0]) + y * (place[i, 1] - place[best, 1])
                if ahead > near:
                    best = i
            new = True
            for k in range(chosen):
                new = new and kept[k] != best
            if new:
                kept[chosen] = best
                chosen += 1
        while chosen < 4:
            best, furthest = 0, -1.0
            for i in range(count):
                nearest = math.inf
                for k in range(chosen):
                    nearest = min(nearest, _apart(place, i, kept[k]))
                if nearest > furthest + near:
                    best, furthest = i, nearest
            kept[chosen] = best
            chosen += 1
        deepest = 0
        for i in range(1, count):
            if gap[i] < gap[deepest]:
                deepest = i
        least, nearest = math.inf, 0
        for k in range(chosen):
            least = min(least, gap[kept[k]])
            if _apart(place, deepest, kept[k]) < _apart(place, deepest, kept[nearest]):
                nearest = k
        if gap[deepest] < least - rounding:
            kept[nearest] = deepest
    for k in range(1, chosen):  # insertion
        i, m = kept[k], k
        while m > 0 and name[kept[m - 1]] > name[i]:
            kept[m] = kept[m - 1]
            m -= 1
        kept[m] = i
    return chosen


@njit(**MERGED)
def _apart(place, i, j):
    return math.hypot(place[i, 0] - place[j, 0], place[i, 1] - place[j, 1])
