# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The facets on both sides of points, whose motion tells how the points' frames turn.

At a point the middle of both lips has the tangents

    a_alpha = t_alpha + 1/2 sum_s sum_j G_sj,alpha u_sj,

with t_alpha the tangents of the frame at the start, s the side, u_sj the displacement of the j-th
node of its facet and G the derivatives of the facet's shape functions along t_alpha.

Where nodes coincide in pairs the middle may be any point of each pair. The couple of a frame acts
on a node by its G (`turning_frames.py`), and moves it by its w: with

    G_1j -> 2 w_2j / (w_1j + w_2j) G_j,   G_2j -> 2 w_1j / (w_1j + w_2j) G_j,

the middle is that of the pairs' centres of mass, and the couple moves both nodes of a pair alike.
An explicit bulk gets the couple after the law: jumps do not feel it then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

# Difference of the w of paired nodes, relative, that is rounding.
_ALIKE = 1e-12


@dataclass(frozen=True)
class Lips:
    """Facets at points."""

    #: shape (num_points, 2, k), int32, nodes of the candidate's and antagonist's facets
    nodes: np.ndarray
    #: G, shape (num_points, 2, k, dim - 1), 1/m. Zero where a frame does not turn.
    gradient: np.ndarray
    tangent: np.ndarray  #: t_alpha, shape (num_points, dim - 1, dim), unit
    #: whether the nodes of both sides coincide, one by one, shape (num_points,), bool
    paired: np.ndarray

    def take(self, indices: np.ndarray) -> Lips:
        """Those of the points at `indices`, in that order."""
        arrays = (self.nodes, self.gradient, self.tangent, self.paired)
        return Lips(*(np.ascontiguousarray(array[indices]) for array in arrays))

    def by_mass(self, compliance: np.ndarray) -> Lips:
        """The same, the middle of paired nodes being their centre of mass.

        Args:
            compliance: w of each slot, shape (num_slots,), 1/kg; zero where it cannot move.
        """
        w = compliance[self.nodes]
        whole = w.sum(axis=1, keepdims=True)
        unlike = self.paired[:, None, None] & (np.abs(w[:, :1] - w[:, 1:]) > _ALIKE * whole)
        share = np.divide(w[:, ::-1], whole, out=np.full(w.shape, 0.5), where=unlike)
        return replace(self, gradient=2.0 * share[..., None] * self.gradient)

    def on(self, slots: np.ndarray) -> Lips:
        """The same on other nodes: those that `slots`, shape (n,), has in the places of these."""
        return replace(self, nodes=slots[self.nodes].astype(np.int32))

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(a.nbytes for a in (self.nodes, self.gradient, self.tangent, self.paired))


def start_frames(tangent: np.ndarray, rows: int) -> np.ndarray:
    """Frames at the start from their tangents, shape (num_points, rows, dim).

    Args:
        tangent: shape (num_points, dim - 1, dim), unit.
        rows: how many of n, t1 (, t2).
    """
    if tangent.shape[2] == 2:
        normal = np.stack([tangent[:, 0, 1], -tangent[:, 0, 0]], axis=1)
    else:
        normal = np.cross(tangent[:, 0], tangent[:, 1])
    return np.ascontiguousarray(np.concatenate([normal[:, None], tangent], axis=1)[:, :rows])


def still_lips(nodes: np.ndarray, frame: np.ndarray) -> Lips:
    """Of points whose frames do not turn.

    Args:
        nodes: shape (num_points, 2, k), any that there are.
        frame: shape (num_points, dim, dim), rows n, t1 (, t2).
    """
    dim = frame.shape[2]
    tangent = np.ascontiguousarray(frame[:, 1:])
    return Lips(nodes, np.zeros((*nodes.shape, dim - 1)), tangent, np.zeros(len(nodes), bool))


