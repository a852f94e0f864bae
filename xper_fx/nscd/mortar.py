# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Interaction points between surfaces whose nodes do not match.

The surfaces, of segments in 2D and triangles in 3D, coincide in space; their nodes need not. Points
sit on the nodes of one of them, the candidates, each with its share of that surface.

*Mortar* points weigh the antagonists by dual multipliers (Wohlmuth 2000). On a facet with k nodes
these are psi_i = (k + 1) N_i - 1, for which int psi_i N_j = delta_ij A_i, so that with

    A_i = int psi_i,    m_il = int psi_i N_l / A_i    (N_l of the antagonists)

the jump of point i is u_i - sum_l m_il u_l, its weights add up to one, and the impulses r_i of a
uniform traction, A_i times it, push each antagonist node with int N_l times it. A uniform stress
thus passes exactly. The integrals are those over the overlaps of the facets of both sides, polygons
on which the integrand is quadratic. With perfect bonds the displacement converges as that of a mesh
without an interface does (order 2 in L2, 1 in energy; Bernardi, Maday and Patera 1994).

*Node* points take sum_l N_l(x_i) u_l at the antagonist facet that holds the candidate node. A
linear displacement passes, a uniform traction only if kinks of the antagonists lie on candidate
nodes (nested meshes): sum_i A_i N_l(x_i) is the rule of trapezes for int N_l. Where they do not,
stresses next to the interface keep an error that refinement does not mend, and displacements there
converge with order 1.

Ties at every quadrature point of the overlaps are not offered: as many constraints leave both
traces no kinks but those that the meshes share, and lock.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from xper_fx.cache import njit
from xper_fx.nscd.facets import no_points, nodal_shares
from xper_fx.nscd.points import InteractionPoints, frame_from_normal

if TYPE_CHECKING:
    from xper_fx.nscd.lips import Lips

RULES = ("mortar", "nodes")
"""Rules of `nonmatching_points`."""

# Distance beside the size of facets within which surfaces coincide, and share of a facet, or
# barycentric coordinate, that is rounding.
_APART, _SLIVER = 1e-6, 1e-9
# Share of a candidate facet that antagonists may leave uncovered.
_UNCOVERED = 1e-6


class MisfitError(ValueError):
    """Surfaces that do not fit each other at some facets or nodes.

    Args:
        kind: of what is wrong: that of a lower kind is told first.
        first: nodes of the first place, in whose order places are on all ranks.
        count: of the places.
        text: what is wrong at the first, with {} for the count.
    """

    def __init__(self, kind: int, first: list[int], count: int, text: str):
        super().__init__(kind, first, count, text)
        self.kind, self.first, self.count, self.text = kind, first, count, text

    def __str__(self) -> str:
        return self.text.format(self.count)


class TiedSurface(NamedTuple):
    """Facets of a surface, with all that points on them ask for."""

    number: np.ndarray  #: shape (num_facets, dim), numbers of nodes that all ranks have alike
    node: np.ndarray  #: shape (num_facets, dim), numbers of nodes on their rank
    x: np.ndarray  #: shape (num_facets, dim, dim), positions of nodes (m)
    inside: np.ndarray  #: shape (num_facets, dim), a point within the cell of each
    body: np.ndarray  #: shape (num_facets,), numbers that all ranks have alike
    rank: np.ndarray  #: shape (num_facets,)

    def take(self, which: np.ndarray) -> TiedSurface:
        """Some of the facets."""
        return TiedSurface(*(array[which] for array in self))


class TiedPoints(NamedTuple):
    """Points of a tie."""

    points: InteractionPoints  #: on nodes that are rows of the last two arrays
    number: np.ndarray  #: shape (num_points,), by which they are in order on all ranks
    x: np.ndarray  #: shape (num_points, dim), where they are (m)
    #: shape (num_points, 2), candidate and antagonist, by numbers that all ranks have alike
    bodies: np.ndarray
    node: np.ndarray  #: shape (num_nodes,), numbers of nodes on their ranks
    rank: np.ndarray  #: shape (num_nodes,), ranks of nodes

    def take(self, which: np.ndarray) -> TiedPoints:
        """Some of the points."""
        return self._replace(
            points=self.points.take(which), number=self.number[which], x=self.x[which],
            bodies=self.bodies[which],
        )  # fmt: skip

    def on(self, nodes: np.ndarray) -> TiedPoints:
        """The points on nodes that `nodes`, shape (num_nodes,), has in the places of these."""
        return self._replace(points=self.points.on(nodes))


