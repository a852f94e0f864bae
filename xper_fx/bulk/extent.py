# SPDX-License-Identifier: LGPL-3.0-or-later
"""How large the scene of a bulk is."""

from __future__ import annotations

from xper_fx.bulk.bulk import Bulk


def extent(bulk: Bulk) -> float:
    """Longest side of the box around the bodies of all ranks at the start (m)."""
    x = bulk.forms.bodies.mesh.geometry.x
    low, high = -bulk.ranks.max(-x.min(axis=0)), bulk.ranks.max(x.max(axis=0))
    return float((high - low).max())
