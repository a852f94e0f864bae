# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Explicit bulk, implicit interactions.

The bulk's forces are taken at mid-step and the mass is lumped,

    q_m = q0 + (h / 2) v0,   M (v1 - v0) = h F(q_m, v0, t0 + h/2) + H r,   q1 = q_m + (h / 2) v1,

which is the central difference scheme, stable below the critical step of the bulk alone, while
the interactions see theta = 1/2 with w = M^-1 and limit nothing however stiff they are. W couples
only the points that meet at one mesh vertex.

With dq = q1 - q0 = h (v0 + v1) / 2 the kinetic energy v.M.v / 2 gains -dq.f(q_m) and the work of
all other impulses in their displacements, exactly. For a linear bulk dq.K q_m is the increment of

    q.K.q / 2 + S,   S = -(h^2 / 8) v.K.v = -(h / 4) v.(f(q + (h / 2) v) - f(q)),

so that v.M.v / 2 + q.K.q / 2 + S is conserved, the shadow energy of central differences (Hairer,
Lubich and Wanner 2003 have its like for all such schemes). S is of order (h omega)^2 beside the
elastic energy and reversible. Both forces are known at either end of a step: f(q_m) and f(q0) give
S0, f(q1) and f(q_m) give S1. The energy ledger holds it, and closes to rounding; where a step is
longer than the one before S is another, and the ledger books the difference as numerical. For other
materials S closes to second order, as their energies do.

The forces of a linear bulk at the end of a step are the mean of those half a step before and half a
step after, and the latter are those of the middle of the next step: each step asks once for forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from xper_fx.bulk.body_inverse import LumpedInverse
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.stable_step import StableStep
from xper_fx.bulk.state import State, StepOutcome, Supports, interact, on_nodes, put_on_nodes
from xper_fx.bulk.step_by_cell import EndedStep, StepByCell
from xper_fx.bulk.step_energies import NUM_ENERGIES, own_energies
from xper_fx.cache import njit
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch


@njit(**LEAN_ENTRY)
def _free_velocities(v0, w, step, force, others, out):
    """Velocities at the end of a step without interactions.

    Args:
        v0: velocities at the start of the step (m/s).
        w: one over the mass, zero where motions are given.
        step: h (s).
        force: internal forces, N (2D: N/m).
        others: other impulses (N s), or one number for none.
        out: takes the velocities in front.
    """
    several = len(others) > 1
    for i in range(len(v0)):
        impulse = -step * force[i]
        if several:
            impulse += others[i]
        out[i] = w[i] * impulse + v0[i]


@njit(**LEAN_ENTRY)
def _react(dofs, mass, v0, v1, step, force, impulses, out):
    """Impulses on the dofs of supports, shape (num_prescribed,), but for those of loads."""
    for i in range(len(dofs)):
        d = np.uintp(dofs[i])
        out[i] = mass[d] * (v1[d] - v0[d]) + step * force[d] - impulses[d]


@njit(**LEAN_ENTRY)
def _give_all(more, w, impulses, free, velocity):
    """As `_give`, where all nodes have slots, in their order."""
    for i in range(len(free)):
        impulses[i] += more[i]
        velocity[i] = free[i] + w[i] * impulses[i]


@njit(**LEAN_ENTRY)
def _give(more, nodes, w, impulses, velocity, slots):
    """Give some nodes more impulses; their velocities, which are free ones, are those of all."""
    dim = more.shape[1]
    for i in range(len(nodes)):
        for d in range(dim):
            dof = np.uintp(nodes[i] * dim + d)
            impulses[dof] += more[i, d]
            velocity[dof] += w[dof] * impulses[dof]
            slots[i, d] = velocity[dof]


class _Left(NamedTuple):
    """What a step has left for the next one: its end, size, and shadow energy there."""

    end: EndedStep
    step: float
    shadow: float

    def suits(self, state: State, step: float) -> bool:
        """Whether it serves a step of some size from a state."""
        same = self.end.displacement is state.displacement and self.step == step
        return same and self.end.ahead is not None


