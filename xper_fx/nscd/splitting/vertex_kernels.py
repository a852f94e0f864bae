# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is done at a vertex whatever its laws are: clusters of corners, and Newton steps."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import LEAN_INNER, MERGED
from xper_fx.nscd.splitting.holding import flow_kernel
from xper_fx.nscd.splitting.vertex_graphs import VertexGraphs

# Slopes are multiplied by this, as closed rings of bonds are redundant: their errors, of 1e-7, must
# be little beside what it leaves. (With 1 - 1e-9 steps along what moves no cell threw vertices back
# where many bonds soften.)
_REGULAR = 1.0 - 1e-4
# A pivot of Newton's matrix that is none.
_SINGULAR = 1e-14


class VertexWork(NamedTuple):
    """Work space of a vertex with as many corners k and bonds e as any has."""

    cluster: np.ndarray  #: shape (k,), first corner of each corner's cluster
    pinned: np.ndarray  #: shape (k,)
    driven: np.ndarray  #: shape (k, dim)
    mass: np.ndarray  #: shape (k, dim), of the corners, zero where they are driven
    free: np.ndarray  #: shape (k, dim), velocities of the cells for themselves (m/s)
    v: np.ndarray  #: shape (k, dim), velocity of the cluster whose first corner it is
    w: np.ndarray  #: shape (k, dim), compliance of that cluster
    source: np.ndarray  #: shape (k, dim)
    laplacian: np.ndarray  #: shape (k, k)
    fused: np.ndarray  #: shape (e,), what transmits within a cluster
    active: np.ndarray  #: shape (e,), what acts between two
    kept: np.ndarray  #: shape (e,), what was fused before it was tried whether more opens
    flow: np.ndarray  #: shape (e, dim); also residuals and corrections (N s)
    answer: np.ndarray  #: shape (e, dim), impulses that laws ask for, in their axes (N s)
    direction: np.ndarray  #: shape (e, dim), of a Newton step (N s)
    slope: np.ndarray  #: shape (e, dim, dim)
    system: np.ndarray  #: shape (e dim, e dim)


def vertex_work(graphs: VertexGraphs, dim: int) -> VertexWork:
    """Work space for the vertices of a scene."""
    k = int(np.diff(graphs.corner_offsets).max(initial=1))
    e = int(np.diff(graphs.bond_offsets).max(initial=1))
    corners = [np.zeros((k, dim)) for _ in range(5)]
    return VertexWork(
        np.zeros(k, np.int64), np.zeros(k, bool), np.zeros((k, dim), bool), *corners,
        np.zeros((k, k)), *(np.zeros(e, bool) for _ in range(3)),
        *(np.zeros((e, dim)) for _ in range(3)), np.zeros((e, dim, dim)),
        np.zeros((e * dim, e * dim)),
    )  # fmt: skip


