# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the interaction layer asks of ranks that share points with it.

These are protocols: the layer calls them and knows nothing of MPI. `xper_fx.parallel` has the
classes that follow them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.points import InteractionPoints


class Reductions(Protocol):
    """Ranks that call everything together (`support/ranks.py`)."""

    @property
    def comm(self) -> Any:
        """Communicator, as that of mpi4py."""

    def sum(self, value: Any) -> Any:
        """Sum of numbers, or of arrays of one shape, the same bits on all ranks."""

    def max(self, value: Any) -> Any:
        """Largest of numbers, or of arrays of one shape entry by entry."""

    def sum_and_max(self, added: Any, compared: Any) -> Any:
        """Sum of the first and largest of the second; few ranks wait for each other once."""

    def all(self, condition: Any) -> bool:
        """Whether something holds on all ranks."""

    def together(self, call: Callable[[], Any]) -> Any:
        """What a call gives on this rank; what the first that fails raises is raised on all."""

    def from_first(self, call: Callable[[], Any]) -> Any:
        """What the first rank finds, on all."""


class GhostExchange(Protocol):
    """Moves entries of flat velocity arrays between slots and their ghosts on other ranks."""

    def forward(self, values: np.ndarray) -> None:
        """Let ghosts follow their owners."""

    def back(self, values: np.ndarray) -> None:
        """Let owners follow their ghosts."""


class Gathering(Protocol):
    """Moves entries between all slots and all their ghosts."""

    def forward(self, values: np.ndarray) -> None:
        """Let ghosts follow their owners."""

    def add_back(self, values: np.ndarray) -> None:
        """Add ghosts to their owners."""


class GatheringBothWays(Gathering, GhostExchange, Protocol):
    """Moves entries between all slots and all their ghosts, either way."""


class AnyHalo(Protocol):
    """What the points of one rank have to do with other ranks."""

    @property
    def ranks(self) -> Reductions:
        """The ranks."""

    @property
    def numbers(self) -> np.ndarray:
        """Number of each permanent point in the scene's order, shape (num_points,)."""

    @property
    def turns(self) -> Sequence[GhostExchange]:
        """Exchanges after the phases of a sweep, from 0 on; none where nothing is cut."""

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""

    @property
    def copies(self) -> int:
        """Of what points on all ranks move: one a rank, with that part of its mass, or 1."""

    def clear(self, values: np.ndarray) -> None:
        """Set the ghosts of a flat array over all slots to zero."""

    def add_up(self, velocity: np.ndarray) -> None:
        """Let all have the velocities to which each has added on its side, cleared before."""

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Values at all points from those at this rank's, in the scene's order, on every rank."""

    def phase_of(self, points: InteractionPoints) -> np.ndarray:
        """Phase of contacts found, 0 where all bodies are this rank's, shape (num_points,)."""


class PointHalo(AnyHalo, Protocol):
    """The halo of points between meshed bodies (`parallel/halo.py`)."""

    @property
    def everywhere(self) -> GatheringBothWays:
        """Exchange with all ranks."""

    @property
    def corners(self) -> GhostExchange:
        """Exchange of what permanent points ask for: a slot has one ghost where they do, at most.

        So it is where each vertex is on one rank.
        """

    @property
    def phase(self) -> np.ndarray:
        """Phase of each point, 0 where all bodies are this rank's, shape (num_points,)."""

    def with_ghosts(self, inverse: BodyInverse) -> BodyInverse:
        """Blocks of w of this rank and of its ghosts, as their owners have them now."""

    def renew_ghosts(self, inverse: BodyInverse) -> None:
        """The same for an inverse that has the ghosts' blocks already, in place."""

    def cut_clusters(self, interactions: Any) -> Any:
        """Clusters of facing nodes as a rank knows them (`parallel/cut_clusters.py`)."""

    def cut_nodes(self, interactions: Any, cluster: np.ndarray) -> Any:
        """Nodes of any clusters that are cut, and their exchange (`parallel/cut_clusters.py`)."""

    def whole_matrix(self, interactions: Any, fixed: np.ndarray) -> Any:
        """The matrix of Newton's method over all ranks (`parallel/whole_matrix.py`)."""

    def coupled_system(
        self,
        bulk: Any,
        prescribed: np.ndarray,
        dofs_of_slots: np.ndarray,
        interactions: Any,
        gradient: np.ndarray,
        num_common: int,
    ) -> Any:
        """Bulk and points of all ranks as one matrix (`bulk/coupled_system.py`)."""


class ContactHalo(AnyHalo, Protocol):
    """The halo of contacts of rigid bodies, which a search finds (`parallel/rigid_halo.py`)."""

    @property
    def everywhere(self) -> Gathering:
        """Exchange of the velocities of all bodies."""

    @property
    def cut(self) -> np.ndarray:
        """This rank's bodies that others move, and its ghosts."""

    def settle(self, velocity: np.ndarray) -> None:
        """Let all copies of what points on all ranks move be their mean."""


class RigidSharing(Protocol):
    """Which rigid bodies beside meshed ones a rank has (`parallel/rigid_share.py`)."""

    @property
    def here(self) -> np.ndarray:
        """Bodies with slots among this rank's own, ascending; what nothing moves is everywhere."""

    def of_all(self, rows: np.ndarray) -> np.ndarray:
        """Velocities of all bodies, shape (num_rigid, 2 dim), from those of `here`."""

    def sum(self, rows: np.ndarray) -> np.ndarray:
        """Impulses on all bodies, shape (num_rigid, 2 dim), from those this rank has on `here`."""
