# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of a table of fragments, whose bodies are on this rank or on several."""

from __future__ import annotations

import math

import numpy as np

from xper_fx.support.ranks import Ranks


class WholeRows:
    """A table of fragments that each rank has whole.

    Args:
        ranks: those that have some bodies each, or one alone.
        count: how many rows there are.
    """

    def __init__(self, ranks: Ranks, count: int):
        self._ranks, self.count, self.first = ranks, count, 0

    def total(self, label: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Sums of values over each fragment, on all ranks.

        Args:
            label: shape (n,), fragment of each value, -1 of those that do not count.
            values: shape (n, ...).
        """
        return self._ranks.sum(sums_of_rows(label, values, self.count))

    def at(self, rows: np.ndarray, label: np.ndarray) -> np.ndarray:
        """Rows of some fragments; what -1 gets means nothing."""
        return rows[label]


def sums_of_rows(label: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sums of values by their labels, of those that are not negative, shape (count, ...)."""
    kept = label >= 0
    flat = values[kept].reshape(np.count_nonzero(kept), math.prod(values.shape[1:]))
    sums = [np.bincount(label[kept], column, minlength=count) for column in flat.T]
    return np.array(sums, float).T.reshape(count, *values.shape[1:])
