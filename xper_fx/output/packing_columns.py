# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the history of a run tells of its rigid bodies as a packing."""

from __future__ import annotations

import numpy as np

from xper_fx.simulation.simulation import Simulation
from xper_fx.simulation.slot_bodies import body_of_slot, first_rigid


def packing_columns(simulation: Simulation) -> dict[str, float]:
    """Contacts that push, coordination and overlap after the last step.

    All ranks call it together.

    Args:
        simulation: of rigid bodies whose contacts are searched.

    Returns:
        `contacts`, points that pushed; `coordination`, how many others a rigid body that can move
        is pushed by on average; `overlap`, the largest depth of a contact (m).
    """
    bodies, interactions = simulation.scene.rigid_bodies, simulation.interactions
    body = body_of_slot(simulation)
    first = first_rigid(simulation)
    free = ~bodies.is_prescribed.all(axis=1)
    pushing, overlap, pairs = 0, 0.0, [np.empty((0, 2), int)]
    for group in interactions.contacts:
        pushes = group.impulse[:, 0] > 0.0
        pushing += int(np.count_nonzero(pushes))
        overlap = max(overlap, -float(group.jump[:, 0].min(initial=0.0)))
        pairs.append(body[group.points.nodes[pushes][:, :, 0]])
    member = np.unique(np.concatenate(pairs), axis=0).ravel() - first
    member = member[member >= 0]
    pushed, pushing = interactions.total(np.array([free[member].sum(), pushing], float)).tolist()
    return {
        "contacts": pushing,
        "coordination": pushed / max(int(free.sum()), 1),
        "overlap": interactions.largest(overlap),
    }
