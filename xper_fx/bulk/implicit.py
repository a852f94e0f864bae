# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Theta scheme with Newton (Perales et al. 2010, eqs 8-11).

With theta in [1/2, 1] and F = f_ext - f_int(q) - C v,

    M (v1 - v0) = h [theta F1 + (1 - theta) F0] + H r,   q1 = q0 + h [theta v1 + (1 - theta) v0],
    Mt = M + h theta C + h^2 theta^2 K,                  w = Mt^-1 on the dofs not prescribed,
    res^k = -M (v^k - v0) + h [(1 - theta) F0 + theta F^k],
    v_free = v^k + w res^k,                              v^{k+1} = v_free + w H r.

A linear bulk is done after one iteration, and Mt is formed and inverted once for each step size.
Bodies without inertia that interactions alone hold stand on springs that let go after each
iteration (`floating_bodies.py`), of which there are then a few.
Otherwise w is kept as long as Newton contracts well with it, and renewed when it does not.

Some unknowns may have another theta (`Bulk.end_weight`): those of a periodic cell that no mass
belongs to hold their equations at the end of the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.extent import extent
from xper_fx.bulk.implicit_step import ImplicitStep, NewtonLimits
from xper_fx.bulk.kept_inverses import KeptInverses
from xper_fx.bulk.state import State, StepOutcome
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch

# Newton's correction of the positions, relative to the size of the scene, that is rounding.
_ROUNDING = 1e-14


class ImplicitScheme:
    """Theta scheme of the bulk.

    Args:
        interacting: nodes at which interactions act.
        theta: weight of the end of the step, in [1/2, 1].
        newton_tolerance: bound on the last Newton correction of the velocities, relative to the
            velocities, in the norm of the mass; with interactions it is at least a hundredth of
            their tolerance, which blurs it.
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
        self.bulk, self.theta, self._stopwatch = bulk, theta, stopwatch
        self._inverses = KeptInverses(bulk, interacting, theta, stopwatch)
        rounding = _ROUNDING * bulk.norm(np.full(bulk.num_dofs, extent(bulk)))
        self._limits = NewtonLimits(newton_tolerance, max_newton, rounding)
        self._likely_sweeps = 0  # those of the step before

    def inverse(self, step: float, displacement: np.ndarray):
        """The inverse for a step size; for a bulk that is not linear, near `displacement`."""
        return self._inverses.at(step, displacement)

    def attempt(
        self,
        state: State,
        step: float,
        interactions: Interactions | None,
        solver: Solver,
        options: SolveOptions,
    ) -> StepOutcome:
        """One step from `state`, which is not changed.

        Args:
            state: state at the start of the step.
            step: h (s).
            interactions: the points, None if the scene has none.
            solver: solver of the interactions.
            options: of the solver; its tolerance is what equations that hang on the impulses
                (`Bulk.balance`) can hold to.

        Returns:
            The outcome, converged or not.
        """
        if self._likely_sweeps and not self.bulk.ranks.alone:
            options = replace(options, likely_sweeps=self._likely_sweeps)
        attempt = ImplicitStep(
            self._inverses, self._limits, state, step, interactions, solver, options,
            self._stopwatch,
        )  # fmt: skip
        outcome = attempt.solve()
        self._likely_sweeps = attempt.sweeps_of_one_solve
        return outcome

    @property
    def nbytes(self) -> int:
        """Memory held by inverses, in bytes."""
        return self._inverses.nbytes

    def holds(self, step: float) -> bool:
        """Whether `inverse` gives the one that a run had for a step size."""
        return self._inverses.holds(step)

    def saved(self) -> dict:
        """At what the kept inverses were made, and how long sweeps took."""
        return {"inverses": self._inverses.saved(), "likely_sweeps": self._likely_sweeps}

    def restore(self, saved: Mapping) -> None:
        """Make the inverses that `saved` told of; other solvers keep others."""
        self._inverses.restore(saved.get("inverses", {}))
        self._likely_sweeps = int(saved.get("likely_sweeps", 0))
