# SPDX-License-Identifier: LGPL-3.0-or-later
"""Convex polyhedra against each other, spheres and half spaces.

The separation along a unit vector n is the lowest height of the first body less the highest of the
second. Its largest value s over the face normals of both and the cross products of edges that meet
on the Gauss map (Gregorius 2013) is minus the least translation that parts the two, if they
overlap, and else a lower bound of their distance: reached by a vertex and a face or by two edges
that cross. If neither is closest, a vertex and an edge, or two vertices, are, and all such pairs
are looked at.

Two edges of unit directions e, f whose faces have the normals (a1, a2) and (b1, b2) meet on the
Gauss map if the arc from a1 to a2 crosses that from -b1 to -b2:
(b1 . e)(b2 . e) < 0, (a1 . f)(a2 . f) < 0 and (b1 . e)(a2 . f) < 0.

Where a face gives s, or two edges whose faces nearly face each other, the overlap of the two faces
gives the points, four at most, each with its own height as its gap and an equal share of the
overlap as its area. Otherwise there is one point, and two where parallel edges are closest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER, MERGED
from xper_fx.nscd.rigid.bodies import ShapeTables
from xper_fx.nscd.search.contact_buffer import (
    POINT_AREA,
    ROUNDING,
    SAME_CORNER,
    Corners,
    Found,
    contact_key,
    put_contact,
)
from xper_fx.nscd.search.overlap import (
    Overlap,
    area_of,
    clip,
    distinct,
    edge_number,
    keep_four,
    overlap_room,
    plane_axes,
)
from xper_fx.nscd.search.spheres import put_ball

# Edges whose directions have a smaller sine between them are taken as parallel.
_PARALLEL = 1e-12
# Cosine between the normals of crossing edges and of their faces from which on the faces overlap.
_FACING = 0.7


class _FaceTables(NamedTuple):
    """Of `ShapeTables`, what tells of faces: each array that a kernel takes is compiled."""

    entry: np.ndarray
    face_offsets: np.ndarray
    face_distance: np.ndarray
    loop_offsets: np.ndarray
    loops: np.ndarray


class _EdgeTables(NamedTuple):
    """Of `ShapeTables`, what tells of edges."""

    entry: np.ndarray
    edge_offsets: np.ndarray
    edges: np.ndarray
    edge_faces: np.ndarray


def _part(kind: type, tables: ShapeTables) -> NamedTuple:
    """Those of the tables that a kind of tuple names."""
    return kind(*(getattr(tables, name) for name in kind._fields))


class Touching(NamedTuple):
    """Room for two points that face each other."""

    on_a: np.ndarray  #: shape (2, 3), on the first body (m)
    on_b: np.ndarray  #: shape (2, 3), on the second (m)
    name: np.ndarray  #: shape (2,), int64, as in `overlap`


@njit(**MERGED)
def _dot(array, i, x):
    return array[i, 0] * x[0] + array[i, 1] * x[1] + array[i, 2] * x[2]


@njit(**MERGED)
def _inner(x, y):
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(**MERGED)
def _row(array, i):
    return array[i, 0], array[i, 1], array[i, 2]


@njit(**MERGED)
def _minus(x, y):
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@njit(**MERGED)
def _distance(x, y):
    d = _minus(x, y)
    return math.sqrt(_inner(d, d))


@njit(**MERGED)
def _along(x, t, y):
    return x[0] + t * y[0], x[1] + t * y[1], x[2] + t * y[2]


@njit(**MERGED)
def _cross(x, y):
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@njit(**MERGED)
def _from_to(position, i, j):
    """From the centre of body i to that of body j."""
    return (
        position[j, 0] - position[i, 0],
        position[j, 1] - position[i, 1],
        position[j, 2] - position[i, 2],
    )


@njit(**LEAN_INNER)
def _lowest(corners, body, n):
    """Lowest height of a body's vertices about its centre, and the vertex."""
    start = corners.vertex_start[body]
    height, low = math.inf, 0
    for v in range(start, corners.vertex_start[body + 1]):
        h = _dot(corners.vertex, v, n)
        if h < height:
            height, low = h, v - start
    return height, low


