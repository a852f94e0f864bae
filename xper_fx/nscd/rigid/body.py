# SPDX-License-Identifier: LGPL-3.0-or-later
"""One rigid body as a user writes it, and walls.

The position of a body is that of its centre of mass, which is the centroid of its shape; the
vertices of a polygon or a polyhedron and the parts of a cluster may have been drawn about any
origin. Its degrees of freedom
are numbered: the components of the velocity of the centre of mass first (0, 1 or 0, 1, 2), then
the spin about it (2 in 2D, counter-clockwise; 3, 4, 5 in 3D, in the axes of space, rad/s).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid.shapes import HalfPlane, HalfSpace, MassProperties, Shape, check_positive
from xper_fx.support.checks import require_numbers

Motion = float | Callable[[float], float]
"""A velocity (m/s or rad/s), constant or as a function of time."""

Load = npt.ArrayLike | Callable[[float], npt.ArrayLike]
"""A force (N) or torque (N m), constant or as a function of time."""

# Masses and inertias are kept as far from the limits of floats as their squares need.
_SMALL = 1e-150


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body. What is wrong with it is said by `RigidBodies`, with its number there.

    Args:
        shape: a shape of this package; bodies may share one.
        position: of the centre of mass at time 0, shape (dim,), m; None leaves the vertices of a
            polygon or polyhedron, or the parts of a cluster, where they were drawn.
        group: name that interactions are given by.
        angle: 2D: of the shape's axes from those of space, rad, counter-clockwise.
        rotation: 3D: from the shape's axes to those of space, as a SciPy `Rotation` or as a
            quaternion (x, y, z, w) of any length, the real part last as in SciPy; None is no
            rotation.
        density: kg/m^3; or else
        mass: kg (2D: kg per metre of depth). A body whose every degree of freedom is prescribed
            needs neither; its mass is then left out of all sums.
        inertia: about the centre of mass in the shape's axes: a number in 2D (kg m), shape (3, 3)
            in 3D (kg m^2); with `mass` only. None: the shape's, for that mass.
        velocity: of the centre of mass at time 0, shape (dim,), m/s; None is rest.
        spin: at time 0, rad/s: a number in 2D, shape (3,) in the axes of space in 3D.
        prescribed: velocities of degrees of freedom, constants or functions of time. They hold
            from time 0 on, whatever `velocity` and `spin` say of these components.
        force: on the centre of mass, besides gravity, shape (dim,), N; constant or of time.
        torque: about the centre of mass, N m: a number in 2D, shape (3,) in the axes of space in
            3D; constant or of time.
    """

    shape: Shape
    position: npt.ArrayLike | None
    group: str
    angle: float = field(default=0.0, kw_only=True)
    rotation: Rotation | npt.ArrayLike | None = field(default=None, kw_only=True)
    density: float | None = field(default=None, kw_only=True)
    mass: float | None = field(default=None, kw_only=True)
    inertia: npt.ArrayLike | None = field(default=None, kw_only=True)
    velocity: npt.ArrayLike | None = field(default=None, kw_only=True)
    spin: npt.ArrayLike | None = field(default=None, kw_only=True)
    prescribed: Mapping[int, Motion] = field(default_factory=dict, kw_only=True)
    force: Load | None = field(default=None, kw_only=True)
    torque: Load | None = field(default=None, kw_only=True)


class ResolvedBody(NamedTuple):
    """A body in numbers; attributes as those of `RigidBody`.

    `rotation` is an angle (2D) or a quaternion (3D), `velocity` and `spin` hold prescribed values
    at time 0, `spin` and `inertia` have shapes () (2D) or (3,) and (3, 3).
    """

    dim: int
    position: np.ndarray
    rotation: float | np.ndarray
    mass: float
    inertia: float | np.ndarray
    velocity: np.ndarray
    spin: float | np.ndarray
    prescribed: dict[int, Motion]


