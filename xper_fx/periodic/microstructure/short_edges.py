# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tessellations rid of their short edges, which give meshes cells of bad quality.

Random tessellations have edges of any shortness, relaxed by Lloyd's algorithm or not: where
dim + 2 seeds are nearly on a sphere, two vertices nearly coincide. A small move of these seeds
parts the vertices again, so that the grains remain true power cells: convex, with plane faces.

The moves descend the penalty E = sum over edges of max(0, 1 - l / l_0)^2, l an edge's length. Of
its gradient: a vertex v with the seeds p_0, ..., p_dim has |v - p_i|^2 - w_i = |v - p_0|^2 - w_0,
hence (p_0 - p_i) . dv = (v - p_i) . dp_i - (v - p_0) . dp_0. With M the matrix of the rows
p_0 - p_i, i > 0, and lambda solving M^T lambda = dE/dv,

    dE/dp_i = lambda_i (v - p_i),    dE/dp_0 = -sum(lambda) (v - p_0).

The step is B. T. Polyak's for a known minimum (USSR Comput. Math. Math. Phys. 9 (1969) 14-29), here
0: against the gradient by E / |gradient|^2, damped, and limited for the topology changes under way.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from xper_fx.periodic.microstructure.tessellation import Tessellation, tessellate
from xper_fx.support.checks import require_count, require_kind, require_non_negative

__all__ = ["lengthen_short_edges"]

# Edges up to this many times the length asked for are lengthened.
_OVERSHOOT = 1.2
# Of Polyak's step, and the longest move of a seed relative to the mean distance of seeds.
_DAMPING = 0.7
_LONGEST_MOVE = 0.05


def lengthen_short_edges(
    tessellation: Tessellation, length: float, max_steps: int = 400
) -> Tessellation:
    """Move seeds a little such that all edges of the grains have a length.

    Args:
        tessellation: what to improve, of whole grains; it is left as it was. Weights stay.
        length: m. In the mean distance of seeds, (volume / number)^(1 / dim), about 0.3 can be
            reached in 2D, 0.15 in 3D.
        max_steps: after this many moves it is given up.

    Returns:
        A tessellation whose shortest edge is at least `length`; the same one if it has that.

    Raises:
        TypeError: no tessellation, something that is no number.
        ValueError: the length is negative or not finite, or was not reached; grains are cut; with
            weights, a grain vanished.
        RuntimeError: as `tessellate`.
    """
    require_kind("tessellation", tessellation, Tessellation)
    require_count("max_steps", max_steps, 1)
    if tessellation.is_cut:
        raise ValueError("The grains are cut by the box; lengthen their edges before that.")
    length = require_non_negative("length", length)
    spacing = (tessellation.periods.prod() / tessellation.num_grains) ** (1 / tessellation.dim)
    improved = tessellation
    longest = improved.shortest_edge
    for _ in range(max_steps):
        if improved.shortest_edge >= length:
            return improved
        penalty, gradient = _penalty(improved, _OVERSHOOT * length)
        if not gradient.any():
            break  # a lattice whose edges are all alike
        step = -_DAMPING * penalty * gradient / np.sum(gradient**2)
        step *= min(1.0, _LONGEST_MOVE * spacing / np.linalg.norm(step, axis=1).max())
        improved = tessellate(improved.seeds + step, improved.periods, improved.weights)
        longest = max(longest, improved.shortest_edge)
    raise ValueError(
        f"Moves of the seeds ({max_steps} at most) do not bring all edges to {length:g} m; the "
        f"shortest edge was {longest:g} m at best, the mean distance of the seeds is "
        f"{spacing:g} m: ask for a smaller length."
    )


def _penalty(tessellation: Tessellation, target: float) -> tuple[float, npt.NDArray[np.float64]]:
    """Return the penalty of edges below a target length, and its gradient by the seeds."""
    penalty, by_vertex = 0.0, np.zeros_like(tessellation.vertices)
    for a, b, edge in _edges(tessellation):
        length = np.linalg.norm(edge)
        if length < target:
            lack = 1 - length / target
            penalty += lack**2
            pull = 2 * lack / target * edge / length
            by_vertex[a] += pull
            by_vertex[b] -= pull
    around = _seeds_of_vertices(tessellation)
    by_seed = np.zeros_like(tessellation.seeds)
    for v in np.flatnonzero(by_vertex.any(axis=1)):
        if len(around[v]) != tessellation.dim + 1:
            continue  # of a lattice: which way it parts is left to its neighbours
        seeds = np.array([seed for seed, *_ in around[v]])
        shifts = np.array([shift for _, *shift in around[v]])
        place = tessellation.seeds[seeds] + shifts * tessellation.periods
        factor = np.linalg.solve((place[0] - place[1:]).T, by_vertex[v])
        arms = tessellation.vertices[v] - place
        np.add.at(by_seed, seeds[1:], factor[:, np.newaxis] * arms[1:])
        by_seed[seeds[0]] -= factor.sum() * arms[0]
    return penalty, by_seed


def _edges(
    tessellation: Tessellation,
) -> list[tuple[int, int, npt.NDArray[np.float64]]]:
    """Return the edges, one of each class: two vertices and the way from the first to the second.

    An edge is found in all the faces around it.
    """
    edges: dict[tuple[int, ...], tuple[int, int, npt.NDArray[np.float64]]] = {}
    for face in tessellation.faces:
        x = tessellation.vertices[face.corners] + face.corner_shifts * tessellation.periods
        following = np.roll(np.arange(len(x)), -1)
        for here, there in zip(range(len(x)), following, strict=True):
            a, b = int(face.corners[here]), int(face.corners[there])
            apart = (face.corner_shifts[there] - face.corner_shifts[here]).tolist()
            edge = x[there] - x[here]
            if (b, *np.negative(apart).tolist()) < (a, *apart):
                a, b, apart, edge = b, a, [-k for k in apart], -edge
            edges[a, b, *apart] = (a, b, edge)
    return list(edges.values())


def _seeds_of_vertices(tessellation: Tessellation) -> list[list[tuple[int, ...]]]:
    """Return for each vertex, in its own place, the seeds around it: seed, shift of the seed."""
    around: list[set[tuple[int, ...]]] = [set() for _ in tessellation.vertices]
    for grain, sides in enumerate(tessellation.boundaries):
        for side in sides:
            face = tessellation.faces[side.face]
            moved = (-(face.corner_shifts + side.shift)).tolist()
            for corner, shift in zip(face.corners.tolist(), moved, strict=True):
                around[corner].add((grain, *shift))
    return [sorted(seeds) for seeds in around]