@njit(**LEAN_INNER)
def _best_face(corners, tables, ref, other, offset, bounding, reach, rounding):
    """Face of `ref` with the largest separation, and the lowest vertex of `other` above it.

    `offset` leads from the centre of `ref` to that of `other`. Stops at the first face beyond the
    reach.
    """
    face_start = corners.face_start[ref]
    first = tables.face_offsets[tables.entry[ref]] - face_start
    best, face, vertex = -math.inf, 0, 0
    for f in range(face_start, corners.face_start[ref + 1]):
        n = _row(corners.normal, f)
        centre = _inner(n, offset) - tables.face_distance[first + f]
        if centre - bounding > reach:
            return centre - bounding, f - face_start, 0
        if centre <= best + rounding:
            continue
        height, low = _lowest(corners, other, n)
        if centre + height > best + rounding:
            best, face, vertex = centre + height, f - face_start, low
            if best > reach:
                break
    return best, face, vertex


@njit(**LEAN_INNER)
def _best_edges(corners, tables, bodies, offset, best, reach, rounding, along):
    """Edges of a and b whose separation exceeds `best`, the largest; the normal from b to a.

    Args:
        bodies: a and b.
        offset: from the centre of b to that of a.
        along: room for a number each face of b.

    Returns:
        (separation, edge of a, edge of b, normal); edges -1 if none exceeds `best`.
    """
    a, b = bodies
    a_edges, b_edges = tables.edge_offsets[tables.entry[a]], tables.edge_offsets[tables.entry[b]]
    a_vertex, b_vertex = corners.vertex_start[a], corners.vertex_start[b]
    a_face, b_face = corners.face_start[a], corners.face_start[b]
    edge_a, edge_b, normal = -1, -1, (0.0, 0.0, 0.0)
    for ea in range(a_edges, tables.edge_offsets[tables.entry[a] + 1]):
        p = _row(corners.vertex, a_vertex + tables.edges[ea, 0])
        e = _minus(_row(corners.vertex, a_vertex + tables.edges[ea, 1]), p)
        p = _along(p, 1.0, offset)
        smallest = _PARALLEL * _PARALLEL * _inner(e, e)
        a1, a2 = a_face + tables.edge_faces[ea, 0], a_face + tables.edge_faces[ea, 1]
        for f in range(b_face, corners.face_start[b + 1]):
            along[f - b_face] = _dot(corners.normal, f, e)
        for eb in range(b_edges, tables.edge_offsets[tables.entry[b] + 1]):
            b1, b2 = tables.edge_faces[eb, 0], tables.edge_faces[eb, 1]
            if along[b1] * along[b2] >= -smallest:
                continue
            q = _row(corners.vertex, b_vertex + tables.edges[eb, 0])
            f = _minus(_row(corners.vertex, b_vertex + tables.edges[eb, 1]), q)
            second = _dot(corners.normal, a2, f)
            if _dot(corners.normal, a1, f) * second >= 0.0 or along[b1] * second >= 0.0:
                continue
            n = _cross(e, f)
            length = math.sqrt(_inner(n, n))
            if length <= _PARALLEL * math.sqrt(_inner(e, e) * _inner(f, f)):
                continue
            outward = _dot(corners.normal, b_face + b1, n) + _dot(corners.normal, b_face + b2, n)
            scale = 1.0 / length if outward > 0.0 else -1.0 / length
            n = (scale * n[0], scale * n[1], scale * n[2])
            if _inner(n, _minus(p, q)) <= best + rounding:
                continue
            # Nearly parallel edges give a rough normal: what counts is the separation along it.
            low, _ = _lowest(corners, a, n)
            high, _ = _lowest(corners, b, (-n[0], -n[1], -n[2]))
            separation = _inner(n, offset) + low + high
            if separation > best + rounding:
                best, edge_a, edge_b, normal = separation, ea, eb, n
                if best > reach:
                    return best, edge_a, edge_b, normal
    return best, edge_a, edge_b, normal


