# SPDX-License-Identifier: LGPL-3.0-or-later
"""Polygons that are extruded into polyhedra."""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.rigid.polyhedron import Polyhedron


def prism(base: np.ndarray, along: np.ndarray) -> Polyhedron:
    """A right prism.

    Args:
        base: corners of one end, counter-clockwise seen from outside, shape (n, 3), m.
        along: from this end to the other, shape (3,), m.
    """
    n = len(base)
    first = np.arange(n)
    after = np.roll(first, -1)
    sides = np.column_stack([after, first, n + first, n + after])
    return Polyhedron(np.concatenate([base, base + along]), [first, n + first[::-1], *sides])
