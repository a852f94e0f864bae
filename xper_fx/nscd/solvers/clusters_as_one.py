# SPDX-License-Identifier: LGPL-3.0-or-later
"""Velocities that open no point: each cluster of facing nodes moves as one."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from xper_fx.cache import njit
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.solvers.clusters import Clusters

_KERNEL = njit(fastmath={"contract"}, nogil=True, **LEAN_ENTRY)


class ClustersAsOne:
    """P^T w^-1 P, factored: P gives all nodes of a cluster its velocity.

    What is prescribed is left out, and so are clusters whose translation opens a point.

    Args:
        clusters: of the nodes.
        opened: of each cluster, whether its translation opens a point, shape (num_clusters,).
        fixed: degrees of freedom that are prescribed, shape (num_slots * dim,), bool.
        inverse: where the blocks of w are.
        blocks: of w^-1, flat as those of w.
    """

    def __init__(
        self,
        clusters: Clusters,
        opened: np.ndarray,
        fixed: np.ndarray,
        inverse: BodyInverse,
        blocks: np.ndarray,
    ):
        dim = inverse.dim
        dofs = (clusters.cluster[:, None] * dim + np.arange(dim)).ravel()
        held = np.repeat(opened, dim)
        held[dofs[fixed]] = True
        self._number = np.where(held, -1, np.cumsum(~held) - 1)[dofs]
        count = int(np.count_nonzero(~held))
        self._force, self._factors = np.empty(count), None
        if count == 0:
            return
        rows, columns = (self._number[dofs] for dofs in inverse.rows_and_columns())
        kept = (rows >= 0) & (columns >= 0)
        matrix = coo_array((blocks[kept], (rows[kept], columns[kept])), shape=(count, count))
        self._factors = splu(
            matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip

    def add_correction(self, r: np.ndarray, z: np.ndarray) -> bool:
        """z += P (P^T w^-1 P)^-1 P^T r; whether there is a cluster that moves as one."""
        if self._factors is None:
            return False
        self._force[:] = 0.0
        _restrict(self._number, r, self._force)
        _prolong(self._number, self._factors.solve(self._force), z)
        return True


@_KERNEL
def _restrict(number, r, q):
    for i in range(len(number)):
        if number[i] >= 0:
            q[number[i]] += r[i]


@_KERNEL
def _prolong(number, q, z):
    for i in range(len(number)):
        if number[i] >= 0:
            z[i] += q[number[i]]