@njit(**LEAN_INNER)
def _face_at(corners, tables, body, vertex, n):
    """Of the faces at a vertex the one whose normal is most opposed to n."""
    face_start = corners.face_start[body]
    first = tables.face_offsets[tables.entry[body]]
    least, face = math.inf, 0
    for f in range(corners.face_start[body + 1] - face_start):
        facing = _dot(corners.normal, face_start + f, n)
        if facing < least - SAME_CORNER:
            for k in range(tables.loop_offsets[first + f], tables.loop_offsets[first + f + 1]):
                if tables.loops[k] == vertex:
                    least, face = facing, f
    return face


@njit(**LEAN_INNER)
def _overlap(overlap, corners, tables, reference, incident, offset, n, rounding):
    """The overlap of two faces along n: corners with (u, w, h), h above the reference, as the gap.

    The reference and the incident face are pairs of a body and its face. `offset` leads from the
    centre of the one body to that of the other; (u, w) are about the former.

    Returns:
        How many corners there are; they have no names yet. Their `place` has the middle as h.
    """
    (ref, ref_face), (other, other_face) = reference, incident
    t1, t2 = plane_axes(n[0], n[1], n[2])
    start = corners.vertex_start[other]
    size = corners.vertex_start[other + 1] - start
    loop = tables.face_offsets[tables.entry[other]] + other_face
    first, last = tables.loop_offsets[loop], tables.loop_offsets[loop + 1]
    for k in range(last - 1, first - 1, -1):  # seen along n the incident face is clockwise
        count = last - 1 - k
        v = tables.loops[k]
        x = _along(offset, 1.0, _row(corners.vertex, start + v))
        overlap.place[0, count, 0] = _inner(t1, x)
        overlap.place[0, count, 1] = _inner(t2, x)
        overlap.place[0, count, 2] = _inner(n, x)
        after = tables.loops[k - 1] if k > first else tables.loops[last - 1]
        overlap.edge[0, count] = edge_number(v, after, size)
        overlap.crossed[0, count, 0] = overlap.crossed[0, count, 1] = -1
    count = last - first
    start = corners.vertex_start[ref]
    size = corners.vertex_start[ref + 1] - start
    loop = tables.face_offsets[tables.entry[ref]] + ref_face
    first, last = tables.loop_offsets[loop], tables.loop_offsets[loop + 1]
    for k in range(first, last):
        v = tables.loops[k]
        w = tables.loops[k + 1] if k + 1 < last else tables.loops[first]
        x, y = _row(corners.vertex, start + v), _row(corners.vertex, start + w)
        count = clip(
            overlap, count, _inner(t1, x), _inner(t2, x), _inner(t1, y), _inner(t2, y),
            edge_number(v, w, size), rounding,
        )  # fmt: skip
    # Heights above the plane of the reference, which may be inclined if edges gave the normal.
    m = _row(corners.normal, corners.face_start[ref] + ref_face)
    upright = _inner(m, n)
    slope_u, slope_w = _inner(m, t1) / upright, _inner(m, t2) / upright
    level = tables.face_distance[loop] / upright
    for i in range(count):
        u, w, h = _row(overlap.place[0], i)
        below = level - slope_u * u - slope_w * w
        overlap.gap[i] = h - below
        overlap.place[0, i, 2] = 0.5 * (h + below)
    return count


