# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a time scheme does where frames of points turn with their bodies.

See `nscd/turning_frames.py` for the equations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State, at_nodes, on_nodes
from xper_fx.nscd.interactions import Interactions


def turn(
    interactions: Interactions,
    bulk: Bulk,
    nodes: np.ndarray | None,
    state: State,
    mean: np.ndarray,
    step: float,
    theta: float,
    stays: bool = False,
) -> None:
    """Turn frames to where a step looks, q0 + h theta v_theta.

    Args:
        bulk: the bodies.
        nodes: the points' nodes, in the order of their slots; None if slots are all nodes in order.
        state: at the start of the step.
        mean: v_theta as far as it is known, shape (num_dofs,), m/s.
        step: h (s).
        theta: weight of the end of the step.
        stays: see `Interactions.turn`.

    Raises:
        FacetFlippedError: see `Interactions.turn`.
    """
    values = [state.displacement, state.velocity]
    values += [] if mean is state.velocity else [mean]
    count = len(values[0]) // bulk.dim
    if nodes is not None or not interactions.turn_on_nodes(count):
        slots = interactions.inverse.num_slots
        nodes = np.arange(count) if nodes is None else nodes
        values = [at_nodes(v, nodes, bulk.dim, slots) for v in values]
    motion = interactions.lip_motion(
        values[0], values[1], values[-1], *bulk.macroscopic_motion(state.displacement, mean)
    )
    interactions.turn(motion, step, theta, stays)


def couples_on(
    interactions: Interactions,
    nodes: np.ndarray,
    num_dofs: int,
    impulses: Sequence[np.ndarray] | None = None,
) -> np.ndarray:
    """Impulses of the couples on all dofs, shape (num_dofs,), N s; see `Interactions.couples`.

    Those of Fbar, column after column, come last.
    """
    out = on_nodes(interactions.couples(impulses=impulses), nodes, num_dofs)
    of_cell = interactions.couples_of_cell()
    if of_cell.size:
        out[-of_cell.size :] = of_cell.T.ravel()
    return out
