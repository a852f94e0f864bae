# SPDX-License-Identifier: LGPL-3.0-or-later
"""The boundary of a periodic cell whose mesh is spread over ranks.

Translates of a facet are wrapped to one place in the cell, by which they come to one rank: that
finds the pairs as one rank finds them in a whole mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh

from xper_fx.bodies.keepers import JoinedNumbers, Keepers, places_of_points
from xper_fx.bodies.lattice import check_volume, match_facets, match_tolerance, wrapped
from xper_fx.bodies.meshes import cell_measure, facet_cells, facet_geometry_nodes
from xper_fx.support.compat import geometry_dofmap, original_cells
from xper_fx.support.ranks import Ranks


class CellBorder(NamedTuple):
    """What a rank's own cells have on the boundary of the periodic cell."""

    #: shape (num_cells, facets of a cell), int64, number of each facet's pair, which another facet
    #: bears as well; -1 of those within the cell and of voids
    pair: npt.NDArray[np.int64]
    #: shape (num_cells, vertices of a cell), int64: the smallest number of the vertices that are
    #: one vertex of the periodic medium
    vertex: npt.NDArray[np.int64]
    lattice: npt.NDArray[np.float64]  #: shape (dim, dim), period vectors as rows, m


def border_of(
    ranks: Ranks,
    mesh: Mesh,
    facet_tag: npt.NDArray[np.int32],
    lattice: npt.NDArray[np.float64],
    voids: Sequence[int],
) -> CellBorder:
    """Pair the facets of a cell's boundary; all ranks call it together.

    Args:
        ranks: those of the mesh.
        mesh: the mesh, as DOLFINx has spread it.
        facet_tag: shape (num_cells, facets of a cell), tags of the facets of this rank's own cells.
        lattice: shape (dim, dim), period vectors as rows, m.
        voids: tags of facets that have no partner.

    Raises:
        ValueError: as `match_facets` and `check_volume`.
    """
    (count, sides), dim = facet_tag.shape, mesh.geometry.dim
    dofmap = geometry_dofmap(mesh)[:count]
    measure = cell_measure(mesh.topology.cell_name(), mesh.geometry.x[dofmap])
    check_volume(ranks.sum(float(measure.sum())), lattice, len(voids) > 0)

    cells, local = facet_cells(mesh)
    outer = (cells[:, 1] < 0) & (cells[:, 0] < count)
    outer[mesh.topology.interprocess_facets()] = False
    cell, side = cells[outer, 0], local[outer, 0]
    there = ~np.isin(facet_tag[cell, side], list(voids))
    cell, side = cell[there], side[there]
    nodes = facet_geometry_nodes(mesh, cell, side)
    x, vertex = mesh.geometry.x[nodes][:, :, :dim], mesh.geometry.input_global_indices
    number = original_cells(mesh)[cell].astype(np.int64) * sides + side

    tolerance = match_tolerance(x, ranks)
    place, places = places_of_points(ranks, *wrapped(x.mean(axis=1), lattice, tolerance))
    keepers = Keepers(ranks, number, place * ranks.size // max(places, 1))
    x, ends = keepers.sum(x), keepers.sum(vertex[nodes].astype(np.int64))
    both, translation = ranks.together(lambda: match_facets(x, lattice, tolerance))
    pair = np.empty(len(x), np.int64)
    pair[both] = keepers.kept[both].min(axis=1)[:, None]
    gap = x[both[:, 0], :, None] + translation[:, None, None] - x[both[:, 1], None]
    partner = np.einsum("fijd,fijd->fij", gap, gap).argmin(axis=2)
    one, other = ends[both[:, 0]], np.take_along_axis(ends[both[:, 1]], partner, axis=1)

    known, where = np.unique(vertex[dofmap], return_inverse=True)
    numbers = np.union1d(known, ends)
    pairs = np.searchsorted(numbers, np.column_stack([one.ravel(), other.ravel()]))
    first = JoinedNumbers(ranks, numbers).smallest(pairs)[np.searchsorted(numbers, known)]
    out = np.full(facet_tag.shape, -1, np.int64)
    out[cell, side] = keepers.answer(pair)
    return CellBorder(out, first[where].reshape(dofmap.shape), lattice)
