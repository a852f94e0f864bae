# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices all of whose bonds have points, as contacts know them (`touching_clusters.py`)."""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.touching.corners import Corners


class LooseVertices:
    """Vertices whose cells move each by itself.

    Args:
        groups: of points with one node a side.
        vertex: shape (num_points,), of each point, group by group.
        num_vertices: how many there are, those included that have lost all of their points.
        inverse: one block a node.

    Attributes:
        corners: of the vertices.
        whole, clusters, vertex_of_slot: as of `FusedPoints`.
    """

    def __init__(
        self,
        groups: list[PointGroup],
        vertex: np.ndarray,
        num_vertices: int,
        inverse: BodyInverse,
    ):
        count, ground = inverse.num_slots, inverse.num_nodes
        slots = [np.zeros((0, 2), np.int64), *(g.points.nodes[:, :, 0] for g in groups)]
        keys = np.unique(vertex.astype(np.int64)[:, None] * count + np.concatenate(slots))
        keys = keys[keys % count != ground]  # it moves with no vertex
        offsets = np.searchsorted(keys, np.arange(num_vertices + 1) * count)
        corner = (keys % count).astype(np.int32)
        self.corners = Corners(offsets, corner, inverse.compliance_of_slots())
        self.whole = np.zeros(num_vertices, bool)
        first = np.repeat(offsets[:-1], np.diff(offsets))
        self.clusters = (np.arange(len(corner)) - first).astype(np.int16)
        self.vertex_of_slot = np.full(count, -1, np.int32)
        self.vertex_of_slot[corner] = keys // count
