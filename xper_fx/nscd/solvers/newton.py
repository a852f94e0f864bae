# SPDX-License-Identifier: LGPL-3.0-or-later
"""Semismooth Newton on all interaction points at once, with a safeguard.

Where Gauss-Seidel sweeps hand a change on from a body to the next, and so need more of them the
finer the mesh and the larger the step, Newton solves the linearised problem of all points
(`tangent.py`): the number of its steps is that of the changes of branch (open, stick, slip).

**Safeguard.** Bare Newton cycles once bonds are broken: a few points that open, close or turn their
slip more than their tangent says undo the gain of all others. A step is accepted if what is left,
|S(b) - r| / |r| over all points, falls; else it is halved, and the rest of it is the first guess of
the next linear problem. Where no length helps a quarter of it is taken, a few times at most; after
that, or where many steps gain little, sweeps go on from the best impulses found for a batch, twice
as long each time: the user is never left with less than sweeps give. Where points are many and all
laws allow it, the first attempt is short, and an interior point follows, which has no branches
(`central_path.py`); the sweeps after it judge what it found. Where springs do not hold most of the
motion, as many points are open or slide, and impulses are known from the step before, the attempt
is left out: it would lead to a poorer start.

**When it stops.** The last step dr reduced the residual by R: |dr| / |R| tells the error that a
residual stands for, and the error so estimated is what `tolerance` bounds, as in `nlgs.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from xper_fx.nscd.algebra.krylov import norm
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.linearised import Linearised
from xper_fx.nscd.solvers.nlgs import NonlinearGaussSeidel
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.nscd.solvers.sweeps import ROUNDING, RUNAWAY
from xper_fx.nscd.solvers.tangent import LinearisedProblem, residual

# Sweeps before the first Newton step: they settle what is open and what is closed.
_BATCH = 10
# Residual of a linear problem, relative to the nonlinear one's: at first, and after good progress.
_FORCING, _TIGHT, _GOOD = 0.1, 0.02, 0.1
# Iterations of a linear problem after which its step is taken as it is.
_MAX_ITERATIONS = 200
# Halvings of a step, and the fraction by which the residual has to fall.
_HALVINGS, _DECREASE = 8, 1e-3
# Growth of the residual that the first step after sweeps may bring: what sweeps leave is smooth,
# and small beside the error that it stands for.
_LEAP = 10.0
# Fraction of a step taken all the same where no length helps, and how often.
_BLIND, _BLIND_STEPS = 0.25, 5
# Steps that should at least halve the residual: before an interior point is tried, and else.
_SHORT_PATIENCE, _PATIENCE = 3, 8
# Points from which on an interior point is tried: few take less time by sweeps.
_MANY = 10_000
# Change of the impulses by a sweep, relative, below which they are known from the step before:
# what grows from nothing grows by 1/n at the n-th sweep. Share of the motion at points that springs
# hold, below which so many points open or slide that Newton's method goes in circles.
_KNOWN, _HELD = 0.01, 0.9


class _Attempt:
    """Newton steps from a state of the impulses until they converge or gain no more."""

    def __init__(self, interactions: Interactions, velocity: np.ndarray, problem):
        self.interactions, self.velocity = interactions, velocity
        self.problem: LinearisedProblem = problem
        self.steps = self.iterations = 0
        self.traction = self.error = np.inf
        self._before = [np.empty_like(g.impulse) for g in interactions.groups]
        self._best = [g.impulse.copy() for g in interactions.groups]
        self._least, self._left_over, self._floor = np.inf, _BLIND_STEPS, 0.0
        self._first = self._now = 0.0  # |r|
        self._start, self._push, self._guess = np.zeros((3, len(velocity)))

    def run(self, tolerance: float, patience: int, has_path: bool = False) -> bool:
        """Whether the estimated error came within the tolerance, internal variables at rest.

        Args:
            tolerance: bound on the estimated error.
            patience: steps that should at least halve the residual.
            has_path: whether an interior point is there for what Newton's method goes in circles
                at.
        """
        amplification = np.inf
        self._floor = self.interactions.rounding(self.velocity) / tolerance
        forcing = _FORCING
        size, relative, self.traction = self._residual()
        history = [relative]
        while np.isfinite(size):
            self.error = relative * amplification if relative > ROUNDING else relative
            if self.error <= tolerance:
                if self._now > RUNAWAY * self._first:
                    return False
                if self.interactions.evolve(self.velocity) <= tolerance:
                    return True
                size, relative, self.traction = self._residual()
                history = [relative]
            if len(history) > patience and relative > 0.5 * history[-1 - patience]:
                return False
            self.problem.linearise(self.velocity)
            if not self.problem.solvable or (
                has_path and self.steps == 0 and relative < _KNOWN and self.problem.held < _HELD
            ):
                return False
            changes, iterations = self.problem.solve(self._guess, forcing * size, _MAX_ITERATIONS)
            self.steps, self.iterations = self.steps + 1, self.iterations + iterations
            squares = sum(norm(c.reshape(-1)) ** 2 for c in changes)
            length = np.sqrt(self.interactions.total(squares))
            fraction, reached = self._advance(changes, size, relative)
            if fraction == 0.0:
                return False
            amplification = max(1.0, length / size)
            self._guess *= 1.0 - fraction
            forcing = _TIGHT if reached[1] < _GOOD * relative else _FORCING
            size, relative, self.traction = reached
            history.append(relative)
            self._keep_best(relative)
        return False

    def _residual(self) -> tuple[float, float, float]:
        """|S(b) - r|, the same relative to |r|, and as a traction."""
        size, impulse, traction = residual(self.interactions, self.velocity)
        impulse = self._now = max(impulse, self._floor)
        self._first = self._first or impulse
        return size, size / impulse if impulse > 0.0 else size, traction

    def _advance(self, changes: list[np.ndarray], size: float, relative: float):
        """Go along dr as far as |S(b) - r| falls; the fraction of it, and the residual there.

        Relative to |r| it would fall too along what impulses leave undetermined, as perfect bonds
        around a vertex do, and impulses would grow without bound.
        """
        groups = self.interactions.groups
        before, start, push = self._before, self._start, self._push
        start[:] = self.velocity
        for g, old, change in zip(groups, before, changes, strict=True):
            old[:] = g.impulse
            g.impulse[:] = change
        push[:] = 0.0
        self.interactions.add_velocity(push)

        def go(fraction: float) -> tuple[float, float, float]:
            for g, old, change in zip(groups, before, changes, strict=True):
                np.multiply(change, fraction, out=g.impulse)
                g.impulse += old
            np.multiply(push, fraction, out=self.velocity)
            self.velocity += start
            return self._residual()

        fraction = 1.0
        for _ in range(_HALVINGS):
            reached = go(fraction)
            if reached[0] < (1.0 - _DECREASE) * size or (
                self.steps == 1 and reached[1] < _LEAP * relative and reached[0] < _LEAP * size
            ):
                return fraction, reached
            fraction *= 0.5
        if self._left_over > 0:
            self._left_over -= 1
            return _BLIND, go(_BLIND)
        return 0.0, go(0.0)

    def _keep_best(self, relative: float) -> None:
        if relative < self._least:
            self._least = relative
            for kept, g in zip(self._best, self.interactions.groups, strict=True):
                kept[:] = g.impulse

    def restore(self) -> None:
        """Put back the impulses that left least; velocities are then the caller's to renew."""
        for kept, g in zip(self._best, self.interactions.groups, strict=True):
            g.impulse[:] = kept


