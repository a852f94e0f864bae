# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of walls, each on the rank of its body or on that of the vertex at which it is."""

from __future__ import annotations

import numpy as np

from xper_fx.parallel.shared_points import SharedPoints
from xper_fx.support.ranks import Ranks


def share_wall(
    shared: SharedPoints,
    ranks: Ranks,
    num_nodes: int,
    by_vertex: bool,
    wall: tuple[np.ndarray, ...],
) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Give points on a wall to the ranks that have them; all ranks call it together.

    Args:
        shared: this rank's points on facing facets.
        num_nodes: nodes among this rank's unknowns; ghosts are numbered after them.
        by_vertex: whether all points that meet at a vertex shall be on one rank.
        wall: arrays over this rank's points. The first has numbers, no two of them the same on any
            ranks, that tell their order in the scene; the second their nodes.

    Returns:
        Arrays over the points that this rank has, and their numbers among those of all ranks.
    """
    told: list = [None] * ranks.size
    stays, nodes = np.ones(len(wall[1]), bool), wall[1]
    for rank, asked in shared.asked.items() if by_vertex else ():
        at_points = asked if shared.at_points is None else asked[shared.at_points[0][rank]]
        gone = np.flatnonzero(np.isin(nodes, at_points))
        place = np.searchsorted(asked, nodes[gone])  # they are ascending
        told[rank] = (wall[0][gone], place, *(array[gone] for array in wall[2:]))
        stays[gone] = False
    parts, first = [tuple(array[stays] for array in wall)], num_nodes
    for rank, got in enumerate(ranks.comm.alltoall(told)):
        if got is not None:
            parts.append((got[0], first + got[1], *got[2:]))
        first += len(shared.ghosts.get(rank, ()))
    wall = tuple(map(np.concatenate, zip(*parts, strict=True)))
    order = np.argsort(wall[0])
    wall = tuple(array[order] for array in wall)
    of_all = np.sort(np.concatenate(ranks.comm.allgather(wall[0])))
    return wall, np.searchsorted(of_all, wall[0])
