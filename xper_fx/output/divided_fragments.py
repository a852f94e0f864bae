# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of fragments of a mesh that is spread over ranks, and rows of their table.

No rank knows all fragments. One is found as the smallest number
of a body in it; the keeper of that number adds up its mass. The table is divided: the heaviest
fragments are on the first rank, and so on.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bodies.keepers import JoinedNumbers, Keepers, places_in_order
from xper_fx.output.fragment_rows import sums_of_rows
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


class DividedRows:
    """A table of fragments of which each rank has some rows, with the methods of `WholeRows`.

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
        """As of `WholeRows`, of the rows of this rank."""
        place = np.where(label < 0, -1, np.searchsorted(self._here, label))
        return self._keepers.sum(sums_of_rows(place, values, len(self._here)))

    def at(self, rows: np.ndarray, label: np.ndarray) -> np.ndarray:
        """As of `WholeRows`, of the rows of all ranks."""
        here = self._keepers.answer(rows)
        here = np.concatenate([here, np.zeros_like(here, shape=(1, *here.shape[1:]))])  # of none
        return here[np.where(label < 0, -1, np.searchsorted(self._here, label))]
