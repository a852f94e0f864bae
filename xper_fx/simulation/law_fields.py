# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of the fields of a scene's laws at their points."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.facets import facet_shapes
from xper_fx.nscd.laws.fields import Places, law_at
from xper_fx.nscd.laws.parameters import fields_of
from xper_fx.support.function_values import function_values

if TYPE_CHECKING:
    from xper_fx.nscd.laws.law import Law
    from xper_fx.scene.scene import Scene
    from xper_fx.simulation.permanent_points import ScenePoints


def laws_at_points(laws: list[Law], points: ScenePoints, scene: Scene) -> list[Law]:
    """The laws with numbers, or arrays over this rank's points, in the place of fields.

    Args:
        laws: of `points`, then those of searched contacts alone.

    Raises:
        ValueError: a value that the law refuses; a field in the law of searched contacts.
    """
    searched = [contact.law for contact in scene.contacts]
    for law in laws:
        if fields_of(law) and law in searched:
            raise ValueError(
                f"{law!r} has a field and is for contacts that are searched, which have no place "
                "of their own: give numbers."
            )
    on_facets, others = _on_facets(points, scene), points.apart_from_facets()
    law_of_point = points.law_of_point
    places = _joined([on_facets, *(_elsewhere(on_facets, *given) for given in others)])
    return [
        law_at(law, places.take(law_of_point == number), _scalar) for number, law in enumerate(laws)
    ]


def _on_facets(points: ScenePoints, scene: Scene) -> Places:
    """Where this rank's points on facing facets are."""
    facets, (place, law) = scene.bodies.facets, points.on_facets()
    which, on_facet = np.divmod(place, max(points.points_a_facet, 1))
    facet = points.facets_with_law[which]
    nodes = scene.bodies.facet_nodes(scene.order)
    shapes = facet_shapes(scene.dim, nodes.shape[1], scene.points)
    x = np.einsum("pk,pkd->pd", shapes[on_facet], nodes[facet])
    return Places(
        _of_three(x), _of_three(facets.normal[facet]), facets.bodies[facet].T,
        facets.materials[facet].T, facets.measure[facet], facet,
        *_among_the_laws(points, scene, place, law),
        len(facets) if scene.bodies.spread is None else None,
    )  # fmt: skip


def _among_the_laws(
    points: ScenePoints, scene: Scene, place: np.ndarray, law: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Number of each point among those of its law on all ranks, and how many these are."""
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
    return Places(_of_three(x), _of_three(normal), pair, pair, area, none, none, none,
                  like.num_facets)  # fmt: skip


def _of_three(vectors: np.ndarray) -> np.ndarray:
    """Vectors, shape (n, dim), with three components, shape (3, n)."""
    out = np.zeros((3, len(vectors)))
    out[: vectors.shape[1]] = vectors.T
    return out


def _joined(parts: list[Places]) -> Places:
    names = [item.name for item in fields(Places) if item.name != "num_facets"]
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in names
    }
    return Places(**arrays, num_facets=parts[0].num_facets)


def _scalar(function, x: np.ndarray) -> np.ndarray:
    return function_values(function, x)[:, 0]
