# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a rank tells others of the surfaces of its bodies, and what it knows of theirs.

Of a mesh that is spread over ranks nodes, facets and bodies have numbers that no partition decides:
those of the mesh that was cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from xper_fx.bodies.explode import Bodies
from xper_fx.bodies.surfaces import numbered_surface
from xper_fx.nscd.search.surface import Surface

# Numbers that keys of contacts have room for (`surface_search.py`).
MOST = 1 << 30


class Tables(NamedTuple):
    """Facets, nodes and bodies; each is named by its number."""

    facet: np.ndarray  #: shape (f,), ascending
    corners: np.ndarray  #: shape (f, dim), nodes
    body: np.ndarray  #: shape (f,)
    group: np.ndarray  #: shape (f,), int32
    thickness: np.ndarray  #: shape (f,), m
    exposed: np.ndarray  #: shape (f,), bool
    ajar: np.ndarray  #: shape (f,), bool
    edges: np.ndarray  #: shape (f, 3), which edges are one (`Bonds.joined_edges`); (f, 0) in 2D
    node: np.ndarray  #: shape (n,), ascending
    start: np.ndarray  #: shape (n, dim), where nodes were at the start (m)
    weld: np.ndarray  #: shape (n,), smallest node of each node's weld
    which: np.ndarray  #: shape (b,), bodies, ascending
    fragment: np.ndarray  #: shape (b,), smallest body of each body's fragment
    rank: np.ndarray  #: shape (b,)

    def of(self, bodies: np.ndarray) -> Tables:
        """What belongs to some of the bodies, given by their numbers."""
        facets = np.isin(self.body, bodies)
        nodes = np.isin(self.node, self.corners[facets])
        there = np.isin(self.which, bodies)
        return Tables(
            *(a[facets] for a in self[:8]), *(a[nodes] for a in self[8:11]),
            *(a[there] for a in self[11:]),
        )  # fmt: skip


def joined(parts: Sequence[Tables]) -> Tables:
    """Tables of several ranks as one."""
    whole = Tables(*map(np.concatenate, zip(*parts, strict=True)))
    orders = (np.argsort(column) for column in (whole.facet, whole.node, whole.which))
    facets, nodes, bodies = orders
    return Tables(
        *(a[facets] for a in whole[:8]), *(a[nodes] for a in whole[8:11]),
        *(a[bodies] for a in whole[11:]),
    )  # fmt: skip


class OwnSurface(NamedTuple):
    """The surface of a rank's own bodies, and all bonds that the rank knows."""

    surface: Surface  #: facets of own bodies; bond i is facing facet i of the bodies known here
    #: in 3D these and, behind them, facets of others' bodies that bonds hide, on the same nodes
    with_hidden: Surface | None
    facet: np.ndarray  #: numbers of facets
    node: np.ndarray  #: numbers of nodes, in the order of the facets
    start: np.ndarray  #: shape (num_nodes, dim), m
    dof: np.ndarray  #: shape (num_nodes,), of the space on all bodies that are known here
    body_of_node: np.ndarray  #: shape (num_nodes,), among the known bodies


def own_surface(bodies: Bodies, V, groups, rank: int) -> OwnSurface:
    """The surface of a rank's bodies.

    Args:
        bodies: those known here of a mesh that is spread.
        V: Lagrange space on their mesh.
        groups: as of `extract_surface`.
        rank: whose bodies count.

    Raises:
        ValueError: a mesh of more cells than keys of contacts have room for.
    """
    whole, facet = numbered_surface(bodies, V, groups)
    dofs = V.dofmap.list
    k, dim = dofs.shape[1], whole.dim
    cells, last = bodies.spread.num_cells, int(bodies.labels.max(initial=0))
    if max(cells * k, 36 * cells if dim == 3 else 0, last) >= MOST:
        raise ValueError(
            "Searched contacts take labels of bodies below 2^30, and meshes of fewer than "
            f"{MOST // (36 if dim == 3 else k)} cells; there are {cells} cells, and labels up to "
            f"{last}."
        )
    number = np.full(int(dofs.max(initial=-1)) + 1, np.iinfo(np.int64).max)
    np.minimum.at(number, dofs, bodies.parent_cell[:, None].astype(np.int64) * k + np.arange(k))
    body = np.zeros(len(number), np.int64)
    body[dofs] = bodies.body_of_cell[:, None]
    in_order = np.argsort(number)
    place = np.empty(len(number), np.int32)
    place[in_order] = np.arange(len(number))
    is_own = bodies.spread.rank_of_body[whole.body] == rank
    own = np.flatnonzero(is_own)

    def taken(facets: np.ndarray) -> tuple[Surface, np.ndarray]:
        return Surface(
            place[whole.facets[facets]], whole.body[facets], len(number), whole.group[facets],
            whole.groups, whole.bond[facets], place[whole.bond_nodes], whole.bond_bodies,
            whole.thickness[facets],
        ).compact()  # fmt: skip

    surface, at = taken(own)
    with_hidden = None
    if dim == 3:  # their nodes are those of bonds
        hidden = np.flatnonzero(~is_own & (whole.bond >= 0))
        with_hidden, _ = taken(np.concatenate([own, hidden]))
    dof = in_order[at]
    start = V.tabulate_dof_coordinates()[dof, :dim]
    return OwnSurface(surface, with_hidden, facet[own], number[dof], start, dof, body[dof])