class ExplicitScheme:
    """Central differences of the bulk with implicit interactions.

    Args:
        interacting: nodes at which interactions act, in the order the layer shall use.
        stopwatch: where phases are timed.
        by_body: as of `LumpedInverse`.
    """

    theta = 0.5

    def __init__(
        self, bulk: Bulk, interacting: np.ndarray, stopwatch: Stopwatch, by_body: bool = False
    ):
        self.bulk = bulk
        with stopwatch.phase("inverse"):
            self._inverse = LumpedInverse(bulk.layout, bulk.mass, interacting, by_body)
        stopwatch.owns("inverse", lambda: self.nbytes)
        with stopwatch.phase("assemble"):
            bulk.forces_by_cell()
            self._stable = StableStep(bulk) if bulk.forms.finite_strain else None
        self._stopwatch = stopwatch
        self._by_cell = None
        if bulk.by_cell is not None:
            self._by_cell = StepByCell(bulk.by_cell, bulk.mass, self._inverse.diagonal)
        self._left: _Left | None = None
        self._free: np.ndarray | None = None

    def inverse(self, step: float, displacement: np.ndarray) -> LumpedInverse:
        """The inverse of the mass, the same for every step."""
        return self._inverse

    def attempt(
        self,
        state: State,
        step: float,
        interactions: Interactions | None,
        solver: Solver,
        options: SolveOptions,
    ) -> StepOutcome:
        """One step from `state`, which is not changed; see `ImplicitScheme.attempt`.

        Raises:
            UnstableStepError: the step is too long for what cells have become.
        """
        bulk, watch, inverse = self.bulk, self._stopwatch, self._inverse
        q0, v0, size = state.displacement, state.velocity, len(state.velocity)
        if self._stable is not None:
            with watch.phase("critical step"):
                self._stable.require(step, q0, v0)
        bulk.forms.set_step(0.5 * step)
        with watch.phase("free velocity"):
            viscous = bulk.viscous(v0)
            force_impulse = step * bulk.external(state.time + 0.5 * step)
            others = force_impulse - step * viscous
            loaded = isinstance(others, np.ndarray)
            halfway, shadow, room = self._begin(state, step)
            in_slots = interactions is not None and inverse.in_order
            length = interactions.inverse.num_slots * bulk.dim if in_slots else size
            if room is None or len(room) != length or loaded:
                room = np.empty(length)
                given = np.atleast_1d(others)
                _free_velocities(v0, inverse.diagonal, step, halfway, given, room)
            free = room[:size]
            bulk.prescribe(free, state.time + step, step, self.theta, q0, v0)
        sweeps, error, traction, converged = 0, 0.0, 0.0, True
        if interactions is None:
            velocity, impulses, slots = free, np.zeros(size), np.zeros(0)
        else:
            with watch.phase("interaction terms"):
                if interactions.turns:
                    from xper_fx.bulk.turning import turn

                    free = free.copy()  # solvers change what is in slots
                    nodes = None if inverse.in_order else inverse.nodes
                    turn(interactions, bulk, nodes, state, v0, step, self.theta)
                interactions.begin_step(step, self.theta, interactions.ordering == "vertices")
            with watch.phase("interaction solve"):
                velocity, impulses, slots, report = interact(
                    inverse, interactions, solver, room, options
                )
            if interactions.turns:
                with watch.phase("turning frames"):
                    couples = interactions.couples(True)
                    by_slot = slots.reshape(couples.shape)
                    if interactions.fused is None and inverse.in_order:
                        velocity = slots[:size]
                        _give_all(couples.ravel(), inverse.diagonal, impulses, free, velocity)
                        interactions.refresh_ghosts(slots)
                    elif interactions.fused is None:
                        velocity = free
                        _give(couples, inverse.nodes, inverse.diagonal, impulses, velocity, by_slot)
                        interactions.refresh_ghosts(slots)
                    else:
                        interactions.push_couples(couples, by_slot)
                        impulses += on_nodes(couples, inverse.nodes, size)
                        velocity = free
                        put_on_nodes(by_slot, inverse.nodes, velocity)
            sweeps, error, traction, converged = report[1], report[2], report[3], report[0]
        dofs = bulk.layout.prescribed_dofs
        reactions = np.empty(len(dofs))
        _react(dofs, bulk.mass, v0, velocity, step, halfway, impulses, reactions)
        if loaded:
            reactions -= others[dofs]
        bulk.forms.set_step(step)
        own = np.array([sweeps, error, traction])
        with watch.phase("energy"):
            end = self._end(state, velocity, halfway, step, length)
            outcome = StepOutcome(
                State(state.time + step, end.displacement, velocity, end.forces), slots, impulses,
                Supports(dofs, reactions), force_impulse, viscous, *own.tolist(), 1, 0.0, converged,
            )  # fmt: skip
            energies = np.zeros(NUM_ENERGIES)
            if converged and math.isfinite(end.power):
                energies = own_energies(bulk, state, outcome, step, self.theta, held=end.held)
            sums = np.concatenate([[end.power, not converged], energies])
            sums, largest = bulk.ranks.sum_and_max(sums, own)
        power, failed, *energies = sums.tolist()
        sweeps, error, traction = largest.tolist()
        shadow_at_end = -0.25 * step * power
        self._left, self._free = _Left(end, step, shadow_at_end), end.free
        # what is not finite is so in the sums too
        converged = failed == 0.0 and math.isfinite(shadow + shadow_at_end)
        return outcome._replace(
            sweeps=int(sweeps), residual=error, traction_change=traction, converged=converged,
            shadow=(float(shadow), float(shadow_at_end)), energies=energies,
        )  # fmt: skip

    def _begin(self, state: State, step: float) -> tuple[np.ndarray, float, np.ndarray | None]:
        """Internal forces in the middle of a step, the shadow energy at its start, and `free`.

        The last is what `EndedStep` has, which is given once, as solvers change it.
        """
        left = self._left
        if left is not None and left.suits(state, step):
            free, self._free = self._free, None
            return left.end.ahead, left.shadow, free
        velocity = state.velocity
        force = self.bulk.internal(0.5 * step * velocity + state.displacement)
        return force, -0.25 * step * self.bulk.dot(velocity, force - state.internal), None

    def _end(
        self, state: State, velocity: np.ndarray, halfway: np.ndarray, step: float, room: int
    ) -> EndedStep:
        """End a step; arguments as of `StepByCell`."""
        if self._by_cell is not None:
            return self._by_cell.end(state, velocity, halfway, step, room)
        bulk, half, ahead = self.bulk, 0.5 * step, None
        q1 = half * velocity + (half * state.velocity + state.displacement)
        if bulk.linear:
            ahead = bulk.internal(half * velocity + q1)
            internal = 0.5 * (halfway + ahead)
        else:
            internal = bulk.internal_at_end(q1)
        return EndedStep(q1, internal, ahead, float(velocity @ (internal - halfway)))

    @property
    def nbytes(self) -> int:
        """Memory held by the inverse of the mass, in bytes."""
        return self._inverse.nbytes

    def saved(self) -> dict:
        """The critical step that the run has come to, at finite strain."""
        return {} if self._stable is None else self._stable.saved()

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave, its rows in order."""
        if self._stable is not None and saved:
            self._stable.restore(saved)

    def holds(self, step: float) -> bool:
        """As of `ImplicitScheme`."""
        return True
