# SPDX-License-Identifier: LGPL-3.0-or-later
"""Whether the mappings and lists of a scene are such."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Integral
from reprlib import repr as short
from typing import Any

import numpy as np


def check_containers(given_by_name: Mapping[str, Any]) -> None:
    """See that mappings are mappings, and lists lists, whose keys are tags or pairs of tags.

    Args:
        given_by_name: attributes of a `Scene`.

    Raises:
        TypeError: one of another kind.
    """
    for name, example in (
        ("materials", "{1: LinearElastic(...)}"),
        ("interactions", "{(1, 2): CohesiveZone(...)}"),
        ("facet_interactions", "{7: SignoriniCoulomb()}"),
        ("surfaces", '{"beam": [1]}'),
    ):
        given = given_by_name[name]
        if not isinstance(given, Mapping):
            raise TypeError(f"{name} should be a mapping such as {example}, got {given!r}.")
    for name in ("walls", "loads", "ties", "rigid", "contacts", "joints"):
        given = given_by_name[name]
        if not isinstance(given, Sequence) or isinstance(given, str):
            raise TypeError(f"{name} should be a list, [...], got {short(given)}.")
    for pair in given_by_name["interactions"]:
        if not (isinstance(pair, tuple) and len(pair) == 2 and all(map(_is_tag, pair))):
            raise TypeError(f"interactions names {pair!r}; it should name pairs of cell tags.")
    for name in ("materials", "facet_interactions"):
        for tag in given_by_name[name]:
            if not _is_tag(tag):
                raise TypeError(f"{name} names {tag!r}; it should name tags, integers.")
    for name, tags in given_by_name["surfaces"].items():
        if isinstance(tags, str) or not np.iterable(tags) or not all(map(_is_tag, tags)):
            raise TypeError(f"The surface {name!r} should be a list of cell tags, got {tags!r}.")


def _is_tag(tag: object) -> bool:
    return isinstance(tag, Integral)
