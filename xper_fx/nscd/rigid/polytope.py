# SPDX-License-Identifier: LGPL-3.0-or-later
"""What polygons and polyhedra have in common: mass properties and size from those for density 1."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from xper_fx.nscd.rigid.shapes import MassProperties, check_positive


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
