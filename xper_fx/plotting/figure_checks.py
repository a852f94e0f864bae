# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether what a figure is given can be drawn: shapes, units, numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from xper_fx.support.checks import require_numbers, require_positive


def checked_mesh(
    points: npt.ArrayLike, triangles: npt.ArrayLike, material: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.integer], npt.NDArray[np.integer]]:
    """Return the mesh as arrays, or say which of them does not fit.

    Args:
        points: Shape (num_points, 2 or 3), m.
        triangles: Connectivity, shape (num_cells, 3).
        material: Tag of each triangle, shape (num_cells,).

    Raises:
        ValueError: If a shape does not fit, a number is not finite, or a point is not there.
        TypeError: If something is no array of numbers.
    """
    points = require_numbers("points", points)
    triangles, material = _whole("triangles", triangles), _whole("material", material)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"Points should have shape (num_points, 2 or 3), got {points.shape}.")
    if not np.isfinite(points).all():
        raise ValueError(f"points should be finite, got {points[~np.isfinite(points).all(1)][0]}.")
    if triangles.ndim != 2 or triangles.shape[1] != 3:
        raise ValueError(f"Triangles should have shape (num_cells, 3), got {triangles.shape}.")
    if triangles.size and not (0 <= triangles.min() and triangles.max() < len(points)):
        raise ValueError(
            f"triangles should name points from 0 to {len(points) - 1}, got "
            f"{triangles.min()} to {triangles.max()}."
        )
    if material.shape != triangles.shape[:1]:
        raise ValueError(
            f"Material should have shape ({len(triangles)},), one tag a triangle, "
            f"got {material.shape}."
        )
    return points[:, :2], triangles, material


def _whole(name: str, values: npt.ArrayLike) -> npt.NDArray[np.integer]:
    numbers = require_numbers(name, values)
    array = np.asarray(values)
    if array.dtype.kind not in "iu" and array.size:
        raise ValueError(f"{name} should be integers, got {array.dtype}.")
    return array.astype(np.int64) if not numbers.size else array


def checked_segments(name: str, segments: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return segments as an array of shape (m, 2, 2).

    Raises:
        ValueError: If their shape is another.
        TypeError: If they are no numbers.
    """
    array = require_numbers(name, segments)
    if array.size and array.shape[1:] != (2, 2):
        raise ValueError(f"{name} should have shape (m, 2, 2), got {array.shape}.")
    return array.reshape(-1, 2, 2)


def checked_unit(name: str, unit: tuple[str, float]) -> tuple[str, float]:
    """Return the name of a unit and its value.

    Raises:
        ValueError: If its value is not above zero.
        TypeError: If it is no pair of a text and a number.
    """
    if not isinstance(unit, Sequence) or len(unit) != 2 or not isinstance(unit[0], str):
        raise TypeError(
            f'{name} should be a text and a number, such as ("mm", 1e-3), got {unit!r}.'
        )
    return unit[0], require_positive(name, unit[1])


def require_mapping(name: str, given: Any, what: str) -> None:
    """Raise TypeError unless something is a mapping, of which `what` tells where it comes from."""
    if not isinstance(given, Mapping):
        raise TypeError(f"{name} should be a mapping, {what}; got {given!r}.")
