# SPDX-License-Identifier: LGPL-3.0-or-later
"""Subdomains: a mesh cut into connected parts of like size by a graph partitioner.

Bodies made of the parts and held together by `PerfectBond` are a dual Schur domain decomposition
(`nscd/solvers/feti.py`); any other law may act where parts meet.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx.cpp.graph import AdjacencyList_int64
from dolfinx.graph import partitioner
from dolfinx.mesh import Mesh
from mpi4py import MPI
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from xper_fx.bodies.meshes import check_mesh, facet_cells
from xper_fx.support.checks import require_positive


def partition(mesh: Mesh, count: int, imbalance: float = 1.2) -> npt.NDArray[np.int32]:
    """Label the cells of a mesh by subdomain, for `xper_fx.bodies.explode.explode`.

    Cells are neighbours if they share a facet; the partitioner that DOLFINx was built with cuts
    few facets. What it leaves apart of a subdomain goes to the neighbour it shares most facets
    with; if the bound on the imbalance is missed then, cells of the largest subdomains go to
    smaller neighbours.

    Args:
        mesh: mesh on one process; its pieces, if it has several, are cut each by itself.
        count: number of subdomains.
        imbalance: bound on the cells of the largest subdomain over their mean; a subdomain of few
            cells may have three more.

    Returns:
        Shape (num_cells,), int32, labels from 0 to count - 1, all used; the cells of each hang
        together by facets. The same mesh gives the same labels.

    Raises:
        TypeError: `count` is no integer, `imbalance` no number.
        ValueError: an imbalance below 1, fewer subdomains than pieces of the mesh or more than
            cells, or the bound on the imbalance cannot be kept.
    """
    check_mesh(mesh)
    if isinstance(count, bool) or not isinstance(count, int | np.integer):
        raise TypeError(f"count is {count!r}; expected an integer number of subdomains.")
    if not require_positive("imbalance", imbalance) >= 1.0:
        raise ValueError(f"imbalance should be 1 or more, got {imbalance}.")
    graph = _dual_graph(mesh)
    num_cells = graph.shape[0]
    pieces, piece = connected_components(graph, directed=False)
    if not pieces <= count <= num_cells:
        raise ValueError(
            f"count is {count}; expected a number from {pieces}, the pieces of the mesh that share "
            f"no facet, to {num_cells}, its cells."
        )
    labels, first = np.empty(num_cells, np.int32), 0
    for number, share in enumerate(_shares(np.bincount(piece), count)):
        cells = np.flatnonzero(piece == number)
        labels[cells] = first + _connected_parts(graph[cells][:, cells], share)
        first += share
    mean = num_cells / count
    most = max(imbalance * mean, mean + 3.0)
    _even_out(graph, labels, most)
    largest = int(np.bincount(labels).max())
    if largest > most:
        raise ValueError(
            f"The largest of {count} subdomains has {largest} cells, the mean is {mean:.1f}: more "
            f"than the imbalance of {imbalance:g} allows. Allow more, or take another count."
        )
    return labels


def _dual_graph(mesh: Mesh) -> csr_array:
    """Cells that share a facet, symmetric, shape (num_cells, num_cells)."""
    cells, _ = facet_cells(mesh)
    pairs = cells[cells[:, 1] >= 0]
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    count = mesh.topology.index_map(mesh.topology.dim).size_local
    return coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count)).tocsr()


def _shares(cells: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    """Subdomains of each piece of a mesh, one at least: each goes where a share is largest."""
    shares = np.ones(len(cells), np.int64)
    for _ in range(count - len(cells)):
        shares[np.argmax(cells / shares)] += 1
    return shares


def _connected_parts(graph: csr_array, count: int) -> npt.NDArray[np.int32]:
    """Cut a connected graph into connected parts."""
    num_cells = graph.shape[0]
    if count == 1:
        return np.zeros(num_cells, np.int32)
    if count == num_cells:
        return np.arange(num_cells, dtype=np.int32)
    adjacency = AdjacencyList_int64(graph.indices.astype(np.int64), graph.indptr.astype(np.int32))
    part = np.array(partitioner()(MPI.COMM_SELF, count, adjacency, False).array, np.int32)
    _fill_empty(part, count)
    rows, columns = graph.nonzero()
    while True:
        inside = part[rows] == part[columns]
        own = coo_array((np.ones(inside.sum()), (rows[inside], columns[inside])), graph.shape)
        number, component = connected_components(own, directed=False)
        if number == count:
            return part
        sizes, part_of = np.bincount(component), np.empty(number, np.int32)
        part_of[component] = part
        main = np.zeros(count, np.int64)
        for one in np.argsort(sizes, kind="stable"):
            main[part_of[one]] = one
        stray = min(set(range(number)) - set(main.tolist()), key=lambda one: sizes[one])
        neighbours = part[columns[(component[rows] == stray) & ~inside]]
        part[component == stray] = np.argmax(np.bincount(neighbours))


def _even_out(graph: csr_array, labels: npt.NDArray[np.int32], most: float) -> None:
    """Move cells of the largest subdomains to smaller neighbours until none has more than `most`.

    How much the partitioner leaves apart, and so what its neighbours get on top of their share,
    depends on its version. Each move makes two sizes more alike, so the moves come to an end; a
    subdomain that a cell leaves stays connected.
    """
    rows, columns = graph.nonzero()
    while (sizes := np.bincount(labels)).max() > most:
        own, other = labels[rows], labels[columns]
        kept = np.bincount(rows, own == other)  # facets inside that a cell has
        ways = np.flatnonzero(sizes[own] > sizes[other] + 1)
        order = np.lexsort((kept[rows[ways]], sizes[other[ways]], -sizes[own[ways]]))
        for way in ways[order]:
            cell = rows[way]
            rest = np.flatnonzero(labels == own[way])
            rest = rest[rest != cell]
            if connected_components(graph[rest][:, rest], directed=False)[0] == 1:
                labels[cell] = other[way]
                break
        else:
            return


def _fill_empty(part: npt.NDArray[np.int32], count: int) -> None:
    """Give a part without cells one of the largest part's."""
    sizes = np.bincount(part, minlength=count)
    for empty in np.flatnonzero(sizes == 0):
        cell = np.flatnonzero(part == np.argmax(sizes))[0]
        sizes[part[cell]] -= 1
        sizes[empty] += 1
        part[cell] = empty
