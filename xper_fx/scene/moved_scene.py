# SPDX-License-Identifier: LGPL-3.0-or-later
"""A scene whose mesh is spread over ranks, with its bodies on other ranks.

Arrays of values for facing facets, which laws may have, go with the facets. DOLFINx functions stay,
and ranks ask each other for their values (`bodies/function_values.py`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from xper_fx.bodies.moved import moved
from xper_fx.nscd.laws.parameters import Values, fields_of, given_fields

if TYPE_CHECKING:
    from xper_fx.scene.scene import Scene


def moved_scene(scene: Scene, rank_of_body: np.ndarray) -> Scene:
    """Bring the bodies of a scene to other ranks; all ranks call it together.

    Args:
        scene: as it is; its mesh is spread over the ranks.
        rank_of_body: shape (num_bodies of this rank,), where each is to go.
    """
    bodies = scene.bodies
    own = bodies.spread.rank_of_body == bodies.spread.ranks.rank
    rank = np.zeros(len(own), np.int64)
    rank[own] = rank_of_body
    of_cell = bodies.body_of_cell[own[bodies.body_of_cell]]
    arrays = {
        id(value): value
        for law in _laws(scene)
        for value in given_fields(law)
        if isinstance(value, Values)
    }
    tables = [array.values for array in arrays.values()]
    bodies, tables = moved(bodies, rank[of_cell], tables)
    new_values = {key: Values(table) for key, table in zip(arrays, tables, strict=True)}
    new_laws = {id(law): _with_values(law, new_values) for law in _laws(scene)}

    def renewed(given: Any) -> Any:
        if isinstance(given, Mapping):
            return {key: renewed(law) for key, law in given.items()}
        return new_laws.get(id(given))

    # it has been checked, and is what it was
    other = copy(scene)
    changed = {name: renewed(getattr(scene, name)) for name in _WITH_LAWS} | {"bodies": bodies}
    for name, value in changed.items():
        object.__setattr__(other, name, value)
    vars(other).pop("_facet_laws", None)
    return other


# Attributes of a scene that have laws of facing facets.
_WITH_LAWS = ("interactions", "default_interaction", "facet_interactions")


def _laws(scene: Scene) -> Iterator[Any]:
    """Laws of facing facets, in an order that is the same on all ranks."""
    for name in _WITH_LAWS:
        given = getattr(scene, name)
        for law in given.values() if isinstance(given, Mapping) else [given]:
            if law is not None:
                yield law


def _with_values(law: Any, new: Mapping[int, Values]) -> Any:
    """A law with other arrays in the place of its own, which `new` has by their identity."""
    if not any(id(one) in new for one in given_fields(law)):
        return law
    given: dict[str, Any] = {}
    for name in fields_of(law):
        value = getattr(law, name)
        if isinstance(value, Mapping):
            given[name] = {key: new.get(id(one), one) for key, one in value.items()}
        elif isinstance(value, tuple):
            given[name] = tuple(new.get(id(one), one) for one in value)
        else:
            given[name] = new.get(id(value), value)
    return replace(law, **given)
