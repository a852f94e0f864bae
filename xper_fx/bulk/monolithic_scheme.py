# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Bulk and interactions in one system: semismooth Newton on the velocities of all bodies.

For the velocities v of all unknowns and the impulses r of all points a step asks

    R(v) + H r = 0   where motions are free,      r = S(H^T v, r)   at each point,

R being the bulk's momentum balance and S a law's answer. With its springs K and sources g
(`nscd/point_tangents.py`) each iteration solves

    (A + H K H^T) dv = R + H r + H g,      dr = g - K H^T dv,

A = M + C + h^2 theta^2 dF/dq, by a sparse factorisation (`coupled_system.py`). Nothing is asked of
A: bodies that only their interactions hold, stiff bonds and no inertia at all are the same to it.
A point that its law holds (contact, stick, a perfect bond) has a multiplier for its impulse, so
that constraints are exact, not penalties.

A step is shortened where it would raise what is left. That is taken with the laws' answers for
impulses, so that every inequality is kept: |R + H r| over the free unknowns, and the change of the
answers when they are asked again, which is what held points are apart, times the bulk's stiffness.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.coupled_system import CoupledSystem
from xper_fx.bulk.loading import Loading
from xper_fx.bulk.sparse_direct import SingularMatrixError
from xper_fx.bulk.state import State, StepOutcome, reactions_on
from xper_fx.bulk.step_equations import StepEquations
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.point_tangents import PointTangents
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch

if TYPE_CHECKING:
    from xper_fx.nscd.growth import GrowthLimit

logger = logging.getLogger(__name__)

# Lengths of a step that are tried, and what is left of how many iterations it may not exceed.
_LENGTHS, _MEMORY = (1.0, 0.5, 0.25, 0.1), 3
# Iterations after which more may be left, and how much beside the tolerance: bonds that flip
# between loading and unloading may go round in circles too small to matter.
_PATIENCE, _ROUND = 7, 100.0
# Relative error of the growth that a step is asked for.
_GROWN = 1e-6
# Growth of what is left at which an iteration has gone astray.
_ASTRAY = 1e9
# Relative rounding of velocities at the ends of a spring.
_ROUNDING = 4.0 * np.finfo(float).eps
# Steps of differences where nothing moves yet, relative to the size of the scene a step.
_LEAST, _SMALLEST = 1e-16, 1e-20


class PointsOfNodes(NamedTuple):
    """Where points find their velocities: as `xper_fx.bulk.body_inverse`, without w on the bulk."""

    nodes: np.ndarray
    num_nodes: int
    blocks: BodyInverse