def vector(what: str, given: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The given value as finite floats of a shape; zeros for None; ValueError otherwise."""
    if given is None:
        return np.zeros(shape)
    try:
        array = require_numbers(what, given)
    except TypeError:
        raise ValueError(f"{what} must be of shape {shape}, got {given!r}.") from None
    if array.shape != shape:
        raise ValueError(f"{what} must be of shape {shape}, got {given!r}.")
    if not np.isfinite(array).all():
        raise ValueError(f"{what} is not finite: {given!r}.")
    return array


def load_at(what: str, load: Load | None, time: float, shape: tuple[int, ...]) -> np.ndarray:
    """A load at a time, checked; zeros for None."""
    return vector(what, load(time) if callable(load) else load, shape)


def value_at(motion: Motion, component: int, time: float) -> float:
    """A prescribed velocity at a time, checked."""
    value = motion(time) if callable(motion) else motion
    if not isinstance(value, Real) or not math.isfinite(value):
        raise ValueError(
            f"The prescribed velocity of component {component} at t = {time:.6g} s must be a "
            f"finite number, got {value!r}."
        )
    return float(value)


def _mass_properties(body: RigidBody, driven: bool) -> tuple[float, float | np.ndarray]:
    dim = body.shape.dim
    none = 0.0 if dim == 2 else np.zeros((3, 3))
    if body.density is not None and body.mass is not None:
        raise ValueError("A body takes a density or a mass, not both.")
    if body.inertia is not None and body.mass is None:
        raise ValueError("An inertia goes with a mass: give mass too.")
    if body.density is None and body.mass is None:
        if driven:
            return 0.0, none
        raise ValueError("A body that is free to move needs a density (kg/m^3) or a mass (kg).")
    if body.density is not None:
        check_positive("A density (kg/m^3)", body.density)
        properties: MassProperties = body.shape.mass_properties(body.density)
        return properties.mass, properties.inertia
    mass = check_positive("A mass (kg)", body.mass)
    if body.inertia is None:
        properties = body.shape.mass_properties(1.0)
        return mass, mass / properties.mass * properties.inertia
    if dim == 2:
        return mass, check_positive("An inertia in 2D (kg m)", body.inertia)
    inertia = vector("An inertia in 3D (kg m^2)", body.inertia, (3, 3))
    if np.abs(inertia - inertia.T).max() > 1e-12 * np.abs(inertia).max():
        raise ValueError(f"An inertia must be symmetric, got {inertia.tolist()}.")
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0.0 or moments[2] > (1.0 + 1e-12) * (moments[0] + moments[1]):
        raise ValueError(
            "An inertia has positive principal moments, none above the sum of the other two; got "
            f"{moments.tolist()}."
        )
    return mass, 0.5 * (inertia + inertia.T)


def resolve(body: RigidBody) -> ResolvedBody:
    """Check a body and put it into numbers.

    Raises:
        TypeError, ValueError: what is wrong, without saying with which body.
    """
    if not isinstance(body, RigidBody):
        raise TypeError(f"Expected a RigidBody, got {type(body).__name__}.")
    if isinstance(body.shape, type) or not hasattr(body.shape, "kind"):
        raise TypeError(
            f"Its shape must be one of this package, such as Disc(1.0), got {body.shape!r}."
        )
    if not isinstance(body.group, str) or not body.group:
        raise ValueError(f"It needs the name of a group (a string), got {body.group!r}.")
    dim = body.shape.dim
    dofs = 3 * (dim - 1)
    if not isinstance(body.prescribed, Mapping):
        raise TypeError(
            "prescribed must be a mapping from a component to its velocity, got "
            f"{body.prescribed!r}."
        )
    prescribed = dict(body.prescribed)
    for component in prescribed:
        if not isinstance(component, Integral) or component not in range(dofs):
            raise ValueError(
                f"Prescribed components in {dim}D are 0 .. {dofs - 1}, got {component!r}."
            )
    if math.isinf(body.shape.bounding_radius):
        if not (body.density is body.mass is body.inertia is None):
            raise ValueError("A half plane or half space has no mass: its motion is prescribed.")
        prescribed = dict.fromkeys(range(dofs), 0.0) | prescribed
    mass, inertia = _mass_properties(body, len(prescribed) == dofs)
    if mass > 0.0 or len(prescribed) < dofs:
        turning = [inertia] if dim == 2 else np.diagonal(inertia)
        if not all(_SMALL < number < 1.0 / _SMALL for number in (mass, *turning)):
            raise ValueError(
                f"Its mass of {mass:g} kg or its inertia of {np.max(turning):g} is beyond the "
                "range of floats: look at the density, at the size of the shape, and at the units."
            )

    if dim == 2 and body.rotation is not None:
        raise ValueError("A body in 2D takes an angle, not a rotation.")
    if dim == 3 and body.angle != 0.0:
        raise ValueError("A body in 3D takes a rotation, not an angle.")
    if dim == 2:
        rotation = vector("The angle (rad)", body.angle, ()).item()
    elif isinstance(body.rotation, Rotation):
        rotation = vector("The rotation as a quaternion", body.rotation.as_quat(), (4,))
    else:
        given = (0.0, 0.0, 0.0, 1.0) if body.rotation is None else body.rotation
        rotation = vector("The rotation as a quaternion (x, y, z, w)", given, (4,))
        if not np.linalg.norm(rotation) > 1e-6:
            raise ValueError(f"The quaternion of a rotation must not vanish, got {given!r}.")

    if body.position is not None:
        position = vector("The position (m)", body.position, (dim,))
    elif hasattr(body.shape, "unit_properties"):
        position = body.shape.unit_properties.centre
        if np.any(rotation != np.array(0.0 if dim == 2 else (0.0, 0.0, 0.0, 1.0))):
            raise ValueError("A body that is turned needs a position.")
    else:
        raise ValueError("It needs a position: its shape has no vertices to tell it.")

    velocity = vector("The velocity (m/s)", body.velocity, (dim,))
    spin_shape = () if dim == 2 else (3,)
    spin = vector("The spin (rad/s)", body.spin, spin_shape)
    for component, motion in prescribed.items():
        start = value_at(motion, component, 0.0)
        if component < dim:
            velocity[component] = start
        elif dim == 2:
            spin = np.array(start)
        else:
            spin[component - 3] = start
    load_at("The force (N)", body.force, 0.0, (dim,))
    load_at("The torque (N m)", body.torque, 0.0, spin_shape)
    return ResolvedBody(dim, position, rotation, mass, inertia, velocity, spin, prescribed)


def wall(
    point: Sequence[float],
    normal: Sequence[float],
    group: str,
    *,
    velocity: Sequence[Motion] | None = None,
) -> RigidBody:
    """A half plane (2D) or half space (3D) as a body.

    Args:
        point: a point of its surface, shape (dim,), m.
        normal: out of the solid, of any length but zero, shape (dim,).
        group: name that interactions are given by.
        velocity: components, shape (dim,), m/s, constants or functions of time; None is rest.

    Raises:
        ValueError: a normal that is zero, not finite, or of another dimension than the point.
    """
    dim = np.size(point)
    if dim not in (2, 3):
        raise ValueError(f"A wall goes through a point of 2 or 3 coordinates, got {point!r}.")
    direction = vector("The normal of a wall", normal, (dim,))
    length = np.linalg.norm(direction)
    if not length > 0.0:
        raise ValueError("A wall has no normal: give a vector that points out of its solid.")
    if velocity is not None and not np.iterable(velocity):
        raise TypeError(f"The velocity of a wall in {dim}D has {dim} components, got {velocity!r}.")
    components = (0.0,) * dim if velocity is None else tuple(velocity)
    if len(components) != dim:
        raise ValueError(f"The velocity of a wall in {dim}D has {dim} components.")
    prescribed = dict(enumerate(components))
    direction = direction / length
    if dim == 2:
        angle = math.atan2(-direction[0], direction[1])
        return RigidBody(HalfPlane(), point, group, angle=angle, prescribed=prescribed)
    turn, _ = Rotation.align_vectors(direction[None], np.array([[0.0, 0.0, 1.0]]))
    return RigidBody(HalfSpace(), point, group, rotation=turn, prescribed=prescribed)
