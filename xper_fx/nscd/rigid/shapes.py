# SPDX-License-Identifier: LGPL-3.0-or-later
"""What shapes of rigid bodies have in common, and the shapes without corners.

A shape lives in the axes of its body. Its mass properties are those of a homogeneous solid; in 2D
they are per metre of depth, so that a density stays in kg/m^3 and a mass is in kg/m. The inertia
is about the centre of mass: a number in 2D (kg m^2/m), a symmetric (3, 3) matrix in 3D (kg m^2),
J = int rho (|x|^2 I - x (x) x) dV.

Half planes and half spaces have neither mass nor size: they are walls, whose motion is prescribed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from xper_fx.support.checks import require_number

# Kinds of shapes, as the tables for compiled kernels name them.
DISC, POLYGON, HALF_PLANE, SPHERE, POLYHEDRON, HALF_SPACE, CLUSTER = range(7)


class MassProperties(NamedTuple):
    """Mass properties of a homogeneous shape.

    Attributes:
        mass: kg (2D: kg/m).
        centre: centre of mass in the shape's own coordinates, shape (dim,), m.
        inertia: about the centre of mass: a float in 2D (kg m), shape (3, 3) in 3D (kg m^2).
    """

    mass: float
    centre: np.ndarray
    inertia: float | np.ndarray


class Shape(Protocol):
    """A solid in the axes of its body, convex or a cluster, which has convex `pieces`.

    Attributes:
        kind: one of the numbers of this module.
        dim: 2 or 3.
        bounding_radius: radius about the centre of mass that holds the shape (m), inf for walls.
    """

    kind: ClassVar[int]
    dim: ClassVar[int]

    @property
    def bounding_radius(self) -> float: ...


class Piece(NamedTuple):
    """A convex shape of a body."""

    shape: Shape  #: with the axes of the body
    #: of its centroid from the body's centre of mass, in the body's axes, (dim,), m
    offset: np.ndarray


def check_positive(what: str, value: float) -> float:
    """The value as a float; ValueError if it is not a finite positive number."""
    try:
        number = require_number(what, value)
    except TypeError:
        number = math.nan
    if not (math.isfinite(number) and number > 0.0):
        raise ValueError(f"{what} must be a finite positive number, got {value!r}.")
    return number


class Cornered:
    """A solid with vertices, shape (n, dim), and `unit_properties` for the density 1 kg/m^3."""

    vertices: np.ndarray
    unit_properties: MassProperties

    def mass_properties(self, density: float) -> MassProperties:
        """Mass properties for a density (kg/m^3); in 2D per metre of depth."""
        density = check_positive("A density (kg/m^3)", density)
        unit = self.unit_properties
        return MassProperties(density * unit.mass, unit.centre, density * unit.inertia)

    @cached_property
    def centred_vertices(self) -> np.ndarray:
        """Vertices about the centroid, shape (n, dim), m."""
        return self.vertices - self.unit_properties.centre

    @property
    def bounding_radius(self) -> float:
        """Largest distance of a vertex from the centroid (m)."""
        return float(np.linalg.norm(self.centred_vertices, axis=1).max())


@dataclass(frozen=True, eq=False)
class Disc:
    """A disc about the origin of the body's axes (2D).

    Args:
        radius: m.

    Raises:
        ValueError: the radius is not a finite positive number.
    """

    radius: float
    kind: ClassVar[int] = DISC
    dim: ClassVar[int] = 2

    def __post_init__(self) -> None:
        radius = check_positive("The radius of a disc (m)", self.radius)
        object.__setattr__(self, "radius", radius)

    @property
    def bounding_radius(self) -> float:
        """The radius (m)."""
        return float(self.radius)

    def mass_properties(self, density: float) -> MassProperties:
        """Mass properties for a density (kg/m^3): J = m r^2 / 2."""
        mass = check_positive("A density (kg/m^3)", density) * np.pi * self.radius * self.radius
        return MassProperties(mass, np.zeros(2), 0.5 * mass * self.radius * self.radius)


@dataclass(frozen=True, eq=False)
class Sphere:
    """A ball about the origin of the body's axes (3D).

    Args:
        radius: m.

    Raises:
        ValueError: the radius is not a finite positive number.
    """

    radius: float
    kind: ClassVar[int] = SPHERE
    dim: ClassVar[int] = 3

    def __post_init__(self) -> None:
        radius = check_positive("The radius of a sphere (m)", self.radius)
        object.__setattr__(self, "radius", radius)

    @property
    def bounding_radius(self) -> float:
        """The radius (m)."""
        return float(self.radius)

    def mass_properties(self, density: float) -> MassProperties:
        """Mass properties for a density (kg/m^3): J = 2/5 m r^2 I."""
        mass = check_positive("A density (kg/m^3)", density) * 4.0 / 3.0 * np.pi
        mass *= self.radius * self.radius * self.radius
        return MassProperties(mass, np.zeros(3), 0.4 * mass * self.radius * self.radius * np.eye(3))


@dataclass(frozen=True, eq=False)
class HalfPlane:
    """A wall in 2D: the solid is y <= 0 in the body's axes, the outward normal its +y."""

    kind: ClassVar[int] = HALF_PLANE
    dim: ClassVar[int] = 2

    @property
    def bounding_radius(self) -> float:
        """Infinite."""
        return math.inf


@dataclass(frozen=True, eq=False)
class HalfSpace:
    """A wall in 3D: the solid is z <= 0 in the body's axes, the outward normal its +z."""

    kind: ClassVar[int] = HALF_SPACE
    dim: ClassVar[int] = 3

    @property
    def bounding_radius(self) -> float:
        """Infinite."""
        return math.inf
