# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies for tests of the contact search, and their gaps by other means.

The distance of convex solids comes from all pairs of vertices, edges and faces, their penetration
from the convex hull of all differences of vertices: the origin's depth in it.
"""

from itertools import combinations

import numpy as np
from scipy.spatial import ConvexHull

from xper_fx.nscd.rigid import RigidBodies, RigidBody
from xper_fx.nscd.rigid.shapes import DISC, HALF_PLANE, HALF_SPACE, SPHERE

ALL = ("a", "a"), ("a", "b"), ("b", "b")


def make(shapes, positions, rotations=None, groups=None):
    """RigidBodies of shapes; walls stand where the others do."""
    dim = shapes[0].dim
    bodies = []
    for k, (shape, position) in enumerate(zip(shapes, positions, strict=True)):
        turn = {}
        if rotations is not None:
            turn = {"angle" if dim == 2 else "rotation": rotations[k]}
        free = {} if np.isinf(shape.bounding_radius) else {"density": 1.0}
        group = "a" if groups is None else groups[k]
        bodies.append(RigidBody(shape, position, group, **turn, **free))
    return RigidBodies(bodies)


def place(bodies, position, rotation):
    """Matrices of the rotations; vertices in space of each body, or its centre."""
    if bodies.dim == 2:
        c, s = np.cos(rotation), np.sin(rotation)
        rotation = np.array([[c, -s], [s, c]]).transpose(2, 0, 1)
    tables = bodies.shapes
    placed = []
    for b in range(len(bodies)):
        e = tables.entry[b]
        if e < 0:
            placed.append(position[b][None])
        else:
            local = tables.vertices[tables.vertex_offsets[e] : tables.vertex_offsets[e + 1]]
            placed.append(position[b] + local @ rotation[b].T)
    return placed, rotation[:, :, -1]


def point_segments(points, a, b):
    """Least distance of points from segments."""
    d = b - a
    length = np.maximum((d * d).sum(-1), 1e-300)
    t = np.clip(((points[:, None] - a) * d).sum(-1) / length, 0.0, 1.0)
    return np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=-1).min()


def segments_segments(a, b, c, d):
    """Least distance of segments where both closest points lie inside, inf if nowhere."""
    u, v = (b - a)[:, None], (d - c)[None]
    n = np.cross(u, v)
    square = (n * n).sum(-1)
    r = c[None] - a[:, None]
    with np.errstate(all="ignore"):
        s = (np.cross(r, v) * n).sum(-1) / square
        t = (np.cross(r, u) * n).sum(-1) / square
        distance = np.abs((r * n).sum(-1)) / np.sqrt(square)
    inside = (square > 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    return distance[inside].min(initial=np.inf)


class Hull:
    """A convex solid as faces and edges, from its vertices alone."""

    def __init__(self, points):
        self.points = points
        self.hull = ConvexHull(points - points.mean(axis=0))
        self.normal = self.hull.equations[:, :-1]
        self.offset = self.hull.equations[:, -1] - self.normal @ points.mean(axis=0)
        corners = points[self.hull.simplices]
        self.facets = corners
        ends = corners.shape[1]
        pairs = list(combinations(range(ends), 2))
        self.a = np.concatenate([corners[:, i] for i, _ in pairs])
        self.b = np.concatenate([corners[:, j] for _, j in pairs])

    def heights(self, points):
        return points @ self.normal.T + self.offset

    def signed_distance(self, point):
        """Distance of a point, negative inside."""
        height = self.heights(point[None])[0]
        if (height <= 0).all():
            return height.max()
        return self.distance(point[None])

    def distance(self, points):
        """Least distance of points outside."""
        least = point_segments(points, self.a, self.b)
        if points.shape[1] == 3:
            height = self.heights(points)
            for f, corners in enumerate(self.facets):
                foot = points - height[:, f, None] * self.normal[f]
                u, v = corners[1] - corners[0], corners[2] - corners[0]
                w = foot - corners[0]
                gram = np.array([[u @ u, u @ v], [u @ v, v @ v]])
                x = np.linalg.solve(gram, np.stack([w @ u, w @ v]))
                inside = (x >= 0).all(axis=0) & (x.sum(axis=0) <= 1) & (height[:, f] >= 0)
                least = min(least, height[inside, f].min(initial=np.inf))
        return least


def hull_gap(p, q):
    """Distance of two convex solids by their vertices, or minus their penetration."""
    differences = (p[:, None] - q[None]).reshape(-1, p.shape[1])
    offset = ConvexHull(differences).equations[:, -1]
    if (offset <= 0).all():
        return offset.max()
    a, b = Hull(p), Hull(q)
    least = min(a.distance(q), b.distance(p))
    if p.shape[1] == 3:
        least = min(least, segments_segments(a.a, a.b, b.a, b.b))
    return least


def brute_gaps(bodies, position, rotation, reach):
    """{(i, j): gap} of all pairs, walls against walls left out, up to twice the reach."""
    shift = position[0].copy()
    placed, walls = place(bodies, position - shift, rotation)
    kind, radius = bodies.shapes.kind, bodies.shapes.radius
    bounding = bodies.shapes.bounding_radius
    is_wall = np.isin(kind, (HALF_PLANE, HALF_SPACE))
    is_ball = np.isin(kind, (DISC, SPHERE))
    gaps = {}
    for i, j in combinations(range(len(bodies)), 2):
        if is_wall[i] and is_wall[j]:
            continue
        if is_wall[i] or is_wall[j]:
            wall, other = (i, j) if is_wall[i] else (j, i)
            height = (placed[other] - placed[wall][0]) @ walls[wall]
            gap = height.min() - radius[other]
        else:
            apart = np.linalg.norm(position[i] - position[j])
            if apart - bounding[i] - bounding[j] > 2 * reach:
                continue
            if is_ball[i] and is_ball[j]:
                gap = apart - radius[i] - radius[j]
            elif is_ball[i] or is_ball[j]:
                ball, other = (i, j) if is_ball[i] else (j, i)
                gap = Hull(placed[other]).signed_distance(placed[ball][0]) - radius[ball]
            else:
                gap = hull_gap(placed[i], placed[j])
        if gap <= 2 * reach:
            gaps[i, j] = gap
    return gaps


def surface_height(bodies, placed, walls, body, point):
    """Signed distance of a point from the surface of a body, positive outside."""
    kind = bodies.shapes.kind[body]
    if kind in (HALF_PLANE, HALF_SPACE):
        return (point - placed[body][0]) @ walls[body]
    if kind in (DISC, SPHERE):
        return np.linalg.norm(point - placed[body][0]) - bodies.shapes.radius[body]
    return Hull(placed[body]).signed_distance(point)


def check(bodies, contacts, position, rotation, reach, tolerance):
    """Contacts are those of brute force, and consistent; returns how many pairs touch."""
    gaps = brute_gaps(bodies, position, rotation, reach)
    count = len(bodies)
    found = {}
    for (i, j), gap in zip(contacts.body.tolist(), contacts.gap.tolist(), strict=True):
        pair = min(i, j), max(i, j)
        found[pair] = min(gap, found.get(pair, np.inf))
    assert {p for p, gap in gaps.items() if gap <= reach - tolerance} <= set(found)
    for pair, gap in found.items():
        assert pair in gaps, pair
        assert abs(gap - gaps[pair]) <= tolerance, (pair, gap, gaps[pair])
    assert (contacts.gap <= reach).all()
    assert np.abs(np.linalg.norm(contacts.normal, axis=1) - 1.0).max(initial=0.0) < 1e-12
    pair = np.sort(contacts.body, axis=1).astype(np.int64)
    assert np.array_equal(contacts.key[:, 0], pair[:, 0] * count + pair[:, 1])
    assert np.array_equal(contacts.key, np.unique(contacts.key, axis=0))
    assert (contacts.area > 0).all()
    assert contacts.nodes.shape == (len(contacts), 2, 1) and not contacts.weights.any()
    shift = position[0].copy()
    placed, walls = place(bodies, position - shift, rotation)
    middle = contacts.point - shift
    half = 0.5 * contacts.gap[:, None] * contacts.normal
    for side, points in ((0, middle + half), (1, middle - half)):
        for body, point in zip(contacts.body[:, side].tolist(), points, strict=True):
            height = surface_height(bodies, placed, walls, body, point)
            assert abs(height) <= tolerance, (body, height)
    return len(found)
