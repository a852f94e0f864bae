# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints between two rigid bodies, or of one to the ground: hinge, slider, weld and tendon.

A joint is as the bodies are placed at the start; from then on its points and directions go with
them. Its constraints are rows (`nscd/rigid/joint_rows.py`), solved with the contacts in one
nonsmooth problem (`nscd/laws/joint_laws.py`). Angles and ways count from the start: those of
the second body of `between` about or along the axis, relative to the first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from reprlib import repr as short
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.nscd.laws.joint_laws import ElasticWire, Held, SlidingFriction, Stop
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.body import RigidBody
from xper_fx.nscd.rigid.joint_rows import ALIGN, LENGTH, PLANE, TURN, TWIST, JointRows, Row
from xper_fx.support.checks import require_non_negative, require_number, require_numbers

# Velocity at a joint that is rounding, relative to the largest of the bodies.
_STILL = 1e-9
# Bodies of a joint, of which one may be None, the ground.
Pair = tuple[RigidBody | None, RigidBody | None]


@dataclass(frozen=True, eq=False)
class Hinge:
    """Two bodies share a point; they turn about it, in 3D about an axis or as a ball joint.

    Args:
        between: the bodies, objects of the scene's `rigid`; None in the place of one is the ground.
        at: the point, shape (dim,), m.
        axis: 3D: about which the bodies may turn, shape (3,), of any length; None is a ball joint.
        friction: largest moment of friction, N m (2D: per metre of depth).
        limits: least and largest angle of the second body relative to the first, rad,
            counter-clockwise (3D: about the axis, within (-pi, pi)); 0 is the start and lies
            between them.
        restitution: Newton's e in [0, 1] of an impact on a limit.

    Raises:
        ValueError: not two bodies, a number out of range, friction or limits of a ball joint.
        TypeError: something of another kind than is expected.
    """

    between: Pair
    at: npt.ArrayLike
    axis: npt.ArrayLike | None = None
    friction: float = 0.0
    limits: tuple[float, float] | None = None
    restitution: float = 0.0

    keeps_apart = True

    def __post_init__(self) -> None:
        _check_between(self)
        dim = len(_check_points(self, 1)[0])
        _check_travel(self)
        if dim == 2 and self.axis is not None:
            raise ValueError("A hinge in 2D turns in the plane: leave its axis out.")
        if self.axis is not None:
            _unit(self, dim)
        if dim == 3 and self.axis is None and (self.friction or self.limits is not None):
            raise ValueError(
                "A ball joint has neither friction nor limits: give the hinge an axis."
            )
        if dim == 3 and self.limits is not None and max(map(abs, self.limits)) >= math.pi:
            raise ValueError(f"limits in 3D should lie within (-pi, pi), got {self.limits}.")

    def rows(self) -> list[Row]:
        """Its rows, in space as the bodies are placed."""
        frame = _Frame.of(self)
        rows = [frame.held(direction) for direction in np.eye(frame.dim)]
        if frame.dim == 3 and self.axis is None:
            return rows
        if frame.dim == 3:
            rows += [frame.aligned(1, 0), frame.aligned(2, 0)]
        return rows + frame.travel(self, TURN if frame.dim == 2 else TWIST)


@dataclass(frozen=True, eq=False)
class Slider:
    """The second body slides along an axis that turns with the first, and does not turn on it.

    Args:
        between: the bodies, objects of the scene's `rigid`; None in the place of one is the ground.
        at: a point of the axis, shape (dim,), m; it goes with the second body and is where the
            joint's force acts.
        axis: along which the second body may slide, shape (dim,), of any length.
        friction: largest force of friction, N (2D: N/m).
        limits: least and largest way of the second body along the axis, m; 0 is the start and lies
            between them.
        restitution: Newton's e in [0, 1] of an impact on a limit.

    Raises:
        ValueError: not two bodies, a number out of range.
        TypeError: something of another kind than is expected.
    """

    between: Pair
    at: npt.ArrayLike
    axis: npt.ArrayLike
    friction: float = 0.0
    limits: tuple[float, float] | None = None
    restitution: float = 0.0

    keeps_apart = True

    def __post_init__(self) -> None:
        _check_between(self)
        dim = len(_check_points(self, 1)[0])
        _check_travel(self)
        _unit(self, dim)

    def rows(self) -> list[Row]:
        """Its rows, in space as the bodies are placed."""
        frame = _Frame.of(self)
        across = [frame.held(direction) for direction in frame.axes[1:]]
        return [*across, *frame.not_turning(), *frame.travel(self, PLANE)]


