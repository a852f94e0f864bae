# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of nodes with rigid shapes, which are convex: one point of each touches a node.

Outside, the closest point q of the shape, n = (x - q)/|x - q| and g = |x - q|; where q is at a
corner or on an edge, x must be the foremost point of its own surface, for else the corner touches a
facet. Inside, of the faces that the node's own facets face the nearest one; of faces as near
that one which more of their area faces: at a corner of a wedge the node of a wall touches the
wedge's side, though its lower face is as near. Another face may be nearer by no more than the
node's depth: a node on the edge of a surface, whose facets are all of one side, would else be
pushed across the whole shape. Both sides act at the node itself, so that no impulse has a moment, a
tangential one neither.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.rigid.bodies import ShapeTables
from xper_fx.nscd.rigid.shapes import DISC, HALF_PLANE, HALF_SPACE, SPHERE
from xper_fx.nscd.search.facet_geometry import Faces, facing_area, is_tip

# Least part of a node's area that faces a contact.
_FACING = 0.05
# Difference of heights of faces, beside a node's depth, at which the more facing one is taken.
_ALIKE = 1e-6
# Share of a shape's radius below which a distance has no direction.
_NO_DISTANCE = 1e-9


@njit(**LEAN_INNER)
def closest_on_face(y, vertices, first, loop, face_normal, height, q):
    """Write the point of a face closest to y into q; whether it is inside the face.

    `first` is the shape's first vertex, `height` the distance of y from the face's plane.
    """
    dim = len(y)
    count = len(loop)
    for d in range(dim):
        q[d] = y[d] - height * face_normal[d]
    sides = 1 if dim == 2 else count
    inside = True
    for j in range(sides):
        a, b = vertices[first + loop[j]], vertices[first + loop[(j + 1) % count]]
        if dim == 2:
            along = square = 0.0
            for d in range(2):
                along += (q[d] - a[d]) * (b[d] - a[d])
                square += (b[d] - a[d]) ** 2
            inside = 0.0 <= along <= square
        else:
            turned = 0.0
            for d in range(3):
                e, g = (d + 1) % 3, (d + 2) % 3
                turned += face_normal[d] * (
                    (b[e] - a[e]) * (q[g] - a[g]) - (b[g] - a[g]) * (q[e] - a[e])
                )
            inside = inside and turned >= 0.0
    if inside:
        return True
    best = np.inf
    side = 0
    part = 0.0
    for j in range(sides):
        a, b = vertices[first + loop[j]], vertices[first + loop[(j + 1) % count]]
        uu = pu = rr = 0.0
        for d in range(dim):
            u, r = b[d] - a[d], y[d] - a[d]
            uu += u * u
            pu += r * u
            rr += r * r
        t = min(max(pu / uu, 0.0), 1.0)
        square = rr + t * (t * uu - 2.0 * pu)
        if square < best:
            best = square
            side = j
            part = t
    a, b = vertices[first + loop[side]], vertices[first + loop[(side + 1) % count]]
    for d in range(dim):
        q[d] = (1.0 - part) * a[d] + part * b[d]
    return False


class OnRigid(NamedTuple):
    """Contacts of nodes with rigid bodies; the first `found` rows."""

    pair: np.ndarray  #: shape (n,), int32, of those that were looked at
    normal: np.ndarray  #: shape (n, dim)
    gap: np.ndarray  #: shape (n,), m
    area: np.ndarray  #: shape (n,), m^2 (2D: m)


def nodes_on_rigid(
    pairs: np.ndarray,
    faces: Faces,
    position: np.ndarray,
    turn: np.ndarray,
    shapes: ShapeTables,
    reach: float,
) -> OnRigid:
    """Find the contacts of nodes with rigid bodies.

    Args:
        pairs: nodes and bodies that may touch, shape (p, 2).
        position: of the rigid bodies, shape (n, dim), m.
        turn: from their axes to those of space, shape (n, dim, dim).
        reach: largest gap (m).
    """
    room, dim = len(pairs), position.shape[1]
    out = OnRigid(np.empty(room, np.int32), np.empty((room, dim)), np.empty(room), np.empty(room))
    found = _node_rigid(pairs, faces, position, turn, shapes, reach, out, np.empty((4, dim)))
    return OnRigid(*(array[:found] for array in out))


