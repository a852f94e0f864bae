# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of edges with edges (3D): where two convex edges of surfaces cross.

The line of shortest distance between two edges runs along e_a x e_b. It is a local minimum of the
distance between the two solids if the facets of both edges recede from it: with t the direction
from an edge into one of its facets, n . t_b <= 0 for those of the antagonist b and n . t_a >= 0 for
those of the candidate a. This decides the sign of n whether the solids are apart or penetrate;
g = n . (p_a - p_b), with p_a - p_b = g n, so that equal and opposite impulses along n have no
moment. Edges flatter than 2 degrees are left to nodes and facets, as are parallel ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.search.facet_geometry import Faces

# Sine of the angle by which an edge must be bent to count.
_BENT = 0.035
# Cosine within which a facet counts as receding, against rounding.
_RECEDING = 1e-3
# Sine of the angle below which edges are parallel.
_PARALLEL = 1e-2
# Share of an edge at its ends that is left to nodes.
_END = 1e-9


def convex_edges(
    x: np.ndarray, facets: np.ndarray, chosen: np.ndarray, weld: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Convex edges of the chosen facets.

    Args:
        x: positions, shape (num_nodes, 3), m.
        facets: triangles, shape (f, 3).
        chosen: facets that are part of the surface, ascending.
        weld: which nodes count as one, shape (num_nodes,).
        normal: of the facets, shape (f, 3).

    Returns:
        Number 3 f + j of each edge in the first facet that has it, from node j to node j + 1,
        ascending; and the other facet, that facet itself if there is none, or several.
    """
    ends = np.stack([facets[chosen], np.roll(facets[chosen], -1, axis=1)], axis=2).reshape(-1, 2)
    number = (3 * chosen[:, None] + np.arange(3)).ravel()
    ranked = np.sort(weld[ends].astype(np.int64), axis=1)
    order = np.lexsort((number, ranked[:, 1], ranked[:, 0]))
    ranked, number = ranked[order], number[order]
    begins = np.ones(len(number), bool)
    begins[1:] = (ranked[1:] != ranked[:-1]).any(axis=1)
    first = np.flatnonzero(begins)
    paired = np.diff(np.append(first, len(number))) == 2
    edge = number[first]
    other = edge // 3
    other[paired] = number[first[paired] + 1] // 3
    # convex: the other facet lies below the plane of the first
    corner = facets[other]
    rise = x[corner] - x[facets[edge // 3, edge % 3]][:, None]
    height = np.einsum("ejd,ed->ej", rise, normal[edge // 3])
    sine = height.min(axis=1) / np.linalg.norm(rise, axis=2).max(axis=1)
    sharp = ~paired | (sine < -_BENT)
    order = np.argsort(edge[sharp])
    return edge[sharp][order], other[sharp][order]


@njit(**LEAN_INNER)
def _recedes(n, sign, direction, facet_normal, turn):
    """Whether a facet beside an edge recedes against sign * n; turn = 1 if it runs along it."""
    t0 = facet_normal[1] * direction[2] - facet_normal[2] * direction[1]
    t1 = facet_normal[2] * direction[0] - facet_normal[0] * direction[2]
    t2 = facet_normal[0] * direction[1] - facet_normal[1] * direction[0]
    return sign * turn * (n[0] * t0 + n[1] * t1 + n[2] * t2) <= _RECEDING


class Crossings(NamedTuple):
    """Contacts of edges; the first `found` rows.

    Attributes:
        pair: shape (n,), int32, of those that were looked at.
        weights: share of the second node of each edge, shape (n, 2).
        normal, gap, area: shape (n, 3), (n,), (n,); m, m^2.
    """

    pair: np.ndarray
    weights: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    area: np.ndarray


def crossings(
    pairs: np.ndarray, edges: np.ndarray, others: np.ndarray, faces: Faces, reach: float
) -> Crossings:
    """Find the contacts of pairs of edges.

    Args:
        pairs: numbers among the edges, shape (p, 2).
        edges, others: of `convex_edges`.
        faces: `Faces`.
        reach: largest gap (m).
    """
    room = len(pairs)
    out = Crossings(
        np.empty(room, np.int32),
        np.empty((room, 2)),
        np.empty((room, 3)),
        np.empty(room),
        np.empty(room),
    )
    found = _edge_edge(pairs, edges, others, faces, reach, out, np.empty((2, 3)), np.empty(3))
    return Crossings(*(array[:found] for array in out))


@njit(**LEAN_ENTRY)
def _edge_edge(pairs, edges, others, faces, reach, out, along, n):
    """Write the contacts into `out`, and return their number; `along` and `n` are room."""
    x, facets, weld, normal, depth = faces.x, faces.facets, faces.weld, faces.normal, faces.depth
    count = 0
    for i in range(len(pairs)):
        ea, eb = edges[pairs[i, 0]], edges[pairs[i, 1]]
        fa, fb = ea // 3, eb // 3
        a0, a1 = facets[fa, ea % 3], facets[fa, (ea + 1) % 3]
        b0, b1 = facets[fb, eb % 3], facets[fb, (eb + 1) % 3]
        if (
            weld[a0] == weld[b0]
            or weld[a0] == weld[b1]
            or weld[a1] == weld[b0]
            or weld[a1] == weld[b1]
        ):
            continue
        uu = uv = vv = ru = rv = 0.0
        for d in range(3):
            u, v, r = x[a1, d] - x[a0, d], x[b1, d] - x[b0, d], x[b0, d] - x[a0, d]
            along[0, d] = u
            along[1, d] = v
            uu += u * u
            uv += u * v
            vv += v * v
            ru += r * u
            rv += r * v
        det = uu * vv - uv * uv
        if det < _PARALLEL * _PARALLEL * uu * vv:
            continue
        s = (vv * ru - uv * rv) / det
        t = (uv * ru - uu * rv) / det
        if s < _END or s > 1.0 - _END or t < _END or t > 1.0 - _END:
            continue
        gap = 0.0
        for d in range(3):
            e, g = (d + 1) % 3, (d + 2) % 3
            n[d] = (along[0, e] * along[1, g] - along[0, g] * along[1, e]) / np.sqrt(det)
            gap += n[d] * (x[a0, d] - x[b0, d])
        for d in range(3):
            along[0, d] /= np.sqrt(uu)
            along[1, d] /= np.sqrt(vv)
        deepest = min(depth[fa], depth[fb])
        for sign in (1.0, -1.0):
            if sign * gap > reach or sign * gap < -deepest:
                continue
            if not (
                _recedes(n, sign, along[1], normal[fb], 1.0)
                and _recedes(n, -sign, along[0], normal[fa], 1.0)
            ):
                continue
            oa, ob = others[pairs[i, 0]], others[pairs[i, 1]]
            if ob != fb and not _recedes(n, sign, along[1], normal[ob], -1.0):
                continue
            if oa != fa and not _recedes(n, -sign, along[0], normal[oa], -1.0):
                continue
            out.pair[count] = i
            out.weights[count, 0] = s
            out.weights[count, 1] = t
            out.gap[count] = sign * gap
            out.area[count] = min(faces.share[fa], faces.share[fb])
            for d in range(3):
                out.normal[count, d] = sign * n[d]
            count += 1
            break
    return count