@dataclass(frozen=True, eq=False)
class Weld:
    """Two bodies move as one.

    Args:
        between: the bodies, objects of the scene's `rigid`; None in the place of one is the ground.
        at: the point where the joint's force acts, shape (dim,), m.

    Raises:
        ValueError: not two bodies, a point that is none.
        TypeError: something of another kind than is expected.
    """

    between: Pair
    at: npt.ArrayLike

    keeps_apart = True

    def __post_init__(self) -> None:
        _check_between(self)
        _check_points(self, 1)

    def rows(self) -> list[Row]:
        """Its rows, in space as the bodies are placed."""
        frame = _Frame.of(self)
        return [*(frame.held(direction) for direction in frame.axes), *frame.not_turning()]


@dataclass(frozen=True, eq=False)
class Tendon:
    """A wire between a point of each body: in tension it bears, in compression it is slack.

    Without a stiffness it is inextensible. With one the tension is that of a spring, `prestress` at
    the start or the stiffness times the elongation beyond `length`.

    Args:
        between: the bodies, objects of the scene's `rigid`; None in the place of one is the ground.
        at: the ends on the first and on the second body, shape (2, dim), m.
        length: of the wire without tension, m; None is the distance of the ends at the start, less
            what a prestress stretches. An inextensible wire is at least as long as that distance.
        stiffness: force over elongation, N/m (2D: N/m per metre of depth); None is inextensible.
        prestress: tension at the start, N (2D: N/m); takes a stiffness and no length.
        restitution: Newton's e in [0, 1] where an inextensible wire becomes taut.

    Raises:
        ValueError: not two bodies, a number out of range, options that exclude each other.
        TypeError: something of another kind than is expected.
    """

    between: Pair
    at: npt.ArrayLike
    length: float | None = None
    stiffness: float | None = None
    prestress: float = 0.0
    restitution: float = 0.0

    keeps_apart = False

    def __post_init__(self) -> None:
        _check_between(self)
        ends = _check_points(self, 2)
        _check_restitution(self)
        require_non_negative("prestress", self.prestress)
        placed = math.dist(*ends)
        if self.length is None and not placed > 0.0:
            raise ValueError(
                f"Both ends of a Tendon are at {ends[0].tolist()} m: give them apart, or a length."
            )
        for name in ("length", "stiffness"):
            given = getattr(self, name)
            if given is not None and not (0.0 < require_number(name, given) < math.inf):
                raise ValueError(f"{name} should be a finite number above zero, got {given}.")
        if self.stiffness is None:
            if self.prestress:
                raise ValueError(
                    "An inextensible Tendon has the tension that holds it: give it a stiffness "
                    f"(N/m) to have a prestress of {self.prestress:g}."
                )
            if self.length is not None and self.length < placed * (1.0 - 1e-12):
                raise ValueError(
                    f"An inextensible Tendon of {self.length:g} m does not reach between its ends, "
                    f"which are {placed:g} m apart: make it longer, or give it a stiffness (N/m)."
                )
            return
        if self.restitution:
            raise ValueError("An elastic Tendon has no impacts: leave its restitution out.")
        if self.prestress and self.length is not None:
            raise ValueError("A Tendon takes a length or a prestress, not both.")
        if self.prestress >= self.stiffness * placed:
            raise ValueError(
                f"A prestress of {self.prestress:g} with a stiffness of {self.stiffness:g} N/m "
                f"leaves a wire over {placed:g} m no length without tension: give a larger "
                "stiffness or a smaller prestress."
            )

    def rows(self) -> list[Row]:
        """Its row, in space as the bodies are placed."""
        ends = np.asarray(self.at, float)
        placed, dim = math.dist(*ends), ends.shape[1]
        if self.stiffness is None:
            length = placed if self.length is None else max(self.length, placed)
            law = Stop(float(self.restitution))
        else:
            length = self.length
            if length is None:
                length = placed - self.prestress / self.stiffness
            law = ElasticWire(float(self.stiffness), self.stiffness * (placed - length))
        return [Row(LENGTH, law, ends, np.zeros((3, dim)), offset=length)]


Joint = Hinge | Slider | Weld | Tendon


