# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the ranks of a run divide a scene: its meshed bodies, the contacts of rigid ones, or not."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from xper_fx.scene.scene import Scene
from xper_fx.simulation.options import Options
from xper_fx.simulation.whole_scenes import stays_whole
from xper_fx.support.profile import Stopwatch
from xper_fx.support.ranks import ALONE, Ranks

if TYPE_CHECKING:
    from xper_fx.parallel.local_bodies import LocalBodies
    from xper_fx.parallel.rigid_partition import RigidDivision


class Decomposition(NamedTuple):
    """What of a scene is this rank's.

    Attributes:
        ranks: those that divide the bodies or their contacts; this one alone where none do.
        part: what this rank has of the bodies, None if it has all.
        contacts: division of the contacts of rigid bodies, None if this rank has all.
    """

    ranks: Ranks = ALONE
    part: LocalBodies | None = None
    contacts: RigidDivision | None = None


def decomposed(scene: Scene, options: Options, team: Ranks, stopwatch: Stopwatch) -> Decomposition:
    """Divide a scene among ranks where that can be done; all ranks call it together.

    Args:
        scene: the scene.
        options: of the run.
        team: ranks that have the scene.
        stopwatch: of the run.
    """
    if team.alone:
        return Decomposition()
    touching = any(contact.law is not None for contact in scene.contacts)
    rigid_alone = scene.bodies is None and scene.lattice is None and not scene.joints
    if rigid_alone and touching and options.solver in ("auto", "nlgs"):
        from xper_fx.parallel.rigid_partition import RigidDivision

        moves = ~scene.rigid_bodies.is_prescribed.all(axis=1)
        return Decomposition(team, None, RigidDivision(team, moves, scene.dim))
    if stays_whole(scene, options, team):
        return Decomposition()
    from xper_fx.parallel.local_bodies import divide

    with stopwatch.phase("partition"):
        groups = None
        if scene.ties:
            from xper_fx.scene.tie import tied_groups

            groups = tied_groups(scene.ties, scene.bodies)
        return Decomposition(team, divide(scene.bodies, team, groups))
