# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts that a search finds between meshed bodies, divided among the ranks of these bodies.

A body stays on its rank, which looks for what its nodes touch (`search_division.py`).
A contact belongs to one of the ranks of its two bodies (`ownership.owners_of_pairs`), to which the
rank that has found it sends it. The owner has the other body as *ghosts* while the two may touch:
its velocities, and its block of w. When lists change, all ranks tell each other which bodies of two
ranks are in their lists; nothing else has to be said about who needs which ghosts. Rigid bodies
count as bodies of two nodes, numbered after the meshed ones; those that nothing moves are on every
rank, and their contacts on that of the other body. Pairs of lists have phases
(`turns.py`), and contacts those of their pairs.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.search.contact_pairs import Contacts, join
from xper_fx.parallel.halo import Halo
from xper_fx.parallel.ownership import owners_of_pairs, ranks_of_pairs
from xper_fx.parallel.rigid_share import RigidShare
from xper_fx.parallel.rows_of_all import RowsOfAll
from xper_fx.parallel.search_division import SearchDivision
from xper_fx.support.ranks import Ranks


class FoundOwners:
    """Which rank has which of the contacts that this rank finds, from step to step."""

    def __init__(self) -> None:
        self._found = self._committed = np.zeros((0, 2), np.int64), np.zeros(0, np.int64)

    def take(self, keys: np.ndarray, owner: np.ndarray) -> bool:
        """Take the contacts found in a step.

        Args:
            keys: shape (n, 2).
            owner: shape (n,), rank of each.

        Returns:
            Whether one of the step done last now belongs to another rank.
        """
        self._found = keys, owner
        keys, owner = map(np.concatenate, zip(self._committed, self._found, strict=True))
        order = np.lexsort(keys.T)
        same = (keys[order[1:]] == keys[order[:-1]]).all(axis=1)
        return bool((owner[order[1:]] != owner[order[:-1]])[same].any())

    def commit(self) -> None:
        """The contacts found last are those of a step that is done."""
        self._committed = self._found


def hand_over(
    ranks: Ranks, contacts: Contacts, owner: np.ndarray, moved: bool
) -> tuple[Contacts, bool]:
    """Send contacts to the ranks that have them; all ranks call it together.

    Args:
        contacts: those that this rank has found in a step.
        owner: shape (n,), rank of each.
        moved: told to all.

    Returns:
        This rank's contacts, sorted by key, and whether something has moved on any rank.
    """
    told = []
    for rank in range(ranks.size):
        theirs = np.flatnonzero(owner == rank) if rank != ranks.rank else ()
        told.append((moved, contacts.take(theirs) if len(theirs) else None))
    got = ranks.comm.alltoall(told)
    parts = [contacts.take(np.flatnonzero(owner == ranks.rank))]
    parts += [part for _, part in got if part is not None]
    return join(parts), any(moved for moved, _ in got)