def nonmatching_points(
    x: np.ndarray,
    candidates: np.ndarray,
    antagonists: np.ndarray,
    inside: np.ndarray,
    body: np.ndarray,
    rule: str = "mortar",
    turns: bool = False,
) -> InteractionPoints:
    """Points on the nodes of the candidates, against the antagonists.

    Args:
        x: positions of the nodes, shape (num_nodes, dim), m.
        candidates: nodes of the candidate facets, shape (num_candidates, dim).
        antagonists: nodes of the antagonist facets, shape (num_antagonists, dim).
        inside: a point within the cell of each candidate, which tells where it is, (num, dim).
        body: body of each node, shape (num_nodes,).
        rule: "mortar" or "nodes".
        turns: whether frames turn with the surfaces.

    Returns:
        One point a candidate node, in ascending order of nodes; without gap.

    Raises:
        ValueError: facets that are neither segments nor triangles.
        MisfitError: candidates not covered by the antagonists, or several bodies around a candidate
            node (mortar).
    """
    dim = x.shape[1]
    for nodes in (candidates, antagonists):
        if nodes.shape[1] != dim:
            raise ValueError(
                f"Surfaces that do not match should be of {'segments' if dim == 2 else 'triangles'}"
                f" of order 1, got facets of {nodes.shape[1]} nodes: take triangles or tetrahedra "
                "of order 1."
            )
    if not len(candidates):
        return no_points(dim)
    normal, measure = _outward(x, candidates, inside)
    nodes, place = np.unique(candidates, return_inverse=True)
    place = place.reshape(candidates.shape)
    area = np.bincount(place.ravel(), np.outer(measure, nodal_shares(dim, dim)).ravel())
    if rule == "mortar":
        weights = _mortar(x, candidates, antagonists, normal, measure, place, len(nodes))
    else:
        weights = _collocated(x, nodes, antagonists)
    others, share = _by_rows(weights)
    mixed = np.any((body[others] != body[others[:, :1]]) & (share != 0.0), axis=1)
    if np.any(mixed):
        first = nodes[np.argmax(mixed)]
        raise MisfitError(
            1, [int(first)], np.count_nonzero(mixed),
            f"The antagonists around the candidate node at {x[first].tolist()} are of several "
            'bodies ({} such nodes): take rule="nodes", or swap candidates and antagonists.',
        )  # fmt: skip
    turned = np.zeros((len(nodes), dim))
    np.add.at(turned, place.ravel(), np.repeat(-normal * measure[:, None], dim, axis=0))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    k = others.shape[1]
    sides = np.stack([np.repeat(nodes[:, None], k, axis=1), others], axis=1)
    own = np.zeros((len(nodes), k))
    own[:, 0] = 1.0
    frame = frame_from_normal(turned)
    lips = None
    if turns:
        nearest = np.take_along_axis(others, np.abs(share).argmax(axis=1)[:, None], axis=1)[:, 0]
        sides_of = ((nodes, candidates), (nearest, antagonists))
        lips = _lips_around([_around(x, at, facets, frame) for at, facets in sides_of], frame)
    return InteractionPoints(
        np.ascontiguousarray(sides, np.int32),
        np.stack([own, share], axis=1),
        frame,
        area,
        np.zeros(len(nodes)),
        lips=lips,
    )


