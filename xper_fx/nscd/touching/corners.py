# SPDX-License-Identifier: LGPL-3.0-or-later
"""The corners of mesh vertices: a node of each cell there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Corners(NamedTuple):
    """Those of all vertices, numbered vertex by vertex."""

    offsets: np.ndarray  #: shape (num_vertices + 1,), first corner of each vertex
    slot: np.ndarray  #: shape (num_corners,), slot of each
    compliance: np.ndarray  #: shape (num_slots, dim), 1 / m of each slot, zero where it is driven

    def of(self, vertices: np.ndarray) -> np.ndarray:
        """Slots of the corners of some vertices, the ground's left out."""
        first, last = self.offsets[vertices], self.offsets[vertices + 1]
        ends = np.cumsum(last - first)
        slots = self.slot[np.repeat(last - ends, last - first) + np.arange(ends[-1:].sum())]
        return slots[slots < len(self.compliance) - 1]
