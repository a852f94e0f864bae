# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which rank has which rigid bodies and contacts, as bodies move.

Every rank has the state of all bodies and moves all of them, by the same operations on the same
bits: a few hundred bytes a body, and little work. The list of pairs that may touch soon is made on
every rank, too. What costs is divided: each pair of that list is searched for contacts by one rank,
which sweeps over them.

Bodies are partitioned as a graph whose edges are the pairs of the list. A pair weighs what its
search costs, and `_CONTACT` more for each contact found last; a body weighs what its pairs do. The
list is looked at anew whenever it has been made anew. Bodies are partitioned again where

    cost = max_r work_r / mean_r work_r + cut / work,

the slowest rank's share and the share of the weight that lies between ranks, has grown by `_GROWN`
since the last partition: that one is what can be reached, however well balanced it is, so that
ranks do not partition again and again in vain.

With fewer pairs than `_FEW` a rank messages would cost more than they save: each rank has all.
"""

from __future__ import annotations

import logging

import numpy as np

from xper_fx.parallel.ownership import owners_of_pairs
from xper_fx.parallel.partition import partition_bodies
from xper_fx.parallel.ranks import Ranks
from xper_fx.parallel.rigid_halo import RigidHalo

logger = logging.getLogger(__name__)

# Pairs a rank below which it pays not to divide them, and share of that at which divided ones are
# put together again.
_FEW, _FEWER = 1000, 0.5
# Weight of a contact over that of a pair: sweeps over one search.
_CONTACT = 10
# Growth of the cost at which bodies are partitioned again.
_GROWN = 0.2


class RigidDivision:
    """Divides rigid bodies among ranks.

    Args:
        ranks: the ranks.
        moves: shape (num_bodies,), bool: which bodies contacts can move.
        dim: dimension of space.

    Attributes:
        halo: what contacts have to do with other ranks, None where each rank has all.
        rank_of_body: shape (num_bodies,), int32; bodies that do not move are on the first.
        partitions: how often bodies have been partitioned.
        moved: how many bodies have changed their rank since the start.
    """

    def __init__(self, ranks: Ranks, moves: np.ndarray, dim: int):
        self.ranks, self._moves, self._dofs = ranks, moves, 2 * dim
        self.halo: RigidHalo | None = None
        self.rank_of_body = np.zeros(len(moves), np.int32)
        self.partitions = self.moved = 0
        self._contacts = np.empty((0, 2), np.int32)
        self._reached = np.inf
        # partition under which the contacts were found, None where each rank has all
        self._found_by: np.ndarray | None = None

    def own(self, pairs: np.ndarray) -> np.ndarray:
        """Which pairs of a new list this rank searches; all ranks call it together.

        Args:
            pairs: shape (n, 2), bodies that may touch soon, the same on all ranks.

        Returns:
            Shape (n,), bool.
        """
        moving = pairs[self._moves[pairs].all(axis=1)]
        least = _FEW * self.ranks.size * (1.0 if self.halo is None else _FEWER)
        if len(moving) < least or np.count_nonzero(self._moves) < self.ranks.size:
            self.halo = None
            return np.ones(len(pairs), bool)
        weighed, weights = self._weighed(pairs)
        cost = self._cost(self.rank_of_body, weighed, weights)
        if self.halo is None or cost > self._reached + _GROWN:
            self._partition(weighed, weights, cost)
        self.halo = RigidHalo(self.ranks, self.rank_of_body, self._moves, moving, self._dofs)
        return self._owner(self.rank_of_body, pairs) == self.ranks.rank

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

    def _weighed(self, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs and their contacts, on all ranks, and what they weigh."""
        contacts = self._contacts
        if self._found_by is not None:
            contacts = np.concatenate(self.ranks.comm.allgather(contacts))
        weights = np.repeat([1, _CONTACT], [len(pairs), len(contacts)])
        return np.concatenate([pairs, contacts]), weights

    def _owner(self, rank_of_body: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Rank of each pair: that of the only body that moves, or one of both."""
        sides = rank_of_body[pairs]
        still = ~self._moves[pairs]
        sides = np.where(still, sides[:, ::-1], sides)
        return owners_of_pairs(sides)

    def _cost(self, rank_of_body, pairs, weights) -> float:
        work = np.bincount(self._owner(rank_of_body, pairs), weights, self.ranks.size)
        both = self._moves[pairs].all(axis=1)
        sides = rank_of_body[pairs]
        cut = weights[both & (sides[:, 0] != sides[:, 1])].sum()
        return work.max() / work.mean() + cut / work.sum()

    def _partition(self, pairs, weights, cost: float) -> None:
        count = len(self._moves)
        moving = np.flatnonzero(self._moves)
        number = np.cumsum(self._moves) - 1
        of_body = np.bincount(pairs.ravel(), np.repeat(weights, 2), count)[moving]
        both = self._moves[pairs].all(axis=1)

        def part() -> np.ndarray:
            return partition_bodies(
                1 + of_body.astype(np.int64), number[pairs[both]], weights[both], self.ranks.size
            )

        new = self.rank_of_body.copy()
        new[moving] = self.ranks.comm.bcast(part() if self.ranks.rank == 0 else None)
        self.partitions += 1
        reached = self._cost(new, pairs, weights)
        if self.halo is None or reached < cost:
            self.moved += int(np.count_nonzero(new != self.rank_of_body))
            self.rank_of_body = new
        self._reached = min(reached, cost)
        logger.info(
            "partition %d of rigid bodies: cost %.3g, was %.3g", self.partitions, reached, cost
        )
