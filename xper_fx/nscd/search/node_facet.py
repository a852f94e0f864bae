# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of points with facets: nodes of meshed bodies, corners and centres of rigid ones.

A point p touches a surface where its distance to it has a local minimum q within reach:

- Inside a facet: the normal is the facet's, g = n . (p - q).
- On an edge (3D) or at a vertex, if no other facet that has it is nearer. Outside the body there
  n = (p - q)/|p - q| and g = |p - q|. There p must also be the foremost point of its own surface,
  else the contact is another one's: that of the vertex q with a facet of p. The sides are told
  apart by the normals of the facets around, each with its angle as its weight (Baerentzen and
  Aanaes 2005). Inside the body the same with the opposite sign, where the facets around are nearly
  plane.
- In a pocket, a reflex corner, the planes of both its facets bound the free space, so that each
  touches p even where p is just behind the other one: its plane is continued by the depth that is
  sought, weights of nodes a little below 0 and above 1.
- In a *hollow*, a reflex corner of less than 18 degrees, both sides hold a node or a disc where it
  is asked for. Bodies lie around what is pressed into them: without inertia it would slide off one
  side from step to step. With inertia the nearer side is enough, and the sides take turns.

Everywhere p - q = g n and q = sum_j w_j x_j: impulses +r on p and -w_j r on the facet's nodes have
no sum, and no moment if r is along n. A tangential impulse r_T has the moment g x r_T.

What is no contact: a facet deeper than its own `depth`, or behind another one that p is in front
of; one that none of p's own facets faces (the back of a thin body); facets that p is welded to; of
several from which p would be driven out of one fragment, all but the nearest; of contacts of p with
one fragment whose normals differ by less than 18 degrees, all but the nearest. In hollows those are
0.5 degrees, for nodes alone, and a disc or sphere next to a node of a facet touches the node: two
contacts in one place share friction in no one way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.search.facet_geometry import (
    NO_WEIGHT,
    Faces,
    closest_weights,
    facing_area,
    is_tip,
    plane_weights,
)
from xper_fx.nscd.search.pair_list import PairList

# Least part of a node's area that faces a contact.
_FACING = 0.05
# Cosine above which two normals are one, and that of facets of which a node is behind none.
_ALIKE, _FLAT = 0.95, 0.99996
# Cosine between the way out behind a corner and the normals there, at least.
_STRAIGHT_OUT = 0.5
# Share of a facet's depth below which a distance has no direction and two distances are equal, so
# that rounding decides nothing that is symmetric, and by which a reflex corner rises at least.
_NO_DISTANCE = 1e-9
_RISE = 1e-2
# Relative difference of distances that is rounding.
_EQUAL = 1e-12
# Weight of a facet's node from which on a disc or sphere touches the node and not the facet, and
# its distance from there beside the radius up to which: the gap is larger by 5e-4 of the radius.
_AT_NODE, _BESIDE_NODE = 0.99, 0.03

# What touches: a closest point, one on an edge or at a vertex seen from inside, a pocket's wall, a
# facet that the point is in front of.
_PLAIN, _BEHIND_CORNER, _POCKET, _IN_FRONT = range(4)


class _Near(NamedTuple):
    """Facets near a point: number, distance squared, height of the point above the plane, how many
    weights of the closest point are not zero, those weights, the welds of the nodes, and whether
    the point is part of the facet."""

    facet: np.ndarray
    square: np.ndarray
    height: np.ndarray
    size: np.ndarray
    weights: np.ndarray
    welds: np.ndarray
    own: np.ndarray


class _Ways(NamedTuple):
    """Contacts of a point before they are sifted: facet and its fragment, distance squared, kind,
    what `Touching` holds, and whether they stay."""

    facet: np.ndarray
    fragment: np.ndarray
    square: np.ndarray
    kind: np.ndarray
    gap: np.ndarray
    area: np.ndarray
    normal: np.ndarray
    weights: np.ndarray
    alive: np.ndarray


class Touching(NamedTuple):
    """Contacts of points with facets; the first `found` rows."""

    point: np.ndarray  #: shape (n,), int32
    facet: np.ndarray  #: shape (n,), int32
    slot: np.ndarray  #: counts the contacts of a point with a fragment, shape (n,), int64
    weights: np.ndarray  #: of the facet's nodes, shape (n, dim)
    normal: np.ndarray  #: out of the facet, shape (n, dim)
    gap: np.ndarray  #: m, shape (n,)
    #: m^2 (2D: m), shape (n,): of a node what faces the contact, else the facet's share
    area: np.ndarray


