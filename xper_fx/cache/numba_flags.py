# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numba's options of a function, compared at once: a tenth of the time that compiling takes.

Numba looks compiled functions up by the options in force, some ten thousand times a kernel. To hash
or compare them it builds a dictionary of all its forty options each time. Options are equal here
under the same conditions, and their hash, that of the options' names, is kept.
"""

from __future__ import annotations

from functools import cache

from numba.core.targetconfig import TargetConfig


@cache
def _defaults(kind: type[TargetConfig]) -> dict[str, object]:
    return {name: option.default for name, option in kind.options.items()}


@cache
def _hash_of_names(kind: type[TargetConfig]) -> int:
    return hash(tuple(sorted(kind.options)))


def _equal(flags: TargetConfig, other: object) -> bool:
    if flags is other:
        return True
    if not isinstance(other, TargetConfig):
        return NotImplemented
    given, others = flags._values, other._values
    if type(flags) is type(other) and given == others:
        return True
    return _defaults(type(flags)) | given == _defaults(type(other)) | others


def compare_at_once() -> None:
    """Let Numba compare options in this way, from now on, in this process."""
    TargetConfig.__eq__ = _equal
    TargetConfig.__hash__ = lambda flags: _hash_of_names(type(flags))
