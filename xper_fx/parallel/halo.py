# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ghost velocities at the cuts between ranks.

A rank's interactions act on the slots of its own nodes and on *ghosts*: the slots of other ranks'
bodies at its points, with their blocks of w. Ghosts follow their owners by DOLFINx index maps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from dolfinx import la

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.points import InteractionPoints
from xper_fx.parallel.ownership import Meetings
from xper_fx.support.compat import index_map
from xper_fx.support.ranks import Ranks

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from xper_fx.nscd.interactions import Interactions
    from xper_fx.parallel.coupled_rows import SharedCoupledSystem
    from xper_fx.parallel.petsc_newton import LinearSystem


class Exchange:
    """Moves entries of velocity arrays between slots and their ghosts.

    Args:
        given: own slots that other ranks have as ghosts, by rank, in the order of their ghosts.
        ghosts: ghost slots by the rank that they follow.
        dim: dofs a slot.
    """

    def __init__(
        self,
        ranks: Ranks,
        given: Mapping[int, np.ndarray],
        ghosts: Mapping[int, np.ndarray],
        dim: int,
    ):
        self._given = np.concatenate([np.zeros(0, np.int64), *given.values()])
        self._ghosts = np.concatenate([np.zeros(0, np.int64), *ghosts.values()])
        count, dims = len(self._given), np.arange(dim)
        first = ranks.comm.exscan(count) or 0
        starts = np.cumsum([first, *map(len, given.values())])
        told = ranks.comm.alltoall(
            [dict(zip(given, starts[:-1], strict=True)).get(r, 0) for r in range(ranks.size)]
        )
        numbers = [told[rank] + np.arange(len(slots)) for rank, slots in ghosts.items()]
        owners = [np.full(len(slots), rank, np.int32) for rank, slots in ghosts.items()]
        shared = index_map(
            ranks.comm,
            count,
            np.concatenate([np.zeros(0, np.int64), *numbers]),
            np.concatenate([np.zeros(0, np.int32), *owners]),
            [rank for rank, slots in given.items() if len(slots)],
        )
        self._vector = la.vector(shared, dim, dtype=np.float64)
        self._array = self._vector.array  # to make this view takes nearly as long as to exchange
        self._split = count * dim
        self._own = (self._given[:, None] * dim + dims).ravel()
        self._mirrored = (self._ghosts[:, None] * dim + dims).ravel()

    def forward(self, values: np.ndarray) -> None:
        """Ghosts take the values of their owners; `values` is flat, of all slots."""
        array = self._array
        array[: self._split] = values[self._own]
        self._vector.scatter_forward()
        values[self._mirrored] = array[self._split :]

    def back(self, values: np.ndarray) -> None:
        """Owners take the values of their ghosts, of which each has one."""
        array = self._array
        array[: self._split] = values[self._own]
        array[self._split :] = values[self._mirrored]
        self._vector.scatter_reverse(la.InsertMode.insert)
        values[self._own] = array[: self._split]

    def add_back(self, values: np.ndarray) -> None:
        """Owners add the values of their ghosts."""
        array = self._array
        array[: self._split] = 0.0
        array[self._split :] = values[self._mirrored]
        self._vector.scatter_reverse(la.InsertMode.add)
        np.add.at(values, self._own, array[: self._split])

    @property
    def nbytes(self) -> int:
        """Memory of the values exchanged and of where they are, in bytes."""
        arrays = (self._given, self._ghosts, self._own, self._mirrored, self._array)
        return sum(array.nbytes for array in arrays)

    @property
    def bytes_sent(self) -> int:
        """Bytes that this rank sends forward."""
        return 8 * self._split

    @property
    def bytes_returned(self) -> int:
        """Bytes that this rank sends back."""
        return 8 * len(self._mirrored)