def join_lips(parts: Sequence[Lips]) -> Lips:
    """Those of several sets of points, in order; facets of fewer nodes get some without weight."""
    k = max(part.nodes.shape[2] for part in parts)
    nodes, gradients = [], []
    for part in parts:
        more = k - part.nodes.shape[2]
        first = np.repeat(part.nodes[:, :, :1], more, axis=2)
        nodes.append(np.concatenate([part.nodes, first], axis=2))
        gradients.append(np.pad(part.gradient, ((0, 0), (0, 0), (0, more), (0, 0))))
    tangents, paired = [part.tangent for part in parts], [part.paired for part in parts]
    return Lips(*map(np.concatenate, (nodes, gradients, tangents, paired)))


def facet_lips(nodes: np.ndarray, x: np.ndarray, frame: np.ndarray, shapes: np.ndarray) -> Lips:
    """Lips of the points of `facet_points`, whose sides match.

    Args:
        nodes: shape (num_facets, 2, k), matched nodes.
        x: shape (num_facets, k, dim), their positions (m).
        frame: shape (num_points, dim, dim), frames of the points.
        shapes: shape (points a facet, k), the shape functions at the points of each.
    """
    count, _, k = nodes.shape
    dim = x.shape[2]
    derivatives = facet_derivatives(dim, k, shapes)
    each = len(derivatives)
    tangent = np.ascontiguousarray(frame[:, 1:])
    all_derivatives = np.tile(derivatives, (count, 1, 1))
    gradient = along_tangents(all_derivatives, np.repeat(x, each, axis=0), tangent)
    both = np.repeat(gradient[:, None], 2, axis=1)
    at_points = np.repeat(nodes, each, axis=0).astype(np.int32)
    return Lips(at_points, both, tangent, np.ones(len(tangent), bool))


def along_tangents(derivatives: np.ndarray, x: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Derivatives of facets' shape functions along tangents, G, shape (n, k, dim - 1), 1/m.

    Args:
        derivatives: shape (n, k, dim - 1), along the facets' own parameters.
        x: shape (n, k, dim), positions of their nodes (m).
        tangent: shape (n, dim - 1, dim), unit; of their plane, or near it.
    """
    own = np.einsum("nka,nkd->nad", derivatives, x)
    # t_alpha = sum_beta M_alpha,beta a_beta of the facet's own parameters, in least squares
    gram = np.einsum("nad,nbd->nab", own, own)
    change = np.linalg.solve(gram, np.einsum("nbd,nad->nba", own, tangent))
    return np.einsum("nkb,nba->nka", derivatives, change)


def facet_derivatives(dim: int, k: int, shapes: np.ndarray) -> np.ndarray:
    """Derivatives of a facet's k shape functions at its points, (num_points, k, dim - 1).

    Args:
        k: nodes of a facet, vertices first.
        shapes: shape (num_points, k), shape functions at the points, which tell where they are.
    """
    count = len(shapes)
    if (dim, k) == (3, 4):
        # those at the centre, where the normal is that of the vector area
        at_centre = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
        return np.broadcast_to(at_centre, (count, 4, 2))
    slopes = np.concatenate([-np.ones((1, dim - 1)), np.eye(dim - 1)])  # of barycentric coordinates
    if k == dim:
        return np.broadcast_to(slopes, (count, dim, dim - 1))
    ends = [(0, 1)] if dim == 2 else [(1, 2), (0, 2), (0, 1)]  # of the edges with a node each
    middles = np.zeros((len(ends), dim))
    for edge, pair in enumerate(ends):
        middles[edge, list(pair)] = 0.5
    b = shapes @ np.concatenate([np.eye(dim), middles])
    at_vertices = (4.0 * b - 1.0)[:, :, None] * slopes
    at_edges = np.stack(
        [4.0 * (b[:, i, None] * slopes[j] + b[:, j, None] * slopes[i]) for i, j in ends], axis=1
    )
    return np.concatenate([at_vertices, at_edges], axis=1)
