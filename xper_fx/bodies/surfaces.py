# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of bodies for the search of contacts: outer facets, and those that bonds hide.

A facet becomes what the search takes: edges between neighbouring nodes in 2D, triangles in 3D. A
facet of order 2 is cut at its nodes into two edges or four triangles, a quadrilateral along a
diagonal, so that every node on a surface may touch and be touched; between its nodes a surface is
taken as straight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set

import numpy as np
import numpy.typing as npt
from dolfinx.fem import FunctionSpace

from xper_fx.bodies.explode import Bodies, CellFacets
from xper_fx.bodies.meshes import facet_cells, local_facet_vertices, midpoints_of
from xper_fx.nscd.search.surface import Surface
from xper_fx.support.compat import geometry_dofmap

# How facets are cut: (dimension, number of nodes) -> pieces, by places among the facet's nodes in
# the order of `Bodies.facing_nodes`.
_PIECES = {
    (2, 2): [(0, 1)],
    (2, 3): [(0, 2), (2, 1)],
    (3, 3): [(0, 1, 2)],
    (3, 4): [(0, 1, 3), (0, 3, 2)],
    (3, 6): [(0, 5, 4), (5, 1, 3), (4, 3, 2), (5, 3, 4)],
    (3, 9): [
        piece
        for a, b, c, d in ((0, 4, 8, 5), (4, 1, 6, 8), (8, 6, 3, 7), (5, 8, 7, 2))
        for piece in ((a, b, c), (a, c, d))
    ],
}


def extract_surface(
    bodies: Bodies,
    V: FunctionSpace,
    groups: Mapping[str, Sequence[int]] | None = None,
    facet_tags: Sequence[int] | None = None,
) -> Surface:
    """Outer facets of bodies, and those that face each other, for `SurfaceSearch`.

    Facing facet i of `bodies.facets` is bond i. Facets come in the order of the cells that the
    parent was made from, and of facets within these.

    Args:
        bodies: the bodies, of no periodic cell.
        V: continuous Lagrange space of order 1 or 2 on their mesh; nodes are its block dofs.
        groups: cell tags of each named group; None: all bodies are "surface". Bodies of other
            tags have no surface.
        facet_tags: tags of the outer facets that are taken; None: all. Facing ones are taken in any
            case.

    Returns:
        The surface; the thickness behind a facet is the height of its cell.

    Raises:
        ValueError: a periodic cell; V as in `Bodies.facing_nodes`; a tag that no cell or facet has,
            or a cell tag in two groups.
    """
    return numbered_surface(bodies, V, groups, facet_tags)[0]


def numbered_surface(
    bodies: Bodies,
    V: FunctionSpace,
    groups: Mapping[str, Sequence[int]] | None = None,
    facet_tags: Sequence[int] | None = None,
) -> tuple[Surface, npt.NDArray[np.int64]]:
    """As `extract_surface`; and a number of each facet by its cell in the parent, shape (f,).

    Numbers are unique, and ascend where cells stand in the order of the parent's.
    """
    if bodies.lattice is not None:
        raise ValueError("Bodies of a periodic cell have no surfaces that meet: explode without.")
    group_of_cell, names = _groups(bodies, groups)
    facing = bodies.facets
    both = bodies.facing_nodes(V)
    outer = _outer_facets(bodies, facet_tags)
    nodes = np.concatenate([bodies.nodes_on_facets(V, outer)[:, 0], both[:, 0], both[:, 1]])
    cell = np.concatenate([outer.cells[:, 0], facing.cells[:, 0], facing.cells[:, 1]])
    bond = np.concatenate([np.full(len(outer.cells), -1), np.tile(np.arange(len(facing)), 2)])
    local = np.concatenate([outer.local_facets[:, 0], *facing.local_facets.T])
    # their order decides between what is equally near: it should not hang on axes, as that of
    # facing facets does, nor on how cells are divided or renumbered
    taken = np.lexsort((local, bodies.mesh.topology.original_cell_index[cell]))
    taken = taken[group_of_cell[cell[taken]] >= 0]
    dim = bodies.mesh.topology.dim
    pieces = np.array(_PIECES[dim, nodes.shape[1]])
    facets = nodes[taken][:, pieces].reshape(-1, dim)
    facets_a_cell = len(local_facet_vertices(bodies.mesh))
    number = bodies.parent_cell[cell[taken]].astype(np.int64) * facets_a_cell + local[taken]
    number = (number[:, None] * len(pieces) + np.arange(len(pieces))).ravel()
    cell, bond = (np.repeat(column[taken], len(pieces)) for column in (cell, bond))
    thickness = _turn_outward(facets, cell, bodies, V)
    return Surface(
        facets,
        bodies.body_of_cell[cell],
        V.dofmap.index_map.size_local,
        group=group_of_cell[cell],
        groups=names,
        bond=bond,
        bond_nodes=both,
        bond_bodies=facing.bodies,
        thickness=thickness,
    ), number