@njit(**LEAN_ENTRY)
def _node_rigid(pairs, faces, position, turn, shapes, reach, out, room):
    """Write the contacts into `out`, and return their number; `room` is for four vectors."""
    dim = position.shape[1]
    y, q, n, world = room[0], room[1], room[2], room[3]
    count = 0
    for i in range(len(pairs)):
        node, body = pairs[i]
        p = faces.x[node]
        kind = shapes.kind[body]
        tip = False
        gap = np.inf
        if kind == HALF_PLANE or kind == HALF_SPACE:
            gap = 0.0
            for d in range(dim):
                n[d] = turn[body, d, dim - 1]
                gap += n[d] * (p[d] - position[body, d])
        elif kind == DISC or kind == SPHERE:
            square = 0.0
            for d in range(dim):
                n[d] = p[d] - position[body, d]
                square += n[d] * n[d]
            distance = np.sqrt(square)
            gap = distance - shapes.radius[body]
            if gap > reach or distance == 0.0:
                continue
            for d in range(dim):
                n[d] /= distance
        else:
            entry = shapes.entry[body]
            first = shapes.vertex_offsets[entry]
            for d in range(dim):
                y[d] = 0.0
                for e in range(dim):
                    y[d] += turn[body, e, d] * (p[e] - position[body, e])
            highest = -np.inf
            for f in range(shapes.face_offsets[entry], shapes.face_offsets[entry + 1]):
                height = -shapes.face_distance[f]
                for d in range(dim):
                    height += y[d] * shapes.face_normal[f, d]
                highest = max(highest, height)
            if highest > reach:
                continue
            flat = False
            if highest > 0.0:
                least = np.inf
                for f in range(shapes.face_offsets[entry], shapes.face_offsets[entry + 1]):
                    height = -shapes.face_distance[f]
                    for d in range(dim):
                        height += y[d] * shapes.face_normal[f, d]
                    if height <= 0.0:
                        continue
                    loop = shapes.loops[shapes.loop_offsets[f] : shapes.loop_offsets[f + 1]]
                    inside = closest_on_face(
                        y, shapes.vertices, first, loop, shapes.face_normal[f], height, q
                    )
                    square = 0.0
                    for d in range(dim):
                        square += (y[d] - q[d]) ** 2
                    if square < least:
                        least = square
                        flat = inside
                        gap = height if inside else np.sqrt(square)
                        for d in range(dim):
                            if inside:
                                n[d] = shapes.face_normal[f, d]
                            else:
                                n[d] = (y[d] - q[d]) / gap
                if gap > reach:
                    continue
                tip = not flat
            if not flat and (highest <= 0.0 or gap <= _NO_DISTANCE * shapes.bounding_radius[body]):
                # inside, or at a corner: of the faces that the node faces the nearest
                tip = False
                lowest = best = -np.inf
                for facet in faces.own_facets[faces.own_start[node] : faces.own_start[node + 1]]:
                    lowest = max(lowest, highest - faces.depth[facet])
                alike = _ALIKE * (highest - lowest)
                for f in range(shapes.face_offsets[entry], shapes.face_offsets[entry + 1]):
                    height = -shapes.face_distance[f]
                    for d in range(dim):
                        height += y[d] * shapes.face_normal[f, d]
                        world[d] = 0.0
                        for e in range(dim):
                            world[d] += turn[body, d, e] * shapes.face_normal[f, e]
                    if height <= lowest:
                        continue
                    area, whole = facing_area(world, node, faces)
                    if area >= _FACING * whole and (height - best) * area > alike * whole:
                        best = height - alike * whole / area
                        gap = height
                        for d in range(dim):
                            n[d] = shapes.face_normal[f, d]
                if best == -np.inf:
                    continue
            for d in range(dim):
                world[d] = 0.0
                for e in range(dim):
                    world[d] += turn[body, d, e] * n[e]
            for d in range(dim):
                n[d] = world[d]
        if gap > reach:
            continue
        area, whole = facing_area(n, node, faces)
        if area < _FACING * whole or (tip and not is_tip(n, node, faces)):
            continue
        out.pair[count] = i
        out.gap[count] = gap
        out.area[count] = area
        for d in range(dim):
            out.normal[count, d] = n[d]
        count += 1
    return count