@njit(**LEAN_INNER)
def _give_names(overlap, count, corners, tables, sides, ref_is_first, n, near):
    """Name the corners of an overlap after vertices nearby, the first body's before the second's.

    Args:
        sides: first and second body, their faces, and the offsets of the bodies' centres from that
            of the reference.
    """
    bodies, faces, offsets = sides
    t1, t2 = plane_axes(n[0], n[1], n[2])
    second_size = corners.vertex_start[bodies[1] + 1] - corners.vertex_start[bodies[1]]
    for i in range(count):
        incident, reference = overlap.crossed[0, i, 0], overlap.crossed[0, i, 1]
        e, f = (reference, incident) if ref_is_first else (incident, reference)
        overlap.name[i] = 4 * (e * second_size * second_size + f) + 2
        named = False
        for side in range(2):
            loop = tables.face_offsets[tables.entry[bodies[side]]] + faces[side]
            start = corners.vertex_start[bodies[side]]
            for k in range(tables.loop_offsets[loop], tables.loop_offsets[loop + 1]):
                v = tables.loops[k]
                x = _along(offsets[side], 1.0, _row(corners.vertex, start + v))
                u = _inner(t1, x) - overlap.place[0, i, 0]
                w = _inner(t2, x) - overlap.place[0, i, 1]
                if not named and u * u + w * w <= near * near:
                    overlap.name[i] = 4 * v + side
                    named = True


@njit(**MERGED)
def _foot(x, p, e):
    """Where on the segment from p along e the point closest to x is, from 0 to 1."""
    return min(max(_inner(_minus(x, p), e) / _inner(e, e), 0.0), 1.0)


@njit(**LEAN_INNER)
def _closest_vertices_edges(touching, corners, tables, bodies, offset, n, near, rounding):
    """Closest of the vertices of either body and the edges of the other: one pair or two.

    Edges that are parallel have two, at the ends of what faces.

    Args:
        touching: `Touching`, for the points about the centre of b, and their names.
        corners, tables: of all bodies.
        bodies: a and b.
        offset: from the centre of b to that of a.
        n: a unit vector from b to a. Vertices that are further from the other body along it than
            what has been found need no closer look.
        near: points closer than this are one (m).
        rounding: distances that differ by less are equal (m).

    Returns:
        (distance, number of points).
    """
    a, b = bodies
    least, count = math.inf, 0
    zero = (0.0, 0.0, 0.0)
    height, _ = _lowest(corners, a, n)
    depth, _ = _lowest(corners, b, (-n[0], -n[1], -n[2]))
    lowest_a, highest_b = height + _inner(n, offset), -depth
    for side in range(2):
        one, other = (a, b) if side == 0 else (b, a)
        one_at, other_at = (offset, zero) if side == 0 else (zero, offset)
        one_start, other_start = corners.vertex_start[one], corners.vertex_start[other]
        entry = tables.entry[other]
        for v in range(one_start, corners.vertex_start[one + 1]):
            x = _along(one_at, 1.0, _row(corners.vertex, v))
            above = _inner(n, x) - highest_b if side == 0 else lowest_a - _inner(n, x)
            if above > least + rounding:
                continue
            for k in range(tables.edge_offsets[entry], tables.edge_offsets[entry + 1]):
                p = _row(corners.vertex, other_start + tables.edges[k, 0])
                e = _minus(_row(corners.vertex, other_start + tables.edges[k, 1]), p)
                p = _along(other_at, 1.0, p)
                y = _along(p, _foot(x, p, e), e)
                d = _minus(x, y)
                distance = math.sqrt(_inner(d, d))
                if distance > least + rounding:
                    continue
                if distance < least - rounding:
                    count = 0
                least = min(least, distance)
                place = count
                if count > 0:
                    mine = x if side == 0 else y
                    apart = _distance(mine, _row(touching.on_a, 0))
                    if apart <= near:
                        continue
                    if count == 2:
                        if (
                            apart
                            <= _distance(_row(touching.on_a, 1), _row(touching.on_a, 0)) + near
                        ):
                            continue
                        place = 1
                for c in range(3):
                    touching.on_a[place, c] = x[c] if side == 0 else y[c]
                    touching.on_b[place, c] = y[c] if side == 0 else x[c]
                touching.name[place] = 4 * (v - one_start) + side
                count = place + 1
    return least, count


class _Pointed(NamedTuple):
    """Room for pairs whose faces do not overlap, each with one point on either body."""

    #: shape (n, 4), int64: a, b, the name of the point, as in `overlap`, and whether it is where
    #: two edges cross
    which: np.ndarray
    #: shape (n, 3, 3), the points of a and b about the centre of b (m), and the normal from b to a
    vectors: np.ndarray
    separation: np.ndarray  #: shape (n,), along the normal (m)


