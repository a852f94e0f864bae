# SPDX-License-Identifier: LGPL-3.0-or-later
"""One attempt at a step: contacts are found, bulk and interactions solved; nothing is committed."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.bulk.slopes import largest_slope
from xper_fx.bulk.stable_step import UnstableStepError
from xper_fx.bulk.state import State, StepOutcome
from xper_fx.nscd import solvers
from xper_fx.nscd.point_values import BROKEN
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, UnsuitableSolverError
from xper_fx.nscd.stepped_points import FacetFlippedError
from xper_fx.simulation.advice import (
    AT_POINTS,
    CONTRADICTORY,
    FOR_NOTHING,
    LOADS_TURN,
    OF_BULK,
    OF_FRICTION,
    OF_ONE_SOLVER,
    ON_PATH,
    UNDER_LOAD,
    comes_loose,
    contested,
    flipped,
)
from xper_fx.simulation.doubts import (
    BROKEN_FOR_NOTHING,
    OVERLAP,
    STRAINED,
    STRAYED,
    TURNED,
    UNSEEN,
    Doubts,
)
from xper_fx.simulation.model import Model
from xper_fx.simulation.options import SOLVERS
from xper_fx.simulation.turned_bonds import FEW, TurnedBonds

if TYPE_CHECKING:
    from xper_fx.nscd.friction import FrictionProblem
    from xper_fx.nscd.rigid.motion import Prediction, RigidWork
    from xper_fx.simulation.path import PathFollower

logger = logging.getLogger(__name__)

# Solvers between which "auto" changes.
_ONE_WAY = ("nlgs", "accelerated", "newton")
# Inelastic strain of a step above which the step is cut.
_LARGEST_FLOW = 0.05
# An attempt whose iterates run away is rejected, as it does not converge: NumPy need not warn.
_RUNS_AWAY = {"over": "ignore", "invalid": "ignore"}
# Damage beyond what the opening found asks for, above which the step is cut: it came from iterates
# on the way, and would cost no energy.
_LARGEST_EXCESS = 0.1
# Stretch or turn of a cell (rad) above which small strain is doubted.
_LARGEST_SLOPE = 0.2
# Explicit steps after which bonds are looked at that should not turn.
_LOOKS_EVERY = 40
# Share of the sweeps allowed after which contacts that ranks divide are left to other solvers.
_SWEEPS_TOGETHER = 0.1


class StepAttempts:
    """Attempts at the steps of a model.

    Args:
        model: what is stepped.

    Attributes:
        solver: of the interactions.
        doubts: about the steps that were taken.
        breaks_for_nothing: whether bonds broke in the last attempt whose openings it does not have.
        rigid_work: of the last attempt, None without rigid bodies.
        rigid_reactions: impulses that drive or hold rigid bodies in the last attempt, None without
            driven ones.
    """

    def __init__(self, model: Model):
        self._model, self._watch = model, model.stopwatch
        self.solver = _solver(model)
        self.doubts, self.breaks_for_nothing = Doubts(), False
        self._error: FloatingPointError | None = None
        self.rigid_work: RigidWork | None = None
        self.rigid_reactions: np.ndarray | None = None
        bodies = model.scene.rigid_bodies
        self._some_driven = bodies is not None and bool(bodies.is_prescribed.any())

    def step(
        self, state: State, size: float, tolerance: float, number: int, last_try: bool
    ) -> StepOutcome | None:
        """One step.

        Args:
            state: at its start, which is not changed.
            size: h (s).
            tolerance: of the interaction solver.
            number: of the step, for warnings.
            last_try: whether the step cannot be cut.

        Returns:
            The outcome, converged or not; None if the step goes too far and can be cut, or if a
            rigid body spins too fast for it.
        """
        model, self.breaks_for_nothing = self._model, False
        outrun = self._outruns_contacts(state, size)
        if outrun and not last_try:
            return None
        self._error = None
        try:
            outcome = self._attempt(state, size, tolerance, last_try)
        except FloatingPointError as error:
            self._note(error)
            return None
        if outcome is None:
            return None
        if outrun:
            self.doubts.tell(UNSEEN, number, size)
        if number == 1 and model.detection is not None:
            if deepest := model.detection.overlap(model.interactions, state, model.rigid, size):
                self.doubts.tell(OVERLAP, number, size, f": by {deepest:.3g} m")
        if not outcome.converged:
            return outcome
        points = model.interactions
        self.breaks_for_nothing = points is not None and points.too_far > _LARGEST_EXCESS
        if not last_try and (self.breaks_for_nothing or self._flows_too_far(outcome)):
            return None
        if self.breaks_for_nothing:
            if not model.options.forgiving:
                return outcome._replace(converged=False)
            self.doubts.tell(BROKEN_FOR_NOTHING, number, size)
        return outcome

    def probe(self, state: State, size: float, tolerance: float) -> StepOutcome | None:
        """A step that is not kept, whatever it does; see `_attempt`."""
        try:
            return self._attempt(state, size, tolerance)
        except FloatingPointError:
            return None

    def contact_problem(self, state: State, size: float) -> FrictionProblem:
        """The contacts of a step as its solver would be given them (`Simulation.contact_problem`).

        Args:
            state: at the start of the step.
            size: h (s).
        """
        from xper_fx.nscd.solvers.contact_problem import CapturedContacts

        model, own, captured = self._model, self.solver, CapturedContacts()
        if model.by_vertex or model.monolithic:
            raise UnsuitableSolverError(
                "A contact problem is assembled of an implicit bulk with inertia or of rigid "
                "bodies."
            )
        if model.interactions is not None:
            self.solver = captured
            try:
                self.probe(state, size, model.options.solve.tolerance)
            finally:
                self.solver = own
        if captured.problem is None:
            raise ValueError(f"No contact is closed in the step from t = {state.time:g} s.")
        return captured.problem

    @np.errstate(**_RUNS_AWAY)
    def along_path(
        self, state: State, last_size: float, size: float, path: PathFollower, end_time: float
    ) -> tuple[StepOutcome, float]:
        """A static step whose load is found (`path_step.py`).

        Args:
            state: at its start, which is not changed.
            last_size: time by which its velocities are defined (s).
            size: time by which those of the outcome are (s).
            path: where the run is on its path.
            end_time: at which the path ends (s).

        Returns:
            The outcome, converged or not, and the time by which its velocities are defined (s).
        """
        from xper_fx.simulation.path_step import PathStep

        model, rigid, theta = self._model, self._model.rigid, self._model.scheme.theta
        longest, prediction = path.longest(state.time, end_time), None
        if rigid is not None:
            if model.detection is not None:
                longest = rigid.time_within(model.detection.reach, state.time, longest)
            way = rigid.velocities(1.0, state.time, state.time + longest)
            prediction = rigid.predict(size, theta, state.time)._replace(way=way)
        self._find_contacts(state, size, prediction)
        outcome, size = PathStep(
            model.scheme, model.interactions, self.solver, model.options.solve,
            path, state, last_size, (end_time, longest),
        ).attempt(size)  # fmt: skip
        if rigid is not None:
            rigid.predict(size, theta, state.time)  # of the size that was taken
            self._end_rigid(outcome)
        return outcome, size

    def advice(
        self, residual: float, newton: float, tolerance: float, path: PathFollower | None
    ) -> tuple[str, ...]:
        """What may help after the last attempt, which did not converge; empty if nothing is known.

        Args:
            residual, newton: that the interactions and the bulk left.
            tolerance: of the interactions.
            path: where the run is on its path, if it follows one.
        """
        options = self._model.options
        if isinstance(self._error, FacetFlippedError):
            return (flipped(self._model.points.place(self._error.point)),)
        if isinstance(self._error, UnstableStepError):
            return (str(self._error),)
        if self.breaks_for_nothing:
            return (FOR_NOTHING,)
        if path is not None:
            return (self._along(path),)
        if self._model.monolithic:
            return () if options.inertia else (self._loose_fragment() or self._under_load(),)
        if not options.inertia and self._model.interactions is not None:
            return (AT_POINTS,)
        if residual <= tolerance < np.inf:
            bulk = newton > options.requested.newton_tolerance
            return (OF_BULK if bulk else CONTRADICTORY,)
        return (OF_ONE_SOLVER,) if options.solver in _ONE_WAY else ()

    def _under_load(self) -> str:
        """What may help where a static step has no equilibrium near the last one."""
        points = self._model.interactions
        laws = [] if points is None else [law.kernels(points.dim) for law in points.laws]
        breaks = any(law.growth is not None or law.rigid is not None for law in laws)
        return UNDER_LOAD if breaks or not laws else OF_FRICTION

    def _along(self, path: PathFollower) -> str:
        """What may help where no step along a path converges."""
        if path.loads_turn:
            return LOADS_TURN
        bond = path.contested
        place = np.full(1, np.nan) if bond is None else self._model.points.place(bond)
        return ON_PATH if np.isnan(place).any() else contested(place)

    def _loose_fragment(self) -> str:
        """What is told of a fragment that no bond holds any more; empty if there is none.

        What contact alone joins from the start is no fragment; nothing comes loose from a lattice.
        """
        points, bulk = self._model.interactions, self._model.bulk
        if points is None or self._model.scene.lattice is not None:
            return ""
        pairs = self._model.points.bodies_of_own_points()
        bonds = np.array(["damage" in law.kernels(points.dim).state_names for law in points.laws])
        broken = bonds[points.local("law").astype(int)] & (points.local("spent") >= BROKEN)
        bodies, _, place = bulk.loose_bodies(pairs[~broken[: len(pairs)]])
        return comes_loose(bodies, place) if len(bodies) else ""

    def turned_bonds(self, state: State, number: int, size: float) -> TurnedBonds | None:
        """The bonds that have turned beyond what small strain bears, if they are not few.

        Few are told. Steps of an explicit bulk are too short for each to be looked at.

        Args:
            state: at the end of a step.
            number: of the step.
            size: h (s).
        """
        model = self._model
        if model.options.scheme == "explicit" and number % _LOOKS_EVERY:
            return None
        if model.bond_turns is None:
            points = model.interactions
            if model.detection is None and points is not None and points.turns:
                if points.num_strayed():
                    self.doubts.tell(STRAYED, number, size)
            return None
        displacement = model.bulk.unknowns.expand(state.displacement)
        bonds = model.bond_turns.beyond(model.interactions, displacement)
        if bonds is not None and (model.options.forgiving or bonds.share <= FEW):
            self.doubts.tell(TURNED, number, size)
            return None
        return bonds

    def tell_strain(self, state: State, number: int, size: float) -> None:
        """Doubt a static run at small strain whose cells stretch or turn too far.

        Args:
            state: at the end of the run.
            number, size: of its last step (s).
        """
        bulk = self._model.bulk
        if self._model.options.inertia or bulk.forms.finite_strain or not number:
            return
        if (slope := largest_slope(bulk, state.displacement)) > _LARGEST_SLOPE:
            self.doubts.tell(STRAINED, number, size, f": by {slope:.2g}")

    @np.errstate(**_RUNS_AWAY)
    def _attempt(
        self, state: State, size: float, tolerance: float, last_try: bool = False
    ) -> StepOutcome | None:
        """One step with the rigid bodies; None if one of them spins too fast for it."""
        rigid, interactions = self._model.rigid, self._model.interactions
        options = self._model.options.solve
        if last_try or tolerance != options.tolerance:
            options = replace(options, tolerance=tolerance, last_try=last_try)
        if rigid is None:
            return self._interact(state, size, options, None)
        try:
            with self._watch.phase("rigid bodies"):
                prediction = rigid.predict(size, self._model.scheme.theta, state.time)
                interactions.take_rigid(prediction.start, prediction.free)
            outcome = self._interact(state, size, options, prediction)
            self._end_rigid(outcome)
        except FloatingPointError as error:
            self._note(error)
            return None
        return outcome

    def _end_rigid(self, outcome: StepOutcome) -> None:
        """Rigid bodies move on as a step says, and what drives them is told."""
        rigid, interactions = self._model.rigid, self._model.interactions
        with self._watch.phase("rigid bodies"):
            rigid.end(interactions.rigid_part(outcome.slots))
            pushed = interactions.rigid_impulses()
            self.rigid_work = rigid.work(pushed)
            if self._some_driven:
                self.rigid_reactions = rigid.reactions(pushed)

    def _note(self, error: FloatingPointError) -> None:
        logger.info("%s", error)
        self._error = error

    def _interact(
        self, state: State, size: float, options: SolveOptions, prediction: Prediction | None
    ) -> StepOutcome:
        """One step with the contacts found in its middle."""
        model = self._model
        self._find_contacts(state, size, prediction)
        divided = model.division is not None and model.division.halo is not None
        if divided and self.solver.name not in ("auto", "nlgs"):
            # other solvers want all contacts on each rank
            model.detection.join()
            return self._interact(state, size, options, prediction)
        solver = solvers.DistributedSweeps() if divided else self.solver
        if model.joints is not None:
            solver = model.joints.around(solver, model.rigid)
        if not divided:
            outcome = model.scheme.attempt(state, size, model.interactions, solver, options)
            if outcome.converged or not (model.monolithic and model.options.may_leave_one_system):
                return outcome
            logger.info("%s: sweeps go on from t = %g s", outcome.failure, state.time)
            model.leave_one_system()
            return model.scheme.attempt(state, size, model.interactions, solver, options)
        if self.solver.name == "nlgs":
            return model.scheme.attempt(state, size, model.interactions, solver, options)
        few = replace(options, max_sweeps=math.ceil(_SWEEPS_TOGETHER * options.max_sweeps))
        outcome = model.scheme.attempt(state, size, model.interactions, solver, few)
        if outcome.converged:
            return outcome
        model.detection.join()
        return self._interact(state, size, options, prediction)

    def _find_contacts(self, state: State, size: float, prediction: Prediction | None) -> None:
        model = self._model
        if model.detection is not None:
            with self._watch.phase("contact search"):
                model.detection.renew(
                    model.interactions, model.slot_nodes, model.bulk, state, prediction, size,
                    model.scheme.theta,
                )  # fmt: skip
        if model.joints is not None:
            with self._watch.phase("joints"):
                model.joints.renew(model.interactions, prediction, size, model.scheme.theta)

    def _outruns_contacts(self, state: State, size: float) -> bool:
        """Whether bodies move so far in a step that their contacts would be missed."""
        detection = self._model.detection
        return detection is not None and detection.outrun(state, self._model.rigid, size)

    def _flows_too_far(self, outcome: StepOutcome) -> bool:
        """Whether a material flows by more in the step than its time integration bears."""
        bulk, ranks = self._model.bulk, self._model.ranks
        if not bulk.forms.flows:
            return False
        with self._watch.phase("flow check"):
            displacement = bulk.unknowns.expand(outcome.state.displacement)
            return ranks.max(bulk.forms.largest_increment(displacement)) > _LARGEST_FLOW


def _solver(model: Model) -> Solver:
    """The solver that was asked for, or the one of vertices that are solved alone."""
    splits = model.interactions is not None and model.interactions.fused is not None
    if splits and model.by_vertex and model.part is None:
        from xper_fx.nscd.splitting.splitting_vertices import SplittingVertices

        return SplittingVertices()
    if model.by_vertex:
        return solvers.VertexBlocks() if model.part is None else solvers.DistributedSweeps()
    asked = model.options.solver
    return asked if isinstance(asked, Solver) else getattr(solvers, SOLVERS[asked])()
