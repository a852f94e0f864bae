# SPDX-License-Identifier: LGPL-3.0-or-later
"""One step of the theta scheme by Newton's method; its equations are those of `implicit.py`.

Each iteration takes the velocities that the bulk would have without impulses, lets the solver find
the impulses for them, and looks at what is left: for these impulses that is the nonlinearity of the
bulk, or what springs of floating bodies bear.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.bulk.kept_inverses import KeptInverses
from xper_fx.bulk.state import State, StepOutcome, Supports, interact
from xper_fx.bulk.step_energies import NUM_ENERGIES, own_energies
from xper_fx.bulk.step_equations import StepEquations
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch

# Contraction of Newton's corrections above which w is renewed, unless no more than a few iterations
# are left to make, which cost less.
_SLOW, _FEW = 0.2, 3
# Times that a Newton step is halved before the time step is given up, or its length looked for.
_CUTS = 5
# Work of the residual along an increment, over what it was at its start, that an increment may end
# with; an increment that is too long ends no nearer than this to where it is known to be long or
# short, as a share of what is between.
_LEFT_OF_WORK, _OFF_ENDS = 0.5, 0.1
# Times the velocities before that are guessed at most: where they are rounding they tell nothing.
_MOST_GUESSED = 10.0
# Newton's tolerance is at least this part of that of the impulses, which blurs it.
_BLUR = 1e-2


class NewtonLimits(NamedTuple):
    """Where Newton's method ends."""

    tolerance: float  #: bound on the last correction of the velocities, relative to the velocities
    iterations: int  #: after which a step is given up
    rounding: float  #: norm of a correction of the positions that is rounding (m kg^(1/2))