class _Frame(NamedTuple):
    """A point and right-handed axes, the joint's own first."""

    point: np.ndarray  #: shape (dim,)
    axes: np.ndarray  #: shape (dim, dim), rows

    @classmethod
    def of(cls, joint: Hinge | Slider | Weld) -> _Frame:
        """That of a joint, or the axes of space where it has no axis."""
        point = np.asarray(joint.at, float)
        axis = getattr(joint, "axis", None)
        if axis is None:
            return cls(point, np.eye(len(point)))
        from xper_fx.nscd.points import frame_from_normal

        return cls(point, frame_from_normal(_unit(joint, len(point))[None])[0])

    @property
    def dim(self) -> int:
        return len(self.point)

    def row(self, kind: int, law: Any, directions: Sequence, sign=1.0, offset=0.0) -> Row:
        """A row at the point."""
        ends = np.stack([self.point, self.point])
        return Row(kind, law, ends, np.array(directions), sign, offset)

    def held(self, direction: np.ndarray) -> Row:
        """The second body stays at the first in a direction."""
        return self.row(PLANE, Held(), [direction] * 3)

    def aligned(self, first: int, second: int) -> Row:
        """An axis of the first body stays at right angles to another one of the second."""
        return self.row(ALIGN, Held(), self.axes[[first, first, second]])

    def not_turning(self) -> list[Row]:
        """The second body does not turn on the first."""
        if self.dim == 2:
            return [self.row(TURN, Held(), [self.axes[0]] * 3)]
        return [self.aligned(0, 1), self.aligned(1, 2), self.aligned(2, 0)]

    def travel(self, joint: Hinge | Slider, kind: int) -> list[Row]:
        """Friction and limits of what the joint lets move."""
        directions, rows = self.axes[[0, 1, 1]], []
        if joint.friction:
            rows.append(self.row(kind, SlidingFriction(float(joint.friction)), directions))
        if joint.limits is not None:
            stop, (low, high) = Stop(float(joint.restitution)), map(float, joint.limits)
            rows.append(self.row(kind, stop, directions, 1.0, -low))
            rows.append(self.row(kind, stop, directions, -1.0, high))
        return rows


def check_joints(joints: Sequence[Joint], rigid: Sequence[RigidBody], bodies: RigidBodies) -> None:
    """See that joints fit a scene.

    Args:
        joints: of the scene.
        rigid: its rigid bodies.
        bodies: the same as arrays.

    Raises:
        TypeError: something that is no joint.
        ValueError: a body that is not in the scene, another dimension, two bodies that cannot move,
            a joint given twice.
    """
    number_of = {id(body): number for number, body in enumerate(rigid)}
    held, first = np.append(bodies.is_prescribed.all(axis=1), True), dict[tuple, int]()
    for number, joint in enumerate(joints):
        what = f"Joint {number}, a {type(joint).__name__},"
        if not isinstance(joint, Joint):
            raise TypeError(
                f"Joint {number} should be an xf.Hinge, xf.Slider, xf.Weld or xf.Tendon, got "
                f"{joint!r}."
            )
        for body in joint.between:
            if body is not None and id(body) not in number_of:
                raise ValueError(
                    f"{what} is between a RigidBody of the group {body.group!r} that is not in the "
                    "scene: give the same object in `rigid` and in `between`."
                )
        dim = np.shape(joint.at)[-1]
        if dim != bodies.dim:
            raise ValueError(f"{what} is in {dim}D, the rigid bodies in {bodies.dim}D.")
        pair = [number_of.get(id(body), -1) for body in joint.between]
        if all(held[pair]):
            raise ValueError(f"{what} joins two bodies whose every motion is prescribed.")
        ends = np.reshape(joint.at, (-1, dim))
        if pair[0] > pair[1]:  # the same joint with its bodies turned round
            pair, ends = pair[::-1], ends[::-1]
        told = (type(joint), *pair, *ends.ravel().tolist())
        if told in first:
            raise ValueError(
                f"{what} stands where joint {first[told]} does, between the same bodies: forces "
                "of two equal joints are not unique; leave one out."
            )
        first[told] = number


class RowsOfJoints(NamedTuple):
    """The rows of some joints, one joint after the other."""

    each: list[Row]  #: the rows, n of them
    joint: np.ndarray  #: number of the joint of each, shape (n,)
    placed: JointRows  #: the same as arrays


def rows_of_joints(
    joints: Sequence[Joint], rigid: Sequence[RigidBody], bodies: RigidBodies
) -> RowsOfJoints:
    """Rows of joints as the bodies are placed; arguments as of `check_joints`."""
    of_joint = [joint.rows() for joint in joints]
    each = [row for rows in of_joint for row in rows]
    number = np.repeat(np.arange(len(of_joint)), [len(rows) for rows in of_joint])
    pairs = joined_bodies(joints, rigid)[number]
    return RowsOfJoints(each, number, JointRows(bodies, pairs, each))


