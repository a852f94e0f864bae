# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads and prescribed motions that a scene may call for.

Values are numbers, or functions of time (s). Forces are per reference volume or area.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Real
from reprlib import repr as short

import numpy as np
import numpy.typing as npt

from xper_fx.support.checks import refuse_expression, require_non_negative

# Sizes of loads from which on steps give nothing but infinity.
_LARGEST = 1e250
# Stresses from which on their works are infinite (Pa).
_LARGEST_STRESS = 1e150

Value = float | Callable[[float], float]
Where = Callable[[np.ndarray], npt.ArrayLike]
VectorValue = Sequence[Value] | Callable[[float], Sequence[float]]


def value_at(value: Value, time: float) -> float:
    """The number a load has at a time.

    Raises:
        ValueError: the load's function gives a number that is not finite.
        TypeError: it gives no number, or an expression of UFL.
    """
    given = _called(value, time) if callable(value) else value
    if not isinstance(given, float | Real):
        refuse_expression(f"A load at t = {time} s", given, "a number, as `float(constant)`")
        given = np.asarray(given)
        if given.size != 1 or given.dtype.kind not in "biuf":
            raise TypeError(f"A load is {given!r} at t = {time} s; it should be a number.")
        given = given.item()
    number = float(given)
    if not abs(number) < _LARGEST:
        raise ValueError(
            f"A load is {number} at t = {time} s; it should be a finite number, well within the "
            "range of floats."
        )
    return number


def vector_at(value: VectorValue, time: float, dim: int) -> np.ndarray:
    """The components a load has at a time, shape (dim,).

    Raises:
        ValueError: the load's function gives another number of components, or one that is not
            finite.
        TypeError: a component is no number.
    """
    if callable(value):
        given = _called(value, time)
        value = tuple(given) if np.iterable(given) else ()
        if len(value) != dim:
            raise ValueError(
                f"A load is {given!r} at t = {time} s; it should have {dim} components."
            )
    return np.array([value_at(component, time) for component in value])


def varies(value: VectorValue) -> bool:
    """Whether a load with components is a function of time, or some component is."""
    return callable(value) or any(map(callable, value))


def _called(function: Callable[[float], object], time: float) -> object:
    try:
        return function(time)
    except Exception as error:
        error.add_note(f"A load is a number or a function of time (s), called with t = {time}.")
        raise


@dataclass(frozen=True)
class PrescribedVelocity:
    """Velocity component given on tagged facets.

    Args:
        facets: facet tag.
        component: 0, 1 (or 2).
        value: velocity (m/s).
        where: which of their nodes, a function of positions x, shape (3, n), m, that returns
            shape (n,), bool; None for all. A node in 2D, or a row of them in 3D, bears as a
            roller or a knife edge does: it leaves the rotation free, which a whole facet holds.
    """

    facets: int
    component: int
    value: Value
    where: Where | None = None


@dataclass(frozen=True)
class PrescribedDisplacement:
    """Displacement component given on tagged facets at the end of each step.

    Args:
        facets: facet tag.
        component: 0, 1 (or 2).
        value: displacement (m), zero at the start.
        where: which of their nodes, a function of positions x, shape (3, n), m, that returns
            shape (n,), bool; None for all. A node in 2D, or a row of them in 3D, bears as a
            roller or a knife edge does: it leaves the rotation free, which a whole facet holds.
    """

    facets: int
    component: int
    value: Value
    where: Where | None = None


def nodes_that_move(
    motion: PrescribedVelocity | PrescribedDisplacement, x: np.ndarray
) -> npt.NDArray[np.bool_]:
    """Of nodes of a motion's facets at positions x, shape (3, n), m, those that it moves.

    Raises:
        ValueError: its `where` returns another shape.
        TypeError: it is no function, or does not return booleans.
    """
    n = x.shape[1]
    if motion.where is None:
        return np.ones(n, bool)
    name = f"The `where` of {type(motion).__name__} on tag {motion.facets}"
    if not callable(motion.where):
        raise TypeError(f"{name} is {motion.where!r}; expected a function of positions.")
    says = np.asarray(motion.where(x))
    if says.dtype != np.bool_:
        raise TypeError(f"{name} returned {says.dtype}; expected bool.")
    if says.shape != (n,):
        raise ValueError(f"{name} returned shape {says.shape}; expected {(n,)}.")
    return says


