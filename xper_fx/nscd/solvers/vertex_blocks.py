# SPDX-License-Identifier: LGPL-3.0-or-later
"""Explicit bulk: every mesh vertex is a small problem, solved on its own.

With a lumped mass and the bulk explicit, w has one block a node and W couples only the points that
meet at one vertex. Each vertex is solved to the tolerance without the others, in threads.

**The local solver** needs nothing of a law but its visit. With the others frozen, point i answers
r_i = S_i(b_i), b_i = u_i - W_ii r_i, and S_i is linear between a few kinks (open, closed, sticking,
softening). Its slope T_i, taken by differences, gives a Newton matrix for the whole vertex,

    (I - T (W - diag W)) dr = S(b) - r,

whose inverse is kept from step to step: as long as the branches are those of the step before, one
product brings the answer and one more visit confirms it. Points that answer otherwise than their
slope had it (they have opened, closed, slipped) get a new one, and the inverse follows by a change
of low rank. Where Newton's steps do not settle, Gauss-Seidel sweeps take over for a while.
Vertices with more than `_NEWTON_DOFS` unknowns are swept only.

**Frames that turn** leave W and T what they were in their own axes where a vertex turns as a whole;
so they do, in axes of space, where T is the same in all directions, as of perfect bonds, of lips
that stick and of open bonds with C_N = C_T. The inverse therefore stays in the frames K of the
start: what point i answers in its frame F_i reaches it as K_i K_p^T F_p F_i^T of it, p being the
vertex's first point with a whole frame. Left out is a relative turn of points whose T has
directions. Where a motion of a node is prescribed its w has directions too, those of space, and
K_p^T F_p gives way to the identity: W of redundant bonds has a kernel, which the inverse would
otherwise hold in wrong axes and amplify by 1 / (1 - `_REGULAR`).

On the notched plate at 20 x 20 this takes less than half the time of sweeps while bonds are sound,
and a quarter or less once cracks open and close, where sweeps often do not converge.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.couplings import (
    LINE,
    Blocks,
    Couplings,
    Sides,
    point_impulse,
    point_velocity,
    prefetch,
)
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER, MERGED
from xper_fx.nscd.law_loops import jump_to_prepare
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.point_group import PointGroup, largest_arm
from xper_fx.nscd.points import frame_from_normal
from xper_fx.nscd.solvers.solver import SolveOptions, Solver, SolveReport
from xper_fx.support.threads import in_ranges, worth_taking

if TYPE_CHECKING:
    from xper_fx.nscd.touching.loose_vertices import LooseVertices

# Largest number of unknowns of a vertex whose inverse is kept (18 kB).
_NEWTON_DOFS = 48
# Factor by which a correction should reduce the residual; else the inverse is renewed.
_SLOW = 0.1
# Newton steps with a new inverse before, and sweeps of, a batch of Gauss-Seidel.
_NEWTON_STEPS, _BATCH = 4, 4
# A residual below this fraction of the bound (squared) needs no product with the inverse.
_CLEAR = 1e-4
_TINY = np.finfo(np.float64).tiny
# Vertices from which threads are taken unasked.
_MANY = 1000
# Squared size of a correction beside the impulses found (of redundant points, whose matrix is all
# but singular) from which its rounding in the velocities counts: they are made anew.
_SWOLLEN = 1e6
# Pivot of an update below which the direction is left out.
_SINGULAR = 1e-12
# Component of a vector, relative to its length, that comes from rounding as it is turned.
_ROUNDING = 1e-14
# Slopes are multiplied by this: sticking contacts in a closed ring are redundant.
_REGULAR = 1.0 - 1e-7


# Hot loops allocate nothing; counting references of the arrays passed would cost more than they do.
_KERNEL = njit(fastmath={"contract"}, **LEAN_INNER)
_MERGED = njit(fastmath={"contract"}, **MERGED)


class _Blocks(NamedTuple):
    """The vertices' own arrays; points are counted vertex by vertex, group by group within.

    A point has as many `unknowns` here as the law of the scene with most components; those that its
    own law lacks stay zero.
    """

    offsets: np.ndarray  #: shape (num_vertices + 1,), first point of each
    start: np.ndarray  #: shape (num_points, 2), first dof of each side's node
    #: shape (num_points, 1, dim), the normal, or (num_points, 3, 3), at the start
    frame: np.ndarray
    #: residual, correction: shape (widest, unknowns), work space of the vertex at hand, for the
    #: points that the vertex with most points has
    residual: np.ndarray
    correction: np.ndarray
    inverse: np.ndarray  #: the vertices' inverse matrices, flat
    inverse_offsets: np.ndarray  #: shape (num_vertices + 1,); equal ones where none is kept
    lines: np.ndarray  #: shape (widest * unknowns**2,), work space
    #: shape (num_points, unknowns, unknowns), columns of the slopes T that the inverse is made for
    slope: np.ndarray
    #: shape (num_vertices,), sum of 1 / (trace W_ii)^2: r^2 for a unit velocity
    rounding: np.ndarray
    #: work space, shape (widest, 1, 2) in 2D and (widest, 3, 3) in 3D: K_i K_p^T F_p F_i^T, its
    #: first row in 2D; empty where frames stay
    tilt: np.ndarray
    #: shape (num_vertices,), whether w of a node is not the same in all directions
    directed: np.ndarray
    free: np.ndarray  #: velocities without impulses, of the step at hand

    def for_thread(self, free: np.ndarray) -> _Blocks:
        """The same vertices with work space of its own, in a step from these free velocities."""
        spaces = ("residual", "correction", "lines", "tilt")
        own = {name: np.zeros_like(getattr(self, name)) for name in spaces}
        return self._replace(free=free, **own)


def _unknowns(interactions: Interactions) -> int:
    """Unknowns of a point: most components that a law of the scene has."""
    return max(g.kernels.components for g in interactions.permanent)


def _frame(group: PointGroup, unknowns: int) -> np.ndarray:
    """Frames of a group's points at the start, as the others of the scene have them."""
    frame = group.couplings.frame
    if group.turning is not None:
        from xper_fx.nscd.lips import start_frames

        frame = start_frames(group.turning.tangent[group.turning.site], frame.shape[1])
    return frame_from_normal(frame[:, 0]) if frame.shape[1] < unknowns == 3 else frame


