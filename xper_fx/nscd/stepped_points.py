# SPDX-License-Identifier: LGPL-3.0-or-later
"""The step of all interaction points: constants of their laws, impulses, energies.

A time step is `begin_step`, one `solve` or more (Newton iterations of the bulk), and `commit`.
Until `commit` nothing of the past is lost: a step may begin again with another size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.nscd.couplings import push_kernel, spread_kernel
from xper_fx.nscd.found_contacts import FoundContacts
from xper_fx.nscd.law_loops import CHUNK, evolve_loop, step_loops
from xper_fx.nscd.laws.law import IMPACT, NUMERICAL, LawKernels
from xper_fx.nscd.own_compliance import update_compliance, update_diagonal
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.point_values import PointValues
from xper_fx.support.threads import in_ranges, num_ranges

if TYPE_CHECKING:
    from xper_fx.nscd.turning_frames import LipMotion

# Relative rounding of velocities that several points add up to.
ROUNDING = 4.0 * np.finfo(float).eps


def _damage(kernels: LawKernels) -> int:
    """Column of the damage in the state of points, or what `turning_frames.py` has in its place."""
    from xper_fx.nscd.turning_frames import LASTING, LOOSE

    if "damage" in kernels.state_names:
        return kernels.state_names.index("damage")
    return LOOSE if "impact" in kernels.energies else LASTING


def _share_of_spin(theta: float) -> float:
    """What laws are given of a spin s: velocities at the start less so many times s."""
    return 1.0 / (1.0 - theta) if theta < 1.0 else 0.0


class FacetFlippedError(FloatingPointError):
    """The lips of a point have no normal in the middle of the step, or the opposite one.

    Attributes:
        point: number of the point in the scene's order.
    """

    def __init__(self, point: int):
        self.point = point
        super().__init__(f"the facet of interaction point {point} flips or degenerates in a step")


class StepWork(NamedTuple):
    """What the interactions stored and dissipated, summed over points (J; 2D: J/m).

    `stored` is a state, the others are what the step added.
    """

    stored: float
    cohesion: float
    friction: float
    impact: float
    numerical: float
    viscous: float = 0.0


@cache
def _places(energies: tuple[str, ...]) -> np.ndarray:
    """Where the energies of a law stand in `StepWork`."""
    return np.array([StepWork._fields.index(name) for name in energies])


def _before_percussions(group: PointGroup) -> tuple[np.ndarray, np.ndarray] | None:
    """What `_take_percussions` is given of contacts before their law's `commit`; None of others."""
    names = group.kernels.state_names
    if "pushed" not in names or "stored" in group.kernels.energies:
        return None
    return group.velocity.copy(), group.state[:, names.index("pushed")] > 0.0


def _take_percussions(
    group: PointGroup, before: np.ndarray, pushed: np.ndarray, theta: float
) -> float:
    r"""Let contacts lose what their percussions take from the kinetic energy (J; 2D: J/m).

    Impulses I change it by (v0 + v1) . I / 2, those of contacts among them by r . (U0 + U1) / 2. By
    the velocity of the step, theta U1 + (1 - theta) U0, laws book (theta - 1/2) r . (U1 - U0) less,
    and damping (theta - 1/2) dv . M dv = (theta - 1/2) dv . I of the scheme has it. Along the
    normal it is given back, so that an impact loses r_N (1 - e) |U0_N| / 2 whatever theta is; along
    the tangent of points that arrive, too. Those that stay and slide leave friction the work of
    its force over the way.

    Args:
        group: after the law's `commit`.
        before: relative velocities U0, as `group.velocity` has U1 now (m/s).
        pushed: which points bore something in the last step.
        theta: weight of the end of the step.

    Returns:
        What is to be taken from the damping of the scheme.
    """
    shift = (theta - 0.5) * group.impulse * (group.velocity - before)
    shift[pushed | (before[:, 0] >= 0.0), 1:] = 0.0
    lost = shift.sum(axis=1)
    group.energy[:, group.kernels.energies.index("impact")] += lost
    return float(lost.sum())