class ImplicitStep:
    """One attempt at a step.

    Args:
        inverses: w by step size; kept ones are taken, and renewed where Newton's method asks.
        limits: of Newton's method.
        state: at the start of the step, which is not changed.
        step: h (s).
        interactions: the points, None if the scene has none.
        solver: of the interactions.
        options: of the solver; its tolerance is what equations that hang on the impulses
            (`Bulk.balance`) can hold to.
        stopwatch: where phases are timed.
    """

    def __init__(
        self,
        inverses: KeptInverses,
        limits: NewtonLimits,
        state: State,
        step: float,
        interactions: Interactions | None,
        solver: Solver,
        options: SolveOptions,
        stopwatch: Stopwatch,
    ):
        bulk = inverses.bulk
        self._inverses, self._limits, self._bulk, self._watch = inverses, limits, bulk, stopwatch
        self._start, self._step, self._theta = state, step, bulk.end_weight(inverses.theta)
        self._interactions, self._solver, self._options = interactions, solver, options
        self._bare = interactions is None
        self._turns = not self._bare and interactions.turns
        self._exact = bulk.linear and not bulk.floating
        self._tolerance = limits.tolerance
        if not self._bare:
            self._tolerance = max(self._tolerance, _BLUR * options.tolerance)
        self._balance = bulk.balance(self._tolerance if self._bare else options.tolerance)
        self._impulses, self._slots = np.zeros_like(state.velocity), np.zeros(0)
        # of turning frames: those of the last iteration's impulses, and how far they are from those
        # that the velocities have
        self._couples: np.ndarray | float = 0.0
        self._couples_left: np.ndarray | float = 0.0
        self._sweeps, self._solved, self._swept = 0, True, False
        self._solver_error = self._traction_change = 0.0
        # Newton's correction relative to the velocities, and that of the iteration before
        self._correction, self._correction_before = 0.0, np.inf
        # without interactions: the next increment of all velocities, once it is known
        self._increment: np.ndarray | None = None
        self._before = np.zeros(0)  # the residual before the last increment

    def solve(self) -> StepOutcome:
        """The outcome, converged or not."""
        self._begin()
        for iteration in self._watch.each("newton", range(1, self._limits.iterations + 1)):
            previous = self._velocity
            self._iterate(iteration)
            if not self._solved or (self._exact and self._balance.settled):
                break
            if self._exact:
                continue
            self._correct(previous)
            arrived = self._correction <= self._tolerance and self._balance.settled
            if arrived or not np.isfinite(self._correction):
                break
            self._renew_if_slow()
            self._correction_before = self._correction
        return self._outcome(iteration)

    def _begin(self) -> None:
        """Loads, prescribed velocities and interactions of the step; velocities of its start."""
        bulk, start, step, theta = self._bulk, self._start, self._step, self._inverses.theta
        time, v0 = start.time + step, start.velocity
        bulk.forms.set_step(step)
        with self._watch.phase("free velocity"):
            self._external = bulk.external(time)
            self._equations = StepEquations(bulk, start, step, self._theta)
            self._equations.load(self._external)
            self._velocity = v0.copy()
            bulk.prescribe(self._velocity, time, step, theta, start.displacement, v0)
            if bulk.inertia is None:
                self._guess(v0)
        self._inverse = self._inverses.at(step, start.displacement)
        if not self._bare:
            with self._watch.phase("interaction terms"):
                if self._interactions.bulk_inverse is not self._inverse.blocks:
                    self._interactions.update_inverse(self._inverse.blocks)
                self._turn(v0)
                self._interactions.begin_step(step, theta)
                self._take_couples()
        with self._watch.phase("free velocity"):
            self._residual, self._internal = self._equations.residual(self._velocity)

    def _guess(self, before: np.ndarray) -> None:
        """Let what is free follow what is prescribed as it did in the step before.

        Where loads turn round, bodies then turn with their supports: else what lies between would
        flow in the first guess.
        """
        bulk, given = self._bulk, self._bulk.layout.prescribed
        was = np.where(given, before, 0.0)
        size = bulk.dot(was, was)
        if size > 0.0:
            share = bulk.dot(was, self._velocity) / size
            share = min(max(share, -_MOST_GUESSED), _MOST_GUESSED)
            self._velocity = np.where(given, self._velocity, share * before)

    def _turn(self, velocity: np.ndarray) -> None:
        """Let frames of bonds follow their bodies, which move by mean velocities over the step."""
        if self._turns:
            from xper_fx.bulk.turning import turn

            turn(
                self._interactions, self._bulk, self._inverse.nodes, self._start, velocity,
                self._step, self._inverses.theta,
            )  # fmt: skip

    def _take_couples(self) -> None:
        """Take the couples of the present impulses, where frames turn."""
        if self._turns:
            from xper_fx.bulk.turning import couples_on

            count = len(self._start.velocity)
            self._couples = couples_on(self._interactions, self._inverse.nodes, count)

    def _iterate(self, iteration: int) -> None:
        """Take the free velocities, and from them those with impulses."""
        watch, inverse, previous = self._watch, self._inverse, self._velocity
        self._before = self._residual
        couples = self._couples
        with watch.phase("free velocity"):
            self._corrected = self._balance.missing
            advance = inverse.advance if self._bare or self._corrected else inverse.apply
            residual = self._residual
            if self._turns:
                residual = residual + couples
            known, self._increment = self._increment, None
            free = previous + (advance(residual) if known is None else known)
        self._velocity = free
        if not self._bare:
            if iteration > 1:  # what an earlier iterate damaged is whole again
                with watch.phase("interaction terms"):
                    self._turn(self._mean(previous))
                    self._interactions.prepare()
            if self._bulk.floating:
                self._interactions.take_anchors(inverse.anchors(residual))
            with watch.phase("interaction solve"):
                self._velocity, impulses, self._slots, report = interact(
                    inverse, self._interactions, self._solver, free, self._options
                )
            self._impulses = impulses + couples if self._turns else impulses
            self._take_couples()
            self._couples_left = self._couples - couples
            self._sweeps += report.sweeps
            self._swept = report.solver == "distributed"
            self._solver_error = report.residual
            self._traction_change = report.traction_change
            self._solved = report.converged
        with watch.phase("free velocity"):
            self._residual, self._internal = self._equations.residual(self._velocity)
            self._balance.assess(
                inverse, self._velocity, previous, self._residual + couples, self._internal,
                self._step, self._correction,
            )  # fmt: skip

    def _correct(self, previous: np.ndarray) -> None:
        """Find what Newton's method would correct next, and halve a step that went too far.

        So does one that inverts a cell (no finite energy) or leaves more than it found.
        """
        if self._corrected and not self._bare:
            # what other unknowns stir up is no step that went wrong
            self._correction_before = np.inf
        with self._watch.phase("free velocity"):
            shortened = not self._corrected and self._shorten(previous)
            self._correction = self._next_correction()
            if shortened and not self._bare:  # the impulses belong to the whole step
                self._correction = max(self._correction, 2.0 * self._tolerance)
            for _ in range(_CUTS):
                bound = 2.0 * self._correction_before
                if np.isfinite(self._correction) and self._correction <= bound:
                    break
                self._velocity = 0.5 * (self._velocity + previous)
                self._residual, self._internal = self._equations.residual(self._velocity)
                self._correction = max(self._next_correction(), 2.0 * self._tolerance)

    def _left(self, residual: np.ndarray) -> np.ndarray:
        """What is left of a residual with the impulses found (N s)."""
        left = residual + self._impulses
        return left + self._couples_left if self._turns else left

    def _shorten(self, previous: np.ndarray) -> bool:
        """End an increment where what is left does little work along it, if it went beyond.

        What is left, r, is minus the gradient of the energy that a step minimises with the impulses
        found. Its work r . d along the increment d falls from above zero to below where an
        increment is too long, as where flow turns round and w is that of the flow before: Newton's
        method then goes to and fro. The zero is looked for between (false position, kept off the
        ends). Of an increment within the tolerance works are rounding.

        Returns:
            Whether the increment was too long.
        """
        bulk, increment = self._bulk, self._velocity - previous
        descent = bulk.dot(self._left(self._before), increment)
        bound = _LEFT_OF_WORK * descent
        low, high = (0.0, descent), (1.0, bulk.dot(self._left(self._residual), increment))
        if bound <= 0.0 or not high[1] < -bound or self._relative(increment) <= self._tolerance:
            return False
        for _ in range(_CUTS):
            share = low[1] / (low[1] - high[1])
            share = min(max(share, _OFF_ENDS), 1.0 - _OFF_ENDS)
            length = low[0] + share * (high[0] - low[0])
            self._velocity = previous + length * increment
            self._residual, self._internal = self._equations.residual(self._velocity)
            work = bulk.dot(self._left(self._residual), increment)
            if abs(work) <= bound:
                break
            if work > 0.0:
                low = length, work
            else:  # or not finite
                high = length, work if np.isfinite(work) else -np.inf
        return True

    def _next_correction(self) -> float:
        """Newton's next correction relative to the velocities; infinite if it is not finite."""
        # without interactions all unknowns are corrected at once
        solve = self._inverse.advance if self._bare else self._inverse.apply
        increment = solve(self._left(self._residual))
        if self._bare:
            self._increment = increment
        return self._relative(increment)

    def _relative(self, increment: np.ndarray) -> float:
        """Size of an increment beside the velocities; infinite if it is not finite."""
        correction = self._bulk.norm(increment)
        self._displacement = self._equations.displacement(self._velocity)
        # towards rest velocities vanish, and the rounding of positions is what is left
        rounding = self._limits.rounding
        if self._bulk.floating:
            from xper_fx.bulk.floating_bodies import ROUNDING

            rounding = max(rounding, ROUNDING * self._bulk.norm(self._displacement))
        if correction <= rounding / (self._step * self._inverses.theta):
            return 0.0
        relative = correction / self._bulk.norm(self._velocity)
        return relative if np.isfinite(relative) else np.inf

    def _renew_if_slow(self) -> None:
        """Take the inverse of the present tangent where Newton's method contracts badly."""
        correction, before = self._correction, self._correction_before
        left = 0.0  # iterations, if corrections go on to contract as they did
        if correction > self._tolerance:
            left = np.inf
            if correction < before < np.inf:
                left = np.log(self._tolerance / correction) / np.log(correction / before)
        slow = correction > _SLOW * before and left > _FEW
        if self._balance.worse or (slow and not self._bulk.linear):
            self._inverse = self._inverses.at(self._step, self._displacement, renew=True)
            self._increment = None
            if not self._bare:
                with self._watch.phase("interaction terms"):
                    self._interactions.update_inverse(self._inverse.blocks)

    @property
    def sweeps_of_one_solve(self) -> int:
        """Those of ranks that have arrived by the impulses' change, where nothing was solved twice.

        Else 0: what went on in a solve says little of the next one.
        """
        if not (self._exact and self._swept and self._solved):
            return 0
        return self._sweeps if self._solver_error <= self._options.tolerance else 0

    def _outcome(self, iterations: int) -> StepOutcome:
        bulk, velocity, step = self._bulk, self._velocity, self._step
        failed = not (
            self._solved
            and self._correction <= self._tolerance
            and self._balance.settled
            and np.all(np.isfinite(velocity))
            and np.all(np.isfinite(self._internal))
        )
        left = self._residual, self._impulses
        dofs = bulk.layout.prescribed_dofs
        supports = Supports(dofs, -(left[0][dofs] + left[1][dofs]))
        end = State(
            self._start.time + step, self._equations.displacement(velocity), velocity,
            self._internal, self._external,
        )  # fmt: skip
        outcome = StepOutcome(
            end, self._slots, self._impulses, supports, self._equations.force_impulse,
            bulk.viscous(self._mean(velocity)), self._sweeps, self._solver_error,
            self._traction_change, iterations, max(self._correction, self._balance.error),
            not failed,
        )  # fmt: skip
        energies, static = np.zeros(NUM_ENERGIES), bulk.inertia is None
        if not (failed or static):
            with self._watch.phase("energy"):
                theta = self._inverses.theta
                energies = own_energies(bulk, self._start, outcome, step, theta)
        failed, *energies = bulk.ranks.sum(np.array([failed, *energies])).tolist()
        if failed:  # matrix and what was learnt may be those of a state gone astray
            bulk.forget()
            if not bulk.linear:
                self._inverses.drop(step)
        # those of a static step hang on what it bore before
        return outcome._replace(converged=not failed, energies=None if static else energies)

    def _mean(self, velocity: np.ndarray) -> np.ndarray:
        """Velocity over the step that ends with `velocity`."""
        return self._theta * velocity + (1.0 - self._theta) * self._start.velocity