@njit(inline="always")
def points_of(tiles, b):
    """A vertex's points of a group; unsigned, as a signed index is checked for being negative."""
    return range(np.uintp(tiles[b]), np.uintp(tiles[b + 1]))


@njit
def _set_identities(inverse, offsets, sizes):
    for b in range(len(sizes)):
        if offsets[b + 1] > offsets[b]:
            for j in range(sizes[b]):
                inverse[offsets[b] + j * (sizes[b] + 1)] = 1.0


def vertex_of_points(groups: list[PointGroup]) -> np.ndarray:
    """The vertex of each point, group by group, of groups that are ordered by vertices."""
    offsets = [g.ordering.tile_offsets for g in groups]
    vertices = [np.repeat(np.arange(len(o) - 1), np.diff(o)) for o in offsets]
    return np.concatenate([np.zeros(0, np.int64), *vertices])


def num_vertices_of(groups: list[PointGroup]) -> int:
    """Vertices of groups that are ordered by these, such as have lost their points included."""
    return len(groups[0].ordering.tile_offsets) - 1


def _directed(interactions: Interactions, vertex: np.ndarray, count: int) -> np.ndarray:
    """Whether a vertex has a node whose w, (dim, dim), is not the same in all directions."""
    dim = interactions.dim
    w = interactions.permanent[0].couplings.w.reshape(-1, dim, dim)
    node = np.concatenate([g.couplings.start for g in interactions.permanent])[:, :, 0] // dim
    same = w[:, :1, :1] * np.eye(dim)
    return np.bincount(vertex, (w != same).any(axis=(1, 2))[node].any(axis=1), count) > 0


def build(interactions: Interactions, before: _Blocks | None = None) -> _Blocks:
    """The vertices' arrays of a scene.

    Args:
        before: those of the same vertices when they had other points or slots; the inverses of
            vertices with as many points are kept.
    """
    unknowns, groups = _unknowns(interactions), interactions.permanent
    vertex = vertex_of_points(groups)
    order = np.argsort(vertex, kind="stable")

    def gathered(arrays):
        return np.concatenate(arrays)[order] if len(groups) > 1 else arrays[0]

    counts = np.bincount(vertex, minlength=num_vertices_of(groups))
    dofs = counts * unknowns
    kept = np.where(dofs <= _NEWTON_DOFS, dofs**2, 0)
    total, widest = len(vertex), int(counts.max(initial=0))
    diagonal = {1: [0], 2: [0, 2], 3: [0, 3, 5]}
    trace = np.concatenate(
        [g.compliance[:, diagonal[g.kernels.components]].sum(axis=1) for g in groups]
    )[order]
    squared = np.divide(1.0, trace**2, out=np.zeros(total), where=trace > 0.0)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    inverse_offsets = np.concatenate([[0], np.cumsum(kept)])
    inverse, slope = np.zeros(inverse_offsets[-1]), np.zeros((total, unknowns, unknowns))
    _set_identities(inverse, inverse_offsets, dofs)
    if before is not None:
        same = np.diff(before.offsets) == counts
        inverse[np.repeat(same, kept)] = before.inverse[
            np.repeat(same, np.diff(before.inverse_offsets))
        ]
        slope[np.repeat(same, counts)] = before.slope[np.repeat(same, np.diff(before.offsets))]
    frame = np.ascontiguousarray(gathered([_frame(g, unknowns) for g in groups]))
    return _Blocks(
        offsets=offsets,
        start=np.ascontiguousarray(gathered([g.couplings.start for g in groups])[:, :, 0]),
        frame=frame,
        residual=np.zeros((widest, unknowns)),
        correction=np.zeros((widest, unknowns)),
        inverse=inverse,
        inverse_offsets=inverse_offsets,
        lines=np.zeros(widest * unknowns**2),
        slope=slope,
        rounding=np.bincount(vertex[order], squared, len(counts)),
        tilt=np.zeros((widest if interactions.turns else 0, *frame.shape[1:])),
        directed=_directed(interactions, vertex, len(counts)),
        free=np.zeros(0),
    )


