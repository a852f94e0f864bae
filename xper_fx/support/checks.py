# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the numbers a user gives: what was given, what was expected."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any

import numpy as np


def require_number(name: str, value: Any) -> float:
    """The value as a float, which may be infinite or NaN.

    Raises:
        TypeError: no real number.
        ValueError: an integer beyond the range of floats.
    """
    if not isinstance(value, Real):
        raise TypeError(f"{name} should be a number, got {value!r}.")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{name} should be a finite number, got one above 1e308.") from None


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
    if not isinstance(value, Integral):
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
    if array.dtype.kind not in "biuf" and array.size:
        raise TypeError(f"{name} should be numbers, got {values!r}.")
    return array.astype(float)
