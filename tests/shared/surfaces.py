# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of simple bodies for the tests of the search."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from xper_fx.nscd.search.surface import Surface


def loop(points, divisions=1):
    """Points and edges of a closed polygon given counter-clockwise, its sides cut evenly."""
    corners = np.asarray(points, float)
    divisions = np.broadcast_to(divisions, len(corners))
    parts = []
    for a, b, n in zip(corners, np.roll(corners, -1, axis=0), divisions, strict=True):
        parts.append(a + (b - a) * np.arange(n)[:, None] / n)
    x = np.concatenate(parts)
    edges = np.stack([np.arange(len(x)), np.roll(np.arange(len(x)), -1)], axis=1)
    return x, edges


def rectangle(low, high, divisions=1):
    """A rectangle's points and edges: bottom, right, top, left."""
    (x0, y0), (x1, y1) = low, high
    return loop([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], divisions)


def hull(points):
    """Points and triangles of the convex hull of points, outward."""
    simplices = ConvexHull(points)
    triangles = simplices.simplices.copy()
    corner = points[triangles]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = (area * simplices.equations[:, :3]).sum(axis=1) < 0
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    used = np.unique(triangles)
    return points[used], np.searchsorted(used, triangles)


def block(low, high, divisions):
    """Points and triangles of a block's surface, each side cut into squares."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    points, triangles, count = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        nu, nv = divisions[u], divisions[v]
        i, j = np.meshgrid(np.arange(nu + 1), np.arange(nv + 1), indexing="ij")
        for end in (0, 1):
            p = np.empty((i.size, 3))
            p[:, axis] = (low, high)[end][axis]
            p[:, u] = low[u] + (high[u] - low[u]) * i.ravel() / nu
            p[:, v] = low[v] + (high[v] - low[v]) * j.ravel() / nv
            number = (i * (nv + 1) + j) + count
            a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
            c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
            both = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
            triangles.append(both if end else both[:, ::-1])
            points.append(p)
            count += i.size
    points = np.concatenate(points)
    _, first, inverse = np.unique(
        np.round(points, 9), axis=0, return_index=True, return_inverse=True
    )
    return points[first], inverse.reshape(-1)[np.concatenate(triangles)]


def assemble(*parts, names=None):
    """One surface of several bodies, each given as (points, facets); a group each if named."""
    x, facets, body, count = [], [], [], 0
    for number, (points, own) in enumerate(parts):
        x.append(points)
        facets.append(own + count)
        body.append(np.full(len(own), number))
        count += len(points)
    body = np.concatenate(body)
    surface = Surface(
        np.concatenate(facets),
        body,
        count,
        group=body if names else None,
        groups=names or ("surface",),
    )
    return surface, np.concatenate(x)