class _Turns(NamedTuple):
    """How a vertex and its points have turned, K being frames of the start and F those of now."""

    none: tuple  #: of a vertex that has not
    #: `(K, p, F, i)`, K_p^T F_i of a point, p among those of all vertices, i in its group
    whole: Callable
    set_tilt: Callable  #: `(tilt, position, K, p, F, i, turn)`, K_p turn F_i^T


@cache
def _turn_kernels(dim: int) -> _Turns:
    if dim == 2:

        @njit(inline="always")
        def times(a, b):
            """conj(a) b."""
            return a[0] * b[0] + a[1] * b[1], a[0] * b[1] - a[1] * b[0]

        # turns are complex numbers, as normals are
        @njit(inline="always")
        def whole(start, p, now, i):
            return times((start[p, 0, 0], start[p, 0, 1]), (now[i, 0, 0], now[i, 0, 1]))

        @njit(inline="always")
        def set_tilt(tilt, position, start, p, now, i, turn):
            c, s = times(whole(start, p, now, i), turn)
            tilt[position, 0, 0], tilt[position, 0, 1] = c, s

        return _Turns((1.0, 0.0), whole, set_tilt)

    space = for_dimension(3)
    to_local, to_global, add, scale = space.to_local, space.to_global, space.add, space.scale

    @njit(inline="always")
    def whole(start, p, now, i):
        return (
            to_global(start, p, (now[i, 0, 0], now[i, 1, 0], now[i, 2, 0])),
            to_global(start, p, (now[i, 0, 1], now[i, 1, 1], now[i, 2, 1])),
            to_global(start, p, (now[i, 0, 2], now[i, 1, 2], now[i, 2, 2])),
        )  # columns

    @njit(inline="always")
    def set_tilt(tilt, position, start, p, now, i, turn):
        for y in range(3):
            turned = add(scale(now[i, y, 0], turn[0]), scale(now[i, y, 1], turn[1]))
            column = to_local(start, p, add(turned, scale(now[i, y, 2], turn[2])))
            for x in range(3):
                tilt[position, x, y] = column[x]

    return _Turns(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), whole, set_tilt)


