# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of ties, which join nodes of any two ranks, beside those on facing facets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from xper_fx.nscd.mortar import TiedPoints
from xper_fx.parallel.shared_points import SharedPoints
from xper_fx.parallel.tied_surfaces import handed_over
from xper_fx.support.ranks import Ranks


class SharedTies(NamedTuple):
    """What is a rank's of some ties."""

    shared: SharedPoints  #: those on facing facets, with the ghosts of all
    ties: list[TiedPoints]  #: on this rank's nodes and on ghosts
    numbers: list[np.ndarray]  #: of these points, among those of all ranks


def share_ties(
    shared: SharedPoints, ties: Sequence[TiedPoints], ranks: Ranks, num_nodes: int
) -> SharedTies:
    """Give each point of a tie to one of the ranks of its bodies; all ranks call it together.

    Args:
        shared: points on facing facets, which are not solved vertex by vertex.
        ties: the points that each rank has found.
        num_nodes: nodes among this rank's unknowns; ghosts are numbered after them.
    """
    me, nothing = ranks.rank, np.zeros(0, np.int64)
    counts = [int(ranks.sum(len(tie.number))) for tie in ties]
    ties = [handed_over(tie, ranks) for tie in ties]
    of_facets = [nothing, *shared.ghosts.values()]
    step = 1 + max(int(n.max(initial=0)) for n in [*of_facets, *(tie.node for tie in ties)])
    old = np.concatenate([nothing, *(rank * step + n for rank, n in shared.ghosts.items())])
    keys = [tie.rank * step + tie.node for tie in ties]
    named = [old]
    for tie, key in zip(ties, keys, strict=True):
        lips = nothing if tie.points.lips is None else tie.points.lips.nodes.ravel()
        there = np.unique(np.concatenate([tie.points.nodes.ravel(), lips]))
        named.append(key[there][tie.rank[there] != me])
    ghosts = np.unique(np.concatenate(named))
    moved = np.concatenate([np.arange(num_nodes), num_nodes + np.searchsorted(ghosts, old)])
    rank, node = np.divmod(ghosts, step)
    wanted = {r: node[rank == r] for r in np.unique(rank).tolist()}
    told = ranks.comm.alltoall([wanted.get(r) for r in range(ranks.size)])
    first = shared.num_points_of_all + np.cumsum([0, *counts])
    return SharedTies(
        shared._replace(
            points=shared.points.on(moved),
            num_points_of_all=int(first[-1]),
            asked={r: given for r, given in enumerate(told) if given is not None},
            ghosts=wanted,
        ),
        [
            tie.on(np.where(tie.rank == me, tie.node, num_nodes + np.searchsorted(ghosts, key)))
            for tie, key in zip(ties, keys, strict=True)
        ],
        [start + tie.number for start, tie in zip(first, ties, strict=False)],
    )
