# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts and vertices take turns, on one rank or on several."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import SolveOptions, SolveReport

if TYPE_CHECKING:
    from xper_fx.nscd.splitting.fused_points import FusedPoints
    from xper_fx.nscd.touching.loose_vertices import LooseVertices


def take_turns(
    interactions: Interactions,
    at: FusedPoints | LooseVertices,
    velocity: np.ndarray,
    move: Callable[[np.ndarray], SolveReport],
    options: SolveOptions,
    vertices: np.ndarray,
) -> SolveReport:
    """Solve a step in which contacts touch vertices; all ranks call it together.

    Args:
        interactions, at, velocity, move, options: as of `TouchingClusters`.
        vertices: numbers of all vertices.
    """
    if interactions.halo is None:
        from xper_fx.nscd.touching.touching_clusters import TouchingClusters as Clusters
    else:
        from xper_fx.nscd.touching.shared_clusters import SharedClusters as Clusters

    return Clusters(interactions, at, velocity, move, options).solve(vertices)