@cache
def _group_kernels(law: LawKernels, dim: int, unknowns: int, alone: bool, turns: bool):
    """What a vertex does with its points of one law, merged into its solver if there is no other.

    Each kernel takes the vertex, the velocities, the vertices' arrays, the count of the vertex's
    points before these, and the group's arrays.
    """
    components = law.components
    algebra, world = for_dimension(dim, components), for_dimension(dim)
    row, set_row, dot, unit = algebra.row, algebra.set_row, algebra.dot, algebra.unit
    add, scale, subtract = algebra.add, algebra.scale, algebra.subtract
    of_vertex = for_dimension(dim, unknowns)
    vertex_unit, to_local, to_global = of_vertex.unit, of_vertex.to_local, of_vertex.to_global
    add_world, scale_world = world.add, world.scale
    sides = Sides(dim, components, 1)
    read, push = point_velocity(sides), point_impulse(sides, Blocks(dim, aligned=True))
    solve, prepare, touch = law.solve, law.prepare, jump_to_prepare(law, dim)
    kernel = _MERGED if alone else _KERNEL
    turns = turns and components == dim
    to_start, to_now = algebra.to_local, algebra.to_global
    _, whole, set_tilt = _turn_kernels(dim)

    @njit(inline="always")
    def without_rounding(x):
        """A vector whose components that are rounding of its turn are zero: open points stay so."""
        least = _ROUNDING * _ROUNDING * dot(x, x)
        a = x[0] if x[0] * x[0] > least else 0.0
        b = x[1] if x[1] * x[1] > least else 0.0
        if dim == 2:
            return a, b
        return a, b, x[2] if x[2] * x[2] > least else 0.0

    @njit(inline="always")
    def slopes_at_start(tilt, p, slopes):
        """Columns of G T G^T for those of T."""
        if dim == 2:
            c, s = tilt[p, 0, 0], tilt[p, 0, 1]
            x = add(scale(c, slopes[0]), scale(s, slopes[1]))
            y = add(scale(-s, slopes[0]), scale(c, slopes[1]))
            return to_start(tilt, p, x), to_start(tilt, p, y)
        x = combined(tilt, p, 0, slopes)
        y = combined(tilt, p, 1, slopes)
        z = combined(tilt, p, 2, slopes)
        return to_start(tilt, p, x), to_start(tilt, p, y), to_start(tilt, p, z)

    @njit(inline="always")
    def combined(tilt, p, x, slopes):
        total = add(scale(tilt[p, x, 0], slopes[0]), scale(tilt[p, x, 1], slopes[1]))
        return add(total, scale(tilt[p, x, 2], slopes[2]))

    @njit(**MERGED)
    def answer(i, u, r, p):
        return solve(i, u, r, p.compliance, p.parameters, p.terms, p.details)

    # A call costs as much as it passes: only the arrays needed, not all of the group's.
    @_KERNEL
    def impulse(i, u, r, w_points, parameters, terms, details):
        new, _ = solve(i, u, r, w_points, parameters, terms, details)
        return new

    @kernel
    def begin(b, v, group, ratio, step, theta):
        """Constants of the step; impulses start from the last step's."""
        tiles, c, p = group[0], group[1], group[2]
        for i in points_of(tiles, b):
            jump = touch(i, row(p.jump, i), p.area[i], p.parameters, p.state)
            prepare(
                i, jump, row(p.velocity, i), p.compliance, p.area[i], step, theta,
                p.parameters, p.state, p.terms, p.details,
            )  # fmt: skip
            r = scale(ratio, row(p.committed, i))
            set_row(p.impulse, i, r)
            push(v, c, i, r)

    @kernel
    def act(b, v, group):
        """All impulses act on the velocities."""
        tiles, c, p = group[0], group[1], group[2]
        for i in points_of(tiles, b):
            push(v, c, i, row(p.impulse, i))

    @kernel
    def evaluate(b, v, blocks, position, group):
        """residual = S(b) - r."""
        tiles, c, p, inverse_area = group
        changed, total, largest = 0.0, 0.0, 0.0
        for i in points_of(tiles, b):
            old = row(p.impulse, i)
            new, _ = answer(i, read(v, c, i), old, p)
            change = subtract(new, old)
            set_row(blocks.residual, position, change)
            for x in range(components, unknowns):  # what a point of another law has left there
                blocks.residual[position, x] = 0.0
            size = dot(change, change)
            changed += size
            total += dot(new, new)
            largest = max(largest, size * inverse_area[i] * inverse_area[i])
            position += 1
        return position, changed, total, largest

    @kernel
    def tilt(b, blocks, position, known, vertex, group):
        """How the points have turned beside their vertex; `vertex` is its own turn, once known."""
        tiles, c = group[0], group[1]
        for i in points_of(tiles, b):
            if turns:
                p = blocks.offsets[b] + position
                if not known:
                    known, vertex = True, whole(blocks.frame, p, c.frame, i)
                set_tilt(blocks.tilt, position, blocks.frame, p, c.frame, i, vertex)
            position += 1
        return position, known, vertex

    @kernel
    def turn(b, blocks, position, group):
        """Residuals go over to the frames of the start."""
        tiles = group[0]
        for _ in points_of(tiles, b):
            if turns:
                change = row(blocks.residual, position)
                set_row(blocks.residual, position, to_start(blocks.tilt, position, change))
            position += 1
        return position

    @kernel
    def sweep(b, v, blocks, position, group, relax):
        tiles, c, p, inverse_area = group
        changed, total, largest = 0.0, 0.0, 0.0
        for i in points_of(tiles, b):
            old = row(p.impulse, i)
            new, smooth = answer(i, read(v, c, i), old, p)
            change = subtract(new, old)
            size = dot(change, change)
            if smooth:
                change = scale(relax, change)
                new = add(old, change)
            set_row(p.impulse, i, new)
            push(v, c, i, change)
            changed += size
            total += dot(new, new)
            largest = max(largest, size * inverse_area[i] * inverse_area[i])
        return position + tiles[b + 1] - tiles[b], changed, total, largest

    @kernel
    def correct(b, v, blocks, position, group):
        tiles, c, p = group[0], group[1], group[2]
        for i in points_of(tiles, b):
            change = row(blocks.correction, position)
            if turns:
                change = without_rounding(to_now(blocks.tilt, position, change))
            set_row(p.impulse, i, add(row(p.impulse, i), change))
            push(v, c, i, change)
            position += 1
        return position

    @njit(inline="always")
    def weighted(w, start, f):
        first = np.uintp(start) * dim
        if dim == 2:
            return w[first] * f[0] + w[first + 1] * f[1], w[first + 2] * f[0] + w[first + 3] * f[1]
        return (
            w[first] * f[0] + w[first + 1] * f[1] + w[first + 2] * f[2],
            w[first + 3] * f[0] + w[first + 4] * f[1] + w[first + 5] * f[2],
            w[first + 6] * f[0] + w[first + 7] * f[1] + w[first + 8] * f[2],
        )

    @njit(inline="always")
    def coupling(blocks, w, p, q, component):
        """Column of W_pq."""
        f = to_global(blocks.frame, q, vertex_unit(component, 1.0))
        out = scale_world(0.0, f)
        for s in range(2):
            for t in range(2):
                node = blocks.start[p, s]
                if node == blocks.start[q, t]:
                    sign = 1.0 if s == t else -1.0
                    out = add_world(out, scale_world(sign, weighted(w, node, f)))
        return to_local(blocks.frame, p, out)

    @njit(inline="always")
    def touching(start, p, q):
        return (
            start[p, 0] == start[q, 0]
            or start[p, 0] == start[q, 1]
            or start[p, 1] == start[q, 0]
            or start[p, 1] == start[q, 1]
        )

    @njit(inline="always")
    def slopes_of(i, u, r, p, reach):
        """Columns of T by differences."""
        law, factor = (p.compliance, p.parameters, p.terms, p.details), _REGULAR / reach
        base = impulse(i, u, r, *law)
        x = scale(factor, subtract(impulse(i, add(u, unit(0, reach)), r, *law), base))
        if components == 1:
            return (x,)
        y = scale(factor, subtract(impulse(i, add(u, unit(1, reach)), r, *law), base))
        if components == 2:
            return x, y
        z = scale(factor, subtract(impulse(i, add(u, unit(2, reach)), r, *law), base))
        return x, y, z

    @njit(inline="always")
    def changed(slope, point, slopes, z, x):
        return slopes[z][x] - slope[point, z, x]

    @_KERNEL
    def update(y, start, lines, slope, point, n, own, slopes):
        """Y for a new slope of one point, given the rows g Y of W - diag W in `lines`.

        I - T (W - diag W) changes by -d g, and Y by (Y d) (g Y) / (1 - g Y d), column by column.
        """
        for z in range(components):
            line = z * n
            for earlier in range(z):
                factor = 0.0
                for x in range(components):
                    factor += lines[line + own + x] * changed(slope, point, slopes, earlier, x)
                for j in range(n):
                    lines[line + j] += factor * lines[earlier * n + j]
            pivot = 1.0
            for x in range(components):
                pivot -= lines[line + own + x] * changed(slope, point, slopes, z, x)
            inverse = 1.0 / pivot if abs(pivot) > _SINGULAR else 0.0
            for j in range(n):
                lines[line + j] *= inverse
        for i in range(n):
            row_i = start + i * n
            for z in range(components):
                factor = 0.0
                for x in range(components):
                    factor += y[row_i + own + x] * changed(slope, point, slopes, z, x)
                for j in range(n):
                    y[row_i + j] += factor * lines[z * n + j]
        for z in range(components):
            for x in range(components):
                slope[point, z, x] = slopes[z][x]

    @_KERNEL
    def renew(b, v, blocks, position, group, reach, threshold):
        """Take new slopes where the residual is above the threshold; the inverse follows."""
        tiles, c, p = group[0], group[1], group[2]
        y, start, lines = blocks.inverse, blocks.inverse_offsets[b], blocks.lines
        low, high = blocks.offsets[b], blocks.offsets[b + 1]
        n = (high - low) * unknowns
        for i in points_of(tiles, b):
            residual = row(blocks.residual, position)
            if dot(residual, residual) > threshold:
                u, old = read(v, c, i), row(p.impulse, i)
                for j in range(components * n):
                    lines[j] = 0.0
                point = low + position
                for other in range(low, high):
                    if other == point or not touching(blocks.start, point, other):
                        continue
                    for z in range(components):
                        # W is symmetric: row z of W_pq is column z of W_qp
                        g = coupling(blocks, c.w, other, point, z)
                        line, source = z * n, start + (other - low) * unknowns * n
                        for j in range(n):
                            if unknowns == 1:
                                lines[line + j] += g[0] * y[source + j]
                            elif unknowns == 2:
                                lines[line + j] += g[0] * y[source + j] + g[1] * y[source + n + j]
                            else:
                                lines[line + j] += (
                                    g[0] * y[source + j]
                                    + g[1] * y[source + n + j]
                                    + g[2] * y[source + 2 * n + j]
                                )
                slopes = slopes_of(i, u, old, p, reach)
                if turns:
                    slopes = slopes_at_start(blocks.tilt, position, slopes)
                update(y, start, lines, blocks.slope, point, n, position * unknowns, slopes)
            position += 1
        return position

    evolve_point = law.evolve

    @kernel
    def evolve(b, v, group):
        """Internal variables follow; their largest relative change."""
        largest = 0.0
        if evolve_point is not None:
            tiles, c, p = group[0], group[1], group[2]
            for i in points_of(tiles, b):
                change = evolve_point(
                    i, read(v, c, i), p.compliance, p.parameters, p.terms, p.details
                )
                largest = max(largest, change)
        return largest

    return begin, act, evaluate, tilt, turn, sweep, correct, renew, evolve


