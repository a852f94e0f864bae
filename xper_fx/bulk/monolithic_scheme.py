# SPDX-License-Identifier: LGPL-3.0-or-later
"""Theta scheme of bulk and interactions in one system (`coupled_step.py`).

A step is solved by a semismooth Newton method (`semismooth_newton.py`); where that goes in circles,
from the contacts that `augmented_lagrangian.py` finds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from xper_fx.bulk.augmented_lagrangian import find_contacts
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.coupled_matrices import CoupledMatrices
from xper_fx.bulk.coupled_step import CoupledStep
from xper_fx.bulk.loading import Loading
from xper_fx.bulk.semismooth_newton import SemismoothNewton
from xper_fx.bulk.sparse_direct import SingularMatrixError
from xper_fx.bulk.state import State, StepOutcome, Supports
from xper_fx.bulk.step_equations import StepEquations
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch

if TYPE_CHECKING:
    from xper_fx.bulk.breaking_vertices import BreakingVertices
    from xper_fx.nscd.growth import GrowthLimit


# How well contacts are found before Newton's method goes on, beside the largest nodal impulse.
_NEAR = 1e-4
# How well at least, where they are not found.
_ROUGH = 1e-2
# Corrections of a search for contacts along a path, but in its first step: those that find them
# take 4 to 70, and a shorter step costs less than others.
_FEW = 80
# Searches of a step along a path that may be in vain before its attempts do without: those that
# solved a step were its first or second, and of the first step of a path its first.
_VAIN = 3
# What may fail beside Newton's method.
_GOES_BACK = "the state that was found leads back along the path"


# Time (s) and velocities to start from, shape (num_dofs,), and impulses of each group if known.
Guess = tuple[float, np.ndarray] | tuple[float, np.ndarray, Sequence[np.ndarray] | None]
# From which rates of bonds a step begins (`rates.py`): none, those where lips slide on that have
# slid, or those where these may stick.
Rates = Literal["", "sliding", "friction"]


class PointsOfNodes(NamedTuple):
    """Where points find their velocities: as `xper_fx.bulk.body_inverse`, without w on the bulk."""

    nodes: np.ndarray
    num_nodes: int
    blocks: BodyInverse


class MonolithicScheme:
    """Theta scheme of the bulk together with the interactions.

    Args:
        interacting: nodes at which interactions act.
        theta: weight of the end of the step, in [1/2, 1].
        newton_tolerance: bound on what is left, relative to the largest nodal impulse.
        max_newton: iterations after which a step is given up.
        stopwatch: where phases are timed.
        gives_up: whether a step is not converged where Newton's method goes in circles.
        jumps: whether a step may end beyond a snap, as none along a path may.

    Attributes:
        loading: of the last attempt.
        told: whether the last attempt that asked for rates of bonds began from them.
        rub: whether lips had slid under pressure there.
    """

    def __init__(
        self,
        bulk: Bulk,
        interacting: np.ndarray,
        theta: float,
        newton_tolerance: float,
        max_newton: int,
        stopwatch: Stopwatch,
        gives_up: bool = False,
        jumps: bool = True,
    ):
        self.bulk, self.theta = bulk, theta
        self._matrices = CoupledMatrices(bulk, interacting, theta)
        self._tolerance, self._max_newton = newton_tolerance, max_newton
        self._stopwatch, self._gives_up, self._jumps = stopwatch, gives_up, jumps
        self.told = self.rub = False
        self._compliance: tuple[float, np.ndarray, PointsOfNodes] | None = None
        self._vain: tuple[State | None, int] = (None, 0)
        self.loading: Loading
        self._vertices: BreakingVertices | None = None
        stopwatch.owns("coupled system", lambda: self.nbytes)

    def inverse(self, step: float, displacement: np.ndarray) -> PointsOfNodes:
        """The nodes of the points, and compliances for a step size by which branches are told."""
        if self._compliance is None or self._compliance[0] != step:
            diagonal = self._matrices.of_bulk(step, displacement).diagonal()
            free = ~self.bulk.layout.prescribed
            compliance = np.zeros(len(diagonal))
            np.divide(1.0, np.abs(diagonal), out=compliance, where=free & (diagonal != 0.0))
            self._take(step, compliance)
        return self._compliance[2]

    def _take(self, step: float, compliance: np.ndarray) -> None:
        """Take the compliance of each unknown for a step size, shape (num_dofs,), m/s per N s."""
        nodes = self._matrices.nodes
        blocks = BodyInverse.of_nodes(compliance.reshape(-1, self.bulk.dim)[nodes], self.bulk.dim)
        found = PointsOfNodes(nodes, len(self.bulk.layout.nodes), blocks)
        self._compliance = step, compliance, found

    def attempt(
        self,
        state: State,
        step: float,
        interactions: Interactions | None,
        solver: Solver,
        options: SolveOptions,
        growth: GrowthLimit | None = None,
        guess: Guess | None = None,
        onwards: Rates = "",
    ) -> StepOutcome:
        """One step from `state`, which is not changed; see `ImplicitScheme.attempt`.

        With a `growth` the time at which the step ends, and so the load, is found from it; `step`
        is then the time by which velocities are defined.

        Args:
            state, step, interactions, solver, options: as of `ImplicitScheme.attempt`.
            growth: what the step may open, None where its end is given.
            guess: time (s) and velocities to start from, shape (num_dofs,).
            onwards: the rates to start from, with a `growth`.
        """
        if interactions is not None and interactions.fused is not None:
            return self._while_vertices_split(state, step, interactions, options.last_try)
        return self._attempt(state, step, interactions, growth, guess, options.last_try, onwards)[0]

    def _while_vertices_split(
        self, state: State, step: float, interactions: Interactions, last_try: bool
    ) -> StepOutcome:
        """One step, made again with those vertices split that turn out not to bear it."""
        from xper_fx.bulk.breaking_vertices import BreakingVertices

        if self._vertices is None:
            self._vertices = BreakingVertices(self._matrices, interactions)
        vertices = self._vertices
        while True:
            vertices.begin(state, step, self.theta)
            outcome, coupled = self._attempt(state, step, interactions, None, None, last_try)
            if not outcome.converged:
                return outcome
            transmitted = self._matrices.shared.transmitted(coupled.residual + coupled.impulses)
            if not vertices.split(transmitted, state):
                dofs, reactions = outcome.supports
                return outcome._replace(
                    impulses=outcome.impulses + transmitted,
                    supports=Supports(dofs, reactions - transmitted[dofs]),
                )

    def _attempt(
        self,
        state: State,
        step: float,
        interactions: Interactions | None,
        growth: GrowthLimit | None,
        guess: Guess | None,
        last_try: bool,
        onwards: Rates = "",
    ) -> tuple[StepOutcome, CoupledStep]:
        """As `attempt`, with the points there are; with the state of the step's unknowns."""
        bulk, watch, weight = self.bulk, self._stopwatch, self._matrices.weight
        bulk.forms.set_step(step)
        equations = StepEquations(bulk, state, step, weight)
        rigid = None if interactions is None else interactions.driven
        self.loading = loading = Loading(bulk, equations, state, step, self.theta, rigid)
        if growth is not None:
            loading.set(state.time)
        if interactions is not None:
            with watch.phase("interaction terms"):
                blocks = self.inverse(step, state.displacement).blocks
                if interactions.bulk_inverse is not blocks:
                    interactions.update_inverse(blocks)
        coupled = CoupledStep(
            self._matrices, equations, loading, interactions, state, step, growth, watch
        )
        coupled.may_jump &= self._jumps
        newton = SemismoothNewton(coupled)

        def begin(guess: Guess | None = guess) -> None:
            if interactions is not None:
                with watch.phase("interaction terms"):
                    coupled.velocity = coupled.start
                    coupled.turn()
                    interactions.begin_step(step, self.theta)
            coupled.restart()
            if guess is not None:
                newton.start_from(*guess)
                if coupled.flipped:  # it leads too far
                    begin(None)

        if onwards:
            begin(None)
            try:
                guess, self.rub = coupled.onwards(onwards == "friction")
            except SingularMatrixError:
                guess, self.rub = None, False
            self.told = guess is not None
        converged = False
        for start in _starts(coupled, guess):
            begin(start)
            converged = self._solve(coupled, newton)
            if converged:
                break
        # along a path another attempt begins from rest, from which contacts are found as well
        again = growth is not None and guess is not None
        if not (converged or self._gives_up or interactions is None or again):
            begins = growth is not None and growth.begins
            vain = self._vain[1] if self._vain[0] is state else 0
            if self._jumps or vain < (1 if begins else _VAIN):
                converged = self._from_contacts(coupled, newton, begin, begins)
                self._vain = state, vain + (not converged)
            if not converged and last_try and coupled.may_jump and coupled.softens:
                coupled.descends = True
                converged = self._from_contacts(coupled, newton, begin, begins)
        velocity, impulses = coupled.velocity, coupled.impulses
        dofs = bulk.layout.prescribed_dofs
        supports = Supports(dofs, -(coupled.residual[dofs] + coupled.impulses[dofs]))
        end = State(
            loading.time, equations.displacement(velocity), velocity, coupled.internal,
            loading.external,
        )  # fmt: skip
        mean = weight * velocity + (1.0 - weight) * state.velocity
        outcome = StepOutcome(
            end, coupled.slots, impulses, supports, equations.force_impulse, bulk.viscous(mean), 0,
            newton.left, 0.0, coupled.corrections, newton.left, converged, failure=newton.failure,
        )  # fmt: skip
        return outcome, coupled

    def _from_contacts(
        self, coupled: CoupledStep, newton: SemismoothNewton, begin: Callable[[], None], first: bool
    ) -> bool:
        """Whether the step was solved from contacts that are found first.

        Where a shorter step has a state near by, the method of multipliers finds them first, which
        goes on from the last ones; an interior point forgets these.

        Args:
            coupled, newton: of the step.
            begin: takes the step to its start.
            first: whether it is the first of a path.
        """

        def inside() -> bool:
            if coupled.growth is not None or coupled.softens:
                return False
            from xper_fx.bulk.interior_contacts import find_contacts_inside

            for _ in find_contacts_inside(coupled, begin):
                coupled.contacts_known = True
                if self._solve(coupled, newton):
                    return True
            return False

        def by_multipliers() -> bool:
            most = np.inf if first or self._jumps else _FEW
            for good in (_NEAR, self._tolerance):
                time = coupled.state.time + (0.0 if coupled.growth is not None else coupled.step)
                coupled.loading.set(time)
                begin()
                change = find_contacts(coupled, good, most)
                if change > _ROUGH:
                    break
                if self._solve(coupled, newton):
                    return True
                if change > good:
                    break
            return False

        ways = (inside, by_multipliers) if coupled.may_jump else (by_multipliers, inside)
        return any(find() for find in ways)

    def _solve(self, coupled: CoupledStep, newton: SemismoothNewton) -> bool:
        """Whether the step was solved."""
        if newton.run(self._tolerance, self._max_newton) and not coupled.goes_on:
            newton.failure = _GOES_BACK
        return not newton.failure

    def unstable_ways(self) -> int:
        """As of `CoupledMatrices`."""
        return self._matrices.unstable_ways()

    @property
    def nbytes(self) -> int:
        """Memory held, factors apart, in bytes."""
        vertices = 0 if self._vertices is None else self._vertices.nbytes
        return self._matrices.nbytes + vertices

    def holds(self, step: float) -> bool:
        """As of `ImplicitScheme`: matrices are made anew from the state."""
        return step > 0.0

    def saved(self) -> dict:
        """The compliances of a bulk that is not linear, which are those of the state they met."""
        if self.bulk.linear or self._compliance is None:
            return {}
        step, compliance, _ = self._compliance
        return {"compliance": self.bulk.unknowns.by_cell(compliance) | {"step": step}}

    def restore(self, saved: Mapping) -> None:
        """Take what `saved` gave; other solvers keep none."""
        if kept := saved.get("compliance"):
            self._take(kept["step"], self.bulk.unknowns.from_cells(kept))


def _starts(coupled: CoupledStep, guess: Guess | None) -> list[Guess | None]:
    """Where the iterations of a step begin, one after another until one of them converges.

    A static step begins from rest. That bends bodies that turn where they are driven, and lets lips
    stick that slide on. Where the load has gone on as before, the last step's velocities are near.
    """
    if guess is not None or not coupled.may_jump:
        return [guess]
    last = coupled.loading.time, coupled.state.velocity
    if coupled.turns:
        return [last, None]
    return [None] if coupled.softens else [None, last]
