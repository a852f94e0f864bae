# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which runs let cells that initially rigid bonds hold move as one, and how they start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.bulk.state import State
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.law import Law
from xper_fx.scene.scene import Scene
from xper_fx.support.ranks import Ranks


def bonds_split(scene: Scene) -> bool:
    """Whether there are initially rigid bonds, at vertices that split where each is alone."""
    if scene.bodies is None:
        return False
    laws, _ = scene.law_of_facet()
    return any(getattr(law.kernels(scene.dim), "rigid", None) for law in laws)


def touched_by_vertex(scene: Scene, sweeps: bool, ranks: Ranks) -> bool:
    """Whether an explicit bulk that contacts touch solves its vertices alone.

    So it does where bonds are at its facets. Contacts without these are swept alone as it is.

    Args:
        sweeps: whether bonds that are not initially rigid are swept with the contacts.
        ranks: those that divide the scene.
    """
    if scene.bodies is None or bonds_split(scene):
        return True
    _, law_of_facet = scene.law_of_facet()
    return not sweeps and ranks.max(float(np.any(law_of_facet >= 0))) > 0.0


def condenses(scene: Scene, laws: Sequence[Law]) -> bool:
    """Whether cells share unknowns in one system: rigid bonds join one node with another.

    Args:
        laws: of its points.
    """
    nodal = scene.points == "nodal" and not scene.ties
    return nodal and any(law.kernels(scene.dim).rigid for law in laws)


def share_motions(
    points: Interactions, nodes: np.ndarray, prescribed: np.ndarray, start: State
) -> None:
    """Let cells that are one start as one, and split vertices at which bonds hold the ground.

    Args:
        points: whose vertices split.
        nodes: the node that each slot of the points is, shape (n,).
        prescribed: shape (num_dofs,), bool, dofs whose motion is given.
        start: the state at the start, whose velocities change.
    """
    from xper_fx.bulk.shared_motion import motion_of_whole_vertices

    points.fused.wake(points.fused.grounded())
    shared = motion_of_whole_vertices(points, nodes, prescribed)
    start.velocity = shared.together(start.velocity)
