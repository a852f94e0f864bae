# SPDX-License-Identifier: LGPL-3.0-or-later
"""The state in which a run begins: meshed bodies without displacement, with given velocities."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from dolfinx import fem

from xper_fx.bodies.explode import Bodies
from xper_fx.bulk.bulk import Bulk
from xper_fx.bulk.state import State
from xper_fx.scene.initial_velocity import Field, checked_velocity


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
    function, dim = fem.Function(bulk.forms.V), bulk.dim

    def interpolate() -> None:
        if isinstance(given, Mapping):
            for tag, field in given.items():
                function.interpolate(checked_velocity(field, dim), bodies.cell_tags.find(tag))
        elif given is not None:
            function.interpolate(checked_velocity(given, dim))

    bulk.ranks.together(interpolate)
    unknowns, rest = bulk.unknowns, np.zeros(bulk.num_dofs)
    velocity = rest.copy()
    velocity.reshape(-1, dim)[unknowns.node_of] = function.x.array.reshape(-1, dim)
    if inertia:
        bulk.start(velocity, step)
    internal = bulk.internal(rest)
    if not bulk.ranks.all(np.all(np.isfinite(internal))):
        raise ValueError(
            "Internal forces at rest are not finite: a material's response should give the "
            "stress of the start for a step of size zero."
        )
    return State(0.0, rest, velocity, internal, bulk.external(0.0))
