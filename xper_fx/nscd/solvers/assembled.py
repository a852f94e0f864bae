# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts with friction solved as a `FrictionProblem` (`nscd/friction/`), W assembled each time.

Sweeps hand an impulse on from body to body, and hardly move those that a structure near collapse
asks for. Solvers of the assembled problem see it as a whole: the interior point takes some twenty
factorisations whatever the structure is. A wall of 55 blocks, at rest under its weight and a
horizontal push of a third of it, takes 0.1 s and comes out at rest to 1e-9 of g h, where sweeps
stop at the tolerance of 1e-3 with 3e-2 (`benchmarks/collapse_loads.py`).

What they find is judged as sweeps are, by some sweeps (`nlgs.py`). Laws whose friction changes in
the step are solved again until it does not.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.local_solvers import LOCAL_SOLVERS
from xper_fx.nscd.solvers.contact_problem import ContactProblem
from xper_fx.nscd.solvers.nlgs import NonlinearGaussSeidel
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport

# Sweeps that judge.
_JUDGING = 20
# Natural-map error asked for, relative to the tolerance, and its bounds.
_SHARE, _LEAST, _MOST = 0.03, 1e-12, 1e-4
# Solutions for friction that changes in the step.
_ROUNDS = 50


class AssembledContacts(Solver):
    """The `FrictionProblem` of the step, by whichever of its solvers gets there.

    Args:
        local_solver: of the sweeps over rows of W, one of `LOCAL_SOLVERS`; "auto" is the fastest
            exact one.
        facets: of the cone, for the local solver "lcp" in 3D.

    Raises:
        ValueError: an unknown local solver, or one for a method that makes no sweeps.
    """

    name = "friction_problem"
    method: ClassVar[str] = "auto"

    def __init__(self, local_solver: str = "auto", facets: int | None = None) -> None:
        known = ("auto", *dict.fromkeys(name for names in LOCAL_SOLVERS.values() for name in names))
        if local_solver not in known:
            raise ValueError(
                f"local_solver should be one of {', '.join(known)}, got {local_solver!r}."
            )
        if self.method not in ("auto", "anderson") and (local_solver, facets) != ("auto", None):
            raise ValueError(
                f'The method "{self.method}" makes no sweeps over contacts, and so has no local '
                f"solver; got local_solver={local_solver!r}, facets={facets}."
            )
        self._local = {"local_solver": local_solver, "facets": facets}
        self._sweeps = NonlinearGaussSeidel()

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says.

        Raises:
            UnsuitableSolverError: interactions of another kind (`contact_problem.py`).
        """
        free, judging = velocity.copy(), replace(options, max_sweeps=_JUDGING)
        asked = min(max(_SHARE * options.tolerance, _LEAST), _MOST)
        sweeps, reason = 0, "no closed contact"
        for _ in range(_ROUNDS):
            assembled = ContactProblem(interactions, free)
            if assembled.problem is None:
                assembled.take(np.zeros(0))
            else:
                result = assembled.solve(
                    self.method, tolerance=asked, max_sweeps=options.max_sweeps, **self._local
                )
                assembled.take(result.reaction)
                sweeps += result.sweeps
                reason = f"{result.solver}, error {result.error:.2g}"
                if not result.converged:
                    reason += f": {result.reason}"
            velocity[:] = free
            interactions.add_velocity(velocity)
            if interactions.evolve(velocity) <= options.tolerance:
                break
        velocity[:] = free
        report = self._sweeps.solve(interactions, velocity, judging)
        return report._replace(sweeps=sweeps + report.sweeps, solver=self.name, reason=reason)


class InteriorPoint(AssembledContacts):
    """The interior point alone."""

    name = method = "interior_point"


class ProximalPoint(AssembledContacts):
    """Proximal points alone."""

    name = method = "proximal_point"


class AndersonSweeps(AssembledContacts):
    """Sweeps over rows of W, mixed by Anderson's method."""

    name = method = "anderson"