class _Room(NamedTuple):
    """Room for what pairs are looked at with: an overlap, a number each face, and other pairs."""

    overlap: Overlap
    along: np.ndarray
    pointed: _Pointed


def polyhedron_polyhedron(
    found: Found,
    pairs: np.ndarray,
    position: np.ndarray,
    corners: Corners,
    tables: ShapeTables,
    bounding_radius: np.ndarray,
    reach: float,
) -> int:
    """Contacts of convex polyhedra, four at most of a pair.

    Args:
        pairs: shape (num_pairs, 2), candidate and antagonist.
        position: shape (num_bodies, 3), centres (m).
        bounding_radius: shape (num_bodies,), m.
        reach: largest gap of a contact (m).

    Returns:
        How many contacts there are.
    """
    faces, edges = _part(_FaceTables, tables), _part(_EdgeTables, tables)
    size = len(pairs)
    pointed = _Pointed(np.empty((size, 4), np.int64), np.empty((size, 3, 3)), np.empty(size))
    room = _Room(overlap_room(tables), np.empty(len(tables.face_distance)), pointed)
    count, others = _polyhedra(
        found, pairs, position, corners, (faces, edges), bounding_radius, reach, room
    )
    if others > 0:  # else the kernel is not compiled
        count += _without_overlap(
            Found(*(array[count:] for array in found)),
            _Pointed(*(array[:others] for array in pointed)),
            position,
            corners,
            edges,
            bounding_radius,
            reach,
            Touching(np.empty((2, 3)), np.empty((2, 3)), np.empty(2, np.int64)),
        )
    return count


