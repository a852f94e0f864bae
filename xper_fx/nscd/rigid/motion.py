# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of rigid bodies in time: drift, kick, drift.

One step of size h from t0 to t1 with theta in [1/2, 1] (Moreau 1988; Jean 1999):

    drift   x_m = x0 + h (1 - theta) v0,  the rotation without torques over h (1 - theta);
    kick    M (v1 - v0) = h [theta f1 + (1 - theta) f0] + p + g;
    drift   x1 = x_m + h theta v1,        the rotation without torques over h theta.

All of the kick happens at x_m: the inertia M, the spins v0 and v1, the arms of the impulses p of
the contacts. g is the impulse of what prescribes velocities, v1_c = given(t1). Two impulses that
are opposite at one point of space then change neither the sum of m v nor that of x x m v + L, for
any theta, since x1 x m v1 - x0 x m v0 = x_m x m (v1 - v0), x between vectors the cross product.

The kinetic energy changes in the kick only (see `space_turning.py` for the drift), by

    d(kinetic) = v_theta . (h f + p + g) - (theta - 1/2) (v1 - v0) . M (v1 - v0),
    v_theta = theta v1 + (1 - theta) v0,

an identity. A body whose spin is prescribed in part or whole also takes work in its drifts, which
is counted as work of what prescribes it.

Velocities are in *slots* of `dim` numbers, two a body: that of the centre of mass, and the spin,
(omega, 0) in 2D and in the axes of space in 3D. The block of w = M^-1 of a body is over its two
slots; rows and columns of prescribed components, and of the unused one in 2D, are zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.body import Load, load_at, value_at, vector
from xper_fx.nscd.rigid.plane_turning import PlaneTurning, Turn

# What messages call it.
_GRAVITY = "The gravity (m/s^2)"


class RigidState(NamedTuple):
    """Positions and velocities of all bodies at one time."""

    position: np.ndarray  #: of the centres of mass, shape (n, dim), m
    velocity: np.ndarray  #: of the centres of mass, shape (n, dim), m/s
    turn: Turn  #: rotation, angular momentum, spin and inertia in space


class Prediction(NamedTuple):
    """Where the kick of a step takes place, and the velocities without contacts."""

    position: np.ndarray  #: x_m of the centres of mass, shape (n, dim), m
    #: angles, shape (n,), rad (2D); matrices from body to space, (n, 3, 3) (3D)
    rotation: np.ndarray
    start: np.ndarray  #: velocities v0 there, before the kick, shape (2 n, dim), m/s and rad/s
    #: velocities after a kick without contacts, with the prescribed ones of the end of the step,
    #: shape (2 n, dim)
    free: np.ndarray
    #: Fbar there, shape (dim, dim), of a periodic cell that deforms, whose columns of dFbar/dt come
    #: behind the other velocities; None without one
    gradient: np.ndarray | None = None
    #: by how much bodies may move and turn in a step along a path, shape (2 n, dim), m and rad;
    #: None where the velocities say it
    way: np.ndarray | None = None


class RigidWork(NamedTuple):
    """Energies of a step (J; 2D: per metre of depth).

    kinetic - (kinetic at the start) = loads + contacts + prescribed - scheme.
    """

    kinetic: float  #: kinetic energy at the end
    loads: float  #: work of gravity, forces and torques
    contacts: float  #: work of the impulses of contacts
    prescribed: float  #: work of what prescribes velocities
    scheme: float  #: energy taken by the scheme, zero for theta = 1/2
    #: of bodies that are driven without inertia, of half the change of what drives them
    change: float = 0.0


