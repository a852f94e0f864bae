# SPDX-License-Identifier: LGPL-3.0-or-later
"""Velocities of rigid bodies whose contacts are divided among ranks.

Every rank has the velocities of all bodies. While contacts are swept a rank moves its own bodies
and, in phases (`turns.py`), bodies of other ranks at the contacts that it owns. Before sweeps and
after them the velocities of all bodies are put together, the same bits on all ranks.

**A cell that stress drives** is moved by all contacts. Each of R ranks sweeps with a copy of
y = dF/dt that has the R-th part of its mass m (mass splitting, Tonge, Benevolenski and Voroshilov
2012), and after a sweep all take the mean of the copies,

    y_r = y + (R / m) sum of B r over the contacts of r,    mean of y_r = y + (1 / m) sum of B r,

B r what a contact with the impulse r gives the cell: the momentum of the cell is that of one rank.
As |sum of g_r|^2 <= R sum |g_r|^2 over the g_r that ranks give, what ranks minimise (impulses
without friction minimise r . W r / 2 + r . u) bounds that of one rank from above and touches it
where the last sweep has ended: each sweep brings it down, and where nothing changes any more the
copies are one.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.points import InteractionPoints
from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.ownership import owners_of_pairs
from xper_fx.parallel.rows_of_all import RowsOfAll
from xper_fx.parallel.turns import PhasesOfPairs, divide_in_phases, hand_overs
from xper_fx.support.ranks import Ranks

_NOTHING = np.zeros(0, bool)


class RigidHalo:
    """What the contacts of rigid bodies on one rank have to do with other ranks.

    It has what `Halo` has where contacts ask for it, in scenes of rigid bodies alone.

    Args:
        rank_of_body: shape (num_bodies,).
        moves: shape (num_bodies,), bool: which bodies contacts can move; others are everywhere.
        pairs: shape (n, 2), bodies that may come into contact, the same on all ranks.
        dofs: degrees of freedom of a body.
        common: shape (n,), bool: which degrees of freedom contacts move of blocks behind those of
            the bodies that every rank has; what contacts give these blocks is added up as that of
            bodies.

    Attributes:
        everywhere: exchange of the velocities of all bodies.
        turns: exchanges after the phases of a sweep, from 0 on; none where nothing is cut.
        numbers: shape (0,), of permanent points, of which there are none.
        cut: this rank's bodies that others move, and its ghosts.
        copies: of what is common, with a part of the mass each: one a rank where contacts move it.
    """

    def __init__(
        self,
        ranks: Ranks,
        rank_of_body: np.ndarray,
        moves: np.ndarray,
        pairs: np.ndarray,
        dofs: int,
        common: np.ndarray = _NOTHING,
    ):
        self.ranks, self._rank_of_body, self._moves = ranks, rank_of_body, moves
        self.numbers = np.zeros(0, np.int64)
        num_common = len(common) // dofs
        self.everywhere = RowsOfAll(ranks, np.pad(rank_of_body, (0, num_common)), dofs)
        self._of_bodies = RowsOfAll(ranks, rank_of_body, dofs)
        self._shared = len(rank_of_body) * dofs + np.flatnonzero(common)
        self.copies = ranks.size if len(self._shared) else 1
        sides = rank_of_body[pairs]
        cut = moves[pairs].all(axis=1) & (sides[:, 0] != sides[:, 1])
        own = cut & (owners_of_pairs(sides) == ranks.rank)
        phase, visits = divide_in_phases(ranks, pairs[own], sides[own])
        self._phase_of = PhasesOfPairs.of(pairs[own], phase)
        ways = hand_overs(ranks, visits, visits.unit)
        self.turns = [Exchange(ranks, given, taken, dofs) for given, taken in ways]
        met = [bodies for of in ways for way in of for bodies in way.values()]
        self.cut = np.unique(np.concatenate([self._shared // dofs, *met]))

    def phase_of(self, points: InteractionPoints) -> np.ndarray:
        """Phase of contacts, 0 where all that they move is here."""
        return self._phase_of(points.nodes[:, :, 0] // 2)

    def clear(self, values: np.ndarray) -> None:
        """Set bodies of other ranks to zero in a flat array over all slots."""
        self._of_bodies.clear(values)

    def add_up(self, velocity: np.ndarray) -> None:
        """Let all have the velocities to which each has added on its side, cleared before."""
        self._of_bodies.add_back(velocity)
        self.settle(velocity)

    def settle(self, velocity: np.ndarray) -> None:
        """Let all copies of what is common be their mean."""
        if self.copies > 1:
            velocity[self._shared] = self.ranks.sum(velocity[self._shared]) / self.copies

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Values at permanent points, of which there are none."""
        return values

    @property
    def nbytes(self) -> int:
        """Memory of what is exchanged and of where bodies are, in bytes."""
        own = (self._rank_of_body, self.cut)
        return sum(e.nbytes for e in self.turns) + sum(array.nbytes for array in own)

    @property
    def bytes_a_sweep(self) -> int:
        """Bytes of velocities that this rank sends in a sweep."""
        return sum(exchange.bytes_sent for exchange in self.turns)

    @property
    def bytes_a_gather(self) -> int:
        """Bytes of this rank's velocities when those of all bodies are put together."""
        return self.everywhere.bytes_sent
