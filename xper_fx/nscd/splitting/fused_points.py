# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which vertices of a scene are whole, and the points of those that are not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.splitting.growing import GrowingGroup
from xper_fx.nscd.splitting.vertex_graphs import vertex_graphs
from xper_fx.nscd.touching.corners import Corners

if TYPE_CHECKING:
    from xper_fx.nscd.turning_frames import LipMotion

# Difference of velocities, relative to the largest, that is rounding.
_ROUNDING = 1e-12


class FusedPoints:
    """The vertices of a scene with initially rigid bonds.

    A vertex all of whose bonds are rigid still is whole: no arrays of its points exist. One that
    may open has all its points, those of its sound bonds too.

    Args:
        points: all points of the scene.
        vertex: shape (num_points,), where they are.
        laws: the laws in use, and `law_of_point`, shape (num_points,).
        inverse: one block a node, of which it holds the diagonal.
        still: groups of all points of other laws.
        make: makes a group of an initially rigid law from its kernels and numbers of points.

    Attributes:
        graphs: of the vertices.
        groups: those of other laws, then those of initially rigid ones, which grow.
        group_of: shape (num_bonds,), which of the groups a bond belongs to; -1 once it has retired.
        rows: shape (num_bonds,), int32, place of each bond's point in its group, or -1.
        tables, table_rows: parameters of the bonds of each group, and the row of each bond there.
        whole: shape (num_vertices,), bool.
        split: those that are not, in the order in which they came.
        impulses: shape (num_slots, dim), of the step on each slot (N s); zero where a vertex is
            whole and not driven, whose bonds nobody asks for theirs. Each step has its own.
        failed: shape (num_vertices,), room for vertices that do not hold.
        clusters: shape (num_corners,), first corner of the cluster of each corner of vertices that
            are not whole, counted in the vertex; made where contacts or couples ask for it.
        vertex_of_slot: shape (num_slots,), -1 where there is none; made as `clusters`.
    """

    def __init__(
        self,
        points: InteractionPoints,
        vertex: np.ndarray,
        laws: Sequence[Law],
        law_of_point: np.ndarray,
        inverse: BodyInverse,
        still: list[PointGroup],
        make: Callable[[object, np.ndarray], PointGroup],
    ):
        self._make, self._num_still, self._lips = make, len(still), points.lips
        kernels = [law.kernels(inverse.dim) for law in laws]
        rigid = list(dict.fromkeys(k for k in kernels if k.rigid is not None))
        group_of_law = np.array([rigid.index(k) if k in rigid else -1 for k in kernels])
        group_of_point = group_of_law[law_of_point] + len(still)
        for number, group in enumerate(still):
            group_of_point[group.indices] = number
        strength = np.zeros(len(points))
        for number, law in enumerate(laws):
            if kernels[number].rigid is not None:
                strength[law_of_point == number] = law.least_strength
        graphs = self.graphs = vertex_graphs(points, vertex, group_of_point, strength, inverse)
        self.group_of = group_of_point[graphs.point].astype(np.int8)
        self._find_rows(still)
        self._take_tables(laws, kernels, rigid, law_of_point, still)
        some = [np.flatnonzero(group_of_law[law_of_point] == n)[:1] for n in range(len(rigid))]
        self._growing = [
            GrowingGroup(make(k, one)) for k, one in zip(rigid, some, strict=True)
        ]  # fmt: skip
        self.groups = still + [g.group for g in self._growing]
        self.whole = np.ones(graphs.num_vertices, bool)
        self.split = np.zeros(0, np.int32)
        self.impulses = np.zeros((inverse.num_slots, inverse.dim))
        self.failed = np.zeros(graphs.num_vertices, np.int32)
        other = np.unique(vertex[group_of_law[law_of_point] < 0])
        if len(other):
            self.wake(other.astype(np.int32))

    @property
    def corners(self) -> Corners:
        """What contacts know of the vertices."""
        graphs = self.graphs
        return Corners(graphs.corner_offsets, graphs.corner, graphs.compliance)

    @cached_property
    def clusters(self) -> np.ndarray:
        """See the class."""
        return np.zeros(len(self.graphs.corner), np.int16)

    @cached_property
    def vertex_of_slot(self) -> np.ndarray:
        """See the class."""
        graphs = self.graphs
        vertex = np.full(len(graphs.compliance), -1, np.int32)
        vertices = np.arange(graphs.num_vertices, dtype=np.int32)
        vertex[graphs.corner] = np.repeat(vertices, np.diff(graphs.corner_offsets))
        vertex[-1] = -1  # the ground is at many
        return vertex

    def _take_tables(self, laws, kernels, rigid, law_of_point, still) -> None:
        """Parameters of rigid bonds: a row a law, or a row a point where they differ."""
        tables: list[list[np.ndarray]] = [[] for _ in rigid]
        sizes, row = [0] * len(rigid), np.zeros(len(law_of_point), np.int32)
        for number, law in enumerate(laws):
            if kernels[number].rigid is None:
                continue
            group, here = rigid.index(kernels[number]), np.flatnonzero(law_of_point == number)
            columns = np.broadcast_arrays(*map(np.atleast_1d, law.parameters()))
            several = len(columns[0]) > 1
            row[here] = sizes[group] + (np.arange(len(here)) if several else 0)
            tables[group].append(np.column_stack(columns).astype(float))
            sizes[group] += len(columns[0])
        self.table_rows = row[self.graphs.point]
        self.tables = tuple(
            [np.zeros((0, 1)) for _ in still] + [np.concatenate(table) for table in tables]
        )

    def move(
        self,
        slots: np.ndarray,
        inverse: BodyInverse,
        moved: Callable[[PointGroup], PointGroup],
    ) -> None:
        """Put all points on other slots of the same cells.

        Args:
            slots: shape (n,), by the old slot.
            inverse: on the new slots, of which it holds the diagonal.
            moved: a group that does not grow on the new slots.
        """
        corner = self.graphs.corner
        impulses = np.zeros((inverse.num_slots, inverse.dim))
        impulses[slots[corner]] = self.impulses[corner]
        self.impulses = impulses
        self.graphs = self.graphs._replace(
            corner=slots[corner].astype(corner.dtype), compliance=inverse.compliance_of_slots()
        )
        self.__dict__.pop("vertex_of_slot", None)
        if self._lips is not None:
            self._lips = self._lips.on(slots)
        still, growing = self.groups[: self._num_still], self._growing
        for group in growing:
            group.move(slots, inverse)
        self.groups[:] = [*map(moved, still), *(g.group for g in growing)]

    def wake(self, vertices: np.ndarray) -> list[PointGroup]:
        """Give vertices the arrays of all their points.

        Args:
            vertices: whole ones.

        Returns:
            The groups that have grown.
        """
        graphs, grown = self.graphs, []
        self.whole[vertices] = False
        self.split = np.concatenate([self.split, vertices])
        counts = graphs.bond_offsets[vertices + 1] - graphs.bond_offsets[vertices]
        ends = np.cumsum(counts)
        first = np.repeat(graphs.bond_offsets[vertices] - (ends - counts), counts)
        bonds = np.arange(len(first)) + first
        for number, growing in enumerate(self._growing):
            of_group = bonds[self.group_of[bonds] == self._num_still + number]
            if len(of_group):
                made = self._make(growing.group.kernels, graphs.point[of_group])
                self.rows[of_group] = growing.take_in(made)
                self.groups[self._num_still + number] = growing.group
                grown.append(growing.group)
        return grown

    def grounded(self) -> np.ndarray:
        """Whole vertices that bonds join to the ground, which has no velocity of its own."""
        graphs = self.graphs
        ground = graphs.corner == len(graphs.compliance) - 1
        touched = np.logical_or.reduceat(ground, graphs.corner_offsets[:-1])
        return np.flatnonzero(touched & self.whole).astype(np.int32)

    def _find_rows(self, groups: list[PointGroup]) -> None:
        row = np.full(len(self.graphs.point), -1, np.int32)
        for group in groups:
            row[group.indices] = np.arange(len(group), dtype=np.int32)
        self.rows = row[self.graphs.point]

    def retire(
        self, indices: np.ndarray, subset: Callable[[PointGroup, np.ndarray], PointGroup]
    ) -> None:
        """Take bonds out for good, of vertices that are not whole.

        Args:
            indices: numbers of their points.
            subset: makes a group of some of the points of one that does not grow.
        """
        gone = np.zeros(len(self.graphs.point), bool)
        gone[indices] = True
        for number, group in enumerate(self.groups):
            kept = np.flatnonzero(~gone[group.indices])
            if len(kept) == len(group):
                continue
            if number < self._num_still:
                self.groups[number] = subset(group, kept)
            else:
                growing = self._growing[number - self._num_still]
                growing.keep(kept)
                self.groups[number] = growing.group
        retired = gone[self.graphs.point]
        self.group_of[retired] = -1
        self.graphs.least[retired] = 0.0
        self._find_rows(self.groups)

    def turn(self, motion: LipMotion, reach: float) -> None:
        """Turn the normals of all bonds with their lips.

        Args:
            motion: of the slots.
            reach: time from the start of a step to where it looks (s).
        """
        from xper_fx.nscd.splitting.turning_vertices import turn_normals

        turn_normals(self.graphs.normal.shape[1], self._lips.nodes.shape[2])(
            self.graphs.normal, self.graphs.point, self._lips.nodes, self._lips.gradient,
            self._lips.tangent, motion, reach,
        )  # fmt: skip

    def push_couples(self, couples: np.ndarray, velocity: np.ndarray) -> None:
        """Let couples of lips act on clusters, whose cells move as one.

        Args:
            couples: shape (num_slots, dim), impulses (N s); what bonds hand on to driven corners
                is added to theirs, and taken from the others.
            velocity: shape (num_slots, dim), which changes (m/s).
        """
        from xper_fx.nscd.splitting.turning_vertices import push_clusters

        slots = np.flatnonzero(couples.any(axis=1))
        vertex = self.vertex_of_slot[slots]
        alone = slots[vertex < 0]
        velocity[alone] += self.graphs.compliance[alone] * couples[alone]
        vertices = np.unique(vertex[vertex >= 0])
        push_clusters(vertices, self.whole, self.clusters, self.graphs, couples, velocity)

    def turn_of_points(self) -> np.ndarray:
        """Place in `split` of each point's vertex, or -1, shape (num_points,)."""
        of_vertex = np.full(self.graphs.num_vertices, -1)
        of_vertex[self.split] = np.arange(len(self.split))
        turn = np.empty(len(self.graphs.point), np.int64)
        turn[self.graphs.point] = np.repeat(of_vertex, np.diff(self.graphs.bond_offsets))
        return turn

    def split_again(self, turn: np.ndarray) -> None:
        """Let vertices be split as they were when `turn_of_points` gave `turn`."""
        of_vertex = turn[self.graphs.point[self.graphs.bond_offsets[:-1]]]
        order = np.argsort(of_vertex, kind="stable")
        split = order[(of_vertex[order] >= 0) & self.whole[order]]
        self.wake(split.astype(np.int32))

    def split_where(self, changed: np.ndarray) -> None:
        """Let the vertices be split of points that are no more as at the start.

        Args:
            changed: shape (num_points,), bool.
        """
        graphs = self.graphs
        split = np.logical_or.reduceat(changed[graphs.point], graphs.bond_offsets[:-1])
        self.wake(np.flatnonzero(split & self.whole).astype(np.int32))

    def require_one_velocity(self, nodal: np.ndarray, largest: Callable) -> None:
        """Raise a ValueError if cells that a vertex joins start with velocities of their own.

        Args:
            nodal: shape (num_slots, dim), velocities at the start (m/s).
            largest: gives the largest of numbers over all ranks, which raise together.
        """
        graphs, sides = self.graphs, self._slots_of_sides()
        rigid = graphs.least > 0.0
        jump = np.abs(nodal[sides[:, 0]] - nodal[sides[:, 1]]).max(axis=1, initial=0.0) * rigid
        driven = np.any(graphs.compliance[sides] == 0.0, axis=(1, 2))
        jump[driven] = 0.0
        apart, speed = largest(np.array([jump.max(initial=0.0), np.abs(nodal).max(initial=0.0)]))
        if apart > _ROUNDING * speed:
            raise ValueError(
                "Initially rigid bonds join cells that move apart at the start, by "
                f"{apart:g} m/s: take an initial_velocity that is continuous there."
            )

    def _slots_of_sides(self) -> np.ndarray:
        """Slots of candidate and antagonist of each bond, shape (num_bonds, 2)."""
        graphs = self.graphs
        first = graphs.corner_offsets[:-1].repeat(np.diff(graphs.bond_offsets))
        return graphs.corner[first[:, None] + graphs.sides]

    def compliance_of_cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Initially rigid points, and how far a unit impulse parts the cells at each (m/s per N s).

        That is of cells for themselves, the largest that their compliance will be.
        """
        graphs, rigid = self.graphs, self.graphs.least > 0.0
        apart = graphs.compliance[self._slots_of_sides()].sum(axis=1).max(axis=1)
        return graphs.point[rigid], apart[rigid]

    def most(self, group: PointGroup) -> int:
        """Number of points that one of the groups may have."""
        number = next(n for n, other in enumerate(self.groups) if other is group)
        return int(np.count_nonzero(self.group_of == number))

    @property
    def asleep(self) -> np.ndarray:
        """Numbers of the points of whole vertices, which have no arrays."""
        return self.graphs.point[(self.rows < 0) & (self.group_of >= 0)]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes, that of the groups left out."""
        held = (value for value in vars(self).values() if isinstance(value, np.ndarray))
        return self.graphs.nbytes + sum(array.nbytes for array in (*held, *self.tables))
