# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which runs are solved with bulk and interactions in one system, where the solver is picked."""

from __future__ import annotations

from xper_fx.bulk.bulk import Bulk
from xper_fx.scene.scene import Scene
from xper_fx.simulation.options import Options
from xper_fx.simulation.permanent_points import ScenePoints
from xper_fx.simulation.shared_motions import condenses


def takes_one_system(
    options: Options, scene: Scene, points: ScenePoints, searched: bool, bulk: Bulk
) -> bool:
    """Whether one system is asked for, or better than points on their bodies where that is open.

    Static runs are with bodies that only their interactions hold, or bonds that may break. Contacts
    between bodies that are held by themselves are few unknowns beside those of the bulk. Dynamic
    ones are where initially rigid bonds leave cells one mesh until they open: sweeps have points
    everywhere.

    Args:
        options, scene: of the run.
        points: of the scene, those that searches find left out.
        searched: whether contacts are searched.
        bulk: of this rank.
    """
    if options.asks_for_one_system:
        return True
    if not options.allows_one_system or not (points.exist or searched):
        return False
    if options.inertia and options.requested.accuracy is not None:
        return False  # snap numbers are told from points on their bodies
    if options.inertia:
        alone = scene.rigid_bodies is None and not searched and bulk.ranks.alone
        return alone and condenses(scene, points.laws)
    breaks = any(hasattr(law, "in_statics") for law in points.laws)
    return bulk.floating or breaks or options.path is not None