@njit(**LEAN_ENTRY)
def _polyhedra(found, pairs, position, corners, tables, bounding_radius, reach, room):
    """Contacts of pairs whose faces overlap; the others are put into `pointed`.

    Returns:
        How many contacts and how many other pairs there are.
    """
    faces, edges = tables
    overlap, along, pointed = room
    num_bodies = len(position)
    zero = (0.0, 0.0, 0.0)
    count = others = 0
    for pair in range(len(pairs)):
        a = pairs[pair, 0]
        b = pairs[pair, 1]
        to_a = _from_to(position, b, a)
        to_b = _from_to(position, a, b)
        size = bounding_radius[a] + bounding_radius[b]
        smaller = min(bounding_radius[a], bounding_radius[b])
        near = SAME_CORNER * smaller
        if _inner(to_a, to_a) > (size + reach) ** 2:
            continue
        rounding = ROUNDING * size
        on_b, face_b, low_a = _best_face(
            corners, faces, b, a, to_a, bounding_radius[a], reach, rounding
        )
        if on_b > reach:
            continue
        on_a, face_a, low_b = _best_face(
            corners, faces, a, b, to_b, bounding_radius[b], reach, rounding
        )
        if on_a > reach:
            continue
        best = max(on_a, on_b)
        separation, edge_a, edge_b, crossing = _best_edges(
            corners, edges, (a, b), to_a, best, reach, rounding, along
        )
        if separation > reach:
            continue

        # The reference at the origin, the other above it along n; `outward` turns n from b to a.
        # `single` is one point on either body, about the centre of b, and its name.
        ref, other, offset, outward = b, a, to_a, 1.0
        facing = True
        single = zero, zero, 0
        if edge_a >= 0:
            n = crossing
            ends_a, ends_b = edges.edges[edge_a], edges.edges[edge_b]
            start_a, start_b = corners.vertex_start[a], corners.vertex_start[b]
            p = _along(to_a, 1.0, _row(corners.vertex, start_a + ends_a[0]))
            e = _minus(_along(to_a, 1.0, _row(corners.vertex, start_a + ends_a[1])), p)
            q = _row(corners.vertex, start_b + ends_b[0])
            f = _minus(_row(corners.vertex, start_b + ends_b[1]), q)
            m = _cross(e, f)
            square = _inner(m, m)
            r = _minus(q, p)
            s, t = _inner(_cross(r, f), m) / square, _inner(_cross(r, e), m) / square
            crosses = min(s, t) >= -ROUNDING and max(s, t) <= 1.0 + ROUNDING
            num_a = corners.vertex_start[a + 1] - start_a
            num_b = corners.vertex_start[b + 1] - start_b
            name = edge_number(ends_a[0], ends_a[1], num_a) * num_b * num_b
            name = 4 * (name + edge_number(ends_b[0], ends_b[1], num_b)) + 2
            single = _along(p, s, e), _along(q, t, f), name
            sides = edges.edge_faces[edge_a]
            face_a = sides[0]
            start = corners.face_start[a]
            if _dot(corners.normal, start + sides[1], n) < _dot(corners.normal, start + face_a, n):
                face_a = sides[1]
            facing = _dot(corners.normal, start + face_a, n) < -_FACING
            sides = edges.edge_faces[edge_b]
            face_b = sides[0]
            start = corners.face_start[b]
            if _dot(corners.normal, start + sides[1], n) > _dot(corners.normal, start + face_b, n):
                face_b = sides[1]
            facing = facing and _dot(corners.normal, start + face_b, n) > _FACING
            if -_dot(corners.normal, corners.face_start[a] + face_a, n) > (
                _dot(corners.normal, corners.face_start[b] + face_b, n) + rounding / size
            ):
                ref, other, offset, outward = a, b, to_b, -1.0
                n = (-n[0], -n[1], -n[2])
        elif on_a > on_b - rounding:
            ref, other, offset, outward = a, b, to_b, -1.0
            n = _row(corners.normal, corners.face_start[a] + face_a)
            face_b = _face_at(corners, faces, b, low_b, n)
            x = _row(corners.vertex, corners.vertex_start[b] + low_b)
            single = _along(x, -on_a, n), x, 4 * low_b + 1
            crosses = False
            separation = on_a
        else:
            n = _row(corners.normal, corners.face_start[b] + face_b)
            face_a = _face_at(corners, faces, a, low_a, n)
            x = _along(to_a, 1.0, _row(corners.vertex, corners.vertex_start[a] + low_a))
            single = x, _along(x, -on_b, n), 4 * low_a
            crosses = False
            separation = on_b

        corners_found = 0
        if facing:
            ref_face, other_face = (face_b, face_a) if ref == b else (face_a, face_b)
            reference, incident = (ref, ref_face), (other, other_face)
            corners_found = _overlap(
                overlap, corners, faces, reference, incident, offset, n, rounding
            )
            least = math.inf
            for i in range(corners_found):
                least = min(least, overlap.gap[i])
            if not least <= separation + 10.0 * rounding:
                corners_found = 0
        if corners_found > 0:
            area = area_of(overlap, corners_found)
            offsets = (to_a, zero) if ref == b else (zero, to_b)
            named = (a, b), (face_a, face_b), offsets
            _give_names(overlap, corners_found, corners, faces, named, ref == a, n, near)
            corners_found = distinct(overlap, corners_found)
            t1, t2 = plane_axes(n[0], n[1], n[2])
            loop = faces.loop_offsets[faces.face_offsets[faces.entry[ref]] + ref_face]
            start = corners.vertex_start[ref]
            x = _row(corners.vertex, start + faces.loops[loop])
            x = _minus(_row(corners.vertex, start + faces.loops[loop + 1]), x)
            length = math.sqrt(_inner(x, x))
            u, w = _inner(t1, x) / length, _inner(t2, x) / length
            kept = keep_four(overlap, corners_found, u, w, near, rounding)
            area = max(area / kept, POINT_AREA * smaller * smaller)
            for k in range(kept):
                i = overlap.kept[k]
                if overlap.gap[i] <= reach:
                    u, w, h = _row(overlap.place[0], i)
                    x = _along(_along(_row(position, ref), u, t1), w, t2)
                    x = _along(x, h, n)
                    key = contact_key((a, b), num_bodies, overlap.name[i])
                    normal = (outward * n[0], outward * n[1], outward * n[2])
                    count = put_contact(found, count, (a, b), key, x, normal, overlap.gap[i], area)
            continue

        pointed.which[others, 0], pointed.which[others, 1] = a, b
        pointed.which[others, 2], pointed.which[others, 3] = single[2], crosses
        for c in range(3):
            pointed.vectors[others, 0, c] = single[0][c]
            pointed.vectors[others, 1, c] = single[1][c]
            pointed.vectors[others, 2, c] = outward * n[c]
        pointed.separation[others] = separation
        others += 1
    return count, others


