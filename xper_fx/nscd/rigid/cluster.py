# SPDX-License-Identifier: LGPL-3.0-or-later
"""Clusters: rigid bodies of several convex parts, for solids that are not convex.

With the mass m_i, the centroid x_i and the inertia J_i about it (in the axes of the cluster) of
part i, the parallel axis theorem (Huygens, Steiner) gives

    m = sum m_i,   m x = sum m_i x_i,   J = sum J_i + m_i (|d_i|^2 I - d_i (x) d_i),

with d_i = x_i - x; in 2D the bracket is |d_i|^2. The sums count twice where parts overlap: such
parts are refused unless the mass properties are given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid.bodies import RigidBodies, plane_rotations
from xper_fx.nscd.rigid.body import RigidBody, resolve
from xper_fx.nscd.rigid.polygon import Polygon
from xper_fx.nscd.rigid.polyhedron import Polyhedron
from xper_fx.nscd.rigid.shapes import (
    CLUSTER,
    POLYGON,
    POLYHEDRON,
    Disc,
    MassProperties,
    Piece,
    Shape,
    Sphere,
    check_positive,
)
from xper_fx.nscd.search.rigid_search import RigidSearch

# Depth that counts as touching, relative to the smallest part.
_TOUCHING = 1e-6


@dataclass(frozen=True, eq=False)
class Part:
    """A convex shape in a cluster.

    Args:
        shape: a disc, polygon, sphere or polyhedron.
        position: of its centroid in the axes of the cluster, shape (dim,), m; None leaves the
            vertices of a polygon or polyhedron where they were drawn.
        angle: 2D: of the shape's axes from those of the cluster, rad, counter-clockwise.
        rotation: 3D: from the shape's axes to those of the cluster, as of `RigidBody`.
    """

    shape: Shape
    position: npt.ArrayLike | None = None
    angle: float = 0.0
    rotation: Rotation | npt.ArrayLike | None = None


@dataclass(frozen=True, eq=False)
class Cluster:
    """A solid of convex parts, which move as one body and do not touch each other.

    Args:
        parts: one or more, as `Part`; a polygon or polyhedron may stand for itself where it was
            drawn. Parts may touch; where they are apart, what joins them has no mass.
        properties: mass properties for the density 1 kg/m^3, the centre and the inertia in the axes
            of the cluster. None: the sums over the parts, which must not overlap then.

    Raises:
        TypeError, ValueError: no parts, something that is no convex part, with its number, parts
            of 2D and 3D, parts that overlap without `properties`.
    """

    parts: Sequence[Part | Shape]
    properties: MassProperties | None = None
    kind: ClassVar[int] = CLUSTER

    def __post_init__(self) -> None:
        if isinstance(self.parts, str) or not isinstance(self.parts, Sequence) or not self.parts:
            raise TypeError(f"The parts of a cluster should be a list, [...], got {self.parts!r}.")
        bodies = [_as_body(number, part) for number, part in enumerate(self.parts)]
        for number, body in enumerate(bodies):
            if body.shape.dim != bodies[0].shape.dim:
                raise ValueError(
                    f"Part {number} of a cluster is of dimension {body.shape.dim}, part 0 of "
                    f"dimension {bodies[0].shape.dim}."
                )
        object.__setattr__(self, "parts", tuple(self.parts))
        object.__setattr__(self, "_placed", RigidBodies(bodies))
        object.__setattr__(self, "_shapes", [body.shape for body in bodies])
        if self.properties is None:
            self._refuse_overlaps()
        else:
            object.__setattr__(self, "properties", _checked(self.properties, self.dim))

    def _refuse_overlaps(self) -> None:
        placed = self._placed
        touching = _TOUCHING * float(placed.bounding_radius.min())
        search = RigidSearch(placed, [("parts", "parts")], touching)
        for i, j, depth in search.overlaps(placed.position, placed.rotation, touching):
            raise ValueError(
                f"Parts {i} and {j} of a cluster overlap by {depth:.3g} m, and the sum of their "
                "masses would count the overlap twice: cut the parts so that they touch, or give "
                "the properties of the whole, MassProperties(mass, centre, inertia) for the "
                "density 1 kg/m^3."
            )

    @property
    def dim(self) -> int:
        """2 or 3."""
        return self._placed.dim

    @cached_property
    def unit_properties(self) -> MassProperties:
        """Mass properties for the density 1 kg/m^3."""
        if self.properties is not None:
            return self.properties
        placed = self._placed
        mass, position, turn = placed.mass, placed.position, self._turns
        centre = mass @ position / mass.sum()
        arm = position - centre
        square = np.einsum("pi,pi->p", arm, arm)
        if self.dim == 2:
            inertia = float(np.sum(placed.inertia + mass * square))
            return MassProperties(float(mass.sum()), centre, inertia)
        own = turn @ placed.inertia @ turn.transpose(0, 2, 1)
        shifted = square[:, None, None] * np.eye(3) - arm[:, :, None] * arm[:, None]
        inertia = np.sum(own + mass[:, None, None] * shifted, axis=0)
        return MassProperties(float(mass.sum()), centre, 0.5 * (inertia + inertia.T))

    def mass_properties(self, density: float) -> MassProperties:
        """Mass properties for a density (kg/m^3); in 2D per metre of depth."""
        density = check_positive("A density (kg/m^3)", density)
        mass, centre, inertia = self.unit_properties
        return MassProperties(density * mass, centre, density * inertia)

    @property
    def _turns(self) -> np.ndarray:
        rotation = self._placed.rotation
        return plane_rotations(rotation) if self.dim == 2 else rotation

    @cached_property
    def pieces(self) -> list[Piece]:
        """The parts with the axes of the cluster, about its centre of mass."""
        offset = self._placed.position - self.unit_properties.centre
        return [
            Piece(_turned(shape, turn), place)
            for shape, turn, place in zip(self._shapes, self._turns, offset, strict=True)
        ]

    @property
    def bounding_radius(self) -> float:
        """Largest distance of a point from the centre of mass (m)."""
        furthest = 0.0
        for shape, offset in self.pieces:
            corners = getattr(shape, "centred_vertices", np.zeros((1, self.dim)))
            distance = np.linalg.norm(offset + corners, axis=1).max()
            furthest = max(furthest, float(distance) + getattr(shape, "radius", 0.0))
        return furthest


def _as_body(number: int, part: Any) -> RigidBody:
    """A part as a body on its own."""
    if not isinstance(part, Part):
        part = Part(part)
    shape = part.shape
    if isinstance(shape, type) or not hasattr(shape, "kind"):
        raise TypeError(
            f"Part {number} of a cluster should be a Part, or a convex shape of this package that "
            f"was drawn in its place, such as Polygon([...]), got {shape!r}."
        )
    if hasattr(shape, "pieces"):
        raise TypeError(f"Part {number} of a cluster is a cluster itself: list its parts instead.")
    if not np.isfinite(shape.bounding_radius):
        raise TypeError(f"Part {number} of a cluster is a wall, which has no end and no mass.")
    body = RigidBody(
        shape, part.position, "parts", angle=part.angle, rotation=part.rotation, density=1.0
    )
    try:
        resolve(body)
    except (TypeError, ValueError) as error:
        raise type(error)(f"Part {number} of a cluster: {error}") from error
    return body


def _turned(shape: Any, turn: np.ndarray) -> Shape:
    """A shape with other axes."""
    if shape.kind not in (POLYGON, POLYHEDRON) or np.array_equal(turn, np.eye(shape.dim)):
        return shape
    vertices = shape.centred_vertices @ turn.T
    return Polygon(vertices) if shape.kind == POLYGON else Polyhedron(vertices, shape.faces)


def _checked(properties: Any, dim: int) -> MassProperties:
    """Mass properties as numbers, checked as those of a body."""
    if not isinstance(properties, tuple) or len(properties) != 3 or properties[2] is None:
        raise TypeError(
            "The properties of a cluster should be a MassProperties(mass, centre, inertia), got "
            f"{properties!r}."
        )
    mass, centre, inertia = properties
    shape = Disc(1.0) if dim == 2 else Sphere(1.0)
    try:
        body = resolve(RigidBody(shape, centre, "cluster", mass=mass, inertia=inertia))
    except (TypeError, ValueError) as error:
        raise type(error)(f"The properties of a cluster: {error}") from error
    return MassProperties(body.mass, body.position, body.inertia)
