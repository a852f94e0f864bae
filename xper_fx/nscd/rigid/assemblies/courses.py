# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blocks laid in courses, and drums one on the other.

In 2D x runs along the wall and y upwards; in 3D x runs along the wall, y through it and z upwards.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.rigid.assemblies.prisms import prism
from xper_fx.nscd.rigid.body import RigidBody
from xper_fx.nscd.rigid.polygon import Polygon
from xper_fx.nscd.rigid.polyhedron import Polyhedron
from xper_fx.support.checks import require_count, require_positive, require_vector

BONDS = ("running", "stack")


def masonry_wall(
    width: int,
    courses: int,
    *,
    block: Sequence[float],
    density: float,
    bond: str = "running",
    thickness: float | None = None,
    group: str = "blocks",
) -> list[RigidBody]:
    """A wall of equal blocks that touch, its lower left (front) corner at the origin.

    Args:
        width: length of the wall in blocks.
        courses: how many, one on the other.
        block: length and height of a block, shape (2,), m.
        density: kg/m^3.
        bond: "running": each course is shifted by half a block against the one below, and every
            second course ends in half blocks; "stack": joints stand one above the other.
        thickness: of the wall (m), for boxes in 3D; None for rectangles in 2D.
        group: name of the blocks' group.

    Returns:
        The blocks, course by course from below, from left to right; blocks alike share a shape.

    Raises:
        ValueError: a number out of range, another bond.
        TypeError: something that is no number.
    """
    require_count("width", width, 1)
    require_count("courses", courses, 1)
    length, height = require_vector("block", block, (2,))
    for name, side in (("length", length), ("height", height)):
        require_positive(f"The {name} of a block (m)", side)
    density = require_positive("density", density)
    if bond not in BONDS:
        raise ValueError(f"bond should be one of {', '.join(BONDS)}, got {bond!r}.")
    if thickness is not None:
        thickness = require_positive("thickness", thickness)

    def shape(side: float) -> Polygon | Polyhedron:
        if thickness is None:
            return Polygon.box((side, height))
        return Polyhedron.box((side, thickness, height))

    whole, half = shape(length), shape(0.5 * length)
    # middles of the blocks along a course, in blocks
    straight = [(whole, i + 0.5) for i in range(width)]
    ends = (half, 0.25), (half, width - 0.25)
    shifted = [ends[0], *((whole, float(i)) for i in range(1, width)), ends[1]]
    across = [] if thickness is None else [0.5 * thickness]
    return [
        RigidBody(kind, [middle * length, *across, (course + 0.5) * height], group, density=density)
        for course in range(courses)
        for kind, middle in (shifted if bond == "running" and course % 2 else straight)
    ]


def column(
    drums: int,
    diameter: float,
    height: float,
    *,
    density: float,
    sides: int | None = None,
    group: str = "drums",
) -> list[RigidBody]:
    """Equal drums that stand one on the other, the middle of the lowest face at the origin.

    A column of rectangular blocks in 3D is a `masonry_wall` one block wide.

    Args:
        drums: how many.
        diameter: of a drum (m): of the circle through its corners in 3D, its length in 2D.
        height: of a drum (m).
        density: kg/m^3.
        sides: of the regular polygon that a drum in 3D has as section; None for rectangles in 2D.
            Two drums touch at four points at most, within the circle: with more than four sides
            they overturn under less than they should.
        group: name of the drums' group.

    Returns:
        The drums from below, which share a shape.

    Raises:
        ValueError: a number out of range.
        TypeError: something that is no number.
    """
    require_count("drums", drums, 1)
    diameter = require_positive("diameter", diameter)
    height, density = require_positive("height", height), require_positive("density", density)
    if sides is None:
        shape: Polygon | Polyhedron = Polygon.box((diameter, height))
    else:
        section = Polygon.regular(sides, 0.5 * diameter).vertices
        top = np.column_stack([section, np.full(len(section), 0.5 * height)])
        shape = prism(top, np.array([0.0, 0.0, -height]))
    foot = [0.0] * (shape.dim - 1)
    return [
        RigidBody(shape, [*foot, (drum + 0.5) * height], group, density=density)
        for drum in range(drums)
    ]
