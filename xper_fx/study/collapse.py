# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Whether a structure of rigid blocks stands, how it begins to fall if not, and its collapse load.

Bodies at rest whose contacts are closed ask one frictional contact problem: M a = f + H r with the
accelerations a in the place of velocities. The structure stands if its solution is a = 0; else a
is the mechanism.

Coulomb's friction is not associated. A load that blocks can bear (forces in the cones, in balance
with it) may also set them in motion: between the least load of a mechanism and the largest one in
balance, which limit analysis with associated friction gives, both are solutions (Ferris and Tin-Loi
2001), and a solver finds one of them. `benchmarks/collapse_loads.py` shows how far they are apart.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.output.contact_forces import ContactForces, find_contact_forces
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_kind, require_number, require_positive

# A step in which bodies at rest go nowhere (s), and the tolerance of its solution.
_STEP, _TOLERANCE = 1e-5, 1e-6
# Velocities, in the norm of the kinetic energy and relative to those without contacts, below which
# bodies are at rest.
_AT_REST = 1e-6


class Equilibrium(NamedTuple):
    """What bodies at rest begin to do.

    Attributes:
        stands: whether none of them moves.
        acceleration: of the centres of mass, shape (n, dim), m/s^2.
        spin: angular accelerations, shape (n,) in 2D, (n, 3) in 3D, rad/s^2.
        forces: in the contacts.
    """

    stands: bool
    acceleration: np.ndarray
    spin: np.ndarray
    forces: ContactForces


class CollapseLoad(NamedTuple):
    """Where bodies that stand under a load begin to fall.

    Attributes:
        stands: the largest load found under which they stand.
        falls: the least load found under which they do not.
        mechanism: how they begin to fall under it.
    """

    stands: float
    falls: float
    mechanism: Equilibrium


def equilibrium(scene: Scene) -> Equilibrium:
    """Whether the rigid bodies of a scene, at rest at time 0, stay there.

    Args:
        scene: of rigid bodies alone, at rest, whose contacts have unilateral laws with Coulomb
            friction.

    Raises:
        ValueError: a mesh, joints, or bodies that move.
        UnsuitableSolverError: laws of another kind.
        ConvergenceError: no solution was found.
    """
    require_kind("scene", scene, Scene)
    bodies = scene.rigid_bodies
    if scene.bodies is not None:
        raise ValueError("An equilibrium is that of rigid bodies; the scene has a mesh.")
    if scene.joints:
        raise ValueError(
            "An equilibrium is that of contacts, and the scene has joints, which are no contacts "
            "with Coulomb friction: run a Simulation and see whether the bodies stay at rest."
        )
    if np.any(bodies.velocity) or np.any(bodies.spin):
        first = int(np.argmax(np.any(bodies.velocity != 0.0, axis=1) | _turns(bodies.spin)))
        raise ValueError(f"Bodies should be at rest at time 0; rigid body {first} moves.")
    simulation = Simulation(
        scene,
        _STEP,
        solver="friction_problem",
        tolerance=_TOLERANCE,
        max_halvings=0,
        comm=MPI.COMM_SELF,
    )
    for _ in simulation.steps(_STEP):
        pass
    moved, motion = simulation.rigid.kinetic, simulation.rigid.state
    stands = moved <= _AT_REST**2 * _kinetic_without_contacts(scene)
    return Equilibrium(
        stands, motion.velocity / _STEP, motion.turn.spin / _STEP, find_contact_forces(simulation)
    )


def _turns(spin: np.ndarray) -> np.ndarray:
    return np.any(spin.reshape(len(spin), -1) != 0.0, axis=1)


def _kinetic_without_contacts(scene: Scene) -> float:
    """Kinetic energy after a step of the bodies that are free, each on its own (J)."""
    motion = RigidMotion(scene.rigid_bodies, scene.gravity)
    motion.end(motion.predict(_STEP, 0.5, 0.0).free)
    return motion.work().kinetic


def collapse_load(
    scene_at: Callable[[float], Scene], between: tuple[float, float], precision: float = 1e-4
) -> CollapseLoad:
    """The load at which a structure of rigid blocks begins to fall, by bisection.

    Args:
        scene_at: gives the scene under a load, as `lambda a: wall_under(Gravity((a * g, -g)))`.
        between: a load under which it stands and one under which it falls.
        precision: width of the bracket, relative to the larger of the two loads given.

    Raises:
        ValueError: a structure that falls under the first load or stands under the second.
    """
    stands, falls = (require_number("A load of `between`", load) for load in between)
    width = require_positive("precision", precision) * max(abs(stands), abs(falls))
    if not equilibrium(scene_at(stands)).stands:
        raise ValueError(f"The structure should stand under the first load, {stands:g}; it falls.")
    mechanism = equilibrium(scene_at(falls))
    if mechanism.stands:
        raise ValueError(f"The structure should fall under the second load, {falls:g}; it stands.")
    while abs(falls - stands) > width:
        middle = 0.5 * (stands + falls)
        found = equilibrium(scene_at(middle))
        if found.stands:
            stands = middle
        else:
            falls, mechanism = middle, found
    return CollapseLoad(stands, falls, mechanism)