@cache
def _chain(laws: tuple[LawKernels, ...], dim: int, unknowns: int, alone: bool, turns: bool):
    """The kernels over all the laws of a vertex, one after the other."""
    kernel = _MERGED if alone else _KERNEL
    kernels = _group_kernels(laws[0], dim, unknowns, alone, turns)
    begin, act, evaluate, tilt, turn, sweep, correct, renew, evolve = kernels
    last = len(laws) == 1
    rest = kernels if last else _chain(laws[1:], dim, unknowns, alone, turns)
    begin_2, act_2, evaluate_2, tilt_2, turn_2, sweep_2, correct_2, renew_2, evolve_2 = rest

    @kernel
    def begin_all(b, v, groups, ratio, step, theta):
        begin(b, v, groups[0], ratio, step, theta)
        if not last:
            begin_2(b, v, groups[1:], ratio, step, theta)

    @kernel
    def act_all(b, v, groups):
        act(b, v, groups[0])
        if not last:
            act_2(b, v, groups[1:])

    @kernel
    def evaluate_all(b, v, blocks, position, groups):
        position, changed, total, largest = evaluate(b, v, blocks, position, groups[0])
        if not last:
            position, x, y, z = evaluate_2(b, v, blocks, position, groups[1:])
            changed, total, largest = changed + x, total + y, max(largest, z)
        return position, changed, total, largest

    @kernel
    def tilt_all(b, blocks, position, known, vertex, groups):
        position, known, vertex = tilt(b, blocks, position, known, vertex, groups[0])
        if not last:
            position, known, vertex = tilt_2(b, blocks, position, known, vertex, groups[1:])
        return position, known, vertex

    @kernel
    def turn_all(b, blocks, position, groups):
        position = turn(b, blocks, position, groups[0])
        if not last:
            position = turn_2(b, blocks, position, groups[1:])
        return position

    @kernel
    def sweep_all(b, v, blocks, position, groups, relax):
        position, changed, total, largest = sweep(b, v, blocks, position, groups[0], relax)
        if not last:
            position, x, y, z = sweep_2(b, v, blocks, position, groups[1:], relax)
            changed, total, largest = changed + x, total + y, max(largest, z)
        return position, changed, total, largest

    @kernel
    def correct_all(b, v, blocks, position, groups):
        position = correct(b, v, blocks, position, groups[0])
        if not last:
            position = correct_2(b, v, blocks, position, groups[1:])
        return position

    @_KERNEL
    def renew_all(b, v, blocks, position, groups, reach, threshold):
        position = renew(b, v, blocks, position, groups[0], reach, threshold)
        if not last:
            position = renew_2(b, v, blocks, position, groups[1:], reach, threshold)
        return position

    @kernel
    def evolve_all(b, v, groups):
        largest = evolve(b, v, groups[0])
        if not last:
            largest = max(largest, evolve_2(b, v, groups[1:]))
        return largest

    return (
        begin_all, act_all, evaluate_all, tilt_all, turn_all, sweep_all, correct_all, renew_all,
        evolve_all,
    )  # fmt: skip


