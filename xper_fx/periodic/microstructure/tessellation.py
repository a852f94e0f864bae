# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic tessellations: a box that repeats, cut into convex grains around seeds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import factorial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from xper_fx.periodic.microstructure.box import checked_periods, near_pairs, wrapped
from xper_fx.periodic.microstructure.power_diagram import DiagramVertices, diagram_vertices
from xper_fx.support.checks import require_kind, require_numbers

__all__ = [
    "Face",
    "PieceFace",
    "Tessellation",
    "counterclockwise",
    "fills_the_box",
    "nearest_grains",
    "tessellate",
]

# Images of the seeds are looked at up to this many mean seed distances outside the box at first.
_FIRST_MARGIN = 3.0
# The cells' volumes sum to the box's up to this, relative; if not, images were missing.
_VOLUME_TOLERANCE = 1e-10
# Seeds nearer than this, relative to their mean distance, are one seed given twice.
_DUPLICATE = 1e-6


class Face(NamedTuple):
    """What two pieces share: an edge or a polygon; one of each class modulo the lattice."""

    pieces: tuple[int, int]  #: the two pieces; the first one in its own place
    #: by how many periods the second piece is moved to face the first, shape (dim,), int. A piece
    #: may face its own image.
    shift: npt.NDArray[np.int64]
    #: vertices of the tessellation, shape (k,), int; k = 2 in 2D. Seen from outside of the first
    #: piece counterclockwise (2D: that piece lies to the left).
    corners: npt.NDArray[np.int64]
    #: by how many periods each of them is moved, shape (k, dim), int
    corner_shifts: npt.NDArray[np.int64]


class PieceFace(NamedTuple):
    """A face as a part of a piece's boundary."""

    face: int  #: index of the face in the tessellation
    #: by how many periods the face is moved to be there, shape (dim,), int
    shift: npt.NDArray[np.int64]
    outward: bool  #: whether its corners are counterclockwise as seen from outside of this piece


