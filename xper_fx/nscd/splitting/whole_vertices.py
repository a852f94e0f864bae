# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices that are whole: they move as nodes of finite elements do, while something holds them."""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.splitting.bonds_of_laws import kernels_of_laws
from xper_fx.nscd.splitting.vertex_kernels import vertex_kernels

# How often flows are eased along all rings of a vertex, by the dimension: a plane one has one.
_EASINGS = (0, 0, 1, 3)

_INLINED = {"inline": "always"}


@cache
def whole_kernel(laws: tuple[LawKernels, ...], dim: int):
    """The kernel `move_whole`."""
    _, gather_whole, _, _, sources, bound, put, least_flow, _ = vertex_kernels(dim)
    bear_all = kernels_of_laws(laws, dim)[7]
    world = for_dimension(dim)
    add, scale, subtract, dot = world.add, world.scale, world.subtract, world.dot

    # places without a sign, which need not be looked at for whether they count from the end

    @njit(**_INLINED)
    def at(v, slot):
        first = np.uintp(slot) * np.uintp(dim)
        if dim == 2:
            return v[first], v[first + np.uintp(1)]
        return v[first], v[first + np.uintp(1)], v[first + np.uintp(2)]

    @njit(**_INLINED)
    def put_at(v, slot, x):
        first = np.uintp(slot) * np.uintp(dim)
        v[first] = x[0]
        v[first + np.uintp(1)] = x[1]
        if dim == 3:
            v[first + np.uintp(2)] = x[2]

    @njit(**_INLINED)
    def within(flow, low, bonds, step, g):
        """Whether a flow is weak enough for each bond."""
        for q in range(bonds):
            size = flow[q, 0] ** 2 + flow[q, 1] ** 2
            if dim == 3:
                size += flow[q, 2] ** 2
            if size > (step * g.least[low + q]) ** 2:
                return False
        return True

    @njit(**_INLINED)
    def ease(flow, start, end, g):
        """Make the weighted sum of squares of a flow as small as can be along a ring."""
        x, y, z = 0.0, 0.0, 0.0
        for n in range(start, end):
            q, weight = np.uintp(g.ring[n, 0]), g.ring_weight[n]
            x += weight * flow[q, 0]
            y += weight * flow[q, 1]
            if dim == 3:
                z += weight * flow[q, 2]
        for n in range(start, end):
            q, sign = np.uintp(g.ring[n, 0]), g.ring[n, 1]
            flow[q, 0] -= sign * x
            flow[q, 1] -= sign * y
            if dim == 3:
                flow[q, 2] -= sign * z

    @njit(**LEAN_INNER)
    def flow_along_tree(b, v, step, mean, g, work):
        """Whether the flow along the vertex's tree, eased along its rings, is weak enough."""
        first, last = np.uintp(g.corner_offsets[b]), np.uintp(g.corner_offsets[b + 1])
        low = np.uintp(g.bond_offsets[b])
        bonds, flow, source = np.uintp(g.bond_offsets[b + 1]) - low, work.flow, work.source
        for c in range(last - first):
            given = scale(g.mass[first + c], subtract(mean, at(v, g.corner[first + c])))
            for d in range(dim):
                source[c, d] = given[d]
        for q in range(bonds):
            for d in range(dim):
                flow[q, d] = 0.0
        for n in range(first, last - np.uintp(1)):
            if g.tree[n, 0] < 0:
                return False
            c, q, up = np.uintp(g.tree[n, 0]), np.uintp(g.tree[n, 1]), np.uintp(g.tree[n, 2])
            sign = 1.0 if np.uintp(g.sides[low + q, 0]) == c else -1.0
            for d in range(dim):
                flow[q, d] = sign * source[c, d]
                source[up, d] += source[c, d]
        for _ in range(_EASINGS[dim]):
            if within(flow, low, bonds, step, g):
                return True
            start = np.uintp(g.ring_ends[g.ring_offsets[b] - 1]) if g.ring_offsets[b] > 0 else 0
            for m in range(g.ring_offsets[b], g.ring_offsets[b + 1]):
                end = np.uintp(g.ring_ends[m])
                ease(flow, np.uintp(start), end, g)
                start = end
        return within(flow, low, bonds, step, g)

    @njit(**_INLINED)
    def holds_easily(b, v, step, g, work):
        """Move a vertex that nothing drives if a flow is borne that is soon found."""
        first, last = np.uintp(g.corner_offsets[b]), np.uintp(g.corner_offsets[b + 1])
        momentum = scale(0.0, at(v, g.corner[first]))
        for c in range(first, last):
            momentum = add(momentum, scale(g.mass[c], at(v, g.corner[c])))
        mean, total = scale(g.compliance_of_vertex[b], momentum), 0.0
        for c in range(first, last):
            given = scale(g.mass[c], subtract(mean, at(v, g.corner[c])))
            total += dot(given, given)
        if total > (step * g.easy[b]) ** 2:
            if not flow_along_tree(b, v, step, mean, g, work):
                return False
        for c in range(first, last):
            put_at(v, g.corner[c], mean)
        return True

    @njit(**LEAN_ENTRY)
    def move_whole(
        v, impulses, step, ground, g, work, vertices, whole, rows, group_of, tables, failed
    ):
        """Move whole ones of some vertices; returns how many do not hold, first of `failed`."""
        count = 0
        for b in vertices:
            if not whole[b]:
                continue
            if g.compliance_of_vertex[b] > 0.0 and holds_easily(b, v, step, g, work):
                continue
            k = gather_whole(b, v, g, work)
            sources(k, work)
            if bound(k, work) > step * g.weakest[b]:
                least_flow(b, k, g, work)
                if not bear_all(b, g, work, rows, step, tables, group_of):
                    failed[count] = b
                    count += 1
                    continue
            if g.compliance_of_vertex[b] > 0.0:
                for c in range(g.corner_offsets[b], g.corner_offsets[b + 1]):
                    put_at(v, g.corner[c], world.row(work.v, 0))
                continue
            for c in range(k):
                for d in range(dim):
                    work.source[c, d] = 0.0
            put(b, k, ground, v, impulses, g, work, work.source)
        return count

    return move_whole
