# SPDX-License-Identifier: LGPL-3.0-or-later
"""The graph of a mesh vertex: its corners, a node of each cell there, joined by bonds.

A bond is an interaction point. Corners and bonds are numbered vertex by vertex; bonds of a vertex
law by law, so that the points of a law follow each other there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.points import InteractionPoints


class VertexGraphs(NamedTuple):
    """Corners and bonds of all vertices.

    Attributes:
        corner_offsets, bond_offsets: shape (num_vertices + 1,), first of each vertex.
        corner: shape (num_corners,), slot of each.
        sides: shape (num_bonds, 2), corners of candidate and antagonist, counted in the vertex.
        point: shape (num_bonds,), number among the points.
        normal: shape (num_bonds, dim), from antagonist to candidate.
        area: shape (num_bonds,), m^2 (2D: m).
        least: shape (num_bonds,), smallest force that a rigid bond may not bear, N; zero where a
            bond is not initially rigid.
        compliance: shape (num_slots, dim), 1 / m of each slot, zero where it is driven.
        mass: shape (num_corners,), of each corner that is not driven (kg; 2D: kg/m).
        compliance_of_vertex: shape (num_vertices,), one over the mass of all its corners; zero
            where one of them is driven.
        weakest: shape (num_vertices,), smallest of `least`.
    """

    corner_offsets: np.ndarray
    bond_offsets: np.ndarray
    corner: np.ndarray
    sides: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    least: np.ndarray
    compliance: np.ndarray
    mass: np.ndarray
    compliance_of_vertex: np.ndarray
    weakest: np.ndarray

    @property
    def num_vertices(self) -> int:
        """How many there are."""
        return len(self.bond_offsets) - 1

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(array.nbytes for array in self)


def vertex_graphs(
    points: InteractionPoints,
    vertex: np.ndarray,
    group_of_point: np.ndarray,
    strength: np.ndarray,
    inverse: BodyInverse,
) -> VertexGraphs:
    """The graphs of a scene.

    Args:
        points: one node a side.
        vertex: shape (num_points,), where they are.
        group_of_point: shape (num_points,), which of the groups of laws they belong to.
        strength: shape (num_points,), smallest traction that a bond may not bear (Pa); zero where
            it is not initially rigid.
        inverse: one block a node.
    """
    dim, count = points.dim, int(vertex.max()) + 1
    order = np.lexsort((group_of_point, vertex))
    slots = points.nodes[order, :, 0].astype(np.int64)
    at = vertex[order].astype(np.int64)
    # a slot is at one vertex, but for the ground, which counts as a corner of each
    keys = at[:, None] * inverse.num_slots + slots
    corners, sides = np.unique(keys.ravel(), return_inverse=True)
    corner_offsets = np.searchsorted(corners, np.arange(count + 1) * inverse.num_slots)
    local = sides.reshape(-1, 2) - corner_offsets[at][:, None]
    corner = (corners % inverse.num_slots).astype(np.int32)
    diagonal = np.arange(dim) * (dim + 1)
    compliance = np.ascontiguousarray(inverse.data.reshape(-1, dim * dim)[:, diagonal])
    driven = np.any(compliance[corner] == 0.0, axis=1)
    mass = np.divide(1.0, compliance[corner, 0], out=np.zeros(len(corner)), where=~driven)
    first = corner_offsets[:-1]
    whole_mass = np.where(
        np.logical_or.reduceat(driven, first), np.inf, np.add.reduceat(mass, first)
    )
    bond_offsets = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=count))])
    least = strength[order] * points.area[order]
    return VertexGraphs(
        corner_offsets=corner_offsets,
        bond_offsets=bond_offsets,
        corner=corner,
        sides=np.ascontiguousarray(local, np.int16),
        point=order.astype(np.int32),
        normal=np.ascontiguousarray(points.frame[order, 0]),
        area=points.area[order],
        least=least,
        compliance=compliance,
        mass=mass,
        compliance_of_vertex=1.0 / whole_mass,
        weakest=np.minimum.reduceat(least, bond_offsets[:-1]),
    )
