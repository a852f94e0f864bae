# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ghost velocities at the cuts between ranks.

A rank's interactions act on the slots of its own nodes and on *ghosts*: the slots of other ranks'
bodies at its points, with their blocks of w. Ghosts follow their owners (`exchange.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.points import InteractionPoints
from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.turns import (
    NO_VISITS,
    PhasesOfPairs,
    Visits,
    divide_in_phases,
    hand_overs,
)
from xper_fx.support.ranks import Ranks

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from xper_fx.nscd.interactions import Interactions
    from xper_fx.parallel.coupled_rows import SharedCoupledSystem
    from xper_fx.parallel.cut_clusters import CutClusters, CutNodes
    from xper_fx.parallel.whole_matrix import WholeMatrix


# More than a rank has blocks.
_MOST = 2**40


class Halo:
    """What a rank's interactions have to do with other ranks.

    Args:
        inverse: blocks of w on this rank's slots.
        given: own slots that other ranks want as ghosts, by rank.
        numbers: shape (num_points,), numbers of this rank's points in the whole scene.
        at_points: by rank, which of `given` and of `wanted` are nodes of points, others being of
            their lips alone; None where all are, or nobody asks.

    Attributes:
        phase: shape (num_points,), phase of each point, 0 until `divide` gives them others.
        wanted: slots of the nodes that other ranks gave, by rank, in the order they were asked for.
        everywhere: exchange with all ranks.
        corners: exchange of what permanent points ask for.
        turns: exchanges after the phases of a sweep, from 0 on; none where nothing is cut.
        copies: of what is on every rank; see `RigidHalo`.
    """

    copies = 1

    def __init__(
        self,
        ranks: Ranks,
        inverse: BodyInverse,
        given: Mapping[int, np.ndarray],
        numbers: np.ndarray,
        at_points: tuple[Mapping[int, np.ndarray], Mapping[int, np.ndarray]] | None = None,
    ):
        self.ranks, self.numbers = ranks, numbers
        self.phase = np.zeros(len(numbers), np.int64)
        self._given, self._at_points = given, at_points
        blocks_of = inverse.block_of_node
        self._blocks = {rank: np.unique(blocks_of[slots]) for rank, slots in given.items()}
        sizes = np.diff(inverse.node_offsets)
        self._own_blocks = len(sizes) - 1
        self._visits = NO_VISITS
        self._phase_of: PhasesOfPairs | None = None
        told = [None] * ranks.size
        all_given = {}
        for rank, blocks in self._blocks.items():
            ranges = [
                np.arange(inverse.node_offsets[b], inverse.node_offsets[b + 1]) for b in blocks
            ]
            all_given[rank] = np.concatenate(ranges)
            place = np.searchsorted(all_given[rank], given[rank])
            told[rank] = (blocks, sizes[blocks], place)
        answers = ranks.comm.alltoall(told)
        ghosts: dict[int, np.ndarray] = {}
        self.wanted: dict[int, np.ndarray] = {}
        self._sizes = []
        own = ranks.rank * _MOST + np.arange(self._own_blocks)
        names, at = [np.repeat(own, sizes[:-1])], inverse.num_nodes
        for rank, answer in enumerate(answers):
            if answer is None:
                continue
            blocks, counts, place = answer
            ghosts[rank] = at + np.arange(counts.sum())
            self.wanted[rank] = at + place
            self._sizes.append(counts)
            names.append(np.repeat(rank * _MOST + blocks.astype(np.int64), counts))
            at += int(counts.sum())
        self._dim = dim = inverse.dim
        self.everywhere = self.corners = Exchange(ranks, all_given, ghosts, dim)
        if at_points is not None:
            self.corners = self._exchange_at_points(self.wanted)
        self._first, self._last = inverse.num_nodes * dim, at * dim
        self._name_of_slot = np.concatenate(names)  # that of its block, on all ranks
        self.turns: list[Exchange] = []

    def divide(self, points: InteractionPoints) -> None:
        """Give the permanent points their phases; all ranks call it together.

        Args:
            points: on these slots.
        """
        names = np.append(self._name_of_slot, -1)
        slots = points.nodes.reshape(len(points), 2 * points.nodes.shape[2])
        names = names[np.minimum(slots, self.num_slots)]
        homes = np.where(names < 0, self.ranks.rank, names // _MOST)
        cut = np.flatnonzero((homes != self.ranks.rank).any(axis=1))
        phase, visits = divide_in_phases(self.ranks, names[cut], homes[cut])
        self.phase[cut] = phase
        self._visits = visits._replace(unit=visits.unit % _MOST)
        self._take_turns(self._visits)

    def divide_pairs(self, pairs: np.ndarray, homes: np.ndarray, unit_of_slot: np.ndarray) -> None:
        """Give contacts of pairs of bodies phases after those of permanent points.

        All ranks call it together. Phases hang on nothing but the pairs, so that a run that goes on
        has the same.

        Args:
            pairs: shape (n, 2), bodies of two ranks whose contacts are this rank's, by names that
                all ranks know.
            homes: shape (n, 2), ranks of these bodies.
            unit_of_slot: shape (num_slots,), body of each slot, -1 for none.
        """
        first = self.ranks.max(int(self.phase.max(initial=0)))
        phase, visits = divide_in_phases(self.ranks, pairs, homes)
        self._phase_of = PhasesOfPairs.of(pairs, int(first) + phase)
        self._unit_of_slot = np.append(unit_of_slot, -1)
        own = np.flatnonzero(self._name_of_slot // _MOST == self.ranks.rank)
        own = own[unit_of_slot[own] >= 0]
        held = np.unique(
            np.column_stack([unit_of_slot[own], self._name_of_slot[own] % _MOST]), axis=0
        )
        start, end = (np.searchsorted(held[:, 0], visits.unit, side) for side in ("left", "right"))
        visit = np.repeat(np.arange(len(start)), end - start)
        block = np.arange(len(visit)) - np.repeat(np.cumsum(end - start) - end, end - start)
        blocks = held[block, 1]
        found = Visits(blocks, int(first) + visits.phase[visit], visits.holder[visit])
        self._take_turns(self._visits.joined(found))

    def _take_turns(self, visits: Visits) -> None:
        order = np.argsort(self._name_of_slot, kind="stable")
        names = self._name_of_slot[order]

        def slots_of(named: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
            return {
                rank: order[np.flatnonzero(np.isin(names, blocks))]
                for rank, blocks in named.items()
            }

        ways = hand_overs(self.ranks, visits, self.ranks.rank * _MOST + visits.unit)
        self.turns = [
            Exchange(self.ranks, slots_of(given), slots_of(taken), self._dim)
            for given, taken in ways
        ]

    def extended(self, inverse: BodyInverse, more: Mapping[int, np.ndarray]) -> Halo:
        """A halo with more ghosts than this one, which has none but its points'; all ranks make it.

        Args:
            inverse: blocks of w on this rank's slots.
            more: own slots that other ranks want besides, by rank; what they have `wanted` is in
                its place, and these come after it.
        """
        given = {
            rank: np.concatenate(
                [there.get(rank, np.zeros(0, np.int64)) for there in (self._given, more)]
            )
            for rank in sorted({*self._given, *more})
        }
        halo = Halo(self.ranks, inverse, given, self.numbers)
        halo.phase, halo._visits = self.phase, self._visits
        wanted = {rank: halo.wanted[rank][: len(slots)] for rank, slots in self.wanted.items()}
        halo.corners = self._exchange_at_points(wanted)
        return halo

    def _exchange_at_points(self, wanted: Mapping[int, np.ndarray]) -> Exchange:
        """Exchange of the nodes of points alone, which are among `wanted` here."""
        given = self._given
        if self._at_points is not None:
            given, wanted = (
                {rank: slots[of_points[rank]] for rank, slots in there.items()}
                for there, of_points in zip((given, wanted), self._at_points, strict=True)
            )
        return Exchange(self.ranks, given, wanted, self._dim)

    def phase_of(self, points: InteractionPoints) -> np.ndarray:
        """Phase of contacts found, 0 where all bodies are this rank's, shape (num_points,)."""
        if self._phase_of is None:
            return np.zeros(len(points), np.int64)
        return self._phase_of(self._unit_of_slot[np.minimum(points.nodes[:, :, 0], self.num_slots)])

    @property
    def num_slots(self) -> int:
        """Slots of this rank's nodes and of ghosts; the ground's comes after them."""
        return self._last // self._dim

    def with_ghost_values(self, own: np.ndarray) -> np.ndarray:
        """Values at this rank's slots, shape (n, dim), and at its ghosts."""
        values = np.zeros((self.num_slots, self._dim))
        values[: len(own)] = own
        self.everywhere.forward(values.reshape(-1))
        return values

    def clear(self, values: np.ndarray) -> None:
        """Set the ghosts of a flat array over all slots to zero."""
        values[self._first : self._last] = 0.0

    def add_up(self, velocity: np.ndarray) -> None:
        """Let all have the velocities to which each has added on its side, cleared before."""
        self.everywhere.add_back(velocity)
        self.everywhere.forward(velocity)

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Values at all points from those at this rank's, in the scene's order, on every rank."""
        return self.ranks.gather(self.numbers, values)

    def cut_clusters(self, interactions: Interactions) -> CutClusters:
        """Clusters of facing nodes as this rank knows them; all ranks find them together."""
        from xper_fx.parallel.cut_clusters import cut_clusters

        return cut_clusters(interactions)

    def cut_nodes(self, interactions: Interactions, cluster: np.ndarray) -> CutNodes:
        """Nodes of clusters that the cut between ranks goes through; all find them together.

        Args:
            interactions: this rank's points.
            cluster: shape (num_slots,), those that these make of slots and ghosts.
        """
        from xper_fx.parallel.cut_clusters import cut_nodes

        return cut_nodes(interactions, cluster)

    def whole_matrix(self, interactions: Interactions, fixed: np.ndarray) -> WholeMatrix:
        """The matrix of Newton's method over all ranks, which make it together.

        Args:
            interactions: this rank's points.
            fixed: shape (n,), which degrees of freedom of its slots and ghosts are prescribed.
        """
        from xper_fx.parallel.whole_matrix import WholeMatrix

        return WholeMatrix(interactions, fixed)

    def coupled_system(
        self,
        bulk: csr_array,
        prescribed: np.ndarray,
        dofs_of_slots: np.ndarray,
        interactions: Interactions,
        gradient: np.ndarray,
        num_common: int,
    ) -> SharedCoupledSystem:
        """Bulk and points of all ranks as one matrix, as `CoupledSystem`; they make it together."""
        from xper_fx.parallel.coupled_rows import SharedCoupledSystem

        return SharedCoupledSystem(
            bulk, prescribed, dofs_of_slots, interactions, gradient, num_common
        )

    def with_ghosts(self, inverse: BodyInverse) -> BodyInverse:
        """Blocks of w of this rank and of its ghosts, as their owners have them now."""
        sizes = np.concatenate([np.zeros(0, np.int64), *self._sizes])
        return inverse.with_blocks(sizes, self._ghost_blocks(inverse))

    def renew_ghosts(self, inverse: BodyInverse) -> None:
        """Take the ghosts' blocks anew into what `with_ghosts` gave, as owners have them now."""
        blocks = self._ghost_blocks(inverse)
        last = inverse.data_offsets[-2]
        inverse.data[last - len(blocks) : last] = blocks

    def _ghost_blocks(self, inverse: BodyInverse) -> np.ndarray:
        """The blocks of ghosts, flat; of `inverse` this rank's own are read."""
        send = [None] * self.ranks.size
        for rank, blocks in self._blocks.items():
            offsets = inverse.data_offsets
            parts = [inverse.data[offsets[b] : offsets[b + 1]] for b in blocks]
            send[rank] = np.concatenate(parts)
        got = [data for data in self.ranks.comm.alltoall(send) if data is not None]
        return np.concatenate([np.zeros(0), *got])

    @property
    def cut(self) -> np.ndarray:
        """Blocks of this rank that others may move, and those of its ghosts."""
        ghosts = self._own_blocks + np.arange(sum(map(len, self._sizes)))
        return np.unique(np.concatenate([ghosts, *self._blocks.values()]))

    @property
    def nbytes(self) -> int:
        """Memory of what is exchanged and of the points' numbers, in bytes."""
        exchanges = (self.everywhere, *self.turns)
        return sum(e.nbytes for e in exchanges) + self.numbers.nbytes + self.phase.nbytes
