# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of facets: normals, closest points, and how a node's own facets face a direction.

A point of a facet is q = sum_j w_j x_j with sum_j w_j = 1. The closest one has w_j >= 0; a weight
that is zero says that it lies on an edge or at a vertex. A projection that misses a facet by
rounding counts as inside it, its weights as they are: flat sides that end together touch flatly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER

# What a weight may be below 0 by rounding, and what counts as 0 on an edge.
NO_WEIGHT = 1e-9
# By how much (a sine) the surface around a point may lean towards what it touches at a corner.
_LEANING = 1e-6


class Faces(NamedTuple):
    """The facets of surfaces as they are now, for compiled kernels.

    Attributes:
        x: positions of the nodes, shape (num_nodes, dim), m.
        facets, body: as in `Surface`.
        normal: outward unit normals, shape (f, dim).
        exposed, weld, fragment: as in `Bonds`.
        share: a node's share of each facet's area, shape (f,), m^2 (2D: m).
        depth: how deep behind each facet contacts are sought, shape (f,), m.
        extent: distance up to which a facet matters, shape (f,), m: the hypotenuse of the reach and
            of the depths of it and its neighbours, which pockets need.
        own_start, own_facets: the facets of node i are `own_facets[own_start[i]:own_start[i + 1]]`.
        own_body: body whose facets a node does not touch, shape (num_nodes,), -2 for none.
    """

    x: np.ndarray
    facets: np.ndarray
    body: np.ndarray
    normal: np.ndarray
    exposed: np.ndarray
    weld: np.ndarray
    fragment: np.ndarray
    share: np.ndarray
    depth: np.ndarray
    extent: np.ndarray
    own_start: np.ndarray
    own_facets: np.ndarray
    own_body: np.ndarray


@njit(**LEAN_ENTRY)
def facet_normals(x, facets, chosen, normal):
    """Write the outward unit normals of the chosen facets into `normal`, shape (f, dim)."""
    for f in chosen:
        a, b = facets[f, 0], facets[f, 1]
        if x.shape[1] == 2:
            nx, ny = x[b, 1] - x[a, 1], x[a, 0] - x[b, 0]
            length = np.sqrt(nx * nx + ny * ny)
            normal[f, 0] = nx / length
            normal[f, 1] = ny / length
        else:
            c = facets[f, 2]
            ux, uy, uz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
            vx, vy, vz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            normal[f, 0] = nx / length
            normal[f, 1] = ny / length
            normal[f, 2] = nz / length


@njit(**LEAN_INNER)
def plane_weights(p, x, facets, f, weights, m):
    """Write the weights of p's projection on the line or plane of facet f into row m; any sign."""
    a, b = facets[f, 0], facets[f, 1]
    if x.shape[1] == 2:
        ux, uy = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1]
        weights[m, 1] = ((p[0] - x[a, 0]) * ux + (p[1] - x[a, 1]) * uy) / (ux * ux + uy * uy)
        weights[m, 0] = 1.0 - weights[m, 1]
        return
    c = facets[f, 2]
    uu = uv = vv = pu = pv = 0.0
    for d in range(3):
        u, v, r = x[b, d] - x[a, d], x[c, d] - x[a, d], p[d] - x[a, d]
        uu += u * u
        uv += u * v
        vv += v * v
        pu += r * u
        pv += r * v
    det = uu * vv - uv * uv
    weights[m, 1] = (vv * pu - uv * pv) / det
    weights[m, 2] = (uu * pv - uv * pu) / det
    weights[m, 0] = 1.0 - weights[m, 1] - weights[m, 2]


@njit(**LEAN_INNER)
def closest_weights(p, x, facets, f, weights, m):
    """Write the weights of the point of facet f closest to p into row m.

    Returns:
        Its distance squared (m^2), and how many weights are not zero.
    """
    k = x.shape[1]
    plane_weights(p, x, facets, f, weights, m)
    size = k
    lowest = weights[m, 0]
    for j in range(1, k):
        lowest = min(lowest, weights[m, j])
    if lowest < -NO_WEIGHT:
        if k == 2:
            weights[m, 1] = min(max(weights[m, 1], 0.0), 1.0)
            if weights[m, 1] < NO_WEIGHT:
                weights[m, 1] = 0.0
            elif weights[m, 1] > 1.0 - NO_WEIGHT:
                weights[m, 1] = 1.0
            weights[m, 0] = 1.0 - weights[m, 1]
        else:
            _closest_on_sides(p, x, facets, f, weights, m)
        size = 0
        for j in range(k):
            if weights[m, j] != 0.0:
                size += 1
    square = 0.0
    for d in range(k):
        q = 0.0
        for j in range(k):
            q += weights[m, j] * x[facets[f, j], d]
        square += (p[d] - q) * (p[d] - q)
    return square, size


@njit(**LEAN_INNER)
def _closest_on_sides(p, x, facets, f, weights, m):
    """Write the weights of the closest point on the three edges of triangle f into row m."""
    best = np.inf
    side = 0
    along = 0.0
    for j in range(3):
        a, b = facets[f, j], facets[f, (j + 1) % 3]
        uu = pu = rr = 0.0
        for d in range(3):
            u, r = x[b, d] - x[a, d], p[d] - x[a, d]
            uu += u * u
            pu += r * u
            rr += r * r
        t = min(max(pu / uu, 0.0), 1.0)
        square = rr + t * (t * uu - 2.0 * pu)
        if square < best:
            best = square
            side = j
            along = t
    if along < NO_WEIGHT:
        along = 0.0
    elif along > 1.0 - NO_WEIGHT:
        along = 1.0
    for j in range(3):
        weights[m, j] = 0.0
    weights[m, side] = 1.0 - along
    weights[m, (side + 1) % 3] = along


@njit(**LEAN_INNER)
def facing_area(n, node, faces):
    """Area of a node's facets that face against n, and all of it.

    The first is sum_f s_f max(0, -n . n_f) over the node's exposed facets f, s_f the node's share
    of each: what they project onto the plane of contact.
    """
    own_start, own_facets, exposed = faces.own_start, faces.own_facets, faces.exposed
    normal, share = faces.normal, faces.share
    facing = 0.0
    whole = 0.0
    for i in range(own_start[node], own_start[node + 1]):
        f = own_facets[i]
        if exposed[f]:
            cosine = 0.0
            for d in range(len(n)):
                cosine -= n[d] * normal[f, d]
            facing += share[f] * max(cosine, 0.0)
            whole += share[f]
    return facing, whole


@njit(**LEAN_INNER)
def is_tip(n, node, faces):
    """Whether a node is its surface's foremost point against n: what is around recedes along n."""
    own_start, own_facets, exposed = faces.own_start, faces.own_facets, faces.exposed
    x, facets = faces.x, faces.facets
    for i in range(own_start[node], own_start[node + 1]):
        f = own_facets[i]
        if not exposed[f]:
            continue
        for j in range(facets.shape[1]):
            rise = 0.0
            square = 0.0
            for d in range(len(n)):
                along = x[facets[f, j], d] - x[node, d]
                rise += along * n[d]
                square += along * along
            if rise < -_LEANING * np.sqrt(square):
                return False
    return True
