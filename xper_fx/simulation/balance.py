# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies are divided among ranks anew where contacts have made that worth while.

The run goes on as from a checkpoint: its state is told in the order of the scene, the model made
again for other bodies, and the state taken up.
"""

from __future__ import annotations

import numpy as np

from xper_fx.simulation.readings import Readings
from xper_fx.simulation.slot_bodies import body_of_slot


def look_at_balance(simulation: Readings, step: int) -> None:
    """See after a step, of some number, whether bodies had better be on other ranks.

    All ranks call it together.
    """
    model = simulation.model
    if not model.balance.is_due(step):
        return
    with model.stopwatch.phase("balance of ranks"):
        body, lips = body_of_slot(simulation), model.detection.lips
        contacts = [body[group.points.nodes[:, :, 0]] for group in simulation.interactions.contacts]
        contacts = np.concatenate([np.zeros((0, 2), int), *contacts])
        points, each = model.points.bodies_of_points(), model.points.points_a_facet
        gone = np.zeros(len(points), bool)
        retired = np.repeat(lips.retired, each)
        gone[: len(retired)] = retired
        model.balance.look(points[~gone], contacts, lips.search.lists.pairs_of_bodies())
