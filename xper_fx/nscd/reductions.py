# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks that share points agree on, so that all of them decide alike.

Where one rank has all points, values are what they are.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.interactions import Interactions


def total(interactions: Interactions, value):
    """Sum over all ranks of numbers, or of arrays of one shape; the same bits on each of them."""
    return value if interactions.halo is None else interactions.halo.ranks.sum(value)


def largest(interactions: Interactions, value):
    """Largest over all ranks of numbers, or of arrays of one shape entry by entry."""
    return value if interactions.halo is None else interactions.halo.ranks.max(value)


def everywhere(interactions: Interactions, condition) -> bool:
    """Whether something holds on all ranks."""
    return bool(condition) if interactions.halo is None else interactions.halo.ranks.all(condition)


def refresh_ghosts(interactions: Interactions, velocity: np.ndarray) -> None:
    """Let ghosts follow their owners; `velocity` has shape (num_slots * dim,)."""
    if interactions.halo is not None:
        interactions.halo.everywhere.forward(velocity)
