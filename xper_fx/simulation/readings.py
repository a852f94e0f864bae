# SPDX-License-Identifier: LGPL-3.0-or-later
"""What can be read off a simulation between its steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from dolfinx import fem

from xper_fx.bulk.state import State, StepOutcome
from xper_fx.simulation.model import Model
from xper_fx.support.checks import require_integer
from xper_fx.support.ranks import Ranks

if TYPE_CHECKING:
    from xper_fx.periodic.averages import Macroscopic
    from xper_fx.periodic.grain_cell import GrainStress


class Readings:
    """Displacements, velocities and reactions of a simulation's present state."""

    model: Model  #: what is stepped
    team: Ranks  #: the ranks that have the scene
    state: State  #: displacement, velocity, time
    last: StepOutcome | None  #: the last step's outcome, None before the first
    _before: State | None  # at the start of the last step
    _last_size: float  # of the last step (s)
    _rigid_reactions: np.ndarray | None  # impulses of the last step

    def _macroscopic(
        self, before: State | None, outcome: StepOutcome | None, size: float
    ) -> Macroscopic | GrainStress | None:
        model = self.model
        if model.scene.macroscopic is None:
            return None
        if model.scene.bodies is None:
            return model.rigid.macroscopic
        from xper_fx.periodic.averages import macroscopic_state

        with model.stopwatch.phase("macroscopic averages"):
            return macroscopic_state(
                model.bulk, before, outcome, self.state, size, model.scheme.theta
            )

    @property
    def time(self) -> float:
        """Time reached (s)."""
        return self.state.time

    @property
    def displacement(self) -> fem.Function:
        """Displacement on the exploded mesh (m)."""
        self._require_mesh("displacement")
        function = self.model.bulk.forms.u
        function.x.array[:] = self.model.bulk.unknowns.expand(self.state.displacement)
        return function

    @property
    def velocity(self) -> fem.Function:
        """Velocity on the exploded mesh (m/s)."""
        self._require_mesh("velocity")
        function = fem.Function(self.model.bulk.forms.V, name="velocity")
        function.x.array[:] = self.model.bulk.unknowns.expand(self.state.velocity)
        return function

    @property
    def estimated_error(self) -> float | None:
        """Relative error estimated so far; None without an accuracy asked for."""
        return None if self.model.control is None else self.model.control.estimate.error

    @property
    def borne(self) -> np.ndarray | float:
        """Loads and reactions of a static run that are in balance (N); 0 at the start of a run."""
        if self.last is None or self.model.options.inertia:
            return 0.0
        return self.state.external + self.last.reactions / self._last_size

    @property
    def transmitted(self) -> np.ndarray | float:
        """What interactions do to the bulk, as `borne`."""
        if self.last is None or self.model.options.inertia:
            return 0.0
        return self.last.impulses / self._last_size

    @property
    def facets_with_law(self) -> np.ndarray:
        """Which of `scene.bodies.facets` have interaction points, on any rank, shape (n,)."""
        return self.model.points.facets_with_law

    def mean_displacement(self, facets: int) -> np.ndarray:
        """Mean displacement of the nodes of tagged facets, shape (dim,), m.

        Raises:
            ValueError, TypeError: a tag that occurs nowhere.
        """
        return self._mean_over(facets, self.state.displacement)

    def mean_displacement_of_reaction(self, facets: int) -> np.ndarray:
        """As `mean_displacement`, at t0 + theta h of the last step, for which `reaction` stands."""
        end = self.mean_displacement(facets)
        if self._before is None:
            return end
        start, theta = self._mean_over(facets, self._before.displacement), self.model.scheme.theta
        return theta * end + (1.0 - theta) * start

    def reaction(self, facets: int) -> np.ndarray:
        """Mean force over the last step on the prescribed dofs of tagged facets.

        It stands for the time t0 + theta h, so compare it with `mean_displacement_of_reaction`.

        Args:
            facets: facet tag.

        Returns:
            Shape (dim,), N (2D: N/m), the force that the support exerts on the bodies.

        Raises:
            ValueError, TypeError: a tag that occurs nowhere, a periodic cell.
        """
        dim = self.model.bulk.dim
        if self.model.scene.macroscopic is not None:
            raise ValueError("A periodic cell has no supports; read `macroscopic.stress`.")
        self._require_tag(facets)
        if self.last is None:
            return np.zeros(dim)
        places, components = self.model.facets.supports(facets)
        impulses = np.bincount(components, self.last.supports.impulses[places], dim)
        return self.model.ranks.sum(impulses) / self._last_size

    def reaction_of(self, group: str) -> np.ndarray:
        """Mean force over the last step that drives or holds the rigid bodies of a group.

        Args:
            group: name of the group.

        Returns:
            Shape (dim,), N (2D: N/m): on what is prescribed, zero elsewhere.

        Raises:
            ValueError: no rigid body bears the name.
        """
        bodies, dim = self.model.scene.rigid_bodies, self.model.bulk.dim
        if bodies is None or group not in bodies.groups:
            raise ValueError(f"No rigid body is of the group {group!r}.")
        if self._rigid_reactions is None:
            return np.zeros(dim)
        forces = self._rigid_reactions.reshape(-1, 2, dim)[:, 0]
        return forces[bodies.group_of == bodies.groups.index(group)].sum(axis=0)

    def _mean_over(self, facets: int, displacement: np.ndarray) -> np.ndarray:
        self._require_tag(facets)
        bulk, ranks = self.model.bulk, self.model.ranks
        nodes, nodal = self.model.facets.nodes(facets), bulk.unknowns.expand(displacement)
        total = np.add.reduce(nodal.reshape(-1, bulk.dim).take(nodes, axis=0))
        if ranks.alone:
            return total / len(nodes)
        return ranks.sum(total) / ranks.sum(len(nodes))

    def _require_mesh(self, what: str) -> None:
        if self.model.scene.bodies is None:
            raise ValueError(
                f"A scene of rigid bodies without a mesh has no {what} to read; `rigid.state` has "
                "theirs, `reaction_of(group)` their supports' forces."
            )

    def _require_tag(self, facets: int) -> None:
        self._require_mesh(f"facet tag {facets!r}")
        require_integer("A facet tag", facets)
        tags = self.model.scene.bodies.present.facets
        if facets not in tags:
            raise ValueError(
                f"There is no facet tag {facets}; tags that there are: {sorted(tags)}."
            )
