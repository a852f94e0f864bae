# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the ranks that simulate a scene together have the same scene and options.

Each describes what it was given, as checkpoints do, and the descriptions are compared before any
work: ranks that step different scenes would wait for each other for ever, or compute nonsense.
"""

from __future__ import annotations

import hashlib
import json

from mpi4py import MPI

from xper_fx.scene.fingerprint import differences, fingerprint
from xper_fx.scene.scene import Scene
from xper_fx.simulation.options import Options
from xper_fx.support.ranks import Ranks

# Differences that an error names.
_NAMED = 3


def check_same_on_ranks(scene: Scene, options: Options, team: Ranks) -> None:
    """See that all ranks have the same scene and options, which call it together.

    Args:
        scene, options: of this rank.

    Raises:
        ValueError: on all ranks, if one of them has another scene or other options than the first,
            or if a mesh is spread over other ranks.
    """
    # a mesh that is spread is described by all its ranks together: these first
    spread = None if scene.bodies is None else scene.bodies.spread
    sizes = team.comm.allgather(1 if spread is None else spread.ranks.size)
    congruent = spread is None or (
        spread.ranks.size == team.size
        and MPI.Comm.Compare(spread.ranks.comm, team.comm) in (MPI.IDENT, MPI.CONGRUENT)
    )
    if len(set(sizes)) > 1 or not team.all(congruent):
        raise ValueError(
            f"The meshes of the ranks are spread over {sizes} ranks, and comm has {team.size}: "
            "build the mesh on the communicator of the simulation, or whole on each rank, on "
            "MPI.COMM_SELF."
        )
    here = fingerprint(scene, [0.0], options=options)
    digest = hashlib.blake2b(json.dumps(here, sort_keys=True).encode()).digest()
    if len(set(team.comm.allgather(digest))) == 1:
        return
    first = team.comm.bcast(here)
    for rank, differ in enumerate(team.comm.allgather(differences(first, here)[:_NAMED])):
        if differ:
            raise ValueError(
                f"Rank {rank} (here) has another scene or other options than rank 0: "
                f"{'; '.join(differ)}. Let all ranks build the same scene, or give each rank a "
                "simulation of its own: comm=MPI.COMM_SELF."
            )
