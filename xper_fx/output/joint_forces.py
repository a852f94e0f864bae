# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces and moments in joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_kind


class JointForces(NamedTuple):
    """What the joints of a scene bear, one row a joint, in the order of `Scene.joints`.

    Attributes:
        force: of the first body on the second, at the joint's point, mean over the step, shape
            (n, dim), N (2D: N/m). That of a tendon points from its second end to the first, and its
            length is the tension.
        moment: of the first body on the second, shape (n, 1) in 2D, (n, 3) in 3D, N m (2D: N):
            what holds or hinders their turning.
    """

    force: np.ndarray
    moment: np.ndarray


def find_joint_forces(simulation: Simulation) -> JointForces:
    """Read the forces of the joints in the last step; all ranks call it together.

    Args:
        simulation: of a scene with joints; before the first step all are zero.

    Raises:
        TypeError: no simulation.
        ValueError: a scene without joints.
    """
    require_kind("simulation", simulation, Simulation)
    joints, interactions = simulation.model.joints, simulation.interactions
    if joints is None:
        raise ValueError("The scene has no joints.")
    dim, count = simulation.scene.dim, len(simulation.scene.joints)
    force, moment = np.zeros((count, dim)), np.zeros((count, dim))
    on_spins = joints.rows.on_spins
    for group in interactions.joints:
        row = joints.here[group.indices]
        vector = group.committed_impulse * group.points.frame[:, 0] / interactions.committed_step
        turns = on_spins[row, None]
        joint = joints.joint_of_row[row]
        np.add.at(force, joint, np.where(turns, 0.0, vector))
        np.add.at(moment, joint, np.where(turns, vector, 0.0))
    force, moment = interactions.total(np.stack([force, moment]))
    return JointForces(force, moment if dim == 3 else moment[:, :1])
