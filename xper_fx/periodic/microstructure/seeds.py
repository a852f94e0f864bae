# SPDX-License-Identifier: LGPL-3.0-or-later
"""Random seeds of periodic tessellations, more or less regular."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from xper_fx.periodic.microstructure.box import checked_periods
from xper_fx.periodic.microstructure.tessellation import tessellate

__all__ = ["random_seeds"]

# Seeds that can be cut into grains in the memory of a machine, and Lloyd's steps, long after which
# nothing moves any more.
_MOST_SEEDS, _MOST_STEPS = 10_000_000, 10_000


def random_seeds(
    count: int, periods: npt.ArrayLike, seed: int, relaxation: int = 10
) -> npt.NDArray[np.float64]:
    """Draw seeds evenly in a periodic box, and make them more regular by Lloyd's algorithm.

    Each step of S. P. Lloyd's algorithm (IEEE Trans. Inf. Theory 28 (1982) 129-137) moves every
    seed to the centroid of its Voronoi cell, over the periodic images. Without steps, the cells
    are those of a Poisson process with a given number of points: some faces are tiny, and the
    mesh follows them. Many steps lead to nearly equal cells (2D: hexagons).

    Args:
        count: number of seeds, at least 1.
        periods: edges of the box, shape (dim,), m, dim 2 or 3.
        seed: of the random generator; the same one gives the same seeds.
        relaxation: number of Lloyd's steps.

    Returns:
        Seeds in the box, shape (count, dim), m.

    Raises:
        TypeError: `count`, `seed` or `relaxation` is no integer.
        ValueError: one of them is too small or too large; a period is not positive.
        RuntimeError: as `tessellate`; relaxation may lead very few seeds in 3D to a cubic lattice,
            at which rounding decides the topology.
    """
    for name, value, least, most in (
        ("count", count, 1, _MOST_SEEDS),
        ("seed", seed, 0, math.inf),
        ("relaxation", relaxation, 0, _MOST_STEPS),
    ):
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise TypeError(f"{name} is {value!r}; expected an integer.")
        if value < least:
            raise ValueError(f"{name} is {value}; expected at least {least}.")
        if value > most:
            raise ValueError(f"{name} is {value}; expected at most {most}.")
    box = checked_periods(periods)
    seeds = np.random.default_rng(seed).random((count, len(box))) * box
    for _ in range(relaxation):
        seeds = tessellate(seeds, box).centroids
    return tessellate(seeds, box).seeds
