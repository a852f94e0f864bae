# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints of a scene in a step: their rows in its middle, and the bend of what they hold bodies to.

A row's gap in the middle of the next step is g_next = G + h U1 + c. G is the gap in the middle of
this step, U1 the end velocity there, and c, the bend, of second order in the angle by which bodies
turn in a step: a point that a hinge holds moves on an arc, a step's motion on its chord. c is read
off where the bodies would be, and the step is solved again until it stays what it is:

    c = g(q_next) - G - h U1,   q_next = q_m + h v1,

q_next with the drift of the rotations (`nscd/rigid/motion.py`). Without c a pendulum that swings
to 2 rad in steps of 10 ms loses 2.7 % of its energy in 1e4 steps, steadily; with c the error is
that of SHAKE, 8e-4, of second order in the step, and does not grow (`benchmarks/joints.py`).

Positions at the ends of steps lie on the chords: a joint's gap there is v^2 h^2 / (8 R), v the
speed on an arc of radius R.

Rows that hold and stops have a bend; the force of an elastic wire is that of the chord.

Where ranks divide rigid bodies, those that joints join are on one of them, which has the rows: they
move no body of another rank, and those that hold are solved at once there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.laws.joint_laws import ElasticWire, Held, Stop
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.rigid.held_rows import HeldRows
from xper_fx.nscd.rigid.joint_rows import JointRows, Place
from xper_fx.nscd.rigid.motion import Prediction, RigidMotion
from xper_fx.nscd.rigid.normal_rows import NormalRows
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.nscd.stepped_points import ROUNDING
from xper_fx.scene.joints import rows_of_joints
from xper_fx.scene.scene import Scene

if TYPE_CHECKING:
    from xper_fx.parallel.rigid_partition import RigidDivision
    from xper_fx.parallel.rigid_share import RigidShare

# How often a step is solved until the bend stays, and what may be left of it: the velocity that it
# asks for, relative to the solver's tolerance of velocities.
_ROUNDS, _STRICT = 20, 1e-4
# Largest bend relative to what turns, which is that of half a radian a step.
_FAR = 0.125


class JointedBodies:
    """The joints of a scene.

    Args:
        scene: with joints.
        laws: of the scene's other interactions.
        division: of the contacts of rigid bodies, None if one rank has all.
        share: what this rank has of rigid bodies beside meshed ones, None if all.

    Attributes:
        rows: of all joints.
        joint_of_row: shape (n,).
        here: numbers of the rows that this rank has in the step, in their order among its points.
        laws: those given and those of the rows.
        row_before: number of each row among those of the run that the scene goes on from, -1 of a
            new one; shape (n,).
        stored: energy of new elastic wires at the start (J).
    """

    def __init__(
        self,
        scene: Scene,
        laws: list[Law],
        division: RigidDivision | None,
        share: RigidShare | None,
    ):
        self._division, self._share = division, share
        of_all, self.joint_of_row, self.rows = rows_of_joints(
            scene.joints, scene.rigid, scene.rigid_bodies
        )
        own = list(dict.fromkeys(row.law for row in of_all))
        self.laws = [*laws, *own]
        self._law_of_row = len(laws) + np.array([own.index(row.law) for row in of_all])
        self.row_before = self._rows_before(scene)
        self.stored = sum(
            row.law.initial_state()[0]
            for row, before in zip(of_all, self.row_before, strict=True)
            if before < 0 and isinstance(row.law, ElasticWire)
        )
        self._place: Place | None = None
        self.here = np.arange(len(self.rows))
        still = np.append(scene.rigid_bodies.is_prescribed.all(axis=1), True)
        first, second = self.rows.pairs.T
        self._moved_body = np.where(still[first], second, first)

    def _rows_before(self, scene: Scene) -> np.ndarray:
        """See `row_before`; the rows that go on stay as they were placed."""
        before = np.full(len(self.rows), -1)
        if scene.after is not None and scene.after.joint_rows is not None:
            first, known = 0, {}
            for joint in scene.after.scene.joints:
                known[id(joint)] = first
                first += len(joint.rows())
            for number, joint in enumerate(scene.joints):
                own = np.flatnonzero(self.joint_of_row == number)
                if id(joint) in known:
                    before[own] = known[id(joint)] + np.arange(len(own))
            self.rows.stay_as(scene.after.joint_rows, before)
        return before

    @property
    def nbytes(self) -> int:
        """Memory of the rows, in bytes."""
        own = self.joint_of_row, self._law_of_row, self.here, self._moved_body
        return self.rows.nbytes + sum(array.nbytes for array in own)

    def renew(
        self, interactions: Interactions, prediction: Prediction, step: float, theta: float
    ) -> None:
        """Give the interaction layer the rows in the middle of a step.

        Args:
            prediction: of the rigid bodies.
            step: h (s).
            theta: weight of the end of the step.
        """
        self._place = self.rows.at(prediction.position, prediction.rotation)
        ground, slots = interactions.inverse.num_nodes, np.full(len(prediction.position), -1)
        own = slice(None) if self._share is None else self._share.here
        slots[own] = interactions.bulk_inverse.num_nodes + 2 * np.arange(len(slots[own]))
        self.here = self._own_rows(interactions)
        points = self.rows.points(self._place, slots, ground, self._law_of_row, self.here)
        interactions.move_joints(points, step, theta)

    def _own_rows(self, interactions: Interactions) -> np.ndarray:
        """Numbers of the rows whose bodies are this rank's; of all where they are on each."""
        if interactions.halo is None:
            return np.arange(len(self.rows))
        divided = self._division if self._share is None else self._share
        mine = divided.rank_of_body == interactions.halo.ranks.comm.rank
        return np.flatnonzero(mine[self._moved_body])

    def around(self, solver: Solver, rigid: RigidMotion) -> Solver:
        """A solver of the step that asks another one until the bend stays.

        Args:
            solver: of the interactions.
            rigid: predicted.
        """
        return _BentPaths(solver, self.rows, self._place, self.here, rigid)