class RigidMotion:
    """Time integration of rigid bodies.

    A step is `predict`, then `end` with velocities that the contacts have changed, as often as
    wanted and with any size, then `commit`.

    Args:
        gravity: acceleration, shape (dim,), m/s^2; constant or of time; None is none.

    Attributes:
        bodies: as given.
        start: the `RigidState` of time 0.
        state: the committed `RigidState`.
        blocks: w of each body at the last prediction, shape (n, 2 dim, 2 dim), 1/kg and so on.
            The array is written in place: in 2D never again, in 3D by each `predict`.
        displayed: the committed state with each body where it is drawn.
        fluctuation: of the velocities, shape (n, dim), m/s: what is not due to a periodic cell that
            deforms, all without one.
        speeds: at which bodies come nearer to their neighbours, turning left out, shape (n,), m/s.
    """

    def __init__(self, bodies: RigidBodies, gravity: Load | None = None):
        dim, n = bodies.dim, len(bodies)
        self.bodies = bodies
        self._dofs = 3 * (dim - 1)
        if dim == 2:
            self._turning = PlaneTurning(bodies)
        else:
            from xper_fx.nscd.rigid.space_turning import SpaceTurning

            self._turning = SpaceTurning(bodies)
        self.start = self.state = RigidState(
            bodies.position.copy(), bodies.velocity.copy(), self._turning.initial
        )
        self.blocks = self._of_bodies = np.zeros((n, 2 * dim, 2 * dim))
        for k in range(dim):
            free = ~bodies.is_prescribed[:, k]
            self._of_bodies[free, k, k] = 1.0 / bodies.mass[free]
        self._spin_blocks[:] = self._turning.inverse
        self._prescribed = np.zeros((n, 2 * dim), bool)
        self._prescribed[:, : self._dofs] = bodies.is_prescribed
        self._tabulate_prescribed()
        self._tabulate_loads(gravity)
        self._at: tuple[float, float] | None = None
        self._middle: RigidState | None = None
        self._end: RigidState | None = None

    @property
    def _spin_blocks(self) -> np.ndarray:
        dim = self.bodies.dim
        return self._of_bodies[:, dim : self._dofs, dim : self._dofs]

    def _tabulate_prescribed(self) -> None:
        """Constants as an array, and the list (body, component, function) of the others."""
        self._constant_motion = np.zeros(self._prescribed.shape)
        self._motions = []
        for i, prescribed in enumerate(self.bodies.prescribed):
            for component, motion in prescribed.items():
                if callable(motion):
                    self._motions.append((i, component, motion))
                else:
                    self._constant_motion[i, component] = motion

    def _tabulate_loads(self, gravity: Load | None) -> None:
        """Constants as an array, gravity of time, and the list (body, what, part, function)."""
        dim, bodies = self.bodies.dim, self.bodies
        self._constant_load = np.zeros(self._prescribed.shape)
        self._gravity_of_time = gravity if callable(gravity) else None
        if self._gravity_of_time is None:
            constant = vector(_GRAVITY, gravity, (dim,))
            self._constant_load[:, :dim] = bodies.mass[:, None] * constant
        self._loads = []
        spin = slice(dim, self._dofs)
        for what, part, loads in (
            ("force (N)", slice(0, dim), bodies.force),
            ("torque (N m)", spin, bodies.torque),
        ):
            for i, load in enumerate(loads):
                if callable(load):
                    self._loads.append((i, f"The {what} of rigid body {i}", part, load))
                elif load is not None:
                    self._constant_load[i, part] += np.asarray(load, float)

    def _load_impulse(self, step: float, theta: float, time: float) -> np.ndarray:
        """h [theta f1 + (1 - theta) f0], shape (n, 2 dim)."""
        if self._gravity_of_time is None and not self._loads:
            return step * self._constant_load
        start, end = self._load(time), self._load(time + step)
        return step * (theta * end + (1.0 - theta) * start)

    def _load(self, time: float) -> np.ndarray:
        """Forces (N) and torques (N m) at a time, shape (n, 2 dim)."""
        total, dim = self._constant_load.copy(), self.bodies.dim
        if self._gravity_of_time is not None:
            gravity = load_at(_GRAVITY, self._gravity_of_time, time, (dim,))
            total[:, :dim] += self.bodies.mass[:, None] * gravity
        for i, what, part, load in self._loads:
            shape = () if dim == 2 and part.start else (dim,)
            total[i, part] += load_at(what, load, time, shape)
        return total

    def _slots(self, velocity: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Velocities and spins of all bodies as slots, shape (n, 2 dim)."""
        rows = np.zeros(self._prescribed.shape)
        rows[:, : self.bodies.dim] = velocity
        rows[:, self.bodies.dim : self._dofs] = spin
        return rows

    def _rows(self, what: str, slots: npt.ArrayLike | None) -> np.ndarray:
        """Slots of shape (2 n, dim) as rows of shape (n, 2 dim)."""
        if slots is None:
            return np.zeros(self._prescribed.shape)
        n, dim = self.state.position.shape
        slots = np.asarray(slots, float)
        if slots.size != 2 * n * dim:
            raise ValueError(f"{what} have shape {(2 * n, dim)}, got {slots.shape}.")
        return slots.reshape(n, 2 * dim)

    def predict(self, step: float, theta: float, time: float) -> Prediction:
        """Drift to where the kick takes place, and kick without contacts.

        Args:
            step: size of the step (s).
            theta: of the scheme, in [1/2, 1].
            time: at the start of the step (s).

        Raises:
            ValueError: a step that is not positive, a theta out of its range, a load or a
                prescribed velocity that is not finite.
            FloatingPointError: a body spins far too fast for the step.
        """
        if not (math.isfinite(step) and step > 0.0):
            raise ValueError(f"A step must be finite and positive (s), got {step!r}.")
        if not 0.5 <= theta <= 1.0:
            raise ValueError(f"theta must be in [1/2, 1], got {theta!r}.")
        first = step * (1.0 - theta)
        state = self.state
        turn = self._turning.drift(first, state.turn)
        self._turning.update_inverse(turn, self._spin_blocks)
        self._at = (step, theta)
        self._end = None
        self._middle = RigidState(state.position + first * state.velocity, state.velocity, turn)
        self._start = self._slots(state.velocity, turn.spin)
        self._impulse = self._load_impulse(step, theta, time)
        given = self._given(step, time)
        free = _free_velocities(
            self._start, self._impulse, self._prescribed, given, turn.inertia, self._of_bodies
        )
        shape = (2 * len(free), self.bodies.dim)
        return Prediction(
            self._middle.position, turn.rotation, self._start.reshape(shape), free.reshape(shape)
        )

    def _given(self, step: float, time: float) -> np.ndarray:
        """Prescribed velocities at the end of a step (s) from a time (s), shape (n, 2 dim)."""
        return self._given_at(time + step)

    def _given_at(self, time: float) -> np.ndarray:
        """Prescribed velocities at a time (s), shape (n, 2 dim), zero where there are none."""
        given = self._constant_motion.copy()
        for i, component, motion in self._motions:
            given[i, component] = value_at(motion, component, time)
        return given

    def end(self, slots: npt.ArrayLike) -> RigidState:
        """The state at the end of the step, for velocities after the kick.

        Args:
            slots: velocities after the kick, shape (2 n, dim); those of prescribed components as
                they were predicted.
        """
        middle = self._predicted()
        step, theta = self._at
        rows = self._rows("Velocities", slots)
        dim = self.bodies.dim
        velocity = rows[:, :dim].copy()
        spin = rows[:, dim : self._dofs].copy()
        # The change of momentum, not J times the spin: without torques it is exactly zero.
        torque = _apply(middle.turn.inertia, spin - middle.turn.spin)
        kicked = middle.turn._replace(spin=spin, momentum=middle.turn.momentum + torque)
        self._kicked, self._kicked_turn = rows.copy(), kicked
        self._change = self._slots(self.bodies.mass[:, None] * (velocity - middle.velocity), torque)
        second = step * theta
        self._end = RigidState(
            middle.position + second * velocity, velocity, self._turning.drift(second, kicked)
        )
        return self._end

    def next_middle(self, slots: npt.ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Position and rotation in the middle of the next step, of the same size; as `end`."""
        end, (step, theta) = self.end(slots), self._at
        left = (1.0 - theta) * step
        return end.position + left * end.velocity, self._turning.drift(left, end.turn).rotation

    def commit(self) -> None:
        """Keep the end of the step as the state that the next one starts from."""
        self.state = self._ended()
        self._middle = self._end = self._at = None

    def renew_blocks(self) -> None:
        """Let `blocks` be those of the committed state; the next `predict` has its own."""
        self._turning.update_inverse(self.state.turn, self._spin_blocks)

    def displace(self, moved: np.ndarray, time: float) -> tuple[float, float]:
        """Move bodies from where the committed state has them, which takes no time.

        Velocities of centres of mass stay, and spins in the axes of the bodies, and with both the
        kinetic energy. A body that has prescribed components of the spin keeps it in space.

        Args:
            moved: displacements (m) and rotation vectors (rad; the first component in 2D), shape
                (n, 2, dim), zero where motions are prescribed.
            time: of the committed state (s).

        Returns:
            The work of the loads, and what the kinetic energy has gained: nothing but of bodies
            with prescribed spins, whose inertia in space has turned (J; 2D: J/m).
        """
        state, dim, guided = self.state, self.bodies.dim, self._turning.guided
        turn = self._turning.turned(moved[:, 1, : self._dofs - dim], state.turn)
        self.state = RigidState(state.position + moved[:, 0], state.velocity, turn)
        gained = _turning_energy(turn, guided) - _turning_energy(state.turn, guided)
        return float(np.vdot(self._load(time), moved)), gained

    def saved(self) -> dict[str, np.ndarray]:
        """The committed state, by the names of `RigidState` and `Turn`."""
        state = self.state
        return {"position": state.position, "velocity": state.velocity, **state.turn._asdict()}

    def restore(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take the committed state from what `saved` gave."""
        turn = Turn(*(saved[name] for name in Turn._fields))
        self.state = RigidState(saved["position"], saved["velocity"], turn)
        self._middle = self._end = self._at = None

    def reactions(self, contacts: npt.ArrayLike | None = None) -> np.ndarray:
        """Mean forces and torques over the step that prescribe velocities, N and N m.

        Args:
            contacts: impulses of the contacts on the slots, shape (2 n, dim): sums of p and of
                arm x p, arms from x_m; None is none.

        Returns:
            Shape (2 n, dim), zero where nothing is prescribed. Of a body without mass, what keeps
            its contacts and loads in balance.
        """
        self._ended()
        missing = self._change - self._impulse - self._rows("Impulses of contacts", contacts)
        return np.where(self._prescribed, missing / self._at[0], 0.0).reshape(-1, self.bodies.dim)

    def work(self, contacts: npt.ArrayLike | None = None) -> RigidWork:
        """Energies of the step that `end` has tried; `contacts` as for `reactions`."""
        end = self._ended()
        step, theta = self._at
        contact = self._rows("Impulses of contacts", contacts)
        mean = theta * self._kicked + (1.0 - theta) * self._start
        reaction = step * self.reactions(contacts).reshape(contact.shape)
        guided = self._turning.guided
        drifts = sum(
            _turning_energy(after, guided) - _turning_energy(before, guided)
            for before, after in (
                (self.state.turn, self._middle.turn),
                (self._kicked_turn, end.turn),
            )
        )
        difference = self._kicked - self._start
        return RigidWork(
            kinetic=self._kinetic(end),
            loads=float(np.vdot(mean, self._impulse)),
            contacts=float(np.vdot(mean, contact)),
            prescribed=float(np.vdot(mean, reaction) + drifts),
            scheme=float((theta - 0.5) * np.vdot(difference, self._change)),
        )

    @property
    def kinetic(self) -> float:
        """Kinetic energy of the committed state (J)."""
        return self._kinetic(self.state)

    @property
    def displayed(self) -> RigidState:
        """See the class."""
        return self.state

    @property
    def fluctuation(self) -> np.ndarray:
        """See the class."""
        return self.state.velocity

    @property
    def speeds(self) -> np.ndarray:
        """See the class."""
        return np.linalg.norm(self.state.velocity, axis=1)

    @property
    def nbytes(self) -> int:
        """Memory of state, masses, loads and blocks of w, in bytes."""
        bodies, turn = self.bodies, self.state.turn
        held = (
            bodies.mass, bodies.inertia, self.blocks, self._prescribed, self._constant_motion,
            self._constant_load, self.state.position, self.state.velocity, *turn,
        )  # fmt: skip
        return sum(array.nbytes for array in held)

    def momentum(self) -> np.ndarray:
        """Sum of m v over the bodies, of the fluctuation in a cell, shape (dim,), N s."""
        return self.bodies.mass @ self.fluctuation

    def angular_momentum(self, about: npt.ArrayLike | None = None) -> np.ndarray:
        """Sum of x x m v + L over the bodies, shape (1,) in 2D, (3,) in 3D, N m s.

        Args:
            about: point from which x is measured, shape (dim,), m; None is the origin.
        """
        about = vector("The point of an angular momentum (m)", about, (self.bodies.dim,))
        x, p = self.state.position - about, self.bodies.mass[:, None] * self.state.velocity
        if self.bodies.dim == 2:
            orbital = (x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0])[:, None]
        else:
            orbital = np.cross(x, p)
        return (orbital + self.state.turn.momentum).sum(axis=0)

    def _kinetic(self, state: RigidState) -> float:
        translation = 0.5 * self.bodies.mass @ np.einsum("ni,ni->n", state.velocity, state.velocity)
        return float(translation) + _turning_energy(state.turn, slice(None))

    def _predicted(self) -> RigidState:
        if self._middle is None:
            raise RuntimeError("The step has not been predicted: call predict first.")
        return self._middle

    def _ended(self) -> RigidState:
        if self._end is None:
            raise RuntimeError("The step has no end yet: call predict and end first.")
        return self._end


def _apply(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """The product of each matrix with its vector."""
    product = np.zeros_like(vectors)
    for j in range(vectors.shape[1]):
        product += matrices[:, :, j] * vectors[:, j, None]
    return product


def _turning_energy(turn: Turn, which: np.ndarray | slice) -> float:
    return 0.5 * float(np.vdot(turn.spin[which], turn.momentum[which]))


def _free_velocities(
    start: np.ndarray,
    impulse: np.ndarray,
    prescribed: np.ndarray,
    given: np.ndarray,
    inertia: np.ndarray,
    blocks: np.ndarray,
) -> np.ndarray:
    """v0 + w (h f - M dv_c), and the given values where they are prescribed; rows (n, 2 dim)."""
    dim, turning = start.shape[1] // 2, inertia.shape[1]
    spin = slice(dim, dim + turning)
    free = np.where(prescribed, given, start)
    for k in range(dim):
        free[:, k] += blocks[:, k, k] * impulse[:, k]
    change = np.where(prescribed, given - start, 0.0)[:, spin]
    torque = impulse[:, spin].copy()
    for j in range(turning):
        torque -= inertia[:, :, j] * change[:, j, None]
    for k in range(turning):
        free[:, spin] += blocks[:, spin, dim + k] * torque[:, k, None]
    return free
