# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts between bodies of a mesh that is spread over ranks, each of which is on one rank.

They are divided as `surface_division.py` divides those of a mesh that each rank has whole.
Ranks tell each other what they have found by numbers that no partition decides. Two of them agree
on the pairs of their bodies that may touch; of pairs of others they know nothing. Rigid bodies
count as bodies of two nodes, as there; their numbers come after those of all meshed ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.search.contact_pairs import Contacts
from xper_fx.parallel.halo import Halo
from xper_fx.parallel.known_surface import MOST
from xper_fx.parallel.ownership import owners_of_pairs
from xper_fx.parallel.rigid_share import RigidShare
from xper_fx.parallel.spread_search import KnownBodies
from xper_fx.parallel.surface_division import FoundOwners, ghosts_of_pairs, hand_over
from xper_fx.support.ranks import Ranks


class SpreadDivision:
    """A rank's share of the contacts; all ranks call its methods together.

    Args:
        rigid: this rank's share of rigid bodies, None without any.

    Attributes:
        slot: shape (num_nodes + 2 num_rigid,), slots of the nodes of `KnownBodies`, the two of each
            rigid body after them, and of the ghosts that there are now; others mean nothing.
    """

    def __init__(self, ranks: Ranks, rigid: RigidShare | None = None):
        self._ranks, self._owners = ranks, FoundOwners()
        self._pairs = np.zeros((0, 4), np.int64)
        self._ghosts = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self.slot = np.zeros(0, np.int64)
        self._rank_of_rigid, self._moves = np.zeros(0, np.int32), np.zeros(0, bool)
        self._rigid_here = np.zeros(0, np.int64)
        if rigid is not None:
            self._rank_of_rigid, self._moves = rigid.rank_of_body, rigid.moves
            self._rigid_here = 2 * rigid.here[:, None] + np.arange(2)

    def begin(self, interactions: Interactions, slots: np.ndarray) -> None:
        """Take the layer of points, and the slots of own nodes of the surface, by number."""
        self._first: Halo = interactions.halo
        self._own_slots = slots
        here = self._rigid_here
        first = interactions.bulk_inverse.num_nodes
        self._rigid_slots = first + np.arange(here.size).reshape(here.shape)

    @property
    def slot_of_rigid(self) -> np.ndarray:
        """First slot of each rigid body, shape (num_rigid,)."""
        return self.slot[len(self.slot) - 2 * len(self._moves) :: 2]

    def commit(self) -> None:
        """The contacts found last are those of a step that is done."""
        self._owners.commit()

    def hand_over(self, contacts: Contacts, known: KnownBodies) -> tuple[Contacts, bool]:
        """As `SurfaceDivision.hand_over`; nodes are those of `known`."""
        node, rank = known.tables.node, known.tables.rank
        main = np.take_along_axis(contacts.nodes, contacts.weights.argmax(axis=2)[..., None], 2)
        meshed, moves = contacts.body < 0, np.ones(contacts.body.shape, bool)
        sides, solid = np.empty(meshed.shape, np.int64), contacts.body[~meshed]
        sides[meshed] = rank[known.body_of_node[main[meshed, 0]]]
        sides[~meshed], moves[~meshed] = self._rank_of_rigid[solid], self._moves[solid]
        owner = owners_of_pairs(np.where(moves, sides, sides[:, ::-1]))
        moved = self._owners.take(contacts.key, owner)
        contacts, some_moved = hand_over(
            self._ranks, _on(contacts, lambda nodes: node[nodes]), owner, moved
        )
        return _on(contacts, lambda nodes: np.searchsorted(node, nodes)), some_moved

    def take_ghosts(
        self, interactions: Interactions, pairs: np.ndarray, known: KnownBodies
    ) -> None:
        """Take the ghosts that contacts between some bodies need.

        Args:
            pairs: shape (n, 2), bodies of `known` that may touch, rigid ones after them.
            known: what this rank knows now.
        """
        ranks, tables, me = self._ranks, known.tables, self._ranks.rank
        sides = np.concatenate([tables.rank, self._rank_of_rigid])[pairs]
        moves = np.concatenate([np.ones(len(tables.rank), bool), self._moves])[pairs].all(axis=1)
        which = np.concatenate([tables.which, MOST + np.arange(len(self._moves))])[pairs]
        cut = np.column_stack([which, sides])[moves & (sides[:, 0] != sides[:, 1])]
        other = np.where(cut[:, 2] == me, cut[:, 3], cut[:, 2])
        told = ranks.comm.alltoall([cut[other == rank] for rank in range(ranks.size)])
        pairs = np.unique(np.concatenate([cut, *told]), axis=0)
        own_slots = self._slots(known)
        # numbers of nodes, and of the two of each rigid body
        names = np.concatenate([tables.node, MOST + np.arange(2 * len(self._moves))])
        if ranks.max(float(not np.array_equal(pairs, self._pairs))) > 0.0:
            self._pairs = pairs
            rigid = MOST + np.repeat(np.arange(len(self._moves)), 2)
            bodies = np.concatenate([tables.which[known.body_of_node], rigid])
            ghosts, slots = ghosts_of_pairs(
                interactions, self._first, pairs[:, :2], pairs[:, 2:], own_slots, bodies
            )
            order = np.argsort(names[ghosts])
            self._ghosts = names[ghosts][order], slots[order]
        self.slot, (number, slot) = own_slots, self._ghosts
        there = np.isin(names, number)
        self.slot[there] = slot[np.searchsorted(number, names[there])]

    def _slots(self, known: KnownBodies) -> np.ndarray:
        """As `slot`, those of own nodes and rigid bodies alone."""
        count = len(known.own_node)
        slots = np.full(count + 2 * len(self._moves), -1)
        slots[:count][known.own_node] = self._own_slots
        slots[count + self._rigid_here] = self._rigid_slots
        return slots


def _on(contacts: Contacts, numbers: Callable[[np.ndarray], np.ndarray]) -> Contacts:
    """Contacts with other numbers of the nodes of their meshed sides."""
    body, nodes, *others = contacts
    named, meshed = np.zeros(nodes.shape, np.int64), body < 0
    named[meshed] = numbers(nodes[meshed])
    return Contacts(body, named, *others)
