# SPDX-License-Identifier: LGPL-3.0-or-later
"""Parameters of laws: a number each, or a field that differs from point to point.

A law is made with numbers and fields. Where its points are known, each field has become an array of
numbers, a `PointArray`, and the law is made again with these: so its checks and its arithmetic are
written once, for numbers and arrays alike, and run where the numbers are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from xper_fx.support.checks import refuse_expression, require_number, require_numbers


class PointArray(np.ndarray):
    """Numbers of a parameter at the points of a law, shape (num_points,)."""


class EntryError(ValueError):
    """A number of an array is wrong.

    Attributes:
        entry: its index.
    """

    def __init__(self, message: str, entry: int):
        self.entry = entry
        super().__init__(message)


class Values:
    """An array over facets or points as a parameter; equal to itself alone.

    Attributes:
        values: shape (num_facets,), (num_facets, points of a facet) or (num_points,).
    """

    def __init__(self, values: np.ndarray):
        self.values = values

    def __repr__(self) -> str:
        low, high = self.values.min(initial=np.inf), self.values.max(initial=-np.inf)
        return f"<{self.values.size} values, {low:.6g} to {high:.6g}>"


def is_field(value: Any) -> bool:
    """Whether a parameter differs from point to point and is not known yet."""
    return callable(value) or isinstance(value, Values) or hasattr(value, "sample")


def take_parameters(
    law: Any,
    positive: Iterable[str] = (),
    non_negative: Iterable[str] = (),
    shares: Iterable[str] = (),
    positive_pairs: Iterable[str] = (),
    optional: Iterable[str] = (),
    numbers: str | None = None,
) -> bool:
    """Check parameters of a law, in its `__post_init__`; lists and arrays become fields.

    Args:
        law: a frozen dataclass.
        positive, non_negative: names of parameters above zero, or not below it.
        shares: names of parameters in (0, 1].
        positive_pairs: names of pairs of parameters above zero.
        optional: names of parameters above zero that may be None.
        numbers: name of a mapping of any parameters.

    Returns:
        Whether all are known. Fields are not: with them the law goes without further checks until
        it is made again.

    Raises:
        TypeError: a parameter that is neither a number nor a field.
        ValueError: a number out of range.
    """
    given = (name for name in optional if getattr(law, name) is not None)
    checks = (
        ((*given, *positive), _is_positive, "a finite number above zero"),
        (non_negative, lambda x: (x >= 0.0) & np.isfinite(x), "a finite number, zero or above"),
        (shares, lambda x: (x > 0.0) & (x <= 1.0), "a number in (0, 1]"),
    )
    fields = []
    for names, is_right, wanted in checks:
        for name in names:
            value = _taken(name, getattr(law, name))
            object.__setattr__(law, name, value)
            if is_field(value):
                fields.append(name)
            _require(name, value, is_right, wanted)
    for name in positive_pairs:
        pair = _pair(name, getattr(law, name))
        object.__setattr__(law, name, pair)
        if any(map(is_field, pair)):
            fields.append(name)
        for place, value in enumerate(pair):
            _require(f"{name}[{place}]", value, _is_positive, "a finite number above zero")
    if numbers is not None:
        values = {name: _taken(name, value) for name, value in getattr(law, numbers).items()}
        object.__setattr__(law, numbers, values)
        if any(map(is_field, values.values())):
            fields.append(numbers)
    object.__setattr__(law, "_fields", tuple(fields))
    return not fields


def _is_positive(x: np.ndarray) -> np.ndarray:
    return (x > 0.0) & np.isfinite(x)


def _require(name: str, value: Any, is_right: Callable[..., Any], wanted: str) -> None:
    """Check a number, or an array; other fields are checked where their values are."""
    if isinstance(value, Values):
        bad = np.argwhere(~is_right(value.values))
        if len(bad):
            entry = ", ".join(map(str, bad[0]))
            raise ValueError(
                f"{name} should be {wanted}, got {value.values[tuple(bad[0])]}, entry {entry}."
            )
    if is_field(value):
        return
    refuse_where(
        ~is_right(np.asarray(value)), lambda at: f"{name} should be {wanted}, got {at(value)}."
    )


def _pair(name: str, value: Any) -> tuple[Any, Any]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise TypeError(
            f"{name} should be a pair, of pure opening and of pure shear, got {value!r}."
        )
    first, second = (_taken(f"{name}[{place}]", item) for place, item in enumerate(value))
    return first, second


def acts(value: Any) -> bool:
    """Whether what a parameter stands for is compiled: it is not zero, or a field.

    A field counts whatever its values are, for all ranks to have the same kernels.
    """
    return is_field(value) or isinstance(value, PointArray) or bool(value)


def fields_of(law: Any) -> tuple[str, ...]:
    """Names of the parameters of a law that are fields, or pairs and mappings with some."""
    return getattr(law, "_fields", ())


def given_fields(law: Any) -> list[Any]:
    """The fields of a law, and what is beside them in pairs and mappings."""
    given: list[Any] = []
    for item in (getattr(law, name) for name in fields_of(law)):
        several = isinstance(item, Mapping | tuple)
        given += (item.values() if isinstance(item, Mapping) else item) if several else [item]
    return given


def _taken(name: str, value: Any) -> Any:
    if not hasattr(value, "function_space") or value.ufl_shape:
        refuse_expression(name, value, "a number, an array, a function or a scalar one of DOLFINx")
    if is_field(value) or isinstance(value, PointArray):
        return value
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim):
        array = require_numbers(name, value)
        if array.ndim not in (1, 2) or array.size < 2:
            raise ValueError(
                f"{name} should be a number, or an array with one for each facet or point, got "
                f"{str(value)[:60]} of shape {array.shape}."
            )
        return Values(array)
    return require_number(name, value)


def refuse_where(bad: Any, message: Callable[[Callable[[Any], Any]], str]) -> None:
    """Raise a ValueError if a condition holds, somewhere if it is an array.

    Args:
        bad: the condition, of one law's numbers.
        message: gives the text; it takes a function that gives of an array the first entry that is
            bad, and any number as it is.
    """
    if not np.any(bad):
        return
    if np.ndim(bad) == 0:
        raise ValueError(message(lambda value: value))
    entry = int(np.argmax(bad))
    pick = lambda value: float(np.broadcast_to(value, np.shape(bad))[entry])  # noqa: E731
    raise EntryError(message(pick), entry)
