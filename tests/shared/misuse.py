# SPDX-License-Identifier: LGPL-3.0-or-later
"""A misuse of the public interface, and what became of it.

Of bad input a script should hear before any work: what was given, what is expected, what to do. A
`Misuse` is one bad call; `outcome` makes it and says which of these it was:

    clear     an error of the package that says what its `words` ask for
    warned    a warning that does, where the input may be meant
    right     what was asked for has a meaning, and that was done
    obscure   an error from below the package, of another kind or with other words; many warnings
    silent    nothing was said
"""

from __future__ import annotations

import logging
import re
import traceback
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import xper_fx as xf

GOOD, BAD = ("clear", "warned", "right"), ("obscure", "silent", "hung")
RIGHT = object()
"""What a misuse gives back that turned out to have a meaning, and had it."""

PACKAGE = str(Path(xf.__file__).parent)
# Errors of the package; Python itself says clearly which argument is unknown or missing.
ERRORS = (
    ValueError, TypeError, OSError, ImportError, RuntimeError, xf.CheckpointError,
    xf.SmallStrainError,
)  # fmt: skip
BY_PYTHON = (
    r"unexpected keyword argument|missing \d+ required|positional arguments? but|"
    r"cannot assign to field"
)
# Warnings of Python that are beside the point: NaN met in passing, a file left to be closed.
_BESIDE = (RuntimeWarning, ResourceWarning)
# More warnings than this are not read.
MOST_WARNINGS = 3

NAN, INF = float("nan"), float("inf")
NUMBERS = (NAN, INF, -1.0, 0.0, None, "1", [1.0], 1j, True)


class Misuse(NamedTuple):
    """A bad call.

    Attributes:
        name: what is wrong.
        words: regular expressions that the error or the warning has, separated by " & ".
        act: makes the call.
    """

    name: str
    words: str
    act: Callable[[], object]


class Outcome(NamedTuple):
    """What became of a misuse.

    Attributes:
        kind: one of `GOOD` and `BAD`.
        told: the error or the warnings.
    """

    kind: str
    told: str


def outcome(misuse: Misuse) -> Outcome:
    """Make a bad call."""
    with _warnings() as told:
        try:
            answer = misuse.act()
        except Exception as error:
            return _of_error(misuse, error)
    if answer is RIGHT:
        return Outcome("right", "")
    text = " | ".join(told)
    if not told:
        return Outcome("silent", "")
    clear = _has(misuse.words, text) and len(told) <= MOST_WARNINGS
    return Outcome("warned" if clear else "obscure", f"{len(told)} warnings: {text}")


def _of_error(misuse: Misuse, error: Exception) -> Outcome:
    frames = traceback.extract_tb(error.__traceback__)
    # what the package adds to an error of a user's function
    notes = getattr(error, "__notes__", [])
    ours = bool(notes) or frames[-1].filename.startswith(PACKAGE)
    text = " ".join([f"{type(error).__name__}: {error}", *notes])
    said = _has(misuse.words, text) or re.search(BY_PYTHON, text)
    by_python = isinstance(error, TypeError | AttributeError) and re.search(BY_PYTHON, str(error))
    attribute = isinstance(error, AttributeError) and (
        frames[-1].filename.endswith("lazy.py") or frames[-1].name == "__setattr__"
    )
    # those of the system name the file themselves
    ours = ours or isinstance(error, OSError)
    clear = said and (by_python or attribute or notes or (ours and isinstance(error, ERRORS)))
    where = "" if ours else f" (raised in {Path(frames[-1].filename).name})"
    return Outcome("clear" if clear else "obscure", text + where)


def _has(words: str, text: str) -> bool:
    return all(re.search(word, text, re.IGNORECASE | re.DOTALL) for word in words.split(" & "))


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """The texts of all warnings that are given within, by the package or by Python."""
    told: list[str] = []

    class Taking(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            told.append(record.getMessage())

    handler, logger = Taking(logging.WARNING), logging.getLogger("xper_fx")
    logger.addHandler(handler)
    before, logger.propagate = logger.propagate, False
    try:
        with warnings.catch_warnings(record=True) as by_python:
            warnings.simplefilter("always")
            yield told
    finally:
        logger.removeHandler(handler)
        logger.propagate = before
        told += [str(w.message) for w in by_python if w.category not in _BESIDE]


def bad_numbers(
    label: str,
    make: Callable[..., Any],
    good: Mapping[str, Any],
    *,
    allowed: Mapping[str, Collection] | None = None,
    called: Mapping[str, str] | None = None,
    fixed: Mapping[str, Any] | None = None,
) -> list[Misuse]:
    """Each number of a call replaced by each of `NUMBERS`.

    Args:
        label: of the call.
        make: what is called, with keywords.
        good: its numbers.
        allowed: for some of them, what is no misuse.
        called: for some of them, what messages call them.
        fixed: other arguments.
    """
    allowed, called = allowed or {}, called or {}
    misuses = []
    for name in good:
        for value in NUMBERS:
            if any(value is v or value == v for v in allowed.get(name, ()) if value is not True):
                continue
            text = str(value).rstrip("0").rstrip(".") if isinstance(value, float) else str(value)
            if value == 0.0 and value is not True:
                text = "0"
            arguments = {**good, **(fixed or {}), name: value}
            words = f"{called.get(name, name)} & {re.escape(text)}"
            misuses.append(
                Misuse(f"{label}({name}={value!r})", words, lambda a=arguments: make(**a))
            )
    return misuses