@dataclass(frozen=True)
class BodyForce:
    """Force per unit reference volume (N/m^3) in every cell.

    Args:
        value: one number or function of time a component, or a function of time that gives them
            all.
    """

    value: VectorValue


@dataclass(frozen=True)
class Gravity:
    """Acceleration (m/s^2) acting on the mass of every cell and rigid body.

    Args:
        value: one number or function of time a component, or a function of time that gives them
            all.
    """

    value: VectorValue


@dataclass(frozen=True)
class SurfaceTraction:
    """Nominal traction (Pa, per reference area) on tagged facets.

    Args:
        facets: facet tag.
        value: one number or function of time a component, or a function of time that gives them
            all.
    """

    facets: int
    value: VectorValue


@dataclass(frozen=True)
class InitialStress:
    """Stress (Pa) that the bodies are under before anything moves, tension positive.

    Displacements count from that state: the stress is `value` + C : eps(u), and the force on a
    test function v is - int value : eps(v) dx. What balances the stress is given too (gravity,
    tractions) or holds it (prescribed motions, contacts). Its work is among that of the external
    forces. Materials are linear elastic ones.

    Args:
        value: symmetric, shape (dim, dim), or a function of positions, shape (3, n), m, that gives
            shape (dim, dim, n). In 2D the stress across the plane counts as zero.
    """

    value: npt.ArrayLike | Callable[[np.ndarray], npt.ArrayLike]

    def at(self, x: np.ndarray, dim: int) -> np.ndarray:
        """The stress at positions, shape (3, n), as an array of shape (dim, dim, n).

        Raises:
            ValueError: another shape, entries that are not finite, an unsymmetric stress.
            TypeError: an expression of UFL.
        """
        shape, given = (dim, dim), self.value
        refuse_expression("The value of InitialStress", given, "numbers or a function of positions")
        if callable(given):
            shape = (dim, dim, x.shape[1])
            try:
                given = given(x)
            except Exception as error:
                error.add_note(self._wrong("a function that fails", dim))
                raise
        try:
            stress = np.asarray(given)
        except ValueError:  # rows of several lengths
            stress = np.array(None)
        if stress.dtype.kind not in "biuf":
            raise ValueError(self._wrong(f"the value {short(given)}", dim))
        if stress.shape != shape:
            raise ValueError(self._wrong(f"the shape {stress.shape}", dim))
        stress = np.broadcast_to(stress.reshape(dim, dim, -1), (dim, dim, x.shape[1])).astype(float)
        if not np.all(np.abs(stress) < _LARGEST_STRESS):
            raise ValueError(self._wrong("entries that are not finite or above 1e150 Pa", dim))
        if np.abs(stress - stress.swapaxes(0, 1)).max() > 1e-9 * np.abs(stress).max():
            raise ValueError(self._wrong("two shear stresses that differ", dim))
        return stress

    @staticmethod
    def _wrong(found: str, dim: int) -> str:
        return (
            f"InitialStress has {found}; it should be finite and symmetric, {dim} x {dim} numbers "
            f"(Pa) or a function of positions of shape (3, n) that gives ({dim}, {dim}, n)."
        )


@dataclass(frozen=True)
class RayleighDamping:
    """Linear viscous damping C = mass M + stiffness K0, K0 the stiffness at rest.

    Args:
        mass: coefficient of the mass (1/s).
        stiffness: coefficient of the stiffness (s).

    Raises:
        ValueError: a coefficient negative or not finite.
    """

    mass: float = 0.0
    stiffness: float = 0.0

    def __post_init__(self) -> None:
        for name in ("mass", "stiffness"):
            object.__setattr__(self, name, require_non_negative(name, getattr(self, name)))