def _around(x, at, facets, frame) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of all facets around a node at each point, and the area-weighted mean of their G."""
    from xper_fx.nscd.lips import along_tangents, facet_derivatives

    dim = x.shape[1]
    corners = facets.ravel()
    order, count = np.argsort(corners, kind="stable"), np.bincount(corners, minlength=len(x))
    number = count[at]
    point = np.repeat(np.arange(len(at)), number)
    place = np.arange(len(point)) - np.repeat(np.cumsum(number) - number, number)
    facet = order[(np.cumsum(count) - count)[at][point] + place] // dim
    here = x[facets[facet]]
    own = facet_derivatives(dim, dim, np.zeros((1, dim)))[0]
    along = np.einsum("ka,nkd->nad", own, here)
    measure = np.sqrt(np.linalg.det(np.einsum("nad,nbd->nab", along, along)))
    share = measure / np.bincount(point, measure)[point]
    gradient = along_tangents(np.tile(own, (len(point), 1, 1)), here, frame[point, 1:])
    gradient *= share[:, None, None]
    where = np.repeat(point, dim), facets[facet].ravel()
    rows = [
        _by_rows(sp.coo_array((gradient[:, :, a].ravel(), where), shape=(len(at), len(x))).tocsr())
        for a in range(dim - 1)
    ]
    return rows[0][0], np.stack([values for _, values in rows], axis=2)


def _lips_around(sides, frame) -> Lips:
    """Lips of points whose sides have facets of their own: nodes and G of each side."""
    from xper_fx.nscd.lips import Lips

    k = max(nodes.shape[1] for nodes, _ in sides)
    nodes = [np.pad(n, ((0, 0), (0, k - n.shape[1])), mode="edge") for n, _ in sides]
    gradients = [np.pad(g, ((0, 0), (0, k - g.shape[1]), (0, 0))) for _, g in sides]
    return Lips(
        np.stack(nodes, axis=1).astype(np.int32),
        np.stack(gradients, axis=1),
        np.ascontiguousarray(frame[:, 1:]),
        np.zeros(len(frame), bool),
    )


def _outward(x, facets, inside):
    """Unit normals out of the bodies, and measures."""
    corners = x[facets]
    if x.shape[1] == 2:
        along = corners[:, 1] - corners[:, 0]
        area = np.stack([along[:, 1], -along[:, 0]], axis=1)
    else:
        area = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    measure = np.linalg.norm(area, axis=1)
    normal = area / measure[:, None]
    inward = np.einsum("fd,fd->f", inside - corners.mean(axis=1), normal) > 0.0
    normal[inward] *= -1.0
    return normal, measure


def _by_rows(weights: sp.csr_array) -> tuple[np.ndarray, np.ndarray]:
    """Columns and values of each row, padded with the row's first column and zeros."""
    count = np.diff(weights.indptr)
    k = int(count.max(initial=1))
    number = np.arange(k)
    entry = weights.indptr[:-1, None] + np.where(number < count[:, None], number, 0)
    return weights.indices[entry], np.where(number < count[:, None], weights.data[entry], 0.0)


def _neighbours(x, candidates, antagonists) -> np.ndarray:
    """Pairs of facets that may overlap, by their circumscribed balls, shape (n, 2)."""
    centres, radii = [], []
    for facets in (candidates, antagonists):
        corners = x[facets]
        centre = corners.mean(axis=1)
        centres.append(centre)
        radii.append(np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1))
    reach = radii[0] + radii[1].max(initial=0.0)
    near = cKDTree(centres[1]).query_ball_point(centres[0], reach)
    pairs = np.stack(
        [np.repeat(np.arange(len(near)), [len(n) for n in near]), np.concatenate(near)], axis=1
    ).astype(np.int64)
    apart = np.linalg.norm(centres[0][pairs[:, 0]] - centres[1][pairs[:, 1]], axis=1)
    return pairs[apart < radii[0][pairs[:, 0]] + radii[1][pairs[:, 1]]]


