# SPDX-License-Identifier: LGPL-3.0-or-later
"""Boxes of half planes (2D) or half spaces (3D)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.rigid.body import RigidBody, wall
from xper_fx.support.checks import require_numbers

# Names of the sides at the low and the high end of each axis, by dimension.
_SIDES = {
    2: (("bottom", "top"), ("left", "right")),
    3: (("bottom", "top"), ("left", "right"), ("front", "back")),
}


def box(
    lengths: Sequence[float], group: str = "box", *, opened: Sequence[str] = ("top",)
) -> list[RigidBody]:
    """Fixed walls around a box with a corner at the origin.

    Args:
        lengths: (width, height) in 2D, (width, depth, height) in 3D, m.
        group: name of the walls' group.
        opened: sides that are left out, of "bottom", "top", "left", "right", and in 3D "front" and
            "back", at the low and the high end of y.

    Returns:
        The walls in this order, each through the middle of its side.

    Raises:
        ValueError: other than two or three finite lengths above zero, an unknown side.
        TypeError: lengths that are no numbers.
    """
    size = box_lengths(lengths)
    dim = len(size)
    known = [name for pair in _SIDES[dim] for name in pair]
    if isinstance(opened, str) or not set(opened) <= set(known):
        raise ValueError(f"opened should be a list of {', '.join(known)}, got {opened!r}.")
    if not np.isfinite(size).all():
        raise ValueError(f"lengths of walls should be finite, got {lengths!r}.")
    walls = []
    for axis, names in zip((dim - 1, *range(dim - 1)), _SIDES[dim], strict=True):
        for name, at, sign in zip(names, (0.0, size[axis]), (1.0, -1.0), strict=True):
            if name not in opened:
                point, normal = 0.5 * size, np.zeros(dim)
                point[axis], normal[axis] = at, sign
                walls.append(wall(point, normal, group))
    return walls


def box_lengths(lengths: Sequence[float]) -> np.ndarray:
    """The lengths of a box, checked, shape (2,) or (3,), m; the height may be infinite.

    Raises:
        ValueError: other than two or three lengths above zero, an infinite width or depth.
        TypeError: no numbers.
    """
    size = require_numbers("lengths", lengths)
    good = size.shape in ((2,), (3,)) and (size > 0.0).all() and np.isfinite(size[:-1]).all()
    if not good:
        raise ValueError(
            "lengths should be (width, height) in 2D or (width, depth, height) in 3D, finite and "
            f"above zero (m), got {lengths!r}."
        )
    return size
