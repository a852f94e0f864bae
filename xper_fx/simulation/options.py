# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run is asked for, checked against its scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.scene.scene import Scene
from xper_fx.simulation.requested_accuracy import RequestedAccuracy
from xper_fx.simulation.shared_motions import bonds_split
from xper_fx.support.checks import require_count, require_flag, require_kind, require_number

if TYPE_CHECKING:
    from xper_fx.simulation.path import PathControl

# Solvers of the interactions: classes of `nscd.solvers`, imported when asked for.
SOLVERS = {
    "auto": "Automatic",
    "nlgs": "NonlinearGaussSeidel",
    "newton": "NewtonOnAllPoints",
    "accelerated": "AcceleratedSweeps",
    "friction_problem": "AssembledContacts",
    "interior_point": "InteriorPoint",
    "proximal_point": "ProximalPoint",
    "anderson": "AndersonSweeps",
    "subdomains": "BondedGradients",
    "monolithic": "Monolithic",
}


@dataclass(frozen=True)
class Options:
    """The options of a `Simulation`, which documents them; `checked` makes them.

    Attributes:
        requested: step, tolerances and accuracy.
        scheme: "implicit" or "explicit".
        scheme_is_picked: whether the user left it open.
        theta, max_newton, max_halvings, forgiving, inertia, healing, solver: as given.
        solve: of the interactions, with the first tolerance.
        path: control of the load of a static run, None where its time is given.
    """

    requested: RequestedAccuracy
    scheme: str
    scheme_is_picked: bool
    theta: float
    solver: str | Solver
    solve: SolveOptions
    max_newton: int
    max_halvings: int
    forgiving: bool
    inertia: bool
    healing: bool
    path: PathControl | None

    @property
    def asks_for_one_system(self) -> bool:
        """Whether bulk and interactions are to be solved in one system."""
        asked = self.solver.name if isinstance(self.solver, Solver) else self.solver
        return asked == "monolithic"

    @property
    def allows_one_system(self) -> bool:
        """Whether they may be, where the scene calls for it."""
        picks = self.solver == "auto" and self.scheme == "implicit"
        return self.asks_for_one_system or picks

    @property
    def may_leave_one_system(self) -> bool:
        """Whether sweeps take over where one system, if it was picked, does not converge."""
        return self.inertia and not self.asks_for_one_system

    @classmethod
    def checked(
        cls,
        scene: Scene,
        requested: RequestedAccuracy,
        *,
        scheme: str | None,
        theta: float | None,
        solver: str | Solver,
        solve: SolveOptions,
        max_newton: int,
        max_halvings: int,
        forgiving: bool,
        inertia: bool,
        healing: bool,
        path: PathControl | None,
    ) -> Options:
        """Options of which the scene can be run.

        Raises:
            ValueError: a number out of range, an unknown word, options that exclude each other or
                something in the scene.
            TypeError: no scene, something that is no number.
        """
        require_kind("scene", scene, Scene)
        if theta is None:
            theta = 0.5 if inertia else 1.0
        picked = scheme is None
        if scheme is None:
            short = requested.adapts_step or (requested.step is None and bonds_split(scene))
            explicit = short and _suits_explicit(scene, theta, solver, inertia)
            scheme = "explicit" if explicit else "implicit"
        options = cls(
            requested,
            scheme,
            picked,
            theta,
            solver,
            solve,
            max_newton,
            max_halvings,
            forgiving,
            inertia,
            healing,
            path,
        )
        options._check_ranges()
        options._check_scene(scene)
        options._check_solver(scene)
        return options

    def _check_ranges(self) -> None:
        theta = require_number("theta", self.theta)
        require_flag("inertia", self.inertia)
        require_flag("healing", self.healing)
        require_flag("forgiving", self.forgiving)
        if self.scheme not in ("implicit", "explicit"):
            raise ValueError(f'scheme should be "implicit" or "explicit", got {self.scheme!r}.')
        if not 0.5 <= theta <= 1.0:
            raise ValueError(f"theta should lie in [1/2, 1], got {theta}.")
        if self.scheme == "explicit" and theta != 0.5:
            raise ValueError(f"The explicit bulk has theta = 1/2, got {theta}.")
        require_count("max_newton", self.max_newton, 1)
        require_count("max_halvings", self.max_halvings, 0)

    def _check_scene(self, scene: Scene) -> None:
        scheme, step = self.scheme, self.requested.step
        if scheme == "explicit" and scene.macroscopic is not None:
            raise ValueError(
                "A periodic cell's macroscopic equations hold at the end of the step: take "
                'scheme="implicit".'
            )
        if scene.bodies is None and (step is None or scheme == "explicit"):
            raise ValueError(
                "A scene of rigid bodies takes a step (s), and no scheme of the bulk: no wave "
                f"bounds the step. Got step = {step}, {scheme!r}."
            )
        self._check_path()
        if self.inertia:
            return
        rigid = scene.rigid_bodies
        if rigid is not None and not rigid.is_prescribed.all():
            free = int(np.flatnonzero(~rigid.is_prescribed.all(axis=1))[0])
            raise ValueError(
                f"Rigid body {free} is free to move, and needs inertia for it; a static run "
                "(inertia=False) has none. Prescribe all its velocities (RigidBody(prescribed=)), "
                "mesh it, or load the scene slowly with inertia and theta = 1."
            )
        no_step = step is None and not self.requested.adapts_step
        if self.theta != 1.0 or scheme == "explicit" or no_step:
            raise ValueError(
                "A static run (inertia=False) takes a step or an accuracy, and theta = 1 of the "
                f'"implicit" scheme, got step = {step}, theta = {self.theta}, {scheme!r}.'
            )

    def _check_path(self) -> None:
        if self.path is None:
            return
        from xper_fx.simulation.path import PathControl

        if not isinstance(self.path, PathControl):
            raise TypeError(
                "path should be an xf.GrowthControl or an xf.DissipationControl, got "
                f"{self.path!r}."
            )
        if self.inertia or not self.allows_one_system or self.requested.accuracy is not None:
            raise ValueError(
                "A path is followed in static runs with a given step by the monolithic solver: "
                f'take inertia=False, solver="auto" and no accuracy; got inertia={self.inertia}, '
                f"solver={self.solver!r}."
            )

    def _check_solver(self, scene: Scene) -> None:
        solver = self.solver
        if not isinstance(solver, Solver | str):
            raise TypeError(
                f"solver should be one of {', '.join(SOLVERS)}, or an object of a class derived "
                f"from xf.solvers.Solver, got {solver!r}."
            )
        if not isinstance(solver, Solver) and solver not in SOLVERS:
            raise ValueError(f"solver should be one of {', '.join(SOLVERS)}, got {solver!r}.")
        moving = scene.rigid_bodies is not None and self.inertia
        if self.asks_for_one_system and (moving or self.scheme == "explicit"):
            raise ValueError(
                "The monolithic solver takes meshed bodies and an implicit bulk, and rigid bodies "
                'in static runs alone; leave solver at "auto" for an explicit bulk or rigid bodies '
                "with inertia."
            )
        if self.scheme == "explicit" and scene.points == "nodal":
            if solver != "auto":
                raise ValueError(
                    "An explicit bulk with nodal points solves each vertex alone: leave solver at "
                    f'"auto", got {solver!r}.'
                )
            if scene.ties:
                raise ValueError(
                    "An explicit bulk with nodal points solves each vertex alone, and ties join "
                    'several: take scheme="implicit" or points="gauss".'
                )


def _suits_explicit(scene: Scene, theta: float, solver: str | Solver, inertia: bool) -> bool:
    """Whether the explicit bulk takes the scene, and longer steps would not be cheaper."""
    if scene.bodies is None:
        return False
    num_bodies, num_cells = scene.bodies.counts
    undamped = scene.macroscopic is None and scene.damping is None
    nodal = scene.points == "nodal" and solver == "auto"
    return num_bodies == num_cells and undamped and nodal and inertia and theta == 0.5
