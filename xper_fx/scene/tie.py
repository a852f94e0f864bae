# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ties: surfaces of bodies meshed apart, whose nodes do not match, and the law between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.bodies.meshes import facet_cells, midpoints_of
from xper_fx.nscd.facets import no_points
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.mortar import RULES, nonmatching_points
from xper_fx.nscd.points import InteractionPoints
from xper_fx.scene.facet_laws import require_law
from xper_fx.support.checks import require_integer

if TYPE_CHECKING:
    from dolfinx.fem import FunctionSpace

    from xper_fx.bodies.explode import Bodies


@dataclass(frozen=True)
class Tie:
    """A law between two surfaces that coincide in space and are meshed differently.

    Args:
        candidates: facet tag of the surface that bears the points: the finer one, or the softer.
        antagonists: facet tag of the surface that the candidates lie in, all of them.
        law: between them; any law.
        rule: "mortar" or "nodes", see `nscd/mortar.py`. Mortar points need all antagonists
            around a candidate node to be of one body.

    Raises:
        ValueError: another rule, one tag for both surfaces.
        TypeError: a law that is none, a tag that is no integer.
    """

    candidates: int
    antagonists: int
    law: Law
    rule: str = "mortar"

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise ValueError(f"rule should be one of {', '.join(RULES)}, got {self.rule!r}.")
        require_law(self.law)
        for name in ("candidates", "antagonists"):
            require_integer(name, getattr(self, name))
        if self.candidates == self.antagonists:
            raise ValueError(
                f"candidates and antagonists are both facet tag {self.candidates}; give the two "
                "surfaces a tag each."
            )

    def check(self, bodies: Bodies, order: int) -> None:
        """See that it fits a scene.

        Args:
            order: of the Lagrange space.

        Raises:
            ValueError: cells that have no such surfaces, a facet tag that occurs nowhere.
        """
        cell = bodies.mesh.topology.cell_name()
        if order != 1 or cell not in ("triangle", "tetrahedron"):
            raise ValueError(
                "Ties need triangles or tetrahedra of order 1, whose surfaces are of segments "
                f"or triangles; got {cell} cells of order {order}."
            )
        for facets in (self.candidates, self.antagonists):
            if facets not in bodies.present.facets:
                raise ValueError(
                    f"A tie names facet tag {facets}, which occurs nowhere; tags that do: "
                    f"{sorted(bodies.present.facets)}."
                )


def tied_groups(ties: Sequence[Tie], bodies: Bodies) -> np.ndarray:
    """Groups of bodies that ties join, directly or through others.

    Returns:
        The group of each body, shape (num_bodies,), int32; a body without a tie is one of its own.
    """
    cell = facet_cells(bodies.mesh)[0][:, 0]
    first, other = [np.zeros(0, int)], [np.zeros(0, int)]
    for tie in ties:
        tags = bodies.facet_tags
        facets = tags.indices[np.isin(tags.values, (tie.candidates, tie.antagonists))]
        tied = np.unique(bodies.body_of_cell[cell[facets]])
        first.append(np.full(len(tied), tied[0]))
        other.append(tied)
    a, b = np.concatenate(first), np.concatenate(other)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=2 * (bodies.num_bodies,))
    return connected_components(graph, directed=False)[1]


def tie_points(
    tie: Tie, V: FunctionSpace, bodies: Bodies, turns: bool
) -> tuple[InteractionPoints, np.ndarray]:
    """Points of a tie, on the nodes of a space of order 1.

    Args:
        V: vector Lagrange space of order 1 on `bodies.mesh`.
        turns: whether frames turn with the surfaces.

    Returns:
        The points, and the pairs of bodies that they join, shape (num_points, 2). None where the
        surfaces are those of other ranks' bodies.

    Raises:
        ValueError: the surfaces do not fit each other (`nonmatching_points`).
    """
    mesh = bodies.mesh
    dim = mesh.geometry.dim
    if not len(bodies.facet_tags.find(tie.candidates)):
        return no_points(dim), np.zeros((0, 2), int)
    cells_of_facet, local = (a[:, 0] for a in facet_cells(mesh))
    x = V.tabulate_dof_coordinates()[:, :dim]
    layout, dofmap = V.dofmap.dof_layout, V.dofmap.list
    facet_dofs = np.array([layout.entity_closure_dofs(dim - 1, f) for f in range(local.max() + 1)])
    surfaces, owners = [], []
    for tag in (tie.candidates, tie.antagonists):
        facets = bodies.facet_tags.find(tag)
        cells = cells_of_facet[facets]
        surfaces.append(dofmap[cells[:, None], facet_dofs[local[facets]]])
        owners.append(cells)
    inside = midpoints_of(x, dofmap[owners[0]])
    body = np.empty(len(x), np.int64)
    body[dofmap.ravel()] = np.repeat(bodies.body_of_cell, dofmap.shape[1])
    points = nonmatching_points(x, *surfaces, inside, body, tie.rule, turns)
    return points, body[points.nodes[:, :, 0]]
