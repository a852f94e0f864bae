# SPDX-License-Identifier: LGPL-3.0-or-later
"""All interaction points of a scene, sorted by law: their bodies, contacts that come and go."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.algebra.small import sym_indices
from xper_fx.nscd.found_contacts import FoundContacts, FoundPoints
from xper_fx.nscd.halo_protocol import ContactHalo, PointHalo, Reductions, RigidSharing
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.own_compliance import update_compliance
from xper_fx.nscd.permanent_groups import PermanentGroups
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.stepped_points import ROUNDING, SteppedPoints

if TYPE_CHECKING:
    from xper_fx.nscd.anchors import Anchors
    from xper_fx.nscd.rigid.driven_motion import DrivenMotion
    from xper_fx.nscd.turning_frames import LipMotion

# Fbar and its rate where there is no periodic cell.
_NONE = np.zeros((0, 0))


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
        rigid_share: which of the rigid bodies are this rank's where ranks divide meshed bodies;
            their slots come before those of ghosts. None where all are here.
        splits: whether initially rigid bonds get points where they may open, and not before, as
            `splitting/` has it; of points ordered by vertices.

    Attributes:
        fused: what the vertices are that initially rigid bonds hold; None where all bonds have
            points.
        anchors: of bodies that interactions alone hold, None if there are none; the bulk renews
            them before each solve.
        rigid_blocks_of_all: as `rigid_blocks` was given.
        own_inverse: blocks of w of this rank's bodies, meshed and rigid, without those of ghosts.
        groups: all points by law: permanent ones, contacts found, their rolling points.
        driven: motion of rigid bodies that are driven, in static runs; None without any.
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
        rigid_share: RigidSharing | None = None,
    ):
        self.dim, self.ordering, self.laws = inverse.dim, ordering, laws
        self.halo, self._rigid_share = halo, rigid_share
        none = np.zeros((0, 2 * self.dim, 2 * self.dim))
        self.rigid_blocks_of_all = none if rigid_blocks is None else rigid_blocks
        self._by_node = ordering == "vertices"
        self._rigid_start = self._rigid_free = np.zeros((0, inverse.dim))
        self.bulk_inverse, inverse = inverse, self._joined(inverse)
        self.committed_step, self.step_size, self.theta = 0.0, 0.0, 0.5
        self.too_far = self.from_scheme = 0.0
        self.anchors: Anchors | None = None
        self.driven: DrivenMotion | None = None
        nodal = np.zeros((inverse.num_slots, self.dim))
        if initial_velocity is not None:
            nodal[: len(initial_velocity)] = initial_velocity
        phase = np.zeros(len(points), int) if halo is None else halo.phase
        self._permanent = PermanentGroups(
            points, laws, law_of_point, inverse, nodal, phase, ordering, splits
        )
        self.inverse = self._permanent.inverse
        self.fused, self.groups = self._permanent.fused, self._permanent.groups
        if self.fused is not None:
            self.fused.require_one_velocity(nodal, self.largest)
        self.turns = bool(self.largest(self._permanent.turn))
        grouping = self._permanent.grouping.by_tiles()
        self._found, self._carried = (FoundContacts(grouping, laws, self.dim) for _ in range(2))
        self.renewals = self.exchanges = 0
        self._jointed = False
        self._take_inverse(self.groups)

    def turn_on_nodes(self, count: int) -> bool:
        """Whether turning frames ask of no slots but the first `count`, and no rank of others."""
        alone = self.halo is None and self.fused is None
        return alone and self._permanent.lip_slots <= count

    def wake(self, vertices: np.ndarray) -> int:
        """Give whole vertices the points of their bonds, within a step.

        Args:
            vertices: their numbers.

        Returns:
            What `require_no_flips` takes.
        """
        flipped = 0
        for group in self.fused.wake(vertices):
            if group.turning is not None and (place := self.turn_group(group)) >= 0:
                flipped = 1 + int(self.numbers[group.indices[place]])
            elif self.step_size > 0.0:
                self.prepare_group(group)
        self._join_groups()
        return flipped

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
        """With blocks of rigid bodies and of ghosts behind those of meshed ones."""
        rigid = len(self.rigid_blocks_of_all) > 0
        if rigid:
            inverse = inverse.joined(self.rigid_blocks, self._by_node)
        self.own_inverse = inverse
        alone = self.halo is None or (rigid and self._rigid_share is None)
        return inverse if alone else self.halo.with_ghosts(inverse)

    def take_rigid(self, start: np.ndarray, free: np.ndarray) -> None:
        """Take what a prediction of the rigid bodies' step gives; `rigid_blocks` holds their w.

        In 2D w does not change as bodies turn, and is not read again; that of driven bodies is
        zero. Where vertices split, contacts read `rigid_blocks`.

        Args:
            start: shape (2 num_rigid, dim), velocities at the start of the step (m/s, rad/s).
            free: shape (2 num_rigid, dim), free velocities.
        """
        blocks, share = self.rigid_blocks, self._rigid_share
        start, free = (self.own_of_rigid(a.reshape(-1, 2, self.dim)) for a in (start, free))
        self._rigid_start = start.reshape(-1, self.dim)
        self._rigid_free = free.reshape(-1, self.dim)
        if self.dim == 2 or self._by_node or self.driven is not None:
            return
        last = self.own_inverse.data_offsets[-2]
        self.inverse.data[last - blocks.size : last] = blocks.ravel()
        if share is not None:
            self.halo.renew_ghosts(self.inverse)

    def _take_inverse(self, groups: list[PointGroup]) -> None:
        for group in groups:
            update_compliance(group, self.inverse)
        self._permanent.take_inverse(self.inverse)
        self._add_up()

    def _add_up(self) -> None:
        """Add up over the points of all ranks what their compliances and kinds tell."""
        traces = [g.compliance[:, np.equal(*sym_indices(g.kernels.components))].sum(1)
                  for g in self.groups]  # fmt: skip
        stiffness = sum(float(np.sum(t[t > 0.0] ** -2.0)) for t in traces)
        mass = sum(float(np.sum(1.0 / t[t > 0.0])) for t in traces)
        points = self._permanent.groups + self.contacts
        others = sum(not g.sides.lever_arms or g.kernels.evolve is not None for g in points)
        counts = (stiffness, mass, len(points), others)
        stiffness, self._mass, groups, others = self.total(np.array(counts, float)).tolist()
        self._stiffness = math.sqrt(stiffness)
        self._all_of_rigid = groups > 0 and others == 0

    def lip_motion(
        self,
        displacement: np.ndarray,
        velocity: np.ndarray,
        mean: np.ndarray,
        gradient: np.ndarray = _NONE,
        rate: np.ndarray = _NONE,
    ) -> LipMotion:
        """What `turn` wants; ghosts follow their owners.

        Args:
            displacement, velocity, mean: see `LipMotion`, flat or shape (num_slots, dim); those of
                ghosts change.
            gradient, rate: of a periodic cell, see `LipMotion`.
        """
        from xper_fx.nscd.turning_frames import LipMotion

        at_slots = []
        for values in (displacement, velocity, mean)[: 2 if mean is velocity else 3]:
            at_slots.append(values.reshape(-1))
            self.refresh_ghosts(at_slots[-1])
        return LipMotion(*at_slots[:2], at_slots[-1], mean is velocity, gradient, rate)

    def complete(self, free: np.ndarray, driven: np.ndarray | None = None) -> None:
        """Set the free velocities of all slots but those of meshed bodies.

        Args:
            free: shape (num_slots * dim,), of which those of meshed bodies come first (m/s).
            driven: of `driven` bodies, shape (2 num_rigid, dim); None as `take_rigid` had them.
        """
        rigid = self._rigid_free if driven is None else driven
        self._set_others(free.reshape(-1, self.dim), rigid)
        if self._rigid_share is not None:  # what impulses do is judged by changes of velocities
            self.refresh_ghosts(free)

    def _slots(self, bulk: np.ndarray, rigid: np.ndarray) -> np.ndarray:
        slots = np.empty((self.inverse.num_slots, self.dim))
        slots[: len(bulk)] = bulk
        self._set_others(slots, rigid)
        return slots

    def _set_others(self, slots: np.ndarray, rigid: np.ndarray) -> None:
        first = self.bulk_inverse.num_nodes
        if len(rigid):
            slots[first : first + len(rigid)] = rigid
        slots[first + len(rigid) :] = 0.0

    def rigid_part(self, slots: np.ndarray) -> np.ndarray:
        """Of velocities of all slots those of rigid bodies, shape (2 num_rigid, dim).

        All ranks call it together.
        """
        own = self.own_rigid(slots)
        return own if self._rigid_share is None else self._all_rigid(self._rigid_share.of_all, own)

    def rigid_impulses(self) -> np.ndarray:
        """Of `impulses` those on rigid bodies, shape (2 num_rigid, dim)."""
        own = self.own_rigid(self.impulses())
        return own if self._rigid_share is None else self._all_rigid(self._rigid_share.sum, own)

    def own_rigid(self, slots: np.ndarray) -> np.ndarray:
        """As `rigid_part`, of this rank's rigid bodies alone: a view."""
        first, last = self.bulk_inverse.num_nodes, self.own_inverse.num_nodes
        return slots.reshape(-1, self.dim)[first:last]

    def _all_rigid(self, put_together, own: np.ndarray) -> np.ndarray:
        return put_together(own.reshape(-1, 2 * self.dim)).reshape(-1, self.dim)

    def find_contacts(
        self,
        found: list[FoundPoints],
        bulk_velocity: np.ndarray,
        step: float,
        theta: float,
        halo: PointHalo | ContactHalo | None = None,
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
        if self.inverse is not self.own_inverse:
            self.refresh_ghosts(start.reshape(-1))
        times = step, step * (1.0 - theta)
        self._found.renew(found, self.inverse, halo, start, times)
        self._regroup()
        self._take_inverse(self.contacts + self.rolling)

    def take_halo(self, halo: PointHalo, slots: np.ndarray) -> None:
        """Take other ghosts, between two steps; contacts are then to be found anew.

        Args:
            halo: of the same permanent points.
            slots: shape (n,), the slot of each of the old slots at which these points are.
        """
        self.halo = halo
        self._permanent.move(self._joined(self.bulk_inverse), slots)
        self.inverse = self._permanent.inverse
        for points in (self._found, self._carried):
            points.regroup(self._permanent.grouping.by_tiles())
        for group in self._permanent.groups if self.fused is None else ():
            update_compliance(group, self.inverse)

    def move_joints(self, rows: FoundPoints, step: float, theta: float) -> None:
        """Put the rows of joints where bodies have moved to in the middle of a step.

        Args:
            rows: of joints; a rank has those of its bodies.
            step: h (s).
            theta: weight of the end of the step.
        """
        start = self._slots(np.zeros((self.bulk_inverse.num_nodes, self.dim)), self._rigid_start)
        times = step, step * (1.0 - theta)
        self._jointed = True
        self._carried.renew([rows], self.inverse, None, start, times)
        self._regroup()
        self._take_inverse(self.joints)

    def _regroup(self) -> None:
        self._join_groups()
        self.renewals += 1

    def _join_groups(self) -> None:
        self.groups = self._permanent.groups + self.passing

    def deactivate(self, indices: np.ndarray) -> None:
        """Take permanent points out, for good; what `gather` gives of them is zero.

        Args:
            indices: their numbers in the scene's order.
        """
        self._retire(np.flatnonzero(np.isin(self.numbers, indices)))

    def _retire(self, places: np.ndarray) -> None:
        """Take out some of this rank's permanent points."""
        self._permanent.deactivate(places)
        self._regroup()

    def rounding(self, velocity: np.ndarray) -> float:
        """|r| of impulses that move the bodies by the rounding of their velocities (N s).

        Args:
            velocity: shape (num_slots * dim,), m/s.
        """
        return self.rounding_at(self.largest(float(np.abs(velocity).max(initial=0.0))))

    def rounding_at(self, speed: float) -> float:
        """`rounding` at the largest speed on any rank (m/s)."""
        if self._stiffness is None:
            self._add_up()
        return ROUNDING * speed * self._stiffness

    @property
    def uses_velocity_criterion(self) -> bool:
        """Whether all points are contacts of rigid bodies (`nscd/solvers/nlgs.py`)."""
        return self._all_of_rigid

    def saved(self) -> dict:
        """What the next step depends on, the inverse and what is found anew left out.

        Arrays over the permanent points are `Rows`; of contacts that were found, and of the rows of
        joints, their history is kept.
        """
        saved: dict = dict(self._permanent.saved(self.numbers, self.turns))
        saved |= {
            "committed_step": self.committed_step, "step_size": self.step_size,
            "theta": self.theta,
        }  # fmt: skip
        if self.halo is not None:
            self.share_history(self.halo.ranks)
        for name, points in (("contacts", self._found), ("joints", self._carried)):
            if points.history is not None:
                saved[name] = points.saved()
        return saved

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order; points as they were before any retired."""
        number = self.numbers
        if self.fused is not None:
            self._permanent.split_as(saved, number)
        gone = np.flatnonzero(~saved["kept"][number])
        if len(gone):
            self._retire(gone)
        self._permanent.restore(saved, number)
        self.committed_step = saved["committed_step"]
        self.step_size, self.theta = saved["step_size"], saved["theta"]
        self._found.restore(saved.get("contacts", {}))
        self._carried.restore(saved.get("joints", {}))

    def share_history(self, ranks: Reductions) -> None:
        """Let contacts and joints go on from the last step on whichever rank has them now.

        All ranks call it together.
        """
        self._found.share_history(ranks)
        self._carried.share_history(ranks)
