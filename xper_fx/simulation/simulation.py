# SPDX-License-Identifier: LGPL-3.0-or-later
"""Simulation: the time loop. It knows no law and no material by name."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from xper_fx.bulk.state import State, StepOutcome
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.scene.scene import Scene
from xper_fx.simulation.attempt import StepAttempts
from xper_fx.simulation.commit import commit_bodies, commit_interactions, deepest
from xper_fx.simulation.course import Course
from xper_fx.simulation.energy_ledger import BulkEnergies
from xper_fx.simulation.explicit_start import leave_explicit
from xper_fx.simulation.failures import give_up, require_finite, require_small_turns
from xper_fx.simulation.model import Model
from xper_fx.simulation.not_finite import not_finite_columns
from xper_fx.simulation.options import Options
from xper_fx.simulation.requested_accuracy import RequestedAccuracy
from xper_fx.simulation.restartable import Restartable
from xper_fx.simulation.step_record import StepRecord
from xper_fx.support.checks import require_kind, require_number
from xper_fx.support.compiling_note import note_compiling
from xper_fx.support.errors import NotFiniteError
from xper_fx.support.profile import Stopwatch
from xper_fx.support.ranks import Ranks

if TYPE_CHECKING:
    from xper_fx.bulk.explicit import ExplicitScheme
    from xper_fx.bulk.implicit import ImplicitScheme
    from xper_fx.bulk.monolithic_scheme import MonolithicScheme
    from xper_fx.bulk.rigid_only import EmptyScheme
    from xper_fx.nscd.friction import FrictionProblem
    from xper_fx.nscd.interactions import Interactions
    from xper_fx.simulation.path import PathControl
    from xper_fx.simulation.verdict import Verdict

logger = logging.getLogger(__name__)

# Time this small beside the end is rounding.
_ROUNDING = 1e-12


class Simulation(Restartable):
    """Steps a scene through time.

    Args:
        scene: what to simulate.
        step: h (s); 0.7 of the critical step of the explicit bulk if not given; "auto" adapts it.
        scheme: "implicit" or "explicit" bulk; interactions are implicit with both. If not given,
            implicit; with an adapted step, and with initially rigid bonds and no step, explicit
            where each cell is a body that has mass, as waves then go from body to body by sweeps,
            and longer steps need as many more; with an adapted step a linear bulk on which nothing
            acts but loads begins explicit, too (`explicit_start.py`).
        theta: weight of the end of the step, in [1/2, 1]. If not given 1/2, which the explicit bulk
            has; 1 without inertia.
        accuracy: relative error asked for, in (0, 1): step and tolerances that are not given are
            picked and adapted for it (`accuracy_control.py`). 1e-2 if only one of
            them is "auto".
        tolerance: bound on the estimated relative error of the impulses, or on the violation of
            the laws where all contacts are of rigid bodies (`nscd/solvers/nlgs.py`); 1e-3 if not
            given, in static runs 1e-6; "auto" adapts it.
        max_sweeps: sweeps after which the interaction solver gives up.
        solver: of the interactions: "nlgs" (sweeps), "newton" (all points at once, for steps far
            beyond the explicit limit), "accelerated" (mixed sweeps), "subdomains" (conjugate
            gradients, where all points are perfect bonds), "monolithic" (bulk and interactions in
            one system, `bulk/monolithic_scheme.py`), "friction_problem", "interior_point",
            "proximal_point" or "anderson" (those of `FrictionProblem` on the assembled contacts,
            where all are unilateral with Coulomb friction), or "auto", which picks: "monolithic"
            without inertia, where bonds may break or interactions alone hold bodies, and with it
            where bonds are initially rigid, until a step does not converge. An explicit
            bulk with nodal points solves each vertex alone, and takes "auto" only. A `Solver` of
            one's own is taken too, on one rank (`nscd/solvers/solver.py`).
        relaxation: over-relaxation of impulses where a law is linear, in (0, 2).
        newton_tolerance: bound on the last relative Newton correction; with interactions at least
            a hundredth of `tolerance`. 1e-8 if not given, or a thousandth of `accuracy`.
        max_newton: Newton iterations after which a step is given up.
        max_halvings: how often a step that does not converge, in which a material flows by more
            than 5 % strain, in which iterates broke bonds that stay closed, or in which bodies
            would pass through each other unseen, is cut in two.
        forgiving: whether to go on, with a warning and a count at the end, where iterates broke
            bonds that stay closed, for no energy, however often the step was cut; else it raises.
        inertia: False for a static run (theta = 1): bodies without mass, which motions, a
            periodic cell's ties or interactions with bodies that are held must hold, as nothing
            regularises the stiffness.
        healing: whether overlaps that impacts leave are taken back in scenes of rigid bodies alone
            (`healing.py`); False leaves them.
        path: finds the load of a static run, `GrowthControl()` or `DissipationControl(...)`.
        num_threads: threads of the interaction solver; all that Numba has if not given.
        comm: ranks that simulate the scene together, each with the same scene. They divide the
            meshed bodies of scenes, also beside rigid ones, and the contacts of scenes of rigid
            bodies alone where there are enough (`parallel/rigid_partition.py`).
            MPI.COMM_SELF if each rank has a scene of its own.

    Attributes:
        model: the scene, made ready to be stepped; `bulk`, `forms`, `rigid`, `detection`,
            `interactions`, `scheme`, `ledger`, `ranks`, `part` and `bodies` are its.
        team: the ranks of `comm`.
        state: displacement, velocity, time.
        step_number: steps made.
        step_size: h (s) at the start.
        tolerance: of the impulses in the next step.
        last: outcome of the last step, None before the first.
        path: where a run that follows its path is on it; None otherwise.
        macroscopic: Fbar, Pibar and Hill-Mandel's error of a periodic cell; None otherwise.
        stopwatch: profile of the run.
        folder: where a recorder writes, None without one.

    Raises:
        ValueError: a number out of range, options that exclude each other or something in the
            scene.
        TypeError: something of another kind than is expected.
    """

    def __init__(
        self,
        scene: Scene,
        step: float | str | None = None,
        *,
        accuracy: float | None = None,
        scheme: str | None = None,
        theta: float | None = None,
        tolerance: float | str | None = None,
        max_sweeps: int = 20_000,
        relaxation: float = 1.3,
        solver: str | Solver = "auto",
        newton_tolerance: float | None = None,
        max_newton: int = 25,
        max_halvings: int = 6,
        forgiving: bool = False,
        inertia: bool = True,
        healing: bool = True,
        path: PathControl | None = None,
        num_threads: int | None = None,
        comm: MPI.Comm = MPI.COMM_WORLD,
    ):
        require_kind("comm", comm, MPI.Comm)
        requested = RequestedAccuracy.chosen(accuracy, step, tolerance, newton_tolerance, inertia)
        options = Options.checked(
            scene, requested, scheme=scheme, theta=theta, solver=solver,
            solve=SolveOptions(requested.tolerance, max_sweeps, relaxation, num_threads),
            max_newton=max_newton, max_halvings=max_halvings, forgiving=forgiving,
            inertia=inertia, healing=healing, path=path,
        )  # fmt: skip
        note_compiling()
        self._given, self.team = scene, Ranks(comm)
        self.stopwatch = Stopwatch()
        self.folder: Path | None = None
        with self.team.ending_all(), self.stopwatch.phase("set-up"):
            model = Model(scene, options, self.team, self.stopwatch)
        self._take(model)
        self.state, self.step_size, self.step_number = model.start, model.step_size, 0
        self.tolerance = requested.tolerance
        self.last: StepOutcome | None = None
        self.macroscopic = self._macroscopic(None, None, self.step_size)
        self.path = None if path is None else path.follower()
        self._before: State | None = None
        self._last_size = self.step_size
        self._rigid_reactions: np.ndarray | None = None
        self._save = None
        self._course = Course()
        self._judge = None
        if model.control is not None:
            from xper_fx.simulation.verdict import Judge

            self._judge = Judge()
        self._stepping: object = None
        if scene.after is not None:
            from xper_fx.simulation.going_on import go_on

            go_on(self, scene.after)

    def _take(self, model: Model) -> None:
        self.model, self._attempts, self.scene = model, StepAttempts(model), model.scene
        self.ranks, self.part, self.bodies = model.ranks, model.part, model.bodies
        self.bulk, self.forms, self.rigid = model.bulk, model.bulk.forms, model.rigid
        self.detection, self.theta, self.ledger = model.detection, model.scheme.theta, model.ledger

    @property
    def options(self) -> Options:
        """As checked; a step to come can have others (`model.options`)."""
        return self.model.options

    @property
    def solver(self) -> Solver:
        """Solver of the interactions."""
        return self._attempts.solver

    @property
    def interactions(self) -> Interactions | None:
        """The points; others once sweeps have taken over from one system."""
        return self.model.interactions

    @property
    def scheme(self) -> EmptyScheme | ExplicitScheme | ImplicitScheme | MonolithicScheme:
        """The scheme of the bulk."""
        return self.model.scheme

    def steps(self, end_time: float) -> Iterator[StepRecord]:
        """Advance to `end_time` (s), a record after each committed step.

        The last step may go beyond the end: steps of a given size are whole. A run that has done
        so, restarted or not, has no step left to the same end. A path ends at the end.

        Raises:
            ValueError: an end that is not finite, or before the present time and not the one that
                the run has been going to.
            RuntimeError: it is asked for a step after another `steps` has begun.
            ConvergenceError: a step did not converge however often it was cut; NotFiniteError:
                it gave NaN or infinity. The state is that of the last step.
        """
        if not math.isfinite(require_number("end_time", end_time)):
            raise ValueError(f"end_time should be a finite number, got {end_time}.")
        before = end_time < self.state.time - _ROUNDING * abs(self.state.time)
        if before and end_time != self._course.end_time:
            raise ValueError(
                f"end_time {end_time:g} s lies before the present time {self.state.time:g} s."
            )
        self._stepping = this = object()
        advance = self._step_on if self.path is None else self._follow
        try:
            with self.team.ending_all():
                for record in advance(end_time):
                    yield record
                    if self._stepping is not this:
                        raise RuntimeError(
                            f"These steps() to {end_time:g} s were left: others have begun, and "
                            "the simulation has one time. Take one after the other."
                        )
                self._attempts.tell_strain(self.state, self.step_number, self.step_size)
                if self._judge is not None:
                    self._judge.tell(self)
                elif self.scene.bodies is not None:
                    moved = self.state.displacement
                    self._attempts.doubts.tell_balance(self.ledger, moved, self.step_number)
        finally:
            self._attempts.doubts.sum_up()

    def contact_problem(self) -> FrictionProblem:
        """The frictional contact problem of the next step, W assembled; nothing is stepped.

        Its contacts are the closed ones, in the order in which searches find them. With a bulk that
        is not linear it is that of the first iterate. Of several ranks each has the problem of all,
        whose contacts are sorted by law and by what they are known by; all ask together.

        Raises:
            UnsuitableSolverError: interactions of another kind than contact with Coulomb friction,
                a bulk whose vertices are solved alone.
            ValueError: no contact is closed.
        """
        return self._attempts.contact_problem(self.state, self.step_size)

    def verdict(self) -> Verdict | None:
        """What accuracy was asked for, what was reached, what limits it; None if none was."""
        if self.model.control is None:
            return None
        from xper_fx.simulation.verdict import verdict

        return verdict(self)

    @property
    def _stays_explicit(self) -> bool:
        """Whether an explicit bulk was picked for good."""
        options = self.options
        picked = options.scheme_is_picked and options.scheme == "explicit"
        return picked and not self.model.begins_explicit

    def _step_on(self, end_time: float) -> Iterator[StepRecord]:
        """Steps whose times are given or picked."""
        control, time = self.model.control, self.state.time
        course = self._course = self._course.towards(time, end_time, self.step_size)
        fixed = control is None or not control.adapts_step
        if self.team.rank == 0:
            if fixed:
                course.warn_of_units()
            elif self._stays_explicit:
                course.suggest_implicit(time)
        yield from self._advance(end_time)
        while fixed and course.left > 0:
            course.left -= 1
            course.begin(self.step_size)
            yield from self._advance(end_time)
        while not fixed and end_time - self.state.time > _ROUNDING * abs(end_time):
            control = self.model.control
            if self.model.begins_explicit and control.outgrows(end_time):
                leave_explicit(self.model)
                self.state = replace(self.state, external=self.bulk.external(self.time))
            course.begin(control.size(self.state.time, end_time))
            yield from self._advance(end_time)

    def _advance(self, end_time: float) -> Iterator[StepRecord]:
        """The pieces of a step that are left to do; none if it should be shorter."""
        pieces, most = self._course.pieces, self.options.max_halvings
        while pieces:
            self._rebalance()
            size, halvings = pieces.pop()
            control = self.model.control
            last_try, record = halvings >= most, None
            doubling = None if control is None else control.estimate.doubling
            if doubling is not None and doubling.is_due:
                doubling.begin(size, self._twice(size, end_time))
            with self.stopwatch.phase("step"):
                outcome = self._attempts.step(
                    self.state, size, self.tolerance, self.step_number + 1, last_try
                )
                if outcome is not None and outcome.converged:
                    if control is not None and control.waits:
                        touch = self.detection.touches(self.bulk, outcome.state)
                        if touch and control.meet(size, end_time):
                            pieces.clear()
                            return
                    energies = self._bulk_energies(outcome, size)
                    time = self.state.time
                    good = control is None or control.accepts(
                        time, size, energies, outcome, end_time
                    )
                    if not (good or halvings):
                        return
                    record = self._commit(outcome, size, energies)
            if record is not None:
                yield record
            elif last_try:
                if outcome is None or not self._sweep_on():
                    give_up(self, self._attempts, outcome, size)
                self._course.rejoin(size)
            else:
                logger.info(
                    "step %d at h = %.3g s did not converge, or went too far: halved",
                    self.step_number, size,
                )  # fmt: skip
                self._course.cut(size, halvings, self.options.scheme == "explicit")

    def _twice(self, size: float, end_time: float) -> BulkEnergies | None:
        """Energies of a step of twice the size, which is not kept; None if it does not converge."""
        long = 2.0 * size
        if self.state.time + long > end_time:
            return None
        with self.stopwatch.phase("step"), self.stopwatch.phase("doubled step"):
            outcome = self._attempts.probe(self.state, long, self.tolerance)
            if outcome is None or not outcome.converged:
                return None
            return self.ledger.bulk_energies(self.state, outcome, long, None, self.borne)

    def _follow(self, end_time: float) -> Iterator[StepRecord]:
        """Steps along the path until its time is the end time."""
        path, self._course = self.path, Course(end_time, self.step_size)
        while end_time - self.state.time > _ROUNDING * abs(end_time):
            self._rebalance()
            with self.stopwatch.phase("step"):
                outcome, size = self._attempts.along_path(
                    self.state, self._last_size, self.step_size, path, end_time
                )
                if outcome.converged:
                    start, ways = self.state.time, self.scheme.unstable_ways()
                    change = outcome.state.time - start
                    record = self._commit(outcome, size, self._bulk_energies(outcome, size))
                    moved, tells = change - self.scheme.loading.held, self.team.rank == 0
                    path.succeeded(moved, outcome.newton_iterations, start, ways, tells)
            if outcome.converged:
                yield record._replace(size=change)
            elif not path.failed():
                give_up(self, self._attempts, outcome, size)

    def _bulk_energies(self, outcome: StepOutcome, size: float) -> BulkEnergies:
        with self.stopwatch.phase("energy"):
            energies = self.ledger.bulk_energies(
                self.state, outcome, size, self._attempts.rigid_work, self.borne
            )
        if not math.isfinite(sum(energies)):
            require_finite(self, not_finite_columns(energies._asdict()), size)
        return energies

    def _commit(self, outcome: StepOutcome, size: float, energies: BulkEnergies) -> StepRecord:
        attempts, control, number = self._attempts, self.model.control, self.step_number + 1
        require_small_turns(self, attempts.turned_bonds(outcome.state, number, size), size)
        work = commit_interactions(self.model, outcome, size, energies, self.transmitted)
        if not math.isfinite(self.ledger.closure) and (
            wrong := not_finite_columns(self.ledger.as_columns())
        ):
            # the interactions have moved on, so the present state is not one to go on from
            raise NotFiniteError(number, self.time, size, wrong, None)
        if work is not None and self.path is not None:
            cohesion = self.ledger.energies.dissipated_cohesion
            attempts.doubts.tell_passed(work, cohesion, number, size)
        elif work is not None and not self.options.inertia:
            attempts.doubts.tell_snap(work, energies, number, size)
        elif work is not None and self.options.scheme == "implicit":
            share, depth = deepest(self.interactions)
            if self.team.rank == 0:
                attempts.doubts.tell_depth(share, depth, number, size)
        if control is not None:
            snap = 0.0
            if work is not None and work.cohesion > 0.0:
                from xper_fx.nscd.laws.softening import snap_number

                snap = snap_number(self.interactions, self.model.scheme.theta)
            control.learn(size, energies, work, self.ledger.closure, outcome, snap)
            self.tolerance = control.tolerance
        commit_bodies(self.model, outcome, size)
        self._before, self.state = self.state, outcome.state
        self.last, self._last_size = outcome, size
        self._rigid_reactions = attempts.rigid_reactions
        self.macroscopic = self._macroscopic(self._before, outcome, size)
        self.step_number = number
        if self.model.balance is not None:
            from xper_fx.simulation.balance import look_at_balance

            look_at_balance(self, number)
        return StepRecord(
            number, self.state.time, size, outcome.sweeps, outcome.residual,
            outcome.traction_change, outcome.newton_iterations, outcome.newton_residual,
            self.ledger.as_columns(),
        )  # fmt: skip
