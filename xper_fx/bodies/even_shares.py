# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which rank gets which body of several cells, of a mesh that is spread over the ranks.

DOLFINx gives ranks like numbers of cells, and a body is best left where most of it is. Where the
ranks would have unlike work then, as bodies are unlike each other or few, the space is cut in two
parts of like work across its longest side, the parts are cut again, and so on (Berger and Bokhari
1987); bodies go by their middles.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from xper_fx.bodies.keepers import Keepers
from xper_fx.bodies.meshes import facets_of_cells
from xper_fx.support.compat import geometry_dofmap
from xper_fx.support.ranks import Ranks

# Share of a cell and of a facing facet in the work of a body.
CELL, FACET = 1, 2
# Most work of a rank, over the mean, up to which bodies stay if each rank has some; what other
# shares, which no fewer ranks have, must make of it.
_UNLIKE, _WORTH = 1.15, 0.95
# Halvings that find where a part is cut; by how much cuts lean, for bodies side by side to part.
_HALVINGS, _LEAN = 50, 1e-3


def rank_of_bodies(
    ranks: Ranks,
    mesh: Mesh,
    label: npt.NDArray[np.int64],
    lattice: npt.NDArray[np.float64] | None,
) -> npt.NDArray[np.int32]:
    """Rank of the body of each cell, shape (num_cells,); all ranks call it together.

    Args:
        ranks: those of the mesh.
        mesh: the mesh, as DOLFINx has spread it.
        label: shape (num_cells,), body of each cell that this rank owns.
        lattice: period vectors of a periodic cell as rows, m; None if the mesh is none. The middle
            of a body that goes on over the boundary is that of its angles on circles.
    """
    own, body, count = np.unique(label, return_inverse=True, return_counts=True)
    keepers = Keepers(ranks, own)
    # the smallest is that of the most cells, and of the lowest rank that has so many
    rank = keepers.min(ranks.rank - ranks.size * count) % ranks.size
    middles = mesh.geometry.x[geometry_dofmap(mesh)[: len(label)]].mean(axis=1)
    middles = middles[:, : mesh.topology.dim]
    if lattice is not None:
        turn = 2.0 * np.pi * middles @ np.linalg.inv(lattice)
        middles = np.concatenate([np.cos(turn), np.sin(turn)], axis=1)
    columns = [_work(mesh, body), np.ones(len(body)), *middles.T]
    sums = keepers.sum(np.array([np.bincount(body, column) for column in columns]).T)
    work, middle = sums[:, 0], sums[:, 2:] / sums[:, 1:2]
    if lattice is not None:
        cosine, sine = np.split(middle, 2, axis=1)
        middle = np.arctan2(sine, cosine) / (2.0 * np.pi) % 1.0 @ lattice
    load = _loads(ranks, rank, work)
    if load.max() > _UNLIKE * load.mean() or not load.all():
        other = bisected(ranks, middle, work)
        others = _loads(ranks, other, work)
        gained = np.count_nonzero(others) - np.count_nonzero(load)  # ranks that have bodies
        if gained > 0 or gained == 0 and others.max() < _WORTH * load.max():
            rank = other
    return keepers.answer(rank).astype(np.int32)[body]


def _work(mesh: Mesh, body: np.ndarray) -> np.ndarray:
    """Work of each own cell; facets between cells of two ranks are left out."""
    facets = facets_of_cells(mesh)[: len(body)]
    low = np.full(facets.max(initial=-1) + 1, len(body))
    high = np.full(len(low), -1)
    np.minimum.at(low, facets, body[:, None])
    np.maximum.at(high, facets, body[:, None])
    return CELL + FACET * np.count_nonzero(low[facets] != high[facets], axis=1)


def _loads(ranks: Ranks, rank: np.ndarray, work: np.ndarray) -> np.ndarray:
    return ranks.sum(np.bincount(rank, work, minlength=ranks.size))


def bisected(ranks: Ranks, x: np.ndarray, work: np.ndarray) -> npt.NDArray[np.int64]:
    """Rank of bodies by their places, shape (n,); all ranks call it together.

    Args:
        ranks: those that share the bodies.
        x: shape (n, dim), middles of those that this rank has (m), each on one rank.
        work: shape (n,).
    """
    first, last = np.array([0]), np.array([ranks.size])  # ranks of each part
    part = np.zeros(len(x), np.int64)
    while np.any(last - first > 1):
        count, several = len(first), last - first > 1
        box = np.full((2, count, x.shape[1]), -np.inf)
        np.maximum.at(box, (0, part), x)
        np.maximum.at(box, (1, part), -x)
        side = np.maximum(ranks.max(box).sum(axis=0), 0.0)
        size = side.max() or 1.0
        along = _LEAN * side / size**2
        along[np.arange(count), side.argmax(axis=1)] = 1.0 / size
        key = np.einsum("nd,nd->n", x, along[part])
        ends = np.full((2, count), -np.inf)
        np.maximum.at(ends, (0, part), key)
        np.maximum.at(ends, (1, part), -key)
        high, low = np.where(np.isfinite(ends := ranks.max(ends)), ends, 0.0)
        low = -low - (high + low)  # below all of a part
        middle = (first + last) // 2
        goal, number = _below(ranks, part, work, key, np.full(count, np.inf))
        goal = goal * (middle - first) / (last - first)
        least, most = middle - first, number - (last - middle)  # bodies, for each rank to get one
        for _ in range(_HALVINGS):
            cut = 0.5 * (low + high)
            done, many = _below(ranks, part, work, key, cut)
            enough = (done >= goal) & (many >= least) | (many >= most)
            low, high = np.where(enough, low, cut), np.where(enough, cut, high)
        (under, many), (over, _) = (_below(ranks, part, work, key, cut) for cut in (low, high))
        cut = np.where((goal - under < over - goal) & (many >= least), low, high)
        beyond = (key > cut[part]) & several[part]
        starts = np.cumsum(1 + several) - 1 - several  # of each part among the next ones
        part = starts[part] + beyond
        first = np.insert(first, np.flatnonzero(several) + 1, middle[several])
        last = np.append(first[1:], ranks.size)
    return first[part]


def _below(
    ranks: Ranks, part: np.ndarray, work: np.ndarray, key: np.ndarray, cut: np.ndarray
) -> np.ndarray:
    """Work of each part up to its cut, and number of its bodies there, shape (2, num_parts)."""
    there = key <= cut[part]
    sums = [np.bincount(part[there], w, minlength=len(cut)) for w in (work[there], None)]
    return ranks.sum(np.array(sums, float))
