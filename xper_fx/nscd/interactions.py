# SPDX-License-Identifier: LGPL-3.0-or-later
"""All interaction points of a scene, sorted by law, with their history.

A time step is `begin_step`, one `solve` or more (Newton iterations of the bulk), and `commit`.
Until `commit` nothing of the past is lost: a step may begin again with another size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import SINGULAR, for_dimension, sym_indices
from xper_fx.nscd.contact_history import ContactHistory
from xper_fx.nscd.couplings import (
    Blocks,
    Couplings,
    Sides,
    couple,
    couple_again,
    motion,
    push_kernel,
    spread_kernel,
)
from xper_fx.nscd.facets import join_points
from xper_fx.nscd.halo_protocol import ContactHalo, PointHalo, Reductions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.laws.law import ENERGIES, Law, LawKernels
from xper_fx.nscd.ordering import (
    Ordering,
    bodies_of_tiles,
    order_by_vertex,
    order_points,
    vertex_of_points,
)
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.points import InteractionPoints
from xper_fx.support.saved_rows import Rows
from xper_fx.support.threads import in_ranges

# Relative rounding of velocities that several points add up to.
_ROUNDING = 4.0 * np.finfo(float).eps


class StepWork(NamedTuple):
    """What the interactions stored and dissipated, summed over points (J; 2D: J/m).

    `stored` is a state, the others are what the step added.
    """

    stored: float
    cohesion: float
    friction: float
    impact: float
    numerical: float


class FoundPoints(NamedTuple):
    """Contacts that a search has found.

    Attributes:
        points: on the node slots, `gap` in the middle of the step, at x0 + h (1 - theta) v0.
        law_of_point: shape (num_points,), index into the laws.
        keys: shape (num_points, 2), what contacts are known by from step to step, sorted.
    """

    points: InteractionPoints
    law_of_point: np.ndarray
    keys: np.ndarray


@dataclass
class Anchors:
    """Dofs that hold bodies which interactions alone hold (`bulk/floating_bodies.py`).

    A solver may pass over them: the bodies are then on springs, and the bulk iterates until these
    bear nothing.

    Args:
        held: w0, blocks of w with the anchors held.
        motions: R, rigid motions that move one anchor each, shape (num_slots * dim, n).
        load: R^T f of the forces that act on the bulk, shape (n,), N s.
        on_springs: velocities that the load gives the anchors, part of the free velocity, shape
            (n,), m/s.

    Attributes:
        velocity: a, what a solver that knows of anchors gives them, shape (n,), m/s.
    """

    held: BodyInverse
    motions: sp.csc_array
    load: np.ndarray
    on_springs: np.ndarray
    velocity: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.velocity = np.zeros(len(self.load))


@cache
def _step_kernels(law: LawKernels, sides: Sides):
    """The loops over ranges of points of a law's `prepare` and `commit`."""
    read, _ = motion(sides)
    algebra = for_dimension(sides.dim, sides.components)
    row, set_row, add, scale = algebra.row, algebra.set_row, algebra.add, algebra.scale
    prepare, commit = law.prepare, law.commit

    @njit(nogil=True, **LEAN_ENTRY)
    def prepare_range(
        first, last, jump, velocity, w, area, step, theta, parameters, state, terms, details
    ):
        for i in range(first, last):
            prepare(
                i, row(jump, i), row(velocity, i), w, area[i], step, theta, parameters, state,
                terms, details,
            )  # fmt: skip

    @njit(nogil=True, **LEAN_ENTRY)
    def commit_range(
        first, last, v, c, jump, velocity, r, area, step, theta, parameters, state, terms, details,
        energy, status,
    ):  # fmt: skip
        for i in range(first, last):
            jump0, u = row(jump, i), read(v, c, i)
            mean = add(scale(theta, u), scale(1.0 - theta, row(velocity, i)))
            jump1 = add(jump0, scale(step, mean))
            status[i] = commit(
                i, jump0, jump1, u, row(r, i), area[i], step, theta, parameters, state, terms,
                details, energy,
            )  # fmt: skip
            set_row(jump, i, jump1)
            set_row(velocity, i, u)

    return prepare_range, commit_range