class Points(NamedTuple):
    """Points that may touch facets."""

    position: np.ndarray  #: shape (p, dim), m; with `meshed` these are the nodes
    radius: np.ndarray  #: of each point, shape (p,), m: that of the disc or sphere around it
    #: direction out of the solid at each point, shape (p, dim), zero if it has none; not read with
    #: `meshed`, where a node's own facets say it
    outward: np.ndarray
    meshed: bool  #: whether points are nodes. Others touch no vertex: that node finds them.


def room_for(count: int, dim: int) -> Touching:
    """Uninitialised room for contacts."""
    return Touching(
        np.empty(count, np.int32),
        np.empty(count, np.int32),
        np.empty(count, np.int64),
        np.empty((count, dim)),
        np.empty((count, dim)),
        np.empty(count),
        np.empty(count),
    )


@njit(**LEAN_INNER)
def _along(n, normal, f):
    """Cosine between n and the normal of facet f."""
    total = 0.0
    for d in range(len(n)):
        total += n[d] * normal[f, d]
    return total


@njit(**LEAN_INNER)
def _is_at_node(a, p, radius, near, faces):
    """Whether a disc or sphere around p, in front of facet a, touches the facet next to a node."""
    weights, f = near.weights, near.facet[a]
    node = 0
    for j in range(1, len(p)):
        if weights[a, j] > weights[a, node]:
            node = j
    apart = -near.square[a]  # of the node from the closest point, squared
    for d in range(len(p)):
        apart += (p[d] - faces.x[faces.facets[f, node], d]) ** 2
    return weights[a, node] > _AT_NODE and apart < (_BESIDE_NODE * radius) ** 2


@njit(**LEAN_INNER)
def _smallest(weights, a):
    """The smallest weight of facet a's nodes."""
    smallest = weights[a, 0]
    for j in range(1, weights.shape[1]):
        smallest = min(smallest, weights[a, j])
    return smallest


@njit(**LEAN_INNER)
def _leave_out_small(weights, a):
    """Let weights of facet a that are rounding be zero."""
    for j in range(weights.shape[1]):
        if weights[a, j] <= NO_WEIGHT:
            weights[a, j] = 0.0


@njit(**LEAN_INNER)
def _has(welds, weights, b, a):
    """Whether facet b has the edge or vertex of facet a that its closest point is on."""
    dim = welds.shape[1]
    for j in range(dim):
        if weights[a, j] == 0.0:
            continue
        found = False
        for i in range(dim):
            found |= welds[b, i] == welds[a, j]
        if not found:
            return False
    return True


@njit(**LEAN_INNER)
def _look_around(node, p, radius, meshed, span, listed, faces, near):
    """Write the facets near p into `near`; how many, and whether p is not part of some of them."""
    x, facets, normal, extent = faces.x, faces.facets, faces.normal, faces.extent
    weld, body, own_body = faces.weld, faces.body, faces.own_body
    facet, square, height, size = near.facet, near.square, near.height, near.size
    weights, welds, own = near.weights, near.welds, near.own
    dim = len(p)
    m = 0
    foreign = False
    for i in range(span[0], span[1]):
        f = listed[i]
        cut = extent[f] + radius
        first = facets[f, 0]
        above = 0.0
        for d in range(dim):
            above += (p[d] - x[first, d]) * normal[f, d]
        if abs(above) > cut:
            continue
        square[m], size[m] = closest_weights(p, x, facets, f, weights, m)
        if square[m] > cut * cut:
            continue
        is_own = meshed and own_body[node] == body[f]
        for j in range(dim):
            welds[m, j] = weld[facets[f, j]]
            is_own |= meshed and welds[m, j] == weld[node]
        facet[m] = f
        height[m] = above
        own[m] = is_own
        foreign |= not is_own
        m += 1
    return m, foreign


@njit(**LEAN_INNER)
def _is_lowest(a, m, noise, square, size, welds, weights):
    """Whether no facet around the closest point of a on an edge or at a vertex is nearer.

    Of facets that are equally near the one with the most weights stands for them, then the first.
    """
    for b in range(m):
        if b != a and square[b] <= square[a] + noise and _has(welds, weights, b, a):
            if square[b] < square[a] - noise or size[b] > size[a]:
                return False
            if size[b] == size[a] and b < a:
                return False
    return True