class _BentPaths(Solver):
    """Solves a step with the bend of the joints' rows."""

    def __init__(
        self, solver: Solver, rows: JointRows, place: Place, here: np.ndarray, rigid: RigidMotion
    ):
        self._solver, self._rows, self._place, self._rigid = solver, rows, place, rigid
        self._here = here

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        dim, free, sweeps = interactions.dim, velocity.copy(), 0
        kinds = (Held().kernels(dim), Stop().kernels(dim))
        self._bent = [group for group in interactions.joints if group.kernels in kinds]
        first, count = interactions.bulk_inverse.num_nodes, len(interactions.rigid_blocks)
        self._rows_of_bent = [NormalRows(group.points, first, count) for group in self._bent]
        held, read = HeldRows(interactions), self._size(interactions, self._rounding())
        straight = [group.jump[:, 0].copy() for group in self._bent]
        if interactions.fused is None:
            interactions.add_velocity(velocity)
        else:  # bonds of whole vertices have no impulses
            _push_rigid(interactions, velocity)
        bend = self._bend(interactions, velocity)
        for _ in range(_ROUNDS):
            for group, jump in zip(self._bent, straight, strict=True):
                group.jump[:, 0] = jump + bend[self._here[group.indices]]
            interactions.prepare()
            held.solve(velocity)
            velocity[:] = free
            report = self._solver.solve(interactions, velocity, options)
            sweeps += report.sweeps
            if not report.converged:
                break
            before, bend = bend, self._bend(interactions, velocity)
            self._check_turns(interactions, bend)
            size, rounding = interactions.impulse_energy_norm(free, velocity)
            left = self._size(interactions, bend - before)
            if left <= max(_STRICT * options.tolerance * size, rounding, read):
                break
        else:
            report = report._replace(converged=False, residual=left / size if size else left)
        return report._replace(sweeps=sweeps)

    def _check_turns(self, interactions: Interactions, bend: np.ndarray) -> None:
        """Raise a FloatingPointError, on all ranks, where bodies turn too far in a step."""
        far = np.abs(bend) / (_FAR * self._rows.reach(self._place))
        row = int(interactions.largest(int(far.argmax()) if far.max() > 1.0 else -1))
        if row >= 0:
            first, second = self._rows.pairs[row]
            raise FloatingPointError(
                f"Rigid bodies {first} and {second} turn too far about their joint in a step of "
                f"{interactions.step_size:.3g} s. Take a smaller step."
            )

    def _bend(self, interactions: Interactions, velocity: np.ndarray) -> np.ndarray:
        """c of each row for end velocities of all slots; all ranks call it together.

        It is zero of rows that have none, and of those of other ranks.
        """
        ahead = self._rows.at(*self._rigid.next_middle(interactions.rigid_part(velocity)))
        rigid, bend = interactions.own_rigid(velocity).ravel(), np.zeros(len(self._rows))
        for group, rows in zip(self._bent, self._rows_of_bent, strict=True):
            row = self._here[group.indices]
            straight = interactions.step_size * rows.closing(rigid)
            bend[row] = ahead.gap[row] - self._place.gap[row] - straight
        return bend

    def _rounding(self) -> np.ndarray:
        """By how much each row's gap is rounded, shape (n,), m or rad."""
        extent = np.abs(self._rigid.state.position).max()
        return ROUNDING * np.where(self._rows.on_spins, 1.0, extent)

    def _size(self, interactions: Interactions, bend: np.ndarray) -> float:
        """Velocities that a bend asks for in the norm of the kinetic energy, kg^(1/2) m/s."""
        total = 0.0
        for group in self._bent:
            moves = group.compliance[:, 0] > 0.0
            asked = bend[self._here[group.indices[moves]]] / interactions.step_size
            total += float(np.sum(asked**2 / group.compliance[moves, 0]))
        return math.sqrt(interactions.total(total))


def _push_rigid(interactions: Interactions, velocity: np.ndarray) -> None:
    """Add w H r of contacts and joints to velocities, flat, of this rank's rigid bodies.

    All ranks call it together; no other points move rigid bodies.
    """
    impulses, blocks = interactions.spread(interactions.passing), interactions.rigid_blocks
    if interactions.halo is not None:
        interactions.halo.everywhere.add_back(impulses.reshape(-1))
    pushed = blocks @ interactions.own_rigid(impulses).reshape(-1, blocks.shape[1], 1)
    interactions.own_rigid(velocity)[:] += pushed.reshape(-1, interactions.dim)
