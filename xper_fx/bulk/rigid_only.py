# SPDX-License-Identifier: LGPL-3.0-or-later
"""The bulk of a scene without a mesh: nothing to assemble, nothing to solve.

It has what `Bulk`, `BulkForms` and `ImplicitScheme` have where a scene of rigid bodies asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from xper_fx.bulk.body_dofs import BodyLayout
from xper_fx.bulk.state import State, StepOutcome, Supports, interact
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.solvers.solver import SolveOptions, Solver
from xper_fx.support.profile import Stopwatch
from xper_fx.support.ranks import ALONE
from xper_fx.support.saved_rows import KeepsNothing


class NoForms:
    """No material, no load on the bulk."""

    external = None
    flows = has_history = plastic = viscous = False

    def assemble_dissipation(self, displacement: np.ndarray) -> dict[str, float]:
        """Nothing dissipates."""
        return {}

    def history(self) -> dict[str, np.ndarray]:
        """No internal variables."""
        return {}


class NoNodes:
    """No unknowns."""

    num_nodes = num_dofs = 0

    def __init__(self, dim: int):
        self.dim = dim
        self.node_of = np.zeros(0, np.int32)

    def expand(self, unknowns: np.ndarray) -> np.ndarray:
        """The unknowns, none."""
        return unknowns

    def by_cell(self, unknowns: np.ndarray) -> dict:
        """Nothing to save."""
        return {}

    def from_cells(self, saved: Mapping) -> np.ndarray:
        """The unknowns, none."""
        return np.zeros(0)


class EmptyBulk(KeepsNothing):
    """A bulk without degrees of freedom."""

    linear, floating = True, False
    inertia = damping = mass = stiffness = None
    num_dofs = num_dofs_of_all = num_common = nbytes = 0
    ranks = ALONE

    def __init__(self, dim: int):
        self.dim = dim
        self.forms, self.unknowns = NoForms(), NoNodes(dim)
        nothing = np.zeros(0, np.int64)
        self.layout = BodyLayout(nothing, np.zeros(1, np.int64), dim, np.zeros(0, bool))

    def kinetic_energy(self, velocity: np.ndarray) -> float:
        """Zero."""
        return 0.0

    def elastic_energy(self, displacement: np.ndarray, internal: np.ndarray) -> float:
        """Zero."""
        return 0.0

    def commit(self, state: State, impulses: np.ndarray, step: float) -> None:
        """No internal variables to move on."""


class _NoInverse:
    """The inverse of no matrix."""

    num_nodes = nbytes = 0
    in_order = False

    def __init__(self, dim: int):
        self.nodes = np.zeros(0, np.int64)
        self.blocks = BodyInverse.from_uniform(np.zeros((0, dim, dim)), dim)


class EmptyScheme(KeepsNothing):
    """The step of a scene whose bodies are all rigid: the interactions alone.

    Args:
        theta: weight of the end of the step, in [1/2, 1].
        stopwatch: where phases are timed.
    """

    def __init__(self, bulk: EmptyBulk, theta: float, stopwatch: Stopwatch):
        self.theta, self._stopwatch = theta, stopwatch
        self._inverse = _NoInverse(bulk.dim)

    def inverse(self, step: float, displacement: np.ndarray) -> _NoInverse:
        """The inverse of no matrix."""
        return self._inverse

    def attempt(
        self,
        state: State,
        step: float,
        interactions: Interactions,
        solver: Solver,
        options: SolveOptions,
    ) -> StepOutcome:
        """One step, as of `ImplicitScheme.attempt`."""
        with self._stopwatch.phase("interaction terms"):
            interactions.begin_step(step, self.theta)
        with self._stopwatch.phase("interaction solve"):
            none, impulses, slots, report = interact(
                self._inverse, interactions, solver, np.zeros(0), options
            )
        return StepOutcome(
            State(state.time + step, none, none, none), slots, impulses,
            Supports(self._inverse.nodes, none), 0.0, 0.0,
            report.sweeps, report.residual, report.traction_change, 1, 0.0, report.converged,
        )  # fmt: skip

    def holds(self, step: float) -> bool:
        """As of `ImplicitScheme`."""
        return True