@njit(**LEAN_ENTRY)
def _without_overlap(found, pointed, position, corners, tables, bounding_radius, reach, touching):
    """Contacts of pairs whose faces do not overlap; returns how many there are."""
    count = 0
    num_bodies = len(position)
    for pair in range(len(pointed.separation)):
        a, b = pointed.which[pair, 0], pointed.which[pair, 1]
        to_a = _from_to(position, b, a)
        smaller = min(bounding_radius[a], bounding_radius[b])
        near = SAME_CORNER * smaller
        rounding = ROUNDING * (bounding_radius[a] + bounding_radius[b])
        n = _row(pointed.vectors[pair], 2)
        gap = separation = pointed.separation[pair]
        points = 1
        for c in range(3):
            touching.on_a[0, c] = pointed.vectors[pair, 0, c]
            touching.on_b[0, c] = pointed.vectors[pair, 1, c]
        touching.name[0] = pointed.which[pair, 2]
        if separation > -10.0 * rounding and pointed.which[pair, 3] == 0:
            distance, points = _closest_vertices_edges(
                touching, corners, tables, (a, b), to_a, n, near, rounding
            )
            if separation > 0.0 and distance > 10.0 * rounding:
                gap = distance
                d = _minus(_row(touching.on_a, 0), _row(touching.on_b, 0))
                length = math.sqrt(_inner(d, d))
                n = (d[0] / length, d[1] / length, d[2] / length)
        if gap > reach:
            continue
        for k in range(points):
            i = k if touching.name[0] < touching.name[points - 1] else points - 1 - k
            middle = _along(_row(touching.on_a, i), 1.0, _row(touching.on_b, i))
            middle = _along(_row(position, b), 0.5, middle)
            area = POINT_AREA * smaller * smaller
            key = contact_key((a, b), num_bodies, touching.name[i])
            count = put_contact(found, count, (a, b), key, middle, n, gap, area)
    return count


def polyhedron_wall(
    found: Found, pairs: np.ndarray, position: np.ndarray, corners: Corners, tables: ShapeTables,
    bounding_radius: np.ndarray, wall_normal: np.ndarray, reach: float,
) -> int:  # fmt: skip
    """Contacts of convex polyhedra with half spaces: corners of the lowest face, four at most.

    Args:
        found, position, corners, tables, bounding_radius, reach: as `polyhedron_polyhedron`.
        pairs: shape (num_pairs, 2), polyhedron and wall.
        wall_normal: shape (num_bodies, 3), outward unit normals of the walls.

    Returns:
        How many contacts there are.
    """
    return _polyhedra_walls(
        found, pairs, position, corners, _part(_FaceTables, tables), bounding_radius, wall_normal,
        reach, overlap_room(tables),
    )  # fmt: skip