class MonolithicScheme:
    """Theta scheme of the bulk together with the interactions.

    Args:
        bulk: the bulk.
        interacting: nodes at which interactions act.
        theta: weight of the end of the step, in [1/2, 1].
        newton_tolerance: bound on what is left, relative to the largest nodal impulse.
        max_newton: iterations after which a step is given up.
        stopwatch: where phases are timed.
    """

    def __init__(
        self,
        bulk: Bulk,
        interacting: np.ndarray,
        theta: float,
        newton_tolerance: float,
        max_newton: int,
        stopwatch: Stopwatch,
    ):
        self.bulk, self.theta = bulk, theta
        self._weight = bulk.end_weight(theta)
        self._nodes = np.asarray(interacting)
        self._tolerance, self._max_newton = newton_tolerance, max_newton
        self._stopwatch = stopwatch
        self._system: CoupledSystem | None = None
        self._renewals = -1
        self._compliance: tuple[float, np.ndarray, PointsOfNodes] | None = None
        self._linear: tuple[float, sp.csr_array] | None = None
        x = bulk.forms.bodies.mesh.geometry.x
        self._extent = float(np.ptp(x, axis=0).max())
        stopwatch.owns("coupled system", lambda: self.nbytes)

    # Matrices

    def inverse(self, step: float, displacement: np.ndarray) -> PointsOfNodes:
        """The nodes of the points, and compliances for a step size by which branches are told."""
        if self._compliance is None or self._compliance[0] != step:
            diagonal = self._matrix(step, displacement).diagonal()
            free = ~self.bulk.layout.prescribed
            compliance = np.zeros(len(diagonal))
            np.divide(1.0, np.abs(diagonal), out=compliance, where=free & (diagonal != 0.0))
            self._take(step, compliance)
        return self._compliance[2]

    def _take(self, step: float, compliance: np.ndarray) -> None:
        """Take the compliance of each unknown for a step size, shape (num_dofs,), m/s per N s."""
        entries = compliance.reshape(-1, self.bulk.dim)[self._nodes]
        blocks = BodyInverse.of_nodes(entries, self.bulk.dim)
        found = PointsOfNodes(self._nodes, len(self.bulk.layout.nodes), blocks)
        self._compliance = step, compliance, found

    def _matrix(self, step: float, displacement: np.ndarray) -> sp.csr_array:
        """A; its pattern is always the same."""
        bulk = self.bulk
        if bulk.linear and self._linear is not None and self._linear[0] == step:
            return self._linear[1]
        scaled = step * self.theta
        stiffness = (bulk.stiffness if bulk.linear else bulk.tangent(displacement)).copy()
        stiffness.data *= scaled**2
        if bulk.damping is not None:
            bulk.damping.add_to(stiffness, scaled)
        matrix = bulk.unknowns.whole(stiffness)
        rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        if np.ndim(self._weight):
            ratio = self._weight / self.theta
            matrix.data *= ratio[rows] * ratio[matrix.indices]
        if bulk.inertia is not None:
            mass = bulk.mass
            if bulk.damping is not None:
                mass = mass * bulk.damping.mass_factor(scaled)
            matrix.data[np.flatnonzero(rows == matrix.indices)] += mass
        if bulk.linear:
            self._linear = step, matrix
        return matrix

    def _coupled(self, matrix: sp.csr_array, interactions: Interactions | None) -> CoupledSystem:
        """The system of the points there are."""
        renewals = 0 if interactions is None else interactions.renewals
        if self._system is None or renewals != self._renewals:
            dofs_of_slots = np.zeros(0, np.int64)
            if interactions is not None:
                dofs_of_slots = np.full(interactions.inverse.num_slots * self.bulk.dim, -1)
                dofs = self.bulk.layout.dofs(self._nodes)
                dofs_of_slots[: len(dofs)] = dofs
            self._system = CoupledSystem(
                matrix, self.bulk.layout.prescribed, dofs_of_slots, interactions
            )
            self._renewals = renewals
        return self._system

    # A step

    def attempt(
        self,
        state: State,
        step: float,
        interactions: Interactions | None,
        solver: Solver,
        options: SolveOptions,
        growth: GrowthLimit | None = None,
        guess: tuple[float, np.ndarray] | None = None,
    ) -> StepOutcome:
        """One step from `state`, which is not changed; see `ImplicitScheme.attempt`.

        With a `growth` the time at which the step ends, and so the load, is found from it; `step`
        is then the time by which velocities are defined.

        Args:
            state, step, interactions, solver, options: as of `ImplicitScheme.attempt`.
            growth: what the step may open, None where its end is given.
            guess: time (s) and velocities to start from, shape (num_dofs,).
        """
        bulk, watch = self.bulk, self._stopwatch
        bulk.forms.set_step(step)
        equations = StepEquations(bulk, state, step, self._weight)
        loading = Loading(bulk, equations, state, step, self.theta)
        if growth is not None:
            loading.set(state.time)
        if interactions is not None:
            with watch.phase("interaction terms"):
                blocks = self.inverse(step, state.displacement).blocks
                if interactions.bulk_inverse is not blocks:
                    interactions.update_inverse(blocks)
                interactions.begin_step(step, self.theta)
        # lips that touch and bear nothing are open at first, or closed if that leads nowhere
        for closes in (False, True):
            newton = _Newton(self, equations, loading, interactions, state, step, growth, closes)
            if guess is not None:
                newton.start_from(*guess)
            converged = newton.run(self._tolerance, self._max_newton)
            if converged or not newton.touches:
                break
            loading.set(state.time + (0.0 if growth is not None else step))
            interactions.begin_step(step, self.theta)
        if growth is not None and growth.turns_back(newton.moved()):
            converged = False
        velocity, impulses = newton.velocity, newton.impulses
        reactions = reactions_on(
            bulk.layout.prescribed, lambda d: -(newton.residual[d] + impulses[d])
        )
        end = State(
            loading.time, equations.displacement(velocity), velocity, newton.internal,
            loading.external,
        )  # fmt: skip
        mean = self._weight * velocity + (1.0 - self._weight) * state.velocity
        return StepOutcome(
            end, newton.slots, impulses, reactions, equations.force_impulse, bulk.viscous(mean), 0,
            newton.left, 0.0, newton.iterations, newton.left, converged,
        )  # fmt: skip

    @property
    def nbytes(self) -> int:
        """Memory held by matrices, factors apart, in bytes."""
        linear = 0 if self._linear is None else 1.5 * self._linear[1].data.nbytes
        return int(linear) + (0 if self._system is None else self._system.nbytes)

    def holds(self, step: float) -> bool:
        """As of `ImplicitScheme`: matrices are made anew from the state."""
        return step > 0.0

    def saved(self) -> dict:
        """The compliances of a bulk that is not linear, which are those of the state they met."""
        if self.bulk.linear or self._compliance is None:
            return {}
        step, compliance, _ = self._compliance
        return self.bulk.unknowns.by_cell(compliance) | {"step": step}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave."""
        if saved:
            self._take(saved["step"], self.bulk.unknowns.from_cells(saved))


class _Newton:
    """The iterations of one step.

    Attributes:
        velocity: of all unknowns (m/s).
        residual, internal: of the bulk there, without impulses (N s), and its forces (N).
        slots: velocities of the points' nodes.
        impulses: H r on all unknowns (N s).
        left: what is left, relative to the largest nodal impulse.
        iterations: made.
        touches: whether points touch at the start and bear nothing.
    """

    def __init__(self, scheme, equations, loading, interactions, state, step, growth, closes):
        self._scheme, self._equations, self._interactions = scheme, equations, interactions
        self._loading, self._step, self._growth, self._closes = loading, step, growth, closes
        self._free = ~scheme.bulk.layout.prescribed
        self._tangents = None if interactions is None else PointTangents(interactions)
        # without inertia the last step's velocities mean nothing for this one
        inert = scheme.bulk.inertia is not None
        start = state.velocity if inert else np.zeros_like(state.displacement)
        self.velocity, self.slots = start.copy(), np.zeros(0)
        self.impulses = np.zeros_like(start)
        self.residual, self.internal = equations.residual(self.velocity)
        self.left, self.iterations = np.inf, 0
        self._stiffest = 0.0
        groups = [] if interactions is None else interactions.groups
        self.touches = any(np.any(~g.impulse.any(axis=1) & (g.jump[:, 0] <= 0.0)) for g in groups)

    def run(self, tolerance: float, most: int) -> bool:
        """Whether what is left came within the tolerance."""
        history: list[float] = []
        for self.iterations in range(1, most + 1):
            try:
                correction = self._correction()
            except SingularMatrixError:
                return False
            if correction is None:
                return False
            best = None
            start = self.velocity, self._loading.time, self._old_impulses()
            for length in _LENGTHS:
                self._go(start, correction, length)
                merit = self._merit()
                if best is None or merit < best[0]:
                    best = merit, length
                if not history or merit < max(history[-_MEMORY:]):
                    break
            if best[1] != length:
                self._go(start, correction, best[1])
                self._merit()
            history.append(best[0])
            if not np.isfinite(best[0]):
                return False
            reference = self._size()
            floor = self._floor()
            self.left = self._most / reference if reference > 0.0 else 0.0
            logger.debug(
                "iteration %d: length %g, %.2e left, growth %.1e, %d points held", self.iterations,
                best[1], self.left, self._growth_left(), self._num_held(),
            )  # fmt: skip
            allowed = tolerance * (1.0 if self.iterations <= _PATIENCE else _ROUND)
            small = self._most <= max(allowed * reference, floor)
            if small and best[1] == 1.0 and self._grown():
                if self._interactions is None:
                    return True
                if self._interactions.evolve(self.slots) <= tolerance:
                    return True
                history.clear()
            elif best[0] > _ASTRAY * reference:
                return False
        return False

    def start_from(self, time: float, velocity: np.ndarray) -> None:
        """Take a state to start from: its loads, and the laws' answers to it."""
        none = [np.zeros_like(old) for old in self._old_impulses()]
        self._go(
            (self.velocity, self._loading.time, self._old_impulses()),
            (velocity - self.velocity, time - self._loading.time, none), 1.0,
        )  # fmt: skip

    def _correction(self) -> tuple[np.ndarray, float, list[np.ndarray]] | None:
        """Changes of all velocities, of the time, and of each group's impulses.

        None if no load keeps all bonds within their growth.
        """
        scheme, interactions, watch = self._scheme, self._interactions, self._scheme._stopwatch
        loading, growth = self._loading, self._growth
        with watch.phase("bulk matrix"):
            displacement = self._equations.displacement(self.velocity)
            matrix = scheme._matrix(self._step, displacement)
            self._stiffest = float(np.abs(matrix.data).max())
        right, stiffness = self.residual, []
        if interactions is not None:
            with watch.phase("point tangents"):
                self.slots = self._slots(self.velocity)
                self._tangents.linearise(self.slots, self._least(), self._closes)
                stiffness = self._tangents.stiffness
                source = [
                    g.impulse + s
                    for g, s in zip(interactions.groups, self._tangents.source, strict=True)
                ]
                right = right + self._on_unknowns(self._tangents.spread(source))
        with watch.phase("factorisation"):
            system = scheme._coupled(matrix, interactions)
            system.take(matrix, stiffness)
        change = 0.0
        with watch.phase("solution"):
            dv = system.solve(right, loading.wanted - self.velocity)
            if growth is not None:
                force, motion = loading.rates()
                along = system.solve(np.broadcast_to(force, dv.shape), motion)
        if growth is not None:
            now = self._jumps(self.velocity)
            start, slope = self._moved(dv), self._moved(along)
            start = [x + y for x, y in zip(now, start, strict=True)]
            change = growth.change(now, self._tangents.held, start, slope)
            if change is None or not np.isfinite(change):
                return None
            dv = dv + change * along
        if interactions is None:
            return dv, change, []
        moved = self._slots(dv).reshape(-1, interactions.dim)
        return dv, change, self._tangents.changes(moved)

    def _jumps(self, velocity: np.ndarray) -> list[np.ndarray]:
        """Jumps of each group at the end of the step for end velocities, m."""
        rest = self._step * (1.0 - self._scheme.theta)
        groups, moved = self._interactions.groups, self._moved(velocity)
        return [g.jump + rest * g.velocity + m for g, m in zip(groups, moved, strict=True)]

    def _moved(self, velocity: np.ndarray) -> list[np.ndarray]:
        """h theta H^T v of each group, m."""
        slots = self._slots(velocity).reshape(-1, self._interactions.dim)
        scaled = self._step * self._scheme.theta
        return [scaled * g.points.relative(slots) for g in self._interactions.groups]

    def moved(self) -> list[np.ndarray]:
        """Change of the jumps of each group in the step, m."""
        groups = self._interactions.groups
        return [j - g.jump for g, j in zip(groups, self._jumps(self.velocity), strict=True)]

    def _grown(self) -> bool:
        """Whether the bonds have opened by what the step asks for, if it does."""
        return abs(self._growth_left()) <= _GROWN

    def _growth_left(self) -> float:
        return 0.0 if self._growth is None else self._growth.left(self._jumps(self.velocity))

    def _old_impulses(self) -> list[np.ndarray]:
        groups = [] if self._interactions is None else self._interactions.groups
        return [g.impulse.copy() for g in groups]

    def _go(self, start, correction, length: float) -> None:
        """The state at a length of a correction from a start; the laws answer there."""
        velocity, time, old = start
        dv, change, changes = correction
        self.velocity = velocity + length * dv
        if self._growth is not None:
            self._loading.set(time + length * change)
        with self._scheme._stopwatch.phase("free velocity"):
            self.residual, self.internal = self._equations.residual(self.velocity)
        if self._interactions is None:
            return
        self.slots = self._slots(self.velocity)
        for g, before, change in zip(self._interactions.groups, old, changes, strict=True):
            np.multiply(change, length, out=g.impulse)
            g.impulse += before
        with self._scheme._stopwatch.phase("point tangents"):
            self._answer()
            self._apart = self._answer()

    def _answer(self) -> tuple[float, float]:
        """Impulses become the laws' answers, which keep every inequality.

        Returns:
            Sum of squares and largest entry of their change (N s).
        """
        self._tangents.respond(self.slots)
        total, most = 0.0, 0.0
        for g, answer in zip(self._interactions.groups, self._tangents.response, strict=True):
            apart = answer - g.impulse
            total += float(np.vdot(apart, apart))
            most = max(most, float(np.abs(apart).max(initial=0.0)))
            g.impulse[:] = answer
        return total, most

    def _merit(self) -> float:
        """What is left; `_most` is its largest entry."""
        total, most = 0.0, 0.0
        self.impulses = np.zeros_like(self.velocity)
        if self._interactions is not None:
            self.impulses = self._on_unknowns(self._interactions.impulses())
            total, most = self._apart
        balance = (self.residual + self.impulses)[self._free]
        self._most = max(most, float(np.abs(balance).max(initial=0.0)))
        return float(np.sqrt(total + balance @ balance))

    def _size(self) -> float:
        """Largest nodal impulse."""
        largest = self._step * np.abs(self.internal).max(initial=0.0)
        return max(
            float(largest), float(np.abs(self.impulses).max(initial=0.0)),
            float(np.abs(self._equations.start).max(initial=0.0)),
        )  # fmt: skip

    def _floor(self) -> float:
        """What rounding of displacements leaves in the bulk and at the stiffest spring."""
        stiffest = self._stiffest
        if self._tangents is not None:
            for k, held in zip(self._tangents.stiffness, self._tangents.held, strict=True):
                stiffest = max(stiffest, float(np.abs(k[~held]).max(initial=0.0)))
        return _ROUNDING * stiffest * float(np.abs(self.velocity).max(initial=0.0))

    def _num_held(self) -> int:
        return 0 if self._tangents is None else sum(int(h.sum()) for h in self._tangents.held)

    def _least(self) -> float:
        """Velocity that differences are at least taken over."""
        given = self._loading.wanted
        speed = max(np.abs(self.slots).max(initial=0.0), np.abs(given).max(initial=0.0))
        return max(_LEAST * float(speed), _SMALLEST * self._scheme._extent / self._step)

    def _slots(self, velocity: np.ndarray) -> np.ndarray:
        dim = self._interactions.dim
        return self._interactions.free_velocities(velocity.reshape(-1, dim)[self._scheme._nodes])

    def _on_unknowns(self, slots: np.ndarray) -> np.ndarray:
        out = np.zeros_like(self.velocity)
        nodes = self._scheme._nodes
        out.reshape(-1, self._interactions.dim)[nodes] = slots[: len(nodes)]
        return out
