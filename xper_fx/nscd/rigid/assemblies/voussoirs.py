# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arches of voussoirs with plane faces and radial joints."""

from __future__ import annotations

import math

import numpy as np

from xper_fx.nscd.rigid.assemblies.prisms import prism
from xper_fx.nscd.rigid.body import RigidBody
from xper_fx.nscd.rigid.polygon import Polygon
from xper_fx.nscd.rigid.polyhedron import Polyhedron
from xper_fx.support.checks import require_count, require_number, require_positive

# Size of a springing: its length over the thickness of the arch, its height over the radius.
_LENGTH, _HEIGHT = 2.0, 0.1


def arch(
    voussoirs: int,
    radius: float,
    thickness: float,
    *,
    density: float,
    angle: float = math.pi,
    depth: float | None = None,
    group: str = "voussoirs",
    springings: str | None = "springings",
) -> list[RigidBody]:
    """Equal voussoirs that touch along radial joints, and what they stand on.

    The centre of the circle is the origin, the crown is above it (along y in 2D, z in 3D).

    Args:
        voussoirs: how many.
        radius: of the middle of the joints (m).
        thickness: length of the joints (m), below twice the radius.
        density: of the voussoirs, kg/m^3.
        angle: of embrace (rad), in (0, 2 pi): pi for a semicircle, less for a segment.
        depth: along y (m), for polyhedra in 3D; None for polygons in 2D.
        group: name of the voussoirs' group.
        springings: name of the group of the two fixed bodies on which the arch stands; None leaves
            them out.

    Returns:
        The voussoirs from right to left, then the springings, the right one first. Vertices of a
        voussoir in 2D: inner and outer end of its right joint, outer and inner end of its left one.

    Raises:
        ValueError: a number out of range, a voussoir that spans half a circle or more.
        TypeError: something that is no number.
    """
    require_count("voussoirs", voussoirs, 1)
    radius, density = require_positive("radius", radius), require_positive("density", density)
    if not 0.0 < require_number("thickness", thickness) < 2.0 * radius:
        raise ValueError(f"thickness should lie between 0 and 2 radius, got {thickness}.")
    if not 0.0 < require_number("angle", angle) < 2.0 * math.pi:
        raise ValueError(f"angle should lie between 0 and 2 pi (rad), got {angle}.")
    if angle >= voussoirs * math.pi:
        raise ValueError(f"{voussoirs} voussoirs cannot span {angle:g} rad: take more of them.")
    if depth is not None:
        depth = require_positive("depth", depth)

    first = 0.5 * (math.pi - angle)
    joint = first + angle * np.arange(voussoirs + 1) / voussoirs
    direction = np.column_stack([np.cos(joint), np.sin(joint)])
    ends = np.array([radius - 0.5 * thickness, radius + 0.5 * thickness])
    ends = ends[:, None] * direction[:, None]
    corners = [np.array([a[0], a[1], b[1], b[0]]) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    bodies = [RigidBody(_shape(x, depth), None, group, density=density) for x in corners]
    if springings is None:
        return bodies
    middle, outwards = radius * direction[[0, -1]], [[0.0, -_HEIGHT * radius]]
    half = 0.5 * _LENGTH * thickness
    held = dict.fromkeys(range(3 if depth is None else 6), 0.0)
    for place, turn in zip(middle, (first, -first), strict=True):
        c, s = math.cos(turn), math.sin(turn)
        top = np.array([[half, 0.0], [-half, 0.0]])
        x = place + np.concatenate([top, top[::-1] + outwards]) @ np.array([[c, s], [-s, c]])
        bodies.append(RigidBody(_shape(x, depth), None, springings, prescribed=held))
    return bodies


def _shape(corners: np.ndarray, depth: float | None) -> Polygon | Polyhedron:
    """The polygon, or that extruded along y."""
    if depth is None:
        return Polygon(corners)
    x, z = corners.T
    # counter-clockwise seen against y
    front = np.column_stack([x, np.zeros(len(x)), z])
    return prism(front, np.array([0.0, depth, 0.0]))
