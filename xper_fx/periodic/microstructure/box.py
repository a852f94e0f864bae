# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points in a box that repeats along its edges."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from xper_fx.support.checks import require_numbers

__all__ = ["checked_periods", "near_pairs", "wrapped"]


def checked_periods(periods: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the edges of a box as an array, shape (dim,), m.

    Raises:
        TypeError: no numbers.
        ValueError: they are not two or three, not finite or not positive.
    """
    box = require_numbers("periods", periods)
    if box.shape not in ((2,), (3,)):
        raise ValueError(f"periods has shape {box.shape}; expected two or three lengths.")
    if not np.all(np.isfinite(box)) or not np.all(box > 0):
        raise ValueError(f"periods is {box.tolist()}; expected positive lengths in m.")
    return box


def wrapped(
    points: npt.NDArray[np.float64], periods: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return points, shape (n, dim), moved by whole periods to where 0 <= x < period."""
    inside = np.mod(points, periods)
    inside[inside >= periods] = 0.0  # of tiny negative numbers the remainder rounds up
    return inside


def near_pairs(
    points: npt.NDArray[np.float64], periods: npt.NDArray[np.float64], distance: float
) -> npt.NDArray[np.int64]:
    """Return the pairs of different points nearer than a distance, over all periodic images.

    Args:
        points: shape (n, dim), in the box from 0 to `periods`.
        periods: shape (dim,).
        distance: less than half of each period.

    Returns:
        Shape (num_pairs, 2).
    """
    tree = cKDTree(points, boxsize=periods)
    return tree.query_pairs(distance, output_type="ndarray").astype(np.int64)