@cache
def _evolve_kernel(law: LawKernels, sides: Sides):
    """The loop over a range of points of a law's `evolve`."""
    read, _ = motion(sides)
    evolve = law.evolve

    @njit(nogil=True, **LEAN_ENTRY)
    def evolve_range(first, last, v, c, w, parameters, terms, details):
        largest = least = 0.0
        for i in range(first, last):
            change = evolve(i, read(v, c, i), w, parameters, terms, details)
            largest, least = max(largest, change), min(least, change)
        return largest, -least

    return evolve_range


@njit(**LEAN_ENTRY)
def _compliance_of_arms(c, frame, rows, cols, out, h, at):
    """As `_compliance`, of points with arms: H_s of each component is written out for its body.

    `h`, shape (components, n), and `at`, shape (n,), have room for the n columns of one side.
    """
    k, dim = c.start.shape[2], frame.shape[2]
    components = frame.shape[1]
    turns = dim if dim == 3 else 1
    count = k * dim + turns
    for i in range(len(out)):
        for entry in range(len(rows)):
            out[i, entry] = 0.0
        for s in range(2):
            base, n = c.body[i, s], c.size[i, s]
            first = c.rows[i, s, 0] - (c.start[i, s, 0] - base) * n
            for j in range(k):
                for d in range(dim):
                    at[j * dim + d] = c.start[i, s, j] - base + d
                    for x in range(components):
                        h[x, j * dim + d] = c.weights[i, s, j] * frame[i, x, d]
            rigid = c.turn[i, s] != c.start[i, s, 0]
            for d in range(turns):
                at[k * dim + d] = c.turn[i, s] - base + d if rigid else 0
                for x in range(components):
                    e, g = (0, 1) if dim == 2 else ((d + 1) % 3, (d + 2) % 3)
                    h[x, k * dim + d] = (
                        c.arms[i, s, e] * frame[i, x, g] - c.arms[i, s, g] * frame[i, x, e]
                    )
            for entry in range(len(rows)):
                total = 0.0
                for a in range(count):
                    for b in range(count):
                        total += (
                            h[rows[entry], a] * c.w[first + at[a] * n + at[b]] * h[cols[entry], b]
                        )
                out[i, entry] += total


@njit(**LEAN_ENTRY)
def _compliance(c, frame, rows, cols, out):
    """W_aa = H_c^T w H_c + H_a^T w H_a at each point, packed symmetric.

    Where the normal stands alone, zero if it is rounding beside the trace over all directions.
    """
    k, dim = c.start.shape[2], frame.shape[2]
    for i in range(len(out)):
        trace = 0.0
        for entry in range(len(rows)):
            total = 0.0
            for s in range(2):
                base, n = c.body[i, s], c.size[i, s]
                for a in range(k):
                    for b in range(k):
                        weight = c.weights[i, s, a] * c.weights[i, s, b]
                        column = c.start[i, s, b] - base
                        for x in range(dim):
                            trace += weight * c.w[c.rows[i, s, a] + x * n + column + x]
                        for x in range(dim):
                            fx = weight * frame[i, rows[entry], x]
                            for y in range(dim):
                                total += (
                                    fx
                                    * c.w[c.rows[i, s, a] + x * n + column + y]
                                    * frame[i, cols[entry], y]
                                )
            out[i, entry] = total
        if len(rows) == 1 and out[i, 0] <= SINGULAR * trace:
            out[i, 0] = 0.0


class _ContactSet(NamedTuple):
    """Contacts in use, by law, with what tells whether a search has found the same again."""

    nodes: np.ndarray
    law_of_point: np.ndarray
    keys: np.ndarray
    phase: np.ndarray
    groups: list[PointGroup]

    def are(self, found: FoundPoints, phase: np.ndarray) -> bool:
        """Whether the found contacts are these, at other places."""
        told = (found.points.nodes, found.law_of_point, found.keys, phase)
        return all(map(np.array_equal, self[:4], told))