@njit(**LEAN_ENTRY)
def _polyhedra_walls(
    found, pairs, position, corners, tables, bounding_radius, wall_normal, reach, overlap
):
    count = 0
    for pair in range(len(pairs)):
        a = pairs[pair, 0]
        b = pairs[pair, 1]
        n = _row(wall_normal, b)
        centre = _inner(n, _from_to(position, b, a))
        if centre > reach + bounding_radius[a]:
            continue
        height, low = _lowest(corners, a, n)
        if centre + height > reach:
            continue
        face = _face_at(corners, tables, a, low, n)
        t1, t2 = plane_axes(n[0], n[1], n[2])
        loop = tables.face_offsets[tables.entry[a]] + face
        start = corners.vertex_start[a]
        num = 0
        for k in range(tables.loop_offsets[loop], tables.loop_offsets[loop + 1]):
            v = tables.loops[k]
            x = _row(corners.vertex, start + v)
            overlap.place[0, num, 0] = _inner(t1, x)
            overlap.place[0, num, 1] = _inner(t2, x)
            overlap.place[0, num, 2] = _inner(n, x)
            overlap.gap[num] = centre + overlap.place[0, num, 2]
            overlap.name[num] = v
            num += 1
        u = overlap.place[0, 1, 0] - overlap.place[0, 0, 0]
        w = overlap.place[0, 1, 1] - overlap.place[0, 0, 1]
        length = math.hypot(u, w)
        size = bounding_radius[a]
        area = area_of(overlap, num)
        if length > SAME_CORNER * size:
            u, w = u / length, w / length
        kept = keep_four(overlap, num, u, w, SAME_CORNER * size, ROUNDING * size)
        area = max(area / kept, POINT_AREA * size * size)
        for k in range(kept):
            i = overlap.kept[k]
            gap = overlap.gap[i]
            if gap <= reach:
                x = _row(corners.vertex, start + overlap.name[i])
                x = _along(_along(_row(position, a), 1.0, x), -0.5 * gap, n)
                key = contact_key((a, b), len(position), overlap.name[i])
                count = put_contact(found, count, (a, b), key, x, n, gap, area)
    return count


@njit(**LEAN_ENTRY)
def sphere_polyhedron(found, pairs, position, radius, corners, tables, reach):
    """Contacts of spheres with convex polyhedra.

    Args:
        found, position, corners, tables, reach: as `polyhedron_polyhedron`.
        pairs: shape (num_pairs, 2), sphere and polyhedron.
        radius: shape (num_bodies,), of the spheres (m).

    Returns:
        How many contacts there are.
    """
    count = 0
    for pair in range(len(pairs)):
        i = pairs[pair, 0]
        j = pairs[pair, 1]
        centre = _from_to(position, j, i)
        within = radius[i] + reach
        entry, start = tables.entry[j], corners.vertex_start[j]
        face_start, first = corners.face_start[j], tables.face_offsets[entry]
        height, face = -math.inf, 0
        for f in range(corners.face_start[j + 1] - face_start):
            above = _dot(corners.normal, face_start + f, centre) - tables.face_distance[first + f]
            if above > height:
                height, face = above, f
                if height > within:
                    break
        if height > within:
            continue
        n = _row(corners.normal, face_start + face)
        distance = height
        above_face = True
        loop_start, loop_end = (
            tables.loop_offsets[first + face],
            tables.loop_offsets[first + face + 1],
        )
        for k in range(loop_start, loop_end):
            v = start + tables.loops[k]
            w = start + tables.loops[k + 1 if k + 1 < loop_end else loop_start]
            p = _row(corners.vertex, v)
            side = _cross(_minus(_row(corners.vertex, w), p), _minus(centre, p))
            above_face = above_face and _inner(side, n) >= 0.0
        if height > 0.0 and not above_face:
            least, closest = math.inf, centre
            for k in range(tables.edge_offsets[entry], tables.edge_offsets[entry + 1]):
                p = _row(corners.vertex, start + tables.edges[k, 0])
                e = _minus(_row(corners.vertex, start + tables.edges[k, 1]), p)
                x = _along(p, _foot(centre, p, e), e)
                d = _minus(centre, x)
                square = _inner(d, d)
                if square < least:
                    least, closest = square, x
            distance = math.sqrt(least)
            if distance > ROUNDING * radius[i]:
                d = _minus(centre, closest)
                n = (d[0] / distance, d[1] / distance, d[2] / distance)
        gap = distance - radius[i]
        if gap <= reach:
            count = put_ball(found, count, (i, j), len(position), position, radius[i], n, gap)
    return count
