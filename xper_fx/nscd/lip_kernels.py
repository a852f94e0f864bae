# SPDX-License-Identifier: LGPL-3.0-or-later
"""The geometry of turning frames at one point, for use inside kernels (`turning_frames.py`)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.kernel_options import MERGED

# Square of the measure of the middle of two lips, beside that at the start, where they fold.
_FOLDED = 0.5
# Measure of a facet, beside that at the start, of which it should be the square at least.
_FLAT = 1e-12


class LipKernels(NamedTuple):
    """Functions on vectors of space as tuples; there are dim - 1 tangents."""

    tangents: Callable  #: `(v, nodes, gradient, i)`, sums over both lips of G v / 2
    #: `(F, t, i, alone)`, F t of each tangent, or `alone` times t if F has no entries
    pushed: Callable
    plus: Callable  #: `(a, factor, b)`, a + factor b of each tangent
    #: `(start, a)`, whether the surface that the tangents span has no normal, or one that is
    #: opposite to that of others
    flips: Callable
    frame: Callable  #: `(a)`, rows n, t1 (, t2)
    arms: Callable  #: `(a, frame)`, b (2D), or b_1, b_2, c_1, c_2
    spin: Callable  #: `(rates, arms, frame)`, omega in the frame's axes, one number in 2D
    turned: Callable  #: `(omega, d)`, omega x d, all in the frame's axes
    moment: Callable  #: `(r, d)`, the couple r x d = -d x r, all in the frame's axes
    forces: Callable  #: `(m, arms, frame)`, h_alpha of a couple m in the frame's axes
    apart: Callable  #: `(v, c, i)`, of the candidate from the antagonist
    local: Callable  #: `(frame, x)`, components in a frame
    arms_at: Callable  #: `(array, i)`, those of point i
    #: `(array, i)`, those of point i, held as frames of `Couplings` are, in 2D by the normal alone
    axes_at: Callable
    turn_at: Callable  #: `(array, i)`, the moment or spin of point i
    folded: Callable  #: `(a)`, whether lips stand at more than a right angle to each other


@cache
def lip_kernels(dim: int, k: int, width: int) -> LipKernels:
    """The functions for points whose sides have k nodes, on facets of `width` nodes.

    Points are numbered by `np.uintp`: a signed index would be checked for being negative.
    """
    world = for_dimension(dim)
    add, scale, dot = world.add, world.scale, world.dot

    if dim == 2:

        @njit(fastmath={"contract"}, **MERGED)
        def tangents(v, nodes, gradient, i):
            x, y = 0.0, 0.0
            for s in range(2):
                for j in range(width):
                    p, g = np.uintp(2 * nodes[i, s, j]), gradient[i, s, j, 0]
                    x += g * v[p]
                    y += g * v[p + np.uintp(1)]
            return ((0.5 * x, 0.5 * y),)

        @njit(inline="always")
        def pushed(F, t, i, alone):
            x, y = t[i, 0, 0], t[i, 0, 1]
            if len(F) == 0:
                return ((alone * x, alone * y),)
            return ((F[0, 0] * x + F[0, 1] * y, F[1, 0] * x + F[1, 1] * y),)

        @njit(inline="always")
        def plus(a, factor, b):
            return (add(a[0], scale(factor, b[0])),)

        @njit(inline="always")
        def flips(start, a):
            return not dot(start[0], a[0]) > _FLAT

        @njit(inline="always")
        def folded(a):
            return dot(a[0], a[0]) < _FOLDED

        @njit(inline="always")
        def frame(a):
            t = scale(1.0 / np.sqrt(dot(a[0], a[0])), a[0])
            return (t[1], -t[0]), t

        @njit(inline="always")
        def arms(a, axes):
            # J a / |a|^2 = -n / |a|
            return (scale(-1.0 / dot(axes[1], a[0]), axes[0]),)

        @njit(inline="always")
        def spin(rates, b, axes):
            return (dot(b[0], rates[0]),)

        @njit(inline="always")
        def turned(omega, d):
            return -omega[0] * d[1], omega[0] * d[0]

        @njit(inline="always")
        def moment(r, d):
            return (d[1] * r[0] - d[0] * r[1],)

        @njit(inline="always")
        def forces(m, b, axes):
            return (scale(m[0], b[0]),)

        @njit(inline="always")
        def apart(v, c, i):
            x, y = 0.0, 0.0
            for j in range(k):
                p, q = np.uintp(c.start[i, 0, j]), np.uintp(c.start[i, 1, j])
                own, other = (1.0, 1.0) if k == 1 else (c.weights[i, 0, j], c.weights[i, 1, j])
                x += own * v[p] - other * v[q]
                y += own * v[p + np.uintp(1)] - other * v[q + np.uintp(1)]
            return x, y

        @njit(inline="always")
        def local(axes, x):
            return dot(axes[0], x), dot(axes[1], x)

        @njit(inline="always")
        def arms_at(arms, i):
            return ((arms[i, 0, 0], arms[i, 0, 1]),)

        @njit(inline="always")
        def axes_at(axes, i):
            n = axes[i, 0, 0], axes[i, 0, 1]
            return n, (-n[1], n[0])

        @njit(inline="always")
        def turn_at(m, i):
            return (m[i, 0],)

    else:

        @njit(inline="always")
        def cross(a, b):
            return (
                a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
            )  # fmt: skip

        @njit(fastmath={"contract"}, **MERGED)
        def tangents(v, nodes, gradient, i):
            first, second = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
            for s in range(2):
                for j in range(width):
                    p = np.uintp(3 * nodes[i, s, j])
                    x = (0.5 * v[p], 0.5 * v[p + np.uintp(1)], 0.5 * v[p + np.uintp(2)])
                    first = add(first, scale(gradient[i, s, j, 0], x))
                    second = add(second, scale(gradient[i, s, j, 1], x))
            return first, second

        @njit(inline="always")
        def product(F, x):
            return (
                F[0, 0] * x[0] + F[0, 1] * x[1] + F[0, 2] * x[2],
                F[1, 0] * x[0] + F[1, 1] * x[1] + F[1, 2] * x[2],
                F[2, 0] * x[0] + F[2, 1] * x[1] + F[2, 2] * x[2],
            )

        @njit(inline="always")
        def pushed(F, t, i, alone):
            first = t[i, 0, 0], t[i, 0, 1], t[i, 0, 2]
            second = t[i, 1, 0], t[i, 1, 1], t[i, 1, 2]
            if len(F) == 0:
                return scale(alone, first), scale(alone, second)
            return product(F, first), product(F, second)

        @njit(inline="always")
        def plus(a, factor, b):
            return add(a[0], scale(factor, b[0])), add(a[1], scale(factor, b[1]))

        @njit(inline="always")
        def flips(start, a):
            return not dot(cross(start[0], start[1]), cross(a[0], a[1])) > _FLAT

        @njit(inline="always")
        def folded(a):
            n = cross(a[0], a[1])
            return dot(n, n) < _FOLDED

        @njit(inline="always")
        def frame(a):
            # the rotation of the polar decomposition of a1, a2 in the axes e1 = a1 / |a1|, n x e1
            n = cross(a[0], a[1])
            n = scale(1.0 / np.sqrt(dot(n, n)), n)
            length = np.sqrt(dot(a[0], a[0]))
            e1 = scale(1.0 / length, a[0])
            e2 = cross(n, e1)
            x, y = length + dot(a[1], e2), dot(a[1], e1)
            c = 1.0 / np.sqrt(x * x + y * y)
            t = add(scale(c * x, e1), scale(-c * y, e2))
            return n, t, cross(n, t)

        @njit(inline="always")
        def arms(a, axes):
            n = cross(a[0], a[1])
            c = 1.0 / np.sqrt(dot(n, n))
            drill = 1.0 / (dot(axes[1], a[0]) + dot(axes[2], a[1]))
            return scale(c, a[1]), scale(-c, a[0]), scale(drill, axes[2]), scale(-drill, axes[1])

        @njit(inline="always")
        def spin(rates, b, axes):
            n = axes[0]
            tilt = add(scale(-dot(n, rates[0]), b[0]), scale(-dot(n, rates[1]), b[1]))
            drill = dot(b[2], rates[0]) + dot(b[3], rates[1])
            return drill, dot(axes[1], tilt), dot(axes[2], tilt)

        @njit(inline="always")
        def turned(omega, d):
            return cross(omega, d)

        @njit(inline="always")
        def moment(r, d):
            return cross(r, d)

        @njit(inline="always")
        def forces(m, b, axes):
            n, tilt = axes[0], add(scale(m[1], axes[1]), scale(m[2], axes[2]))
            return (
                add(scale(m[0], b[2]), scale(-dot(b[0], tilt), n)),
                add(scale(m[0], b[3]), scale(-dot(b[1], tilt), n)),
            )

        @njit(inline="always")
        def apart(v, c, i):
            x = (0.0, 0.0, 0.0)
            for j in range(k):
                p, q = np.uintp(c.start[i, 0, j]), np.uintp(c.start[i, 1, j])
                own, other = (1.0, 1.0) if k == 1 else (c.weights[i, 0, j], c.weights[i, 1, j])
                one, two = np.uintp(1), np.uintp(2)
                x = add(x, scale(own, (v[p], v[p + one], v[p + two])))
                x = add(x, scale(-other, (v[q], v[q + one], v[q + two])))
            return x

        @njit(inline="always")
        def local(axes, x):
            return dot(axes[0], x), dot(axes[1], x), dot(axes[2], x)

        @njit(inline="always")
        def arms_at(arms, i):
            return (
                (arms[i, 0, 0], arms[i, 0, 1], arms[i, 0, 2]),
                (arms[i, 1, 0], arms[i, 1, 1], arms[i, 1, 2]),
                (arms[i, 2, 0], arms[i, 2, 1], arms[i, 2, 2]),
                (arms[i, 3, 0], arms[i, 3, 1], arms[i, 3, 2]),
            )

        @njit(inline="always")
        def axes_at(axes, i):
            return (
                (axes[i, 0, 0], axes[i, 0, 1], axes[i, 0, 2]),
                (axes[i, 1, 0], axes[i, 1, 1], axes[i, 1, 2]),
                (axes[i, 2, 0], axes[i, 2, 1], axes[i, 2, 2]),
            )

        @njit(inline="always")
        def turn_at(m, i):
            return m[i, 0], m[i, 1], m[i, 2]

    return LipKernels(
        tangents=tangents, pushed=pushed, plus=plus, flips=flips, folded=folded, frame=frame,
        arms=arms, turned=turned, moment=moment, forces=forces, apart=apart, local=local,
        arms_at=arms_at, axes_at=axes_at, turn_at=turn_at, spin=spin,
    )  # fmt: skip
