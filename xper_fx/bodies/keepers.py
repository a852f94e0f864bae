# SPDX-License-Identifier: LGPL-3.0-or-later
"""What several ranks say of one number, brought together on one of them, the number's *keeper*.

No rank holds what belongs to all numbers: a keeper has those that are sent to it, and answers the
ranks that have named them.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.support.ranks import Ranks


class Keepers:
    """Numbers that ranks name, each with a keeper; ranks make it and call it together.

    Args:
        ranks: the ranks.
        numbers: shape (n,), those that this rank names, each once.
        keeper: shape (n,), the rank that keeps each, the same wherever it is named; number modulo
            the number of ranks if None.

    Attributes:
        kept: shape (m,), numbers kept here, ascending.
        num_ranks: shape (m,), how many ranks name each.
    """

    def __init__(
        self, ranks: Ranks, numbers: np.ndarray, keeper: npt.NDArray[np.integer] | None = None
    ):
        self._ranks = ranks
        to = numbers % ranks.size if keeper is None else keeper
        self._order = np.argsort(to, kind="stable")
        self._ends = np.searchsorted(to[self._order], np.arange(1, ranks.size))
        heard = self._told(numbers)
        self.kept, place, self.num_ranks = np.unique(
            np.concatenate(heard), return_inverse=True, return_counts=True
        )
        self._places = np.split(place, np.cumsum([len(named) for named in heard])[:-1])

    def _told(self, values: np.ndarray) -> list[np.ndarray]:
        """What each rank has of the numbers that this one keeps."""
        return self._ranks.comm.alltoall(np.split(values[self._order], self._ends))

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sums over the ranks, in their order, shape (m, ...).

        Args:
            values: of the numbers that this rank names, shape (n, ...).
        """
        return self._reduced(np.add, values, 0)

    def min(self, values: np.ndarray) -> np.ndarray:
        """As `sum`, the smallest of whole numbers."""
        return self._reduced(np.minimum, values, np.iinfo(values.dtype).max)

    def _reduced(self, reduce: np.ufunc, values: np.ndarray, start: float) -> np.ndarray:
        told = self._told(values)
        # a rank that has nothing may have no numbers but whole ones (bincount)
        out = np.full((len(self.kept), *values.shape[1:]), start, np.result_type(*told))
        for place, given in zip(self._places, told, strict=True):
            out[place] = reduce(out[place], given)  # a rank names a number once
        return out

    def answer(self, values: np.ndarray) -> np.ndarray:
        """What keepers have for the numbers that this rank names, shape (n, ...).

        Args:
            values: of the numbers kept here, shape (m, ...).
        """
        heard = self._ranks.comm.alltoall([values[place] for place in self._places])
        out = np.empty((len(self._order), *values.shape[1:]), values.dtype)
        out[self._order] = np.concatenate(heard)
        return out


def places_in_order(
    ranks: Ranks, values: np.ndarray, tolerance: float = 0.0
) -> tuple[npt.NDArray[np.int64], int]:
    """Place of values among those of all ranks, of which equal ones share a place.

    Each rank sorts what lies between two of the values of all: a sort by regular samples (Shi and
    Schaeffer 1992), by which no rank gets more than twice its share of values that differ.

    Args:
        ranks: the ranks, which call it together.
        values: shape (n,).
        tolerance: a value that lies no further above the next lower one counts as equal to it.

    Returns:
        Shape (n,), and the number of places.
    """
    own, inverse = np.unique(values, return_inverse=True)
    few = own[:: max(len(own) // ranks.size, 1)]
    samples = np.sort(np.concatenate(ranks.comm.allgather(few)))
    if not len(samples):
        return np.zeros(0, int), 0
    splitters = samples[len(samples) * np.arange(1, ranks.size) // ranks.size]
    keepers = Keepers(ranks, own, np.searchsorted(splitters, own, "right"))
    kept = keepers.kept
    ends = ranks.comm.allgather(kept[-1:])
    before = np.concatenate([kept[:0], *ends[: ranks.rank]])[-1:]
    new = np.ones(len(kept), bool)
    steps = np.diff(np.concatenate([before, kept])) > tolerance
    new[len(new) - len(steps) :] = steps
    count = int(np.count_nonzero(new))
    places = ranks.before(count) - 1 + np.cumsum(new)
    return keepers.answer(places)[inverse.ravel()], int(ranks.sum(count))


def places_of_points(
    ranks: Ranks, points: np.ndarray, tolerance: float
) -> tuple[npt.NDArray[np.int64], int]:
    """As `places_in_order`, of points sorted by x, then y, then z.

    Args:
        points: shape (n, dim).
        tolerance: of each coordinate.
    """
    places, count = places_in_order(ranks, points[:, 0], tolerance)
    for coordinate in points.T[1:]:
        next_places, next_count = places_in_order(ranks, coordinate, tolerance)
        places, count = places_in_order(ranks, places * next_count + next_places)
    return places, count


class JoinedNumbers:
    """Which numbers pairs join that are divided among ranks; ranks make it and call it together.

    Args:
        ranks: the ranks.
        numbers: shape (n,), those that this rank knows, ascending.
    """

    def __init__(self, ranks: Ranks, numbers: npt.NDArray[np.int64]):
        self._ranks, self._numbers = ranks, numbers
        keepers = Keepers(ranks, numbers)
        self._cut = np.flatnonzero(keepers.answer(keepers.num_ranks) > 1)
        self._keepers = Keepers(ranks, numbers[self._cut])

    def smallest(self, pairs: np.ndarray) -> npt.NDArray[np.int64]:
        """The smallest number of all that are joined with each, over all ranks, shape (n,).

        It goes from rank to rank by the numbers that several know, in as many rounds as there are
        ranks on its way, and one more.

        Args:
            pairs: shape (m, 2), places of joined numbers among those of this rank.
        """
        count = len(self._numbers)
        graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
        number, part = connected_components(graph, directed=False)
        least = np.full(number, np.iinfo(np.int64).max)
        np.minimum.at(least, part, self._numbers)
        while True:
            before = least.copy()
            keepers, cut = self._keepers, part[self._cut]
            np.minimum.at(least, cut, keepers.answer(keepers.min(least[cut])))
            if not self._ranks.max(float(np.any(least != before))):
                return least[part]
