# SPDX-License-Identifier: LGPL-3.0-or-later
"""When meshed bodies, and rigid ones beside them, are divided among ranks anew.

Bodies stay where they are until that costs too much. What it costs is counted: a cell, a point on a
facet and a contact have weights, and so have a step and its exchanges. So all ranks come to the
same numbers, and so does a run that is repeated.

Every `_LOOKS_EVERY` steps the cost of the partition that there is (`division.cost_of_partition`) is
compared with the least that was seen since the last partition. What it is above that is added up
over the steps; where it comes to as much as `_PRICE` steps, which a division takes, bodies are
partitioned with the contacts that there are now. What is lost before is thus no more than what the
division costs (Karlin, Manasse, Rudolph and Sleator 1988 on snoopy caching). A partition that gains
less than `_WORTH` is not taken, and its cost is what can be reached.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from xper_fx.parallel.division import cost_of_partition, none_empty, partition_bodies
from xper_fx.parallel.ownership import ranks_of_pairs
from xper_fx.support.ranks import ALONE, Ranks

logger = logging.getLogger(__name__)

# Work of a point on a facet and of a contact over that of a cell; what a step has besides, and
# what its sweeps exchange where there are cuts.
_POINT, _CONTACT, _STEP, _EXCHANGES = 2, 30, 3000, 1000
# Steps after which the partition is looked at, as many as lists of pairs last.
_LOOKS_EVERY = 20
# Steps of the time that it takes to divide anew, and the least gain for which it is done.
_PRICE, _WORTH = 100.0, 0.1


class Rebalancing:
    """Tells when bodies should be on other ranks, and on which.

    Args:
        rank_of_body: shape (num_bodies,), int: meshed bodies first, then rigid ones.
        cells: shape (num_meshed,), of each meshed body.
        moves: shape (num_rigid,), bool: which rigid ones contacts can move; others are everywhere.
        groups: shape (num_rigid,), whole numbers: those that move and have the same are on one
            rank.

    Attributes:
        is_pending: whether bodies are to be divided anew before the next step.
        cost: of the partition when it was looked at last; 1 before.
        rank_of_body: that there is.
    """

    def __init__(
        self,
        ranks: Ranks,
        rank_of_body: np.ndarray,
        cells: np.ndarray,
        moves: np.ndarray,
        groups: np.ndarray,
    ):
        self._ranks, self.rank_of_body, self._cells = ranks, rank_of_body, cells
        self._next, self.is_pending = rank_of_body, False
        self._moves = np.concatenate([np.ones(len(cells), bool), moves])
        _, vertex = np.unique(groups[moves], return_inverse=True)
        self._vertex = np.full(len(self._moves), -1)
        self._vertex[: len(cells)] = np.arange(len(cells))
        self._vertex[np.flatnonzero(moves) + len(cells)] = len(cells) + vertex
        self._reached, self._lost, self.cost = np.inf, 0.0, 1.0

    def is_due(self, step: int) -> bool:
        """Whether the partition is to be looked at after a step."""
        return step % _LOOKS_EVERY == 0

    def look(self, points: np.ndarray, contacts: np.ndarray, near: np.ndarray) -> None:
        """Look at the partition; all ranks call it together.

        Args:
            points: shape (n, 2), bodies of the points that last, of all ranks.
            contacts: shape (m, 2), those of this rank's contacts.
            near: shape (k, 2), bodies that may touch soon, in the lists of this rank. Their ranks
                have to meet.
        """
        told = zip(*self._ranks.comm.allgather((contacts, near)), strict=True)
        contacts, near = map(np.concatenate, told)
        self._judge(*weighed(points, contacts, near))

    def _judge(self, pairs: np.ndarray, weights: np.ndarray) -> None:
        """Look at the partition by what there is between bodies, as of `weighed`."""
        self.cost = cost = self._cost(self.rank_of_body, pairs, weights)
        self._reached = min(self._reached, cost)
        self._lost += _LOOKS_EVERY * (cost - self._reached)
        if self._lost <= _PRICE:
            return
        new = self._partition(pairs, weights)
        reached = self._cost(new, pairs, weights)
        self.is_pending = better = reached < cost - _WORTH
        self._lost, self._reached = 0.0, reached if better else cost
        if self._ranks.rank == 0:
            told = "bodies are divided anew" if better else "bodies stay on their ranks"
            logger.info("%s: cost %.3g, was %.3g", told, reached, cost)
        if better:
            self._next = new

    def saved(self) -> dict:
        """Which rank has which bodies in the next step, and what has been lost since then."""
        return {
            "ranks": self._ranks.size, "rank_of_body": self._next,
            "reached": self._reached, "lost": self._lost,
        }  # fmt: skip

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, of this partition; of another number of ranks nothing."""
        if saved["ranks"] == self._ranks.size:
            self._reached, self._lost = saved["reached"], saved["lost"]

    def other(self, saved: Mapping) -> np.ndarray | None:
        """The partition of what `saved` gave, if it is another one of as many ranks."""
        if saved["ranks"] != self._ranks.size:
            return None
        rank_of_body = saved["rank_of_body"]
        return None if np.array_equal(rank_of_body, self.rank_of_body) else rank_of_body

    def _cost(self, rank_of_body: np.ndarray, pairs: np.ndarray, weights: np.ndarray) -> float:
        sides = ranks_of_pairs(rank_of_body, self._moves, pairs)
        own = np.bincount(rank_of_body[: len(self._cells)], self._cells, self._ranks.size)
        return priced(sides, weights, own)

    def _partition(self, pairs: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return self._ranks.from_first(lambda: self._partitioned(pairs, weights))

    def _partitioned(self, pairs: np.ndarray, weights: np.ndarray) -> np.ndarray:
        vertex, first = self._vertex, len(self._cells)
        work = np.zeros(vertex.max() + 1, np.int64)
        work[:first] = 2 * self._cells
        there = vertex[pairs] >= 0
        np.add.at(work, vertex[pairs][there], np.repeat(weights[:, None], 2, axis=1)[there])
        both = (vertex[pairs] >= 0).all(axis=1)
        exchanged = np.maximum(weights[both], 1)
        of_vertex = partition_bodies(
            np.maximum(work, 1), vertex[pairs[both]], exchanged, self._ranks.size
        )
        none_empty(of_vertex[:first], self._ranks.size)
        new = self.rank_of_body.copy()
        new[vertex >= 0] = of_vertex[vertex[vertex >= 0]]
        return new


def weighed(
    points: np.ndarray, contacts: np.ndarray, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of bodies, shape (n, 2), and the work between them, shape (n,)."""
    pairs = np.concatenate([points, contacts, near])
    return pairs, np.repeat([_POINT, _CONTACT, 0], [len(points), len(contacts), len(near)])


def priced(
    sides: np.ndarray, weights: np.ndarray, cells: np.ndarray, ranks: Ranks = ALONE
) -> float:
    """Cost of a partition, as `cost_of_partition`, by the cells of each rank."""
    return cost_of_partition(sides, weights, _STEP + cells, _EXCHANGES, ranks)
