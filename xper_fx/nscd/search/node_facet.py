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

Everywhere p - q = g n and q = sum_j w_j x_j: impulses +r on p and -w_j r on the facet's nodes have
no sum, and no moment if r is along n. A tangential impulse r_T has the moment g x r_T.

What is no contact: a facet deeper than its own `depth`, or behind another one that p is in front
of; one that none of p's own facets faces (the back of a thin body); facets that p is welded to; of
several from which p would be driven out of one fragment, all but the nearest; of contacts of p with
one fragment whose normals differ by less than 18 degrees, all but the nearest.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from xper_fx.nscd.search.facet_geometry import (
    closest_weights,
    facing_area,
    is_tip,
    plane_weights,
)

# Least part of a node's area that faces a contact.
_FACING = 0.05
# Cosine above which two normals are one.
_ALIKE = 0.95
# Share of a facet's size below which a distance has no direction.
_NO_DISTANCE = 1e-9
# Relative difference of distances that is rounding.
_EQUAL = 1e-12

# What a local minimum is like.
_PLAIN, _BEHIND_CORNER, _POCKET = range(3)


@njit
def _has(facet, w, corners, weld):
    """Whether a facet has the welds of all `corners` whose weight w is not zero."""
    for j in range(len(corners)):
        if w[j] == 0.0:
            continue
        found = False
        for i in range(len(facet)):
            if weld[facet[i]] == weld[corners[j]]:
                found = True
        if not found:
            return False
    return True


@njit
def _touch(first, second, weld):
    """Whether two facets have a weld in common."""
    for i in range(len(first)):
        for j in range(len(second)):
            if weld[first[i]] == weld[second[j]]:
                return True
    return False


@njit(error_model="numpy")
def _angle(x, facet, at, weld):
    """Angle of a facet at a vertex, given by its weld (3D)."""
    j = 0
    for i in range(len(facet)):
        if weld[facet[i]] == at:
            j = i
    a, b, c = facet[j], facet[(j + 1) % 3], facet[(j + 2) % 3]
    uu = uv = vv = 0.0
    for d in range(3):
        u, v = x[b, d] - x[a, d], x[c, d] - x[a, d]
        uu += u * u
        uv += u * v
        vv += v * v
    return np.arccos(min(max(uv / np.sqrt(uu * vv), -1.0), 1.0))


