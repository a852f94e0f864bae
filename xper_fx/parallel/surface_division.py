# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts that a search finds between meshed bodies, divided among the ranks of these bodies.

A body stays on its rank. Every rank knows where all nodes of all surfaces are, which are few beside
those of the volumes unless each cell is a body, and so finds the same pairs of bodies that may
touch and the same contacts.
A contact belongs to one of the ranks of its two bodies (`ownership.owners_of_pairs`), which has
the other body as *ghosts* while the two may touch: its velocities, and its block of w. Nothing has
to be said about who needs which ghosts, as all ranks know all pairs. Which pairs of ranks meet in
which phase (`ownership.phases`) only grows, so that points that last stay in their phase.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.parallel.halo import Halo
from xper_fx.parallel.ownership import owners_of_pairs, phases
from xper_fx.parallel.rows_of_all import RowsOfAll
from xper_fx.support.ranks import Ranks


class SurfaceDivision:
    """What a rank has of the surfaces of all bodies.

    Args:
        ranks: the ranks.
        rank_of_body: shape (num_bodies,), int.
        body_of_node: shape (num_nodes,), body of each node of the surfaces.
        touchable: shape (num_nodes,), bool: at which of them contacts may come about.
        dim: 2 or 3.

    Attributes:
        ranks: as given.
        own: nodes of this rank's bodies, ascending.
        slot: shape (num_nodes,), their slots and those of the ghosts that there are now; others
            mean nothing.
    """

    def __init__(
        self,
        ranks: Ranks,
        rank_of_body: np.ndarray,
        body_of_node: np.ndarray,
        touchable: np.ndarray,
        dim: int,
    ):
        self.ranks, self._rank_of_body, self._body_of_node = ranks, rank_of_body, body_of_node
        self._touchable = touchable
        rank_of_node = rank_of_body[body_of_node]
        self.own = np.flatnonzero(rank_of_node == ranks.rank)
        self._rows = RowsOfAll(ranks, rank_of_node, dim)
        self._shape = len(body_of_node), dim
        self.slot = np.full(len(body_of_node), -1)
        self._pairs = np.zeros((0, 2), np.int64)
        self._found = self._committed = np.zeros((0, 2), np.int64), np.zeros(0, np.int64)

    def of_all(self, own: np.ndarray) -> np.ndarray:
        """Values at all nodes, shape (num_nodes, dim), from those at this rank's `own`."""
        values = np.empty(self._shape)
        values[self.own] = own
        self._rows.forward(values.reshape(-1))
        return values

    def begin(self, interactions: Interactions, slots: np.ndarray) -> None:
        """Take the layer of points, and the slots of `own`, -1 where nothing can touch a node."""
        self._first: Halo = interactions.halo
        self.slot[self.own] = slots
        self._meetings = self._first.meetings

    def own_of(self, keys: np.ndarray, bodies: np.ndarray) -> np.ndarray:
        """Which contacts are this rank's.

        Args:
            keys: shape (n, 2), of the contacts of all ranks, found in a step.
            bodies: shape (n, 2).

        Returns:
            Shape (n,), bool.
        """
        owner = owners_of_pairs(self._rank_of_body[bodies])
        self._found = keys, owner
        return owner == self.ranks.rank

    def commit(self) -> None:
        """The contacts found last are those of a step that is done."""
        self._committed = self._found

    def some_moved(self) -> bool:
        """Whether a contact of the step done last now belongs to another rank.

        So it may be where several bodies are one fragment: a node slides from one to the next.
        """
        keys, owner = map(np.concatenate, zip(self._committed, self._found, strict=True))
        order = np.lexsort(keys.T)
        same = (keys[order[1:]] == keys[order[:-1]]).all(axis=1)
        return bool((owner[order[1:]] != owner[order[:-1]])[same].any())

    def take_ghosts(self, interactions: Interactions, pairs: np.ndarray) -> None:
        """Take the ghosts that contacts between some bodies need; all ranks call it together.

        Args:
            interactions: the layer.
            pairs: shape (n, 2), bodies that may touch, the same on all ranks, sorted.
        """
        sides = self._rank_of_body[pairs]
        cut = sides[:, 0] != sides[:, 1]
        pairs, sides = pairs[cut], sides[cut]
        if np.array_equal(pairs, self._pairs):
            return
        self._pairs = pairs
        me, owner = self.ranks.rank, owners_of_pairs(sides)
        self._meetings = phases(sides, self.ranks.size, self._meetings)
        given, ghosts = {}, {}
        for other in np.setdiff1d(sides[(sides == me).any(axis=1)], [me]).tolist():
            met = (np.sort(sides, axis=1) == sorted((me, other))).all(axis=1)
            for rank, of, nodes in ((other, me, given), (me, other, ghosts)):
                here = met & (owner == rank)
                nodes[other] = self._nodes_of(pairs[here][sides[here] == of])
        given = {rank: self.slot[nodes] for rank, nodes in given.items() if len(nodes)}
        before, first = interactions.halo, self._first
        halo = first.extended(interactions.bulk_inverse, given, self._meetings)
        moved = np.arange(before.num_slots + 1)
        moved[-1] = halo.num_slots
        for rank, slots in first.wanted.items():
            moved[before.wanted[rank][: len(slots)]] = halo.wanted[rank][: len(slots)]
        for rank, nodes in ghosts.items():
            if len(nodes):
                self.slot[nodes] = halo.wanted[rank][-len(nodes) :]
        interactions.take_halo(halo, moved)

    def _nodes_of(self, bodies: np.ndarray) -> np.ndarray:
        """Nodes of bodies that something may touch, ascending."""
        return np.flatnonzero(self._touchable & np.isin(self._body_of_node, bodies))

    def saved(self) -> dict:
        """In which phase ranks meet, which hangs on all that was near before."""
        return {"meetings": self._meetings}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, of as many ranks; another number of ranks meets anew."""
        if saved["meetings"].shape == self._meetings.shape:
            self._meetings = saved["meetings"]
