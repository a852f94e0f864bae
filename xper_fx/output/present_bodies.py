# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies as a run has left them, to go into another scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid.body import RigidBody
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_kind


def rigid_bodies_now(simulation: Simulation) -> list[RigidBody]:
    """The rigid bodies of a scene where they are and as they move at the present time.

    They make another scene: with other loads or laws, with bodies left out or added. Its time
    begins at 0; prescribed velocities, forces and torques that are functions of time go on from the
    present one. Whole turns are left out of angles. Contacts begin anew, without the impulses that
    they had. What bodies overlap by, as impacts leave it, `Scene(resolve_overlaps=True)` takes
    away.

    Those of a periodic cell lie in the cell at the origin, and have the fluctuation of their
    velocities: the lattice of another scene with them is `lattice @ Fbar.T` of its rows.

    Args:
        simulation: with rigid bodies.

    Returns:
        New bodies, in the order of the scene.

    Raises:
        TypeError: no simulation.
        ValueError: a scene without rigid bodies.
    """
    require_kind("simulation", simulation, Simulation)
    if simulation.rigid is None:
        raise ValueError("The scene has no rigid bodies.")
    state, now = simulation.rigid.displayed, simulation.time
    velocity = simulation.rigid.fluctuation

    def later(given: Any) -> Any:
        return _later(given, now) if callable(given) else given

    bodies = []
    for number, body in enumerate(simulation.scene.rigid):
        turn, spin = state.turn.rotation[number], state.turn.spin[number]
        if simulation.scene.dim == 2:
            turned = {"angle": math.remainder(turn.item(), 2.0 * math.pi), "spin": spin.item()}
        else:
            turned = {"rotation": Rotation.from_matrix(turn), "spin": spin.copy()}
        bodies.append(
            replace(
                body,
                position=state.position[number].copy(),
                velocity=velocity[number].copy(),
                prescribed={dof: later(motion) for dof, motion in body.prescribed.items()},
                force=later(body.force),
                torque=later(body.torque),
                **turned,
            )
        )
    return bodies


def _later(function: Callable[[float], Any], start: float) -> Callable[[float], Any]:
    return lambda time: function(start + time)