class Interactions:
    """The interaction points of a scene and their laws.

    Args:
        points: all points.
        laws: the laws in use.
        law_of_point: shape (num_points,), index into `laws`.
        inverse: blocks of w on the interacting nodes; `update_inverse` replaces their values.
        initial_velocity: shape (num_nodes, dim), nodal velocities at the start (m/s).
        ordering: order of visit, "tiles" of neighbouring bodies, or "vertices" for
            `vertex_blocks.solve` (one block of w a node, one node a side).
        rigid_blocks: shape (num_rigid, 2 dim, 2 dim), blocks of w of rigid bodies, whose nodes, two
            a body, come after the others; None without any. `take_rigid` renews them.
        halo: what there is to exchange with other ranks, whose bodies' nodes come after this
            rank's; None where one rank has all bodies. Where ranks divide contacts of rigid bodies
            alone each has the nodes of all, and contacts may be divided otherwise in another step:
            the halo is then set before they are found. Everything that reads or moves all points
            is then done by all ranks together.

    Attributes:
        anchors: of bodies that interactions alone hold, None if there are none.
        groups: all points by law, permanent ones before those of contacts found.
        renewals: how often contacts were found anew.
        too_far: by how much internal variables have gone further in the step than the velocities
            last given to `evolve` ask for, relative: what iterates on the way broke for nothing.

    Raises:
        ValueError: a law index out of range, arrays whose lengths disagree, an unknown ordering,
            or "vertices" where w couples more than a node.
    """

    def __init__(
        self,
        points: InteractionPoints,
        laws: list[Law],
        law_of_point: np.ndarray,
        inverse: BodyInverse,
        initial_velocity: np.ndarray | None = None,
        ordering: str = "tiles",
        rigid_blocks: np.ndarray | None = None,
        halo: PointHalo | ContactHalo | None = None,
    ):
        law_of_point = np.asarray(law_of_point)
        if len(law_of_point) != len(points):
            raise ValueError(
                f"law_of_point should hold one law a point ({len(points)}), "
                f"got {len(law_of_point)}."
            )
        if len(points) and not (0 <= law_of_point.min() and law_of_point.max() < len(laws)):
            raise ValueError(
                f"law_of_point should index the {len(laws)} laws given, got values from "
                f"{law_of_point.min()} to {law_of_point.max()}."
            )
        if ordering not in ("tiles", "vertices"):
            raise ValueError(f'ordering should be "tiles" or "vertices", got {ordering!r}.')
        if ordering == "vertices" and (
            inverse.uniform_size != inverse.dim or points.nodes.shape[2] != 1
        ):
            raise ValueError(
                'ordering="vertices" needs nodal points (one node a side, got '
                f"{points.nodes.shape[2]}) and a lumped mass without bulk stiffness in w (blocks "
                f"of {inverse.dim} degrees of freedom, got {inverse.uniform_size or 'several'})."
            )
        self.dim = inverse.dim
        self.ordering = ordering
        self.laws = laws
        self.law_of_point = law_of_point.astype(np.min_scalar_type(max(len(laws) - 1, 0)))
        self._count = len(points)
        self._rigid_blocks = rigid_blocks
        self.halo = halo
        self._rigid_start = self._rigid_free = np.zeros((0, inverse.dim))
        self.bulk_inverse = inverse
        inverse = self.inverse = self._joined(inverse)
        self._still = inverse.still()
        self.committed_step = 0.0
        self.step_size, self.theta = 0.0, 0.5
        self.too_far = 0.0
        self.anchors: Anchors | None = None
        nodal = np.zeros((inverse.num_slots, self.dim))
        if initial_velocity is not None:
            nodal[: len(initial_velocity)] = initial_velocity
        self._vertex = None
        if ordering == "vertices":
            vertex = vertex_of_points(points.nodes[:, :, 0], inverse.num_nodes + 1)
            self._vertex = vertex.astype(np.int32)
        self._block_of_node = inverse.block_of_node().astype(np.int32)
        phase = np.zeros(len(points), int) if halo is None else halo.phase
        self._permanent = self._grouped(points, law_of_point, nodal, phase)
        self.groups = self._permanent
        self._found: list[_ContactSet] = []
        self._history: ContactHistory | None = None
        self.renewals = 0
        components = [g.kernels.components for g in self.groups]
        # Points whose groups have all of their frames are put together again when asked for.
        self._points = None
        if not components or min(components) < max(components) or points.arms is not None:
            self._points = points.with_components(max(components, default=1))
        self._take_inverse(self.groups)

    def _grouped(self, points, law_of_point, nodal, phase) -> list[PointGroup]:
        by_kernels: dict[LawKernels, list[int]] = {}
        for number in np.flatnonzero(np.bincount(law_of_point)).tolist():
            by_kernels.setdefault(self.laws[number].kernels(self.dim), []).append(number)
        groups = []
        for kernels, numbers in by_kernels.items():
            indices = np.flatnonzero(np.isin(law_of_point, numbers))
            for number in np.unique(phase[indices]).tolist():
                here = indices[phase[indices] == number]
                group = self._group(kernels, points, law_of_point, here, nodal)
                groups.append(replace(group, phase=number))
        return groups

    def _group(self, kernels, points, law_of_point, indices, nodal, like=None) -> PointGroup:
        """A group with the start of its points; `like` has the same points as they were before."""
        points = points.with_components(kernels.components)
        if like is None:
            num_blocks = len(self._still)
            blocks = self._blocks_of(points.nodes[indices])
            ordering = self._ordered(blocks, num_blocks, indices)
            tile_bodies = bodies_of_tiles(ordering, blocks, num_blocks)
            indices = indices[ordering.order]
            points = points.take(indices)
            couplings = couple(points, self.inverse)
        else:
            indices, ordering, tile_bodies = like.indices, like.ordering, like.tile_bodies
            points = points.take(indices)
            couplings = couple_again(like.couplings, points)
        n, components = len(points), kernels.components
        which = law_of_point[indices]
        numbers = np.flatnonzero(np.bincount(which))
        which = np.searchsorted(numbers, which)
        laws = [self.laws[number] for number in numbers]
        parameters = np.array([law.parameters() for law in laws]).reshape(len(laws), -1)[which]
        state = np.array([law.initial_state() for law in laws]).reshape(len(laws), -1)[which]
        jump = np.zeros((n, components))
        jump[:, 0] = points.gap
        return PointGroup(
            kernels=kernels,
            indices=indices.astype(np.int32),
            points=points,
            ordering=ordering,
            tile_bodies=tile_bodies,
            couplings=couplings,
            parameters=parameters.astype(float),
            state=state.astype(float),
            terms=np.zeros((n, kernels.num_terms)),
            details=np.zeros((n, kernels.num_details)),
            compliance=np.zeros((n, components * (components + 1) // 2)),
            inverse_area=(1.0 / points.area).astype(np.float32),
            jump=jump,
            velocity=points.relative(nodal),
            impulse=np.zeros((n, components)),
            committed_impulse=np.zeros((n, components)),
            energy=np.zeros((n, len(kernels.energies))),
            status=np.zeros(n, np.int8),
            sides=Sides(self.dim, components, points.nodes.shape[2], points.arms is not None),
            blocks=self._blocks(couplings),
        )

    def _ordered(self, blocks, num_blocks: int, indices) -> Ordering:
        if self._vertex is None:
            return order_points(blocks, num_blocks)
        vertex, count = self._vertex[indices], int(self._vertex.max()) + 1
        return order_by_vertex(blocks, num_blocks, vertex, count)

    def _blocks(self, couplings: Couplings) -> Blocks:
        """The size that the blocks of w have, all of them or those of a group's points."""
        if self.inverse.uniform_size:
            return Blocks(self.inverse.uniform_size, aligned=True)
        ground = self.inverse.node_offsets[-2] * self.dim
        sizes = np.unique(couplings.size[couplings.body != ground])
        room = len(self.inverse.data) - self.inverse.data_offsets[-2]
        alike = len(sizes) == 1 and sizes[0] ** 2 <= room
        return Blocks(int(sizes[0])) if alike else Blocks()

    def __len__(self) -> int:
        return self._count

    @property
    def points(self) -> InteractionPoints:
        """All permanent points in the scene's order, those taken out included."""
        if self._points is not None:
            return self._points
        where = np.empty(self._count, np.int32)
        where[np.concatenate([g.indices for g in self._permanent])] = np.arange(self._count)
        return join_points([g.points for g in self._permanent]).take(where)

    def update_inverse(self, inverse: BodyInverse) -> None:
        """Take new values of w (same blocks) of meshed bodies; the compliances W_aa follow."""
        self.bulk_inverse = inverse
        self.inverse = self._joined(inverse)
        self._take_inverse(self.groups)

    def _joined(self, inverse: BodyInverse) -> BodyInverse:
        if self._rigid_blocks is not None:
            return inverse.joined(self._rigid_blocks)
        return inverse if self.halo is None else self.halo.with_ghosts(inverse)

    def take_rigid(self, start: np.ndarray, free: np.ndarray) -> None:
        """Take what a prediction of the rigid bodies' step gives; `rigid_blocks` holds their w.

        In 2D w does not change as bodies turn, and is not read again.

        Args:
            start: shape (2 num_rigid, dim), velocities at the start of the step (m/s, rad/s).
            free: shape (2 num_rigid, dim), free velocities.
        """
        self._rigid_start, self._rigid_free = start, free
        if self.dim == 2:
            return
        offsets = self.inverse.data_offsets
        blocks = self._rigid_blocks
        self.inverse.data[offsets[-2 - len(blocks)] : offsets[-2]] = blocks.ravel()

    def _take_inverse(self, groups: list[PointGroup]) -> None:
        for group in groups:
            rows, cols = sym_indices(group.kernels.components)
            group.couplings = group.couplings._replace(w=self.inverse.data)
            arguments = group.couplings, group.points.frame, rows, cols, group.compliance
            if group.sides.arms:
                dim, components, k, _ = group.sides
                columns = k * dim + (dim if dim == 3 else 1)
                h, at = np.empty((components, columns)), np.empty(columns, np.int64)
                _compliance_of_arms(*arguments, h, at)
            else:
                _compliance(*arguments)
        traces = [g.compliance[:, np.equal(*sym_indices(g.kernels.components))].sum(1)
                  for g in self.groups]  # fmt: skip
        stiffness = sum(float(np.sum(t[t > 0.0] ** -2.0)) for t in traces)
        mass = sum(float(np.sum(1.0 / t[t > 0.0])) for t in traces)
        others = sum(not g.sides.arms or g.kernels.evolve is not None for g in self.groups)
        counts = (stiffness, mass, len(self.groups), others)
        stiffness, self._mass, groups, others = self._sum(np.array(counts, float)).tolist()
        self._stiffness = math.sqrt(stiffness)
        self._all_of_rigid = groups > 0 and others == 0

    def _sum(self, value):
        """Sum over all ranks."""
        return value if self.halo is None else self.halo.ranks.sum(value)

    def _whole(self, values: np.ndarray) -> np.ndarray:
        """Of values at this rank's permanent points, shape (num_points, ...), those of all."""
        return values if self.halo is None else self.halo.gather(values)

    @property
    def num_points(self) -> int:
        """Number of permanent points, on all ranks."""
        return int(self._sum(len(self)))

    def free_velocities(self, bulk: np.ndarray) -> np.ndarray:
        """Free velocities of all slots, flat.

        Args:
            bulk: shape (num_nodes, dim), those of the interacting nodes of meshed bodies (m/s).
        """
        return self._slots(bulk, self._rigid_free).reshape(-1)

    def _slots(self, bulk: np.ndarray, rigid: np.ndarray) -> np.ndarray:
        slots = np.zeros((self.inverse.num_slots, self.dim))
        slots[: len(bulk)] = bulk
        slots[len(bulk) : len(bulk) + len(rigid)] = rigid
        return slots

    def rigid_part(self, slots: np.ndarray) -> np.ndarray:
        """Of an array over all slots, what belongs to rigid bodies, shape (2 num_rigid, dim)."""
        first = self.bulk_inverse.num_nodes
        return slots.reshape(-1, self.dim)[first : self.inverse.num_nodes]

    def find_contacts(
        self, found: list[FoundPoints], bulk_velocity: np.ndarray, step: float, theta: float
    ) -> None:
        """Put the contacts that searches have found in the place of those of the last step.

        Contacts with the key of one that was there go on with its impulse, history and slip.

        Args:
            found: sets of contacts, of which each law has one for each way its sides are given.
            bulk_velocity: shape (num_nodes, dim), of the interacting nodes of meshed bodies at the
                start of the step (m/s).
            step: h (s).
            theta: weight of the end of the step.
        """
        start = self._slots(bulk_velocity, self._rigid_start)
        before, self._found = self._found, []
        for new in found:
            phase = np.zeros(len(new.keys), int)
            if self.halo is not None:
                phase = self.halo.phase_of(new.points)
            same = next((old for old in before if old.are(new, phase)), None)
            if same is None:
                groups = self._grouped(new.points, new.law_of_point, start, phase)
            else:
                groups = [
                    replace(
                        self._group(
                            g.kernels, new.points, new.law_of_point, g.indices, start, like=g
                        ),
                        phase=g.phase,
                    )
                    for g in same.groups
                ]
            for group in groups:
                group.jump[:, 0] -= step * (1.0 - theta) * group.velocity[:, 0]
                if self._history is not None:
                    self._history.hand_on(group, new.keys)
            known = (new.points.nodes, new.law_of_point, new.keys, phase)
            self._found.append(_ContactSet(*known, groups))
        self.groups = self._permanent + self.contacts
        self.renewals += 1
        self._take_inverse(self.contacts)

    @property
    def contacts(self) -> list[PointGroup]:
        """The groups of contacts that were found."""
        return [group for known in self._found for group in known.groups]

    def unbonded(self) -> np.ndarray:
        """Which permanent points nothing holds together, shape (num_points,).

        That is where damage is complete, or whose law has no damage and no stored energy.
        """
        loose = np.ones(len(self), bool)
        for g in self._permanent:
            if "damage" in g.kernels.state_names:
                loose[g.indices] = g.state[:, g.kernels.state_names.index("damage")] == 0.0
            else:
                loose[g.indices] = "impact" in g.kernels.energies
        return self._whole(loose)

    def retire(self, indices: np.ndarray) -> None:
        """Take permanent points out, for good; what `gather` gives of them is zero.

        Args:
            indices: their numbers in the scene's order.
        """
        self._points = self.points
        for number, group in enumerate(self._permanent):
            kept = np.flatnonzero(~np.isin(group.indices, indices))
            if len(kept) < len(group):
                self._permanent[number] = self._subset(group, kept)
        self.groups = self._permanent + self.contacts
        self.renewals += 1

    def _subset(self, group: PointGroup, kept: np.ndarray) -> PointGroup:
        # in the scene's order first: who retires together leaves no trace in the order of visit
        kept = kept[np.argsort(group.indices[kept])]
        blocks = self._blocks_of(group.points.nodes[kept])
        ordering = order_points(blocks, len(self._still))
        kept = kept[ordering.order]
        points = group.points.take(kept)
        arrays = {
            name: np.ascontiguousarray(array[kept])
            for name, array in vars(group).items()
            if isinstance(array, np.ndarray)
        }
        return replace(
            group, points=points, ordering=ordering, couplings=couple(points, self.inverse),
            tile_bodies=bodies_of_tiles(ordering, blocks, len(self._still)), **arrays,
        )  # fmt: skip

    def _blocks_of(self, nodes: np.ndarray) -> np.ndarray:
        """Blocks of both sides of points; what cannot be moved counts as the ground."""
        blocks = self._block_of_node[nodes[:, :, 0]]
        return np.where(self._still[blocks], len(self._still) - 1, blocks)

    def rounding(self, velocity: np.ndarray) -> float:
        """|r| of impulses that move the bodies by the rounding of their velocities (N s).

        Args:
            velocity: shape (num_slots * dim,), m/s.
        """
        speed = float(np.abs(velocity).max(initial=0.0))
        if self.halo is not None:
            speed = self.halo.ranks.max(speed)
        return _ROUNDING * speed * self._stiffness

    @property
    def judged_by_velocities(self) -> bool:
        """Whether all points are contacts of rigid bodies (`nscd/solvers/nlgs.py`)."""
        return self._all_of_rigid

    def kick(self, free: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
        """|w H r| of the present impulses in the norm of the kinetic energy, and its rounding.

        Args:
            free, velocity: shape (num_slots * dim,), before and after the impulses (m/s).

        Returns:
            (p . w p)^(1/2) with p = H r, and the same of the rounding of velocities; kg^(1/2) m/s.
        """
        energy = self._sum(float(np.vdot(self._own_impulses(), velocity - free)))
        speed = float(np.abs(velocity).max(initial=0.0))
        return math.sqrt(max(energy, 0.0)), _ROUNDING * speed * math.sqrt(self._mass)

    def begin_step(self, step: float, theta: float) -> None:
        """Set the constants of the step in every law; impulses start from the last step's."""
        ratio = step / self.committed_step if self.committed_step > 0.0 else 1.0
        for g in self.groups:
            np.multiply(g.committed_impulse, ratio, out=g.impulse)
        self.step_size, self.theta = step, theta
        self.prepare()

    def prepare(self) -> None:
        """Renew the laws' constants of the step, after `update_inverse`."""
        for g in self.groups:
            prepare, _ = _step_kernels(g.kernels, g.sides)
            in_ranges(
                prepare, len(g), g.jump, g.velocity, g.compliance, g.points.area, self.step_size,
                self.theta, g.parameters, g.state, g.terms, g.details,
            )  # fmt: skip

    def evolve(self, velocity: np.ndarray) -> float:
        """Let the laws' internal variables follow the end velocities found.

        Args:
            velocity: shape (num_slots * dim,), m/s.

        Returns:
            The largest relative change, zero when all have arrived.
        """
        largest, self.too_far = 0.0, 0.0
        for g in self.groups:
            if g.kernels.evolve is not None:
                changes = in_ranges(
                    _evolve_kernel(g.kernels, g.sides), len(g), velocity, g.couplings,
                    g.compliance, g.parameters, g.terms, g.details,
                )  # fmt: skip
                for change, too_far in changes:
                    largest, self.too_far = max(largest, change), max(self.too_far, too_far)
        if self.halo is not None:
            both = self.halo.ranks.max(np.array([largest, self.too_far]))
            largest, self.too_far = both.tolist()
        return largest

    def add_velocity(self, velocity: np.ndarray) -> None:
        """Add w H r to `velocity`, shape (num_slots * dim,)."""
        if self.halo is not None:
            self.halo.clear(velocity)
        for g in self.groups:
            push_kernel(g.sides, g.blocks)(velocity, g.couplings, g.impulse)
        if self.halo is not None:
            self.halo.everywhere.add_back(velocity)
            self.halo.everywhere.forward(velocity)

    def impulses(self) -> np.ndarray:
        """H r: impulses of the current step on the interacting nodes, shape (num_slots, dim)."""
        total = self._own_impulses()
        if self.halo is not None:
            self.halo.everywhere.add_back(total.reshape(-1))
        return total

    def _own_impulses(self) -> np.ndarray:
        """H r of this rank's points."""
        total = np.zeros((self.inverse.num_slots, self.dim))
        for g in self.groups:
            spread = spread_kernel(g.sides)
            spread(total.reshape(-1), g.couplings, g.impulse)
        return total

    def commit(self, velocity: np.ndarray) -> StepWork:
        """End the step: jumps, damage and energies move on.

        Args:
            velocity: shape (num_slots * dim,), end-of-step velocities of the interacting nodes.

        Returns:
            The energies of the step.
        """
        totals = dict.fromkeys(ENERGIES, 0.0)
        for g in self.groups:
            _, commit = _step_kernels(g.kernels, g.sides)
            in_ranges(
                commit, len(g), velocity, g.couplings, g.jump, g.velocity, g.impulse, g.points.area,
                self.step_size, self.theta, g.parameters, g.state, g.terms, g.details, g.energy,
                g.status,
            )  # fmt: skip
            g.committed_impulse[:] = g.impulse
            for name, total in zip(g.kernels.energies, g.energy.sum(axis=0), strict=True):
                totals[name] += total
        self.committed_step = self.step_size
        if self.renewals:
            self._history = ContactHistory(
                [(group, known.keys) for known in self._found for group in known.groups]
            )
        return StepWork(*self._sum(np.array([totals[name] for name in StepWork._fields])).tolist())

    def gather(self, name: str) -> np.ndarray:
        """An array over the permanent points, in the scene's order.

        Local vectors have `dim` columns, energies those of ENERGIES: what a law has no use for, as
        frictionless contact for anything tangential, reads zero.

        Args:
            name: "jump" (m), "velocity" (m/s), "impulse" (N s), "traction" (Pa, opening negative
                as it pulls the sides together), "status", "energy", "law" (index into `laws`),
                "area" (m^2; 2D: m), or a history variable of the laws such as "damage" (NaN-free:
                laws without it give 0).
        """
        return self._whole(self.local(name))

    def local(self, name: str) -> np.ndarray:
        """As `gather`, of this rank's points."""
        if name == "traction":
            scale = max(self.committed_step, np.finfo(float).tiny) * self.points.area
            return self.local("impulse") / scale[:, None]
        if name in ("law", "area"):
            return self.law_of_point if name == "law" else self.points.area
        widths = {"compliance": self.dim * (self.dim + 1) // 2, "energy": len(ENERGIES)}
        widths |= dict.fromkeys(("jump", "velocity", "impulse"), self.dim)
        if name in widths:
            out = np.zeros((len(self), widths[name]))
            for g in self._permanent:
                own = getattr(g, name)
                columns = range(own.shape[1])
                if name == "energy":
                    columns = [ENERGIES.index(energy) for energy in g.kernels.energies]
                out[np.ix_(g.indices, columns)] = own
            return out
        out = np.zeros(len(self))
        for g in self._permanent:
            if name in g.kernels.state_names:
                out[g.indices] = g.state[:, g.kernels.state_names.index(name)]
            elif hasattr(g, name):
                out[g.indices] = getattr(g, name)
        return out

    @property
    def nbytes(self) -> int:
        """Memory held by points and blocks of w, in bytes."""
        inverse = self.inverse
        shared = [
            self.law_of_point, self._block_of_node, self._still, inverse.data,
            inverse.node_offsets, inverse.data_offsets,
        ]  # fmt: skip
        shared += [] if self._vertex is None else [self._vertex]
        shared += [] if self._points is None else vars(self._points).values()
        return sum(g.nbytes for g in self.groups) + sum(a.nbytes for a in shared if a is not None)

    def saved(self) -> dict:
        """What the next step depends on, the inverse and what is found anew left out.

        Arrays over the permanent points are `Rows` in the scene's order, as wide as the widest of
        the laws asks for; of contacts that were found their history is kept.
        """
        kernels = [law.kernels(self.dim) for law in self.laws]
        components = max((k.components for k in kernels), default=0)
        widths = dict.fromkeys(("jump", "velocity", "committed_impulse"), components)
        widths["energy"] = max((len(k.energies) for k in kernels), default=0)
        widths["state"] = max((len(k.state_names) for k in kernels), default=0)
        number = self._numbers()
        arrays = {name: np.zeros((len(self), width)) for name, width in widths.items()}
        arrays |= {"status": np.zeros(len(self), np.int8), "kept": np.zeros(len(self), bool)}
        for g in self._permanent:
            arrays["kept"][g.indices] = True
            arrays["status"][g.indices] = g.status
            for name in widths:
                own = getattr(g, name)
                arrays[name][g.indices, : own.shape[1]] = own
        saved = {name: Rows(number, values) for name, values in arrays.items()}
        saved |= {
            "committed_step": self.committed_step, "step_size": self.step_size,
            "theta": self.theta,
        }  # fmt: skip
        if self._history is not None:
            if self.halo is not None:
                self.share_history(self.halo.ranks)
            law_of = {kernel: law for law, kernel in reversed(list(enumerate(kernels)))}
            saved["contacts"] = self._history.saved(law_of)
        return saved

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order; points as they were before any retired."""
        number = self._numbers()
        gone = np.flatnonzero(~saved["kept"][number])
        if len(gone):
            self.retire(gone)
        for g in self._permanent:
            for name in ("jump", "velocity", "committed_impulse", "energy", "state"):
                own = getattr(g, name)
                own[:] = saved[name][number[g.indices], : own.shape[1]]
            g.impulse[:] = g.committed_impulse
            g.status[:] = saved["status"][number[g.indices]]
        self.committed_step = saved["committed_step"]
        self.step_size, self.theta = saved["step_size"], saved["theta"]
        kernels = [law.kernels(self.dim) for law in self.laws]
        self._history = ContactHistory.restored(saved.get("contacts", {}), kernels, self.dim)

    def _numbers(self) -> np.ndarray:
        """Numbers of this rank's permanent points in the scene's order, shape (num_points,)."""
        return np.arange(len(self)) if self.halo is None else self.halo.numbers

    def share_history(self, ranks: Reductions) -> None:
        """Let contacts go on from the last step on whichever rank they are found now.

        All ranks call it together.
        """
        if self._history is not None:
            self._history.share(ranks, [law.kernels(self.dim) for law in self.laws])
