# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies in 2D and 3D: their shapes, what they are and how they move."""

from typing import TYPE_CHECKING

from xper_fx.support.lazy import importer

if TYPE_CHECKING:
    from xper_fx.nscd.rigid.bodies import RigidBodies as RigidBodies
    from xper_fx.nscd.rigid.body import RigidBody as RigidBody
    from xper_fx.nscd.rigid.body import wall as wall
    from xper_fx.nscd.rigid.cluster import Cluster as Cluster
    from xper_fx.nscd.rigid.cluster import Part as Part
    from xper_fx.nscd.rigid.motion import RigidMotion as RigidMotion
    from xper_fx.nscd.rigid.outline import body_outlines as body_outlines
    from xper_fx.nscd.rigid.polygon import Polygon as Polygon
    from xper_fx.nscd.rigid.polyhedron import Polyhedron as Polyhedron
    from xper_fx.nscd.rigid.shapes import Disc as Disc
    from xper_fx.nscd.rigid.shapes import HalfPlane as HalfPlane
    from xper_fx.nscd.rigid.shapes import HalfSpace as HalfSpace
    from xper_fx.nscd.rigid.shapes import MassProperties as MassProperties
    from xper_fx.nscd.rigid.shapes import Sphere as Sphere

_MODULE_OF = {
    "Cluster": "cluster",
    "Disc": "shapes",
    "HalfPlane": "shapes",
    "HalfSpace": "shapes",
    "MassProperties": "shapes",
    "Part": "cluster",
    "Polygon": "polygon",
    "Polyhedron": "polyhedron",
    "RigidBodies": "bodies",
    "RigidBody": "body",
    "RigidMotion": "motion",
    "Sphere": "shapes",
    "body_outlines": "outline",
    "wall": "body",
}

__all__ = list(_MODULE_OF)
__getattr__ = importer(__name__, _MODULE_OF)