@njit(**LEAN_INNER)
def _angle(x, facets, f, j):
    """Angle of triangle f at its node j."""
    a, b, c = facets[f, j], facets[f, (j + 1) % 3], facets[f, (j + 2) % 3]
    uu = uv = vv = 0.0
    for d in range(3):
        u, v = x[b, d] - x[a, d], x[c, d] - x[a, d]
        uu += u * u
        uv += u * v
        vv += v * v
    return np.arccos(min(max(uv / np.sqrt(uu * vv), -1.0), 1.0))


@njit(**LEAN_INNER)
def _is_outside(a, m, away, near, faces):
    """Whether `away`, from an edge or vertex to p, leads out: against the normals around."""
    welds, weights = near.welds, near.weights
    dim = len(away)
    corner = 0
    for j in range(dim):
        if weights[a, j] != 0.0:
            corner = welds[a, j]
    leads_out = 0.0
    for b in range(m):
        if not _has(welds, weights, b, a):
            continue
        f = near.facet[b]
        angle = 1.0
        if dim == 3 and near.size[a] == 1:
            for j in range(dim):
                if welds[b, j] == corner:
                    angle = _angle(faces.x, faces.facets, f, j)
        leads_out += angle * _along(away, faces.normal, f)
    return leads_out > 0.0


@njit(**LEAN_INNER)
def _most_faced(a, m, node, outward, meshed, near, faces):
    """Of the facets around the closest point of a the one that the point's own surface faces."""
    best = -np.inf
    side = a
    for b in range(m):
        if not _has(near.welds, near.weights, b, a):
            continue
        f = near.facet[b]
        if meshed:
            facing = facing_area(faces.normal[f], node, faces)[0]
        else:
            facing = -_along(outward, faces.normal, f)
        if facing > best:
            best = facing
            side = b
    return side


@njit(**LEAN_INNER)
def _is_straight_out(a, m, n, near, faces):
    """Whether n agrees with the normals around the closest point of a."""
    for b in range(m):
        if _has(near.welds, near.weights, b, a):
            if _along(n, faces.normal, near.facet[b]) < _STRAIGHT_OUT:
                return False
    return True


@njit(**LEAN_INNER)
def _is_pocket(a, m, mild, near, faces):
    """Whether facet a is the wall of a reflex corner behind whose other wall the point is.

    `mild` tells whether the corner may be one of less than 18 degrees, and the point at its bottom.
    """
    x, facets, normal, depth = faces.x, faces.facets, faces.normal, faces.depth
    facet, square, height, own = near.facet, near.square, near.height, near.own
    welds, weights = near.welds, near.weights
    dim = welds.shape[1]
    f = facet[a]
    if square[a] - height[a] ** 2 > depth[f] ** 2:
        return False
    for b in range(m):
        g = facet[b]
        behind = _NO_DISTANCE * depth[g] if mild else 0.0
        if b == a or own[b] or height[b] >= behind or height[b] < -depth[g]:
            continue
        if square[b] - height[b] ** 2 > depth[g] ** 2 or not _has(welds, weights, b, a):
            continue
        if not mild and _along(normal[f], normal, g) > _ALIKE:
            continue
        for j in range(dim):
            rise = 0.0
            for d in range(dim):
                rise += (x[facets[f, j], d] - x[facets[g, 0], d]) * normal[g, d]
            if rise > _RISE * depth[f]:
                return True
    return False


@njit(**LEAN_INNER)
def _is_back(a, m, gap, n, near, faces):
    """Whether facet a is the back of something whose front, nearer, faces the point."""
    facet, square, height, own, welds = near.facet, near.square, near.height, near.own, near.welds
    dim = welds.shape[1]
    fragment = faces.fragment[faces.body[facet[a]]]
    for b in range(m):
        g = facet[b]
        if own[b] or height[b] <= 0.0 or square[b] > square[a]:
            continue
        # going to the closest point of a leads through the plane of b
        cosine = _along(n, faces.normal, g)
        if cosine >= 0.0 or height[b] >= gap * cosine:
            continue
        apart = faces.fragment[faces.body[g]] == fragment
        for i in range(dim):
            for j in range(dim):
                apart &= welds[a, i] != welds[b, j]
        if apart:
            return True
    return False


