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
"""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.body_inverse import LumpedInverse
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State, StepOutcome, at_nodes, interact, reactions_on
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch
from xper_fx.support.saved_rows import KeepsNothing


class ExplicitScheme(KeepsNothing):
    """Central differences of the bulk with implicit interactions.

    Args:
        bulk: the bulk.
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
        self._stopwatch = stopwatch

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
        """One step from `state`, which is not changed; see `ImplicitScheme.attempt`."""
        bulk, watch, inverse = self.bulk, self._stopwatch, self._inverse
        time = state.time + step
        q0, v0 = state.displacement, state.velocity
        bulk.forms.set_step(0.5 * step)
        with watch.phase("free velocity"):
            middle = 0.5 * step * v0
            middle += q0
            viscous = bulk.viscous(v0)
            force_impulse = step * bulk.external(state.time + 0.5 * step)
            halfway = bulk.internal(middle)
            impulse = halfway + viscous
            impulse *= -step
            impulse += force_impulse
            free = inverse.apply(impulse)
            free += v0
            bulk.prescribe(free, time, step, self.theta, q0, v0)
        velocity, impulses, slots = free, np.zeros_like(v0), np.zeros(0)
        sweeps, error, traction, converged = 0, 0.0, 0.0, True
        if interactions is not None:
            with watch.phase("interaction terms"):
                if interactions.turns:
                    from xper_fx.bulk.turning import couples_on, turn

                    turn(interactions, bulk, inverse.nodes, state, v0, step, self.theta)
                interactions.begin_step(step, self.theta)
            with watch.phase("interaction solve"):
                velocity, impulses, slots, report = interact(
                    inverse, interactions, solver, free, options
                )
            if interactions.turns:
                with watch.phase("turning frames"):
                    impulses += couples_on(interactions, inverse.nodes, len(impulses), True)
                    velocity = free + inverse.apply(impulses)
                    interactions.move_bulk(slots, at_nodes(velocity, inverse.nodes, bulk.dim))
            sweeps, error, traction, converged = report[1], report[2], report[3], report[0]
        reactions = reactions_on(
            bulk.layout,
            lambda d: bulk.mass[d] * (velocity[d] - v0[d]) - impulse[d] - impulses[d],
        )
        displacement = 0.5 * step * velocity
        displacement += middle
        bulk.forms.set_step(step)
        with watch.phase("energy"):
            internal = bulk.internal(displacement)
            start, end = v0 @ (halfway - state.internal), velocity @ (internal - halfway)
            shadow = bulk.ranks.sum(-0.25 * step * np.array([start, end]))
        finite = np.all(np.isfinite(velocity)) and np.all(np.isfinite(internal))
        converged = bulk.ranks.all(converged and finite)
        end = State(time, displacement, velocity, internal)
        return StepOutcome(
            end, slots, impulses, reactions, force_impulse, viscous, sweeps, error, traction, 1,
            0.0, converged, (float(shadow[0]), float(shadow[1])),
        )  # fmt: skip

    @property
    def nbytes(self) -> int:
        """Memory held by the inverse of the mass, in bytes."""
        return self._inverse.nbytes

    def holds(self, step: float) -> bool:
        """As of `ImplicitScheme`."""
        return True
