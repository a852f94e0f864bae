# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monolithic runs in which cells share unknowns where initially rigid bonds hold them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from xper_fx.nscd.laws.law import Law

if TYPE_CHECKING:
    from xper_fx.simulation.model import Model


def condenses(model: Model, laws: Sequence[Law]) -> bool:
    """Whether cells share unknowns: of nodal points on one rank, which join a node to a node.

    Args:
        model: whose solver is known.
        laws: of its points.
    """
    scene = model.scene
    nodal = scene.points == "nodal" and not scene.ties
    rigid = any(law.kernels(scene.dim).rigid for law in laws)
    return model.monolithic and nodal and model.part is None and rigid


def share_motions(model: Model) -> None:
    """Let cells that are one start as one, and split vertices at which bonds hold the ground.

    Args:
        model: with points whose vertices split.
    """
    from xper_fx.bulk.shared_motion import motion_of_whole_vertices

    points, prescribed = model.interactions, model.bulk.layout.prescribed
    points.fused.wake(points.fused.grounded())
    shared = motion_of_whole_vertices(points, model.slot_nodes, prescribed)
    model.start.velocity = shared.together(model.start.velocity)
