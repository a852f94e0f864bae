# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of the fields of a scene's laws at their points."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.bodies.function_values import function_values, is_function
from xper_fx.nscd.facets import facet_shapes
from xper_fx.nscd.laws.fields import Places, draws, law_at
from xper_fx.nscd.laws.parameters import fields_of, given_fields

if TYPE_CHECKING:
    from xper_fx.nscd.laws.law import Law
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.permanent_points import ScenePoints
    from xper_fx.support.ranks import Ranks


def laws_at_points(laws: list[Law], points: ScenePoints, scene: Scene, ranks: Ranks) -> list[Law]:
    """The laws with numbers, or arrays over this rank's points, in the place of fields.

    Args:
        laws: of `points`, then those of searched contacts alone.
        ranks: those that simulate the scene, which call it together.

    Raises:
        ValueError: a value that the law refuses; a field in the law of searched contacts.
    """
    numbered = None
    if scene.bodies is not None and any(map(draws, laws)):
        numbered = scene.bodies.facet_places()
    places = ranks.together(lambda: _of_laws(laws, points, scene, numbered))
    values = [_of_functions(law, there, ranks) for law, there in zip(laws, places, strict=True)]
    return ranks.together(lambda: list(map(law_at, laws, places, values)))


def _of_laws(
    laws: list[Law], points: ScenePoints, scene: Scene, numbered: tuple[np.ndarray, int] | None
) -> list[Places]:
    """Where this rank's points of each law are."""
    searched = [contact.law for contact in scene.contacts]
    for law in laws:
        if fields_of(law) and law in searched:
            raise ValueError(
                f"{law!r} has a field and is for contacts that are searched, which have no place "
                "of their own: give numbers."
            )
    on_facets, others = _on_facets(points, scene, numbered), points.apart_from_facets()
    law_of_point = points.law_of_point
    places = _joined([on_facets, *(_elsewhere(on_facets, *given) for given in others)])
    return [places.take(law_of_point == number) for number in range(len(laws))]


def _of_functions(law: Law, places: Places, ranks: Ranks) -> dict[int, np.ndarray]:
    """Values of a law's DOLFINx functions by their identity; all ranks call it together."""
    functions = filter(is_function, given_fields(law))
    return {id(one): function_values(one, places.x, ranks)[:, 0] for one in functions}


def _on_facets(
    points: ScenePoints, scene: Scene, numbered: tuple[np.ndarray, int] | None
) -> Places:
    """Where this rank's points on facing facets are.

    Args:
        numbered: what `Bodies.facet_places` gives, if laws have random fields.
    """
    facets, (place, law) = scene.bodies.facets, points.on_facets()
    which, on_facet = np.divmod(place, max(points.points_a_facet, 1))
    facet = points.facets_with_law[which]
    nodes = scene.bodies.facet_nodes(scene.order)
    shapes = facet_shapes(scene.dim, nodes.shape[1], scene.points)
    x = np.einsum("pk,pkd->pd", shapes[on_facet], nodes[facet])
    place_of, count = numbered or (np.zeros(len(facets), int), 0)
    sides = scene.bodies.numbers_on_all(facets.bodies[facet])
    return Places(
        _of_three(x), _of_three(facets.normal[facet]), sides.T,
        facets.materials[facet].T, facets.measure[facet], facet,
        *_among_the_laws(points, scene, place, law), on_facet, place_of[facet],
        len(facets), count, points.points_a_facet,
    )  # fmt: skip


def _among_the_laws(
    points: ScenePoints, scene: Scene, place: np.ndarray, law: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Number of each point among those of its law on all ranks, and how many these are."""
    if scene.bodies.spread is not None:
        return np.full((2, len(place)), -1)
    _, law_of_facet = scene.law_of_facet()
    everywhere = np.repeat(law_of_facet[points.facets_with_law], points.points_a_facet)
    among = np.empty(len(everywhere), int)
    for one in np.unique(everywhere):
        here = everywhere == one
        among[here] = np.arange(np.count_nonzero(here))
    count = np.bincount(everywhere, minlength=1)
    return among[place], count[law] if len(law) else np.zeros(0, int)


def _elsewhere(like: Places, x: np.ndarray, normal: np.ndarray, area: np.ndarray) -> Places:
    """Where the points of a tie or a wall are."""
    none = np.full(len(x), -1)
    pair = np.stack([none, none])
    return replace(
        like, x=_of_three(x), normal=_of_three(normal), bodies=pair, materials=pair, area=area,
        facet=none, number=none, num_points=none, on_facet=none, place=none,
    )  # fmt: skip


def _of_three(vectors: np.ndarray) -> np.ndarray:
    """Vectors, shape (n, dim), with three components, shape (3, n)."""
    out = np.zeros((3, len(vectors)))
    out[: vectors.shape[1]] = vectors.T
    return out


def _joined(parts: list[Places]) -> Places:
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=-1)
        for name, array in vars(parts[0]).items()
        if isinstance(array, np.ndarray)
    }
    return replace(parts[0], **arrays)
