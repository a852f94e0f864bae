# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of fragments and rows of their table, where ranks have some bodies each.

Of a mesh that is spread over ranks no rank knows all fragments. One is found as the smallest number
of a body in it; the keeper of that number adds up its mass. The table is divided: the heaviest
fragments are on the first rank, and so on.
"""

from __future__ import annotations

import math

import numpy as np

from xper_fx.bodies.keepers import JoinedNumbers, Keepers, places_in_order
from xper_fx.support.ranks import Ranks


def number_fragments(
    ranks: Ranks, numbers: np.ndarray, pairs: np.ndarray, mass: np.ndarray, digits: int
) -> np.ndarray:
    """The fragment of each body, by masses as `find_fragments`; all ranks call it together.

    Args:
        numbers: shape (n,), bodies that this rank knows, ascending.
        pairs: shape (m, 2), places in `numbers` of bodies that hang together, each on some rank.
        mass: shape (n,), of each body; zero but on one rank.
        digits: to which masses are told apart, as shares of that of all.
    """
    roots, place = np.unique(JoinedNumbers(ranks, numbers).smallest(pairs), return_inverse=True)
    keepers = Keepers(ranks, roots)
    weight = keepers.sum(np.bincount(place, mass, minlength=len(roots)))
    weight = weight / max(ranks.sum(float(weight.sum())), np.finfo(float).tiny)
    heavier, _ = places_in_order(ranks, -np.round(weight, digits))
    beyond = 1 + int(ranks.max(float(numbers.max(initial=0))))
    rank, _ = places_in_order(ranks, heavier * beyond + keepers.kept)
    return keepers.answer(rank).astype(np.int32)[place]


class WholeRows:
    """A table of fragments that each rank has whole.

    Args:
        ranks: those that have some bodies each, or one alone.
        count: how many rows there are.
    """

    def __init__(self, ranks: Ranks, count: int):
        self._ranks, self.count, self.first = ranks, count, 0

    def total(self, label: np.ndarray, values: np.ndarray) -> np.ndarray:
        """As of `DividedRows`."""
        return self._ranks.sum(_sums(label, values, self.count))

    def at(self, rows: np.ndarray, label: np.ndarray) -> np.ndarray:
        """As of `DividedRows`."""
        return rows[label]


class DividedRows:
    """A table of fragments of which each rank has some rows.

    Args:
        ranks: the ranks, which make it and call it together.
        fragment: those that have something on this rank; -1 is none.

    Attributes:
        count: how many rows all ranks have.
        first: the first of this rank's, which follow each other.
    """

    def __init__(self, ranks: Ranks, fragment: np.ndarray):
        self._here = np.unique(fragment[fragment >= 0]).astype(np.int64)
        self.count = 1 + int(ranks.max(float(self._here.max(initial=-1))))
        self._keepers = Keepers(ranks, self._here, self._here * ranks.size // self.count)
        self.first = ranks.before(len(self._keepers.kept))

    def total(self, label: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Sums of values over each fragment of the rows here, on all ranks.

        Args:
            label: shape (n,), fragment of each value, -1 of those that do not count.
            values: shape (n, ...).
        """
        place = np.where(label < 0, -1, np.searchsorted(self._here, label))
        return self._keepers.sum(_sums(place, values, len(self._here)))

    def at(self, rows: np.ndarray, label: np.ndarray) -> np.ndarray:
        """Of the rows of all ranks those of some fragments; what -1 gets means nothing."""
        here = self._keepers.answer(rows)
        return here[np.where(label < 0, -1, np.searchsorted(self._here, label))]


def _sums(label: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    kept = label >= 0
    flat = values[kept].reshape(np.count_nonzero(kept), math.prod(values.shape[1:]))
    sums = [np.bincount(label[kept], column, minlength=count) for column in flat.T]
    return np.array(sums).T.reshape(count, *values.shape[1:])