class NewtonOnAllPoints(Solver):
    """Newton on all points at once, with sweeps where it does not help."""

    name = "newton"

    def __init__(self) -> None:
        self.linearised = Linearised()
        self._sweeps = NonlinearGaussSeidel()

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        free = velocity.copy()
        tolerance, max_sweeps = options.tolerance, options.max_sweeps
        sweeps = steps = iterations = failures = interior = 0
        batch = _BATCH
        # an interior point is for one rank
        has_path = interactions.halo is None and sum(map(len, interactions.groups)) >= _MANY
        has_path = has_path and all(g.kernels.coulomb is not None for g in interactions.groups)
        while True:
            velocity[:] = free
            report = self._sweeps.solve(
                interactions, velocity, replace(options, max_sweeps=min(batch, max_sweeps - sweeps))
            )
            sweeps += report.sweeps
            converged, error, traction = report.converged, report.residual, report.traction_change
            finite = interactions.everywhere(np.all(np.isfinite(velocity)))
            if converged or sweeps >= max_sweeps or not finite:
                break
            problem = self.linearised.problem(interactions)
            if not problem.regular:
                batch = max_sweeps
                continue
            if steps == 0:
                problem.begin()
            path_next = has_path and failures == 0
            patience = _SHORT_PATIENCE if path_next else _PATIENCE
            attempt = _Attempt(interactions, velocity, problem)
            converged = attempt.run(tolerance, patience, path_next)
            steps, iterations = steps + attempt.steps, iterations + attempt.iterations
            if converged:
                error, traction = attempt.error, attempt.traction
                break
            attempt.restore()
            failures += 1
            if path_next:
                from xper_fx.nscd.solvers.central_path import follow_path

                interior = follow_path(interactions, free, problem, tolerance)
            batch *= 2
        reason = f"{steps} Newton steps, {iterations} iterations, {failures} times back to sweeps"
        if interior:
            reason += f", {interior} of an interior point"
        return SolveReport(converged, sweeps, error, traction, "newton", reason)

    def kept(self) -> list[object]:
        """The linearised problem."""
        return self.linearised.kept()

    def saved(self, interactions: Interactions) -> dict[str, dict[str, np.ndarray]]:
        """What the linearised problem keeps."""
        return self.linearised.saved(interactions)

    def restore(self, interactions: Interactions, saved: Mapping[str, Mapping]) -> None:
        """Take what `saved` gave."""
        self.linearised.restore(interactions, saved)
