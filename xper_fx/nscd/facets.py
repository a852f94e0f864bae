# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interaction points on facing facets, from matched nodes.

*Nodal* points sit on the nodes, each with its share of the facet: every bond has its own pair of
nodes, so that stiff bonds do not make the traction oscillate between neighbours (the Newton-Cotes
or lumped integration of interface elements; Schellekens and de Borst 1993). *Gauss* points
integrate a smooth traction more accurately, and oscillate when bonds are stiff beside the bulk.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from xper_fx.nscd.points import InteractionPoints, frame_from_normal

if TYPE_CHECKING:
    from xper_fx.nscd.lips import Lips

# Shares of the facet at its nodes. The quadratic triangle takes the diagonal of its mass matrix:
# the exact rule would leave its vertices without any.
_NODAL_SHARES = {
    (2, 2): (1 / 2, 1 / 2),
    (2, 3): (1 / 6, 1 / 6, 2 / 3),
    (3, 3): (1 / 3, 1 / 3, 1 / 3),
    (3, 4): (1 / 4, 1 / 4, 1 / 4, 1 / 4),
    (3, 6): (1 / 19, 1 / 19, 1 / 19, 16 / 57, 16 / 57, 16 / 57),
}


def _line_rule(count: int) -> tuple[np.ndarray, np.ndarray]:
    x, w = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * w


def _linear_line():
    x, w = _line_rule(2)
    return np.stack([1.0 - x, x], axis=1), w


def _quadratic_line():
    x, w = _line_rule(3)
    shapes = [(1.0 - x) * (1.0 - 2.0 * x), x * (2.0 * x - 1.0), 4.0 * x * (1.0 - x)]
    return np.stack(shapes, axis=1), w


def _linear_triangle():
    shapes = np.full((3, 3), 1 / 6) + 0.5 * np.eye(3)
    return shapes, np.full(3, 1 / 3)


def _quadratic_triangle():
    """Six points, degree 4 (Dunavant 1985)."""
    groups = ((0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322))
    barycentric, weights = [], []
    for a, weight in groups:
        for j in range(3):
            point = [a, a, a]
            point[j] = 1.0 - 2.0 * a
            barycentric.append(point)
            weights.append(weight)
    b, w = np.array(barycentric), np.array(weights)
    vertex = b * (2.0 * b - 1.0)
    edge = [4.0 * b[:, 1] * b[:, 2], 4.0 * b[:, 0] * b[:, 2], 4.0 * b[:, 0] * b[:, 1]]
    return np.concatenate([vertex, np.stack(edge, axis=1)], axis=1), w / w.sum()


_GAUSS_RULES = {
    (2, 2): _linear_line,
    (2, 3): _quadratic_line,
    (3, 3): _linear_triangle,
    (3, 6): _quadratic_triangle,
}


def nodal_shares(dim: int, k: int) -> np.ndarray:
    """Share of a facet's area at each of its k nodes, vertices first.

    Raises:
        ValueError: facets of this kind have no nodal rule.
    """
    if (dim, k) not in _NODAL_SHARES:
        raise ValueError(
            f"Facets of {k} nodes in dimension {dim} carry no interaction points: take order=1, or "
            "triangles or tetrahedra."
        )
    return np.array(_NODAL_SHARES[dim, k])


def facet_shapes(dim: int, k: int, rule: str) -> np.ndarray:
    """Shape functions of a facet's nodes at its points, shape (num_points, k).

    Args:
        k: nodes of a facet.
        rule: "nodal" or "gauss".
    """
    return np.eye(k) if rule == "nodal" else _GAUSS_RULES[dim, k]()[0]