@njit(**LEAN_INNER)
def _way_out(a, m, touches, point, near, faces, n, away):
    """Decide how facet a touches the point with its edge or vertex, or as a pocket's wall.

    Args:
        touches: whether it is nearest there.
        point: its number, place and direction out of the solid, whether it is a node, and whether
            mild hollows count for it.
        n: the facet's normal; overwritten by the contact's.

    Returns:
        Whether it does, the kind, the gap from p, and whether p must be its surface's tip.
    """
    node, p, outward, meshed, mild = point
    normal, weights = faces.normal, near.weights
    dim = len(p)
    f = near.facet[a]
    gap = near.height[a]
    kind = _PLAIN
    if touches and near.size[a] == 1 and not meshed:
        return False, kind, gap, False
    if touches:
        distance = np.sqrt(near.square[a])
        for d in range(dim):
            away[d] = p[d]
            for j in range(dim):
                away[d] -= weights[a, j] * faces.x[faces.facets[f, j], d]
        if distance <= _NO_DISTANCE * faces.depth[f]:
            if mild and _is_pocket(a, m, mild, near, faces):
                return True, _POCKET, gap, False
            side = _most_faced(a, m, node, outward, meshed, near, faces)
            for d in range(dim):
                n[d] = normal[near.facet[side], d]
            return True, kind, near.height[side], False
        if _is_outside(a, m, away, near, faces):
            for d in range(dim):
                n[d] = away[d] / distance
            return True, kind, distance, meshed
        kind = _BEHIND_CORNER
    if _is_pocket(a, m, mild, near, faces):
        return True, _POCKET, gap, False
    if touches:
        for d in range(dim):
            n[d] = -away[d] / distance
        gap = -distance
        touches = _is_straight_out(a, m, n, near, faces)
    return touches, kind, gap, False


@njit(**LEAN_INNER)
def _one_way_out(found, inside, equal, ways):
    """Strike out, within a fragment, all but the nearest way out of it, and contacts behind a
    corner that has two walls; of ways that are equally long the first stays."""
    fragment, kind, gap, alive = ways.fragment, ways.kind, ways.gap, ways.alive
    for a in range(found):
        in_line = kind[a] != _POCKET and gap[a] < inside
        shortest = -np.inf
        for b in range(found):
            if b == a or fragment[b] != fragment[a]:
                continue
            if kind[a] == _BEHIND_CORNER and kind[b] == _POCKET:
                alive[a] = False
            elif kind[b] != _POCKET and gap[b] < inside:
                shortest = max(shortest, gap[b])
        if not in_line or gap[a] > shortest + equal:
            continue
        shortest = max(shortest, gap[a])
        alive[a] &= gap[a] >= shortest - equal
        for b in range(a):
            if fragment[b] == fragment[a] and kind[b] != _POCKET:
                alive[a] &= gap[b] >= inside or gap[b] < shortest - equal


@njit(**LEAN_INNER)
def _nearest_of_each_normal(found, equal, flat, ways, kept):
    """Write into `kept`, nearest first, contacts whose normals differ within a fragment.

    `flat` is the cosine above which two facets of a hollow are one.
    """
    fragment, square, alive, normal = ways.fragment, ways.square, ways.alive, ways.normal
    kind, count = ways.kind, 0
    while True:
        a = -1
        for b in range(found):
            if alive[b] and (a < 0 or np.sqrt(square[b]) < np.sqrt(square[a]) - equal):
                a = b
        if a < 0:
            return count
        alive[a] = False
        fresh = True
        for e in range(count):
            b = kept[e]
            if fragment[b] == fragment[a]:
                alike = flat if max(kind[a], kind[b]) >= _POCKET else _ALIKE
                fresh = fresh and _along(normal[a], normal, b) < alike
        if fresh:
            kept[count] = a
            count += 1


def point_facet(
    points: Points, pairs: PairList, faces: Faces, reach: float, hollows: bool, out: Touching
) -> int:
    """Find the contacts of points with the facets listed for each.

    Args:
        pairs: the facets that each may touch.
        reach: largest gap (m).
        hollows: whether both sides of mild hollows hold a point.
        out: `Touching`, where contacts go, as many as there is room for.

    Returns:
        How many contacts there are, more than there was room for perhaps.
    """
    dim = points.position.shape[1]
    longest = int(np.diff(pairs.start).max(initial=1))
    near = _Near(
        np.empty(longest, np.int64),
        np.empty(longest),
        np.empty(longest),
        np.empty(longest, np.int64),
        np.empty((longest, dim)),
        np.empty((longest, dim), np.int64),
        np.empty(longest, np.bool_),
    )
    ways = _Ways(
        np.empty(longest, np.int64),
        np.empty(longest, np.int64),
        np.empty(longest),
        np.empty(longest, np.int64),
        np.empty(longest),
        np.empty(longest),
        np.empty((longest, dim)),
        np.empty((longest, dim)),
        np.empty(longest, np.bool_),
    )
    room = near, ways, np.empty(longest, np.int64), np.empty(dim)
    listed = pairs.rows, pairs.start, pairs.listed
    return _point_facet(points, listed, faces, reach, hollows, out, room)


