# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The linearised interaction problem, solved in the velocities of the bodies.

At a point, with the others frozen, the law answers r = S(b), b = u - W_aa r. Around the present
state its answer is S(b) + D db, D taken by differences, so that the point moves with its neighbours
as a spring,

    dr = g - K H^T dv,   K = -(I + D W_aa)^-1 D,   g = (I + K W_aa)(S(b) - r),

K = C^-1 for a law of compliance C, zero for an open point, infinite where the law holds the
velocity itself (sticking, perfect bond). There D is shortened by a millionth, a proximal term that
also makes redundant constraints (a ring of sticking facets) harmless. With dv = w H dr all make

    (w^-1 + H K H^T) dv = H g,

sparse, over the bodies' degrees of freedom, symmetric but for sliding with friction. GMRES solves
it with two corrections added up (for an interior point Orthomin, and GMRES where that stalls:
`algebra/krylov.py`):

- the clusters of facing nodes (`clusters.py`: a vertex of the mesh before it was cut) one after the
  other, K included, each by a dense inverse: however stiff the springs, they are inside. What the
  bodies hand on from the clusters before is taken along (block Gauss-Seidel), which halves the
  iterations of clusters that are each alone. Where no point acts across clusters the matrix is
  L + D + L^T, L being entries of w^-1, so that its product with z = (L + D)^-1 r is r + L^T z: the
  same pass over L gives both, and springs are not read again;
- all clusters moving as one, in which no point opens: P^T w^-1 P, the matrix of the mesh before it
  was cut (`clusters_as_one.py`). It carries over any distance, and on a sound mesh makes the number
  of iterations nearly independent of its size.

The second is left out where many points are open or slide: facing nodes do not move as one.

Rigid bodies have nothing of the kind, and their stacks, arches and packings hand a load on over
many bodies. Blocks with many nodes on their boundary deform in ways of which neither correction
knows. So the matrix itself is factored, where it is not too large, if all bodies are rigid, and of
other bodies once many iterations were needed in the step. Newton's method gains by more than
their time: changes that are exact settle most points at once, where rough ones make many of them
open and close in turn.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import bsr_array, coo_array, diags_array
from scipy.sparse.linalg import splu

from xper_fx.cache import njit
from xper_fx.nscd.algebra.krylov import gmres, norm, orthomin
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.couplings import (
    LINE,
    Sides,
    lever_arm_kernels,
    point_force,
    point_velocity,
    prefetch,
    spread_kernel,
)
from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.opening_matrix import opening_matrix
from xper_fx.nscd.point_group import PointGroup
from xper_fx.nscd.solvers.clusters import Clusters, facing_clusters, springs_within
from xper_fx.nscd.solvers.clusters_as_one import ClustersAsOne

# Reach of the differences, relative to the local velocity; and to the largest one, where that is 0.
_REACH, _LEAST = 1e-6, 1e-9
# Shortening of D (module docstring), and change of D, or of K by a turn, that counts as rounding.
_PROXIMAL, _SAME = 1e-6, 1e-6
# Directions that Orthomin keeps, and vectors that GMRES keeps before a restart.
_KEPT, _BASIS = 2, 40
# How often what rounding has left over is solved for.
_REFINEMENTS = 1
# Share of the motion at points that springs hold, below which facing nodes do not move as one.
MOSTLY = 0.75
# Degrees of freedom up to which the matrix of rigid bodies is factored; of meshed ones, in 2D and
# in 3D, and iterations after which it is.
_RIGID = 6000
DIRECT, MANY = {2: 40_000, 3: 12_000}, 40
# Pivot, relative to the largest entry, at which a block counts as singular.
_SINGULAR = 1e-13
# Entries of blocks that stay in the cache while they are made, and how far ahead of their use they
# are fetched, as sweeps wait for memory else.
_IN_CACHE, _AHEAD = 50_000, np.uintp(1024)

_KERNEL = njit(fastmath={"contract"}, nogil=True, **LEAN_ENTRY)


@cache
def residual_kernel(law: LawKernels, sides: Sides):
    """Kernel: sum over points of |S(b) - r|^2 and |r|^2, and the largest |S(b) - r|^2 / area^2."""
    algebra = for_dimension(sides.dim, sides.components)
    row, subtract, dot = algebra.row, algebra.subtract, algebra.dot
    read = point_velocity(sides)
    solve = law.solve

    @_KERNEL
    def residual(v, c, points, inverse_area):
        w, parameters, terms = points.compliance, points.parameters, points.terms
        changed, total, largest = 0.0, 0.0, 0.0
        for number in range(len(inverse_area)):
            i = np.uintp(number)
            old = row(points.impulse, i)
            new, _ = solve(i, read(v, c, i), old, w, parameters, terms, points.details)
            change = subtract(new, old)
            size = dot(change, change)
            changed += size
            total += dot(old, old)
            largest = max(largest, size * inverse_area[i] * inverse_area[i])
        return changed, total, largest

    return residual


