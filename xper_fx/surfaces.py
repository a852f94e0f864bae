# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of bodies for the search of contacts: outer facets, and those that bonds hide.

A facet becomes what the search takes: edges between neighbouring nodes in 2D, triangles in 3D. A
facet of order 2 is cut at the nodes on its edges, two edges or four triangles, a quadrilateral
along a diagonal, so that every node on a surface may touch and be touched; between its nodes a
surface is taken as straight.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx.fem import FunctionSpace

from xper_fx.bodies import Bodies, FacingFacets
from xper_fx.compat import geometry_dofmap
from xper_fx.meshes import cell_measure, facet_cells, facet_geometry_nodes, local_facet_vertices
from xper_fx.nscd.search.surface import Surface

# How facets are cut: dimension, number of nodes -> pieces by places among a facet's nodes, which
# go counter-clockwise seen from outside (2D: with the body on the left).
_PIECES = {
    (2, 2): [(0, 1)],
    (2, 3): [(0, 2), (2, 1)],
    (3, 3): [(0, 1, 2)],
    (3, 6): [(0, 5, 4), (5, 1, 3), (4, 3, 2), (5, 3, 4)],
    (3, 4): [(0, 1, 3), (0, 3, 2)],
    (3, 9): [
        piece
        for a, b, c, d in ((0, 4, 8, 5), (4, 1, 6, 8), (8, 6, 3, 7), (5, 8, 7, 2))
        for piece in ((a, b, c), (a, c, d))
    ],
}


def extract_surface(
    bodies: Bodies,
    V: FunctionSpace,
    groups: dict[str, Sequence[int]] | None = None,
    facet_tags: Sequence[int] | None = None,
) -> Surface:
    """Outer facets of bodies, and those that face each other, as arrays for `SurfaceSearch`.

    Facing facet i of `bodies.facets` is bond i.

    Args:
        bodies: the bodies; of no periodic cell.
        V: continuous Lagrange space of order 1 or 2 on their mesh. Nodes are its block dofs.
        groups: name of each group -> cell tags of its bodies; None: all bodies are of the group
            "surface". Bodies of other cell tags have no surface.
        facet_tags: outer facets that are taken; None: all. Facing ones are taken in any case.

    Returns:
        The surface; the thickness behind a facet is the height of its cell.

    Raises:
        ValueError: a periodic cell; V as in `Bodies.facing_nodes`; a tag that no cell or facet
            has, or that is in two groups.
    """
    if bodies.lattice is not None:
        raise ValueError("Bodies of a periodic cell have no surfaces to search for contacts.")
    group_of_cell, names = _groups(bodies, groups)
    mesh = bodies.mesh
    dim = mesh.topology.dim
    outer = _outer_facets(bodies, facet_tags)
    facing = bodies.facets
    nodes = [_nodes(bodies, V, outer.cells, outer.local_facets, outer.local_vertices)]
    cells, local, bond = [outer.cells[:, 0]], [outer.local_facets[:, 0]], [np.full(len(outer), -1)]
    both = bodies.facing_nodes(V)
    for side in range(2):
        # seen from the candidate's inside the vertices go counter-clockwise round the normal
        own = both[:, side]
        nodes.append(_turned(own, dim) if side == 0 else own)
        cells.append(facing.cells[:, side])
        local.append(facing.local_facets[:, side])
        bond.append(np.arange(len(facing)))
    nodes, cells, local, bond = (np.concatenate(part) for part in (nodes, cells, local, bond))
    taken = group_of_cell[cells] >= 0
    nodes, cells, local, bond = nodes[taken], cells[taken], local[taken], bond[taken]
    height = _heights(mesh, cells, local)
    pieces = np.array(_PIECES[dim, nodes.shape[1]])
    repeated = np.repeat(np.arange(len(nodes)), len(pieces))
    return Surface(
        nodes[:, pieces].reshape(-1, dim),
        bodies.body_of_cell[cells][repeated],
        V.dofmap.index_map.size_local,
        group=group_of_cell[cells][repeated],
        groups=names,
        bond=bond[repeated],
        bond_nodes=both,
        bond_bodies=facing.bodies,
        thickness=height[repeated],
    )