def ghosts_of_pairs(
    interactions: Interactions,
    first: Halo,
    pairs: np.ndarray,
    sides: np.ndarray,
    slot: np.ndarray,
    body_of_node: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Let a layer take a halo with the ghosts that contacts need; all ranks call it together.

    Args:
        first: its halo for its permanent points alone.
        pairs: shape (n, 2), bodies of two ranks that may touch, by names that all ranks know.
        sides: shape (n, 2), ranks of these bodies.
        slot: shape (num_nodes,), own slots of nodes, -1 elsewhere.
        body_of_node: shape (num_nodes,), names of the bodies of nodes that something may touch.

    Returns:
        Which nodes are ghosts, and their slots.
    """
    me, owner, given, ghosts = first.ranks.rank, owners_of_pairs(sides), {}, {}
    mine = (sides == me).any(axis=1)
    for other in np.setdiff1d(sides[mine], [me]).tolist():
        met = mine & (sides == other).any(axis=1)
        for rank, of, nodes in ((other, me, given), (me, other, ghosts)):
            here = met & (owner == rank)
            there = np.flatnonzero(np.isin(body_of_node, pairs[here][sides[here] == of]))
            if len(there):
                nodes[other] = there
    before = interactions.halo
    more = {rank: slot[nodes] for rank, nodes in given.items()}
    halo = first.extended(interactions.own_inverse, more)
    moved = np.arange(before.num_slots + 1)
    moved[-1] = halo.num_slots
    for rank, slots in first.wanted.items():
        moved[before.wanted[rank][: len(slots)]] = halo.wanted[rank][: len(slots)]
    interactions.take_halo(halo, moved)
    none = np.zeros(0, np.int64)
    nodes = np.concatenate([none, *ghosts.values()])
    slots = np.concatenate([none, *(halo.wanted[r][-len(n) :] for r, n in ghosts.items())])
    unit_of_slot, own, here = np.full(halo.num_slots, -1), owner == me, slot >= 0
    unit_of_slot[slot[here]] = body_of_node[here]
    unit_of_slot[slots] = body_of_node[nodes]
    halo.divide_pairs(pairs[own], sides[own], unit_of_slot)
    return nodes, slots


class SurfaceDivision:
    """What a rank has of the surfaces of all bodies.

    Args:
        rank_of_body: shape (num_bodies,), int.
        body_of_node: shape (num_nodes,), body of each node of the surfaces.
        touchable: shape (num_nodes,), bool: at which of them contacts may come about.
        dim: 2 or 3.
        rigid: this rank's share of rigid bodies, None without any.

    Attributes:
        ranks: as given.
        own: nodes of this rank's bodies, ascending.
        search: this rank's share of the search.
        slot: shape (num_nodes + 2 num_rigid,), their slots, the two of each rigid body after them,
            and those of the ghosts that there are now; others mean nothing.
    """

    def __init__(
        self,
        ranks: Ranks,
        rank_of_body: np.ndarray,
        body_of_node: np.ndarray,
        touchable: np.ndarray,
        dim: int,
        rigid: RigidShare | None = None,
    ):
        self.ranks, self._rigid = ranks, rigid
        rank_of_node = rank_of_body[body_of_node]
        self.own = np.flatnonzero(rank_of_node == ranks.rank)
        self._rows = RowsOfAll(ranks, rank_of_node, dim)
        rank_of_rigid, moves = np.zeros(0, np.int32), np.zeros(0, bool)
        if rigid is not None:
            rank_of_rigid, moves = rigid.rank_of_body, rigid.moves
        self.search = SearchDivision(ranks, rank_of_body, body_of_node, dim, rank_of_rigid)
        first, count = len(rank_of_body), len(moves)
        self._num_nodes = len(body_of_node)
        self._rank_of_body = np.concatenate([rank_of_body, rank_of_rigid])
        self._moves = np.concatenate([np.ones(first, bool), moves])
        own_nodes = first + np.repeat(np.arange(count), 2)
        self._body_of_node = np.concatenate([np.where(touchable, body_of_node, -1), own_nodes])
        self.slot = np.full(len(self._body_of_node), -1)
        self._pairs = np.zeros((0, 2), np.int64)
        self._owners = FoundOwners()

    def owns(self, bodies: np.ndarray) -> np.ndarray:
        """Whether what is between two bodies is this rank's, of pairs of shape (n, 2), (n,)."""
        return owners_of_pairs(self._rank_of_body[bodies]) == self.ranks.rank

    def fill_in(self, values: np.ndarray) -> None:
        """Put what all ranks have at their nodes into values at all nodes, shape (n, dim)."""
        self._rows.forward(values.reshape(-1))

    def begin(self, interactions: Interactions, slots: np.ndarray) -> None:
        """Take the layer of points, and the slots of `own`, -1 where nothing can touch a node."""
        self._first: Halo = interactions.halo
        self.slot[self.own] = slots
        if self._rigid is not None:
            nodes = self._num_nodes + 2 * self._rigid.here[:, None] + np.arange(2)
            first = interactions.bulk_inverse.num_nodes
            self.slot[nodes] = first + np.arange(nodes.size).reshape(nodes.shape)

    @property
    def slot_of_rigid(self) -> np.ndarray:
        """First slot of each rigid body, shape (num_rigid,)."""
        return self.slot[self._num_nodes :: 2]

    def hand_over(self, contacts: Contacts, bodies: np.ndarray) -> tuple[Contacts, bool]:
        """Send contacts to the ranks that have them; all ranks call it together.

        Args:
            contacts: those that this rank has found in a step.
            bodies: shape (n, 2), of their sides; rigid ones are numbered after meshed ones.

        Returns:
            This rank's contacts, sorted by key, and whether, on any rank, a contact of the step
            done last now belongs to another one. So it may be where several bodies are one
            fragment: a node slides from one to the next.
        """
        owner = owners_of_pairs(ranks_of_pairs(self._rank_of_body, self._moves, bodies))
        return hand_over(self.ranks, contacts, owner, self._owners.take(contacts.key, owner))

    def commit(self) -> None:
        """The contacts found last are those of a step that is done."""
        self._owners.commit()

    def take_ghosts(self, interactions: Interactions, pairs: np.ndarray) -> None:
        """Take the ghosts that contacts between some bodies need; all ranks call it together.

        Args:
            pairs: shape (n, 2), bodies that may touch, in the lists of this rank, numbered as in
                `hand_over`.
        """
        sides = self._rank_of_body[pairs]
        cut = pairs[(sides[:, 0] != sides[:, 1]) & self._moves[pairs].all(axis=1)]
        pairs = np.unique(np.concatenate(self.ranks.comm.allgather(cut)), axis=0)
        sides = self._rank_of_body[pairs]
        if np.array_equal(pairs, self._pairs):
            return
        self._pairs = pairs
        own_slots = np.where(self.slot < interactions.own_inverse.num_nodes, self.slot, -1)
        ghosts, slots = ghosts_of_pairs(
            interactions, self._first, pairs, sides, own_slots, self._body_of_node
        )
        self.slot[ghosts] = slots