def _groups(
    bodies: Bodies, groups: Mapping[str, Sequence[int]] | None
) -> tuple[npt.NDArray[np.int32], tuple[str, ...]]:
    """Return the group of each cell, -1 for none, and the names of the groups."""
    tags = bodies.material_of_cell
    if groups is None:
        return np.zeros(len(tags), np.int32), ("surface",)
    of_cell = np.full(len(tags), -1, np.int32)
    for number, (name, own) in enumerate(groups.items()):
        _check_known(own, bodies.present.cells, f"Group {name!r}", "cell")
        inside = np.isin(tags, own)
        twice = np.flatnonzero(inside & (of_cell >= 0))
        if len(twice):
            other = list(groups)[of_cell[twice[0]]]
            raise ValueError(
                f"Cell tag {tags[twice[0]]} is in groups {other!r} and {name!r}; give it to one."
            )
        of_cell[inside] = number
    return of_cell, tuple(groups)


def _outer_facets(bodies: Bodies, facet_tags: Sequence[int] | None) -> CellFacets:
    """Return the outer facets that bear one of the tags, or all, that face no other body."""
    mesh = bodies.mesh
    cells, local = facet_cells(mesh)
    outer = cells[:, 1] < 0
    if facet_tags is not None:
        there = set(bodies.facet_tags.values.tolist())
        _check_known(facet_tags, there, "facet_tags", "facet")
        tagged = bodies.facet_tags.indices[np.isin(bodies.facet_tags.values, facet_tags)]
        bears = np.zeros(len(outer), bool)
        bears[tagged] = True
        outer &= bears
    cells, local = cells[:, :1], local[:, :1]
    per_cell = len(local_facet_vertices(mesh))
    faces = np.zeros(len(bodies.body_of_cell) * per_cell, bool)
    faces[bodies.facets.cells * per_cell + bodies.facets.local_facets] = True
    outer &= ~faces[cells[:, 0] * per_cell + local[:, 0]]
    local = local[outer]
    return CellFacets(cells[outer], local, local_facet_vertices(mesh)[local])


def _check_known(asked: Sequence[int], there: Set[int], what: str, entity: str) -> None:
    unknown = set(asked) - there
    if unknown:
        raise ValueError(
            f"{what} names {entity} tags {sorted(unknown)}, which no {entity} bears; tags that "
            f"do: {sorted(there)}."
        )


def _turn_outward(
    facets: npt.NDArray[np.int32], cell: npt.NDArray[np.int32], bodies: Bodies, V: FunctionSpace
) -> npt.NDArray[np.float64]:
    """Order the nodes of facets so that they face out of their cells; return the cells' heights."""
    mesh = bodies.mesh
    dim = mesh.topology.dim
    x = mesh.geometry.x[:, :dim]
    corner = V.tabulate_dof_coordinates()[:, :dim][facets]
    along = corner[:, 1] - corner[:, 0]
    if dim == 2:
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    else:
        normal = np.cross(along, corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    dofmap = geometry_dofmap(mesh)[cell]
    inward = np.einsum("fd,fd->f", midpoints_of(x, dofmap) - corner[:, 0], normal) > 0.0
    facets[inward] = facets[inward][:, [1, 0, 2][:dim]]
    rise = np.einsum("fvd,fd->fv", x[dofmap] - corner[:, :1], normal)
    return np.abs(rise).max(axis=1)
