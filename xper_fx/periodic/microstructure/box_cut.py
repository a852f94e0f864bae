# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains cut by the straight boundary of the box, for a periodic cell that is the box itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from xper_fx.periodic.microstructure.box import wrapped
from xper_fx.periodic.microstructure.tessellation import (
    Face,
    PieceFace,
    Tessellation,
    counterclockwise,
    fills_the_box,
)
from xper_fx.support.checks import require_kind

__all__ = ["cut_by_box"]

# A vertex nearer to the box's boundary than this, relative to the mean distance of seeds, would
# make an edge of no use.
_TOO_NEAR = 1e-6


def cut_by_box(tessellation: Tessellation, keep_origin: bool = False) -> Tessellation:
    """Cut grains where they cross the box's boundary, and move the pieces into the box.

    The pieces of a grain on opposite sides of the box face each other, periodically, as if they
    were not cut. A cut near a vertex makes a short edge; as a periodic medium has no origin, it
    is moved, one axis after the other, such that each plane lies in the middle of the widest gap
    between vertices.

    Args:
        tessellation: of whole grains; it is left as it was.
        keep_origin: cut where the box's boundary is instead.

    Returns:
        The tessellation of the box, from 0 to `periods`; `grain_of_piece` says whose each piece
        is. The seeds are moved with the grains.

    Raises:
        TypeError: no tessellation.
        ValueError: a vertex lies on the box's boundary; the grains are cut already.
    """
    require_kind("tessellation", tessellation, Tessellation)
    if tessellation.is_cut:
        raise ValueError("The grains are cut by the box already.")
    spacing = (tessellation.periods.prod() / tessellation.num_grains) ** (1 / tessellation.dim)
    cut = tessellation
    for axis in range(tessellation.dim):
        if not keep_origin:
            cut = _moved(cut, axis, _middle_of_widest_gap(cut, axis))
        along = cut.vertices[:, axis] / cut.periods[axis]
        apart = np.abs(along - np.rint(along)) * cut.periods[axis]
        if apart.min() < _TOO_NEAR * spacing:
            raise ValueError(
                f"A vertex at {cut.vertices[apart.argmin()].tolist()} lies on the box's boundary, "
                "where cutting would make edges without length: add the same vector to all "
                "seeds, or do not keep the origin."
            )
        cut = _Cut(cut, axis).result()
    if not fills_the_box(cut):
        raise RuntimeError("The pieces of the cut grains do not fill the box.")
    return replace(cut, seeds=wrapped(cut.seeds, cut.periods))


def _middle_of_widest_gap(tessellation: Tessellation, axis: int) -> float:
    """Return the coordinate, modulo the period, that is furthest from all vertices."""
    period = tessellation.periods[axis]
    taken = np.sort(np.mod(tessellation.vertices[:, axis], period))
    gaps = np.diff(taken, append=taken[0] + period)
    widest = np.argmax(gaps)
    return float(taken[widest] + gaps[widest] / 2)


def _moved(tessellation: Tessellation, axis: int, way: float) -> Tessellation:
    """Return the tessellation moved against an axis."""
    seeds, vertices = tessellation.seeds.copy(), tessellation.vertices.copy()
    seeds[:, axis] -= way
    vertices[:, axis] -= way
    return replace(tessellation, seeds=seeds, vertices=vertices)


