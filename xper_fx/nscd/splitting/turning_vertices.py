# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices at finite strain: normals that turn, and couples of lips that act on clusters.

Points have frames that turn as `nscd/turning_frames.py` says; whole vertices have no points, and
normals alone, which tell pressure from shear where it is asked whether bonds bear their flows. The
couple of an open bond acts on all nodes of its lips, at several vertices: each of them moves with
its cluster, by the sum of the couples on its cells over its mass.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.lip_kernels import lip_kernels


@cache
def turn_normals(dim: int, width: int):
    """Kernel that gives bonds the normals that their lips have a while after the start of a step.

    Args:
        dim: 2 or 3.
        width: nodes of a facet.
    """
    lips, set_world = lip_kernels(dim, 1, width), for_dimension(dim).set_row
    tangents, pushed, plus, frame = lips.tangents, lips.pushed, lips.plus, lips.frame

    @njit(**LEAN_ENTRY)
    def turn(normal, point, nodes, gradient, tangent, motion, reach):
        for q in range(len(normal)):
            i = np.uintp(point[q])
            start = plus(
                pushed(motion.gradient, tangent, i, 1.0), 1.0,
                tangents(motion.displacement, nodes, gradient, i),
            )  # fmt: skip
            rates = plus(
                pushed(motion.rate, tangent, i, 0.0), 1.0, tangents(motion.mean, nodes, gradient, i)
            )
            set_world(normal, q, frame(plus(start, reach, rates))[0])

    return turn


@njit(**LEAN_ENTRY)
def push_clusters(vertices, whole, clusters, g, couples, velocity):
    """Move the clusters of some vertices by the impulses on their corners.

    Where a cluster is driven, its bonds hand impulses on to the corners that are.
    """
    dim = velocity.shape[1]
    for b in vertices:
        first, last = g.corner_offsets[b], g.corner_offsets[b + 1]
        for root in range(first, last):
            if (0 if whole[b] else clusters[root]) != root - first:
                continue
            for d in range(dim):
                mass, given, held, handed = 0.0, 0.0, 0, 0.0
                for c in range(root, last):
                    if whole[b] or clusters[c] == root - first:
                        slot = g.corner[c]
                        given += couples[slot, d]
                        if g.compliance[slot, d] == 0.0:
                            held += 1
                        else:
                            mass += 1.0 / g.compliance[slot, d]
                            handed += couples[slot, d]
                for c in range(root, last):
                    if whole[b] or clusters[c] == root - first:
                        slot = g.corner[c]
                        if held == 0:
                            velocity[slot, d] += given / mass
                        elif g.compliance[slot, d] == 0.0:
                            couples[slot, d] += handed / held
                        else:
                            couples[slot, d] = 0.0
