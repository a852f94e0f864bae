# SPDX-License-Identifier: LGPL-3.0-or-later
r"""What the iterations of a monolithic step go through: velocities, impulses, loads, corrections.

For the velocities v of all unknowns and the impulses r of all points a step asks

    R(v) + H r = 0   where motions are free,      r = S(H^T v, r)   at each point,

R being the bulk's momentum balance and S a law's answer. With its springs K and sources g
(`nscd/point_tangents.py`) a correction solves

    (A + H K H^T) dv = R + H r + H g,      dr = g - K H^T dv,

A = M + C + h^2 theta^2 dF/dq, by a sparse factorisation (`coupled_system.py`). Frames that turn
follow the bodies in each state: H r has the couples, too, and the springs their derivatives
(`nscd/turning_tangents.py`). Nothing is asked of A: bodies that only their interactions hold, stiff
bonds and no inertia at all are the same to it.

Where ranks divide the bodies, vectors are those of a rank's bodies and points, and all ranks do
everything together; what is left, and how large things are, is told over all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.bulk.coupled_matrices import CoupledMatrices
from xper_fx.bulk.extent import extent, moved_too_far
from xper_fx.bulk.loading import Loading
from xper_fx.bulk.point_motions import PointMotions
from xper_fx.bulk.sparse_direct import SingularMatrixError
from xper_fx.bulk.state import State
from xper_fx.bulk.step_equations import StepEquations
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.point_tangents import PointTangents
from xper_fx.nscd.stepped_points import FacetFlippedError
from xper_fx.support.profile import Stopwatch

if TYPE_CHECKING:
    from xper_fx.nscd.growth import GrowthLimit

# Corrections after which points of turning frames stay of the kind that they need once.
_SETTLED = 4
# Steps of differences where nothing moves yet, relative to the size of the scene a step.
_LEAST, _SMALLEST = 1e-16, 1e-20


class Correction(NamedTuple):
    """Changes that an iteration proposes."""

    velocity: np.ndarray  #: of all unknowns, shape (num_dofs,), m/s
    time: float  #: of the load (s)
    impulses: list[np.ndarray]  #: of each group, shape (n, components), N s


class CoupledStep:
    """The unknowns of one step, and what is left of its equations.

    Args:
        matrices: of the bulk and of the system.
        equations, loading: of the step.
        interactions: points after `begin_step`, None without any.
        state: at the start of the step.
        step: by which velocities are defined (s).
        growth: what the step may open, None where its end is given.
        stopwatch: where phases are timed.

    Attributes:
        loading, interactions, state, step, growth: as given.
        extent: of the bodies (m).
        finite_strain: whether strains are those of positions.
        stiffest: entry of the bulk's matrix (kg).
        ranks: those that divide the bodies.
        dot: inner product of vectors of all unknowns over them.
        tangents: springs of the points, None without any.
        motions: how they move with the unknowns.
        velocity: of all unknowns (m/s).
        residual, internal: of the bulk there, without impulses (N s), and its forces (N).
        slots: velocities of the points' nodes.
        impulses: H r on all unknowns (N s), with the couples of frames that turn.
        corrections: how many were solved for.
        start: velocities that iterations begin from (m/s).
        turns: whether frames of points turn with the bodies.
        frames_differ: whether points of one node may have frames that part.
        may_jump: whether shorter steps, too, may have no state near the last one: their load is
            given, and neither inertia nor viscosity bounds how fast bonds break.
        softens: whether there are bonds that soften.
        descends: whether a state is looked for wherever the energy is least, beyond a snap.
        contacts_known: whether an interior point has found them: what flips yet is rounding.
        flipped: what facet is flipped or degenerate in the present state, in words; or empty.
    """

    def __init__(
        self,
        matrices: CoupledMatrices,
        equations: StepEquations,
        loading: Loading,
        interactions: Interactions | None,
        state: State,
        step: float,
        growth: GrowthLimit | None,
        stopwatch: Stopwatch,
    ):
        self._matrices, self._equations, self._stopwatch = matrices, equations, stopwatch
        self.loading, self.step, self.growth = loading, step, growth
        self.interactions = interactions
        bulk = matrices.bulk
        self.ranks, self.dot = bulk.ranks, bulk.dot
        self._free = ~bulk.layout.prescribed
        self.finite_strain = bulk.forms.finite_strain
        self.extent = extent(bulk)
        self.tangents = None if interactions is None else PointTangents(interactions)
        self.motions = PointMotions(matrices, interactions, state)
        # without inertia the last step's velocities mean nothing for this one
        inert = bulk.inertia is not None
        self.start = state.velocity if inert else np.zeros_like(state.displacement)
        self.stiffest, self.corrections, self.state = 0.0, 0, state
        self.turns = interactions is not None and interactions.turns
        searched = 0.0 if interactions is None else float(len(interactions.contacts))
        self.frames_differ = self.turns or self.ranks.max(searched) > 0.0
        viscous = any("viscous" in g.kernels.energies for g in self._groups)  # a rank may have none
        self.may_jump = not inert and growth is None and not self.ranks.max(float(viscous))
        softens = any(g.kernels.growth is not None for g in self._groups)
        self.softens = bool(self.ranks.max(float(softens)))
        self.descends = self.contacts_known = False
        self.flipped = ""
        self.restart()

    def restart(self) -> None:
        """Go back to where the iterations began; impulses stay as they are."""
        self.velocity, self.slots = self.start.copy(), np.zeros(0)
        self._of_slots = self.slots
        self.impulses = np.zeros_like(self.start)
        self._evolved, self._before = np.zeros(0), self.corrections
        self._ask_bulk()

    def _ask_bulk(self) -> None:
        self.residual, self.internal = self._equations.residual(self.velocity)

    def turn(self) -> None:
        """Turn frames of points, if they turn, to where the present velocities lead.

        Raises:
            FacetFlippedError: see `Interactions.turn`.
        """
        if not self.turns:
            return
        from xper_fx.bulk.turning import turn

        matrices, theta, weight = self._matrices, self._matrices.theta, self._matrices.weight
        mean = weight * self.velocity + (1.0 - weight) * self.start
        stays = theta < 1.0 and self.corrections - self._before > _SETTLED
        points, bulk, nodes = self.interactions, matrices.bulk, matrices.nodes
        turn(points, bulk, nodes, self.state, mean, self.step, theta, stays)
        if points.fused is not None:
            points.turn_compliances()

    def _follow(self) -> None:
        """Let frames follow the present velocities, and laws their frames."""
        self.flipped = ""
        try:
            self.turn()
        except FacetFlippedError as error:
            self.flipped = str(error)
            self.residual = np.full_like(self.residual, np.nan)
            return
        for g in self._groups:
            if g.turning is not None:
                self.interactions.prepare_group(g)
        if len(self._evolved):  # internal variables are to be what they were
            self.interactions.evolve(self._evolved)

    def evolve(self) -> float:
        """Let internal variables of laws follow; see `Interactions.evolve`."""
        if self.interactions is None:
            return 0.0
        self._evolved = self.slots
        return self.interactions.evolve(self.slots)

    # Impulses of the points

    @property
    def _groups(self) -> Sequence:
        return [] if self.interactions is None else self.interactions.groups

    def impulses_of_points(self) -> list[np.ndarray]:
        """A copy of the impulses of each group, shape (n, components), N s."""
        return [g.impulse.copy() for g in self._groups]

    def set_impulses(self, impulses: Sequence[np.ndarray]) -> None:
        """Take impulses of each group, shape (n, components), N s."""
        for g, own in zip(self._groups, impulses, strict=True):
            g.impulse[:] = own

    def answers(self) -> list[np.ndarray]:
        """S of each group for the present velocities and impulses, shape (n, components), N s.

        The arrays are those of the next call, too.
        """
        if self.tangents is None:
            return []
        slots = self.present()
        with self._stopwatch.phase("point tangents"):
            self.tangents.respond(slots)
        return self.tangents.response

    def on_unknowns(self, impulses: Sequence[np.ndarray]) -> np.ndarray:
        """H r of impulses of each group, with their couples, shape (num_dofs,), N s."""
        out = np.zeros_like(self.velocity)
        if self.tangents is not None:
            slots, nodes = self.tangents.spread(impulses), self._matrices.nodes
            out.reshape(-1, self.interactions.dim)[nodes] = slots[: len(nodes)]
            if self.turns:
                from xper_fx.bulk.turning import couples_on

                out += couples_on(self.interactions, nodes, len(out), impulses=impulses)
        return out

    # Corrections

    def correction(
        self, proximal: float, follows: bool = True, convex: bool = False
    ) -> Correction | None:
        """The correction from the present state; None if no load keeps bonds within their growth.

        Args:
            proximal: p of the springs (`nscd/point_tangents.py`), 1 where impulses are given.
            follows: whether the load is found from the growth, if the step has one.
            convex: whether springs that push are turned round (`nscd/point_tangents.py`).

        Raises:
            SingularMatrixError: the system cannot be factorised.
        """
        self.corrections += 1
        self.linearise(proximal, convex)
        growth = self.growth if follows else None
        try:
            found = self._solved(growth)
            flies = found is not None and self.moved_too_far(found.velocity) > 0.0
            return self._solved(growth) if flies and self._press(proximal) else found
        except SingularMatrixError:
            if not self._press(proximal):
                raise
            return self._solved(growth)

    def _press(self, proximal: float) -> bool:
        """Whether lips that touch, without impulse yet, were open and are now taken as closed.

        In statics bodies may hang by such lips alone. Open, they let them go anywhere.
        """
        if self.tangents is None or self._matrices.bulk.inertia is not None:
            return False
        with self._stopwatch.phase("point tangents"):
            pressed = self.tangents.press(self.present(), self._least(), proximal)
        return bool(self.ranks.max(float(pressed)))

    def linearise(self, proximal: float, convex: bool = False) -> None:
        """Take the springs of the points around the present state; see `correction`."""
        if self.tangents is not None:
            with self._stopwatch.phase("point tangents"):
                self.tangents.linearise(self.present(), self._least(), proximal, convex)

    def _solved(self, growth: GrowthLimit | None) -> Correction | None:
        """The correction of the bulk's matrix and the points' springs; see `correction`."""
        self.take_springs()
        return self.along_springs(growth)

    def take_springs(self) -> None:
        """Take the system of the bulk at the present velocities, and of `tangents.stiffness`.

        Raises:
            SingularMatrixError: it cannot be factorised.
        """
        with self._stopwatch.phase("bulk matrix"):
            displacement = self._equations.displacement(self.velocity)
            matrix = self._matrices.of_bulk(self.step, displacement)
            self.stiffest = float(np.abs(matrix.data).max(initial=0.0))
        with self._stopwatch.phase("point tangents"):
            stiffness = [] if self.tangents is None else self._springs()
        with self._stopwatch.phase("factorisation"):
            self._matrices.factorise(matrix, stiffness, self.interactions)

    def along_springs(self, growth: GrowthLimit | None = None) -> Correction | None:
        """The correction of the last system, for the present impulses and `tangents.source`."""
        loading, right = self.loading, self.residual
        if self.tangents is not None:
            with self._stopwatch.phase("point tangents"):
                source = [
                    g.impulse + s for g, s in zip(self._groups, self.tangents.source, strict=True)
                ]
                right = right + self.on_unknowns(source)
        change = 0.0
        with self._stopwatch.phase("solution"):
            dv = self._matrices.solve(right, loading.wanted - self.velocity)
            if growth is not None:
                along, driven = self._along()
        rigid = 0.0 * loading.driven
        if growth is not None:
            now = self._jumps()
            scaled, changes = self.step * self._matrices.theta, self.motions.changes
            start = [x + scaled * du for x, du in zip(now, changes(dv, rigid), strict=True)]
            slope = [scaled * du for du in changes(along, driven)]
            found = growth.change(now, self.tangents.held, start, slope)
            if found is None or not np.isfinite(found):
                return None
            change, dv, rigid = found, dv + found * along, found * driven
        if self.tangents is None:
            return Correction(dv, change, [])
        return Correction(dv, change, self.tangents.changes(self.motions.changes(dv, rigid)))

    def _along(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of all unknowns and of rigid bodies for a unit of the load's time."""
        force, motion, driven = self.loading.rates()
        right = np.broadcast_to(force, self.velocity.shape) + self._pushed_by(driven)
        return self._matrices.solve(right, motion), driven

    def onwards(
        self, friction: bool
    ) -> tuple[tuple[float, np.ndarray, list[np.ndarray] | None] | None, bool]:
        """With what the start of the step goes on, see `Kinks.onwards`, and whether lips rub."""
        from xper_fx.bulk.rates import MULTIPLIERS, Kinks

        matrices, points, h = self._matrices, self.tangents, self.step * self._matrices.theta
        self.linearise(MULTIPLIERS)
        kinks = Kinks(self._groups, points.stiffness, self.growth, h, self.ranks, friction)
        rub = kinks.rub
        if not kinks.tell:
            return None, rub
        self.take_springs()
        along, driven = self._along()
        ways = [matrices.solve(self.on_unknowns(r), 0.0 * along) for r in kinks.pushes()]
        return kinks.onwards(self.loading.time, along, driven, ways, self.motions.changes), rub

    def _pushed_by(self, driven: np.ndarray) -> np.ndarray | float:
        """What springs do to the unknowns where rigid bodies are driven at velocities (N s)."""
        if not driven.any():
            return 0.0
        moved = self.motions.changes(np.zeros_like(self.velocity), driven)
        springs = zip(self.tangents.stiffness, moved, strict=True)
        return -self.on_unknowns([np.einsum("pij,pj->pi", k, du) for k, du in springs])

    def _springs(self) -> list[np.ndarray]:
        """K of each group, or what points whose frames turn have in its place."""
        springs, theta = self.tangents.stiffness, self._matrices.theta
        if not self.turns:
            return springs
        from xper_fx.nscd.turning_tangents import springs as that_turn

        return [
            k if g.turning is None else that_turn(g, k, self.step * theta**2)
            for g, k in zip(self._groups, springs, strict=True)
        ]

    def move(self, velocity: np.ndarray, time: float) -> None:
        """Take velocities and the time of the loads; the bulk answers."""
        self.velocity = velocity
        if self.growth is not None:
            self.loading.set(time)
            # loads that bend are not on the correction's line
            self.velocity = np.where(self._free, velocity, self.loading.wanted)
        with self._stopwatch.phase("free velocity"):
            self._ask_bulk()
        if self.turns:
            with self._stopwatch.phase("interaction terms"):
                self._follow()

    # What is left

    def balance(self) -> np.ndarray:
        """R + H r of the last `impulses`, zero where motions are prescribed, N s.

        Of unknowns that move as one it is the sum, at their root.
        """
        left, shared = self.residual + self.impulses, self._matrices.shared
        if shared is not None:
            left = shared.sums(left)
        return np.where(self._free, left, 0.0)

    def size(self) -> float:
        """Largest nodal impulse (N s)."""
        vectors = self.step * self.internal, self.impulses, self._equations.start
        return self.ranks.max(max(float(np.abs(v).max(initial=0.0)) for v in vectors))

    def moved_too_far(self, change: float | np.ndarray = 0.0) -> float:
        """How far velocities with a change (m/s) move a body too far (m); see `moved_too_far`."""
        velocities = self.velocity + change, self.loading.wanted
        return moved_too_far(self._matrices.bulk, self.step, *velocities, self.extent)

    def num_held(self) -> int:
        """This rank's points whose impulses are multipliers."""
        return 0 if self.tangents is None else sum(int(h.sum()) for h in self.tangents.held)

    def _least(self) -> float:
        """Velocity that differences are at least taken over."""
        speeds = self.slots, self.loading.wanted
        speed = self.ranks.max(max(float(np.abs(v).max(initial=0.0)) for v in speeds))
        return max(_LEAST * float(speed), _SMALLEST * self.extent / self.step)

    # Openings

    @property
    def goes_on(self) -> bool:
        """Whether a step along a path does not go back on it."""
        if self.growth is None:
            return True
        jumps = zip(self._groups, self._jumps(), strict=True)
        moved = [jump - g.jump for g, jump in jumps]
        return not self.growth.turns_back(moved, self.loading.time - self.state.time)

    def growth_left(self) -> float:
        """By how much the growth differs from the one that the step asks for, relative."""
        return 0.0 if self.growth is None else self.growth.left(self._jumps())

    def _jumps(self) -> list[np.ndarray]:
        """Jumps of each group at the end of the step for the present velocities, m."""
        return self.motions.jumps(self.present(), self.step)

    def present(self) -> np.ndarray:
        """`slots` at the present velocities, which ranks tell each other once."""
        if self._of_slots is not self.velocity:
            self.slots = self.motions.slots(self.velocity, self.loading.driven)
            self._of_slots = self.velocity
        return self.slots
