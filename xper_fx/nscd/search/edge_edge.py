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
BENT = 0.035
# Cosine within which a facet counts as receding, against rounding.
_RECEDING = 1e-3
# Sine of the angle below which edges are parallel.
_PARALLEL = 1e-2
# Share of an edge at its ends that is left to nodes.
_END = 1e-9


def surface_edges(
    facets: np.ndarray, chosen: np.ndarray, joined: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the chosen facets.

    Args:
        facets: triangles, shape (f, 3).
        chosen: facets that are part of the surface, ascending.
        joined: of `Bonds.joined_edges`: which of their edges are one, shape (len(chosen), 3).

    Returns:
        Number 3 f + j of each edge in the first facet that has it, from node j to node j + 1,
        ascending; and the other facet, that facet itself if there is none, or several.
    """
    number = (3 * chosen[:, None] + np.arange(3)).ravel()
    joined = joined.ravel()
    order = np.argsort(joined, kind="stable")
    joined, number = joined[order], number[order]
    first = np.flatnonzero(np.diff(joined, prepend=-1))
    paired = np.diff(np.append(first, len(number))) == 2
    edge = number[first]
    other = edge // 3
    other[paired] = number[first[paired] + 1] // 3
    order = np.argsort(edge)
    return edge[order], other[order]


def edge_bends(
    x: np.ndarray, facets: np.ndarray, edges: np.ndarray, others: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """How far the other facet of each edge falls below the first: minus a sine, -1 without one.

    Args:
        x: positions, shape (num_nodes, 3), m.
        facets: triangles, shape (f, 3).
        edges, others: of `surface_edges`.
        normal: of the facets, shape (f, 3).
    """
    out = np.full(len(edges), -1.0)
    _bends(x, facets, edges, others, normal, out)
    return out


@njit(**LEAN_ENTRY)
def _bends(x, facets, edges, others, normal, out):
    for i in range(len(edges)):
        f, g, from_node = edges[i] // 3, others[i], facets[edges[i] // 3, edges[i] % 3]
        if f == g:
            continue
        lowest = longest = 0.0
        for j in range(3):
            height = square = 0.0
            for d in range(3):
                rise = x[facets[g, j], d] - x[from_node, d]
                height += rise * normal[f, d]
                square += rise * rise
            lowest = min(lowest, height)
            longest = max(longest, square)
        out[i] = lowest / np.sqrt(longest)


@njit(**LEAN_INNER)
def _recedes(n, sign, direction, facet_normal, turn):
    """Whether a facet beside an edge recedes against sign * n; turn = 1 if it runs along it."""
    t0 = facet_normal[1] * direction[2] - facet_normal[2] * direction[1]
    t1 = facet_normal[2] * direction[0] - facet_normal[0] * direction[2]
    t2 = facet_normal[0] * direction[1] - facet_normal[1] * direction[0]
    return sign * turn * (n[0] * t0 + n[1] * t1 + n[2] * t2) <= _RECEDING


class Crossings(NamedTuple):
    """Contacts of edges; the first `found` rows."""

    pair: np.ndarray  #: shape (n,), int32, of those that were looked at
    weights: np.ndarray  #: share of the second node of each edge, shape (n, 2)
    normal: np.ndarray  #: shape (n, 3)
    gap: np.ndarray  #: shape (n,), m
    area: np.ndarray  #: shape (n,), m^2


def crossings(
    pairs: np.ndarray,
    edges: np.ndarray,
    others: np.ndarray,
    bends: np.ndarray,
    faces: Faces,
    reach: float,
) -> Crossings:
    """Find the contacts of pairs of edges.

    Args:
        pairs: numbers among the edges, shape (p, 2).
        edges, others: of `surface_edges`.
        bends: of `edge_bends`.
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
    bent = bends < -BENT
    scratch = np.empty((2, 3)), np.empty(3)
    found = _edge_edge(pairs, edges, others, bent, faces, reach, out, scratch)
    return Crossings(*(array[:found] for array in out))


@njit(**LEAN_ENTRY)
def _edge_edge(pairs, edges, others, bent, faces, reach, out, scratch):
    """Write the contacts into `out`, and return their number."""
    along, n = scratch
    x, facets, weld, normal, depth = faces.x, faces.facets, faces.weld, faces.normal, faces.depth
    count = 0
    for i in range(len(pairs)):
        if not (bent[pairs[i, 0]] and bent[pairs[i, 1]]):
            continue
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
