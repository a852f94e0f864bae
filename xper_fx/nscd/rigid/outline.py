# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of all rigid bodies, for files and figures.

In 2D triangles fill the bodies, counter-clockwise; in 3D they cover their surfaces,
counter-clockwise seen from outside. Round shapes have their points on the circle or sphere, so
that what is drawn lies inside. Walls, which have no end, are drawn as slabs below their surface.
Of a cluster all parts are drawn, whole.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies, ShapeTables
from xper_fx.nscd.rigid.polyhedron import Polyhedron
from xper_fx.nscd.rigid.shapes import (
    DISC,
    HALF_PLANE,
    HALF_SPACE,
    POLYHEDRON,
    SPHERE,
    check_positive,
)

# Thickness of a slab over its half width.
_SLAB = 0.05
# Segments of a circle that a file or figure still holds.
_MOST_SEGMENTS = 10_000


class Outline(NamedTuple):
    """Triangles of all bodies; points and cells are sorted by body."""

    points: np.ndarray  #: in the axes of their body, about its centre of mass, shape (p, dim), m
    cells: np.ndarray  #: points of the triangles, shape (t, 3), int32
    body_of_point: np.ndarray  #: shape (p,), int32
    body_of_cell: np.ndarray  #: shape (t,), int32
    piece_of_point: np.ndarray  #: convex piece of a body (`ShapeTables`), shape (p,), int32
    piece_of_cell: np.ndarray  #: convex piece of a body, shape (t,), int32

    def positions(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """The points in space, shape (p, dim), m.

        Args:
            position: of the bodies' centres of mass, shape (n, dim), m.
            rotation: angles, shape (n,), rad (2D); matrices from body to space, (n, 3, 3) (3D).
        """
        if self.points.shape[1] == 2:
            c, s = np.cos(rotation), np.sin(rotation)
            rotation = np.stack([c, -s, s, c], axis=-1).reshape(-1, 2, 2)
        turned = np.einsum("pij,pj->pi", rotation[self.body_of_point], self.points)
        return position[self.body_of_point] + turned


def _disc(segments: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit disc: its centre, and the rim counter-clockwise."""
    angle = 2.0 * np.pi * np.arange(segments) / segments
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    i = np.arange(segments)
    cells = np.column_stack([np.zeros_like(i), 1 + i, 1 + (i + 1) % segments])
    return np.vstack([np.zeros((1, 2)), rim]), cells


def _sphere(segments: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit sphere: circles of latitude between two poles."""
    bands = max(2, segments // 2)
    latitude = np.pi * np.arange(1, bands) / bands
    longitude = 2.0 * np.pi * np.arange(segments) / segments
    flat = np.sin(latitude)[:, None]
    rings = np.stack(
        [
            flat * np.cos(longitude),
            flat * np.sin(longitude),
            np.broadcast_to(np.cos(latitude)[:, None], (bands - 1, segments)),
        ],
        axis=-1,
    )
    points = np.vstack([[0.0, 0.0, 1.0], rings.reshape(-1, 3), [0.0, 0.0, -1.0]])
    number = 1 + np.arange((bands - 1) * segments).reshape(bands - 1, segments)
    after = np.roll(number, -1, axis=1)
    pole = np.zeros(segments, int)
    cells = [np.column_stack([pole, number[0], after[0]])]
    for upper, lower in zip(range(bands - 2), range(1, bands - 1), strict=True):
        cells.append(np.column_stack([number[upper], number[lower], after[lower]]))
        cells.append(np.column_stack([number[upper], after[lower], after[upper]]))
    cells.append(np.column_stack([pole + len(points) - 1, after[-1], number[-1]]))
    return points, np.vstack(cells)


def _slab(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Slab of half width 1 below the local surface y = 0 (2D) or z = 0 (3D)."""
    if dim == 2:
        corners = np.array([[-1, -_SLAB], [1, -_SLAB], [1, 0], [-1, 0]])
        return corners, np.array([[0, 1, 2], [0, 2, 3]])
    box = Polyhedron.box((2.0, 2.0, _SLAB))
    return box.vertices - [0.0, 0.0, 0.5 * _SLAB], box.triangles


def _cornered(tables: ShapeTables, entry: int) -> tuple[np.ndarray, np.ndarray]:
    """A polygon or polyhedron of the tables, its faces cut from their first vertex."""
    points = tables.vertices[tables.vertex_offsets[entry] : tables.vertex_offsets[entry + 1]]
    if points.shape[1] == 2:
        loops = [np.arange(len(points))]
    else:
        faces = range(tables.face_offsets[entry], tables.face_offsets[entry + 1])
        starts = tables.loop_offsets
        loops = [tables.loops[starts[f] : starts[f + 1]] for f in faces]
    cells = [(p[0], p[i], p[i + 1]) for p in loops for i in range(1, len(p) - 1)]
    return points, np.array(cells)


def _wall_sizes(bodies: RigidBodies) -> np.ndarray:
    """Distance of the far side of the farthest body from the point of each wall, (n,), m."""
    radius = bodies.bounding_radius
    bounded = np.isfinite(radius)
    size = np.ones(len(bodies))
    if bounded.any():
        for i in np.nonzero(~bounded)[0]:
            distance = np.linalg.norm(bodies.position[bounded] - bodies.position[i], axis=1)
            size[i] = (distance + radius[bounded]).max()
    return size


def body_outlines(bodies: RigidBodies, segments: int = 24) -> Outline:
    """Triangles of all bodies in their own axes.

    Args:
        segments: sides of the polygon that stands for a circle, at least 3. A sphere has about
            `segments`^2 triangles.

    Returns:
        The triangles. A wall reaches, from its point, as far as the bodies do at time 0.

    Raises:
        ValueError: segments out of range, or no whole number of them.
    """
    check_positive("The number of segments of a circle", segments)
    if not 3 <= segments <= _MOST_SEGMENTS or segments != int(segments):
        raise ValueError(
            f"The segments of a circle should be 3 to {_MOST_SEGMENTS}, got {segments!r}."
        )
    segments = int(segments)
    tables = bodies.shapes
    templates = {DISC: _disc(segments)} if bodies.dim == 2 else {SPHERE: _sphere(segments)}
    templates[HALF_PLANE if bodies.dim == 2 else HALF_SPACE] = _slab(bodies.dim)
    size = np.where(tables.radius > 0.0, tables.radius, 1.0)
    walls = ~np.isfinite(tables.bounding_radius)
    size[walls] = _wall_sizes(bodies)[tables.body[walls]]

    # Pieces alike share a template: of an entry of the tables, or of a kind without corners.
    alike = np.where(tables.entry >= 0, tables.entry, -1 - tables.kind.astype(int))
    kinds, which = np.unique(alike, return_inverse=True)
    drawn = [_cornered(tables, k) if k >= 0 else templates[-1 - k] for k in kinds]
    num_points = np.array([len(points) for points, _ in drawn])[which]
    num_cells = np.array([len(cells) for _, cells in drawn])[which]
    first_point, first_cell = np.cumsum(num_points) - num_points, np.cumsum(num_cells) - num_cells
    points = np.empty((num_points.sum(), bodies.dim))
    cells = np.empty((num_cells.sum(), 3), np.int32)
    for k, (template, triangles) in enumerate(drawn):
        own = np.nonzero(which == k)[0]
        points[first_point[own, None] + np.arange(len(template))] = (
            tables.offset[own, None] + size[own, None, None] * template
        )
        cells[first_cell[own, None] + np.arange(len(triangles))] = (
            first_point[own, None, None] + triangles
        )
    pieces = np.arange(len(tables.kind), dtype=np.int32)
    of_point, of_cell = np.repeat(pieces, num_points), np.repeat(pieces, num_cells)
    return Outline(points, cells, tables.body[of_point], tables.body[of_cell], of_point, of_cell)


def piece_faces(bodies: RigidBodies, outline: Outline) -> tuple[list[np.ndarray], np.ndarray]:
    """Faces of all pieces of bodies as loops of points, for pictures.

    In 2D a piece is one loop, counter-clockwise; the point before that of a disc is its centre. In
    3D loops are counter-clockwise seen from outside: the faces of polyhedra, the triangles of
    spheres, and of walls their surface alone.

    Args:
        outline: of these bodies.

    Returns:
        Numbers of the points of each face, and its piece, shape (num_faces,), sorted.
    """
    tables, numbers = bodies.shapes, np.arange(len(bodies.shapes.kind) + 1)
    points = np.searchsorted(outline.piece_of_point, numbers)
    if bodies.dim == 2:
        starts = points[:-1] + (tables.kind == DISC)
        loops = [np.arange(a, b) for a, b in zip(starts, points[1:], strict=True)]
        return loops, numbers[:-1]
    cells = np.searchsorted(outline.piece_of_cell, numbers)
    loops, owner = [], []
    for piece, (kind, entry) in enumerate(zip(tables.kind, tables.entry, strict=True)):
        if kind == POLYHEDRON:
            starts = tables.loop_offsets[tables.face_offsets[entry] :]
            count = tables.face_offsets[entry + 1] - tables.face_offsets[entry]
            own = [
                points[piece] + tables.loops[a:b]
                for a, b in zip(starts[:count], starts[1 : count + 1], strict=True)
            ]
        else:
            triangles = outline.cells[cells[piece] : cells[piece + 1]]
            if kind == HALF_SPACE:
                triangles = triangles[(outline.points[triangles][:, :, 2] >= 0.0).all(axis=1)]
            own = list(triangles)
        loops += own
        owner += [piece] * len(own)
    return loops, np.array(owner)