class _Cut:
    """A tessellation being cut by the planes normal to an axis, one in each period.

    The m-th layer lies between the planes m and m + 1. Where a piece reaches into several layers,
    its part in each becomes a piece of its own, whose own place is in layer 0.
    """

    def __init__(self, parent: Tessellation, axis: int) -> None:
        """Cut all faces and pieces of a tessellation."""
        self.parent = parent
        self.axis = axis
        self.vertices = list(parent.vertices)
        self.crossings: dict[tuple[int, ...], int] = {}
        self.new_piece: dict[tuple[int, int], int] = {}
        self.grain_of_piece: list[int] = []
        self.faces: list[Face] = []
        # for each piece and plane the corners there, in the piece's own place
        self.on_plane: dict[tuple[int, int], set[tuple[int, ...]]] = {}
        parts = [self._parts(face) for face in parent.faces]
        for piece, sides in enumerate(parent.boundaries):
            for side in sides:
                self._note_crossings(piece, side, parts[side.face])
        for face, parts_of_face in zip(parent.faces, parts, strict=True):
            for layer, corners in parts_of_face.items():
                self._add_part(face, layer, corners)
        for (piece, plane), corners in self.on_plane.items():
            self._close(piece, plane, np.array(sorted(corners)))

    def result(self) -> Tessellation:
        """Return the cut tessellation."""
        boundaries: list[list[PieceFace]] = [[] for _ in self.grain_of_piece]
        for f, face in enumerate(self.faces):
            boundaries[face.pieces[0]].append(PieceFace(f, np.zeros_like(face.shift), True))
            boundaries[face.pieces[1]].append(PieceFace(f, -face.shift, False))
        return replace(
            self.parent,
            vertices=np.array(self.vertices),
            faces=tuple(self.faces),
            boundaries=tuple(map(tuple, boundaries)),
            grain_of_piece=np.array(self.grain_of_piece),
        )

    def _layer(self, vertex: int, shift: npt.NDArray[np.int64]) -> int:
        """Return the layer in which a moved vertex of the parent lies."""
        axis = self.axis
        x = self.parent.vertices[vertex, axis] / self.parent.periods[axis]
        return int(np.floor(x)) + int(shift[axis])

    def _parts(self, face: Face) -> dict[int, list[tuple[int, ...]]]:
        """Return the corners of a face's part in each layer: vertex, shift; in the face's order."""
        parts: dict[int, list[tuple[int, ...]]] = {}
        corners = list(zip(face.corners.tolist(), face.corner_shifts, strict=True))
        ends = corners[1:] + corners[:1] if len(corners) > 2 else [corners[1], corners[1]]
        for (a, at_a), (b, at_b) in zip(corners, ends, strict=True):
            here, there = self._layer(a, at_a), self._layer(b, at_b)
            parts.setdefault(here, []).append((a, *at_a.tolist()))
            step = 1 if there > here else -1
            for layer in range(here, there, step):
                plane = max(layer, layer + step)
                crossing = self._crossing(a, at_a, b, at_b, plane)
                parts.setdefault(layer, []).append(crossing)
                parts.setdefault(layer + step, []).append(crossing)
        return parts

    def _crossing(
        self,
        a: int,
        at_a: npt.NDArray[np.int64],
        b: int,
        at_b: npt.NDArray[np.int64],
        plane: int,
    ) -> tuple[int, ...]:
        """Return the vertex where an edge crosses a plane, and its shift."""
        axis, periods = self.axis, self.parent.periods
        if (b, *(at_a - at_b)) < (a, *(at_b - at_a)):  # translates are cut at the same place
            a, at_a, b, at_b = b, at_b, a, at_a
        key = (a, b, *(at_b - at_a).tolist(), plane - int(at_a[axis]))
        if key not in self.crossings:
            start = self.parent.vertices[a]
            way = self.parent.vertices[b] + (at_b - at_a) * periods - start
            height = (plane - at_a[axis]) * periods[axis]
            x = start + (height - start[axis]) / way[axis] * way
            x[axis] = 0.0
            self.crossings[key] = len(self.vertices)
            self.vertices.append(x)
        shift = at_a.tolist()
        shift[axis] = plane
        return (self.crossings[key], *shift)

    def _note_crossings(
        self, piece: int, side: PieceFace, parts: dict[int, list[tuple[int, ...]]]
    ) -> None:
        """Note the corners of a piece's face that lie on planes."""
        first = len(self.parent.vertices)
        for corners in parts.values():
            for vertex, *shift in corners:
                if vertex >= first:
                    moved = side.shift + shift
                    plane = int(moved[self.axis])
                    found = self.on_plane.setdefault((piece, plane), set())
                    found.add((vertex, *moved.tolist()))

    def _piece(self, piece: int, layer: int) -> int:
        """Return the new piece that is the part of one of the parent's in a layer."""
        key = (piece, layer)
        if key not in self.new_piece:
            self.new_piece[key] = len(self.grain_of_piece)
            self.grain_of_piece.append(int(self.parent.grain_of_piece[piece]))
        return self.new_piece[key]

    def _add_part(self, face: Face, layer: int, corners: list[tuple[int, ...]]) -> None:
        """Add the part of a face in a layer, moved to layer 0."""
        table = np.array(corners)
        table[:, 1 + self.axis] -= layer
        first, second = face.pieces
        pieces = (
            self._piece(first, layer),
            self._piece(second, layer - int(face.shift[self.axis])),
        )
        shift = face.shift.copy()
        shift[self.axis] = 0
        self.faces.append(Face(pieces, shift, table[:, 0], table[:, 1:]))

    def _close(self, piece: int, plane: int, corners: npt.NDArray[np.int64]) -> None:
        """Add the face where a plane cuts a piece, between the parts below and above."""
        corners[:, 1 + self.axis] -= plane - 1
        shift = np.zeros(self.parent.dim, dtype=np.int64)
        shift[self.axis] = 1
        x = np.array(self.vertices)[corners[:, 0]] + corners[:, 1:] * self.parent.periods
        order = counterclockwise(x, shift.astype(float))
        pieces = (self._piece(piece, plane - 1), self._piece(piece, plane))
        self.faces.append(Face(pieces, shift, corners[order, 0], corners[order, 1:]))