def residual(interactions: Interactions, velocity: np.ndarray) -> tuple[float, float, float]:
    """What is left of the interaction problem: every point asked once, nothing changed.

    Args:
        interactions: points and their impulses r.
        velocity: shape (num_slots * dim,), v_free + w H r.

    Returns:
        |S(b) - r| and |r| over all points of all ranks (N s), and the largest |S(b) - r| / (h area)
        (Pa).
    """
    changed, total, largest = 0.0, 0.0, 0.0
    for g in interactions.groups:
        kernel = residual_kernel(g.kernels, g.sides)
        x, y, z = kernel(velocity, g.couplings, g.law_arrays(), g.inverse_area)
        changed, total, largest = changed + x, total + y, max(largest, z)
    changed, total = interactions.total(np.array([changed, total])).tolist()
    largest = interactions.largest(largest)
    return np.sqrt(changed), np.sqrt(total), np.sqrt(largest) / interactions.step_size


@njit(fastmath={"contract"}, **LEAN_INNER)
def _stiffness(slope, w, work):
    """work = K = -(I + D W)^-1 D, by Gauss-Jordan; False where I + D W is singular."""
    size = len(slope)
    for i in range(size):
        for j in range(size):
            total = 1.0 if i == j else 0.0
            for x in range(size):
                total += slope[i, x] * w[x, j]
            work[i, j] = total
            work[i, size + j] = -slope[i, j]
    for p in range(size):
        best = p
        for i in range(p + 1, size):
            if abs(work[i, p]) > abs(work[best, p]):
                best = i
        if abs(work[best, p]) <= 1e-3 * _PROXIMAL:
            return False
        for j in range(2 * size):
            work[p, j], work[best, j] = work[best, j], work[p, j]
        inverse = 1.0 / work[p, p]
        for j in range(2 * size):
            work[p, j] *= inverse
        for i in range(size):
            factor = work[i, p]
            if i != p and factor != 0.0:
                for j in range(2 * size):
                    work[i, j] -= factor * work[p, j]
    return True


@cache
def _tangent_kernel(law: LawKernels, sides: Sides):
    """Kernel that takes D, K and g of every point, and marks the points whose D is another."""
    components = sides.components
    algebra = for_dimension(sides.dim, components)
    row, add, subtract, unit = algebra.row, algebra.add, algebra.subtract, algebra.unit
    dot, sym_row, sym_vector = algebra.dot, algebra.sym_row, algebra.sym_vector
    read = point_velocity(sides)
    solve = law.solve

    @_KERNEL
    def tangents(v, c, points, least, own, room):
        r, w_points, parameters = points.impulse, points.compliance, points.parameters
        terms, details = points.terms, points.details
        slopes, stiffness, source, changed = own.slopes, own.stiffness, own.source, own.changed
        w, new, work = room
        for number in range(len(r)):
            i = np.uintp(number)
            old, u = row(r, i), read(v, c, i)
            wi = sym_row(w_points, i)
            b = subtract(u, sym_vector(wi, old))
            reach = max(_REACH * np.sqrt(dot(b, b)), least)
            factor = (1.0 - _PROXIMAL) / reach
            largest, apart, base = 0.0, 0.0, old
            for n in range(components + 1):  # the law is compiled into one place: it is long
                moved = u if n == 0 else add(u, unit(n - 1, reach))
                answer, _ = solve(i, moved, old, w_points, parameters, terms, details)
                if n == 0:
                    base = answer
                    continue
                j, column = n - 1, subtract(answer, base)
                for x in range(components):
                    new[x, j] = factor * column[x]
                    largest = max(largest, abs(new[x, j]))
                    apart = max(apart, abs(new[x, j] - slopes[i, x, j]))
            for j in range(components):
                x = sym_vector(wi, unit(j, 1.0))
                for y in range(components):
                    w[y, j] = x[y]
            changed[i] = apart > _SAME * largest
            if changed[i]:
                if not _stiffness(new, w, work):
                    for x in range(components):
                        for y in range(components):
                            work[x, components + y] = 0.0
                for x in range(components):
                    for y in range(components):
                        slopes[i, x, y] = new[x, y]
                        stiffness[i, x, y] = work[x, components + y]
            missing = subtract(base, old)
            velocity = sym_vector(wi, missing)
            for x in range(components):
                total = missing[x]
                for y in range(components):
                    total += stiffness[i, x, y] * velocity[y]
                source[i, x] = total

    return tangents


@cache
def _turn_kernel(sides: Sides):
    """Kernel that marks points whose K a turn has changed, and renews frames of the marked ones.

    A direction that is held is a million times as stiff as one that is free, so that a small turn
    of both counts.
    """
    local, world = for_dimension(sides.dim, sides.components), for_dimension(sides.dim)
    to_local, to_global, spring = local.to_local, local.to_global, local.matrix_vector
    unit, subtract, dot = world.unit, world.subtract, world.dot

    @njit(inline="always")
    def column(frame, stiffness, i, x):
        return to_global(frame, i, spring(stiffness, i, to_local(frame, i, unit(x, 1.0))))

    @_KERNEL
    def follow(now, stiffness, frame, changed):
        for i in range(len(changed)):
            apart, size = 0.0, 0.0
            for x in range(now.shape[2]):
                old = column(frame, stiffness, i, x)
                turned = subtract(column(now, stiffness, i, x), old)
                apart, size = apart + dot(turned, turned), size + dot(old, old)
            if apart > _SAME * _SAME * size:
                changed[i] = True
            if changed[i]:
                for x in range(now.shape[1]):
                    for d in range(now.shape[2]):
                        frame[i, x, d] = now[i, x, d]

    return follow


