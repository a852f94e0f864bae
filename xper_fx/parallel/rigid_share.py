# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies beside meshed ones that ranks divide.

Every rank has the state of all rigid bodies and moves all of them by the same operations on the
same bits. A body that contacts can move is on one rank, that of the meshed body next to it, where
its velocity stands beside those of meshed bodies; other ranks have it as a ghost while their bodies
may touch it. After a solution all ranks are told all velocities. Bodies that nothing moves are on
every rank.

Where rigid bodies may touch each other, those that move are all on one rank, which has the contacts
between them. So are those that joints join, on one of the ranks.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bodies.explode import Bodies
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.parallel.local_bodies import boxes_of
from xper_fx.parallel.rows_of_all import RowsOfAll
from xper_fx.support.ranks import Ranks


class RigidShare:
    """A rank's share of the rigid bodies.

    Args:
        rank_of_body: shape (num_rigid,), int.
        moves: shape (num_rigid,), bool: which of them contacts can move.
        dim: 2 or 3.

    Attributes:
        rank_of_body, moves: as given.
        here: bodies with slots among this rank's own, ascending.
        is_home: whether this rank has the contacts between rigid bodies.
    """

    def __init__(self, ranks: Ranks, rank_of_body: np.ndarray, moves: np.ndarray, dim: int):
        self.rank_of_body, self.moves = rank_of_body, moves
        home = int(rank_of_body[moves][0]) if moves.any() else 0
        self._ranks, self._home, self.is_home = ranks, home, ranks.rank == home
        self.here = np.flatnonzero(~moves | (rank_of_body == ranks.rank))
        self._rows = RowsOfAll(ranks, rank_of_body, 2 * dim)
        self._shape = len(moves), 2 * dim

    def of_all(self, rows: np.ndarray) -> np.ndarray:
        """Velocities of all bodies, shape (num_rigid, 2 dim), from those of `here`."""
        return self._put_together(rows, self._rows.forward)

    def sum(self, rows: np.ndarray) -> np.ndarray:
        """Impulses on all bodies, shape (num_rigid, 2 dim), from those this rank has on `here`."""
        return self._put_together(rows, self._rows.add_back)

    def from_home(self, value):
        """What the rank that has the contacts between rigid bodies gives."""
        return self._ranks.comm.bcast(value, self._home)

    def _put_together(self, rows: np.ndarray, exchange) -> np.ndarray:
        values = np.zeros(self._shape)
        values[self.here] = rows
        exchange(values.reshape(-1))
        return values


def share_rigid(
    rigid: RigidBodies,
    meshed: Bodies,
    rank_of_meshed: np.ndarray,
    ranks: Ranks,
    groups: np.ndarray,
) -> RigidShare:
    """Give each rigid body to the rank of the meshed body whose box is next to its centre.

    Those that move and are of one group are where the first of them is.

    Args:
        meshed: the meshed ones.
        rank_of_meshed: shape (num_meshed,).
        groups: shape (num_rigid,), whole numbers.
    """
    dim, moves = rigid.dim, ~rigid.is_prescribed.all(axis=1)
    low, high = boxes_of(meshed)
    rank, least = np.zeros(len(rigid), np.int32), np.full(len(rigid), np.inf)
    for body, centre in enumerate(rigid.position if len(low) else ()):
        beside = np.maximum(np.maximum(low - centre, centre - high), 0.0)
        squared = (beside**2).sum(axis=1)
        nearest = np.argmin(squared)
        rank[body], least[body] = rank_of_meshed[nearest], squared[nearest]
    if meshed.spread is not None:  # each rank knows those around its own
        closest = np.argmin(ranks.comm.allgather(least), axis=0)
        rank = np.array(ranks.comm.allgather(rank))[closest, np.arange(len(rigid))]
    _, first, group = np.unique(groups[moves], return_index=True, return_inverse=True)
    rank[moves] = rank[moves][first][group]
    return RigidShare(ranks, rank, moves, dim)
