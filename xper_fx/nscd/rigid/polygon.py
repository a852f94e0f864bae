# SPDX-License-Identifier: LGPL-3.0-or-later
"""Convex polygons.

Mass properties follow from Green's theorem, edge by edge: with a and b the ends of an edge,
measured from the first vertex so that a far polygon loses no digits, and c = a x b,

    A = sum c / 2,   A g = sum c (a + b) / 6,   int |x|^2 dA = sum c (a.a + a.b + b.b) / 12,

and the inertia about the centroid g is rho (int |x|^2 dA - A |g|^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.rigid.shapes import POLYGON, Cornered, MassProperties, check_positive
from xper_fx.support.checks import require_count, require_numbers, require_vector

# Sides of a polygon that a search of contacts still bears.
_MOST_SIDES = 10_000
# Sine of a turn to the wrong side that still counts as straight.
_STRAIGHT = 1e-10


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The component a_x b_y - a_y b_x of the cross product of plane vectors, shape (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


@dataclass(frozen=True, eq=False)
class Polygon(Cornered):
    """A convex polygon (2D).

    Args:
        vertices: counter-clockwise, shape (n, 2), n >= 3, m, in coordinates of any origin: a body
            moves them so that its position is that of the centroid.

    Raises:
        ValueError: fewer than three vertices, coinciding ones, clockwise, or not convex.
    """

    vertices: npt.ArrayLike
    kind: ClassVar[int] = POLYGON
    dim: ClassVar[int] = 2

    def __post_init__(self) -> None:
        vertices = require_numbers("The vertices of a polygon", self.vertices)
        if vertices.ndim != 2 or vertices.shape[1] != 2 or len(vertices) < 3:
            raise ValueError(
                f"A polygon takes vertices of shape (n, 2) with n >= 3, got {vertices.shape}."
            )
        if not np.isfinite(vertices).all():
            bad = int(np.nonzero(~np.isfinite(vertices).all(1))[0][0])
            raise ValueError(f"Vertex {bad} of a polygon is not finite: {vertices[bad]}.")
        vertices.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        self._check_convex()

    def _check_convex(self) -> None:
        x = self.vertices
        out = np.roll(x, -1, axis=0) - x
        length = np.linalg.norm(out, axis=1)
        size = np.ptp(x, axis=0).max()
        short = np.nonzero(length <= 1e-12 * size)[0]
        if len(short):
            first = int(short[0])
            raise ValueError(
                f"Vertices {first} and {(first + 1) % len(x)} of a polygon coincide at {x[first]}: "
                "leave one of them out."
            )
        out = out / length[:, None]
        into = np.roll(out, 1, axis=0)
        turn = np.arctan2(cross(into, out), np.sum(into * out, axis=1))
        back = np.nonzero(np.abs(turn) > np.pi - _STRAIGHT)[0]
        if len(back):
            raise ValueError(
                f"A polygon turns back on itself at vertex {int(back[0])}, {x[back[0]]}."
            )
        if turn.sum() < -np.pi:
            raise ValueError(
                "The vertices of a polygon go clockwise: give them counter-clockwise, "
                "vertices[::-1]."
            )
        wrong = np.nonzero(turn < -_STRAIGHT)[0]
        if len(wrong):
            bad = int(wrong[0])
            raise ValueError(
                f"A polygon is not convex at vertex {bad}, {x[bad]}: cut it into convex ones."
            )
        if turn.sum() > 3.0 * np.pi:
            raise ValueError("A polygon goes round more than once: its edges cross each other.")

    @classmethod
    def box(cls, lengths: Sequence[float]) -> Polygon:
        """A rectangle about the origin with sides `lengths`, shape (2,), m.

        Raises:
            TypeError, ValueError: other than two lengths above zero.
        """
        sides = require_vector("The side lengths of a rectangle (m)", lengths, (2,))
        x, y = (0.5 * check_positive("A side of a rectangle (m)", length) for length in sides)
        return cls([[-x, -y], [x, -y], [x, y], [-x, y]])

    @classmethod
    def regular(cls, sides: int, radius: float) -> Polygon:
        """A regular polygon about the origin, its first vertex at (radius, 0), m.

        Raises:
            TypeError, ValueError: sides that are no integer from 3 to 10000, no radius above zero.
        """
        if require_count("sides", sides, 3) > _MOST_SIDES:
            raise ValueError(f"sides should be at most {_MOST_SIDES}, got {sides}.")
        radius = check_positive("The radius of a polygon (m)", radius)
        angle = 2.0 * np.pi * np.arange(sides) / sides
        return cls(radius * np.column_stack([np.cos(angle), np.sin(angle)]))

    @cached_property
    def unit_properties(self) -> MassProperties:
        """Mass properties for the density 1 kg/m^3."""
        a = self.vertices - self.vertices[0]
        b = np.roll(a, -1, axis=0)
        twice = cross(a, b)
        area = 0.5 * twice.sum()
        centre = twice @ (a + b) / (6.0 * area)
        a, b = a - centre, b - centre
        polar = cross(a, b) @ (np.sum(a * a + a * b + b * b, axis=1)) / 12.0
        return MassProperties(float(area), self.vertices[0] + centre, float(polar))

    @cached_property
    def edge_normals(self) -> np.ndarray:
        """Outward unit normal of the edge from vertex i to i + 1, shape (n, 2)."""
        edge = np.roll(self.vertices, -1, axis=0) - self.vertices
        edge = edge / np.linalg.norm(edge, axis=1)[:, None]
        return np.column_stack([edge[:, 1], -edge[:, 0]])