@cache
def vertex_kernels(dim: int):
    """What is done at a vertex whatever its laws are."""
    flow = flow_kernel(dim)

    @njit(**MERGED)
    def gather(b, v, g, work):
        """Free velocities of the corners; returns how many there are."""
        first = g.corner_offsets[b]
        k = g.corner_offsets[b + 1] - first
        some_driven = g.compliance_of_vertex[b] == 0.0
        for c in range(k):
            slot = g.corner[first + c]
            for d in range(dim):
                driven = some_driven and g.compliance[slot, d] == 0.0
                work.free[c, d] = v[slot * dim + d]
                work.driven[c, d] = driven
                work.mass[c, d] = g.mass[first + c]
                if some_driven:
                    work.mass[c, d] = 0.0 if driven else 1.0 / g.compliance[slot, d]
        return k

    @njit(**MERGED)
    def partition(b, k, g, work):
        """Clusters of corners that fused bonds join; returns how many there are."""
        cluster = work.cluster
        for c in range(k):
            cluster[c] = c
        first, count = g.bond_offsets[b], k
        for q in range(first, g.bond_offsets[b + 1]):
            if work.fused[q - first]:
                x, y = cluster[g.sides[q, 0]], cluster[g.sides[q, 1]]
                while x != cluster[x]:
                    x = cluster[x]
                while y != cluster[y]:
                    y = cluster[y]
                count -= x != y
                cluster[max(x, y)] = min(x, y)
        for c in range(k):  # none leads to a later corner
            cluster[c] = cluster[cluster[c]]
        return count

    @njit(**MERGED)
    def form(k, work):
        """Compliance and free velocity of the clusters."""
        for c in range(k):
            root = work.cluster[c]
            for d in range(dim):
                if root == c:
                    work.w[c, d] = work.v[c, d] = 0.0
                work.w[root, d] += work.mass[c, d]
                work.v[root, d] += work.mass[c, d] * work.free[c, d]
        for c in range(k):
            if work.cluster[c] == c:
                for d in range(dim):
                    mass = work.w[c, d]
                    work.w[c, d] = 1.0 / mass
                    work.v[c, d] /= mass
        for c in range(k):
            for d in range(dim):
                if work.driven[c, d]:
                    root = work.cluster[c]
                    work.w[root, d], work.v[root, d] = 0.0, work.free[c, d]

    @njit(**LEAN_INNER)
    def gather_whole(b, v, g, work):
        """One cluster of all corners; returns how many there are."""
        k = gather(b, v, g, work)
        for q in range(g.bond_offsets[b + 1] - g.bond_offsets[b]):
            work.fused[q] = True
        for c in range(k):
            work.cluster[c] = 0
        form(k, work)
        return k

    @njit(**MERGED)
    def sources(k, work):
        """Impulses that bonds give each corner, those for what drives it left out."""
        for c in range(k):
            for d in range(dim):
                lag = work.v[work.cluster[c], d] - work.free[c, d]
                work.source[c, d] = work.mass[c, d] * lag

    @njit(**MERGED)
    def bound(k, work):
        """What bounds each flow of the sources; see `holding.py`. Driven corners have none."""
        total, share = 0.0, 0.5
        for c in range(k):
            squared = 0.0
            for d in range(dim):
                if work.driven[c, d]:
                    work.source[c, d], share = 0.0, 1.0
                squared += work.source[c, d] ** 2
            total += np.sqrt(squared)
        return share * total

    @njit(**MERGED)
    def put(b, k, ground, v, impulses, g, work, external):
        """Velocities and impulses of the corners; `external` has those of other clusters."""
        first = g.corner_offsets[b]
        for c in range(k):
            root, slot = work.cluster[c], g.corner[first + c]
            if slot == ground:
                continue
            for d in range(dim):
                v[slot * dim + d] = work.v[root, d]
                if not work.driven[c, d]:
                    impulses[slot, d] = work.mass[c, d] * (work.v[root, d] - work.free[c, d])
                    continue
                # what the others of the cluster do not take, shared among those that are driven
                rest, sharing = 0.0, 0
                for other in range(k):
                    if work.cluster[other] != root:
                        continue
                    rest += external[other, d]
                    if work.driven[other, d]:
                        sharing += 1
                    else:
                        rest -= work.mass[other, d] * (work.v[root, d] - work.free[other, d])
                impulses[slot, d] = rest / sharing

    @njit(**LEAN_INNER)
    def least_flow(b, k, g, work):
        first, last = g.bond_offsets[b], g.bond_offsets[b + 1]
        flow(
            work.laplacian, k, first, last, g.sides, g.least, work.fused, work.driven,
            work.cluster, work.pinned, work.source, work.flow,
        )  # fmt: skip

    @njit(**LEAN_INNER)
    def eliminate(a, n, x):
        """x, flat, becomes a^-1 x; False if a is singular. Pivots are sought by columns."""
        for c in range(n):
            pivot = c
            for i in range(c + 1, n):
                if abs(a[i, c]) > abs(a[pivot, c]):
                    pivot = i
            if abs(a[pivot, c]) < _SINGULAR:
                return False
            if pivot != c:
                for j in range(c, n):
                    a[c, j], a[pivot, j] = a[pivot, j], a[c, j]
                x[c], x[pivot] = x[pivot], x[c]
            for i in range(c + 1, n):
                factor = a[i, c] / a[c, c]
                if factor != 0.0:
                    for j in range(c, n):
                        a[i, j] -= factor * a[c, j]
                    x[i] -= factor * x[c]
        for c in range(n - 1, -1, -1):
            for j in range(c + 1, n):
                x[c] -= a[c, j] * x[j]
            x[c] /= a[c, c]
        return True

    @njit(**LEAN_INNER)
    def newton(b, g, work):
        """`flow` of active bonds, their residuals, becomes the correction; False if there is none.

        Unknowns are those of active bonds, packed one after the other.
        """
        first, last = g.bond_offsets[b], g.bond_offsets[b + 1]
        n = 0
        for q in range(first, last):
            if not work.active[q - first]:
                continue
            m = 0
            for p in range(first, last):
                if not work.active[p - first]:
                    continue
                for y in range(dim):
                    coupling = 0.0
                    if p != q:
                        for s in range(2):
                            for t in range(2):
                                root = work.cluster[g.sides[q, s]]
                                if root == work.cluster[g.sides[p, t]]:
                                    coupling += work.w[root, y] if s == t else -work.w[root, y]
                    for x in range(dim):
                        entry = -_REGULAR * work.slope[q - first, x, y] * coupling
                        work.system[n + x, m + y] = entry
                m += dim
            for x in range(dim):
                work.system[n + x, n + x] += 1.0
            n += dim
        packed = work.slope.reshape(-1)  # no longer needed
        n = 0
        for q in range(last - first):
            if work.active[q]:
                for x in range(dim):
                    packed[n + x] = work.flow[q, x]
                n += dim
        if not eliminate(work.system, n, packed):
            return False
        n = 0
        for q in range(last - first):
            if work.active[q]:
                for x in range(dim):
                    work.flow[q, x] = packed[n + x]
                n += dim
        return True

    return gather, gather_whole, partition, form, sources, bound, put, least_flow, newton
