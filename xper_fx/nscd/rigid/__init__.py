# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies in 2D and 3D: their shapes, what they are and how they move."""

from xper_fx.lazy import importer

_MODULE_OF = {
    "Disc": "shapes",
    "HalfPlane": "shapes",
    "HalfSpace": "shapes",
    "Polygon": "polygon",
    "Polyhedron": "polyhedron",
    "RigidBodies": "bodies",
    "RigidBody": "body",
    "RigidMotion": "motion",
    "Sphere": "shapes",
    "wall": "body",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