def _mortar(x, candidates, antagonists, normal, measure, place, count) -> sp.csr_array:
    """m_il by rows of candidate nodes and columns of nodes."""
    dim = x.shape[1]
    pairs = _neighbours(x, candidates, antagonists)
    overlap = _segment_overlaps if dim == 2 else _triangle_overlaps
    pair, weight, own, other = overlap(
        x, candidates, antagonists, pairs, normal, measure ** (1.0 / (dim - 1))
    )
    facet, opposite = pairs[pair].T
    covered = np.bincount(facet, weight, minlength=len(candidates))
    bare = np.flatnonzero(np.abs(covered - measure) > _UNCOVERED * measure)
    if bare.size:
        first = bare[np.lexsort(candidates[bare].T[::-1])[0]]
        raise MisfitError(
            0, candidates[first].tolist(), bare.size,
            f"The antagonists cover {100.0 * covered[first] / measure[first]:.4g} % of the "
            f"candidate facet at {x[candidates[first]].mean(axis=0).tolist()} ({{}} such facets): "
            "the candidates should lie within the antagonists, which touch them; tag fewer facets "
            "or swap the sides.",
        )  # fmt: skip
    psi = (dim + 1) * own - 1.0
    rows = np.repeat(place[facet], dim, axis=1)
    columns = np.tile(antagonists[opposite], (1, dim))
    values = weight[:, None, None] * psi[:, :, None] * other[:, None, :]
    sums = sp.coo_array(
        (values.ravel(), (rows.ravel(), columns.ravel())), shape=(count, len(x))
    ).tocsr()
    share = np.asarray(sums.sum(axis=1)).ravel()
    sums = sp.csr_array(sp.diags_array(1.0 / share) @ sums)
    sums.data[np.abs(sums.data) < _SLIVER] = 0.0
    sums.eliminate_zeros()
    return sp.csr_array(sp.diags_array(1.0 / np.asarray(sums.sum(axis=1)).ravel()) @ sums)


def _collocated(x, nodes, antagonists) -> sp.csr_array:
    """N_l at each candidate node by rows."""
    corners = x[antagonists]
    size = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    near = cKDTree(corners.mean(axis=1)).query_ball_point(x[nodes], 1.001 * size.max(initial=0.0))
    row = np.repeat(np.arange(len(nodes)), [len(n) for n in near])
    facet = np.concatenate(near).astype(np.int64)
    base, edges = corners[facet, 0], corners[facet, 1:] - corners[facet, :1]
    away = x[nodes[row]] - base
    gram = np.einsum("fad,fbd->fab", edges, edges)
    inner = np.linalg.solve(gram, np.einsum("fad,fd->fa", edges, away)[..., None])[..., 0]
    shape = np.concatenate([1.0 - inner.sum(axis=1, keepdims=True), inner], axis=1)
    distance = np.linalg.norm(away - np.einsum("fa,fad->fd", inner, edges), axis=1)
    beside = np.maximum(-shape.min(axis=1), 0.0)
    wrong = np.maximum(beside, distance / size[facet])
    order = np.lexsort((wrong, row))
    row, facet, shape, wrong = row[order], facet[order], shape[order], wrong[order]
    found, first = np.unique(row, return_index=True)
    missing = np.setdiff1d(np.arange(len(nodes)), found[wrong[first] <= _APART])
    if missing.size:
        first = nodes[missing[0]]
        raise MisfitError(
            0, [int(first)], missing.size,
            f"No antagonist facet holds the candidate node at {x[first].tolist()} ({{}} such "
            "nodes): the candidates should lie within the antagonists, which touch them; tag fewer "
            "facets or swap the sides.",
        )  # fmt: skip
    shape = np.where(np.abs(shape[first]) < _SLIVER, 0.0, shape[first])
    shape /= shape.sum(axis=1, keepdims=True)
    entries = (np.repeat(found, x.shape[1]), antagonists[facet[first]].ravel())
    weights = sp.csr_array(sp.coo_array((shape.ravel(), entries), shape=(len(nodes), len(x))))
    weights.eliminate_zeros()
    return weights


def _segment_overlaps(x, candidates, antagonists, pairs, normal, size):
    """Gauss points on the overlaps of segments: pair, weight, shape functions of both sides."""
    p, q = x[candidates[pairs[:, 0]]], x[antagonists[pairs[:, 1]]]
    length = size[pairs[:, 0]]
    tangent = (p[:, 1] - p[:, 0]) / length[:, None]
    along = np.einsum("nkd,nd->nk", q - p[:, :1], tangent)
    off = np.abs(np.einsum("nkd,nd->nk", q - p[:, :1], normal[pairs[:, 0]])).max(axis=1)
    low = np.maximum(along.min(axis=1), 0.0)
    high = np.minimum(along.max(axis=1), length)
    meet = np.flatnonzero((high - low > _SLIVER * length) & (off <= _APART * length))
    roots, gauss = np.polynomial.legendre.leggauss(2)
    at = 0.5 * ((high + low)[meet, None] + (high - low)[meet, None] * roots)
    weight = 0.5 * (high - low)[meet, None] * gauss
    own = at / length[meet, None]
    start, end = along[meet, :1], along[meet, 1:]
    other = (at - start) / (end - start)
    shapes = [np.stack([1.0 - s.ravel(), s.ravel()], axis=1) for s in (own, other)]
    return np.repeat(meet, 2), weight.ravel(), *shapes


