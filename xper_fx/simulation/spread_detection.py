# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts between bodies of a mesh that is spread over ranks, none of which knows the whole."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from dolfinx.fem import FunctionSpace, functionspace

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.parallel.known_surface import own_surface
from xper_fx.parallel.local_bodies import LocalBodies
from xper_fx.parallel.ownership import owners_of_pairs
from xper_fx.parallel.rigid_share import RigidShare
from xper_fx.parallel.spread_division import SpreadDivision
from xper_fx.parallel.spread_search import SpreadSearch
from xper_fx.simulation.contact_detection import Detection
from xper_fx.simulation.parted_lips import PartedLips
from xper_fx.support.ranks import Ranks

if TYPE_CHECKING:
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.permanent_points import ScenePoints


class SpreadDetection(Detection):
    """`Detection` where each rank knows its bodies and what may touch them.

    Args:
        scene: the scene, whose mesh is spread.
        points: of its other interactions.
        V, part, ranks, rigid_share, static: as of `Detection`.
    """

    def __init__(
        self,
        scene: Scene,
        points: ScenePoints,
        V: FunctionSpace,
        part: LocalBodies,
        ranks: Ranks,
        rigid_share: RigidShare | None,
        static: bool,
    ):
        self._lip_numbers = points.facet_numbers
        super().__init__(scene, points.laws, V, part, ranks, rigid_share, static)

    def _surface_search(self, V: FunctionSpace, part: LocalBodies) -> None:
        scene, ranks = self._scene, self._ranks
        bodies = scene.bodies
        all_V = functionspace(bodies.mesh, V.ufl_element())
        own = own_surface(bodies, all_V, scene.surfaces, ranks.rank)
        contacts = [c for c in self._contacts if set(c.between) & set(scene.surfaces)]
        stored = (c.law.kernels(scene.dim).stored is not None for c in contacts)
        self._hold_slips = scene.dim == 3 and any(stored)
        smallest = -ranks.max(-float(own.surface.size(own.start).min(initial=np.inf)))
        _, law_of_facet = scene.law_of_facet()
        share = self._rigid_share
        rigid = None if share is None else (scene.rigid_bodies, share.rank_of_body)
        search = self._surfaces = SpreadSearch(
            ranks, bodies, own, self._reach(contacts, smallest), [c.between for c in contacts],
            law_of_facet < 0, self._static, rigid,
        )  # fmt: skip
        self._depth, self._shared = search.depth, SpreadDivision(ranks, share)
        self.reach = search.reach
        here = np.zeros(int(all_V.dofmap.list.max(initial=-1)) + 1, np.int64)
        here[all_V.dofmap.list[part.cells]] = V.dofmap.list
        self.nodes = self._at = here[own.dof[search.own]]
        self._x = own.start[search.own]
        lips = np.flatnonzero(law_of_facet >= 0)
        group = self._groups_of_tags(bodies.facets.materials[lips])
        taken = np.all(group >= 0, axis=1) & (self._law_of_pair[group[:, 0], group[:, 1]] >= 0)
        of_pairs = owners_of_pairs(part.rank_of_body[bodies.facets.bodies[lips]])
        self.lips = PartedLips(
            search, own.start, bodies.facets, lips, self._lip_numbers, taken, ranks,
            of_pairs == ranks.rank,
        )  # fmt: skip

    def _groups_of_tags(self, tags: np.ndarray) -> np.ndarray:
        """Number of the group of cells with given tags, -1 where they are in none."""
        group = np.full(tags.shape, -1)
        for number, own in enumerate(self._scene.surfaces.values()):
            group[np.isin(tags, own)] = number
        return group

    def share(self, interactions: Interactions, nodes: np.ndarray) -> None:
        """Take the layer of points; arguments as of `Detection.share`."""
        slot = np.full(nodes.max(initial=-1) + 1, -1)
        slot[nodes] = np.arange(len(nodes))
        self._shared.begin(interactions, slot[self.nodes])

    def _moved(self, displacement: np.ndarray) -> np.ndarray:
        return self._x + displacement.reshape(-1, self._scene.dim)[self._at]

    def _known_x(self, x: np.ndarray) -> np.ndarray:
        return self._surfaces.x

    def _moved_with_known(self, displacement: np.ndarray) -> np.ndarray:
        return self._surfaces.at_surface(self._moved(displacement))

    def _own(self, contacts: Contacts, interactions: Interactions) -> Contacts:
        search, shared = self._surfaces, self._shared
        known = search.known
        if search.lists_made != self._listed:
            self._listed = search.lists_made
            shared.take_ghosts(interactions, search.pairs_of_bodies(), known)
            tables = known.tables
            self._group_of_node = np.full(len(tables.node), -1)
            self._group_of_node[known.corners] = tables.group[:, None]
        contacts, some_moved = shared.hand_over(contacts, known)
        if some_moved:
            interactions.share_history(self._ranks)
        return contacts

    def saved(self) -> dict:
        """Broken lips and those that have retired; lists are made anew."""
        return self.lips.saved()

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order."""
        self.lips.restore(saved)
