# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a solver of the interactions is: what it is asked, what it keeps, what it says.

A solver object serves one scene. Between the steps it may keep what makes the next one cheaper; it
saves and restores that with the run, so that a restarted run has the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from xper_fx.support.checks import require_count, require_number, require_positive

if TYPE_CHECKING:
    from xper_fx.nscd.interactions import Interactions


@dataclass(frozen=True)
class SolveOptions:
    """How well, and with what, the interaction problem of a step is solved.

    Args:
        tolerance: bound on the estimated relative error of the impulses, or on the violation of the
            laws where all contacts are of rigid bodies (`nlgs.py`).
        max_sweeps: sweeps or iterations after which to give up.
        relaxation: factor on the change of an impulse in Gauss-Seidel sweeps, where its law is
            locally linear, in (0, 2).
        num_threads: threads to use; if not given all that Numba has, or one where points are few.
            Results do not depend on it beyond the rounding of the residual.
        last_try: whether the step cannot be cut, so that a static one may go down to a state beyond
            a snap.
        likely_sweeps: as many as the last solve took, 0 if that says nothing. Ranks do not ask each
            other before whether they have arrived.

    Raises:
        ValueError: a number out of range.
        TypeError: something that is no number.
    """

    tolerance: float = 1e-4
    max_sweeps: int = 10_000
    relaxation: float = 1.0
    num_threads: int | None = None
    last_try: bool = False
    likely_sweeps: int = 0

    def __post_init__(self) -> None:
        require_positive("tolerance", self.tolerance)
        require_count("max_sweeps", self.max_sweeps, 1)
        require_count("likely_sweeps", self.likely_sweeps, 0)
        if not 0.0 < require_number("relaxation", self.relaxation) < 2.0:
            raise ValueError(f"relaxation should lie in (0, 2), got {self.relaxation}.")
        if self.num_threads is not None:
            require_count("num_threads", self.num_threads, 1)


class SolveReport(NamedTuple):
    """How a solve ended.

    Attributes:
        converged: whether the estimated error is within the tolerance.
        sweeps: sweeps made.
        residual: estimated relative error of the impulses; of contacts of rigid bodies the
            relative violation of their laws (`nlgs.py`).
        traction_change: largest change of a traction in the last sweep (Pa).
        solver: name of the solver that found the impulses.
        reason: why this solver, and what else it did; empty if there was no choice.
        contraction: of the last sweeps, a sweep; 1 if unknown.
    """

    converged: bool
    sweeps: int
    residual: float
    traction_change: float
    solver: str = "nlgs"
    reason: str = ""
    contraction: float = 1.0


class UnsuitableSolverError(ValueError):
    """The interactions of a step are not of the kind that a solver takes; says which and why."""


class Solver:
    """A solver of the interactions of one scene.

    Attributes:
        name: by which users ask for it.
    """

    name: ClassVar[str] = "own"

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step.

        Args:
            interactions: points after `begin_step`, whose impulses are the first guess.
            velocity: shape (num_slots * dim,), m/s: the free velocity on entry, v_free + w H r on
                return.
            options: how well, and with what.

        Returns:
            The report; not converged is reported, not raised.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method `solve`.")

    def kept(self) -> list[object]:
        """The objects that are kept from step to step."""
        return []

    def saved(self, interactions: Interactions) -> dict[str, dict[str, np.ndarray]]:
        """What is kept from step to step and decides about bits, by the name of its owner.

        Arrays are in the order in which this process visits points: of use with as many processes
        only.
        """
        return {}

    def restore(self, interactions: Interactions, saved: Mapping[str, Mapping]) -> None:
        """Take what `saved` gave, for the same points and w."""