class SteppedPoints(PointValues):
    """Interaction points that are stepped."""

    step_size: float  #: h of the step (s)
    theta: float  #: weight of its end
    renewals: int  #: how often contacts were found anew
    turns: bool  #: whether frames of points turn with their bodies, on whichever rank
    #: by how much internal variables have gone further in the step than the velocities last given
    #: to `evolve` ask for, relative: what iterates on the way broke for nothing
    too_far: float
    #: what contacts lost in the step last committed that a scheme with theta > 1/2 would else count
    #: as its damping (J; 2D: J/m)
    from_scheme: float
    _carried: FoundContacts
    _jointed: bool
    _motion: LipMotion
    _couples: np.ndarray
    _of_cell: np.ndarray
    _stiffness: float | None
    _mass: float

    @property
    def rolling(self) -> list[PointGroup]:
        """The rolling points of contacts that were found (`laws/rolling.py`)."""
        return self._found.rolling

    def turn(self, motion: LipMotion, step: float, theta: float, stays: bool = False) -> None:
        """Turn frames with their lips, before `begin_step` or `prepare`.

        Args:
            motion: of the slots.
            step: h (s).
            theta: weight of the end of the step.
            stays: whether points that were of the second kind (`turning_frames.py`) when frames
                were last turned stay so.

        Raises:
            FacetFlippedError: a facet has no normal any more, or the opposite one.
        """
        self._motion = motion
        self.step_size, self.theta = step, theta
        flipped = 0
        if self.fused is not None:
            self.fused.turn(motion, step * theta)
        for g in self._permanent.groups:
            if g.turning is None:
                continue
            wrong = self.turn_group(g, stays)
            if wrong >= 0:
                flipped = 1 + int(self.numbers[g.indices[wrong]])
            elif self.fused is not None:  # its vertices know compliances
                continue
            elif self._permanent.uneven is None:
                update_compliance(g, self.inverse)
            else:
                update_diagonal(g, *self._permanent.uneven[id(g)])
        self.require_no_flips(flipped)

    def require_no_flips(self, flipped: int) -> None:
        """End an attempt if the facet of a point has flipped; all ranks call it together.

        Args:
            flipped: one more than the number of such a point in the scene's order, 0 without one.

        Raises:
            FacetFlippedError: there is one on some rank.
        """
        if flipped := int(self.largest(flipped)):
            raise FacetFlippedError(flipped - 1)

    def turn_compliances(self) -> None:
        """Take W_aa in the frames that points now have, for solvers beside those of vertices."""
        for g in self._permanent.groups:
            if g.turning is not None:
                update_compliance(g, self.inverse)

    def turn_group(self, g: PointGroup, stays: bool = False) -> int:
        """As `turn`, of one group; returns the place of a point whose facet flips, or -1."""
        from xper_fx.nscd.turning_frames import site_loop, turn_loop

        width, reach, new = g.turning.width, self.step_size * self.theta, 0
        if num_ranges(len(g)) > 1:  # sites are shared by ranges
            new = len(g.turning.nodes)
            in_ranges(site_loop(self.dim, width), new, g.turning, self._motion, reach)
        first = in_ranges(
            turn_loop(g.sides, width), len(g), new, g.couplings, g.points.gap, g.points.area,
            g.turning, self._motion, reach, _share_of_spin(self.theta), g.kernels.no_jump, g.state,
            _damage(g.kernels), g.committed_impulse, g.compliance, g.jump, g.velocity, stays,
        )  # fmt: skip
        if self.fused is not None or self._permanent.uneven is None:
            g.show_frames()
        return next((i for i in first if i >= 0), -1)

    def num_strayed(self) -> int:
        """Points that press, on all ranks, whose lips have turned away from the frame they keep."""
        from xper_fx.nscd.turning_frames import count_strayed

        count, displacement = 0, self._motion.displacement.reshape(-1, self.dim)
        for g in self._permanent.groups:
            if g.turning is not None and not g.kernels.no_jump:
                pressing = np.flatnonzero((g.impulse[:, 0] > 0.0) & (g.status > 0))
                normal = g.couplings.frame[pressing, 0]
                count += count_strayed(g.turning.take(pressing), normal, displacement)
        return int(self.total(count))

    def _work_of_couples(self, velocity: np.ndarray) -> float:
        """Work in the step of what `couples` gave last (J; 2D: J/m), on this rank's slots."""
        from xper_fx.nscd.turning_frames import work_of_couples

        work = work_of_couples(self._couples, self._motion.velocity, velocity, self.theta)
        return work + float(np.vdot(self._of_cell, self._motion.rate))

    @property
    def size_of_gradient(self) -> int:
        """Entries of Fbar of a periodic cell with which lips turn; 0 without one."""
        return self._motion.rate.size

    def couples(
        self, of_gaps: bool = False, impulses: Sequence[np.ndarray] | None = None
    ) -> np.ndarray:
        """Impulses on the nodes of the couples that come with turning frames, (num_slots, dim).

        `of_cell` then has those on the rate of Fbar.

        Args:
            of_gaps: whether bonds that leave no jump count, with what the tolerance leaves of it.
            impulses: of each group; those that the points have if not given.
        """
        from xper_fx.nscd.turning_frames import couple_loop

        given = [g.impulse for g in self.groups] if impulses is None else impulses

        total = np.zeros((self.inverse.num_slots, self.dim))
        self._of_cell = np.zeros_like(self._motion.rate)
        for g, r in zip(self._permanent.groups, given, strict=False):
            if g.turning is not None and (of_gaps or not g.kernels.no_jump):
                add_couples = couple_loop(g.sides, g.turning.width)
                add_couples(total.reshape(-1), self._of_cell, g.turning, r)
        alone = self.halo is None and self.fused is None  # else they are given on
        self._couples = total.reshape(-1) if alone else total.reshape(-1).copy()
        if self.halo is not None:
            self.halo.everywhere.add_back(total.reshape(-1))
        return total

    def push_couples(self, couples: np.ndarray, velocity: np.ndarray) -> None:
        """Let `couples` act on the clusters of vertices that split.

        A lip has nodes at vertices of other ranks: owners of nodes, which have added the couples of
        all up, tell those of the vertices, who tell how nodes move.

        Args:
            couples, velocity: as of `FusedPoints.push_couples`; ghosts follow.
        """
        self.refresh_ghosts(couples.reshape(-1))
        self.fused.push_couples(couples, velocity)
        if self.halo is not None:
            for values in (couples, velocity):
                self.halo.corners.back(values.reshape(-1))
            self.refresh_ghosts(velocity.reshape(-1))

    def couples_of_cell(self) -> np.ndarray:
        """Of what `couples` gave last, what does work with the rate of Fbar of a periodic cell.

        Returns:
            Impulses, those of all ranks, shape (dim, dim), N m s (2D: N s).
        """
        return self.total(self._of_cell)

    @property
    def step_ratio(self) -> float:
        """Size of the step over that of the last, as impulses of the same forces have it."""
        return self.step_size / self.committed_step if self.committed_step > 0.0 else 1.0

    def begin_step(self, step: float, theta: float, by_vertex: bool = False) -> None:
        """Set the constants of the step in every law; impulses start from the last step's.

        Args:
            step: h (s).
            theta: weight of the end of the step.
            by_vertex: whether permanent points are left to a solver that goes through vertices, and
                does so there.
        """
        self.step_size, self.theta = step, theta
        if self.turns:  # it is that of frames of a step before, which a restarted run does not know
            self._stiffness = None
        left_to_solver = len(self._permanent.groups) if by_vertex else 0
        for number, g in enumerate(self.groups):
            if number >= left_to_solver or self.fused is not None:
                np.multiply(g.committed_impulse, self.step_ratio, out=g.impulse)
            if number >= left_to_solver:
                self.prepare_group(g)

    def prepare(self) -> None:
        """Renew the laws' constants of the step, after `update_inverse`."""
        for g in self.groups:
            self.prepare_group(g)

    def prepare_group(self, g: PointGroup) -> None:
        """As `prepare`, of one group, whose points or compliances are others now."""
        prepare, _ = step_loops(g.kernels, g.sides)
        in_ranges(prepare, len(g), g.law_arrays(), self.step_size, self.theta)

    def evolve(self, velocity: np.ndarray) -> float:
        """Let the laws' internal variables follow the end velocities found.

        Args:
            velocity: shape (num_slots * dim,), m/s.

        Returns:
            The largest relative change, zero when all have arrived.
        """
        return self.evolve_and_compare(velocity, 0.0)[0]

    def evolve_and_compare(self, velocity: np.ndarray, value: float) -> tuple[float, float]:
        """`evolve`, and the largest of a value over all ranks, in one message."""
        largest, too_far = 0.0, 0.0
        for g in self.groups:
            if g.kernels.evolve is not None:
                evolve = evolve_loop(g.kernels, g.sides)
                changes = in_ranges(evolve, len(g), velocity, g.couplings, g.law_arrays())
                for change, far in changes:
                    largest, too_far = max(largest, change), max(too_far, far)
        largest, self.too_far, value = self.largest(np.array([largest, too_far, value])).tolist()
        return largest, value

    def add_velocity(self, velocity: np.ndarray) -> None:
        """Add w H r to `velocity`, shape (num_slots * dim,)."""
        if self.halo is not None:
            self.halo.clear(velocity)
        for g in self.groups:
            push_kernel(g.sides, g.blocks)(velocity, g.couplings, g.impulse)
        if self.halo is not None:
            self.halo.add_up(velocity)

    def impulses(self) -> np.ndarray:
        """H r: impulses of the current step on the interacting nodes, shape (num_slots, dim)."""
        if self.fused is not None:
            total = self.fused.impulses
            if self.passing or self.halo is not None:  # those of vertices stay as they are
                total = total + self.spread(self.passing)
        else:
            total = self.spread(self.groups)
        if self.halo is not None:
            self.halo.everywhere.add_back(total.reshape(-1))
        return total

    def spread(self, groups: list[PointGroup]) -> np.ndarray:
        """H r of groups of this rank's points, shape (num_slots, dim)."""
        total = np.zeros((self.inverse.num_slots, self.dim))
        for g in groups:
            spread = spread_kernel(g.sides)
            spread(total.reshape(-1), g.couplings, g.impulse)
        return total

    @property
    def permanent(self) -> list[PointGroup]:
        """The groups of permanent points."""
        return self._permanent.groups

    @property
    def joints(self) -> list[PointGroup]:
        """The groups of the rows of joints, of those that were given last."""
        return self._carried.groups

    @property
    def contacts(self) -> list[PointGroup]:
        """The groups of contacts that were found."""
        return self._found.groups

    @property
    def passing(self) -> list[PointGroup]:
        """The groups of all points that are not permanent."""
        return self.joints + self.contacts + self.rolling

    @property
    def touches(self) -> bool:
        """Whether contacts or joints act on some rank in this step; all ranks ask together."""
        # they are renewed on all ranks, of which some may have none
        return self.renewals > 0 and self.largest(len(self.passing)) > 0

    def impulse_energy_norm(self, free: np.ndarray, velocity: np.ndarray) -> tuple[float, float]:
        """|w H r| of the present impulses in the norm of the kinetic energy, and its rounding.

        Args:
            free, velocity: shape (num_slots * dim,), before and after the impulses (m/s).

        Returns:
            (p . w p)^(1/2) with p = H r, and the same of the rounding of velocities; kg^(1/2) m/s.
        """
        energy = self.total(float(np.vdot(self.spread(self.groups), velocity - free)))
        speed = self.largest(float(np.abs(velocity).max(initial=0.0)))
        return math.sqrt(max(energy, 0.0)), ROUNDING * speed * math.sqrt(self._mass)

    def commit(
        self, velocity: np.ndarray, static: bool = False, at_start: np.ndarray | None = None
    ) -> StepWork:
        """End the step: jumps, damage and energies move on.

        Args:
            velocity: shape (num_slots * dim,), end-of-step velocities of the interacting nodes.
            static: whether tractions do the work of their mean over the step, not of its end.
            at_start: of a static step whose points are others than those of the step before: what
                those did to this rank's slots, impulses over this step, shape (n, dim), N s.

        Returns:
            The energies of the step.
        """
        totals, percussions = np.zeros(len(StepWork._fields) + 1), -1
        if self.turns:
            totals[NUMERICAL] -= (0.5 if static else 1.0) * self._work_of_couples(velocity)
        if at_start is not None:
            change = self.impulses()[: len(at_start)] - at_start
            totals[NUMERICAL] += 0.5 * float(np.vdot(change, velocity[: change.size]))
        for g in self.groups:
            if not len(g):
                continue
            if static and at_start is None:
                totals[NUMERICAL] += self._work_of_change(g, velocity)
            before = None
            if self.theta > 0.5 and not static and g.turning is None:
                before = _before_percussions(g)
            *energies, of_turning = self._commit_group(g, velocity)
            totals[_places(g.kernels.energies)] += energies
            totals[NUMERICAL] += of_turning
            if before is not None:
                lost = _take_percussions(g, *before, self.theta)
                totals[percussions] += lost
                totals[IMPACT] += lost
        self.committed_step = self.step_size
        if self.renewals:
            self._found.commit()
        if self._jointed:
            self._carried.commit()
        *work, self.from_scheme = self.total(totals).tolist()
        return StepWork(*work)

    def _commit_group(self, g: PointGroup, velocity: np.ndarray) -> np.ndarray:
        """As a law's `commit`; returns its energies and what turning adds to the numerical one."""
        if g.turning is None:
            commit, turned = step_loops(g.kernels, g.sides)[1], ()
        else:
            from xper_fx.nscd.turning_frames import commit_loop

            commit = commit_loop(g.kernels, g.sides, g.turning.width)
            turned = g.turning, self._motion, _share_of_spin(self.theta)
        sums = np.zeros((-(-len(g) // CHUNK), len(g.kernels.energies) + 1))
        in_ranges(
            commit, len(sums), velocity, g.couplings, g.law_arrays(), self.step_size, self.theta,
            *turned, spaces=[sums] * num_ranges(len(g)),
        )  # fmt: skip
        return sums.sum(axis=0)

    def _work_of_change(self, group: PointGroup, velocity: np.ndarray) -> float:
        """Half the work (J; 2D: J/m) in a static step of what tractions have changed by.

        Where frames turn, the work of the couples at the end is not in it.
        """
        ratio = self.step_ratio
        rate = group.points.relative(velocity.reshape(-1, self.dim))
        if group.turning is None:
            return 0.5 * float(np.vdot(group.impulse - ratio * group.committed_impulse, rate))
        from xper_fx.nscd.turning_frames import power_loop

        before = in_ranges(
            power_loop(group.sides, group.turning.width), len(group), velocity, group.couplings,
            group.turning, self._motion, group.committed_impulse, not group.kernels.no_jump,
        )  # fmt: skip
        return 0.5 * (float(np.vdot(group.impulse, rate)) - ratio * math.fsum(before))
