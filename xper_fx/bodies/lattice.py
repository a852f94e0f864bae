# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which facets of a periodic cell's boundary are one facet of the periodic medium.

The cell may have any shape - a box, or grains left whole - as long as its translates by the
lattice fill space: every facet of its boundary then has exactly one translate on the boundary.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from xper_fx.support.checks import require_numbers
from xper_fx.support.ranks import ALONE, Ranks

# Distance, beside the smallest facet of the boundary, within which translates count as one.
_MATCH = 1e-5
# Volume that the cell may miss beside the lattice's.
_VOLUME = 1e-6


class FacetPairs(NamedTuple):
    """Facets of the boundary that a vector of the lattice brings together."""

    facets: npt.NDArray[np.intp]  #: shape (n, 2), positions in the arrays given
    #: shape (n, dim), vector from the first of a pair to the second, m
    translation: npt.NDArray[np.float64]


def checked_lattice(lattice: npt.ArrayLike, dim: int) -> npt.NDArray[np.float64]:
    """Return the period vectors as rows, or raise.

    Args:
        lattice: shape (dim, dim), rows are period vectors, or (dim,), edges of a box, m.

    Raises:
        ValueError: another shape, not finite, or vectors that span no volume.
    """
    rows = require_numbers("lattice", lattice)
    if rows.shape == (dim,):
        rows = np.diag(rows)
    if rows.shape != (dim, dim) or not np.all(np.isfinite(rows)):
        raise ValueError(
            f"lattice should hold {dim} edges of a box or {dim} period vectors as rows, finite, "
            f"in m; got {lattice!r}."
        )
    if abs(np.linalg.det(rows)) <= 1e-9 * np.prod(np.linalg.norm(rows, axis=1)):
        raise ValueError(f"The period vectors {rows.tolist()} span no volume.")
    return rows


def match_tolerance(vertices: npt.NDArray[np.float64], ranks: Ranks = ALONE) -> float:
    """Distance within which facets of a cell's boundary are translates (m).

    Args:
        vertices: shape (num_facets, k, dim), vertices of each facet that a rank has, m.
        ranks: those that have the boundary.
    """
    edges = np.linalg.norm(vertices - np.roll(vertices, 1, axis=1), axis=2)
    return -_MATCH * float(ranks.max(-edges.min(initial=np.inf)))


def match_facets(
    vertices: npt.NDArray[np.float64], lattice: npt.NDArray[np.float64], tolerance: float
) -> FacetPairs:
    """Pair the facets of a cell's boundary that are translates of each other.

    Args:
        vertices: shape (num_facets, k, dim), vertices of each facet of the boundary, m.
        lattice: shape (dim, dim), rows are period vectors, m.
        tolerance: see `match_tolerance`, m.

    Raises:
        ValueError: a vertex or a facet has no translate (its coordinates are reported), or
            several.
    """
    count, _, dim = vertices.shape
    if count == 0:
        return FacetPairs(np.zeros((0, 2), np.intp), np.zeros((0, dim)))
    _require_translates(np.unique(vertices.reshape(-1, dim), axis=0), lattice, tolerance)
    midpoints = vertices.mean(axis=1)
    pairs = translates(midpoints, lattice, tolerance)
    partners = np.bincount(pairs.ravel(), minlength=count)
    bad = np.flatnonzero(partners != 1)
    if bad.size:
        raise ValueError(
            f"The facet of the cell's boundary at {midpoints[bad[0]].tolist()} has "
            f"{partners[bad[0]]} translates by the lattice {lattice.tolist()} on the boundary; "
            f"expected one ({bad.size} such facets). Mesh opposite faces alike (gmsh: "
            "setPeriodic), and name the surfaces of voids in `voids`."
        )
    return FacetPairs(pairs, midpoints[pairs[:, 1]] - midpoints[pairs[:, 0]])


def translates(
    points: npt.NDArray[np.float64], lattice: npt.NDArray[np.float64], tolerance: float
) -> npt.NDArray[np.intp]:
    """Pairs of points that differ by a vector of the lattice other than zero.

    Args:
        points: shape (num_points, dim), m.
        lattice: shape (dim, dim), rows are period vectors, m.
        tolerance: distance within which points are one, m.

    Returns:
        Shape (n, 2), sorted.
    """
    places, radius = wrapped(points, lattice, tolerance)
    pairs = cKDTree(places, boxsize=1.0).query_pairs(radius, output_type="ndarray")
    apart = points[pairs[:, 1]] - points[pairs[:, 0]]
    whole = np.round(apart @ np.linalg.inv(lattice))
    near = np.linalg.norm(apart - whole @ lattice, axis=1) <= tolerance
    pairs = pairs[near & np.any(whole != 0.0, axis=1)]
    return pairs[np.lexsort(pairs.T[::-1])]


def wrapped(
    points: npt.NDArray[np.float64], lattice: npt.NDArray[np.float64], tolerance: float
) -> tuple[npt.NDArray[np.float64], float]:
    """Where points lie in the cell at the origin, in coordinates along the lattice.

    Args:
        points, lattice, tolerance: as of `translates`.

    Returns:
        Shape (num_points, dim), in [0, 1), and what the tolerance is in these coordinates, by which
        points below 1 come to 0.
    """
    inverse = np.linalg.inv(lattice)
    # what lies within the tolerance in space lies within this in lattice coordinates
    radius = tolerance * float(np.linalg.norm(inverse, 2))
    places = (points @ inverse) % 1.0
    places[places >= 1.0 - radius] = 0.0
    return places, radius


def _require_translates(points: np.ndarray, lattice: np.ndarray, tolerance: float) -> None:
    """Raise a ValueError that names the vertices of the boundary without a translate."""
    alone = np.ones(len(points), bool)
    alone[translates(points, lattice, tolerance).ravel()] = False
    if np.any(alone):
        shown = "; ".join(str(tuple(p)) for p in points[alone][:5].tolist())
        raise ValueError(
            f"{np.count_nonzero(alone)} of {len(points)} nodes on the cell's boundary have no "
            f"translate by the lattice {lattice.tolist()} on the boundary, among them {shown}. "
            "Mesh opposite faces alike (gmsh: setPeriodic), give the right periods, and name the "
            "surfaces of voids in `voids`."
        )


def check_volume(volume: float, lattice: npt.NDArray[np.float64], voids: bool) -> None:
    """Raise a ValueError unless the cells fill the lattice's volume, or less if there are voids.

    Args:
        volume: of all cells, m^3 (2D: m^2).
        lattice: shape (dim, dim), m.
        voids: whether the cell has voids.
    """
    whole = abs(np.linalg.det(lattice))
    excess = volume / whole - 1.0
    if excess > _VOLUME or (excess < -_VOLUME and not voids):
        raise ValueError(
            f"The cells fill {volume:g} of the {whole:g} m^{len(lattice)} of the lattice "
            f"{lattice.tolist()}; give the periods of this mesh, and name the surfaces of voids in "
            "`voids`."
        )
