# SPDX-License-Identifier: LGPL-3.0-or-later
"""How large the scene of a bulk is, and how far a static step may move its bodies."""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.bulk import Bulk


def extent(bulk: Bulk) -> float:
    """Longest side of the box around the bodies of all ranks at the start (m)."""
    low, high = bulk.ranks.box(bulk.forms.bodies.mesh.geometry.x)
    return float((high - low).max())


def moved_too_far(
    bulk: Bulk, step: float, velocity: np.ndarray, given: np.ndarray, size: float
) -> float:
    """How far a static step moves a body beyond its supports (m), 0 within the scene's size.

    What nothing holds for a moment goes wherever rounding leads it, and forces balance there.

    Args:
        step: h (s).
        velocity, given: of all unknowns, and of those that are prescribed, (num_dofs,), m/s.
        size: of the scene (m).
    """
    if bulk.inertia is not None:
        return 0.0
    nodal = slice(bulk.unknowns.num_nodes * bulk.dim)  # not the gradient of a periodic cell
    far = step * np.array([np.abs(v[nodal]).max(initial=0.0) for v in (velocity, given)])
    moved, supports = bulk.ranks.max(far)
    return moved if moved > supports + size else 0.0
