# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which rank has which rigid bodies and contacts, as bodies move.

Every rank has the state of all bodies and moves all of them, by the same operations on the same
bits: a few hundred bytes a body, and little work. The list of pairs that may touch soon is made on
every rank, too. What costs is divided: each pair of that list is searched for contacts by one rank,
which sweeps over them.

Bodies are partitioned as a graph whose edges are the pairs of the list. A pair weighs what its
search costs, and `_CONTACT` more for each contact found last; a body weighs what its pairs do. The
partition is looked at anew whenever the list has been made anew. Bodies are partitioned again where
the cost of a sweep (`division.cost_of_partition`) has grown by `_GROWN` since the last partition:
what was reached then is what can be reached, so that ranks do not partition again and again in
vain. A partition that is no better is not taken.

Bodies that joints join stay together: they are one vertex of the graph.

With fewer pairs than `_FEW` a rank messages would cost more than they save: each rank has all.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from xper_fx.parallel.division import cost_of_partition, partition_bodies
from xper_fx.parallel.ownership import owners_of_pairs, ranks_of_pairs
from xper_fx.parallel.rigid_halo import RigidHalo
from xper_fx.support.ranks import Ranks

logger = logging.getLogger(__name__)

# Pairs a rank below which it pays not to divide them, and share of that at which divided ones are
# put together again. A sweep visits ten thousand contacts in about the time of its messages.
_FEW, _FEWER = 10_000, 0.5
# Weight of a contact over that of a pair: sweeps over one search.
_CONTACT = 10
# Growth of the cost at which bodies are partitioned again.
_GROWN = 0.1


class RigidDivision:
    """Divides rigid bodies among ranks.

    Args:
        moves: shape (num_bodies,), bool: which bodies contacts can move.
        groups: shape (num_bodies,), whole numbers: bodies that move and have the same one are on
            one rank.
        common: as of `RigidHalo`.

    Attributes:
        halo: what contacts have to do with other ranks, None where each rank has all.
        rank_of_body: shape (num_bodies,), int32; bodies that do not move are on the first.
        partitions: how often bodies have been partitioned.
        moved: how many bodies have changed their rank since the start.
    """

    def __init__(
        self, ranks: Ranks, moves: np.ndarray, dim: int, groups: np.ndarray, common: np.ndarray
    ):
        self.ranks, self._moves = ranks, moves
        self._dofs, self._common = 2 * dim, common
        names, self._group_of_moving = np.unique(groups[moves], return_inverse=True)
        self._num_groups = len(names)
        self.halo: RigidHalo | None = None
        self.rank_of_body = np.zeros(len(moves), np.int32)
        self.partitions = self.moved = 0
        self._contacts = np.empty((0, 2), np.int32)
        self._reached = np.inf
        # partition under which the contacts were found, None where each rank has all
        self._found_by: np.ndarray | None = None
        # whether the next list is divided, as that of a saved run was; None where nothing was saved
        self._as_saved: bool | None = None

    def own(self, pairs: np.ndarray) -> np.ndarray:
        """Which pairs of a new list this rank searches; all ranks call it together.

        Args:
            pairs: shape (n, 2), bodies that may touch soon, the same on all ranks.

        Returns:
            Shape (n,), bool.
        """
        moving = pairs[self._moves[pairs].all(axis=1)]
        as_saved, self._as_saved = self._as_saved, None
        if not (self._are_many(moving) if as_saved is None else as_saved):
            self.halo = None
            return np.ones(len(pairs), bool)
        if as_saved is None:
            weighed, weights = self._weighed(pairs)
            cost = self._cost(self.rank_of_body, weighed, weights)
            if self.halo is None or cost > self._reached + _GROWN:
                self._partition(weighed, weights, cost)
        self.halo = RigidHalo(
            self.ranks, self.rank_of_body, self._moves, moving, self._dofs, self._common
        )
        sides = ranks_of_pairs(self.rank_of_body, self._moves, pairs)
        return owners_of_pairs(sides) == self.ranks.rank

    def found(self, bodies: np.ndarray) -> bool:
        """Take note of the contacts found; all ranks call it together.

        Args:
            bodies: shape (n, 2), of this rank's contacts.

        Returns:
            Whether contacts of the last step have to be told to all ranks, as others have them now.
        """
        self._contacts = bodies
        before, self._found_by = self._found_by, None if self.halo is None else self.rank_of_body
        return before is not None and before is not self._found_by

    def join(self) -> None:
        """Let each rank have all until a new list is made."""
        self.halo = None

    def saved(self) -> dict:
        """Which rank has which bodies, whether that is used now, and what its partition reached.

        All ranks call it together: the contacts found last weigh in the next partition.
        """
        return {
            "contacts": self._all_contacts(),
            "ranks": self.ranks.size,
            "divided": int(self.halo is not None),
            "rank_of_body": self.rank_of_body,
            "reached": self._reached,
        }

    def restore(self, saved: Mapping) -> None:
        """Divide the next list as `saved` tells; another number of ranks divides it anew."""
        if saved["ranks"] == self.ranks.size:
            self.rank_of_body, self._reached = saved["rank_of_body"], saved["reached"]
            self._as_saved = bool(saved["divided"])
            self._contacts, self._found_by = saved["contacts"], None

    def _are_many(self, moving: np.ndarray) -> bool:
        """Whether there is enough to divide."""
        least = _FEW * self.ranks.size * (1.0 if self.halo is None else _FEWER)
        enough = self._num_groups >= self.ranks.size
        return enough and len(moving) >= max(least, 1)

    def _weighed(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs and their contacts, on all ranks, and what they weigh."""
        contacts = self._all_contacts()
        weights = np.repeat([1, _CONTACT], [len(pairs), len(contacts)])
        return np.concatenate([pairs, contacts]), weights

    def _all_contacts(self) -> np.ndarray:
        """Bodies of the contacts found last, by all ranks, shape (n, 2)."""
        if self._found_by is None:
            return self._contacts
        return np.concatenate(self.ranks.comm.allgather(self._contacts))

    def _cost(self, rank_of_body, pairs, weights) -> float:
        sides = ranks_of_pairs(rank_of_body, self._moves, pairs)
        return cost_of_partition(sides, weights, np.zeros(self.ranks.size))

    def _partition(self, pairs, weights, cost: float) -> None:
        count = len(self._moves)
        moving, group_of = np.flatnonzero(self._moves), np.full(count, -1)
        group_of[moving] = self._group_of_moving
        of_body = 1 + np.bincount(pairs.ravel(), np.repeat(weights, 2), count)[moving]
        of_group = np.bincount(self._group_of_moving, of_body).astype(np.int64)
        both = self._moves[pairs].all(axis=1)
        given = of_group, group_of[pairs[both]], weights[both], self.ranks.size
        new = self.rank_of_body.copy()
        rank_of_group = self.ranks.from_first(lambda: partition_bodies(*given))
        new[moving] = rank_of_group[self._group_of_moving]
        self.partitions += 1
        reached = self._cost(new, pairs, weights)
        if self.halo is None or reached < cost:
            self.moved += int(np.count_nonzero(new != self.rank_of_body))
            self.rank_of_body = new
        self._reached = min(reached, cost)
        logger.info(
            "partition %d of rigid bodies: cost %.3g, was %.3g", self.partitions, reached, cost
        )
