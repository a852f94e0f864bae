# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ties: surfaces of bodies meshed apart, whose nodes do not match, and the law between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.bodies.meshes import facet_cells, midpoints_of
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.mortar import RULES, MisfitError, TiedPoints, TiedSurface, nonmatching_points
from xper_fx.scene.facet_laws import require_law
from xper_fx.support.checks import require_integer

if TYPE_CHECKING:
    from dolfinx.fem import FunctionSpace

    from xper_fx.bodies.explode import Bodies
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.support.ranks import Ranks


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


def tie_points(
    tie: Tie, V: FunctionSpace, bodies: Bodies, part: LocalBodies | None, ranks: Ranks, turns: bool
) -> TiedPoints:
    """Points of a tie on this rank's candidates, on the nodes of a space of order 1.

    All ranks call it together.

    Args:
        V: vector Lagrange space of order 1 on the mesh of this rank's bodies.
        bodies: of the scene.
        part: what of them is this rank's, None if it has all.
        turns: whether frames turn with the surfaces.

    Raises:
        MisfitError: the surfaces do not fit each other; it is the same on all ranks.
    """
    candidates, antagonists = _surfaces(tie, V, bodies, part, ranks.rank)
    if ranks.alone:
        return _points_of(tie, candidates, antagonists, turns)
    from xper_fx.bodies.keepers import places_in_order
    from xper_fx.parallel.tied_surfaces import fitting, in_reach

    antagonists = in_reach(candidates, antagonists, ranks)
    points = fitting(ranks, lambda: _points_of(tie, candidates, antagonists, turns))
    return points._replace(number=places_in_order(ranks, points.number)[0])


def _surfaces(
    tie: Tie, V: FunctionSpace, bodies: Bodies, part: LocalBodies | None, rank: int
) -> list[TiedSurface]:
    """Candidates and antagonists of this rank; arguments as of `tie_points`."""
    if part is None:
        own, body, cell = bodies, np.arange(bodies.num_bodies), np.arange(len(V.dofmap.list))
    else:
        own, body = part.bodies, bodies.numbers_on_all(part.body_numbers)
        cell = part.cells if bodies.spread is None else own.parent_cell
    dim = own.mesh.geometry.dim
    cells_of_facet, local = (a[:, 0] for a in facet_cells(own.mesh))
    x, dofmap = V.tabulate_dof_coordinates()[:, :dim], V.dofmap.list
    layout = V.dofmap.dof_layout
    facet_dofs = np.array([layout.entity_closure_dofs(dim - 1, f) for f in range(dim + 1)])
    # nodes are numbered as cells name them first, where all are on one rank, too
    named, first = np.unique(dofmap, return_index=True)
    number = np.empty(len(x), np.int64)
    number[named] = cell[first // dofmap.shape[1]] * dofmap.shape[1] + first % dofmap.shape[1]
    out = []
    for tag in (tie.candidates, tie.antagonists):
        facets = own.facet_tags.find(tag)
        cells = cells_of_facet[facets]
        nodes = dofmap[cells[:, None], facet_dofs[local[facets]]]
        out.append(
            TiedSurface(
                number[nodes], nodes, x[nodes], midpoints_of(x, dofmap[cells]),
                body[own.body_of_cell[cells]], np.full(len(nodes), rank),
            )
        )  # fmt: skip
    return out


def _points_of(
    tie: Tie, candidates: TiedSurface, antagonists: TiedSurface, turns: bool
) -> TiedPoints:
    """Points on all nodes of the candidates; `number` has those of these nodes."""
    both = TiedSurface(*map(np.concatenate, zip(candidates, antagonists, strict=True)))
    number, one, place = np.unique(both.number, return_index=True, return_inverse=True)
    corners, count = place.reshape(both.number.shape), len(candidates.number)
    facet, corner = np.divmod(one, corners.shape[1])
    node, x = both.node[facet, corner], both.x[facet, corner]
    body, rank = both.body[facet], both.rank[facet]
    try:
        points = nonmatching_points(
            x, corners[:count], corners[count:], candidates.inside, body, tie.rule, turns
        )
    except MisfitError as error:
        raise MisfitError(error.kind, number[error.first].tolist(), *error.args[2:]) from None
    sides = points.nodes[:, :, 0]
    return TiedPoints(points, number[sides[:, 0]], x[sides[:, 0]], body[sides], node, rank)
