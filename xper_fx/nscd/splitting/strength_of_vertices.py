# SPDX-License-Identifier: LGPL-3.0-or-later
"""Implicit bulk: whether whole vertices bear what their cells are given, and what their bonds do.

Cells of a whole vertex share its motion in the bulk's matrix (`bulk/shared_motion.py`). What each
of them is given by the others is known once a step is solved; the flows of `holding.py` tell
whether admissible tractions give it. A vertex is split ahead, at a share of what it bears: its
points are there before any of them opens, and a step is seldom made again.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.splitting.vertex_kernels import vertex_kernels, vertex_work
from xper_fx.nscd.splitting.whole_vertices import whole_kernel


class StrengthOfVertices:
    """What the whole vertices of a scene bear.

    Args:
        interactions: points whose vertices split (`Interactions.fused`).
    """

    def __init__(self, interactions: Interactions):
        self._interactions = interactions
        graphs = interactions.fused.graphs
        self._work = vertex_work(graphs, interactions.dim)
        self._all = np.arange(graphs.num_vertices, dtype=np.int32)

    def beyond(self, given: np.ndarray, share: float) -> np.ndarray:
        """Whole vertices that do not bear what their cells are given.

        Args:
            given: shape (num_slots, dim), impulses of a step that each node has from the others of
                its vertex (N s); of no account where a vertex is not whole.
            share: of the strength of their bonds.
        """
        interactions, fused = self._interactions, self._interactions.fused
        laws, dim = tuple(g.kernels for g in fused.groups), interactions.dim
        count = whole_kernel(laws, dim)(
            self._free(given), fused.impulses, share * interactions.step_size,
            interactions.inverse.num_nodes, fused.graphs, self._work, self._all, fused.whole,
            fused.table_rows, fused.group_of, fused.tables, fused.failed,
        )  # fmt: skip
        return fused.failed[:count].copy()

    def split(self, vertices: np.ndarray, given: np.ndarray, name: str) -> None:
        """Split whole vertices; their bonds get impulses that give their cells what they are given.

        That is the flow of least squares. Any other does the same work as the vertex opens.

        Args:
            vertices: their numbers.
            given: as of `beyond`.
            name: of the impulses, "impulse" of this step or "committed_impulse" of the last one.
        """
        interactions, fused = self._interactions, self._interactions.fused
        flow = np.zeros((len(fused.graphs.point), interactions.dim))
        flows = _flow_kernel(interactions.dim)
        flows(self._free(given), fused.graphs, self._work, vertices, flow)
        offsets = fused.graphs.bond_offsets
        interactions.wake(vertices)
        bonds = np.concatenate([np.arange(offsets[b], offsets[b + 1]) for b in vertices])
        for number, group in enumerate(fused.groups):
            own = bonds[fused.group_of[bonds] == number]
            rows = fused.rows[own]
            local = np.einsum("pxd,pd->px", group.points.frame[rows], flow[own])
            getattr(group, name)[rows] = local

    def _free(self, given: np.ndarray) -> np.ndarray:
        """Velocities, flat, that cells for themselves have whom this brings to rest."""
        return (-given * self._interactions.fused.graphs.compliance).reshape(-1)

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return self._all.nbytes + sum(array.nbytes for array in self._work)


@cache
def _flow_kernel(dim: int):
    """Kernel: the least flows of vertices whose bonds all are rigid."""
    _, gather_whole, _, _, sources, _, _, least_flow, _ = vertex_kernels(dim)

    @njit(**LEAN_ENTRY)
    def flows(v, g, work, vertices, out):
        for b in vertices:
            k, first, last = gather_whole(b, v, g, work), g.bond_offsets[b], g.bond_offsets[b + 1]
            sources(k, work)
            least_flow(b, k, g, work)
            for q in range(first, last):
                for d in range(dim):
                    out[q, d] = work.flow[q - first, d]

    return flows
