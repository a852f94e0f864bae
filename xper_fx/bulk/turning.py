# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a time scheme does where frames of points turn with their bodies.

See `nscd/turning_frames.py` for the equations.
"""

from __future__ import annotations

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State, at_nodes, on_nodes
from xper_fx.nscd.interactions import Interactions


def turn(
    interactions: Interactions,
    bulk: Bulk,
    nodes: np.ndarray,
    state: State,
    mean: np.ndarray,
    step: float,
    theta: float,
) -> None:
    """Turn frames to where a step looks, q0 + h theta v_theta.

    Args:
        interactions: the points.
        bulk: the bodies.
        nodes: the points' nodes, in the order of their slots.
        state: at the start of the step.
        mean: v_theta as far as it is known, shape (num_dofs,), m/s.
        step: h (s).
        theta: weight of the end of the step.

    Raises:
        FacetFlippedError: see `Interactions.turn`.
    """
    slots = interactions.inverse.num_slots
    velocity = at_nodes(state.velocity, nodes, bulk.dim, slots)
    motion = interactions.lip_motion(
        at_nodes(state.displacement, nodes, bulk.dim, slots),
        velocity,
        velocity if mean is state.velocity else at_nodes(mean, nodes, bulk.dim, slots),
        *bulk.macroscopic_motion(state.displacement, mean),
    )
    interactions.turn(motion, step, theta)


def couples_on(
    interactions: Interactions, nodes: np.ndarray, num_dofs: int, of_gaps: bool = False
) -> np.ndarray:
    """Impulses of the couples on all dofs, shape (num_dofs,), N s; see `Interactions.couples`."""
    return on_nodes(interactions.couples(of_gaps), nodes, num_dofs)