class Halo:
    """What a rank's interactions have to do with other ranks.

    Args:
        inverse: blocks of w on this rank's slots.
        given: own slots that other ranks want as ghosts, by rank.
        meetings: in which phases ranks meet.
        numbers: shape (num_points,), numbers of this rank's points in the whole scene.
        phase: shape (num_points,), phase of each point, 0 where both bodies are here or, vertex by
            vertex, where there are no phases.
        at_points: by rank, which of `given` and of `wanted` are nodes of points, others being of
            their lips alone; None where all are, or nobody asks.

    Attributes:
        meetings: as given.
        wanted: slots of the nodes that other ranks gave, by rank, in the order they were asked for.
        everywhere: exchange with all ranks.
        corners: exchange of what permanent points ask for.
        phases: exchange with one rank, phase after phase from the first.
        copies: of what is on every rank; see `RigidHalo`.
    """

    copies = 1

    def __init__(
        self,
        ranks: Ranks,
        inverse: BodyInverse,
        given: Mapping[int, np.ndarray],
        meetings: Meetings,
        numbers: np.ndarray,
        phase: np.ndarray,
        at_points: tuple[Mapping[int, np.ndarray], Mapping[int, np.ndarray]] | None = None,
    ):
        self.ranks, self.numbers, self.phase = ranks, numbers, phase
        self.meetings, self._given, self._at_points = meetings, given, at_points
        blocks_of = inverse.block_of_node
        self._blocks = {rank: np.unique(blocks_of[slots]) for rank, slots in given.items()}
        sizes = np.diff(inverse.node_offsets)
        self._own_blocks = len(sizes) - 1
        told = [None] * ranks.size
        all_given = {}
        for rank, blocks in self._blocks.items():
            ranges = [
                np.arange(inverse.node_offsets[b], inverse.node_offsets[b + 1]) for b in blocks
            ]
            all_given[rank] = np.concatenate(ranges)
            place = np.searchsorted(all_given[rank], given[rank])
            told[rank] = (sizes[blocks], place)
        answers = ranks.comm.alltoall(told)
        ghosts: dict[int, np.ndarray] = {}
        self.wanted: dict[int, np.ndarray] = {}
        self._sizes = []
        at = inverse.num_nodes
        for rank, answer in enumerate(answers):
            if answer is None:
                continue
            counts, place = answer
            ghosts[rank] = at + np.arange(counts.sum())
            self.wanted[rank] = at + place
            self._sizes.append(counts)
            at += int(counts.sum())
        self._dim = dim = inverse.dim
        self.everywhere = self.corners = Exchange(ranks, all_given, ghosts, dim)
        if at_points is not None:
            self.corners = self._exchange_at_points(self.wanted)
        self.phases = []
        for phase in range(1, meetings.num_phases + 1):
            met = meetings.partner(ranks.rank, phase)
            self.phases.append(
                Exchange(
                    ranks,
                    {r: all_given[r] for r in met if r in all_given},
                    {r: ghosts[r] for r in met if r in ghosts},
                    dim,
                )
            )
        self._first, self._last = inverse.num_nodes * dim, at * dim
        self._rank_of_slot = np.full(at + 1, ranks.rank)
        for rank, slots in ghosts.items():
            self._rank_of_slot[slots] = rank

    def extended(
        self, inverse: BodyInverse, more: Mapping[int, np.ndarray], meetings: Meetings
    ) -> Halo:
        """A halo with more ghosts than this one, which has none but its points'; all ranks make it.

        Args:
            inverse: blocks of w on this rank's slots.
            more: own slots that other ranks want besides, by rank; what they have `wanted` is in
                its place, and these come after it.
            meetings: as of `Halo`; ranks that met before do so in the same phase.
        """
        given = {
            rank: np.concatenate(
                [there.get(rank, np.zeros(0, np.int64)) for there in (self._given, more)]
            )
            for rank in sorted({*self._given, *more})
        }
        halo = Halo(self.ranks, inverse, given, meetings, self.numbers, self.phase)
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
        """Phase of points on these slots, 0 where all bodies are this rank's, (num_points,)."""
        other = self._rank_of_slot[points.nodes[:, :, 0]]
        return self.meetings.of(np.full_like(other, self.ranks.rank), other).max(axis=1, initial=0)

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

    def linear_system(self, interactions: Interactions) -> LinearSystem:
        """The linear system of Newton's method over all ranks; they make it together."""
        from xper_fx.parallel.petsc_newton import LinearSystem

        return LinearSystem(interactions)

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
        exchanges = (self.everywhere, *self.phases)
        return sum(e.nbytes for e in exchanges) + self.numbers.nbytes + self.phase.nbytes