@cache
def _solve_kernel(laws: tuple[LawKernels, ...], dim: int, unknowns: int, turns: bool):
    """A range of some vertices: `solve(first, last, vertices, v, groups, ..., speed, blocks)`.

    `v` are the free velocities at first, and `blocks.free` a copy of them. Returns the most sweeps
    of a vertex, the largest squared relative error and change of a traction, and how many vertices
    have not converged.
    """
    algebra = for_dimension(dim, unknowns)
    row, set_row, dot, add = algebra.row, algebra.set_row, algebra.dot, algebra.add
    chained = _chain(laws, dim, unknowns, len(laws) == 1, turns)
    begin_all, act_all, evaluate_all, tilt_all, turn_all = chained[:5]
    sweep_all, correct_all, renew_all, evolve_all = chained[5:]
    not_turned = _turn_kernels(dim).none

    none, ones = (0.0,) * unknowns, (1.0,) * unknowns

    @njit(inline="always")
    def products(a, at, x):
        """Entries of a row of the inverse times those of a point's residual, one by one."""
        if unknowns == 1:
            return (a[at] * x[0],)
        if unknowns == 2:
            return a[at] * x[0], a[at + np.uintp(1)] * x[1]
        return a[at] * x[0], a[at + np.uintp(1)] * x[1], a[at + np.uintp(2)] * x[2]

    @njit(inline="always")
    def multiply(blocks, b):
        """correction = inverse residual; returns its square."""
        a, line = blocks.inverse, np.uintp(blocks.inverse_offsets[b])
        points, width = np.uintp(blocks.offsets[b + 1] - blocks.offsets[b]), np.uintp(unknowns)
        n, size = points * width, 0.0
        for i in range(points):
            first = second = third = none
            for j in range(points):
                x, at = row(blocks.residual, j), line + j * width
                first = add(first, products(a, at, x))
                if unknowns > 1:
                    second = add(second, products(a, at + n, x))
                if unknowns > 2:
                    third = add(third, products(a, at + n + n, x))
            total = (dot(first, ones),)
            if unknowns == 2:
                total = (dot(first, ones), dot(second, ones))
            elif unknowns == 3:
                total = (dot(first, ones), dot(second, ones), dot(third, ones))
            set_row(blocks.correction, i, total)
            size += dot(total, total)
            line += n * width
        return size

    @njit(inline="always")
    def fetch(blocks, w, v, b):
        """What a vertex will want that does not lie in the order of its points begins to come."""
        end = np.uintp(blocks.inverse_offsets[b + 1])
        for line in range(np.uintp(blocks.inverse_offsets[b]), end, LINE):
            prefetch(blocks.inverse, line)
        for p in points_of(blocks.offsets, b):
            node = np.uintp(blocks.start[p, 0])
            prefetch(w, node * np.uintp(dim))
            prefetch(v, node)

    @_KERNEL
    def reset(blocks, b):
        """The inverse for zero slopes."""
        start = blocks.inverse_offsets[b]
        first = blocks.offsets[b] * unknowns
        n = blocks.offsets[b + 1] * unknowns - first
        for j in range(n * n):
            blocks.inverse[start + j] = 0.0
        for j in range(n):
            blocks.inverse[start + j * (n + 1)] = 1.0
            for x in range(unknowns):
                blocks.slope[blocks.offsets[b] + j // unknowns, j % unknowns, x] = 0.0

    @_KERNEL
    def act_again(b, v, blocks, groups):
        """Velocities from the free ones and all impulses, without what rounding has left."""
        for p in range(blocks.offsets[b], blocks.offsets[b + 1]):
            for side in range(2):
                first = np.uintp(blocks.start[p, side])
                for d in range(np.uintp(dim)):
                    v[first + d] = blocks.free[first + d]
        act_all(b, v, groups)

    @njit(inline="always")
    def solve_vertex(b, v, blocks, groups, tolerance, max_sweeps, relax, speed):
        """Returns sweeps, squared relative error, squared traction change, converged."""
        # impulses whose effect is within the rounding of the velocities
        floor = (16.0 * np.finfo(np.float64).eps * speed) ** 2 * blocks.rounding[b]
        bound = tolerance * tolerance
        newton = blocks.inverse_offsets[b + 1] > blocks.inverse_offsets[b]
        previous, batch, length, fresh, tilted = np.inf, 0, _BATCH, 0, False
        # squares of the largest correction, and of what may come and go unseen in velocities
        peak, unseen = 0.0, _SWOLLEN * speed * speed * blocks.rounding[b]
        if not newton:
            batch = max_sweeps
        for count in range(1, max_sweeps + 1):
            if batch > 0:
                batch -= 1
                _, changed, total, largest = sweep_all(b, v, blocks, 0, groups, relax)
                error = np.inf
                if previous < np.inf and changed < previous:
                    rho = np.sqrt(changed / previous)
                    error = changed * max(1.0, rho / (1.0 - rho)) ** 2
                previous, peak = changed if batch > 0 else np.inf, max(peak, changed)
                if changed <= floor or error <= bound * total:
                    if peak > unseen + _SWOLLEN * total:
                        act_again(b, v, blocks, groups)
                        peak, previous = 0.0, np.inf
                        continue
                    if evolve_all(b, v, groups) <= tolerance:
                        left = 0.0 if changed <= floor else min(error, changed) / max(total, _TINY)
                        return count, left, largest, True
                    previous = np.inf
                continue
            _, changed, total, largest = evaluate_all(b, v, blocks, 0, groups)
            error = changed
            if changed > max(floor, _CLEAR * bound * total):
                if turns:
                    if not tilted:
                        tilt_all(b, blocks, 0, blocks.directed[b], not_turned, groups)
                        tilted = True
                    turn_all(b, blocks, 0, groups)
                if changed > _SLOW * _SLOW * previous:
                    if fresh == _NEWTON_STEPS:
                        reset(blocks, b)
                        batch, length, fresh, previous = length, 2 * length, 0, np.inf
                        continue
                    renew_all(b, v, blocks, 0, groups, 1e-6 * speed, 1e-4 * changed)
                    fresh += 1
                previous = changed
                error = max(changed, multiply(blocks, b))
                if error > bound * total:
                    correct_all(b, v, blocks, 0, groups)
                    peak = max(peak, error)
                    continue
            if peak > unseen + _SWOLLEN * total:
                act_again(b, v, blocks, groups)
                peak, previous, fresh = 0.0, np.inf, 0
                continue
            if evolve_all(b, v, groups) <= tolerance:
                left = 0.0 if changed <= floor else error / max(total, _TINY)
                return count, left, largest, True
            previous, fresh = np.inf, 0
        return max_sweeps, changed / max(total, floor, _TINY), largest, False

    @njit(fastmath={"contract"}, nogil=True, **LEAN_ENTRY)
    def solve_range(
        first, last, vertices, v, groups, ratio, step, theta, tolerance, max_sweeps, relax, speed,
        blocks
    ):  # fmt: skip
        sweeps, residual, traction, failed = 0, 0.0, 0.0, 0
        for n in range(first, last):
            b = vertices[n]
            if n + 1 < last:
                fetch(blocks, groups[0][1].w, v, vertices[n + 1])
            begin_all(b, v, groups, ratio, step, theta)
            count, error, largest, converged = solve_vertex(
                b, v, blocks, groups, tolerance, max_sweeps, relax, speed
            )
            sweeps, residual = max(sweeps, count), max(residual, error)
            traction = max(traction, largest)
            failed += 0 if converged else 1
        return sweeps, residual, traction, failed

    return solve_range


class VertexBlocks(Solver):
    """One small problem a mesh vertex, for an explicit bulk with nodal points.

    Vertices that contacts touch, and these, take turns (`touching/touching_clusters.py`).
    """

    name = "vertex_blocks"

    def __init__(self) -> None:
        self._blocks: _Blocks | None = None
        self._all = np.zeros(0, np.int32)
        self._loose: LooseVertices | None = None
        self._halo: object = None

    def solve(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> SolveReport:
        """Find the impulses of the step, as `Solver.solve` says."""
        if interactions.ordering != "vertices":
            raise ValueError(
                "Vertex by vertex, points should be ordered so: build Interactions with "
                f'ordering="vertices", got {interactions.ordering!r}.'
            )
        self._take_points(interactions)
        move = self._move(interactions, velocity, options)
        if not interactions.touches:
            return move(self._all)
        from xper_fx.nscd.touching.in_turns import take_turns

        if self._loose is None:
            from xper_fx.nscd.touching.loose_vertices import LooseVertices

            groups, inverse = interactions.permanent, interactions.inverse
            self._loose = LooseVertices(groups, vertex_of_points(groups), len(self._all), inverse)
        return take_turns(interactions, self._loose, velocity, move, options, self._all)

    def _take_points(self, interactions: Interactions) -> None:
        """Make what is kept of vertices, or make it anew where points have gone or moved."""
        groups, blocks = interactions.permanent, self._blocks
        count = sum(map(len, groups))
        if blocks is not None and blocks.offsets[-1] == count and self._halo is interactions.halo:
            return
        self._halo, self._loose = interactions.halo, None
        if groups:
            self._blocks = build(interactions, blocks)
            self._all = np.arange(num_vertices_of(groups), dtype=np.int32)

    def _move(
        self, interactions: Interactions, velocity: np.ndarray, options: SolveOptions
    ) -> Callable[[np.ndarray], SolveReport]:
        """What solves some vertices, from the velocities of their corners."""
        groups = tuple(
            (g.ordering.tile_offsets, Couplings(*g.couplings[:7]), g.law_arrays(), g.inverse_area)
            for g in interactions.permanent
        )
        free, speeds = np.empty_like(velocity), velocity
        if len(interactions.rigid_blocks):  # a spin moves what is at the end of an arm
            speeds = velocity.copy()
            interactions.own_rigid(speeds)[1::2] *= largest_arm(interactions.passing)
        speed = max(speeds.max(initial=_TINY), -speeds.min(initial=-_TINY))
        dim, blocks, everywhere = interactions.dim, self._blocks, self._all

        def move(vertices: np.ndarray) -> SolveReport:
            if not len(vertices):
                return SolveReport(True, 0, 0.0, 0.0)
            if vertices is everywhere:
                free[:] = velocity
            else:
                corners = self._loose.corners.of(vertices)
                free.reshape(-1, dim)[corners] = velocity.reshape(-1, dim)[corners]
            kernel = _solve_kernel(
                tuple(g.kernels for g in interactions.permanent), dim, _unknowns(interactions),
                interactions.turns,
            )  # fmt: skip
            threads = worth_taking(len(vertices), _MANY, options.num_threads)
            found = in_ranges(
                kernel, len(vertices), vertices, velocity, groups, interactions.step_ratio,
                interactions.step_size, interactions.theta, options.tolerance, options.max_sweeps,
                options.relaxation, speed,
                spaces=[blocks.for_thread(free) for _ in range(threads)],
            )  # fmt: skip
            sweeps, residual, traction, failed = zip(*found, strict=True)
            return SolveReport(
                not any(failed),
                max(sweeps),
                np.sqrt(max(residual)),
                np.sqrt(max(traction)) / interactions.step_size,
            )

        return move

    def kept(self) -> list[object]:
        """The vertices' arrays."""
        return [] if self._blocks is None else [self._blocks]

    def saved(self, interactions: Interactions) -> dict[str, dict[str, np.ndarray]]:
        """Inverses of vertices and the slopes they are made for."""
        if self._blocks is None:
            return {}
        self._take_points(interactions)  # lips may have parted since
        return {"vertex_blocks": {"inverse": self._blocks.inverse, "slope": self._blocks.slope}}

    def restore(self, interactions: Interactions, saved: Mapping[str, Mapping]) -> None:
        """Take what `saved` gave."""
        if "vertex_blocks" in saved:
            held = saved["vertex_blocks"]
            self._take_points(interactions)
            self._blocks.inverse[:], self._blocks.slope[:] = held["inverse"], held["slope"]