def facet_points(
    nodes: np.ndarray, normal: np.ndarray, measure: np.ndarray, rule: str = "nodal"
) -> InteractionPoints:
    """Points on facing facets, facet after facet.

    Args:
        nodes: shape (num_facets, 2, k), matched nodes: candidate, antagonist; vertices first.
        normal: shape (num_facets, dim), unit, from antagonist to candidate.
        measure: shape (num_facets,), length or area (m, m^2).
        rule: "nodal" or "gauss".

    Returns:
        The points; `len(points) // num_facets` on each facet.

    Raises:
        ValueError: an unknown rule, or one that facets of this kind do not have.
    """
    count, _, k = nodes.shape
    dim = normal.shape[1]
    if rule == "nodal":
        shares = nodal_shares(dim, k)
        shapes = np.ones((k, 1))
        on_point = nodes.transpose(0, 2, 1)[..., None]
    elif rule == "gauss":
        if (dim, k) not in _GAUSS_RULES:
            raise ValueError(f"There is no Gauss rule for facets of {k} nodes in dimension {dim}.")
        shapes, shares = _GAUSS_RULES[dim, k]()
        on_point = np.repeat(nodes[:, None], len(shares), axis=1)
    else:
        raise ValueError(f'rule should be "nodal" or "gauss", got {rule!r}.')
    num = len(shares)
    sides = on_point.shape[-1]
    weights = np.broadcast_to(shapes[None, :, None, :], (count, num, 2, sides))
    return InteractionPoints(
        np.ascontiguousarray(on_point.reshape(-1, 2, sides), dtype=np.int32),
        np.ascontiguousarray(weights.reshape(-1, 2, sides)),
        frame_from_normal(np.repeat(normal, num, axis=0)),
        np.outer(measure, shares).ravel(),
        np.zeros(count * num),
    )


def with_lips(
    points: InteractionPoints, nodes: np.ndarray, x: np.ndarray, rule: str
) -> InteractionPoints:
    """Points of `facet_points` whose frames turn with their facets.

    Args:
        points: facet after facet.
        nodes: shape (num_facets, 2, k), as of `facet_points`.
        x: shape (num_facets, k, dim), positions of the nodes (m).
        rule: "nodal" or "gauss".
    """
    from xper_fx.nscd.lips import facet_lips

    shapes = facet_shapes(points.dim, nodes.shape[2], rule)
    return replace(points, lips=facet_lips(nodes, x, points.frame, shapes))


def wall_points(
    nodes: np.ndarray, area: np.ndarray, normal: np.ndarray, gap: np.ndarray, ground: int, k: int
) -> InteractionPoints:
    """Points of nodes against a fixed plane obstacle.

    Args:
        nodes: shape (num_points,), candidate nodes.
        area: shape (num_points,), tributary area (m^2; 2D: m).
        normal: shape (dim,), unit, out of the obstacle.
        gap: shape (num_points,), distance to the obstacle at the start (m).
        ground: the ground's node.
        k: nodes a side that the other points of the scene have; the rest are given no weight.

    Returns:
        One point a node.
    """
    count = len(nodes)
    both = np.full((count, 2, k), ground, dtype=np.int32)
    both[:, 0] = nodes[:, None]  # all of one body, as the layer expects of a side
    weights = np.zeros((count, 2, k))
    weights[:, :, 0] = 1.0
    frame = frame_from_normal(np.broadcast_to(normal, (count, len(normal))))
    return InteractionPoints(both, weights, frame, np.asarray(area, float), np.asarray(gap, float))


def no_points(dim: int) -> InteractionPoints:
    """A set of points without any."""
    return InteractionPoints(
        np.zeros((0, 2, 1), np.int32),
        np.zeros((0, 2, 1)),
        np.zeros((0, dim, dim)),
        np.zeros(0),
        np.zeros(0),
    )


def join_points(parts: list[InteractionPoints]) -> InteractionPoints:
    """Several sets of points as one, in order; sides of fewer nodes get some without weight."""
    k = max(part.nodes.shape[2] for part in parts)
    parts = [part if part.nodes.shape[2] == k else _widened(part, k) for part in parts]
    return InteractionPoints(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("nodes", "weights", "frame", "area", "gap")
        ),
        lips=_joined_lips(parts),
    )


def _joined_lips(parts: list[InteractionPoints]) -> Lips | None:
    """The lips of several sets of points; where some have none their frames stay as they are."""
    if all(part.lips is None for part in parts):
        return None
    from xper_fx.nscd.lips import join_lips, still_lips

    return join_lips(
        [
            still_lips(part.nodes[:, :, :1], part.frame) if part.lips is None else part.lips
            for part in parts
        ]
    )


def _widened(points: InteractionPoints, k: int) -> InteractionPoints:
    """Points with k nodes a side: the first of each again, all of one body as the layer expects."""
    more = k - points.nodes.shape[2]
    nodes = np.concatenate([points.nodes, np.repeat(points.nodes[:, :, :1], more, axis=2)], axis=2)
    weights = np.pad(points.weights, ((0, 0), (0, 0), (0, more)))
    return replace(points, nodes=np.ascontiguousarray(nodes), weights=weights)
