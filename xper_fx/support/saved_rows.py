# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays as they are saved: in an order that no process, and no number of processes, decides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np


class Rows(NamedTuple):
    """Rows of an array, and the numbers that they are known by all over a scene.

    What is saved are the rows by ascending number, so that who holds the rows `number` takes
    `saved[number]` where the numbers are those from zero on.

    Attributes:
        number: shape (n,), or (n, m) for keys of m numbers, of which the first counts most.
        values: shape (n, ...).
    """

    number: np.ndarray
    values: np.ndarray

    def in_order(self) -> np.ndarray:
        """The values by ascending number."""
        keys = self.number if self.number.ndim == 2 else self.number[:, None]
        return self.values[np.lexsort(keys.T[::-1])]


def in_order(saved: Mapping) -> dict:
    """What was saved, with arrays in the place of `Rows`, where one process has them all."""
    return {n: value.in_order() if isinstance(value, Rows) else value for n, value in saved.items()}


class KeepsNothing:
    """What a restarted run makes anew, so that nothing of it is saved."""

    def saved(self) -> dict:
        """Nothing."""
        return {}

    def restore(self, saved: Mapping) -> None:
        """Nothing to restore."""
