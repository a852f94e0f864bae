# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vertices that are whole: they move as nodes of finite elements do, while something holds them."""

from __future__ import annotations

from functools import cache

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.splitting.bonds_of_laws import kernels_of_laws
from xper_fx.nscd.splitting.vertex_kernels import vertex_kernels

# How often flows are eased along all rings of a vertex: in the plane there is but one.
_EASINGS = 3

_INLINED = {"inline": "always"}


@cache
def whole_kernel(laws: tuple[LawKernels, ...], dim: int):
    """The kernel `move_whole`."""
    gather, partition, _, form, sources, put, least_flow, _ = vertex_kernels(dim)
    bear_all = kernels_of_laws(laws, dim)[6]
    world = for_dimension(dim)
    add, scale, subtract, dot = world.add, world.scale, world.subtract, world.dot

    @njit(**_INLINED)
    def at(v, slot):
        first = slot * dim
        if dim == 2:
            return v[first], v[first + 1]
        return v[first], v[first + 1], v[first + 2]

    @njit(**LEAN_INNER)
    def flow_along_tree(b, v, step, mean, g, work):
        """Whether the flow along the vertex's tree, eased along its rings, is weak enough."""
        first, last = g.corner_offsets[b], g.corner_offsets[b + 1]
        low, flow, source = g.bond_offsets[b], work.flow, work.source
        for c in range(first, last):
            given = scale(g.mass[c], subtract(mean, at(v, g.corner[c])))
            for d in range(dim):
                source[c - first, d] = given[d]
        for q in range(g.bond_offsets[b + 1] - low):
            for d in range(dim):
                flow[q, d] = 0.0
        for n in range(first, last - 1):
            c, q, up = g.tree[n, 0], g.tree[n, 1], g.tree[n, 2]
            if c < 0:
                return False
            sign = 1.0 if g.sides[low + q, 0] == c else -1.0
            for d in range(dim):
                flow[q, d] = sign * source[c, d]
                source[up, d] += source[c, d]
        for _ in range(_EASINGS):
            for m in range(g.ring_offsets[b], g.ring_offsets[b + 1]):
                start = g.ring_ends[m - 1] if m > 0 else 0
                total, x, y, z = 0.0, 0.0, 0.0, 0.0
                for n in range(start, g.ring_ends[m]):
                    q = g.ring[n, 0]
                    weight = 1.0 / (g.least[low + q] * g.least[low + q])
                    total += weight
                    weight *= g.ring[n, 1]
                    x += weight * flow[q, 0]
                    y += weight * flow[q, 1]
                    if dim == 3:
                        z += weight * flow[q, 2]
                for n in range(start, g.ring_ends[m]):
                    q, share = g.ring[n, 0], g.ring[n, 1] / total
                    flow[q, 0] -= share * x
                    flow[q, 1] -= share * y
                    if dim == 3:
                        flow[q, 2] -= share * z
        for q in range(g.bond_offsets[b + 1] - low):
            size = flow[q, 0] ** 2 + flow[q, 1] ** 2
            if dim == 3:
                size += flow[q, 2] ** 2
            if size > (step * g.least[low + q]) ** 2:
                return False
        return True

    @njit(**_INLINED)
    def holds_easily(b, v, step, g, work):
        """Move a vertex that nothing drives if a flow is borne that is soon found."""
        first, last = g.corner_offsets[b], g.corner_offsets[b + 1]
        momentum = scale(0.0, at(v, g.corner[first]))
        for c in range(first, last):
            momentum = add(momentum, scale(g.mass[c], at(v, g.corner[c])))
        mean, total = scale(g.compliance_of_vertex[b], momentum), 0.0
        for c in range(first, last):
            given = scale(g.mass[c], subtract(mean, at(v, g.corner[c])))
            total += dot(given, given)
        # (sum |s|)^2 <= k sum |s|^2
        if 0.25 * (last - first) * total > (step * g.weakest[b]) ** 2:
            if not flow_along_tree(b, v, step, mean, g, work):
                return False
        for c in range(first, last):
            for d in range(dim):
                v[g.corner[c] * dim + d] = mean[d]
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
            k = gather(b, v, g, work)
            first, last = g.bond_offsets[b], g.bond_offsets[b + 1]
            for q in range(last - first):
                work.fused[q] = True
            for c in range(k):
                work.cluster[c] = 0
            form(b, k, g, work)
            if sources(b, k, g, work) > step * g.weakest[b]:
                least_flow(b, k, g, work)
                if not bear_all(b, g, work, 0, rows, step, tables, group_of):
                    failed[count] = b
                    count += 1
                    continue
            for c in range(k):
                for d in range(dim):
                    work.source[c, d] = 0.0
            put(b, k, ground, v, impulses, g, work, work.source)
        return count

    return move_whole
