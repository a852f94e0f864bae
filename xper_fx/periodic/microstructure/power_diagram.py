# SPDX-License-Identifier: LGPL-3.0-or-later
"""The vertices of a periodic power diagram, from the regular triangulation of its seeds.

The power of a point x with respect to a seed p of weight w is |x - p|^2 - w; the cell of a seed
is where its power is the smallest (F. Aurenhammer, Power diagrams, SIAM J. Comput. 16 (1987)).
Equal weights give the Voronoi diagram. Lift each seed to (p, |p|^2 - w): then the power of x is
|x|^2 plus the height of the lifted seed above the hyperplane z = 2 x . p, so that dim + 1 seeds
have the same power at x, and no seed a smaller one, where a facet of the lower convex hull of the
lifted seeds has the slope 2 x. With the facet's normal (n, n_z), n_z < 0, this *power centre* is

    x = -n / (2 n_z).

Where more than dim + 1 seeds meet (lattices), several facets of the triangulated hull lie in one
hyperplane: their centres coincide, and are one vertex here.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from xper_fx.periodic.microstructure.box import near_pairs, wrapped

__all__ = ["DiagramVertices", "diagram_vertices"]

# Power centres nearer than this, relative to the mean distance of the seeds, are one vertex.
_COINCIDENT = 1e-8


@dataclass(frozen=True, eq=False)
class DiagramVertices:
    """Vertices of a periodic power diagram, one of each class modulo the lattice."""

    #: position of each vertex, in the box (up to rounding), shape (num_vertices, dim)
    x: npt.NDArray[np.float64]
    #: for each vertex the seeds whose cells meet there, num_vertices arrays of shape (k,)
    seeds: list[npt.NDArray[np.int64]]
    #: by how many periods each of them is moved to be there, num_vertices integer arrays of shape
    #: (k, dim)
    shifts: list[npt.NDArray[np.int64]]


def diagram_vertices(
    seeds: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    periods: npt.NDArray[np.float64],
    margin: float,
) -> DiagramVertices | None:
    """Return the vertices of the periodic power diagram of seeds in a box.

    Of the seeds' periodic images, those up to `margin` outside the box are looked at. A cell lies
    within the Voronoi cell of its seed among the images of this seed alone (these have the same
    weight), so within half the box's diagonal of its seed, and two seeds whose cells touch are no
    further apart than the diagonal: with this margin the diagram is right. Most often less does.

    Args:
        seeds: shape (n, dim), in the box from 0 to `periods`, of a mean distance of about 1.
        weights: shape (n,), the unit of length squared.
        periods: shape (dim,).
        margin: as above.

    Returns:
        The vertices; None if there are clearly too few images within the margin. That there are
        enough, the caller sees from the cells: too few make them too large.

    Raises:
        ValueError: a seed has no cell.
    """
    diagonal = np.linalg.norm(periods)
    num_seeds, dim = seeds.shape
    weights = weights - weights.mean()  # only differences count
    owner, shift = _images(seeds, periods, margin)
    x = seeds[owner] + shift * periods
    middle = periods / 2
    lifted = np.column_stack(
        [x - middle, np.einsum("ij,ij->i", x - middle, x - middle) - weights[owner]]
    )
    try:
        hull = ConvexHull(lifted)
    except QhullError:  # too few or all in one hyperplane
        return None
    lower = (hull.equations[:, dim] < 0) & np.any(hull.simplices < num_seeds, axis=1)
    simplices, normal = hull.simplices[lower], hull.equations[lower, : dim + 1]
    without = np.setdiff1d(np.arange(num_seeds), simplices)
    if without.size:  # more images would only make the cells smaller
        raise ValueError(
            f"Seed {without[0]} has no cell ({without.size} such seeds in all): the weights of its "
            "neighbours are too large against its own. Let the weights differ by less than the "
            "squared distances of the seeds, or leave this seed out."
        )
    centre = middle - normal[:, :dim] / (2 * normal[:, dim:])
    if np.abs(centre - middle).max() > 2 * diagonal:
        return None
    return _classes(centre, owner[simplices], shift[simplices], periods)


def _images(
    seeds: npt.NDArray[np.float64], periods: npt.NDArray[np.float64], margin: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return owner and shift of the seeds, in their order, then of their images near the box."""
    num_seeds, dim = seeds.shape
    ranges = [range(-reach, reach + 1) for reach in np.ceil(margin / periods).astype(int)]
    owners, shifts = [np.arange(num_seeds)], [np.zeros((num_seeds, dim), dtype=np.int64)]
    for shift in product(*ranges):
        if any(shift):
            moved = seeds + np.multiply(shift, periods)
            near = np.flatnonzero(np.all((moved >= -margin) & (moved <= periods + margin), axis=1))
            owners.append(near)
            shifts.append(np.tile(np.array(shift, dtype=np.int64), (len(near), 1)))
    return np.concatenate(owners), np.concatenate(shifts)


def _classes(
    centre: npt.NDArray[np.float64],
    simplex_seeds: npt.NDArray[np.int64],
    simplex_shifts: npt.NDArray[np.int64],
    periods: npt.NDArray[np.float64],
) -> DiagramVertices:
    """Gather power centres that coincide modulo the lattice, with all the seeds around them."""
    dim = len(periods)
    inside = wrapped(centre, periods)
    pairs = near_pairs(inside, periods, min(_COINCIDENT, periods.min() / 4))
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(centre), len(centre)))
    vertex = connected_components(graph, directed=False)[1]
    first = np.unique(vertex, return_index=True)[1]
    x = inside[first]
    moved = np.rint((centre - x[vertex]) / periods).astype(np.int64)
    # rows: vertex, seed, shift of the seed
    around = np.column_stack(
        [
            np.repeat(vertex, dim + 1),
            simplex_seeds.ravel(),
            (simplex_shifts - moved[:, np.newaxis]).reshape(-1, dim),
        ]
    )
    around = np.unique(around, axis=0)
    parts = np.split(around[:, 1:], np.flatnonzero(np.diff(around[:, 0])) + 1)
    return DiagramVertices(x, [part[:, 0] for part in parts], [part[:, 1:] for part in parts])
