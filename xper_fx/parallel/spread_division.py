# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts between bodies of a mesh that is spread over ranks, each of which is on one rank.

They are divided as `surface_division.py` divides those of a mesh that each rank has whole.
Ranks tell each other what they have found by numbers that no partition decides. Two of them agree
on the pairs of their bodies that may touch; of pairs of others they know nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.parallel.halo import Halo
from xper_fx.parallel.ownership import owners_of_pairs, phases
from xper_fx.parallel.spread_search import KnownBodies
from xper_fx.parallel.surface_division import FoundOwners, hand_over, with_ghosts_of_pairs
from xper_fx.support.ranks import Ranks


class SpreadDivision:
    """A rank's share of the contacts; all ranks call its methods together.

    Args:
        ranks: the ranks.

    Attributes:
        slot: shape (num_nodes,), slots of the nodes of `KnownBodies`, and of the ghosts that there
            are now; others mean nothing.
        slot_of_rigid: empty, as there are no rigid bodies.
    """

    def __init__(self, ranks: Ranks):
        self._ranks, self._owners = ranks, FoundOwners()
        self._pairs = np.zeros((0, 4), np.int64)
        self._ghosts = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self.slot = self.slot_of_rigid = np.zeros(0, np.int64)

    def begin(self, interactions: Interactions, slots: np.ndarray) -> None:
        """Take the layer of points, and the slots of own nodes of the surface, by number."""
        self._first: Halo = interactions.halo
        self._own_slots, self._meetings = slots, self._first.meetings

    def commit(self) -> None:
        """The contacts found last are those of a step that is done."""
        self._owners.commit()

    def hand_over(self, contacts: Contacts, known: KnownBodies) -> tuple[Contacts, bool]:
        """As `SurfaceDivision.hand_over`; nodes are those of `known`."""
        node, rank = known.tables.node, known.tables.rank
        main = np.take_along_axis(contacts.nodes, contacts.weights.argmax(axis=2)[..., None], 2)
        owner = owners_of_pairs(rank[known.body_of_node[main[..., 0]]])
        moved = self._owners.take(contacts.key, owner)
        contacts, some_moved = hand_over(
            self._ranks, _on(contacts, node[contacts.nodes]), owner, moved
        )
        nodes = np.searchsorted(node, contacts.nodes).astype(np.int32)
        return _on(contacts, nodes), some_moved

    def take_ghosts(
        self, interactions: Interactions, pairs: np.ndarray, known: KnownBodies
    ) -> None:
        """Take the ghosts that contacts between some bodies need.

        Args:
            interactions: the layer.
            pairs: shape (n, 2), bodies of `known` that may touch.
            known: what this rank knows now.
        """
        ranks, tables, me = self._ranks, known.tables, self._ranks.rank
        sides = tables.rank[pairs]
        cut = np.column_stack([tables.which[pairs], sides])[sides[:, 0] != sides[:, 1]]
        other = np.where(cut[:, 2] == me, cut[:, 3], cut[:, 2])
        told = ranks.comm.alltoall([cut[other == rank] for rank in range(ranks.size)])
        pairs = np.unique(np.concatenate([cut, *told]), axis=0)
        if ranks.max(float(not np.array_equal(pairs, self._pairs))) > 0.0:
            self._pairs = pairs
            self._renew(interactions, known)
        number, slot = self._ghosts
        self.slot = np.full(len(tables.node), -1)
        self.slot[known.own_node] = self._own_slots
        there = np.isin(tables.node, number)
        self.slot[there] = slot[np.searchsorted(number, tables.node[there])]

    def _renew(self, interactions: Interactions, known: KnownBodies) -> None:
        ranks, me = self._ranks, self._ranks.rank
        bodies, sides = self._pairs[:, :2], self._pairs[:, 2:]
        met = np.concatenate(ranks.comm.allgather(np.unique(sides, axis=0)))
        self._meetings = phases(met, ranks.size, self._meetings)
        owner = owners_of_pairs(sides)
        own_node = np.flatnonzero(known.own_node)
        given, ghosts = {}, {}
        for other in np.setdiff1d(sides, [me]).tolist():
            here = (sides == other).any(axis=1)
            for rank, of, nodes in ((other, me, given), (me, other, ghosts)):
                pairs = here & (owner == rank)
                nodes[other] = self._nodes_of(bodies[pairs][sides[pairs] == of], known)
        given = {
            rank: self._own_slots[np.searchsorted(own_node, nodes)]
            for rank, nodes in given.items()
            if len(nodes)
        }
        halo = with_ghosts_of_pairs(interactions, self._first, given, self._meetings)
        numbers, slots = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        for rank, nodes in ghosts.items():
            if len(nodes):
                numbers.append(known.tables.node[nodes])
                slots.append(halo.wanted[rank][-len(nodes) :])
        number, slot = np.concatenate(numbers), np.concatenate(slots)
        order = np.argsort(number)
        self._ghosts = number[order], slot[order]

    @staticmethod
    def _nodes_of(bodies: np.ndarray, known: KnownBodies) -> np.ndarray:
        """Nodes of bodies that are given by their numbers, ascending."""
        there = np.isin(known.tables.which, bodies)
        return np.flatnonzero(there[known.body_of_node])

    def saved(self) -> dict:
        """In which phase ranks meet, which hangs on all that was near before."""
        return {"meetings": self._meetings}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, of as many ranks; another number of ranks meets anew."""
        if saved["meetings"].shape == self._meetings.shape:
            self._meetings = saved["meetings"]


def _on(contacts: Contacts, nodes: np.ndarray) -> Contacts:
    """Contacts with other numbers of their nodes."""
    body, _, *others = contacts
    return Contacts(body, nodes, *others)
