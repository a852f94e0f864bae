# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of a cluster's parts as contacts of the whole.

Where two parts meet there is no surface: the face between them lies inside the cluster, and a
block that slides across the seam, deeper than the surface by rounding or by an impact, would be
stopped by it. A contact of a part, with x the point on it and n the normal out of it, is one of the
whole if x is the point of the whole that is closest to x + e n for a small e (a proximal normal:
Clarke, Ledyaev, Stern and Wolenski 1998, section 1.1):

    distance(x + e n, part) >= e  for all other parts.                                          (1)

Otherwise the part's surface may still be that of the whole close by: at a reentrant corner, or at a
seam between two faces of one plane. Of the part's faces that have a point with (1) no further than
d from x, d > e, the one whose normal m is closest to n takes the contact, at the lowest point of
the other body above it, unless that is lower by more than d. Where m is n this changes nothing. A
contact without such a face, m . n > 0, is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.rigid.bodies import ShapeTables
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.nscd.search.node_rigid import closest_on_face
from xper_fx.nscd.search.overlap import plane_axes

# e and d of the module's docstring, as shares of the smaller of the two that touch.
_OUT, _NEAR = 1e-3, 1e-2
# Share of e that rounding may take.
_ROUNDING = 1e-6
# Least m . n, and m . n from which they are the same.
_LEAST, _SAME = 0.1, 1.0 - 1e-12


class Pieces(NamedTuple):
    """Pieces where they are; attributes as the arguments of `on_the_whole`.

    `first` is the first piece of each body, with their number at the end.
    """

    tables: ShapeTables
    first: np.ndarray
    position: np.ndarray
    turn: np.ndarray


def on_the_whole(
    contacts: Contacts, tables: ShapeTables, position: np.ndarray, turn: np.ndarray
) -> Contacts:
    """The contacts on surfaces of whole clusters.

    Args:
        contacts: with pieces in the place of bodies; changed.
        tables: of all pieces.
        position: of the pieces' centres, shape (num_pieces, dim), m.
        turn: from their axes to those of space, shape (num_pieces, dim, dim).
    """
    kept = np.ones(len(contacts), bool)
    first = np.searchsorted(tables.body, np.arange(tables.body[-1] + 2))
    pieces = Pieces(tables, first, position, turn)
    _look_at_whole(
        contacts.body,
        contacts.point,
        contacts.normal,
        contacts.gap,
        pieces,
        np.empty((9, contacts.dim)),
        kept,
    )
    return contacts.take(np.flatnonzero(kept))


@njit(**LEAN_INNER)
def _distance(p, piece, pieces, y, q):
    """Distance of a point from a piece that is no wall (m); negative inside."""
    tables, _, position, turn = pieces
    dim = len(p)
    entry = tables.entry[piece]
    if entry < 0:
        square = 0.0
        for d in range(dim):
            square += (p[d] - position[piece, d]) ** 2
        return np.sqrt(square) - tables.radius[piece]
    for d in range(dim):
        y[d] = 0.0
        for e in range(dim):
            y[d] += turn[piece, e, d] * (p[e] - position[piece, e])
    highest, least = -np.inf, np.inf
    for f in range(tables.face_offsets[entry], tables.face_offsets[entry + 1]):
        height = -tables.face_distance[f]
        for d in range(dim):
            height += y[d] * tables.face_normal[f, d]
        highest = max(highest, height)
        if height <= 0.0:
            continue
        loop = tables.loops[tables.loop_offsets[f] : tables.loop_offsets[f + 1]]
        closest_on_face(
            y, tables.vertices, tables.vertex_offsets[entry], loop, tables.face_normal[f], height, q
        )
        square = 0.0
        for d in range(dim):
            square += (y[d] - q[d]) ** 2
        least = min(least, square)
    return np.sqrt(least) if highest > 0.0 else highest


@njit(**LEAN_INNER)
def _is_free(p, n, size, own, pieces, room):
    """Whether (1) holds at a point of a piece."""
    y, q, moved = room[0], room[1], room[2]
    out = _OUT * size
    for d in range(len(p)):
        moved[d] = p[d] + out * n[d]
    body = pieces.tables.body[own]
    for k in range(pieces.first[body], pieces.first[body + 1]):
        if k != own and _distance(moved, k, pieces, y, q) < (1.0 - _ROUNDING) * out:
            return False
    return True


