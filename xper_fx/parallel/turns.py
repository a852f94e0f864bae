# SPDX-License-Identifier: LGPL-3.0-or-later
"""In which order ranks sweep over points at bodies of several ranks.

A body may be moved by one rank at a time. A sweep has *phases*: points whose bodies are all of one
rank are of phase 0, which all ranks sweep at once; the others are *cut*, and of phases from 1 on.
In each phase a body is moved by one rank at most, the *holder*, which need not be its *home*. A
body of which one rank has all cut points is not disputed: its points are of phase 1 but for those
that they share with a disputed body. Points at disputed bodies, which lie where three ranks meet
or more, take the first phase in which nobody else holds one of their bodies (a greedy colouring).

Between its visits a body goes straight from one holder to the next, and home before phase 0:

    home (0) -> first holder (p1) -> second holder (p2) -> ... -> home (0),

so that a sweep of n phases has n + 1 exchanges with all neighbours at once, one after each phase
(`hand_overs`). In the plane n is mostly 2 or 3, however many ranks a rank has around it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.nscd.ordering import LAST_COLOR, greedy_colors
from xper_fx.support.ranks import Ranks


class Visits(NamedTuple):
    """When which rank holds a unit: a body, or one of its blocks of w."""

    unit: np.ndarray  #: shape (n,)
    phase: np.ndarray  #: shape (n,), from 1
    holder: np.ndarray  #: shape (n,), rank

    def joined(self, more: Visits) -> Visits:
        """These and others."""
        return Visits(*map(np.concatenate, zip(self, more, strict=True)))


_NONE = np.zeros(0, np.int64)
NO_VISITS = Visits(_NONE, _NONE, _NONE)


class HandOvers(NamedTuple):
    """Which units go from whom to whom after which phase."""

    unit: np.ndarray  #: shape (n,)
    after: np.ndarray  #: shape (n,), phase
    giver: np.ndarray  #: shape (n,), rank
    taker: np.ndarray  #: shape (n,), rank


def phases_of_rows(units: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Phase of each row of cut points, if all rows at disputed units are among them.

    Args:
        units: shape (n, m), units that the points of a row act on, -1 for none, names >= 0.
        owner: shape (n,), rank that sweeps it.

    Returns:
        Shape (n,), from 1.
    """
    phase = np.ones(len(units), np.int64)
    disputed = _disputed(units, owner)
    rows = np.flatnonzero(np.isin(units, disputed).any(axis=1))
    if not len(rows):
        return phase
    units, owner = units[rows], owner[rows]
    # what one rank sweeps and hangs together through units is one item, and has one phase
    row, column = np.nonzero(units >= 0)
    held = np.column_stack([units[row, column], owner[row]])
    held, place = np.unique(held, axis=0, return_inverse=True)
    place = place.ravel()
    first = np.searchsorted(row, row)
    edges = coo_array((np.ones(len(row)), (place, place[first])), shape=(len(held), len(held)))
    count, item = connected_components(edges, directed=False)
    order = np.argsort(item, kind="stable")
    names, member = np.unique(held[order, 0], return_inverse=True)
    offsets = np.concatenate([[0], np.cumsum(np.bincount(item, minlength=count))])
    color = greedy_colors(offsets, member.ravel().astype(np.int32), len(names), -1)
    crowded = color == LAST_COLOR
    color[crowded] += np.arange(np.count_nonzero(crowded))
    phase[rows] += color[item[place[np.searchsorted(row, np.arange(len(rows)))]]]
    return phase