@cache
def _spring_kernels(sides: Sides):
    """Kernels over the points of a group: y += H K H^T x; dr = g - K H^T x; K into the blocks.

    Blocks of clusters are kept by columns, as are their inverses: a product adds up columns, whose
    entries are next to each other.
    """
    dim, components, k, lever_arms, _ = sides
    turns = dim if dim == 3 else 1
    local, world_algebra = for_dimension(dim, components), for_dimension(dim)
    world_unit, add, times = world_algebra.unit, world_algebra.add, world_algebra.scale
    to_local, to_global, spring = local.to_local, local.to_global, local.matrix_vector
    read = point_velocity(sides)
    give = point_force(sides)
    turned_unit, moment = lever_arm_kernels(dim)[1:] if lever_arms else (None, None)

    @njit(inline="always")
    def column(world, x):
        if dim == 2:
            return world[0, x], world[1, x]
        return world[0, x], world[1, x], world[2, x]

    @njit(inline="always")
    def force_of(world, u):
        f = times(u[0], column(world, 0))
        for x in range(1, dim):
            f = add(f, times(u[x], column(world, x)))
        return f

    @_KERNEL
    def pull(x, c, stiffness, y):
        for number in range(len(stiffness)):
            i = np.uintp(number)
            give(y, c, i, to_global(c.frame, i, spring(stiffness, i, read(x, c, i))))

    @_KERNEL
    def answer(x, c, stiffness, source, change):
        for i in range(len(stiffness)):
            f = spring(stiffness, i, read(x, c, i))
            for d in range(components):
                change[i, d] = source[i, d] - f[d]

    @_KERNEL
    def mark(c, changed, cluster, marked):
        for i in range(len(changed)):
            if changed[i]:
                for s in range(2):
                    for j in range(k):
                        marked[cluster[c.start[i, s, j] // dim]] = True

    @_KERNEL
    def turn_springs(c, i, clusters, marked, blocks, world):
        # what turns: pairs of a side's rotation with itself and with its translation
        for s in range(2):
            node, turn = c.start[i, s, 0] // dim, c.rotation_dof[i, s] // dim
            own = clusters.cluster[node]
            if turn == node or not marked[own]:
                continue
            n = (clusters.offsets[own + 1] - clusters.offsets[own]) * dim
            first = clusters.block_offsets[own]
            at, beside = clusters.position[turn] * dim, clusters.position[node] * dim
            for x in range(turns):
                f = force_of(world, turned_unit(c, i, s, x))
                g = moment(c, i, s, f)
                for y in range(turns):
                    blocks[first + (at + x) * n + at + y] += g[y]
                for y in range(dim):
                    blocks[first + (at + x) * n + beside + y] += f[y]
                    transposed = moment(c, i, s, column(world, y))
                    blocks[first + (beside + y) * n + at + x] += transposed[x]

    @_KERNEL
    def add_springs(c, frame, stiffness, points, clusters, marked, blocks, world):
        for i in points:
            hit = False
            for s in range(2):
                for j in range(k):
                    hit = hit or marked[clusters.cluster[c.start[i, s, j] // dim]]
            if not hit:
                continue
            for x in range(dim):  # columns of frame^T K frame
                u = to_local(frame, i, world_unit(x, 1.0))
                f = to_global(frame, i, spring(stiffness, i, u))
                for y in range(dim):
                    world[y, x] = f[y]
            for a in range(2 * k):
                node = c.start[i, a // k, a % k] // dim
                own = clusters.cluster[node]
                if not marked[own]:
                    continue
                n = (clusters.offsets[own + 1] - clusters.offsets[own]) * dim
                for b in range(2 * k):
                    other = c.start[i, b // k, b % k] // dim
                    if clusters.cluster[other] != own:
                        continue
                    scale = c.weights[i, a // k, a % k] * c.weights[i, b // k, b % k]
                    if a // k != b // k:
                        scale = -scale
                    first = (
                        clusters.block_offsets[own]
                        + clusters.position[node] * dim * n + clusters.position[other] * dim
                    )  # fmt: skip
                    for x in range(dim):
                        for y in range(dim):
                            blocks[first + y * n + x] += scale * world[x, y]
            if lever_arms:
                turn_springs(c, i, clusters, marked, blocks, world)

    return pull, answer, mark, add_springs


@_KERNEL
def _invert(a, first, n, swaps, row):
    """In-place inverse of the n x n block of `a` at `first`, pivots by rows; False if singular.

    `row` has room for the row of a pivot, so that the rows are changed without looking at it again.
    """
    first, n, scale = np.uintp(first), np.uintp(n), 0.0
    for i in range(n * n):
        scale = max(scale, abs(a[first + i]))
    for p in range(n):
        best = p
        for i in range(p + np.uintp(1), n):
            if abs(a[first + i * n + p]) > abs(a[first + best * n + p]):
                best = i
        swaps[p] = best
        pivot = a[first + best * n + p]
        if not abs(pivot) > _SINGULAR * scale:
            return False
        inverse, own, other = 1.0 / pivot, first + p * n, first + best * n
        for j in range(n):
            row[j], a[other + j] = a[other + j] * inverse, a[own + j]
        row[p] = inverse
        for i in range(n):
            line = first + i * n
            factor = a[line + p]
            if i != p and factor != 0.0:
                a[line + p] = 0.0
                for j in range(n):
                    a[line + j] -= factor * row[j]
        for j in range(n):
            a[own + j] = row[j]
    for back in range(n):
        p = n - np.uintp(1) - back
        q = swaps[p]
        if q != p:
            for i in range(n):
                line = first + i * n
                a[line + p], a[line + q] = a[line + q], a[line + p]
    return True


@_KERNEL
def _invert_bodies(data, data_offsets, sizes, fixed, starts, swaps, row):
    """w^-1 in place of w; rows and columns of prescribed degrees of freedom stay zero."""
    for b in range(len(sizes)):
        n, first, start = sizes[b], data_offsets[b], starts[b]
        for i in range(n):
            if fixed[start + i]:
                data[first + i * n + i] = 1.0
        if not _invert(data, first, n, swaps, row):
            return False
        for i in range(n):
            if fixed[start + i]:
                data[first + i * n + i] = 0.0
    return True


def inverted_bodies(inverse: BodyInverse) -> tuple[np.ndarray, np.ndarray, bool]:
    """Blocks of w^-1, flat as those of w.

    Returns:
        The blocks, with zero rows and columns of what is prescribed; which degrees of freedom are
        prescribed, shape (num_slots * dim,); and whether all blocks could be inverted.
    """
    sizes = np.diff(inverse.node_offsets) * inverse.dim
    starts = inverse.node_offsets[:-1] * inverse.dim
    blocks, fixed = inverse.data.copy(), prescribed(inverse)
    largest = sizes.max()
    room = np.empty(largest, np.uintp), np.empty(largest)
    regular = _invert_bodies(blocks, inverse.data_offsets, sizes, fixed, starts, *room)
    return blocks, fixed, regular


def prescribed(inverse: BodyInverse) -> np.ndarray:
    """Which degrees of freedom nothing moves, the ground's among them; (num_slots * dim,)."""
    sizes = np.diff(inverse.node_offsets) * inverse.dim
    within = np.arange(sizes.sum()) - np.repeat(inverse.node_offsets[:-1] * inverse.dim, sizes)
    diagonal = np.repeat(inverse.data_offsets[:-1], sizes) + within * np.repeat(sizes + 1, sizes)
    return inverse.data[diagonal] == 0.0


@cache
def _body_product(size: int):
    """Kernel y = w^-1 x; compiled for blocks of one size, or for any where it is 0."""

    @_KERNEL
    def multiply(data, data_offsets, sizes, starts, x, y):
        for b in range(len(sizes)):
            n = size if size > 0 else sizes[b]
            first, start = np.uintp(data_offsets[b]), np.uintp(starts[b])
            for i in range(n):
                y[start + np.uintp(i)] = 0.0
            # symmetric: columns are rows, whose entries are next to each other
            for i in range(n):
                factor = x[start + np.uintp(i)]
                line = first + np.uintp(i * n)
                for j in range(n):
                    y[start + np.uintp(j)] += factor * data[line + np.uintp(j)]

    return multiply


@_KERNEL
def _add_bodies(data, data_offsets, sizes, starts, bodies, clusters, marked, blocks, dim):
    """The entries of w^-1 between nodes of one marked cluster."""
    for b in bodies:
        n, node0 = sizes[b], starts[b] // dim
        count = n // dim
        for k in range(count):
            own = clusters.cluster[node0 + k]
            if not marked[own]:
                continue
            m = (clusters.offsets[own + 1] - clusters.offsets[own]) * dim
            line = clusters.block_offsets[own] + clusters.position[node0 + k] * dim * m
            for other in range(count):
                if clusters.cluster[node0 + other] == own:
                    into = line + clusters.position[node0 + other] * dim
                    entry = data_offsets[b] + k * dim * n + other * dim
                    for x in range(dim):
                        for y in range(dim):
                            blocks[into + x * m + y] += data[entry + x * n + y]


@_KERNEL
def _invert_clusters(portion, clusters, marked, blocks, fixed, dim, swaps, row):
    for a in range(portion[0], portion[1]):
        if not marked[a]:
            continue
        start, block = clusters.offsets[a], clusters.block_offsets[a]
        n = (clusters.offsets[a + 1] - start) * dim
        for i in range(n):
            if fixed[clusters.nodes[start + i // dim] * dim + i % dim]:
                for j in range(n):
                    blocks[block + i * n + j] = 0.0
                    blocks[block + j * n + i] = 0.0
                blocks[block + i * n + i] = 1.0
        if not _invert(blocks, block, n, swaps, row):
            return False
    return True


class _Couplings(NamedTuple):
    """L: entries of w^-1 between the nodes of a cluster and those of clusters before it."""

    #: shape (num_slots + 1,), first pair of each node, in the order of `Clusters.nodes`
    offsets: np.ndarray
    before: np.ndarray  #: first degree of freedom of the other node of each pair
    blocks: np.ndarray  #: shape (num_pairs, dim, dim), rows of the node itself

    @classmethod
    def of(cls, clusters: Clusters, sizes: np.ndarray, dim: int) -> _Couplings:
        """Room for those of bodies of so many degrees of freedom."""
        n = sizes // dim
        most = int(np.sum(n * (n - 1))) // 2
        return cls(
            np.zeros(len(clusters.nodes) + 1, np.int32), np.empty(most, np.int32),
            np.empty((most, dim, dim)),
        )  # fmt: skip


@_KERNEL
def _take_couplings(data, data_offsets, sizes, starts, body, clusters, couplings):
    dim, count = couplings.blocks.shape[1], 0
    for k in range(len(clusters.nodes)):
        node = clusters.nodes[k]
        b, own = body[node], clusters.cluster[node]
        first = data_offsets[b] + (node * dim - starts[b]) * sizes[b]
        for j in range(0, sizes[b], dim):
            if clusters.cluster[(starts[b] + j) // dim] < own:
                couplings.before[count] = starts[b] + j
                for x in range(dim):
                    for y in range(dim):
                        couplings.blocks[count, x, y] = data[first + x * sizes[b] + j + y]
                count += 1
        couplings.offsets[k + 1] = count


@cache
def _cluster_sweep(dim: int):
    """Kernel z = (L + D)^-1 r over clusters, and y = r + L^T z, which is (L + D + L^T) z.

    Once z of a cluster is known, its pairs add to y of the clusters before it.
    """

    @_KERNEL
    def sweep(clusters, couplings, blocks, r, z, y, room):
        offsets, before, pairs = couplings.offsets, couplings.before, couplings.blocks
        left, found = room[0], room[1]
        for a in range(len(clusters.offsets) - 1):
            first, last = clusters.offsets[a], clusters.offsets[a + 1]
            n = np.uintp((last - first) * dim)
            for k in range(last - first):
                dof = np.uintp(clusters.nodes[first + k] * dim)
                for x in range(dim):
                    i = dof + np.uintp(x)
                    total = y[i] = r[i]
                    for e in range(offsets[first + k], offsets[first + k + 1]):
                        e, other = np.uintp(e), np.uintp(before[e])
                        for j in range(dim):
                            total -= pairs[e, x, j] * z[other + np.uintp(j)]
                    left[np.uintp(k * dim + x)] = total
            line = np.uintp(clusters.block_offsets[a])
            for i in range(n):
                found[i] = 0.0
            for j in range(n):
                factor = left[j]
                prefetch(blocks, line + _AHEAD)
                prefetch(blocks, line + _AHEAD + LINE)
                for i in range(n):
                    found[i] += factor * blocks[line + i]
                line += n
            for k in range(last - first):
                dof = np.uintp(clusters.nodes[first + k] * dim)
                for x in range(dim):
                    z[dof + np.uintp(x)] = factor = found[np.uintp(k * dim + x)]
                    for e in range(offsets[first + k], offsets[first + k + 1]):
                        e, other = np.uintp(e), np.uintp(before[e])
                        for j in range(dim):
                            y[other + np.uintp(j)] += pairs[e, x, j] * factor

    return sweep


@_KERNEL
def _clear(portion, clusters, marked, blocks):
    for a in range(portion[0], portion[1]):
        if marked[a]:
            for i in range(clusters.block_offsets[a], clusters.block_offsets[a + 1]):
                blocks[i] = 0.0


class GroupTangents(NamedTuple):
    """D, K and g of the n points of a group, of m components each."""

    slopes: np.ndarray  #: D, shape (n, m, m)
    stiffness: np.ndarray  #: K, shape (n, m, m)
    source: np.ndarray  #: g, shape (n, m)
    change: np.ndarray  #: dr, shape (n, m)
    #: which points' D, or K in the axes of space, is another than before, shape (n,)
    changed: np.ndarray
    #: of when that was last so, shape as `Couplings.frame`, which it is where points do not turn.
    #: Blocks of clusters are made with it, and not with the frame of now: a block whose springs are
    #: what they were stays, and what is saved is all that it is made of.
    frame: np.ndarray

    @classmethod
    def of(cls, group: PointGroup) -> GroupTangents:
        """Of points whose D is not known."""
        n, m = len(group), group.kernels.components
        frame = group.couplings.frame
        return cls(
            np.full((n, m, m), np.inf), np.zeros((n, m, m)), np.zeros((n, m)), np.zeros((n, m)),
            np.zeros(n, np.bool_), frame if group.turning is None else frame.copy(),
        )  # fmt: skip


class PointTangents:
    """D, K and g of all points of a scene, in arrays that are kept.

    Attributes:
        groups: those of each group of points.
    """

    def __init__(self, interactions: Interactions):
        self.groups = [GroupTangents.of(g) for g in interactions.groups]

    def forget(self) -> None:
        """Count every D as another, as K depends on w."""
        for own in self.groups:
            own.slopes[:] = np.inf

    def take(self, interactions: Interactions, velocity: np.ndarray) -> None:
        """Take D, K and g at v_free + w H r, shape (num_slots * dim,)."""
        speed = interactions.largest(float(np.abs(velocity).max(initial=0.0)))
        least = _LEAST * max(speed, np.finfo(float).tiny)
        for g, own in zip(interactions.groups, self.groups, strict=True):
            m, tangents = g.kernels.components, _tangent_kernel(g.kernels, g.sides)
            room = (np.empty((m, m)), np.empty((m, m)), np.empty((m, 2 * m)))
            tangents(velocity, g.couplings, g.law_arrays(), least, own, room)
            if g.turning is not None:
                follow = _turn_kernel(g.sides)
                follow(g.couplings.frame, own.stiffness, own.frame, own.changed)

    def held(self, interactions: Interactions) -> float:
        """The share of the motion at points that springs hold."""
        pairs = zip(interactions.groups, self.groups, strict=True)
        held = sum(_held(own.slopes, g.compliance) for g, own in pairs)
        return interactions.total(held) / max(interactions.dim * interactions.num_points, 1)

    def spread_source(self, interactions: Interactions, total: np.ndarray) -> None:
        """total = H g, shape (num_slots * dim,)."""
        total[:] = 0.0
        for g, own in zip(interactions.groups, self.groups, strict=True):
            spread_kernel(g.sides)(total, g.couplings, own.source)

    def changes(self, interactions: Interactions, step: np.ndarray) -> list[np.ndarray]:
        """dr = g - K H^T dv of each group, for dv of shape (num_slots * dim,)."""
        for g, own in zip(interactions.groups, self.groups, strict=True):
            answer = _spring_kernels(g.sides)[1]
            answer(step, g.couplings, own.stiffness, own.source, own.change)
        return [own.change for own in self.groups]

    def saved(self, interactions: Interactions) -> dict[str, np.ndarray]:
        """D and K of the permanent points: they stay as they are where they change little.

        Returns:
            `slopes` and `stiffness`, shape (num_points, components, components) of the widest law;
            `frame`, shape (num_points, rows, dim), where points turn.
        """
        m = max((g.kernels.components for g in interactions.groups), default=0)
        arrays = {name: np.zeros((len(interactions), m, m)) for name in ("slopes", "stiffness")}
        if interactions.turns:
            rows = max((own.frame.shape[1] for own in self.groups), default=0)
            arrays["frame"] = np.zeros((len(interactions), rows, interactions.dim))
        for g, own in zip(interactions.groups, self.groups, strict=True):
            for name, array in arrays.items():
                held = getattr(own, name)
                array[g.indices, : held.shape[1], : held.shape[2]] = held
        return arrays

    def restore(self, interactions: Interactions, saved: Mapping[str, np.ndarray]) -> None:
        """Take what `saved` gave, for the same w."""
        for g, own in zip(interactions.groups, self.groups, strict=True):
            for name, array in saved.items():
                held = getattr(own, name)
                held[:] = array[g.indices, : held.shape[1], : held.shape[2]]


class _Portion(NamedTuple):
    """Consecutive clusters whose blocks stay in the cache while they are made."""

    clusters: tuple[int, int]  #: the first, and one after the last
    bodies: np.ndarray  #: which have nodes in them
    points: list[np.ndarray]  #: of each group, which act on them


def _portions(interactions: Interactions, clusters: Clusters) -> list[_Portion]:
    """The clusters of a scene, in portions of some `_IN_CACHE` entries of their blocks."""
    portion = np.unique(clusters.block_offsets[:-1] // _IN_CACHE, return_inverse=True)[1]
    ends = np.concatenate([[0], np.cumsum(np.bincount(portion))]).tolist()
    of_node = portion[clusters.cluster]

    def by_portion(which: np.ndarray, portions: np.ndarray) -> list[np.ndarray]:
        count = which.max(initial=0) + 1
        owner, which = np.divmod(np.unique(portions * count + which), count)
        return np.split(which, np.searchsorted(owner, np.arange(1, len(ends) - 1)))

    nodes = np.diff(interactions.inverse.node_offsets)
    bodies = by_portion(np.repeat(np.arange(len(nodes)), nodes), of_node)
    points = []
    for g in interactions.groups:
        touched = of_node[g.points.nodes]
        numbers = np.broadcast_to(np.arange(len(g))[:, None, None], touched.shape)
        points.append(by_portion(numbers, touched))
    return [
        _Portion(pair, bodies[a], [those[a] for those in points])
        for a, pair in enumerate(pairwise(ends))
    ]


class LinearisedProblem:
    """The linearised problem of a scene; what does not depend on the state is kept.

    Attributes:
        regular: whether w could be inverted on the degrees of freedom that are not prescribed; if
            not, there is nothing to solve with.
        tangents: D, K and g of the points.
        held: share of the motion at points that springs hold, at the last state linearised.
    """

    def __init__(self, interactions: Interactions):
        self._interactions = interactions
        self.held = 0.0
        inverse, dim = interactions.inverse, interactions.dim
        self._sizes = np.diff(inverse.node_offsets) * dim
        self._starts = inverse.node_offsets[:-1] * dim
        num_dofs = inverse.num_slots * dim
        rigid = interactions.bulk_inverse.num_nodes == 0
        self._small = num_dofs <= (_RIGID if rigid else DIRECT[dim])
        self._always = self._direct = rigid and self._small
        self._factors = None
        self._openings: list = []  # H^T of each group
        self._clusters, self._opened = facing_clusters(interactions)
        # blocks of points that turn are those of a moment before
        self._within = not interactions.turns and springs_within(
            interactions, self._clusters.cluster
        )
        self._blocks = np.empty(self._clusters.block_offsets[-1])
        self._portions = _portions(interactions, self._clusters)
        self._swaps = np.empty(np.diff(self._clusters.offsets).max() * dim, np.uintp)
        self._beside = np.empty((2, len(self._swaps)))
        self._couplings = _Couplings.of(self._clusters, self._sizes, dim)
        self.tangents = PointTangents(interactions)
        self._directions = np.empty((2, _KEPT + 1, num_dofs))
        self._basis = np.empty((_BASIS + 3, num_dofs))
        self._left, self._part = np.empty((2, num_dofs))
        self.renew()

    def _springs(self, group: PointGroup):
        return _spring_kernels(group.sides)

    def renew(self) -> None:
        """Take the present values of w."""
        inverse = self._interactions.inverse
        self._matrix, self._fixed, self.regular = inverted_bodies(inverse)
        self._held_dofs = np.flatnonzero(self._fixed)
        self._as_one = None
        if self.regular and not self._always:
            nodes = np.diff(inverse.node_offsets)
            _take_couplings(
                self._matrix, inverse.data_offsets, self._sizes, self._starts,
                np.repeat(np.arange(len(nodes)), nodes), self._clusters, self._couplings,
            )  # fmt: skip
        self.tangents.forget()
        self._fresh = True

    def begin(self) -> None:
        """Take H of now, as points may have turned; without factors if the bodies are not rigid."""
        self._openings = []
        if self._direct and not self._always:
            self._direct, self._fresh = False, True

    def linearise(self, velocity: np.ndarray) -> None:
        """Take D, K and g at a state; clusters whose springs are others are inverted again.

        Args:
            velocity: shape (num_slots * dim,), v_free + w H r.
        """
        interactions, tangents = self._interactions, self.tangents
        clusters = self._clusters
        tangents.take(interactions, velocity)
        marked = np.zeros(len(clusters.offsets) - 1, np.bool_)
        groups = list(zip(interactions.groups, tangents.groups, strict=True))
        for g, own in groups:
            self._springs(g)[2](g.couplings, own.changed, clusters.cluster, marked)
        if self._direct:
            if self._fresh or marked.any():
                self._factor()
            return
        if self._fresh:
            marked[:] = True
        self._renew_blocks(marked)
        self.held = tangents.held(interactions)

    def take_springs(self) -> None:
        """Take K as `tangents` have it; `linearise` then makes all of it anew."""
        for g, own in zip(self._interactions.groups, self.tangents.groups, strict=True):
            if g.turning is not None:
                own.frame[:] = g.couplings.frame
        if self._direct:
            self._factor()
        else:
            self._renew_blocks(np.ones(len(self._clusters.offsets) - 1, np.bool_))
        self.held = 0.0
        self.tangents.forget()

    def _renew_blocks(self, marked: np.ndarray) -> None:
        """Invert the blocks of marked clusters."""
        interactions, clusters, dim = self._interactions, self._clusters, self._interactions.dim
        groups = list(zip(interactions.groups, self.tangents.groups, strict=True))
        blocks, world = self._blocks, np.empty((dim, dim))
        here = np.zeros_like(marked)
        self.solvable = True
        for portion, bodies, points in self._portions:
            own_clusters = slice(*portion)
            if not marked[own_clusters].any():
                continue
            here[own_clusters] = marked[own_clusters]
            _clear(portion, clusters, here, blocks)
            _add_bodies(
                self._matrix, interactions.inverse.data_offsets, self._sizes, self._starts, bodies,
                clusters, here, blocks, dim,
            )  # fmt: skip
            for (g, own), those in zip(groups, points, strict=True):
                self._springs(g)[3](
                    g.couplings, own.frame, own.stiffness, those, clusters, here, blocks, world
                )
            if not _invert_clusters(
                portion, clusters, here, blocks, self._fixed, dim, self._swaps, self._beside[0]
            ):
                self.solvable = False
                break
            here[own_clusters] = False
        self._fresh = not self.solvable

    def _factor(self) -> None:
        """Factor w^-1 + H K H^T, with ones for what is prescribed."""
        count = len(self._fixed)
        if not self._openings:
            self._openings = [opening_matrix(g, count) for g in self._interactions.groups]
        rows, columns = self._interactions.inverse.rows_and_columns()
        kept = self._matrix != 0.0
        matrix = coo_array(
            (self._matrix[kept], (rows[kept], columns[kept])), shape=(count, count)
        ).tocsc()
        for openings, own in zip(self._openings, self.tangents.groups, strict=True):
            n, size = len(own.stiffness), own.source.size
            springs = bsr_array((own.stiffness, np.arange(n), np.arange(n + 1)), shape=(size, size))
            matrix += openings.T @ (springs @ openings)
        free = np.where(self._fixed, 0.0, 1.0)
        matrix = (matrix * free).tocsc() * free[:, None] + diags_array(1.0 - free)
        try:
            self._factors = splu(
                matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.1,
                options={"SymmetricMode": True},
            )  # fmt: skip
        except RuntimeError:  # singular
            self._factors = None
        self.solvable = self._factors is not None
        self._fresh = not self.solvable

    def solve(self, step: np.ndarray, bound: float, max_iterations: int):
        """The step of the impulses that the linearised laws ask for.

        Args:
            step: shape (num_slots * dim,), dv (m/s): a first guess, improved in place.
            bound: norm of the momentum that may be left over (N s).
            max_iterations: products with the matrix after which to stop.

        Returns:
            dr of each group (arrays of this object, overwritten next time), and iterations.
        """
        iterations, left, correction = 0, self._left, self._basis[0]
        for _ in range(_REFINEMENTS + 1):
            self._source(left)
            self._apply(step, self._part)
            left -= self._part
            if norm(left) <= bound or iterations >= max_iterations:
                break
            # taken whole, it leaves nothing of stiff springs, beside which soft ones do not count
            self._precondition(left, correction, self._part)
            step += correction
            left -= self._part
            more, _ = gmres(
                self._precondition, left, step, bound, max_iterations - iterations, self._basis
            )
            iterations += more
        self.heed(iterations)
        return self.tangents.changes(self._interactions, step), iterations

    def heed(self, iterations: int) -> None:
        """Factor the matrix from now on if that many iterations are too many, and it is small."""
        if self._small and iterations >= MANY:
            self._direct = self._fresh = True

    def improve(self, left: np.ndarray, step: np.ndarray, bound: float, max_iterations: int) -> int:
        """Improve a solution of (w^-1 + H K H^T) dv = f, for the springs of an interior point.

        Args:
            left: shape (num_slots * dim,), f - (w^-1 + H K H^T) dv, zero where nothing moves; what
                is left of it on return.
            step: shape (num_slots * dim,), dv.
            bound, max_iterations: as of `solve`.

        Returns:
            Iterations.
        """
        iterations, size = orthomin(
            self._precondition, left, step, bound, max_iterations, self._directions
        )
        if size > bound:
            more, _ = gmres(
                self._precondition, left, step, bound, max_iterations - iterations, self._basis
            )
            iterations += more
        return iterations

    def _source(self, total: np.ndarray) -> None:
        """total = H g."""
        self.tangents.spread_source(self._interactions, total)
        self.hold(total)

    def hold(self, x: np.ndarray) -> None:
        """Set x, shape (num_slots * dim,), to zero where nothing moves."""
        _hold(self._held_dofs, x)

    def momentum(self, x: np.ndarray, y: np.ndarray) -> None:
        """y = w^-1 x, both of shape (num_slots * dim,)."""
        inverse = self._interactions.inverse
        _body_product(inverse.uniform_size)(
            self._matrix, inverse.data_offsets, self._sizes, self._starts, x, y
        )

    def _apply(self, x: np.ndarray, y: np.ndarray) -> None:
        """y = (w^-1 + H K H^T) x."""
        self.momentum(x, y)
        for g, own in zip(self._interactions.groups, self.tangents.groups, strict=True):
            self._springs(g)[0](x, g.couplings, own.stiffness, y)
        self.hold(y)

    def _first(self, r: np.ndarray, z: np.ndarray, y: np.ndarray) -> bool:
        """z = B r by the first correction alone; whether y is (w^-1 + H K H^T) z."""
        if self._direct:
            z[:] = self._factors.solve(r)
            return False
        _cluster_sweep(self._interactions.dim)(
            self._clusters, self._couplings, self._blocks, r, z, y, self._beside
        )  # fmt: skip
        return self._within

    def _precondition(self, r: np.ndarray, z: np.ndarray, y: np.ndarray) -> None:
        known = self._first(r, z, y)
        if not self._direct and self.held > MOSTLY:
            if self._as_one is None:
                inverse, fixed = self._interactions.inverse, self._fixed
                self._as_one = ClustersAsOne(
                    self._clusters, self._opened, fixed, inverse, self._matrix
                )
            known = not self._as_one.add_correction(r, z) and known
        if not known:
            self._apply(z, y)


@_KERNEL
def _hold(held, x):
    for i in held:
        x[i] = 0.0


@_KERNEL
def _held(slopes, compliance):
    """Sum of the traces of -D W_aa: of a point all components if it sticks, 0 if it is open."""
    total, components = 0.0, slopes.shape[1]
    for i in range(len(slopes)):
        entry = 0
        for x in range(components):
            for y in range(x, components):
                twice = slopes[i, x, y] + (slopes[i, y, x] if x != y else 0.0)
                total -= twice * compliance[i, entry]
                entry += 1
    return total
