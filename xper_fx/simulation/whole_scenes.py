# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes whose meshed bodies ranks do not divide: each rank simulates the whole."""

from __future__ import annotations

import logging

from xper_fx.bodies.meshes import SerialOnlyError
from xper_fx.scene.scene import Scene
from xper_fx.simulation.options import Options
from xper_fx.support.ranks import Ranks

logger = logging.getLogger(__name__)

# Solvers of ranks that divide the bodies.
_ON_RANKS = ("auto", "nlgs", "newton", "accelerated")


def stays_whole(scene: Scene, options: Options, team: Ranks) -> bool:
    """Whether each rank has to simulate all of a scene; warns of it, and says why.

    Raises:
        SerialOnlyError: it has to, and the mesh is spread over the ranks.
    """
    why = [
        name
        for name, there in (
            ("rigid bodies", scene.rigid_bodies is not None),
            ("a lattice of rigid bodies", scene.lattice is not None),
            ("contacts that are searched", len(scene.contacts) > 0),
            ("ties", scene.ties and _cannot_tie(scene, team.size)),
            ("joints", len(scene.joints) > 0),
            ("no inertia", not options.inertia),
            ("a solver for one rank", options.solver not in _ON_RANKS),
            ("no facets between bodies", scene.bodies and not scene.bodies.present.facing),
        )
        if there
    ]
    if why and scene.bodies is not None and scene.bodies.spread is not None:
        raise SerialOnlyError(
            f"The mesh is spread over {team.size} ranks, and a scene that has {' and '.join(why)} "
            "is simulated whole: build the mesh on MPI.COMM_SELF."
        )
    if why and team.rank == 0:
        logger.warning(
            "each of %d ranks simulates the whole scene, as it has %s", team.size, " and ".join(why)
        )
    return bool(why)


def _cannot_tie(scene: Scene, num_ranks: int) -> bool:
    """Whether bodies that ties keep on one rank leave a rank without any."""
    from xper_fx.scene.tie import tied_groups

    return int(tied_groups(scene.ties, scene.bodies).max()) + 1 < num_ranks