@dataclass(frozen=True, eq=False)
class Tessellation:
    """A periodic tessellation into grains; made by `tessellate` and `box_cut.cut_by_box`.

    Each grain is the whole convex cell around its seed, in one piece: the grains' union is a
    periodic cell with a jagged boundary of grain boundaries. Or the box cuts them: then its union
    is the box, and a grain at the boundary consists of several convex pieces on opposite sides.
    The translates of either by the lattice fill the space. With few whole grains the union may
    fall apart.

    Attributes:
        seeds: shape (num_grains, dim), m, wrapped into the box from 0 to `periods`.
        weights: shape (num_grains,), m^2; zeros give the Voronoi tessellation.
        periods: edges of the box, shape (dim,), m.
        vertices: one of each class modulo the lattice, shape (num_vertices, dim), m.
        faces: one of each class modulo the lattice.
        boundaries: for each piece, in its own place, the faces around it.
        grain_of_piece: shape (num_pieces,), int; of whole grains 0, 1, 2, ...
    """

    seeds: npt.NDArray[np.float64]
    weights: npt.NDArray[np.float64]
    periods: npt.NDArray[np.float64]
    vertices: npt.NDArray[np.float64]
    faces: tuple[Face, ...]
    boundaries: tuple[tuple[PieceFace, ...], ...]
    grain_of_piece: npt.NDArray[np.int64]

    @property
    def num_grains(self) -> int:
        """Return the number of grains."""
        return len(self.seeds)

    @property
    def dim(self) -> int:
        """Return the dimension, 2 or 3."""
        return len(self.periods)

    @property
    def is_cut(self) -> bool:
        """Return whether the box cuts the grains."""
        return len(self.grain_of_piece) > self.num_grains

    @property
    def lattice(self) -> npt.NDArray[np.float64]:
        """Return the period vectors as rows, shape (dim, dim), m."""
        return np.diag(self.periods)

    def face_corners(self, side: PieceFace) -> npt.NDArray[np.float64]:
        """Return the corners of a piece's face, shape (k, dim), m, as seen from outside the piece.

        In 3D they are counterclockwise; in 2D the piece is to the left on the way from the first
        to the second.
        """
        face = self.faces[side.face]
        x = self.vertices[face.corners] + (face.corner_shifts + side.shift) * self.periods
        return x if side.outward else x[::-1]

    @cached_property
    def _moments(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Volumes and centroids of the pieces, as sums over simplices with a tip in the piece.

        A simplex of tip o and other corners a_i has the volume det(a_i - o) / dim! and the
        centroid o + sum(a_i - o) / (dim + 1). In 3D a face is cut into triangles around its mean
        corner.
        """
        sides = [side for boundary in self.boundaries for side in boundary]
        piece = np.repeat(np.arange(len(self.boundaries)), list(map(len, self.boundaries)))
        corners = [self.face_corners(side) for side in sides]
        sizes = np.array(list(map(len, corners)))
        x, first = np.concatenate(corners), np.cumsum(sizes) - sizes
        middle = np.add.reduceat(x, first) / sizes[:, np.newaxis]  # of a face
        starts = np.searchsorted(piece, np.arange(len(self.boundaries)))
        tip = np.add.reduceat(middle, starts) / np.bincount(piece)[:, np.newaxis]
        if self.dim == 3:
            face, after = np.repeat(np.arange(len(sides)), sizes), np.arange(1, len(x) + 1)
            after[first + sizes - 1] = first
            simplices, piece = np.stack([middle[face], x, x[after]], axis=1), piece[face]
        else:
            simplices = x.reshape(-1, 2, 2)
        simplices = simplices - tip[piece][:, np.newaxis]
        parts = np.linalg.det(simplices) / factorial(self.dim)
        volumes = np.bincount(piece, parts)
        moments = parts[:, np.newaxis] * simplices.sum(axis=1) / (self.dim + 1)
        starts = np.searchsorted(piece, np.arange(len(volumes)))
        return volumes, tip + np.add.reduceat(moments, starts) / volumes[:, np.newaxis]

    @property
    def volumes(self) -> npt.NDArray[np.float64]:
        """Return the grains' areas (m^2) or volumes (m^3), shape (num_grains,)."""
        return np.bincount(self.grain_of_piece, self.piece_volumes, self.num_grains)

    @property
    def piece_volumes(self) -> npt.NDArray[np.float64]:
        """Return the pieces' areas (m^2) or volumes (m^3), shape (num_pieces,)."""
        return self._moments[0]

    @property
    def centroids(self) -> npt.NDArray[np.float64]:
        """Return the pieces' centroids, shape (num_pieces, dim), m; each piece in its own place."""
        return self._moments[1]

    @cached_property
    def shortest_edge(self) -> float:
        """Return the length of the shortest edge, m; around it a mesh has cells no larger."""
        shortest = np.inf
        for face in self.faces:
            x = self.vertices[face.corners] + face.corner_shifts * self.periods
            lengths = np.linalg.norm(x - np.roll(x, -1, axis=0), axis=1)
            shortest = min(shortest, float(lengths.min()))
        return shortest


def tessellate(
    seeds: npt.ArrayLike, periods: npt.ArrayLike, weights: npt.ArrayLike | None = None
) -> Tessellation:
    """Cut a periodic box into Voronoi cells, or Laguerre (power) cells.

    A point x belongs to the seed p, of weight w, with the smallest |x - p|^2 - w, over all seeds
    and all their periodic images. The face between two seeds a distance d apart lies on the plane
    at (d + (w_1 - w_2) / d) / 2 from the first: with weights, a seed may lie outside its grain.

    One seed is enough (its grain is the box).

    Args:
        seeds: shape (n, 2) or (n, 3), m; those outside the box from 0 to `periods` are wrapped
            into it.
        periods: edges of the box, shape (dim,), m.
        weights: shape (n,), m^2, of any sign; only differences count. By default Voronoi.

    Returns:
        The tessellation.

    Raises:
        ValueError: shapes do not fit; a number is not finite, a period is not positive; two seeds
            coincide modulo the lattice; a seed has no cell (weights too different).
        RuntimeError: the seeds are placed such that rounding decides the topology.
    """
    points, box, power = _checked(seeds, periods, weights)
    # lengths in a unit near the mean distance of the seeds; a power of two scales exactly
    unit = 2.0 ** np.rint(np.log2(box.prod() / len(points)) / len(box))
    points, box, power = points / unit, box / unit, power / unit**2
    margin, diagonal = _FIRST_MARGIN, float(np.linalg.norm(box))
    while True:
        margin = min(margin, diagonal)
        vertices = diagram_vertices(points, power, box, margin)
        if vertices is not None:
            found = _assemble(points, power, box, vertices)
            if found is not None:
                break
        if margin == diagonal:
            raise RuntimeError(
                f"The cells of these {len(points)} seeds do not fill the box: rounding decides "
                "where their vertices are. Move the seeds a little (random ones: take another seed "
                "or another number of relaxation steps)."
            )
        margin *= 2
    return Tessellation(
        seeds=found.seeds * unit,
        weights=found.weights * unit**2,
        periods=found.periods * unit,
        vertices=found.vertices * unit,
        faces=found.faces,
        boundaries=found.boundaries,
        grain_of_piece=found.grain_of_piece,
    )


def _checked(
    seeds: npt.ArrayLike, periods: npt.ArrayLike, weights: npt.ArrayLike | None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return wrapped seeds, periods and weights as arrays, or raise."""
    box = checked_periods(periods)
    points = require_numbers("seeds", seeds)
    if points.ndim != 2 or points.shape[1] != len(box) or len(points) == 0:
        raise ValueError(
            f"seeds has shape {points.shape}; expected (n, {len(box)}), n at least 1, a row for "
            f"each seed and a column for each of the {len(box)} periods."
        )
    power = np.zeros(len(points)) if weights is None else require_numbers("weights", weights)
    if power.shape != (len(points),):
        raise ValueError(
            f"weights has shape {power.shape}; expected one for each of the {len(points)} seeds, "
            f"shape ({len(points)},)."
        )
    for name, values in (("seeds", points), ("weights", power)):
        if not np.all(np.isfinite(values)):
            bad = int(np.argmin(np.isfinite(values).reshape(len(points), -1).all(axis=1)))
            raise ValueError(f"{name}[{bad}] is {values[bad]}; expected finite numbers.")
    points = wrapped(points, box)
    spacing = (box.prod() / len(points)) ** (1 / len(box))
    pairs = near_pairs(points, box, min(_DUPLICATE * spacing, box.min() / 4))
    if len(pairs):
        raise ValueError(
            f"Seeds {pairs[0, 0]} and {pairs[0, 1]} coincide modulo the periods, at "
            f"{points[pairs[0, 0]].tolist()} ({len(pairs)} such pairs in all); leave one out."
        )
    return points, box, power


def _assemble(
    seeds: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    periods: npt.NDArray[np.float64],
    vertices: DiagramVertices,
) -> Tessellation | None:
    """Build the tessellation of given vertices; None if its grains do not fill the box.

    The cells of a power diagram meet in common faces, so that the corners of the face between two
    grains are the vertices where both are.
    """
    dim = len(periods)
    shared: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for vertex, (around, moved) in enumerate(zip(vertices.seeds, vertices.shifts, strict=True)):
        grains = [(i, *k) for i, k in zip(around.tolist(), moved.tolist(), strict=True)]
        for (i, *at_i), (j, *at_j) in combinations(sorted(grains), 2):
            apart = (b - a for a, b in zip(at_i, at_j, strict=True))
            shared.setdefault((i, j, *apart), []).append((vertex, *(-a for a in at_i)))
    faces = []
    boundaries: list[list[PieceFace]] = [[] for _ in seeds]
    for (i, j, *apart), corners in sorted(shared.items()):
        if len(corners) < dim:
            continue  # these grains share a corner, or in 3D an edge
        if dim == 2 and len(corners) > 2:
            return None  # of unfinished cells
        shift = np.array(apart)
        corner, corner_shift = np.array(corners)[:, 0], np.array(corners)[:, 1:]
        order = counterclockwise(
            vertices.x[corner] + corner_shift * periods, seeds[j] + shift * periods - seeds[i]
        )
        boundaries[i].append(PieceFace(len(faces), np.zeros_like(shift), True))
        boundaries[j].append(PieceFace(len(faces), -shift, False))
        faces.append(Face((i, j), shift, corner[order], corner_shift[order]))
    found = Tessellation(
        seeds,
        weights,
        periods,
        vertices.x,
        tuple(faces),
        tuple(map(tuple, boundaries)),
        np.arange(len(seeds)),
    )
    return found if fills_the_box(found) else None


def fills_the_box(tessellation: Tessellation) -> bool:
    """Return whether the pieces have closed boundaries, and volumes that sum to the box's."""
    if not all(_is_closed(tessellation, sides) for sides in tessellation.boundaries):
        return False
    volumes, box = tessellation.piece_volumes, tessellation.periods.prod()
    return bool(volumes.min() > 0 and abs(volumes.sum() - box) <= _VOLUME_TOLERANCE * box)


def counterclockwise(
    corners: npt.NDArray[np.float64], normal: npt.NDArray[np.float64]
) -> npt.NDArray[np.intp]:
    """Return the order of the corners of a convex face as seen against its normal."""
    if corners.shape[1] == 2:
        return np.argsort(corners @ (-normal[1], normal[0]))
    arms = corners - corners.mean(axis=0)
    first = arms[np.argmax(np.einsum("ij,ij->i", arms, arms))]
    second = np.cross(normal, first) / np.linalg.norm(normal)
    return np.argsort(np.arctan2(arms @ second, arms @ first))


def _is_closed(tessellation: Tessellation, sides: tuple[PieceFace, ...]) -> bool:
    """Return whether the boundary of a piece is closed.

    The signed sum of its faces' corners (2D) or of their edges (3D) must vanish, and each be
    there exactly twice.
    """
    count: dict[tuple[int, ...], list[int]] = {}
    for side in sides:
        face = tessellation.faces[side.face]
        moved = (face.corner_shifts + side.shift).tolist()
        corners = [(c, *k) for c, k in zip(face.corners.tolist(), moved, strict=True)]
        sign = 1 if side.outward else -1
        if tessellation.dim == 2:
            ends = [(corners[0], sign), (corners[1], -sign)]
        else:
            following = corners[1:] + corners[:1]
            ends = [
                ((a + b, sign) if a < b else (b + a, -sign))
                for a, b in zip(corners, following, strict=True)
            ]
        for end, direction in ends:
            count.setdefault(end, []).append(direction)
    return bool(count) and all(sorted(found) == [-1, 1] for found in count.values())


def nearest_grains(
    tessellation: Tessellation, point: npt.ArrayLike, count: int
) -> npt.NDArray[np.int64]:
    """Return the grains nearest to a point, over all periodic images, the one around it first.

    The measure is the power |x - p|^2 - w of the point; without weights, the distance of the
    seeds. A few nearest grains make an inclusion of several grains.

    Args:
        tessellation: the grains.
        point: shape (dim,), m.
        count: number of grains, 0 to the number of grains.

    Returns:
        Grains by distance, shape (count,).

    Raises:
        TypeError: `count` is no integer, the point no numbers, or there is no tessellation.
        ValueError: the point is of another dimension or not finite; there are too few grains.
    """
    require_kind("tessellation", tessellation, Tessellation)
    x = require_numbers("point", point)
    if x.shape != (tessellation.dim,) or not np.all(np.isfinite(x)):
        raise ValueError(f"point is {point!r}; expected {tessellation.dim} finite coordinates.")
    if isinstance(count, bool) or not isinstance(count, int | np.integer):
        raise TypeError(f"count is {count!r}; expected an integer.")
    if not 0 <= count <= tessellation.num_grains:
        raise ValueError(
            f"count is {count}; expected 0 to the number of grains, {tessellation.num_grains}."
        )
    apart = tessellation.seeds - x
    apart -= tessellation.periods * np.rint(apart / tessellation.periods)
    power = np.einsum("ij,ij->i", apart, apart) - tessellation.weights
    return np.argsort(power, kind="stable")[:count]
