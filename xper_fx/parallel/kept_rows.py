# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows that ranks share, in memory, for whichever rank asks for them by their numbers."""

from __future__ import annotations

import numpy as np

from xper_fx.bodies.keepers import Keepers
from xper_fx.bodies.spread import send
from xper_fx.support.ranks import Ranks
from xper_fx.support.saved_rows import Rows


class KeptRows:
    """Rows of all ranks, each at its number's keeper: `rows[number]`, `rows[number, :3]`.

    All ranks make it and ask it together, of which each has and gets its share.

    Args:
        ranks: the ranks.
        rows: of this rank, one number a row.
    """

    def __init__(self, ranks: Ranks, rows: Rows):
        self._ranks = ranks
        heard = send(ranks, rows.number % ranks.size, rows.number, rows.values)
        number, values = map(np.concatenate, zip(*heard, strict=True))
        order = np.argsort(number, kind="stable")
        self._number, self._values = number[order], values[order]

    def __getitem__(self, key: np.ndarray | tuple) -> np.ndarray:
        number, *rest = key if isinstance(key, tuple) else (key,)
        wanted, place = np.unique(number, return_inverse=True)
        keepers = Keepers(self._ranks, wanted)
        given = self._values[np.searchsorted(self._number, keepers.kept)]
        return keepers.answer(given)[(place.reshape(number.shape), *rest)]
