# SPDX-License-Identifier: LGPL-3.0-or-later
"""Simulation: the time loop. It knows no law and no material by name."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.scheme import Solver, State, StepOutcome
from xper_fx.energy import BulkEnergies, EnergyLedger
from xper_fx.errors import ConvergenceError, NotFiniteError
from xper_fx.forms.dynamics import BulkForms
from xper_fx.forms.loads import PrescribedDisplacement, PrescribedVelocity
from xper_fx.knobs import Knobs
from xper_fx.not_finite import not_finite_columns, source_of_not_finite
from xper_fx.nscd.checks import require_count, require_number
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.solve_report import SolveReport
from xper_fx.parallel.ranks import ALONE, Ranks
from xper_fx.profile import Stopwatch
from xper_fx.scene import Load, Scene
from xper_fx.scene_points import ScenePoints

if TYPE_CHECKING:
    from xper_fx.accuracy import AccuracyControl
    from xper_fx.bulk.empty import EmptyScheme
    from xper_fx.bulk.explicit import ExplicitScheme
    from xper_fx.bulk.implicit import ImplicitScheme
    from xper_fx.detection import Detection
    from xper_fx.nscd.rigid.motion import Prediction, RigidMotion, RigidWork
    from xper_fx.parallel.rigid_division import RigidDivision
    from xper_fx.periodic.averages import Macroscopic

logger = logging.getLogger(__name__)

# Solvers of the interactions: modules of `nscd`, imported when asked for.
SOLVERS = ("auto", "nlgs", "newton", "accelerated", "subdomains")
# Those of ranks that divide the bodies.
_ON_RANKS = ("auto", "nlgs", "newton", "accelerated")
# Those of their modules that keep something of a step for the next.
_WITH_MEMORY = ("linearised", "vertex_blocks")
# Steps as shares of the critical one: without a wish, and where an explicit bulk, linear so that
# its critical step stays what it is, should be as cheap as it can.
_BELOW_LIMIT, _AT_LIMIT = 0.7, 0.95
# An adapted step with inertia stays below this multiple of the first: rounding leaves the mass.
_LARGEST_GROWTH = 1e5
# Steps of a picked explicit bulk above which a user is told that an implicit one may be cheaper.
_MANY_STEPS = 100_000
# Inelastic strain of a step above which the step is cut.
_LARGEST_FLOW = 0.05
# Damage beyond what the opening found asks for, above which the step is cut: it came from iterates
# on the way, and would cost no energy.
_LARGEST_EXCESS = 0.1
# Share of the sweeps allowed after which contacts that ranks divide are left to other solvers.
_SWEEPS_TOGETHER = 0.1
# Part of a step that may be rounding of the end time.
_LITTLE_LEFT = 1e-6
# Time this small beside the end is rounding.
_ROUNDING = 1e-12


@dataclass
class _Course:
    """Where a run is on its way to an end time.

    Attributes:
        end_time: s.
        step: the step that was given (s).
        left: whole steps left, where the step is given.
        pieces: sizes (s) and halvings of what is left of a step that is cut, the next one last.
    """

    end_time: float
    step: float
    left: int
    pieces: list[tuple[float, int]]

    def is_to(self, end_time: float, step: float) -> bool:
        """Whether it leads to an end time with a step."""
        return self.end_time == end_time and self.step == step


def _forces_and_motion(state: State, by_cell: Callable) -> dict:
    """The vectors of a state, by name."""
    vectors = {n: by_cell(getattr(state, n)) for n in ("displacement", "velocity", "internal")}
    external = state.external
    return vectors | {"external": by_cell(external) if np.ndim(external) else float(external)}


class StepRecord(NamedTuple):
    """What a committed step was.

    Attributes:
        step: number, from 1.
        time: time at its end (s).
        size: h (s).
        sweeps, residual, traction_change: of the interaction solver.
        newton_iterations, newton_residual: of the bulk.
        energies: columns of the energy ledger (J; 2D: J/m).
    """

    step: int
    time: float
    size: float
    sweeps: int
    residual: float
    traction_change: float
    newton_iterations: int
    newton_residual: float
    energies: dict[str, float]


class Simulation:
    """Steps a scene through time.

    Args:
        scene: what to simulate.
        step: h (s); 0.7 of the critical step of the explicit bulk if not given; "auto" adapts it.
        scheme: "implicit" or "explicit" bulk; interactions are implicit with both. If not given,
            implicit; with an adapted step explicit where each cell is a body that has mass, as
            waves then go from body to body by sweeps, and longer steps need as many more.
        theta: weight of the end of the step, in [1/2, 1]; the explicit bulk has 1/2.
        accuracy: relative error asked for, in (0, 1): step and tolerances that are not given are
            picked and adapted for it (`accuracy.py`). 1e-2 if only a knob is "auto".
        tolerance: bound on the estimated relative error of the impulses, or on the violation of
            the laws where all contacts are of rigid bodies (`nscd/nlgs.py`); 1e-3 if not given;
            "auto" adapts it.
        max_sweeps: sweeps after which the interaction solver gives up.
        solver: of the interactions: "nlgs" (sweeps), "newton" (all points at once, for steps far
            beyond the explicit limit), "accelerated" (mixed sweeps), "subdomains" (conjugate
            gradients, where all points are perfect bonds), or "auto", which picks. An explicit
            bulk with nodal points solves each vertex alone, and takes "auto" only. A function
            with the arguments of `nscd.nlgs.solve` is a solver too.
        relaxation: over-relaxation of impulses where a law is linear, in (0, 2).
        newton_tolerance: bound on the last relative Newton correction; with interactions at least
            a hundredth of `tolerance`. 1e-8 if not given, or a thousandth of `accuracy`.
        max_newton: Newton iterations after which a step is given up.
        max_halvings: how often a step that does not converge, in which a material flows by more
            than 5 % strain, in which iterates broke bonds that stay closed, or in which bodies
            would pass through each other unseen, is cut in two.
        inertia: False for a static run (theta = 1): bodies without mass, which motions, a
            periodic cell's ties or interactions with bodies that are held must hold, as nothing
            regularises the stiffness.
        num_threads: threads of the interaction solver; all that Numba has if not given.
        comm: ranks that simulate the scene together, each with the same scene. They divide the
            bodies of scenes of meshed bodies that interact at their facets or with walls, and the
            contacts of scenes of rigid bodies alone where there are enough of them
            (`parallel/rigid_division.py`); other scenes every rank simulates as a whole.
            MPI.COMM_SELF if each rank has a scene of its own.

    Attributes:
        team: the ranks of `comm`.
        ranks: those that divide the bodies or their contacts: `team`, or this one alone.
        part: what this rank has of the bodies, None if one rank has all.
        bodies: this rank's meshed bodies; those of the scene if one rank has all.
        state: displacement, velocity, time.
        rigid: motion of the rigid bodies, None without any.
        detection: searches of contacts, None if the scene names no contacts.
        interactions: the points, None if the scene has none.
        slot_nodes: nodes, among the unknowns, in the order of the points' slots, before those of
            rigid bodies.
        ledger: energies.
        macroscopic: Fbar, Pibar and Hill-Mandel's error of a periodic cell; None otherwise.
        solver: module of `nscd` that solves the interactions, or the function given.
        stopwatch: profile of the run.
        rescue: called where a step does not converge; saves the state and returns the file.

    Raises:
        ValueError: a number out of range.
    """

    def __init__(
        self,
        scene: Scene,
        step: float | str | None = None,
        *,
        accuracy: float | None = None,
        scheme: str | None = None,
        theta: float = 0.5,
        tolerance: float | str | None = None,
        max_sweeps: int = 20_000,
        relaxation: float = 1.3,
        solver: str | Callable[..., SolveReport] = "auto",
        newton_tolerance: float | None = None,
        max_newton: int = 25,
        max_halvings: int = 6,
        inertia: bool = True,
        num_threads: int | None = None,
        comm: MPI.Comm = MPI.COMM_WORLD,
    ):
        knobs = Knobs.chosen(accuracy, step, tolerance, newton_tolerance)
        step, tolerance, newton_tolerance = knobs.step, knobs.tolerance, knobs.newton_tolerance
        self._scheme_picked = scheme is None
        if scheme is None:
            explicit = knobs.adapts_step and self._suits_explicit(scene, theta, solver, inertia)
            scheme = "explicit" if explicit else "implicit"
        self._check(scheme, theta, relaxation)
        self._check_effects(scene, scheme, knobs, theta, inertia)
        if solver not in SOLVERS and not callable(solver):
            raise ValueError(f"solver should be one of {', '.join(SOLVERS)}, got {solver!r}.")
        if solver != "auto" and scheme == "explicit" and scene.points == "nodal":
            raise ValueError(
                "An explicit bulk with nodal points solves each vertex alone: leave solver at "
                f'"auto", got {solver!r}.'
            )
        for name, count, least in (
            ("max_sweeps", max_sweeps, 1), ("max_newton", max_newton, 1),
            ("max_halvings", max_halvings, 0),
        ):  # fmt: skip
            require_count(name, count, least)
        if num_threads is not None:
            require_count("num_threads", num_threads, 1)
        self.scene, self.scheme_name = scene, scheme
        self.tolerance, self.relaxation, self.max_sweeps = tolerance, relaxation, max_sweeps
        self.stopwatch = Stopwatch()
        self.max_halvings = max_halvings
        self.folder: Path | None = None
        self.team = Ranks(comm)
        with self.stopwatch.phase("set-up"):
            self._divide_bodies(solver, inertia)
            motions = [
                load
                for load in scene.loads
                if isinstance(load, PrescribedVelocity | PrescribedDisplacement)
            ]
            forces = [load for load in scene.loads if load not in motions]
            self.bulk = self._bulk(motions, forces, inertia)
            self.forms = self.bulk.forms
            self.rigid = self._rigid_motion()
            self.step_size = self._step_size(knobs, scheme)
            self.state = self._initial_state()
            self.detection: Detection | None = None
            self._points = ScenePoints(scene, self.bulk, self._ties, self.part, self._by_vertex)
            self.facets_with_law = self._points.facets_with_law
            self.detection = self._contact_detection(self._points.laws)
            if self._division is not None:
                self.detection.divide(self._division)
            interacting = self._points.interacting(self.detection)
            self.scheme = self._scheme(interacting, theta, newton_tolerance, max_newton)
            self.theta = self.scheme.theta
            with self.stopwatch.phase("interaction points"):
                self.interactions = self._interactions()
            self._account()
            self.ledger = EnergyLedger(self.bulk, self.state, self.theta, self.rigid)
            if wrong := not_finite_columns(self.ledger.as_columns()):
                raise ValueError(
                    f"At the start {wrong} are not finite: initial velocities or masses are beyond "
                    "the range of floats; take other units."
                )
            self._control = None if knobs.accuracy is None else self._accuracy_control(knobs)
        self.solver = solver
        if self._by_vertex:
            self.solver = "vertex_blocks" if self.part is None else "distributed"
        if not callable(solver):
            solver = import_module(f"xper_fx.nscd.{self.solver}").solve
        self._solve = partial(
            solver,
            max_sweeps=max_sweeps,
            relaxation=relaxation,
            num_threads=num_threads,
        )
        self._solve_together = self._together(relaxation, num_threads)
        self.macroscopic = self._macroscopic(None, None, self.step_size)
        self._tagged_nodes: dict[int, np.ndarray] = {}
        self.step_number = 0
        self._rigid_work: RigidWork | None = None
        self._rigid_reactions: np.ndarray | None = None
        self._some_driven = self.rigid is not None and bool(scene.rigid_bodies.is_prescribed.any())
        self.last: StepOutcome | None = None
        self._before: State | None = None
        self._last_size = self.step_size
        self.rescue: Callable[[], Path] | None = None
        self._course = _Course(math.nan, 0.0, 0, [])
        self._resumes = False

    @staticmethod
    def _suits_explicit(scene: Scene, theta: float, solver: str | Solver, inertia: bool) -> bool:
        """Whether the explicit bulk takes the scene, and longer steps would not be cheaper."""
        if scene.bodies is None:
            return False
        each_cell_a_body = scene.bodies.num_bodies == len(scene.bodies.body_of_cell)
        undamped = scene.macroscopic is None and scene.damping is None
        nodal = scene.points == "nodal" and solver == "auto"
        return each_cell_a_body and undamped and nodal and inertia and theta == 0.5

    @staticmethod
    def _check(scheme: str, theta: float, relaxation: float) -> None:
        for name, value in (("theta", theta), ("relaxation", relaxation)):
            require_number(name, value)
        if scheme not in ("implicit", "explicit"):
            raise ValueError(f'scheme should be "implicit" or "explicit", got {scheme!r}.')
        if not 0.5 <= theta <= 1.0:
            raise ValueError(f"theta should lie in [1/2, 1], got {theta}.")
        if scheme == "explicit" and theta != 0.5:
            raise ValueError(f"The explicit bulk has theta = 1/2, got {theta}.")
        if not 0.0 < relaxation < 2.0:
            raise ValueError(f"relaxation should lie in (0, 2), got {relaxation}.")

    @staticmethod
    def _check_effects(
        scene: Scene, scheme: str, knobs: Knobs, theta: float, inertia: bool
    ) -> None:
        if scheme == "explicit" and scene.macroscopic is not None:
            raise ValueError(
                "A periodic cell's macroscopic equations hold at the end of the step: take "
                'scheme="implicit".'
            )
        no_step = knobs.step is None and not knobs.adapts_step
        if scene.bodies is None and (knobs.step is None or scheme == "explicit"):
            raise ValueError(
                "A scene of rigid bodies takes a step (s), and no scheme of the bulk: no wave "
                f"bounds the step. Got step = {knobs.step}, {scheme!r}."
            )
        if scene.rigid_bodies is not None and not inertia:
            raise ValueError("Rigid bodies have inertia; a static run (inertia=False) has none.")
        if not inertia and (theta != 1.0 or scheme == "explicit" or no_step):
            raise ValueError(
                "A static run (inertia=False) takes a step or an accuracy, and theta = 1 of the "
                f'"implicit" scheme, got step = {knobs.step}, theta = {theta}, {scheme!r}.'
            )

    # Set-up

    def _divide_bodies(self, solver: str | Solver, inertia: bool) -> None:
        """Take this rank's part of the bodies where the scene can be divided."""
        scene = self.scene
        self.ranks, self.bodies, self.part = ALONE, scene.bodies, None
        self._division: RigidDivision | None = None
        if self.team.alone:
            return
        touching = any(contact.law is not None for contact in scene.contacts)
        if scene.bodies is None and touching and solver in ("auto", "nlgs"):
            self._divide_rigid_bodies()
            return
        whole = [
            name
            for name, there in (
                ("rigid bodies", scene.rigid_bodies is not None),
                ("contacts that are searched", len(scene.contacts) > 0),
                ("ties", len(scene.ties) > 0),
                ("no inertia", not inertia),
                ("a solver for one rank", solver not in _ON_RANKS),
                ("no facets between bodies", scene.bodies and not len(scene.bodies.facets)),
            )
            if there
        ]
        if whole:
            if self.team.rank == 0:
                logger.warning(
                    "each of %d ranks simulates the whole scene, as it has %s", self.team.size,
                    " and ".join(whole),
                )  # fmt: skip
            return
        from xper_fx.parallel.part import divide

        self.ranks = self.team
        with self.stopwatch.phase("partition"):
            self.part = divide(scene.bodies, self.ranks)
        self.bodies = self.part.bodies

    def _divide_rigid_bodies(self) -> None:
        """Let ranks divide the contacts of rigid bodies."""
        from xper_fx.parallel.rigid_division import RigidDivision

        self.ranks = self.team
        moves = ~self.scene.rigid_bodies.is_prescribed.all(axis=1)
        self._division = RigidDivision(self.ranks, moves, self.scene.dim)

    def _step_size(self, knobs: Knobs, scheme: str) -> float:
        """The step asked for, or a share of the critical one.

        Raises:
            ValueError: the explicit bulk would be unstable.
        """
        step = knobs.step
        if step is not None and scheme == "implicit":
            return float(step)
        critical = self.bulk.critical_step()
        if step is None:
            at_limit = scheme == "explicit" and knobs.adapts_step and self.bulk.linear
            return (_AT_LIMIT if at_limit else _BELOW_LIMIT) * critical
        if step > critical:
            raise ValueError(
                f"The explicit bulk is unstable at the step {step:g} s; it should be below the "
                f'critical one, {critical:.3g} s. Take a smaller step or scheme="implicit".'
            )
        return float(step)

    def _bulk(self, motions: Sequence[Load], forces: Sequence[Load], inertia: bool) -> Bulk:
        scene, self._ties = self.scene, []
        if scene.bodies is None:
            from xper_fx.bulk.empty import EmptyBulk

            return EmptyBulk(scene.dim)
        with self.stopwatch.phase("forms"):
            forms = BulkForms(self.bodies, scene.order, scene.materials, forces)
        self._ties = self._tied(forms)
        if scene.macroscopic is None:
            joined = () if inertia else self._joined_bodies()
            return Bulk(forms, motions, scene.damping, inertia, joined, self.ranks)
        from xper_fx.periodic.two_field import CellBulk

        return CellBulk(forms, scene.macroscopic, inertia, self.ranks)

    def _scheme(
        self, interacting: np.ndarray, theta: float, newton_tolerance: float, max_newton: int
    ) -> EmptyScheme | ExplicitScheme | ImplicitScheme:
        if self.scene.bodies is None:
            from xper_fx.bulk.empty import EmptyScheme

            return EmptyScheme(self.bulk, theta, self.stopwatch)
        if self.scheme_name == "explicit":
            from xper_fx.bulk.explicit import ExplicitScheme

            by_body = self.detection is not None or self.scene.points != "nodal"
            return ExplicitScheme(self.bulk, interacting, self.stopwatch, by_body)
        from xper_fx.bulk.implicit import ImplicitScheme

        return ImplicitScheme(
            self.bulk, interacting, theta, newton_tolerance, max_newton, self.stopwatch
        )

    def _rigid_motion(self) -> RigidMotion | None:
        if self.scene.rigid_bodies is None:
            return None
        from xper_fx.nscd.rigid.motion import RigidMotion

        return RigidMotion(self.scene.rigid_bodies, self.scene.gravity)

    def _contact_detection(self, laws: list) -> Detection | None:
        """The searches that the scene's contacts call for; their laws are added to `laws`."""
        if all(contact.law is None for contact in self.scene.contacts):
            return None
        from xper_fx.detection import Detection

        return Detection(self.scene, laws, getattr(self.forms, "V", None))

    def _initial_state(self) -> State:
        if self.scene.bodies is None:
            none = np.zeros(0)
            return State(0.0, none, none, none)
        function = fem.Function(self.forms.V)
        given = self.scene.initial_velocity
        if isinstance(given, Mapping):
            for tag, field in given.items():
                function.interpolate(
                    _checked(field, self.scene.dim), self.bodies.cell_tags.find(tag)
                )
        elif given is not None:
            function.interpolate(_checked(given, self.scene.dim))
        unknowns, rest = self.bulk.unknowns, np.zeros(self.bulk.num_dofs)
        velocity = rest.copy()
        velocity.reshape(-1, unknowns.dim)[unknowns.node_of] = function.x.array.reshape(
            -1, unknowns.dim
        )
        self.bulk.start(velocity, self.step_size)
        internal = self.bulk.internal(rest)
        if not np.all(np.isfinite(internal)):
            raise ValueError(
                "Internal forces at rest are not finite: a material's response should give the "
                "stress of the start for a step of size zero."
            )
        return State(0.0, rest, velocity, internal, self.bulk.external(0.0))

    def _tied(self, forms: BulkForms) -> list[tuple[InteractionPoints, np.ndarray]]:
        """Points of each tie and the bodies that they join."""
        if not self.scene.ties:
            return []
        from xper_fx.ties import tie_points

        if self.scheme_name == "explicit" and self.scene.points == "nodal":
            raise ValueError(
                "An explicit bulk with nodal points solves each vertex alone, and ties join "
                'several: take scheme="implicit" or points="gauss".'
            )
        return [tie_points(tie, forms.V, self.scene.bodies) for tie in self.scene.ties]

    def _joined_bodies(self) -> np.ndarray:
        """Pairs of bodies between which interactions act, shape (n, 2)."""
        _, law = self.scene.law_of_facet()
        pairs = [self.scene.bodies.facets.bodies[law >= 0], *(pair for _, pair in self._ties)]
        return np.concatenate(pairs)

    def _interactions(self) -> Interactions | None:
        if not self._points.exist and self.rigid is None and self.detection is None:
            return None
        inverse = self.scheme.inverse(self.step_size, self.state.displacement)
        self.slot_nodes = inverse.nodes
        points, halo = self._points.on_slots(inverse)
        velocity = self.state.velocity.reshape(-1, self.bulk.dim)[inverse.nodes]
        if halo is not None:
            velocity = halo.with_ghost_values(velocity)
        return Interactions(
            points, self._points.laws, self._points.law_of_point, inverse.blocks, velocity,
            ordering="vertices" if self._by_vertex else "tiles",
            rigid_blocks=None if self.rigid is None else self.rigid.blocks, halo=halo,
        )  # fmt: skip

    def _accuracy_control(self, knobs: Knobs) -> AccuracyControl:
        from xper_fx.accuracy import AccuracyControl
        from xper_fx.nscd.softening import softening_numbers

        softening, base = np.inf, self.step_size
        if self.interactions is not None:
            number = softening_numbers(self.interactions, base, self.theta).max(initial=0.0)
            softening = base / math.sqrt(number) if number > 0.0 else np.inf
        held, inertia = self.ledger.energies, self.bulk.inertia is not None
        largest = _LARGEST_GROWTH * base if inertia else np.inf
        return AccuracyControl(
            knobs, base if inertia or not knobs.adapts_step else None,
            largest=base if self.scheme_name == "explicit" else largest,
            softening_step=softening,
            interacting=self.interactions is not None,
            energy=held.kinetic + held.elastic,
        )  # fmt: skip

    def _account(self) -> None:
        """Say which phase holds which arrays."""
        owns, forms, interactions = self.stopwatch.owns, self.forms, self.interactions
        owns("forms", lambda: self.bulk.nbytes)
        if forms.has_history:
            owns("commit", lambda: forms.history_nbytes)
        if interactions is not None:
            owns("interaction points", lambda: sum(g.nbytes for g in interactions.groups))

    @property
    def _by_vertex(self) -> bool:
        """Whether W couples only what meets at a vertex, each of which is then solved alone."""
        alone = self.detection is None and self.rigid is None
        # a wall's points are on the rank of their body, a vertex's on that of the first body there
        alone = alone and not (self.part is not None and self.scene.walls)
        return self.scheme_name == "explicit" and self.scene.points == "nodal" and alone

    # Running

    def steps(self, end_time: float) -> Iterator[StepRecord]:
        """Advance to `end_time` (s), a record after each committed step.

        Raises:
            ValueError: an end that is not finite.
            ConvergenceError: a step did not converge however often it was cut; NotFiniteError:
                it gave NaN or infinity. The state is that of the last step.
        """
        if not math.isfinite(require_number("end_time", end_time)):
            raise ValueError(f"end_time should be a finite number, got {end_time}.")
        control = self._control
        fixed = control is None or not control.adapts_step
        course = self._course
        resumes, self._resumes = self._resumes, False
        if not (resumes and course.is_to(end_time, self.step_size)):
            count = math.ceil((end_time - self.state.time) / self.step_size - _LITTLE_LEFT)
            course = self._course = _Course(end_time, self.step_size, max(count, 0), [])
        yield from self._advance(end_time)
        if fixed:
            while course.left > 0:
                course.left -= 1
                course.pieces.append((self.step_size, 0))
                yield from self._advance(end_time)
            return
        if self._scheme_picked and self.scheme_name == "explicit":
            count = (end_time - self.state.time) / self.step_size
            if count > _MANY_STEPS:
                logger.warning(
                    "%.0f explicit steps to %g s: slow loads may be cheaper with "
                    'scheme="implicit"', count, end_time,
                )  # fmt: skip
        while end_time - self.state.time > _ROUNDING * abs(end_time):
            course.pieces.append((control.size(self.state.time, end_time), 0))
            yield from self._advance(end_time)

    def _advance(self, end_time: float) -> Iterator[StepRecord]:
        """The pieces of a step that are left to do; none if it should be shorter."""
        pieces = self._course.pieces
        while pieces:
            size, halvings = pieces.pop()
            with self.stopwatch.phase("step"):
                outcome, outrun = None, self._outruns_contacts(size)
                if halvings >= self.max_halvings or not outrun:
                    outcome = self._attempt(size)
                if outrun and outcome is not None:
                    logger.warning(
                        "step %d at h = %.3g s: bodies move so far that they may pass through each "
                        "other unseen; take a smaller step", self.step_number + 1, size,
                    )  # fmt: skip
                good = (
                    outcome is not None
                    and outcome.converged
                    and (
                        halvings >= self.max_halvings
                        or not (self._flows_too_far(outcome) or self._breaks_for_nothing())
                    )
                )
                if good and self._breaks_for_nothing():
                    logger.warning(
                        "step %d at h = %.3g s: bonds broke that stay closed, for no energy; take "
                        "a smaller step or tolerance", self.step_number + 1, size,
                    )  # fmt: skip
                if good:
                    with self.stopwatch.phase("energy"):
                        energies = self.ledger.bulk_energies(
                            self.state, outcome, size, self._rigid_work
                        )
                    self._require_finite(not_finite_columns(energies._asdict()), size)
                    if not self._accurate(size, energies, end_time) and not halvings:
                        return
                    record = self._commit(outcome, size, energies)
            if good:
                yield record
            elif halvings < self.max_halvings:
                logger.info(
                    "step %d at h = %.3g s did not converge, or went too far: halved",
                    self.step_number,
                    size,
                )
                pieces += [(0.5 * size, halvings + 1)] * 2
            else:
                residual, newton = np.nan, np.nan
                if outcome is not None:
                    residual, newton = outcome.residual, outcome.newton_residual
                    if self.ranks.alone:
                        source = source_of_not_finite(
                            self.scene, self.bulk, self.interactions, self.state, outcome, size
                        )
                        self._require_finite(source, size)
                raise ConvergenceError(
                    self.step_number + 1, self.state.time, size, residual, newton,
                    self._save_state(),
                )  # fmt: skip

    def _require_finite(self, source: str | None, size: float) -> None:
        """Raise a NotFiniteError if something has given a number that is not finite."""
        if source is not None:
            raise NotFiniteError(
                self.step_number + 1, self.state.time, size, source, self._save_state()
            )

    def _attempt(self, size: float) -> StepOutcome | None:
        """One step from the present state, None if a rigid body spins too fast for it.

        Nothing is committed.
        """
        if self.rigid is None:
            return self._interact(size, None)
        try:
            with self.stopwatch.phase("rigid bodies"):
                prediction = self.rigid.predict(size, self.theta, self.state.time)
                self.interactions.take_rigid(prediction.start, prediction.free)
            outcome = self._interact(size, prediction)
            with self.stopwatch.phase("rigid bodies"):
                self.rigid.end(self.interactions.rigid_part(outcome.slots))
                pushed = self.interactions.rigid_part(self.interactions.impulses())
                self._rigid_work = self.rigid.work(pushed)
                if self._some_driven:
                    self._rigid_reactions = self.rigid.reactions(pushed)
        except FloatingPointError as error:
            logger.info("%s", error)
            return None
        return outcome

    def _interact(self, size: float, prediction: Prediction | None) -> StepOutcome:
        """One step with the contacts found in its middle."""
        self._find_contacts(size, prediction)
        divided = self._division is not None and self._division.halo is not None
        solve = self._solve_together if divided else self._solve
        outcome = self.scheme.attempt(self.state, size, self.interactions, solve, self.tolerance)
        if divided and not outcome.converged and self.solver == "auto":
            # other solvers want all contacts on each rank
            self.detection.join()
            return self._interact(size, prediction)
        return outcome

    def _find_contacts(self, size: float, prediction: Prediction | None) -> None:
        if self.detection is not None:
            with self.stopwatch.phase("contact search"):
                self.detection.renew(
                    self.interactions, self.slot_nodes, self.bulk, self.state, prediction, size,
                    self.theta,
                )  # fmt: skip

    def _together(self, relaxation: float, num_threads: int | None) -> Callable | None:
        """Sweeps over contacts that ranks divide; how many are tried depends on what else is."""
        if self._division is None:
            return None
        from xper_fx.nscd.distributed import solve

        share = _SWEEPS_TOGETHER if self.solver == "auto" else 1.0
        return partial(
            solve, max_sweeps=math.ceil(share * self.max_sweeps), relaxation=relaxation,
            num_threads=num_threads,
        )  # fmt: skip

    def _accurate(self, size: float, energies: BulkEnergies, end_time: float) -> bool:
        """Whether the step from the present state is as accurate as asked for, if anything is."""
        if self._control is None:
            return True
        good = self._control.accepts(self.state.time, size, energies, end_time)
        if not good:
            logger.info("step at %.3g s of h = %.3g s is too coarse", self.state.time, size)
        return good

    def _outruns_contacts(self, size: float) -> bool:
        """Whether bodies move so far in a step that their contacts would be missed."""
        return self.detection is not None and self.detection.outrun(self.state, self.rigid, size)

    def _flows_too_far(self, outcome: StepOutcome) -> bool:
        """Whether a material flows by more in the step than its time integration bears."""
        if not self.forms.flows:
            return False
        with self.stopwatch.phase("flow check"):
            displacement = self.bulk.unknowns.expand(outcome.state.displacement)
            return self.ranks.max(self.forms.largest_increment(displacement)) > _LARGEST_FLOW

    def _breaks_for_nothing(self) -> bool:
        """Whether bonds were broken by iterates whose openings the step does not have."""
        return self.interactions is not None and self.interactions.too_far > _LARGEST_EXCESS

    def _commit(self, outcome: StepOutcome, size: float, energies: BulkEnergies) -> StepRecord:
        with self.stopwatch.phase("energy"):
            work = None if self.interactions is None else self.interactions.commit(outcome.slots)
            self.ledger.record(self.state, outcome, size, energies, work, self._rigid_work)
        self._require_finite(not_finite_columns(self.ledger.as_columns()), size)
        if self.detection is not None:
            with self.stopwatch.phase("contact search"):
                self.detection.release(
                    self.interactions, self._points.points_a_facet,
                    self.bulk.unknowns.expand(outcome.state.displacement),
                )  # fmt: skip
        if self._control is not None:
            self._control.learn(size, energies, work, self.ledger.closure)
            self.tolerance = self._control.tolerance
        with self.stopwatch.phase("commit"):
            self.bulk.commit(outcome.state.displacement, outcome.state.internal)
            if self.rigid is not None:
                self.rigid.commit()
        self._before, self.state, self.last, self._last_size = (
            self.state, outcome.state, outcome, size,
        )  # fmt: skip
        self.macroscopic = self._macroscopic(self._before, outcome, size)
        self.step_number += 1
        return StepRecord(
            self.step_number, self.state.time, size, outcome.sweeps, outcome.residual,
            outcome.traction_change, outcome.newton_iterations, outcome.newton_residual,
            self.ledger.as_columns(),
        )  # fmt: skip

    def _macroscopic(
        self, before: State | None, outcome: StepOutcome | None, size: float
    ) -> Macroscopic | None:
        if self.scene.macroscopic is None:
            return None
        from xper_fx.periodic.averages import macroscopic_state

        with self.stopwatch.phase("macroscopic averages"):
            return macroscopic_state(self.bulk, before, outcome, self.state, size, self.theta)

    # Saving

    def _save_state(self) -> Path | None:
        """Save the state before a step that failed, where a recorder does so."""
        self._course = _Course(math.nan, 0.0, 0, [])
        if self.rescue is None:
            return None
        try:
            return self.rescue()
        except OSError as error:
            logger.error("the state could not be saved: %s", error)
            return None

    def saved(self) -> dict:
        """All that the rest of the run depends on, in nested dictionaries.

        Returns:
            By name numbers, arrays that are the same for all processes, and `Rows`; a restarted
            run equals this one if it has the same scene and options.
        """
        by_cell, course = self.bulk.unknowns.by_cell, self._course
        saved = {
            "step_number": self.step_number,
            "time": self.state.time,
            "last_size": self._last_size,
            "state": _forces_and_motion(self.state, by_cell),
            "bulk": self.bulk.saved(),
            "scheme": self.scheme.saved(),
            "ledger": self.ledger.saved(),
            "course": {
                "end_time": course.end_time,
                "step": course.step,
                "left": course.left,
                "pieces": np.reshape(np.array(course.pieces, float), (-1, 2)),
            },
        }
        if self.last is not None:
            saved["last"] = {
                "reactions": by_cell(self.last.reactions),
                "impulses": by_cell(self.last.impulses),
                "displacement_before": by_cell(self._before.displacement),
            }
        if self.macroscopic is not None:
            saved["hill_mandel"] = self.macroscopic.hill_mandel
        for name, part in self._parts():
            saved[name] = part.saved()
        if self._rigid_reactions is not None:
            saved["rigid_reactions"] = self._rigid_reactions
        if self.interactions is not None:
            saved["solvers"] = self._solver_memories()
        return saved

    def _solver_memories(self) -> dict[str, dict]:
        """What solvers keep from step to step, by rank: it stands in the order of its points."""
        memory = {
            name: module.saved(self.interactions)
            for name in _WITH_MEMORY
            if (module := sys.modules.get(f"xper_fx.nscd.{name}")) is not None
        }
        memories = [memory] if self.ranks.alone else self.ranks.comm.allgather(memory)
        return {f"{rank} of {len(memories)}": held for rank, held in enumerate(memories)}

    def restore(self, saved: Mapping) -> None:
        """Go on where `saved` was taken, of the same scene.

        Args:
            saved: with the rows in order (`Rows.in_order`).
        """
        from_cells = self.bulk.unknowns.from_cells
        state = saved.get("state", {})
        vectors = {
            name: state[name] if isinstance(state[name], float) else from_cells(state[name])
            for name in state
        }
        none = np.zeros(0)
        self.state = State(
            saved["time"],
            *(vectors.get(name, none) for name in ("displacement", "velocity", "internal")),
            vectors.get("external", 0.0),
        )
        self.step_number, self._last_size = saved["step_number"], saved["last_size"]
        self.bulk.restore(saved.get("bulk", {}))
        self.scheme.restore(saved.get("scheme", {}))
        self.ledger.restore(saved["ledger"])
        course = saved["course"]
        pieces = [(size, int(halvings)) for size, halvings in course["pieces"].tolist()]
        self._course = _Course(course["end_time"], course["step"], course["left"], pieces)
        self._resumes = True
        for name, part in self._parts():
            if name in saved:
                part.restore(saved[name])
        if self._control is not None:
            self.tolerance = self._control.tolerance
        self._rigid_reactions = saved.get("rigid_reactions")
        if self.step_number:
            last = saved.get("last", {})
            self._before = replace(
                self.state, displacement=from_cells(last.get("displacement_before", {}))
            )
            self.last = StepOutcome(
                self.state, none, from_cells(last.get("impulses", {})),
                from_cells(last.get("reactions", {})), 0.0, 0.0, 0, 0.0, 0.0, 0, 0.0, True,
            )  # fmt: skip
        if self.macroscopic is not None:
            here = self._macroscopic(None, None, self._last_size)
            self.macroscopic = here._replace(hill_mandel=saved["hill_mandel"])
        if self.interactions is not None and self.scheme.holds(self.interactions.step_size):
            inverse = self.scheme.inverse(self.interactions.step_size, self.state.displacement)
            self.interactions.update_inverse(inverse.blocks)
        own = f"{self.ranks.rank} of {self.ranks.size}"
        for name, memory in saved.get("solvers", {}).get(own, {}).items():
            import_module(f"xper_fx.nscd.{name}").restore(self.interactions, memory)

    def _parts(self) -> list[tuple[str, object]]:
        """What there is of the parts that save themselves, in the order to restore them."""
        parts = [
            ("interactions", self.interactions), ("detection", self.detection),
            ("rigid", self.rigid), ("accuracy", self._control),
        ]  # fmt: skip
        return [(name, part) for name, part in parts if part is not None]

    # Reading

    @property
    def estimated_error(self) -> float | None:
        """Relative error estimated so far; None without an accuracy asked for."""
        return None if self._control is None else self._control.error

    @property
    def time(self) -> float:
        """Time reached (s)."""
        return self.state.time

    @property
    def displacement(self) -> fem.Function:
        """Displacement on the exploded mesh (m)."""
        function = self.forms.u
        function.x.array[:] = self.bulk.unknowns.expand(self.state.displacement)
        return function

    @property
    def velocity(self) -> fem.Function:
        """Velocity on the exploded mesh (m/s)."""
        function = fem.Function(self.forms.V, name="velocity")
        function.x.array[:] = self.bulk.unknowns.expand(self.state.velocity)
        return function

    def mean_displacement(self, facets: int) -> np.ndarray:
        """Mean displacement of the nodes of tagged facets, shape (dim,), m."""
        return self._mean_over(facets, self.state.displacement)

    def mean_displacement_of_reaction(self, facets: int) -> np.ndarray:
        """As `mean_displacement`, at t0 + theta h of the last step, for which `reaction` stands."""
        end = self.mean_displacement(facets)
        if self._before is None:
            return end
        start = self._mean_over(facets, self._before.displacement)
        return self.theta * end + (1.0 - self.theta) * start

    def _mean_over(self, facets: int, displacement: np.ndarray) -> np.ndarray:
        values = self.bulk.unknowns.expand(displacement).reshape(-1, self.bulk.dim)
        values = values[self._nodes_of(facets)]
        if self.ranks.alone:
            return values.mean(axis=0)
        return self.ranks.sum(values.sum(axis=0)) / self.ranks.sum(len(values))

    def _nodes_of(self, facets: int) -> np.ndarray:
        if facets not in self._tagged_nodes:
            fdim = self.bodies.mesh.topology.dim - 1
            self._tagged_nodes[facets] = fem.locate_dofs_topological(
                self.forms.V, fdim, self.bodies.facet_tags.find(facets)
            )
        return self._tagged_nodes[facets]

    def reaction(self, facets: int) -> np.ndarray:
        """Mean force over the last step on the prescribed dofs of tagged facets.

        It stands for the time t0 + theta h, so compare it with `mean_displacement_of_reaction`.

        Args:
            facets: facet tag.

        Returns:
            Shape (dim,), N (2D: N/m), the force that the support exerts on the bodies.
        """
        if self.scene.macroscopic is not None:
            raise ValueError("A periodic cell has no supports; read `macroscopic.stress`.")
        if self.last is None:
            return np.zeros(self.bulk.dim)
        nodes = self._nodes_of(facets)
        reactions = self.last.reactions.reshape(-1, self.bulk.dim)[nodes].sum(axis=0)
        return self.ranks.sum(reactions) / self._last_size

    def reaction_of(self, group: str) -> np.ndarray:
        """Mean force over the last step that drives or holds the rigid bodies of a group.

        Args:
            group: name of the group.

        Returns:
            Shape (dim,), N (2D: N/m): on what is prescribed, zero elsewhere.

        Raises:
            ValueError: no rigid body bears the name.
        """
        bodies = self.scene.rigid_bodies
        if bodies is None or group not in bodies.groups:
            raise ValueError(f"No rigid body is of the group {group!r}.")
        if self._rigid_reactions is None:
            return np.zeros(self.bulk.dim)
        forces = self._rigid_reactions.reshape(-1, 2, self.bulk.dim)[:, 0]
        return forces[bodies.group_of == bodies.groups.index(group)].sum(axis=0)


def _checked(field: Callable[[np.ndarray], np.ndarray], dim: int) -> Callable:
    """An initial velocity that is refused unless it gives finite numbers of the right shape."""

    def values(x: np.ndarray) -> np.ndarray:
        given = np.asarray(field(x))
        if given.shape != (dim, x.shape[1]) or given.dtype.kind not in "biuf":
            raise ValueError(
                f"initial_velocity should give numbers of shape ({dim}, {x.shape[1]}) for as many "
                f"points, got {given.dtype} of shape {given.shape}."
            )
        if not np.all(np.isfinite(given)):
            where = x[:dim, ~np.isfinite(given).all(axis=0)][:, 0]
            raise ValueError(f"initial_velocity is not finite at {where.tolist()}.")
        return given.astype(float)

    return values
