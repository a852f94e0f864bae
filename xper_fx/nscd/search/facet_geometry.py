# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of facets: normals, closest points, and how a node's own facets face a direction.

A point of a facet is q = sum_j w_j x_j with sum_j w_j = 1. The closest one has w_j >= 0; a weight
that is zero says that it lies on an edge or at a vertex. A projection that misses a facet by
rounding counts as inside it, its weights as they are: flat sides that end together touch flatly.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# What a weight may be below 0 by rounding, and what counts as 0 on an edge.
_NO_WEIGHT = 1e-9
# By how much (a sine) the surface around a point may lean towards what it touches at a corner.
_LEANING = 1e-6


@njit(error_model="numpy")
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


@njit(error_model="numpy")
def plane_weights(p, x, facet, w):
    """Write the weights of p's projection on the facet's line or plane into w; any sign."""
    a, b = facet[0], facet[1]
    if len(facet) == 2:
        ux, uy = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1]
        w[1] = ((p[0] - x[a, 0]) * ux + (p[1] - x[a, 1]) * uy) / (ux * ux + uy * uy)
        w[0] = 1.0 - w[1]
        return
    c = facet[2]
    uu = uv = vv = pu = pv = 0.0
    for d in range(3):
        u, v, r = x[b, d] - x[a, d], x[c, d] - x[a, d], p[d] - x[a, d]
        uu += u * u
        uv += u * v
        vv += v * v
        pu += r * u
        pv += r * v
    det = uu * vv - uv * uv
    w[1] = (vv * pu - uv * pv) / det
    w[2] = (uu * pv - uv * pu) / det
    w[0] = 1.0 - w[1] - w[2]


@njit(error_model="numpy")
def closest_weights(p, x, facet, w):
    """Write the weights of the facet's point closest to p into w.

    Returns:
        Its distance squared (m^2), and how many weights are not zero.
    """
    k = len(facet)
    plane_weights(p, x, facet, w)
    size = k
    lowest = w[0]
    for j in range(1, k):
        lowest = min(lowest, w[j])
    if lowest < -_NO_WEIGHT:
        if k == 2:
            w[1] = min(max(w[1], 0.0), 1.0)
            if w[1] < _NO_WEIGHT:
                w[1] = 0.0
            elif w[1] > 1.0 - _NO_WEIGHT:
                w[1] = 1.0
            w[0] = 1.0 - w[1]
        else:
            _closest_on_sides(p, x, facet, w)
        size = 0
        for j in range(k):
            if w[j] != 0.0:
                size += 1
    square = 0.0
    for d in range(k):
        q = 0.0
        for j in range(k):
            q += w[j] * x[facet[j], d]
        square += (p[d] - q) * (p[d] - q)
    return square, size


@njit(error_model="numpy")
def _closest_on_sides(p, x, facet, w):
    """Write the weights of the closest point on the three edges of a triangle into w."""
    best = np.inf
    side = 0
    along = 0.0
    for j in range(3):
        a, b = facet[j], facet[(j + 1) % 3]
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
    if along < _NO_WEIGHT:
        along = 0.0
    elif along > 1.0 - _NO_WEIGHT:
        along = 1.0
    w[:] = 0.0
    w[side] = 1.0 - along
    w[(side + 1) % 3] = along


@njit(error_model="numpy")
def facing_area(n, own, normal, exposed, share):
    """Area of a node's own facets that face against n, and all of it.

    The first is sum_f s_f max(0, -n . n_f) over the node's exposed facets f, s_f the node's share
    of each: what they project onto the plane of contact.
    """
    facing = 0.0
    whole = 0.0
    for f in own:
        if exposed[f]:
            cosine = 0.0
            for d in range(len(n)):
                cosine -= n[d] * normal[f, d]
            facing += share[f] * max(cosine, 0.0)
            whole += share[f]
    return facing, whole


@njit(error_model="numpy")
def is_tip(p, n, own, x, facets, exposed):
    """Whether p is its surface's foremost point against n: what is around it recedes along n."""
    for f in own:
        if not exposed[f]:
            continue
        for j in range(facets.shape[1]):
            rise = 0.0
            square = 0.0
            for d in range(len(n)):
                along = x[facets[f, j], d] - p[d]
                rise += along * n[d]
                square += along * along
            if rise < -_LEANING * np.sqrt(square):
                return False
    return True