@njit(error_model="numpy")
def point_facet(
    points,
    radius,
    outward,
    meshed,
    rows,
    start,
    listed,
    x,
    facets,
    body,
    normal,
    exposed,
    weld,
    fragment,
    share,
    depth,
    extent,
    reach,
    own_start,
    own_facets,
    own_body,
    out_point,
    out_facet,
    out_slot,
    out_weights,
    out_normal,
    out_gap,
    out_area,
):
    """Find the contacts of points with the facets listed for each.

    Args:
        points: shape (p, dim), m; with `meshed` these are x itself.
        radius: of each point, shape (p,), m: that of the disc or sphere around it.
        outward: direction out of the solid at each point, shape (p, dim), zero if it has none;
            empty with `meshed`, where a point's own facets say it.
        meshed: whether points are nodes. Others touch no vertex: that node finds them.
        rows, start, listed: the facets of the point `rows[i]` are
            `listed[start[i]:start[i + 1]]`, ascending.
        x, facets, body, normal, exposed, weld, fragment: the surface as it is now.
        share: a node's share of each facet's area, shape (f,).
        depth: of each facet, shape (f,), m.
        extent: distance up to which a facet matters, shape (f,), m: the hypotenuse of the reach and
            the depths of it and its neighbours, which pockets need.
        reach: largest gap (m).
        own_start, own_facets: facets of each node.
        own_body: body whose facets a node does not touch, shape (p,), -1 for none; empty if not
            `meshed`.
        out_*: where contacts go, as many as there is room for.

    Returns:
        How many contacts there are, more than there was room for perhaps.
    """
    dim = x.shape[1]
    longest = 1
    for i in range(len(rows)):
        longest = max(longest, start[i + 1] - start[i])
    near = np.empty(longest, np.int64)
    square = np.empty(longest)
    height = np.empty(longest)
    size = np.empty(longest, np.int64)
    weights = np.empty((longest, dim))
    own = np.empty(longest, np.bool_)
    # contacts of one point before they are sifted
    source = np.empty(longest, np.int64)
    sort = np.empty(longest, np.int64)
    gaps = np.empty(longest)
    areas = np.empty(longest)
    normals = np.empty((longest, dim))
    mixed = np.empty((longest, dim))
    alive = np.empty(longest, np.bool_)
    kept = np.empty(longest, np.int64)
    n = np.empty(dim)
    away = np.empty(dim)
    pseudo = np.empty(dim)
    count = 0
    for i in range(len(rows)):
        node = rows[i]
        p = points[node]
        m = 0
        foreign = False
        for c in range(start[i], start[i + 1]):
            f = listed[c]
            cut = extent[f] + radius[node]
            h = 0.0
            for d in range(dim):
                h += (p[d] - x[facets[f, 0], d]) * normal[f, d]
            if h > cut or h < -cut:
                continue
            square[m], size[m] = closest_weights(p, x, facets[f], weights[m])
            if square[m] > cut * cut:
                continue
            near[m] = f
            height[m] = h
            own[m] = False
            if meshed:
                own[m] = own_body[node] == body[f]
                for j in range(dim):
                    own[m] |= weld[facets[f, j]] == weld[node]
            foreign |= not own[m]
            m += 1
        if not foreign:
            continue
        mine = own_facets[own_start[node] : own_start[node + 1]] if meshed else own_facets[:0]

        found = 0
        for a in range(m):
            if own[a]:
                continue
            f = near[a]
            w = weights[a]
            for d in range(dim):
                n[d] = normal[f, d]
            gap = height[a]
            kind = _PLAIN
            tip = False
            lowest = True
            if size[a] < dim:
                noise = _EQUAL * square[a] + (_EQUAL * depth[f]) ** 2
                for b in range(m):
                    if b == a or not _has(facets[near[b]], w, facets[f], weld):
                        continue
                    if square[b] < square[a] - noise or (
                        square[b] <= square[a] + noise
                        and (size[b] > size[a] or (size[b] == size[a] and b < a))
                    ):
                        lowest = False
                        break
                if lowest and not meshed and size[a] == 1:
                    continue
            if lowest and size[a] < dim:
                # which side of the surface, and the facet that faces p most
                pseudo[:] = 0.0
                best = -np.inf
                straight = np.sqrt(square[a])
                for d in range(dim):
                    q = 0.0
                    for j in range(dim):
                        q += w[j] * x[facets[f, j], d]
                    away[d] = p[d] - q
                side = f
                side_height = height[a]
                for b in range(m):
                    g = near[b]
                    if not _has(facets[g], w, facets[f], weld):
                        continue
                    angle = 1.0
                    if dim == 3 and size[a] == 1:
                        corner = 0
                        for j in range(dim):
                            if w[j] != 0.0:
                                corner = facets[f, j]
                        angle = _angle(x, facets[g], weld[corner], weld)
                    for d in range(dim):
                        pseudo[d] += angle * normal[g, d]
                    facing = 0.0
                    if meshed:
                        facing, _ = facing_area(normal[g], mine, normal, exposed, share)
                    else:
                        for d in range(dim):
                            facing -= outward[node, d] * normal[g, d]
                    if facing > best:
                        best = facing
                        side = g
                        side_height = height[b]
                outside = 0.0
                for d in range(dim):
                    outside += pseudo[d] * away[d]
                if straight <= _NO_DISTANCE * depth[f]:
                    for d in range(dim):
                        n[d] = normal[side, d]
                    gap = side_height
                elif outside > 0.0:
                    for d in range(dim):
                        n[d] = away[d] / straight
                    gap = straight
                    tip = meshed
                else:
                    for d in range(dim):
                        n[d] = -away[d] / straight
                    gap = -straight
                    kind = _BEHIND_CORNER
                    for b in range(m):
                        if _has(facets[near[b]], w, facets[f], weld):
                            cosine = 0.0
                            for d in range(dim):
                                cosine += n[d] * normal[near[b], d]
                            if cosine < 0.5:
                                lowest = False
            for j in range(dim):
                mixed[found, j] = w[j]
            if size[a] < dim and (not lowest or kind == _BEHIND_CORNER):
                # a pocket: p is behind another facet at a reflex corner
                overshoot = square[a] - height[a] * height[a]
                if overshoot <= depth[f] * depth[f]:
                    for b in range(m):
                        g = near[b]
                        if b == a or own[b] or height[b] >= 0.0 or height[b] < -depth[g]:
                            continue
                        if square[b] - height[b] * height[b] > depth[g] * depth[g]:
                            continue
                        if not _has(facets[g], w, facets[f], weld):
                            continue
                        cosine = 0.0
                        for d in range(dim):
                            cosine += normal[f, d] * normal[g, d]
                        if cosine > _ALIKE:
                            continue
                        above = 0.0
                        for j in range(dim):
                            rise = 0.0
                            for d in range(dim):
                                rise += (x[facets[f, j], d] - x[facets[g, 0], d]) * normal[g, d]
                            above = max(above, rise)
                        if above > 0.01 * depth[f]:
                            kind = _POCKET
                            lowest = True
                            break
                if kind == _POCKET:
                    for d in range(dim):
                        n[d] = normal[f, d]
                    gap = height[a]
                    plane_weights(p, x, facets[f], mixed[found])
            if not lowest:
                continue
            if gap < 0.0 and kind != _POCKET:
                # the back of something whose front is nearer
                shown = False
                for b in range(m):
                    g = near[b]
                    if own[b] or height[b] <= 0.0 or square[b] > square[a]:
                        continue
                    if fragment[body[g]] != fragment[body[f]] or _touch(facets[g], facets[f], weld):
                        continue
                    cosine = 0.0
                    for d in range(dim):
                        cosine += n[d] * normal[g, d]
                    shown |= cosine < 0.0 and height[b] < gap * cosine
                if shown:
                    continue
            gap -= radius[node]
            if gap > reach or gap < -depth[f]:
                continue
            if meshed:
                areas[found], whole = facing_area(n, mine, normal, exposed, share)
                if areas[found] < _FACING * whole:
                    continue
                if tip and not is_tip(p, n, mine, x, facets, exposed):
                    continue
            else:
                areas[found] = share[f]
                leans = 0.0
                for d in range(dim):
                    leans += outward[node, d] * n[d]
                if leans > 0.0:
                    continue
            source[found] = a
            sort[found] = kind
            gaps[found] = gap
            for d in range(dim):
                normals[found, d] = n[d]
            alive[found] = True
            found += 1

        # one way out of each fragment, and no contact behind a corner that has two walls
        inside = _NO_DISTANCE * depth[near[0]] - radius[node]
        for a in range(found):
            for b in range(found):
                if b == a or fragment[body[near[source[a]]]] != fragment[body[near[source[b]]]]:
                    continue
                if sort[a] == _BEHIND_CORNER and sort[b] == _POCKET:
                    alive[a] = False
                elif sort[a] != _POCKET and sort[b] != _POCKET and max(gaps[a], gaps[b]) < inside:
                    if gaps[b] > gaps[a] or (gaps[b] == gaps[a] and b < a):
                        alive[a] = False
        # nearest first, each with a normal of its own
        accepted = 0
        while True:
            a = -1
            for b in range(found):
                if alive[b] and (a < 0 or square[source[b]] < square[source[a]]):
                    a = b
            if a < 0:
                break
            alive[a] = False
            fresh = True
            for e in range(accepted):
                b = kept[e]
                if fragment[body[near[source[a]]]] == fragment[body[near[source[b]]]]:
                    cosine = 0.0
                    for d in range(dim):
                        cosine += normals[a, d] * normals[b, d]
                    fresh = fresh and cosine < _ALIKE
            if fresh:
                kept[accepted] = a
                accepted += 1
        for e in range(accepted):
            a = kept[e]
            f = near[source[a]]
            slot = 0
            for o in range(accepted):
                g = near[source[kept[o]]]
                if fragment[body[g]] == fragment[body[f]] and g < f:
                    slot += 1
            if count < len(out_gap):
                out_point[count] = node
                out_facet[count] = f
                out_slot[count] = slot
                out_gap[count] = gaps[a]
                out_area[count] = areas[a]
                for d in range(dim):
                    out_weights[count, d] = mixed[a, d]
                    out_normal[count, d] = normals[a, d]
            count += 1
    return count
