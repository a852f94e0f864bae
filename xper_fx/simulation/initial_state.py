# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state in which a run begins: meshed bodies without displacement, with given velocities."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from dolfinx.fem import FunctionSpace

from xper_fx.bodies.explode import Bodies
from xper_fx.bodies.node_positions import node_positions
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State
from xper_fx.scene.initial_velocity import Field, velocities_at
from xper_fx.support.ranks import Ranks


def initial_state(
    bulk: Bulk,
    bodies: Bodies | None,
    given: Field | Mapping[int, Field] | None,
    step: float,
    inertia: bool,
) -> State:
    """The state at the start.

    Args:
        bulk: of the bodies.
        bodies: this rank's meshed bodies, None without a mesh.
        given: initial velocity, as of a `Scene`.
        step: h (s) at the start.
        inertia: whether bodies have mass.

    Raises:
        ValueError: velocities or internal forces at rest that are not finite, or of another shape;
            on all ranks that divide the bodies.
    """
    if bodies is None:
        none = np.zeros(0)
        return State(0.0, none, none, none)
    unknowns, rest = bulk.unknowns, np.zeros(bulk.num_dofs)
    velocity = rest.copy()
    nodal = _nodal_velocity(bulk.forms.V, bodies, given, bulk.ranks)
    velocity.reshape(-1, bulk.dim)[unknowns.node_of] = nodal
    if inertia:
        bulk.start(velocity, step)
    internal = bulk.internal(rest)
    if not bulk.ranks.all(np.all(np.isfinite(internal))):
        raise ValueError(
            "Internal forces at rest are not finite: a material's response should give the "
            "stress of the start for a step of size zero."
        )
    return State(0.0, rest, velocity, internal, bulk.external(0.0))


def _nodal_velocity(
    V: FunctionSpace, bodies: Bodies, given: Field | Mapping[int, Field] | None, ranks: Ranks
) -> np.ndarray:
    """Velocities of all nodes of V, shape (number of nodes, dim), m/s.

    Lips that are together at the start have one position, and so one velocity, to the last digit.
    """
    x, dim = node_positions(V), V.dofmap.bs
    velocity = np.zeros((len(x), dim))
    if isinstance(given, Mapping):
        for tag, field in given.items():
            nodes = np.unique(V.dofmap.list[bodies.cell_tags.find(tag)])
            velocity[nodes] = velocities_at(field, x[nodes].T, dim, ranks).T
    elif given is not None:
        velocity[:] = velocities_at(given, x.T, dim, ranks).T
    return velocity
