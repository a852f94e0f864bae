# SPDX-License-Identifier: LGPL-3.0-or-later
"""H^T and w as sparse matrices, for what factors or assembles them."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.point_group import PointGroup


def opening_matrix(group: PointGroup, num_dofs: int) -> csr_array:
    """H^T of the points of a group: u = H^T v in their local frames (`nscd/points.py`).

    Args:
        group: the n points, of m components each.
        num_dofs: degrees of freedom of all slots.

    Returns:
        Shape (n m, num_dofs), rows by points.
    """
    c, points, dim = group.couplings, group.points, group.sides.dim
    n, components = len(group), group.kernels.components
    frame = points.frame[:, :components]
    rows = np.arange(n * components).reshape(n, components, 1)
    parts = []
    for side, sign in enumerate((1.0, -1.0)):
        for j in range(group.sides.k):
            force = sign * points.weights[:, side, j, None, None] * frame
            parts.append((force, c.start[:, side, j]))
        if points.lever_arms is not None:
            a = points.lever_arms[:, side, None]
            if dim == 2:
                moment = (a[..., 0] * frame[..., 1] - a[..., 1] * frame[..., 0])[..., None]
            else:
                moment = np.cross(a, frame)
            parts.append((sign * moment, c.rotation_dof[:, side]))
    if points.branches is not None:
        for j in range(dim):
            first = np.full(n, c.cell + j * dim)
            parts.append((points.branches.vectors[:, j, None, None] * frame, first))
    entries, at = [], []
    for values, first in parts:
        columns = first[:, None, None] + np.arange(values.shape[2])
        at.append(np.broadcast_arrays(rows, columns))
        entries.append(values.ravel())
    rows, columns = (np.concatenate([pair[i].ravel() for pair in at]) for i in range(2))
    shape = (n * components, num_dofs)
    return coo_array((np.concatenate(entries), (rows, columns)), shape=shape).tocsr()


def inverse_matrix(inverse: BodyInverse) -> csr_array:
    """w, shape (num_slots dim, num_slots dim); the ground's rows and columns are empty."""
    sizes = np.diff(inverse.node_offsets) * inverse.dim
    starts = np.repeat(inverse.node_offsets[:-1] * inverse.dim, sizes**2)
    size = np.repeat(sizes, sizes**2)
    place = np.arange(len(inverse.data)) - np.repeat(inverse.data_offsets[:-1], sizes**2)
    there = np.flatnonzero(inverse.data)
    at = starts[there] + np.divmod(place[there], size[there])
    return coo_array((inverse.data[there], tuple(at)), shape=(sizes.sum(),) * 2).tocsr()
