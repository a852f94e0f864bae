# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tied surfaces of several ranks: what a rank is given of those of others, and points handed over.

A rank finds the points on its own candidates. All ranks tell each other one box around the
candidates and one around the antagonists of each, then the boxes of the candidates that overlap
another rank's antagonists, and each gives the others those of its antagonists whose boxes overlap
some of theirs, with the facets around the nodes of these, with which frames turn. Nothing has the
size of the whole. A point then goes to the rank that has it (`ownership.owners_of_pairs`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from xper_fx.nscd.facets import join_points
from xper_fx.nscd.mortar import MisfitError, TiedPoints, TiedSurface
from xper_fx.nscd.search.grid import box_pairs
from xper_fx.parallel.ownership import owners_of_pairs
from xper_fx.support.ranks import Ranks

# Width of what is in reach around a facet, as a share of its size: far more than what surfaces
# that coincide are apart.
_AROUND = 1e-2


def in_reach(candidates: TiedSurface, antagonists: TiedSurface, ranks: Ranks) -> TiedSurface:
    """Antagonists of all ranks that this rank's candidates may face; ranks call it together."""
    low, high = _boxes(candidates)
    low_there, high_there = _boxes(antagonists)
    of_ranks = ranks.comm.allgather(_around(low_there, high_there))
    told = []
    for least, most in of_ranks:
        near = (low <= most).all(axis=1) & (least <= high).all(axis=1)
        told.append((low[near], high[near]))
    given = []
    for low, high in ranks.comm.alltoall(told):
        near = np.zeros(0, int)
        if len(low) and len(low_there):
            near = box_pairs(low_there, high_there, low, high)[:, 0]
        there = np.isin(antagonists.number, antagonists.number[near]).any(axis=1)
        given.append(antagonists.take(np.flatnonzero(there)))
    got = ranks.comm.alltoall(given)
    return TiedSurface(*map(np.concatenate, zip(*got, strict=True)))


def fitting(ranks: Ranks, find: Callable[[], TiedPoints]) -> TiedPoints:
    """What `find` gives on this rank; ranks call it together.

    Raises:
        MisfitError: on all ranks, of the places of all.
    """

    def found() -> TiedPoints | MisfitError:
        try:
            return find()
        except MisfitError as error:
            return error

    given = ranks.together(found)
    told = ranks.comm.allgather(given if isinstance(given, MisfitError) else None)
    misfits = [error for error in told if error is not None]
    if misfits:
        kind, first, _, text = min(error.args for error in misfits)
        count = sum(error.count for error in misfits if error.kind == kind)
        raise MisfitError(kind, first, count, text)
    return given


def _boxes(surface: TiedSurface) -> tuple[np.ndarray, np.ndarray]:
    """Low and high corners of what is in reach of each facet, each of shape (num_facets, dim)."""
    low, high = surface.x.min(axis=1), surface.x.max(axis=1)
    beyond = _AROUND * np.linalg.norm(high - low, axis=1, keepdims=True)
    return low - beyond, high + beyond


def _around(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return low.min(axis=0, initial=np.inf), high.max(axis=0, initial=-np.inf)


def handed_over(tie: TiedPoints, ranks: Ranks) -> TiedPoints:
    """The points that this rank has, of those that all have found; ranks call it together."""
    owner = owners_of_pairs(tie.rank[tie.points.nodes[:, :, 0]])
    given = [_compact(tie.take(np.flatnonzero(owner == rank))) for rank in range(ranks.size)]
    parts, moved, first = ranks.comm.alltoall(given), [], 0
    for part in parts:
        moved.append(part.points.on(first + np.arange(len(part.node))))
        first += len(part.node)
    columns = map(np.concatenate, zip(*(part[1:] for part in parts), strict=True))
    whole = TiedPoints(join_points(moved), *columns)
    return whole.take(np.argsort(whole.number))


def _compact(tie: TiedPoints) -> TiedPoints:
    """The same with no nodes but those of the points."""
    points, lips = tie.points, tie.points.lips
    named = [points.nodes.ravel()] + ([] if lips is None else [lips.nodes.ravel()])
    used = np.unique(np.concatenate(named))
    place = np.zeros(len(tie.node), np.int32)
    place[used] = np.arange(len(used))
    return tie.on(place)._replace(node=tie.node[used], rank=tie.rank[used])