def _disputed(units: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Units at which several ranks sweep."""
    held = np.column_stack([units.ravel(), np.repeat(owner, units.shape[1])])
    names, counts = np.unique(np.unique(held[held[:, 0] >= 0], axis=0)[:, 0], return_counts=True)
    return names[counts > 1]


def hand_over_rows(visits: Visits, home: np.ndarray) -> HandOvers:
    """The way of each unit from holder to holder and home.

    Args:
        visits: all those of some units.
        home: shape (n,), rank of the unit of each visit.
    """
    unit, first = np.unique(visits.unit, return_index=True)
    at_home = Visits(unit, np.zeros(len(unit), np.int64), home[first])
    unit, phase, rank = visits.joined(at_home)
    order = np.lexsort((phase, unit))
    unit, phase, rank = unit[order], phase[order], rank[order]
    following = np.arange(1, len(unit) + 1)
    last = np.append(unit[1:] != unit[:-1], True)[: len(unit)]
    following[last] = np.searchsorted(unit, unit[last])
    taker = rank[following]
    goes = taker != rank
    return HandOvers(unit[goes], phase[goes], rank[goes], taker[goes])


def divide_in_phases(
    ranks: Ranks, units: np.ndarray, homes: np.ndarray
) -> tuple[np.ndarray, Visits]:
    """Give the cut points of all ranks phases; all ranks call it together.

    Each home is told who visits its units and says which are disputed; rows at these alone, few as
    they are, are told to all ranks, each of which colours them.

    Args:
        units: shape (n, m), as of `phases_of_rows`, of the rows of this rank.
        homes: shape (n, m), ranks of these units.

    Returns:
        Phase of each row, shape (n,), and the visits to this rank's units.
    """
    there = units >= 0
    named = np.unique(np.column_stack([homes[there], units[there]]), axis=0)
    told = _by_rank(named[:, 0], ranks.size)
    heard = ranks.comm.alltoall([named[rows, 1] for rows in told])
    holder = np.repeat(np.arange(ranks.size), [len(names) for names in heard])
    disputed = _disputed(np.concatenate(heard)[:, None], holder)
    answers = ranks.comm.alltoall([np.isin(names, disputed) for names in heard])
    disputed = np.concatenate(
        [named[rows, 1][which] for rows, which in zip(told, answers, strict=True)]
    )
    rows = np.flatnonzero(np.isin(units, disputed).any(axis=1))
    told_all = ranks.comm.allgather(units[rows])
    owner = np.repeat(np.arange(ranks.size), [len(part) for part in told_all])
    phase = np.ones(len(units), np.int64)
    phase[rows] = phases_of_rows(np.concatenate(told_all), owner)[owner == ranks.rank]
    visits = np.column_stack(
        [homes[there], units[there], np.broadcast_to(phase[:, None], units.shape)[there]]
    )
    visits = np.unique(visits, axis=0)
    got = ranks.comm.alltoall([visits[rows, 1:] for rows in _by_rank(visits[:, 0], ranks.size)])
    unit, at = np.concatenate(got).T
    return phase, Visits(unit, at, np.repeat(np.arange(ranks.size), [len(part) for part in got]))


def hand_overs(
    ranks: Ranks, visits: Visits, name: np.ndarray
) -> list[tuple[dict[int, np.ndarray], dict[int, np.ndarray]]]:
    """What this rank gives and takes after each phase; all ranks call it together.

    Args:
        visits: to units of which this rank is the home.
        name: shape (n,), what all ranks call the unit of each visit.

    Returns:
        After phases 0, 1, ...: names of units given and taken, ascending, by rank. Empty where no
        rank has visits.
    """
    count = int(ranks.max(int(visits.phase.max(initial=0))))
    if count == 0:
        return []
    ways = hand_over_rows(visits._replace(unit=name), np.full(len(name), ranks.rank))
    rows = np.column_stack(ways)
    of_giver, of_taker = (_by_rank(who, ranks.size) for who in (ways.giver, ways.taker))
    got = ranks.comm.alltoall(
        [rows[np.concatenate(both)] for both in zip(of_giver, of_taker, strict=True)]
    )
    rows = np.concatenate(got)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    steps = []
    for phase in range(count + 1):
        unit, _, giver, taker = rows[rows[:, 1] == phase].T
        steps.append(
            tuple(
                {int(r): unit[ours & (other == r)] for r in np.unique(other[ours])}
                for ours, other in ((giver == ranks.rank, taker), (taker == ranks.rank, giver))
            )
        )
    return steps


class PhasesOfPairs(NamedTuple):
    """Phases of contacts between bodies of two ranks."""

    names: np.ndarray  #: of bodies, ascending
    keys: np.ndarray  #: of pairs, ascending
    phase: np.ndarray  #: of these pairs

    @classmethod
    def of(cls, pairs: np.ndarray, phase: np.ndarray) -> PhasesOfPairs:
        """Of pairs of names of bodies, shape (n, 2)."""
        names, place = np.unique(pairs, return_inverse=True)
        place = np.sort(place.reshape(-1, 2), axis=1)
        keys, first = np.unique(place @ [len(names), 1], return_index=True)
        return cls(names, keys, phase[first])

    def __call__(self, pairs: np.ndarray) -> np.ndarray:
        """Phase of contacts between pairs, shape (n,); 0 of a pair that is not known."""
        if not len(self.keys):
            return np.zeros(len(pairs), np.int64)
        place = np.minimum(np.searchsorted(self.names, pairs), len(self.names) - 1)
        known = (self.names[place] == pairs).all(axis=1)
        keys = np.sort(place, axis=1) @ [len(self.names), 1]
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(known & (self.keys[place] == keys), self.phase[place], 0)


def _by_rank(rank: np.ndarray, size: int) -> list[np.ndarray]:
    """Which entries are of rank 0, 1, ..."""
    order = np.argsort(rank, kind="stable")
    return np.split(order, np.searchsorted(rank[order], np.arange(1, size)))