@njit(**LEAN_ENTRY)
def _point_facet(points, pairs, faces, reach, hollows, out, room):
    near, ways, kept, away = room
    position, radius, outward, meshed = points
    rows, start, listed = pairs
    mild = hollows and meshed  # rigid corners make mild ones wherever they are
    dim = position.shape[1]
    share, depth, fragment, body = faces.share, faces.depth, faces.fragment, faces.body
    own, height, square, near_facet = near.own, near.height, near.square, near.facet
    size, welds, weights = near.size, near.welds, near.weights
    normal, normals = faces.normal, ways.normal
    count = 0
    for i in range(len(rows)):
        node = rows[i]
        p = position[node]
        r = radius[node]
        # with nodes, whose `outward` is not read, any row will do
        leaning = outward[0] if meshed else outward[node]
        span = start[i], start[i + 1]
        m, foreign = _look_around(node, p, r, meshed, span, listed, faces, near)
        if not foreign:
            continue
        found = 0
        for a in range(m):
            f = near_facet[a]
            far = max(reach + r, depth[f])
            flat = abs(height[a])
            if own[a] or flat > far or square[a] > flat * flat + far * far:
                continue
            n = normals[found]
            for d in range(dim):
                n[d] = normal[f, d]
            touches, kind, gap, tip = True, _PLAIN, height[a], False
            if size[a] < dim:
                noise = _EQUAL * square[a] + (_EQUAL * depth[f]) ** 2
                touches = _is_lowest(a, m, noise, square, size, welds, weights)
                if not touches and square[a] - flat * flat > depth[f] ** 2:
                    continue
                point = node, p, leaning, meshed, mild
                touches, kind, gap, tip = _way_out(a, m, touches, point, near, faces, n, away)
            elif hollows and _smallest(weights, a) > NO_WEIGHT:
                kind = _IN_FRONT if gap > 0.0 else _PLAIN
            elif hollows and gap <= _NO_DISTANCE * depth[f]:
                _leave_out_small(weights, a)
                kind = _POCKET if _is_pocket(a, m, mild, near, faces) else _PLAIN
            if not touches or gap - r > reach or gap - r < -depth[f]:
                continue
            if hollows and r > 0.0 and _is_at_node(a, p, r, near, faces):
                continue
            if gap < 0.0 and kind != _POCKET and _is_back(a, m, gap, n, near, faces):
                continue
            area = share[f]
            if meshed:
                area, whole = facing_area(n, node, faces)
                if area < _FACING * whole or (tip and not is_tip(n, node, faces)):
                    continue
            elif _along(leaning, ways.normal, found) > 0.0:
                continue
            for j in range(dim):
                ways.weights[found, j] = weights[a, j]
            if kind == _POCKET:
                plane_weights(p, faces.x, faces.facets, f, ways.weights, found)
            ways.facet[found] = f
            ways.fragment[found] = fragment[body[f]]
            ways.square[found] = square[a]
            ways.kind[found] = kind
            ways.gap[found] = gap - r
            ways.area[found] = area
            ways.alive[found] = True
            found += 1
        if found == 0:
            continue
        equal = _NO_DISTANCE * depth[near_facet[0]]
        _one_way_out(found, equal - r, equal, ways)
        flat = _ALIKE
        if hollows:  # discs touch facets apart from each other
            flat = _FLAT if r == 0.0 else 1.0 - _EQUAL
        accepted = _nearest_of_each_normal(found, equal, flat, ways, kept)
        for e in range(accepted):
            if count < len(out.gap):
                a = kept[e]
                slot = 0
                for o in range(accepted):
                    b = kept[o]
                    if ways.facet[b] < ways.facet[a] and ways.fragment[b] == ways.fragment[a]:
                        slot += 1
                out.point[count] = node
                out.facet[count] = ways.facet[a]
                out.slot[count] = slot
                out.gap[count] = ways.gap[a]
                out.area[count] = ways.area[a]
                for d in range(dim):
                    out.weights[count, d] = ways.weights[a, d]
                    out.normal[count, d] = ways.normal[a, d]
            count += 1
    return count
