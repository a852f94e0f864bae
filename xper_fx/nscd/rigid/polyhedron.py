# SPDX-License-Identifier: LGPL-3.0-or-later
"""Convex polyhedra.

Faces are cut into triangles from their first vertex; each triangle (a, b, c) and a point inside
span a tetrahedron of volume V = a . (b x c) / 6, all measured from that point, with (summed over
the corners a, b, c and s = a + b + c)

    int x dV = V s / 4,     int x (x) x dV = V (a(x)a + b(x)b + c(x)c + s(x)s) / 20.

The inertia about the centroid is tr(S) I - S with S the second moment about it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from xper_fx.nscd.rigid.shapes import POLYHEDRON, Cornered, MassProperties, check_positive
from xper_fx.support.checks import require_numbers, require_vector

# Height above a face, relative to the size of the polyhedron, that still counts as in its plane.
_FLAT = 1e-9


def _vector_area(loop: np.ndarray) -> np.ndarray:
    """Vector area of a closed loop of points, shape (n, 3)."""
    x = loop - loop[0]
    return 0.5 * np.cross(x, np.roll(x, -1, axis=0)).sum(axis=0)


@dataclass(frozen=True, eq=False)
class Polyhedron(Cornered):
    """A convex polyhedron (3D); `hull` and `box` make one without listing faces.

    Args:
        vertices: shape (n, 3), m, in coordinates of any origin: a body moves them so that its
            position is that of the centroid.
        faces: loops of vertex numbers, counter-clockwise seen from outside.

    Raises:
        ValueError: not finite, open, not convex, a warped or inverted face, an unused vertex.
        TypeError: faces that are no lists.
    """

    vertices: npt.ArrayLike
    faces: Sequence[Sequence[int]]
    kind: ClassVar[int] = POLYHEDRON
    dim: ClassVar[int] = 3

    def __post_init__(self) -> None:
        vertices = require_numbers("The vertices of a polyhedron", self.vertices)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 4:
            raise ValueError(
                f"A polyhedron takes vertices of shape (n, 3) with n >= 4, got {vertices.shape}."
            )
        if not np.isfinite(vertices).all():
            bad = int(np.nonzero(~np.isfinite(vertices).all(1))[0][0])
            raise ValueError(f"Vertex {bad} of a polyhedron is not finite: {vertices[bad]}.")
        vertices.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        if not np.iterable(self.faces) or not all(np.iterable(face) for face in self.faces):
            raise TypeError(
                f"The faces of a polyhedron should be lists of vertex numbers, got {self.faces!r}."
            )
        faces = tuple(np.asarray(face).tolist() for face in self.faces)
        object.__setattr__(self, "faces", tuple(tuple(face) for face in faces))
        self._check_loops()
        self._check_closed()
        self._check_convex()

    def _check_loops(self) -> None:
        used: set[int] = set()
        for f, face in enumerate(self.faces):
            if len(face) < 3 or len(set(face)) < len(face):
                raise ValueError(
                    f"Face {f} of a polyhedron must name three or more different vertices, "
                    f"got {face}."
                )
            if not all(isinstance(v, int) and 0 <= v < len(self.vertices) for v in face):
                raise ValueError(
                    f"Face {f} of a polyhedron names vertices out of 0 .. "
                    f"{len(self.vertices) - 1}: {face}."
                )
            used.update(face)
        for v in range(len(self.vertices)):
            if v not in used:
                raise ValueError(f"Vertex {v} of a polyhedron is in no face: leave it out.")

    def _check_closed(self) -> None:
        face_of: dict[tuple[int, int], int] = {}
        for f, face in enumerate(self.faces):
            for a, b in zip(face, face[1:] + face[:1], strict=True):
                if (a, b) in face_of:
                    raise ValueError(
                        f"Faces {face_of[a, b]} and {f} of a polyhedron run along the edge "
                        f"({a}, {b}) in the same direction: one of them is inverted; faces go "
                        "counter-clockwise seen from outside."
                    )
                face_of[a, b] = f
        for (a, b), f in face_of.items():
            if (b, a) not in face_of:
                raise ValueError(
                    f"A polyhedron is open: its edge ({a}, {b}) belongs to face {f} alone."
                )

    def _check_convex(self) -> None:
        x = self.vertices
        size = np.ptp(x, axis=0).max()
        inside = x.mean(axis=0)
        volume = 0.0
        areas = [_vector_area(x[list(face)]) for face in self.faces]
        for f, (face, area) in enumerate(zip(self.faces, areas, strict=True)):
            if np.linalg.norm(area) <= 1e-14 * size**2:
                raise ValueError(f"Face {f} of a polyhedron has no area.")
            volume += area @ (x[list(face)].mean(axis=0) - inside) / 3.0
        if abs(volume) <= 1e-12 * size**3:
            raise ValueError("A polyhedron has no volume.")
        if volume < 0.0:
            raise ValueError(
                "The faces of a polyhedron are inverted: they must go counter-clockwise seen from "
                "outside; reverse each, face[::-1]."
            )
        for f, (face, area) in enumerate(zip(self.faces, areas, strict=True)):
            corners = x[list(face)]
            normal = area / np.linalg.norm(area)
            height = (x - corners.mean(axis=0)) @ normal
            own = list(face)
            if np.abs(height[own]).max() > _FLAT * size:
                raise ValueError(
                    f"Face {f} of a polyhedron is not plane: vertex "
                    f"{own[int(np.abs(height[own]).argmax())]} is "
                    f"{np.abs(height[own]).max():.3g} m off it. Cut it into triangles."
                )
            if height.max() > _FLAT * size:
                v = int(height.argmax())
                raise ValueError(
                    f"A polyhedron is not convex: vertex {v} lies {height[v]:.3g} m outside face "
                    f"{f}. Cut it into convex ones, or take Polyhedron.hull(vertices)."
                )
            edge = np.roll(corners, -1, axis=0) - corners
            turn = np.cross(np.roll(edge, 1, axis=0), edge) @ normal
            if turn.min() < -_FLAT * size**2:
                raise ValueError(
                    f"Face {f} of a polyhedron is not convex at vertex {own[int(turn.argmin())]}."
                )

    @classmethod
    def box(cls, lengths: Sequence[float]) -> Polyhedron:
        """A box about the origin with sides `lengths`, shape (3,), m.

        Raises:
            TypeError, ValueError: other than three lengths above zero.
        """
        sides = require_vector("The side lengths of a box (m)", lengths, (3,))
        half = [0.5 * check_positive("A side of a box (m)", length) for length in sides]
        corners = np.array([[i, j, k] for k in (-1, 1) for j in (-1, 1) for i in (-1, 1)]) * half
        return cls(
            corners,
            [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)],
        )

    @classmethod
    def hull(cls, points: npt.ArrayLike) -> Polyhedron:
        """The convex hull of points, shape (n, 3), m; triangles of one plane make one face.

        Raises:
            TypeError: no numbers.
            ValueError: fewer than four points, or all in a plane.
        """
        points = require_numbers("The points of a hull", points)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
            raise ValueError(
                f"A hull takes points of shape (n, 3) with n >= 4, got {points.shape}."
            )
        if not np.isfinite(points).all():
            raise ValueError("A hull takes finite points.")
        size = np.ptp(points, axis=0).max()
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[-1] <= 1e-12 * max(size, spread[0]):
            raise ValueError("The points of a hull lie in one plane: a polyhedron needs a volume.")
        hull = ConvexHull(points)
        normal = hull.equations[:, :3]
        triangles = hull.simplices.copy()
        corner = points[triangles]
        area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        inward = np.sum(area * normal, axis=1) < 0.0
        triangles[inward] = triangles[inward][:, [0, 2, 1]]
        # A neighbour is of the same face if its corners lie in the plane of this one.
        first = np.repeat(np.arange(len(triangles)), 3)
        second = hull.neighbors.ravel()
        height = np.einsum("pki,pi->pk", points[triangles[second]], normal[first])
        height = np.abs(height + hull.equations[first, 3, None]).max(axis=1)
        same = height <= 0.1 * _FLAT * size
        graph = coo_array((np.ones(same.sum()), (first[same], second[same])), (len(triangles),) * 2)
        _, face_of = connected_components(graph, directed=False)
        loops = []
        for f in range(face_of.max() + 1):
            own = triangles[face_of == f]
            edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in own for i in range(3)}
            after = dict(e for e in edges if e[::-1] not in edges)
            loop = [next(iter(after))]
            while after[loop[-1]] != loop[0]:
                loop.append(after[loop[-1]])
            loops.append(loop)
        kept = np.unique(np.concatenate(loops))
        number = np.zeros(len(points), int)
        number[kept] = np.arange(len(kept))
        return cls(points[kept], [number[loop] for loop in loops])

    @cached_property
    def triangles(self) -> np.ndarray:
        """The faces cut into triangles from their first vertex, shape (t, 3), int32."""
        return np.array(
            [(f[0], f[i], f[i + 1]) for f in self.faces for i in range(1, len(f) - 1)], np.int32
        )

    @cached_property
    def unit_properties(self) -> MassProperties:
        """Mass properties for the density 1 kg/m^3."""
        inside = self.vertices.mean(axis=0)

        def moments(x):
            a, b, c = (x[self.triangles[:, k]] for k in range(3))
            volume = np.sum(a * np.cross(b, c), axis=1) / 6.0
            s = a + b + c
            second = sum(np.einsum("t,ti,tj->ij", volume, y, y) for y in (a, b, c, s)) / 20.0
            return volume.sum(), volume @ s / 4.0, second

        volume, first, _ = moments(self.vertices - inside)
        centre = inside + first / volume
        _, _, second = moments(self.vertices - centre)
        second = 0.5 * (second + second.T)
        return MassProperties(float(volume), centre, np.trace(second) * np.eye(3) - second)

    @cached_property
    def face_normals(self) -> np.ndarray:
        """Outward unit normals of the faces, shape (len(faces), 3)."""
        area = np.array([_vector_area(self.vertices[list(face)]) for face in self.faces])
        return area / np.linalg.norm(area, axis=1)[:, None]

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (a, b), a < b, of each edge, and the faces that have it as (a, b) and (b, a).

        Two arrays of shape (num_edges, 2), int32, sorted by vertices.
        """
        face_of = {
            (a, b): f
            for f, face in enumerate(self.faces)
            for a, b in zip(face, face[1:] + face[:1], strict=True)
        }
        ends = sorted(e for e in face_of if e[0] < e[1])
        sides = [(face_of[e], face_of[e[::-1]]) for e in ends]
        return np.array(ends, np.int32), np.array(sides, np.int32)