def parting_joint(
    joints: Sequence[Joint], rigid: Sequence[RigidBody], bodies: RigidBodies
) -> tuple[int, float] | None:
    """The joint whose bodies leave it fastest, and how fast, m/s or rad/s; None if none do."""
    rows = rows_of_joints(joints, rigid, bodies)
    place, count = rows.placed.at(bodies.position, bodies.rotation), len(bodies)
    every, slots = np.arange(len(rows.each)), 2 * np.arange(count)
    points = rows.placed.points(place, slots, 2 * count, np.zeros_like(every), every).points
    velocity = np.zeros((2 * count + 1, bodies.dim))
    velocity[:-1:2] = bodies.velocity
    velocity[1::2, : np.size(bodies.spin) // count] = bodies.spin.reshape(count, -1)
    parting = np.abs(points.relative(velocity)[:, 0])
    parting[[not isinstance(row.law, Held) for row in rows.each]] = 0.0
    first = int(parting.argmax())
    if parting[first] <= _STILL * np.abs(velocity).max():
        return None
    return int(rows.joint[first]), float(parting[first])


def joined_bodies(joints: Sequence[Joint], rigid: Sequence[RigidBody]) -> np.ndarray:
    """Numbers of the bodies of each joint, shape (num_joints, 2), int; len(rigid) is the ground."""
    number_of = {id(body): number for number, body in enumerate(rigid)}
    pairs = [[number_of.get(id(body), len(rigid)) for body in joint.between] for joint in joints]
    return np.array(pairs, int).reshape(-1, 2)


def jointed_groups(
    joints: Sequence[Joint], rigid: Sequence[RigidBody], moves: np.ndarray
) -> np.ndarray:
    """Bodies that joints join, directly or through others that move, have one number.

    Args:
        joints: of the scene.
        rigid: its rigid bodies.
        moves: shape (num_rigid,), bool: which of them can move; others join nothing.

    Returns:
        Shape (num_rigid,), from 0 in the order of their first bodies.
    """
    pairs, still = joined_bodies(joints, rigid), np.append(~moves, True)
    a, b = pairs[~still[pairs].any(axis=1)].T
    graph = coo_array((np.ones(len(a)), (a, b)), shape=2 * (len(rigid),))
    return connected_components(graph, directed=False)[1]


def _check_between(joint: Joint) -> None:
    name, given = type(joint).__name__, joint.between
    if not isinstance(given, tuple | list) or len(given) != 2:
        raise ValueError(f"A {name} is between two bodies, (first, second), got {short(given)}.")
    for body in given:
        if body is not None and not isinstance(body, RigidBody):
            raise TypeError(
                f"A {name} is between RigidBody objects, or one and None, the ground; got "
                f"{short(body)}."
            )
    if given[0] is given[1]:
        raise ValueError(f"A {name} is between two different bodies, got one twice.")


def _check_points(joint: Joint, count: int) -> np.ndarray:
    """The points `at`, shape (count, dim)."""
    points = require_numbers("at", joint.at)
    shapes = [(2,), (3,)] if count == 1 else [(count, 2), (count, 3)]
    if points.shape not in shapes or not np.isfinite(points).all():
        raise ValueError(
            f"`at` of a {type(joint).__name__} should be finite numbers of shape {shapes[0]} in 2D "
            f"or {shapes[1]} in 3D (m), got {joint.at!r}."
        )
    return points.reshape(count, -1)


def _unit(joint: Hinge | Slider, dim: int) -> np.ndarray:
    axis = require_numbers("axis", joint.axis)
    if axis.shape != (dim,) or not np.isfinite(axis).all() or not np.linalg.norm(axis) > 0.0:
        raise ValueError(
            f"The axis of a {type(joint).__name__} should be a vector of shape ({dim},) that is "
            f"not zero, got {joint.axis!r}."
        )
    return axis / np.linalg.norm(axis)


def _check_restitution(joint: Joint) -> None:
    if not 0.0 <= require_number("restitution", joint.restitution) <= 1.0:
        raise ValueError(f"restitution should lie in [0, 1], got {joint.restitution}.")


def _check_travel(joint: Hinge | Slider) -> None:
    """Friction, limits and restitution."""
    require_non_negative("friction", joint.friction)
    _check_restitution(joint)
    if joint.limits is None:
        if joint.restitution:
            raise ValueError(
                f"restitution of a {type(joint).__name__} is that of its limits: give limits."
            )
        return
    if not isinstance(joint.limits, tuple | list) or len(joint.limits) != 2:
        raise ValueError(f"limits should be two numbers, (least, largest), got {joint.limits!r}.")
    low, high = (require_number("A number of limits", limit) for limit in joint.limits)
    if not (math.isfinite(low) and math.isfinite(high) and low <= 0.0 <= high and low < high):
        raise ValueError(
            "limits should be finite, with the start, 0, between them, got "
            f"{joint.limits}: place the bodies within their limits."
        )
