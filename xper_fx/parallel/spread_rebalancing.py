# SPDX-License-Identifier: LGPL-3.0-or-later
"""When bodies of a mesh that is spread over ranks are divided among them anew.

As `rebalancing.py` has it for bodies that all ranks know. Here a rank counts what is its own, and
asks the keepers of numbers on which ranks other bodies are. Bodies are divided by the places where
they are now (`even_shares.bisected`), for which no rank has those of others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from xper_fx.bodies.even_shares import bisected
from xper_fx.bodies.keepers import Keepers
from xper_fx.parallel.local_bodies import LocalBodies
from xper_fx.parallel.rebalancing import Rebalancing, priced, weighed
from xper_fx.support.ranks import Ranks
from xper_fx.support.saved_rows import Rows


class SpreadRebalancing(Rebalancing):
    """As `Rebalancing`; all ranks call its methods together.

    Bodies have the numbers of `ContactForces.bodies`: meshed ones their labels, rigid ones come
    after all of these. A partition has the ranks of this rank's meshed bodies, then of all rigid
    ones.

    Args:
        part: this rank's meshed bodies.
        rank_of_rigid: shape (num_rigid,), int.
        moves, groups: as of `Rebalancing`.
    """

    def __init__(
        self,
        ranks: Ranks,
        part: LocalBodies,
        rank_of_rigid: np.ndarray,
        moves: np.ndarray,
        groups: np.ndarray,
    ):
        bodies = part.bodies
        rank_of_body = np.concatenate([np.full(bodies.num_bodies, ranks.rank), rank_of_rigid])
        cells = np.bincount(bodies.body_of_cell, minlength=bodies.num_bodies)
        super().__init__(ranks, rank_of_body, cells, moves, groups)
        self._body_of_cell, self._parent_cell = bodies.body_of_cell, bodies.parent_cell
        self._first_rigid = 1 + int(ranks.max(bodies.labels.max(initial=-1)))
        # this rank's among all that can move, and their numbers
        here = self._moves & (rank_of_body == ranks.rank)
        self._own = np.flatnonzero(here)
        rigid = self._first_rigid + np.arange(len(moves))
        self._number = np.concatenate([bodies.labels, rigid])[self._own]

    def look(
        self,
        points: np.ndarray,
        contacts: np.ndarray,
        near: np.ndarray,
        places: Callable[[], np.ndarray] | None = None,
    ) -> None:
        """As `Rebalancing.look`; all pairs are those of this rank alone.

        Args:
            points, contacts, near: numbers of bodies.
            places: gives the middles of this rank's meshed bodies, and of all rigid ones, as they
                are now, shape (num_bodies, dim), m.
        """
        self._places = places
        self._judge(*weighed(points, contacts, near))

    def saved(self) -> dict:
        """As of `Rebalancing`, meshed bodies by their cells."""
        meshed, rigid = np.split(self._next, [len(self._cells)])
        rows = Rows(self._parent_cell, meshed[self._body_of_cell])
        return super().saved() | {"rank_of_body": rigid, "rank_of_cell": rows}

    def other(self, saved: Mapping) -> np.ndarray | None:
        """As of `Rebalancing`."""
        if saved["ranks"] != self._ranks.size:
            return None
        of_cell, present = saved["rank_of_cell"][self._parent_cell], self.rank_of_body
        meshed = np.empty(len(self._cells), present.dtype)
        meshed[self._body_of_cell] = of_cell
        new = np.concatenate([meshed, np.asarray(saved["rank_of_body"], present.dtype)])
        return None if self._ranks.all(np.array_equal(new, present)) else new

    def _cost(self, rank_of_body: np.ndarray, pairs: np.ndarray, weights: np.ndarray) -> float:
        size = self._ranks.size
        named = np.union1d(self._number, pairs)
        keepers, rank = Keepers(self._ranks, named), np.full(len(named), size)
        rank[np.searchsorted(named, self._number)] = rank_of_body[self._own]
        rank = keepers.answer(keepers.min(rank))
        sides = rank[np.searchsorted(named, pairs)]
        sides = np.where(sides < size, sides, sides[:, ::-1])  # one is held, and on all ranks
        own = np.bincount(rank_of_body[: len(self._cells)], self._cells, size)
        return priced(sides, weights, self._ranks.sum(own), self._ranks)

    def _partition(self, pairs: np.ndarray, weights: np.ndarray) -> np.ndarray:
        named = np.union1d(self._number, pairs)
        keepers = Keepers(self._ranks, named)
        both, twice = np.searchsorted(named, pairs), np.repeat(weights, 2)
        work = np.bincount(both.ravel(), twice, len(named))
        work = keepers.answer(keepers.sum(work))[np.searchsorted(named, self._number)]
        meshed = self._own < len(self._cells)
        work[meshed] += 2 * self._cells
        # those that have to be on one rank go as one
        vertices, vertex = np.unique(self._vertex[self._own], return_inverse=True)
        count = np.bincount(vertex, minlength=len(vertices))
        middle = [np.bincount(vertex, x, len(vertices)) / count
                  for x in self._places()[self._own].T]  # fmt: skip
        work = np.maximum(np.bincount(vertex, work, len(vertices)), 1.0)
        rank = bisected(self._ranks, np.stack(middle, axis=1), work)[vertex]
        new = self.rank_of_body.copy()
        new[self._own] = rank
        rigid = new[len(self._cells) :]
        told = self._ranks.comm.allgather((self._own[~meshed] - len(self._cells), rank[~meshed]))
        for body, there in told:
            rigid[body] = there
        return new
