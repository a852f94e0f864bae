# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interaction points sorted by law, each law's in an order of visit."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from xper_fx.nscd.couplings import Blocks, Couplings, Sides, couple, couple_again, couple_nodes
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws.law import Law, LawKernels
from xper_fx.nscd.ordering import (
    NO_ORDER,
    NO_TILES,
    Ordering,
    TileBodies,
    bodies_of_tiles,
    order_by_vertex,
    order_points,
)
from xper_fx.nscd.own_compliance import update_compliance
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.points import InteractionPoints


class _Like(NamedTuple):
    """What of a group `Grouping._group` keeps."""

    indices: np.ndarray
    ordering: Ordering
    tile_bodies: TileBodies
    couplings: Couplings


class Grouping:
    """Makes groups of points.

    Args:
        laws: the laws in use.
        inverse: blocks of w, of which the sizes count.
        vertex: shape (num_points,), of the points where each vertex is solved alone; None where
            points are visited in tiles of neighbouring bodies.
    """

    def __init__(self, laws: list[Law], inverse: BodyInverse, vertex: np.ndarray | None):
        self._laws, self._dim, self._vertex = laws, inverse.dim, vertex
        self._still = inverse.still()
        self._block_of_node = inverse.block_of_node
        # numbers that laws gave for all of their points, which they need not be asked for again
        self._given: dict[tuple[str, int], np.ndarray] = {}

    def by_tiles(self) -> Grouping:
        """Makes groups of points that are visited in tiles, as those that a search finds are."""
        if self._vertex is None:
            return self
        grouping = copy(self)
        grouping._vertex = None
        return grouping

    def groups(
        self,
        inverse: BodyInverse,
        points: InteractionPoints,
        law_of_point: np.ndarray,
        nodal: np.ndarray,
        phase: np.ndarray,
        later: bool = False,
        left_out: frozenset[int] = frozenset(),
    ) -> list[PointGroup]:
        """Points by law.

        Args:
            inverse: blocks of w as they are now.
            points: to be sorted.
            law_of_point: shape (num_points,), index into the laws.
            nodal: shape (num_slots, dim), velocities of the nodes (m/s).
            phase: shape (num_points,), in which bodies of another rank are at a point.
            later: whether they come about after the start (`law.py`).
            left_out: laws whose points are in no group.
        """
        by_kernels: dict[LawKernels, list[int]] = {}
        for number in np.flatnonzero(np.bincount(law_of_point)).tolist():
            if number in left_out:
                continue
            by_kernels.setdefault(self._laws[number].kernels(self._dim), []).append(number)
        groups = []
        for kernels, numbers in by_kernels.items():
            own = np.zeros(len(self._laws), bool)
            own[numbers] = True
            indices = np.flatnonzero(own[law_of_point])
            for number in np.flatnonzero(np.bincount(phase[indices])).tolist():
                here = indices[phase[indices] == number]
                group = self._group(inverse, kernels, points, law_of_point, here, nodal, later)
                groups.append(replace(group, phase=number))
        return groups

    def as_given(
        self,
        inverse: BodyInverse,
        kernels: LawKernels,
        points: InteractionPoints,
        law_of_point: np.ndarray,
        indices: np.ndarray,
    ) -> PointGroup:
        """A group of some points of one law's kernels at rest, in their order.

        Args:
            inverse, kernels, points, law_of_point: as of `groups`.
            indices: shape (n,), numbers of the points.
        """
        like = _Like(
            indices, NO_ORDER, NO_TILES, couple_nodes(points.nodes[indices], inverse)
        )  # fmt: skip
        group = self._group(inverse, kernels, points, law_of_point, indices, None, False, like)
        update_compliance(group, inverse)
        return group

    def again(
        self,
        inverse: BodyInverse,
        group: PointGroup,
        points: InteractionPoints,
        law_of_point: np.ndarray,
        nodal: np.ndarray,
        later: bool,
    ) -> PointGroup:
        """A group at its start, of points that are those of another group at other places."""
        made = self._group(
            inverse, group.kernels, points, law_of_point, group.indices, nodal, later, group
        )
        return replace(made, phase=group.phase)

    def rolling_points(
        self, inverse: BodyInverse, group: PointGroup, nodal: np.ndarray
    ) -> PointGroup:
        """The rolling points of a group of contacts at their start (`laws/rolling.py`).

        Args:
            inverse, nodal: as of `groups`.
            group: contacts of rigid bodies; their parameters and impulses are those of the points.
        """
        kernels, dim, n = group.kernels.rolling, inverse.dim, len(group)
        radius, frame = group.points.round_radius, group.points.frame
        if dim == 2:
            frame = np.broadcast_to([[1.0, 0.0]], (n, 1, 2))
        points = InteractionPoints(
            group.points.nodes[:, :, :1] + np.int32(1),
            np.broadcast_to(radius[:, None, None], (n, 2, 1)).copy(),
            np.ascontiguousarray(frame), np.ones(n), np.zeros(n),
        )  # fmt: skip
        couplings = couple(points, inverse)
        # one node a side: kernels take its weight as one
        couplings = couplings._replace(frame=radius[:, None, None] * points.frame)
        components = kernels.components
        return replace(
            group,
            kernels=kernels,
            points=points,
            couplings=couplings,
            state=np.zeros((n, 0)),
            terms=np.zeros((n, 0)),
            details=group.impulse,
            compliance=np.zeros((n, components * (components + 1) // 2)),
            inverse_area=np.ones(n, np.float32),
            jump=np.zeros((n, components)),
            velocity=points.relative(nodal),
            impulse=np.zeros((n, components)),
            committed_impulse=np.zeros((n, components)),
            energy=np.zeros((n, len(kernels.energies))),
            status=np.zeros(n, np.int8),
            sides=Sides(dim, components, 1),
            blocks=_block_size(inverse, couplings),
        )

    def _group(
        self, inverse, kernels, points, law_of_point, indices, nodal, later, like=None
    ) -> PointGroup:
        """A group with the start of its points; `like` has the same points as they were before.

        They are at rest where `nodal` is None.
        """
        points = points.with_components(kernels.components)
        if like is None:
            num_blocks = len(self._still)
            blocks = self._blocks_of(points, indices)
            ordering = self._ordered(blocks, num_blocks, indices)
            tile_bodies = bodies_of_tiles(ordering, blocks, num_blocks)
            indices = indices[ordering.order]
            points = points.take(indices)
            couplings = couple(points, inverse)
        else:
            indices, ordering, tile_bodies = like.indices, like.ordering, like.tile_bodies
            points = points.take(indices)
            couplings = couple_again(like.couplings, points)
        n, components = len(points), kernels.components
        sides = Sides(
            inverse.dim, components, points.nodes.shape[2], points.lever_arms is not None,
            points.branches is not None,
        )  # fmt: skip
        which = law_of_point[indices]
        parameters = self._rows("parameters", kernels, which, law_of_point, indices)
        born = "later_state" if later else "initial_state"
        state = self._rows(born, kernels, which, law_of_point, indices)
        jump = np.zeros((n, components))
        jump[:, 0] = points.gap
        turning = None
        if points.lips is not None:
            from xper_fx.nscd.turning_frames import TurningFrames

            turning = TurningFrames.of(points.lips, kernels, parameters, state)
        return PointGroup(
            kernels=kernels,
            indices=indices.astype(np.int32),
            points=points,
            ordering=ordering,
            tile_bodies=tile_bodies,
            couplings=couplings,
            parameters=parameters,
            state=state,
            terms=np.zeros((n, kernels.num_terms)),
            details=np.zeros((n, kernels.num_details)),
            compliance=np.zeros((n, components * (components + 1) // 2)),
            inverse_area=(1.0 / points.area).astype(np.float32),
            jump=jump,
            velocity=np.zeros((n, components)) if nodal is None else points.relative(nodal),
            impulse=np.zeros((n, components)),
            committed_impulse=np.zeros((n, components)),
            energy=np.zeros((n, len(kernels.energies))),
            status=np.zeros(n, np.int8),
            sides=sides,
            blocks=_block_size(inverse, couplings),
            turning=turning,
        )

    def _rows(self, what: str, kernels: LawKernels, which, law_of_point, indices) -> np.ndarray:
        """What a method of the laws gives for each of some points, numbers or arrays over points.

        Args:
            what: the method.
            kernels: of the laws; where there are no points they tell how wide rows are.
            which: shape (n,), law of each.
            law_of_point: shape (num_points,), of all.
            indices: shape (n,), of the points among all.
        """
        rows = np.zeros((len(which), 0))
        numbers = np.flatnonzero(np.bincount(which)).tolist()
        if not numbers:
            numbers = [[law.kernels(self._dim) for law in self._laws].index(kernels)]
        for number in numbers:
            given, here = self._given.get((what, number)), which == number
            if given is None:
                law = self._laws[number]
                given = getattr(law, what, law.initial_state)()
                if not any(map(np.ndim, given)):
                    given = self._given[what, number] = np.array(given, float)
            if rows.shape[1] != len(given):
                rows = np.zeros((len(which), len(given)))
            if isinstance(given, np.ndarray):
                rows[here] = given
                continue
            place = np.searchsorted(np.flatnonzero(law_of_point == number), indices[here])
            for column, values in enumerate(given):
                rows[here, column] = values[place] if np.ndim(values) else values
        return rows

    def _ordered(self, blocks, num_blocks: int, indices) -> Ordering:
        if self._vertex is None:
            return order_points(blocks, num_blocks)
        vertex, count = self._vertex[indices], int(self._vertex.max()) + 1
        return order_by_vertex(blocks, num_blocks, vertex, count)

    def subset(self, inverse: BodyInverse, group: PointGroup, kept: np.ndarray) -> PointGroup:
        """A group of the points of another one that are kept, with their history."""
        # in the scene's order first: who retires together leaves no trace in the order of visit
        kept = kept[np.argsort(group.indices[kept])]
        blocks = self._blocks_of(group.points, kept)
        ordering = self._ordered(blocks, len(self._still), group.indices[kept])
        kept = kept[ordering.order]
        points = group.points.take(kept)
        arrays = {
            name: np.ascontiguousarray(array[kept])
            for name, array in vars(group).items()
            if isinstance(array, np.ndarray)
        }
        return replace(
            group, points=points, ordering=ordering, couplings=couple(points, inverse),
            tile_bodies=bodies_of_tiles(ordering, blocks, len(self._still)),
            turning=None if group.turning is None else group.turning.take(kept), **arrays,
        )  # fmt: skip

    def onto(self, inverse: BodyInverse) -> Grouping:
        """Makes groups of points of the same laws on other blocks of w."""
        grouping = copy(self)
        grouping._still, grouping._block_of_node = inverse.still(), inverse.block_of_node
        return grouping

    def moved(self, inverse: BodyInverse, group: PointGroup, slots: np.ndarray) -> PointGroup:
        """A group whose points are on other slots of the same bodies, with its history.

        Args:
            inverse: blocks of w that this makes groups on.
            slots: shape (n,), by the old slot.
        """
        points, turning = group.points.on(slots), group.turning
        if turning is not None:
            turning = turning._replace(nodes=slots[turning.nodes].astype(turning.nodes.dtype))
        blocks = np.empty((len(group), 2), self._block_of_node.dtype)
        blocks[group.ordering.order] = self._blocks_of(points, np.arange(len(group)))
        couplings = couple(points, inverse)
        return replace(
            group, points=points, couplings=couplings, blocks=_block_size(inverse, couplings),
            tile_bodies=bodies_of_tiles(group.ordering, blocks, len(self._still)), turning=turning,
        )  # fmt: skip

    def _blocks_of(self, points: InteractionPoints, indices: np.ndarray) -> np.ndarray:
        """Blocks that some points move; what cannot be moved counts as the ground."""
        blocks = self._block_of_node[points.nodes[indices, :, 0]]
        if points.branches is not None:
            first = points.branches.node
            cell = np.unique(self._block_of_node[first : first + self._dim])
            blocks = np.column_stack([blocks, np.tile(cell, (len(blocks), 1))])
        return np.where(self._still[blocks], len(self._still) - 1, blocks)

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        vertex = 0 if self._vertex is None else self._vertex.nbytes
        return self._still.nbytes + self._block_of_node.nbytes + vertex


def _block_size(inverse: BodyInverse, couplings: Couplings) -> Blocks:
    """The size that the blocks of w have, all of them or those of a group's points."""
    if inverse.uniform_size:
        return Blocks(inverse.uniform_size, aligned=True)
    ground = inverse.node_offsets[-2] * inverse.dim
    sizes = np.unique(couplings.size[couplings.body != ground])
    room = len(inverse.data) - inverse.data_offsets[-2]
    alike = len(sizes) == 1 and sizes[0] ** 2 <= room
    return Blocks(int(sizes[0])) if alike else Blocks()