def _triangle_overlaps(x, candidates, antagonists, pairs, normal, size):
    """As `_segment_overlaps`, for triangles: polygons cut into triangles, three points each."""
    p, q = x[candidates[pairs[:, 0]]], x[antagonists[pairs[:, 1]]]
    frame = frame_from_normal(normal)[pairs[:, 0]]
    p, q = (np.einsum("nij,nkj->nki", frame, corners - p[:, :1]) for corners in (p, q))
    off = np.abs(q[:, :, 0]).max(axis=1)
    near = np.flatnonzero(off <= _APART * size[pairs[:, 0]])
    found, weight, at = _clipped(
        np.ascontiguousarray(p[near, :, 1:]), np.ascontiguousarray(q[near, :, 1:])
    )
    pair = near[found]
    shapes = [_barycentric(corners[pair, :, 1:], at) for corners in (p, q)]
    return pair, weight, *shapes


def _barycentric(corners, at):
    """Barycentric coordinates of points in triangles, shape (n, 3)."""
    a, b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], at - corners[:, 0]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    second = (c[:, 0] * b[:, 1] - c[:, 1] * b[:, 0]) / cross
    third = (a[:, 0] * c[:, 1] - a[:, 1] * c[:, 0]) / cross
    return np.stack([1.0 - second - third, second, third], axis=1)


@njit(error_model="numpy")
def _clipped(p, q):
    """Quadrature of degree 2 on the intersections of triangles (Sutherland and Hodgman 1974).

    Returns:
        Number of the pair, weight and position of each point.
    """
    most = 12 * len(p)  # a polygon of 6 corners is 4 triangles of 3 points
    pair, weight, at = np.empty(most, np.int64), np.empty(most), np.empty((most, 2))
    count = 0
    polygon, clipped = np.empty((9, 2)), np.empty((9, 2))
    for n in range(len(p)):
        a, b = p[n, 1] - p[n, 0], p[n, 2] - p[n, 0]
        whole = 0.5 * (a[0] * b[1] - a[1] * b[0])
        turn = 1.0 if whole > 0.0 else -1.0
        corners = 3
        polygon[:3] = q[n]
        for edge in range(3):
            start, along = p[n, edge], p[n, (edge + 1) % 3] - p[n, edge]
            kept = 0
            for i in range(corners):
                one, two = polygon[i], polygon[(i + 1) % corners]
                s = turn * (along[0] * (one[1] - start[1]) - along[1] * (one[0] - start[0]))
                t = turn * (along[0] * (two[1] - start[1]) - along[1] * (two[0] - start[0]))
                if s >= 0.0:
                    clipped[kept] = one
                    kept += 1
                if (s > 0.0 and t < 0.0) or (s < 0.0 and t > 0.0):
                    clipped[kept] = one + (s / (s - t)) * (two - one)
                    kept += 1
            corners = kept
            polygon[:corners] = clipped[:corners]
            if corners < 3:
                break
        for i in range(1, corners - 1):
            a, b = polygon[i] - polygon[0], polygon[i + 1] - polygon[0]
            area = 0.5 * abs(a[0] * b[1] - a[1] * b[0])
            if area <= _SLIVER * abs(whole):
                continue
            centre = 0.5 * (polygon[0] + polygon[i] + polygon[i + 1])
            for corner in (0, i, i + 1):  # middles of the edges
                pair[count], weight[count] = n, area / 3.0
                at[count] = centre - 0.5 * polygon[corner]
                count += 1
    return pair[:count], weight[:count], at[:count]
