# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which bodies the slots of interaction points are of."""

from __future__ import annotations

import numpy as np

from xper_fx.simulation.readings import Readings


def body_of_slot(simulation: Readings) -> np.ndarray:
    """Body of each slot, numbered as in `ContactForces.bodies`, shape (num_slots,).

    Where ranks divide meshed bodies, of this rank's slots and of its ghosts; all ranks call it
    together.
    """
    body = np.empty(0, int)
    if simulation.scene.bodies is not None:
        body = simulation.bulk.layout.body_of_node()[simulation.model.slot_nodes]
        if simulation.part is not None:
            body = simulation.scene.bodies.numbers_on_all(simulation.part.body_numbers[body])
    if simulation.rigid is not None:
        numbers = first_rigid(simulation) + np.arange(len(simulation.scene.rigid_bodies))
        numbers = numbers[rigid_here(simulation)]
        body = np.concatenate([body, np.repeat(numbers, 2)])
    if simulation.part is not None:
        spread = np.repeat(body[:, None], simulation.bulk.dim, axis=1).astype(float)
        body = simulation.interactions.halo.with_ghost_values(spread)[:, 0].astype(int)
    return body


def first_rigid(simulation: Readings) -> int:
    """Number of the first rigid body in `ContactForces.bodies`; all ranks call it together."""
    bodies = simulation.scene.bodies
    if bodies is None:
        return 0
    if bodies.spread is None:
        return bodies.num_bodies
    return 1 + int(bodies.spread.ranks.max(int(bodies.labels.max(initial=-1))))


def rigid_here(simulation: Readings) -> slice | np.ndarray:
    """Which rigid bodies have slots of their own here."""
    share = simulation.model.rigid_share
    return slice(None) if share is None else share.here
