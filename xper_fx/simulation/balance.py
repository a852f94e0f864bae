# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies are divided among ranks anew where contacts have made that worth while.

The run goes on as from a checkpoint: the model is made again for other bodies, and takes up the
state. Where a mesh is whole all ranks hear of all of it; where it is spread each rank hears of the
rows that it asks for.
"""

from __future__ import annotations

import numpy as np

from xper_fx.simulation.readings import Readings
from xper_fx.simulation.slot_bodies import body_of_slot, first_rigid


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
        each = model.points.points_a_facet
        if model.scene.bodies.spread is None:
            points, retired = model.points.bodies_of_points(), np.repeat(lips.retired, each)
            near = lips.search.lists.pairs_of_bodies()
            model.balance.look(_those_that_last(points, retired), contacts, near)
            return
        points, place = model.points.bodies_of_own_points(), model.points.on_facets()[0]
        last = _those_that_last(points, lips.retired[place // max(each, 1)])
        known = lips.search.known.tables.which
        rigid = first_rigid(simulation) + np.arange(len(model.scene.rigid))
        near = np.concatenate([known, rigid])[lips.search.pairs_of_bodies()]
        model.balance.look(last, contacts, near, lambda: _middles(simulation))


def _those_that_last(points: np.ndarray, retired: np.ndarray) -> np.ndarray:
    """Bodies of points that have not retired; those on facets come first."""
    gone = np.zeros(len(points), bool)
    gone[: len(retired)] = retired
    return points[~gone]


def _middles(simulation: Readings) -> np.ndarray:
    """Middles of the rank's meshed bodies, then of all rigid ones, shape (num_bodies, dim), m."""
    bulk = simulation.bulk
    body = bulk.layout.body_of_node()
    x = bulk.forms.V.tabulate_dof_coordinates()[:, : bulk.dim]
    x = x + simulation.state.displacement.reshape(-1, bulk.dim)
    count = np.bincount(body, minlength=simulation.bodies.num_bodies)
    sums = [np.bincount(body, along, len(count)) for along in x.T]
    rigid = np.zeros((0, bulk.dim))
    if simulation.rigid is not None:
        rigid = simulation.rigid.state.position[:, : bulk.dim]
    return np.concatenate([np.stack(sums, axis=1) / count[:, None], rigid])
