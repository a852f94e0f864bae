# SPDX-License-Identifier: LGPL-3.0-or-later
"""All interaction points of a scene, sorted by law: their bodies, contacts that come and go."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.contact_history import ContactHistory, kernels_of_contacts
from xper_fx.nscd.found_contacts import FoundContacts, FoundPoints
from xper_fx.nscd.grouping import Grouping
from xper_fx.nscd.halo_protocol import ContactHalo, PointHalo, Reductions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws.law import Law, LawKernels
from xper_fx.nscd.ordering import vertex_of_points
from xper_fx.nscd.own_compliance import update_compliance
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.stepped_points import ROUNDING, SteppedPoints
from xper_fx.support.saved_rows import Rows

if TYPE_CHECKING:
    from xper_fx.nscd.anchors import Anchors
    from xper_fx.nscd.turning_frames import LipMotion


class Interactions(SteppedPoints):
    """The interaction points of a scene and their laws.

    Args:
        points: all points.
        laws: the laws in use.
        law_of_point: shape (num_points,), index into `laws`.
        inverse: blocks of w on the interacting nodes; `update_inverse` replaces their values.
        initial_velocity: shape (num_nodes, dim), nodal velocities at the start (m/s).
        ordering: order of visit, "tiles" of neighbouring bodies, or "vertices" for
            `VertexBlocks` (one block of w a node, one node a side).
        rigid_blocks: shape (num_rigid, 2 dim, 2 dim), blocks of w of rigid bodies, whose nodes, two
            a body, come after the others; None without any. `take_rigid` renews them.
        halo: what there is to exchange with other ranks, whose bodies' nodes come after this
            rank's; None where one rank has all bodies. Where ranks divide contacts of rigid bodies
            alone each has the nodes of all, and contacts may be divided otherwise in another step:
            the halo then comes with them. Everything that reads or moves all points is then done
            by all ranks together.
        splits: whether initially rigid bonds get points where they may open, and not before, as
            `splitting/` has it; of points ordered by vertices.

    Attributes:
        fused: what the vertices are that initially rigid bonds hold; None where all bonds have
            points.
        anchors: of bodies that interactions alone hold, None if there are none; the bulk renews
            them before each solve.
        groups: all points by law: permanent ones, contacts found, their rolling points.
        renewals: how often contacts were found anew.
        exchanges: how often w of meshed bodies was exchanged for another.

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
        splits: bool = False,
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
        self.committed_step = 0.0
        self.step_size, self.theta = 0.0, 0.5
        self.too_far = self.from_scheme = 0.0
        self.anchors: Anchors | None = None
        nodal = np.zeros((inverse.num_slots, self.dim))
        if initial_velocity is not None:
            nodal[: len(initial_velocity)] = initial_velocity
        vertex = None
        if ordering == "vertices":
            vertex = vertex_of_points(points.nodes[:, :, 0], inverse.num_nodes + 1)
            vertex = vertex.astype(np.int32)
        self._grouping = Grouping(laws, inverse, vertex)
        phase = np.zeros(len(points), int) if halo is None else halo.phase
        rigid = [n for n, law in enumerate(laws) if splits and law.kernels(self.dim).rigid]
        self._permanent = self._grouping.groups(
            inverse, points, law_of_point, nodal, phase, left_out=frozenset(rigid)
        )
        self.fused = self._fused(points, vertex, nodal) if rigid else None
        self.groups = self._permanent
        self._turns = bool(self.largest(any(g.turning is not None for g in self._permanent)))
        self._found, self._carried = FoundContacts(), FoundContacts()
        self.renewals = self.exchanges = 0
        components = [g.kernels.components for g in self.groups]
        # Points whose groups have all of their frames are put together again when asked for.
        self._points = None
        alike = components and min(components) == max(components) and self.fused is None
        if not alike or points.lever_arms is not None:
            self._points = points.with_components(max(components, default=1))
        self._take_inverse(self.groups)

    def _fused(self, points: InteractionPoints, vertex: np.ndarray, nodal: np.ndarray):
        """The vertices that initially rigid bonds hold; their points become those of groups."""
        from xper_fx.nscd.splitting.fused_points import FusedPoints

        fused = FusedPoints(
            points, vertex, self.laws, self.law_of_point, self.inverse, self._permanent,
            lambda kernels, indices: self._grouping.as_given(
                self.inverse, kernels, points, self.law_of_point, indices
            ),
        )  # fmt: skip
        fused.require_one_velocity(nodal)
        self._permanent = fused.groups
        return fused

    def wake(self, vertices: np.ndarray) -> None:
        """Give whole vertices the points of their bonds, within a step.

        Args:
            vertices: their numbers.
        """
        for group in self.fused.wake(vertices):
            self._prepare(group)

    def update_inverse(self, inverse: BodyInverse) -> None:
        """Take new values of w (same blocks) of meshed bodies; the compliances W_aa follow."""
        self.bulk_inverse = inverse
        self.inverse = self._joined(inverse)
        self.exchanges += 1
        self._take_inverse(self.groups)

    def take_anchors(self, anchors: Anchors) -> None:
        """Take what holds bodies that interactions alone hold, before each solution."""
        self.anchors = anchors

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
            update_compliance(group, self.inverse)
        self._find_uneven()
        self._add_up()

    def _add_up(self) -> None:
        """Add up over the points of all ranks what their compliances and kinds tell."""
        traces = [g.compliance[:, np.equal(*sym_indices(g.kernels.components))].sum(1)
                  for g in self.groups]  # fmt: skip
        stiffness = sum(float(np.sum(t[t > 0.0] ** -2.0)) for t in traces)
        mass = sum(float(np.sum(1.0 / t[t > 0.0])) for t in traces)
        points = self._permanent + self.contacts
        others = sum(not g.sides.lever_arms or g.kernels.evolve is not None for g in points)
        counts = (stiffness, mass, len(points), others)
        stiffness, self._mass, groups, others = self.total(np.array(counts, float)).tolist()
        self._stiffness = math.sqrt(stiffness)
        self._all_of_rigid = groups > 0 and others == 0

    def _find_uneven(self) -> None:
        """Find the turning points whose compliance hangs on their frame; None: w has blocks."""
        turning = [g for g in self._permanent if g.turning is not None]
        even = self.inverse.even_nodes() if turning else None
        self._uneven = None
        if even is not None:
            self._uneven = {
                id(g): np.flatnonzero(~even[g.points.nodes].all(axis=(1, 2))) for g in turning
            }

    def lip_motion(
        self,
        displacement: np.ndarray,
        velocity: np.ndarray,
        mean: np.ndarray,
        gradient: np.ndarray | None = None,
        rate: np.ndarray | None = None,
    ) -> LipMotion:
        """What `turn` wants, from the interacting nodes of meshed bodies.

        Args:
            displacement, velocity, mean: shape (num_nodes, dim), see `LipMotion`.
            gradient, rate: of a periodic cell, see `LipMotion`.
        """
        from xper_fx.nscd.turning_frames import LipMotion

        at_slots = []
        for nodal in (displacement, velocity, mean)[: 2 if mean is velocity else 3]:
            at_slots.append(np.zeros(self.inverse.num_slots * self.dim))
            self.move_bulk(at_slots[-1], nodal)
        if gradient is None:
            gradient, rate = np.eye(self.dim), np.zeros((self.dim, self.dim))
        return LipMotion(at_slots[0], at_slots[1], at_slots[-1], gradient, rate)

    def move_bulk(self, values: np.ndarray, nodal: np.ndarray) -> None:
        """Give values of meshed bodies to their slots and to those of ghosts.

        Args:
            values: shape (num_slots * dim,), changed.
            nodal: shape (num_nodes, dim), of the interacting nodes of meshed bodies.
        """
        values.reshape(-1, self.dim)[: len(nodal)] = nodal
        self.refresh_ghosts(values)

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
        self,
        found: list[FoundPoints],
        bulk_velocity: np.ndarray,
        step: float,
        theta: float,
        halo: ContactHalo | None = None,
    ) -> None:
        """Put the contacts that searches have found in the place of those of the last step.

        Contacts with the key of one that was there go on with its impulse, history and slip.

        Args:
            found: sets of contacts, of which each law has one for each way its sides are given.
            bulk_velocity: shape (num_nodes, dim), of the interacting nodes of meshed bodies at the
                start of the step (m/s).
            step: h (s).
            theta: weight of the end of the step.
            halo: of ranks that divide these contacts.
        """
        self.halo = halo
        start = self._slots(bulk_velocity, self._rigid_start)
        opened = step * (1.0 - theta)
        self._found.renew(found, self._grouping, self.inverse, halo, start, opened)
        self._regroup()
        self._take_inverse(self.contacts + self.rolling)

    def move_joints(self, rows: FoundPoints, step: float, theta: float) -> None:
        """Put the rows of joints where bodies have moved to in the middle of a step.

        Args:
            rows: of all joints, the same in each step.
            step: h (s).
            theta: weight of the end of the step.
        """
        start = self._slots(np.zeros((self.bulk_inverse.num_nodes, self.dim)), self._rigid_start)
        opened = step * (1.0 - theta)
        self._carried.renew([rows], self._grouping, self.inverse, None, start, opened)
        self._regroup()
        self._take_inverse(self.joints)

    def _regroup(self) -> None:
        self.groups = self._permanent + self.joints + self.contacts + self.rolling
        self.renewals += 1

    def deactivate(self, indices: np.ndarray) -> None:
        """Take permanent points out, for good; what `gather` gives of them is zero.

        Args:
            indices: their numbers in the scene's order.
        """
        self._points = self.points
        for number, group in enumerate(self._permanent):
            kept = np.flatnonzero(~np.isin(group.indices, indices))
            if len(kept) < len(group):
                self._permanent[number] = self._grouping.subset(self.inverse, group, kept)
        self._regroup()
        self._find_uneven()

    def rounding(self, velocity: np.ndarray) -> float:
        """|r| of impulses that move the bodies by the rounding of their velocities (N s).

        Args:
            velocity: shape (num_slots * dim,), m/s.
        """
        if self._stiffness is None:
            self._add_up()
        speed = self.largest(float(np.abs(velocity).max(initial=0.0)))
        return ROUNDING * speed * self._stiffness

    @property
    def uses_velocity_criterion(self) -> bool:
        """Whether all points are contacts of rigid bodies (`nscd/solvers/nlgs.py`)."""
        return self._all_of_rigid

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
        if self.fused is not None:
            arrays["kept"][self.fused.asleep] = True
            arrays["split"] = self.fused.turn_of_points()
        if self.turns:  # lips that face each other no more keep a frame of some time
            arrays["frame"] = np.zeros((len(self), components, self.dim))
            for g in self._permanent:
                frame = g.points.frame
                arrays["frame"][g.indices, : frame.shape[1]] = frame
        saved = {name: Rows(number, values) for name, values in arrays.items()}
        saved |= {
            "committed_step": self.committed_step, "step_size": self.step_size,
            "theta": self.theta,
        }  # fmt: skip
        if self._found.history is not None:
            if self.halo is not None:
                self.share_history(self.halo.ranks)
            saved["contacts"] = self._found.history.saved(self._kernels_of_contacts())
        if self._carried.history is not None:
            saved["joints"] = self._carried.history.saved(self._kernels_of_contacts())
        return saved

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order; points as they were before any retired."""
        number = self._numbers()
        gone = np.flatnonzero(~saved["kept"][number])
        if len(gone):
            self.deactivate(gone)
        if self.fused is not None:
            self.fused.split_again(saved["split"][number])
        for g in self._permanent:
            for name in ("jump", "velocity", "committed_impulse", "energy", "state"):
                own = getattr(g, name)
                own[:] = saved[name][number[g.indices], : own.shape[1]]
            g.impulse[:] = g.committed_impulse
            g.status[:] = saved["status"][number[g.indices]]
            if g.turning is not None:
                g.points.frame[:] = saved["frame"][number[g.indices], : g.points.frame.shape[1]]
                g.couplings.frame[:] = g.points.frame[:, : g.couplings.frame.shape[1]]
        self.committed_step = saved["committed_step"]
        self.step_size, self.theta = saved["step_size"], saved["theta"]
        kernels = self._kernels_of_contacts()
        for name, points in (("contacts", self._found), ("joints", self._carried)):
            points.history = ContactHistory.restored(saved.get(name, {}), kernels, self.dim)

    def _kernels_of_contacts(self) -> list[LawKernels | None]:
        """See `kernels_of_contacts`."""
        return kernels_of_contacts(self.laws, self.dim)

    def _numbers(self) -> np.ndarray:
        """Numbers of this rank's permanent points in the scene's order, shape (num_points,)."""
        return np.arange(len(self)) if self.halo is None else self.halo.numbers

    def share_history(self, ranks: Reductions) -> None:
        """Let contacts go on from the last step on whichever rank they are found now.

        All ranks call it together.
        """
        if self._found.history is not None:
            self._found.history.share(ranks, self._kernels_of_contacts())
