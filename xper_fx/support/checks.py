# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of what a user gives: what was given, what was expected."""

from __future__ import annotations

import math
import os
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np

# Letters of what is given above which a message names its class alone.
_LONG = 80


def require_number(name: str, value: Any) -> float:
    """The value as a float, which may be infinite or NaN.

    Raises:
        TypeError: no real number.
        ValueError: an integer beyond the range of floats.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise TypeError(f"{name} should be a number, got {value!r}.")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} should be a finite number, got one above 1e308.") from None


def refuse_expression(name: str, value: Any, wanted: str) -> None:
    """Refuse what UFL computes with: it can be called, and NumPy reads it as an array without end.

    Args:
        name: of what was given.
        wanted: what it should be, which may be a function of DOLFINx.

    Raises:
        TypeError: an expression, a DOLFINx constant or function.
    """
    shape = getattr(type(value), "ufl_shape", None)
    if shape is not None:
        raise TypeError(
            f"{name} is a {type(value).__name__} of shape {value.ufl_shape}, an expression of UFL; "
            f"it should be {wanted}."
        )


def require_positive(name: str, value: Any) -> float:
    """The value as a float.

    Raises:
        TypeError: no real number.
        ValueError: not a finite number above zero.
    """
    number = require_number(name, value)
    if not (math.isfinite(number) and number > 0.0):
        raise ValueError(f"{name} should be a finite number above zero, got {value}.")
    return number


def require_non_negative(name: str, value: Any) -> float:
    """The value as a float.

    Raises:
        TypeError: no real number.
        ValueError: not a finite number, zero or above.
    """
    number = require_number(name, value)
    if not (math.isfinite(number) and number >= 0.0):
        raise ValueError(f"{name} should be a finite number, zero or above, got {value}.")
    return number


def require_between(name: str, value: Any, low: float, high: float) -> float:
    """The value as a float.

    Raises:
        TypeError: no real number.
        ValueError: not between two numbers, or one of them.
    """
    number = require_number(name, value)
    if not low < number < high:
        raise ValueError(f"{name} should lie in ({low:g}, {high:g}), got {value}.")
    return number


def require_count(name: str, value: Any, least: int) -> int:
    """The value as an int.

    Raises:
        TypeError: no integer.
        ValueError: below `least`.
    """
    require_integer(name, value)
    if value < least:
        raise ValueError(f"{name} should be at least {least}, got {value}.")
    return int(value)


def require_integer(name: str, value: Any) -> None:
    """Raise TypeError unless a value is an integer."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} should be an integer, got {value!r}.")


def take_numbers(item: Any, *names: str) -> None:
    """Turn attributes of a frozen dataclass into floats, in its `__post_init__`.

    Raises:
        TypeError, ValueError: as `require_number`, with the name of the attribute.
    """
    for name in names:
        object.__setattr__(item, name, require_number(name, getattr(item, name)))


def require_numbers(name: str, values: Any) -> np.ndarray:
    """The values as a new array of floats, of any shape, which may be infinite or NaN.

    Raises:
        TypeError: something that is no array of real numbers.
    """
    try:
        array = np.array(values)
    except ValueError:  # lists of different lengths
        array = np.array(None)
    if array.dtype.kind not in "iuf" and array.size:
        raise TypeError(f"{name} should be numbers, got {_said(values)}.")
    return array.astype(float)


def require_vector(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The values as a new array of finite floats of a shape.

    Raises:
        TypeError: something that is no array of real numbers.
        ValueError: another shape, or a number that is not finite.
    """
    array = require_numbers(name, values)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(
            f"{name} should be finite numbers of shape {shape}, got {_said(values)} of shape "
            f"{array.shape}."
        )
    return array


def require_flag(name: str, value: Any) -> bool:
    """The value as a bool.

    Raises:
        TypeError: neither True nor False.
    """
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} should be True or False, got {value!r}.")
    return bool(value)


def require_kind(name: str, value: Any, *kinds: type) -> None:
    """Raise TypeError unless a value is of one of some classes."""
    if isinstance(value, kinds):
        return
    wanted = " or ".join(f"a {kind.__name__}" for kind in kinds)
    if isinstance(value, type):
        raise TypeError(
            f"{name} should be {wanted}, got the class {value.__name__}: make an object of it, "
            f"{value.__name__}(...)."
        )
    raise TypeError(f"{name} should be {wanted}, got {_said(value)}.")


def _said(value: Any) -> str:
    given = repr(value)
    return given if len(given) < _LONG else f"a {type(value).__name__}"


def require_path(name: str, value: Any) -> Path:
    """The value as a path.

    Raises:
        TypeError: neither a text nor a path.
        ValueError: an empty text.
    """
    if not isinstance(value, str | os.PathLike):
        raise TypeError(f"{name} should be a path, got {value!r}.")
    if not os.fspath(value):
        raise ValueError(f'{name} should be a path, got {value!r}; "." is the present folder.')
    return Path(value)
