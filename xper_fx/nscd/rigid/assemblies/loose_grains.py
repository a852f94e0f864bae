# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grains that lie apart, for a run to let them settle.

Grains stand side by side in rows, rows behind each other in layers (3D), and layers above each
other. A row is as thick as its largest grain, so that no two grains have to be compared. What is
left of the length of a row parts its grains at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.rigid.assemblies.enclosure import box_lengths
from xper_fx.nscd.rigid.body import RigidBody
from xper_fx.nscd.rigid.shapes import Disc, Sphere
from xper_fx.support.checks import require_count, require_numbers, require_positive

if TYPE_CHECKING:
    from scipy.stats._distn_infrastructure import rv_frozen

# Share of a row's length that grains take, and height of a row over that of its largest grain.
_TAKEN, _APART = 0.85, 1.05
# Grains that a box of a given height is first tried with.
_FIRST = 64


def packing(
    radii: npt.ArrayLike | rv_frozen,
    lengths: Sequence[float],
    *,
    density: float,
    seed: int,
    count: int | None = None,
    group: str = "grains",
) -> list[RigidBody]:
    """Discs (2D) or spheres (3D) of random places in a box, which do not overlap.

    They fill about half of the plane, or a fifth of the space; less where radii differ much.

    Args:
        radii: m, an array, from the lowest grain to the highest; or a distribution of SciPy with
            its parameters, from which they are drawn: `scipy.stats.uniform(0.8, 0.4)` from 0.8 to
            1.2, `scipy.stats.lognorm(0.3, scale=1.0)` with the median 1.
        lengths: of the box, (width, height) in 2D, (width, depth, height) in 3D, m. A corner of the
            box is the origin. The height may be infinite where the number of grains is given.
        density: kg/m^3.
        seed: of radii and places; the same seed gives the same grains.
        count: number of grains of a distribution; None fills the box.
        group: name of the grains' group.

    Returns:
        The grains from below.

    Raises:
        ValueError: a radius that is not above zero, grains that the box does not hold.
        TypeError: something of another kind than is expected.
    """
    size, random = box_lengths(lengths), np.random.default_rng(require_count("seed", seed, 0))
    density = require_positive("density", density)
    if not hasattr(radii, "rvs"):
        if count is not None:
            raise ValueError("An array of radii tells the number of grains: leave count out.")
        radius = _checked(require_numbers("radii", radii), size)
        centre = _places(radius, size, random)
    elif count is not None:
        require_count("count", count, 1)
        radius = _checked(radii.rvs(size=count, random_state=random), size)
        centre = _places(radius, size, random)
    else:
        if not np.isfinite(size[-1]):
            raise ValueError("Give a count, or a height of the box that is finite.")
        radius, centre = _filling(radii, size, random)
    needed = float((centre[:, -1] + radius).max(initial=0.0))
    if needed > size[-1]:
        raise ValueError(
            f"{len(radius)} grains need a height of {needed:.4g} m, the box has {size[-1]:g} m: "
            "take fewer grains or a larger box."
        )
    shape = Disc if len(size) == 2 else Sphere
    return [
        RigidBody(shape(r), x, group, density=density) for r, x in zip(radius, centre, strict=True)
    ]


def _checked(radius: np.ndarray, size: np.ndarray) -> np.ndarray:
    if radius.ndim != 1 or not len(radius) or not np.all(np.isfinite(radius) & (radius > 0.0)):
        raise ValueError(f"radii should be finite and above zero (m), shape (n,), got {radius}.")
    if 2.0 * radius.max() > _TAKEN * size[:-1].min():
        raise ValueError(
            f"The largest grain, of radius {radius.max():g} m, should take at most {_TAKEN:g} of "
            f"the box, which is {size[:-1].min():g} m wide."
        )
    return radius


def _filling(radii: rv_frozen, size: np.ndarray, random: np.random.Generator):
    """Radii and places of as many grains as the box holds in whole rows."""
    radius = np.empty(0)
    while True:
        more = radii.rvs(size=max(len(radius), _FIRST), random_state=random)
        radius = _checked(np.concatenate([radius, more]), size)
        centre = _places(radius, size, np.random.default_rng(random.integers(2**31)))
        high = centre[:, -1] + radius > size[-1]
        if high.any():
            first = centre[np.argmax(high), -1]
            inside = centre[:, -1] < first
            return radius[inside], centre[inside]


def _places(radius: np.ndarray, size: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Centres of grains in rows, and in 3D rows in layers; shape (n, dim), m."""
    centre = np.empty((len(radius), len(size)))
    low, row_ends = 0.0, _ends(2.0 * radius, _TAKEN * size[0])
    if len(size) == 2:
        layers = [[row] for row in row_ends]
    else:
        thickness = np.array([_APART * 2.0 * radius[a:b].max() for a, b in row_ends])
        layers = [row_ends[a:b] for a, b in _ends(thickness, size[1])]
    for rows in layers:
        height = 2.0 * radius[rows[0][0] : rows[-1][1]].max()
        back = 0.0
        for first, last in rows:
            own = radius[first:last]
            shares = random.dirichlet(np.ones(len(own) + 1))
            gaps = (size[0] - 2.0 * own.sum()) * shares[:-1]
            centre[first:last, 0] = np.cumsum(gaps + 2.0 * own) - own
            if len(size) == 3:
                centre[first:last, 1] = back + own.max()
                back += _APART * 2.0 * own.max()
        centre[rows[0][0] : rows[-1][1], -1] = low + 0.5 * height
        low += _APART * height
    return centre


def _ends(lengths: np.ndarray, room: float) -> list[tuple[int, int]]:
    """First and one past the last of what goes into each row, in order, at least one."""
    rows, first, total = [], 0, 0.0
    for number, length in enumerate(lengths):
        if total + length > room and number > first:
            rows.append((first, number))
            first, total = number, 0.0
        total += length
    return [*rows, (first, len(lengths))]