@njit(**LEAN_INNER)
def _is_free_near(x, m, size, own, pieces, room):
    """Whether (1) holds, with the normal m of a face, at a point of the face near x, or at x."""
    dim = len(x)
    p, t1, t2 = room[3], room[4], room[5]
    if dim == 2:
        t1[0], t1[1] = -m[1], m[0]
    else:
        (t1[0], t1[1], t1[2]), (t2[0], t2[1], t2[2]) = plane_axes(m[0], m[1], m[2])
    for place in range(3 if dim == 2 else 9):
        along = 0.0 if place == 0 else _NEAR * size
        angle = place * np.pi if dim == 2 else 0.25 * place * np.pi
        for d in range(dim):
            p[d] = x[d] + along * np.cos(angle) * t1[d]
            if dim == 3:
                p[d] += along * np.sin(angle) * t2[d]
        on_face = _distance(p, own, pieces, room[0], room[1]) <= _ROUNDING * _OUT * size
        if on_face and _is_free(p, m, size, own, pieces, room):
            return True
    return False


@njit(**LEAN_INNER)
def _turned(face, piece, pieces, m):
    """Write the normal of a face as it stands."""
    for d in range(len(m)):
        m[d] = 0.0
        for e in range(len(m)):
            m[d] += pieces.turn[piece, d, e] * pieces.tables.face_normal[face, e]


@njit(**LEAN_INNER)
def _height(x, face, piece, pieces, m):
    """Height of a point above a face with the normal m (m)."""
    height = -pieces.tables.face_distance[face]
    for d in range(len(x)):
        height += m[d] * (x[d] - pieces.position[piece, d])
    return height


@njit(**LEAN_INNER)
def _lowest(piece, m, pieces, lowest):
    """Write the point of a piece that is lowest along m."""
    tables, dim = pieces.tables, len(m)
    entry, least = tables.entry[piece], np.inf
    if entry < 0:
        for d in range(dim):
            lowest[d] = pieces.position[piece, d] - tables.radius[piece] * m[d]
        return
    best = tables.vertex_offsets[entry]
    for v in range(tables.vertex_offsets[entry], tables.vertex_offsets[entry + 1]):
        height = 0.0
        for d in range(dim):
            for e in range(dim):
                height += m[d] * pieces.turn[piece, d, e] * tables.vertices[v, e]
        if height < least:
            best, least = v, height
    for d in range(dim):
        lowest[d] = pieces.position[piece, d]
        for e in range(dim):
            lowest[d] += pieces.turn[piece, d, e] * tables.vertices[best, e]


@njit(**LEAN_ENTRY)
def _look_at_whole(touching, point, normal, gap, pieces, room, kept):
    """Write which contacts stay, and change those of other faces; `room` has shape (9, dim)."""
    tables, dim = pieces.tables, point.shape[1]
    x, n, m = room[6], room[7], room[8]
    for c in range(len(kept)):
        for side in range(2):
            own, other = touching[c, side], touching[c, 1 - side]
            if own < 0:
                continue
            body, entry = tables.body[own], tables.entry[own]
            if pieces.first[body + 1] - pieces.first[body] == 1:
                continue
            size = tables.bounding_radius[own]
            if other >= 0:
                size = min(size, tables.bounding_radius[other])
            # x_c is n g / 2 from the common point, that of a meshed side n g from it
            off = gap[c] if other < 0 else 0.5 * gap[c]
            outward = -1.0 if side == 0 else 1.0
            for d in range(dim):
                n[d] = outward * normal[c, d]
                x[d] = point[c, d] - off * n[d]
            if _is_free(x, n, size, own, pieces, room):
                continue
            face, most = -1, _LEAST
            if entry >= 0:
                for f in range(tables.face_offsets[entry], tables.face_offsets[entry + 1]):
                    _turned(f, own, pieces, m)
                    along = 0.0
                    for d in range(dim):
                        along += m[d] * n[d]
                    if along <= most or _height(x, f, own, pieces, m) < -_NEAR * size:
                        continue
                    if _is_free_near(x, m, size, own, pieces, room):
                        face, most = f, along
            if face < 0:
                kept[c] = False
                break
            if most >= _SAME:
                continue
            _turned(face, own, pieces, m)
            if other < 0:
                for d in range(dim):
                    x[d] = point[c, d]
            elif np.isfinite(tables.bounding_radius[other]):
                _lowest(other, m, pieces, x)
            else:
                continue
            height = _height(x, face, own, pieces, m)
            if abs(height - gap[c]) > _NEAR * size:
                continue
            gap[c] = height
            for d in range(dim):
                normal[c, d] = outward * m[d]
                point[c, d] = x[d] - (0.0 if other < 0 else 0.5 * gap[c] * m[d])
