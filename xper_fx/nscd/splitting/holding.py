# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Whether admissible tractions hold together what moves as one.

At a vertex corner c with mass m_c would move with the free velocity v_c of its cell alone; if it
moves with its cluster instead, at V, the bonds give it the impulse s_c = m_c (V - v_c). What its
fused bonds transmit, p_f on the candidate and -p_f on the antagonist, is any flow on the graph of
the vertex with these sources. The set-valued law asks for one whose tractions are all admissible.

- Each flow that follows a tree has |p_f| <= sum_c |s_c| / 2: below the weakest bond, nothing else
  need be looked at. Where one ring goes through all corners, as at a vertex within a plane mesh,
  sum_c |s_c| / 4 is enough: from corner to corner the flows are the points of a closed curve of
  the length L = sum_c |s_c|, taken from where one likes. Two of its points, A and B, halve it, and
  each point P has |P - (A + B) / 2| <= (|P - A| + |P - B|) / 2 <= L / 4. The sum is at most the
  root of k sum_c |s_c|^2 for k corners.
- The least flow below is no larger than sum_c |s_c| / 2 either: along any direction n it is that
  of the sources n . s_c, whose sum of sizes is no larger; sources and sinks can be paired, and what
  one unit from a source to a sink puts on any resistor is one at most. Where corners are driven,
  to which all of a source may go, sum_c |s_c| bounds it. The bonds of a cracked vertex are not
  asked one by one if the weakest of them bears that.
- The flow along a tree of shortest ways from one corner, with what it takes to make the sum of
  (p_f / l_f)^2 along each ring as small as can be, l_f the weakest impulse of each bond, costs some
  ten operations a bond; if all |p_f| <= l_f, the vertex holds. In the plane it is the next one.
- The flow of least sum of (p_f / l_f)^2, l_f the weakest impulse of each bond, is that of the
  potentials of a Laplacian with weights l_f^2, as in a network of resistors. If all bonds bear it,
  the vertex holds.
- If not, another flow may do: the vertex is then solved with each cell for itself, all bonds
  following their set-valued law (`splitting_vertices.py`).

A corner that is driven takes up what is left of the others: its potential is zero in the components
that are driven. So is that of one corner of each cluster, whose sources add up to zero.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import LEAN_INNER


@cache
def flow_kernel(dim: int):
    """Kernel `flow(...)`: the least flow of a vertex."""

    @njit(**LEAN_INNER)
    def factor(a, n):
        """L D L^T of a positive matrix, in place; rows below the diagonal."""
        for j in range(n):
            for k in range(j):
                x = a[j, k]
                if x != 0.0:
                    y = x / a[k, k]
                    for i in range(j, n):
                        a[i, j] -= a[i, k] * y
        for j in range(n):
            inverse = 1.0 / a[j, j]
            for i in range(j + 1, n):
                a[i, j] *= inverse

    @njit(**LEAN_INNER)
    def solve(a, n, x, d):
        """Column d of x becomes a^-1 of it."""
        for i in range(n):
            for j in range(i):
                x[i, d] -= a[i, j] * x[j, d]
        for i in range(n):
            x[i, d] /= a[i, i]
        for i in range(n - 1, -1, -1):
            for j in range(i + 1, n):
                x[i, d] -= a[j, i] * x[j, d]

    @njit(**LEAN_INNER)
    def laplacian(a, k, first, last, sides, least, fused, driven, pinned, d):
        for i in range(k):
            for j in range(i + 1):
                a[i, j] = 0.0
        for q in range(first, last):
            if fused[q - first]:
                i, j = sides[q, 0], sides[q, 1]
                weight = least[q] * least[q]
                a[i, i] += weight
                a[j, j] += weight
                a[max(i, j), min(i, j)] -= weight
        for c in range(k):
            if pinned[c] or driven[c, d] or a[c, c] == 0.0:
                a[c, c] = 1.0
                for j in range(c):
                    a[c, j] = 0.0
                for i in range(c + 1, k):
                    a[i, c] = 0.0

    @njit(**LEAN_INNER)
    def flow(a, k, first, last, sides, least, fused, driven, cluster, pinned, source, out):
        """The least flow, `out` of shape (bonds of the vertex, dim), from `source`, which changes.

        Args:
            a: work space, (k, k) or more.
            k: corners of the vertex.
            first, last: bonds of the vertex.
            sides, least: of `VertexGraphs`.
            fused: shape (bonds of the vertex,), which transmit.
            driven: shape (k, dim), components that are.
            cluster: shape (k,), of each corner.
            pinned: work space, shape (k,).
            source: shape (k, dim), s_c.
            out: shape (bonds of the vertex, dim).
        """
        some_driven = False
        for c in range(k):
            for d in range(dim):
                some_driven = some_driven or driven[c, d]
        for d in range(dim):
            if d == 0 or some_driven:
                for c in range(k):
                    pinned[c] = True
                    for other in range(k):
                        if cluster[other] == cluster[c] and (driven[other, d] or other < c):
                            pinned[c] = False
                laplacian(a, k, first, last, sides, least, fused, driven, pinned, d)
                factor(a, k)
            for c in range(k):
                if pinned[c] or driven[c, d]:
                    source[c, d] = 0.0
            solve(a, k, source, d)
            for q in range(first, last):
                if fused[q - first]:
                    lost = source[sides[q, 0], d] - source[sides[q, 1], d]
                    out[q - first, d] = least[q] * least[q] * lost

    return flow


@cache
def local_flow(dim: int):
    """Kernel `local(normal, q, flow, i)`: a flow along a bond's normal and beside it.

    In space the second component is the length of what is tangential, the third zero.
    """
    dot = for_dimension(dim).dot

    @njit(inline="always")
    def local(normal, q, flow, i):
        if dim == 2:
            n, p = (normal[q, 0], normal[q, 1]), (flow[i, 0], flow[i, 1])
            return dot(n, p), n[0] * p[1] - n[1] * p[0]
        n = (normal[q, 0], normal[q, 1], normal[q, 2])
        p = (flow[i, 0], flow[i, 1], flow[i, 2])
        along = dot(n, p)
        return along, np.sqrt(max(dot(p, p) - along * along, 0.0)), 0.0

    return local
