# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear Gauss-Seidel sweeps through the body velocities, W never formed.

Visiting point i reads its relative velocity u = H_i^T v from the bodies, lets the law give the
new impulse, and adds w H_i dr to the velocities of its two bodies: for small bodies this moves
less memory than the stored rows of W.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numba import config, prange, types
from numba.core.cgutils import ir
from numba.extending import intrinsic

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import for_dimension
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER, MERGED
from xper_fx.nscd.laws.law import LawKernels
from xper_fx.nscd.points import InteractionPoints


class Sides(NamedTuple):
    """What kernels over the points of a group are compiled for."""

    dim: int
    components: int  #: of local vectors
    k: int  #: nodes on a side
    lever_arms: bool = False  #: whether there are sides on rigid bodies
    branches: bool = False  #: whether points read a periodic cell that deforms


class Blocks(NamedTuple):
    """What is known of the blocks of w when kernels are compiled."""

    size: int = 0  #: their common size in dofs, or 0
    #: whether all blocks of the scene have it: block b then starts at b times the size
    aligned: bool = False


ANY_BLOCKS = Blocks()


class Couplings(NamedTuple):
    """Where a point reads and writes, as the sweep kernels want it."""

    start: np.ndarray  #: shape (num_points, 2, k), first dof of each node
    weights: np.ndarray  #: shape (num_points, 2, k)
    body: np.ndarray  #: shape (num_points, 2), first dof of each side's block
    size: np.ndarray  #: shape (num_points, 2), dofs in each side's block
    rows: np.ndarray  #: shape (num_points, 2, k), entry of `w` where the node's first row starts
    frame: np.ndarray  #: shape (num_points, 1, dim), the normal, or (num_points, 3, 3)
    w: np.ndarray  #: flat blocks of the inverse
    #: shape (num_points, 2), first dof of a rigid side's rotation, else `start` of its first node;
    #: None without lever arms
    rotation_dof: np.ndarray | None = None
    #: shape (num_points, 2, dim) (m), zero where a side is not rigid; None without lever arms
    lever_arms: np.ndarray | None = None
    #: shape (num_points, dim) (m), None without a periodic cell that deforms
    branches: np.ndarray | None = None
    cell: np.int64 | None = None  #: first dof of dFbar/dt, column after column
    cell_w: np.ndarray | None = None  #: w of these dofs, shape (dim^2,); they have no others


def couple(points: InteractionPoints, inverse: BodyInverse) -> Couplings:
    """Resolve nodes to positions in the velocity array and in the blocks of w."""
    dim = inverse.dim
    # The ground's slots all belong to the last block.
    block = inverse.block_of_node[points.nodes]
    first = inverse.node_offsets[block[:, :, 0]]
    body, size = first * dim, (inverse.node_offsets[block[:, :, 0] + 1] - first) * dim
    start = points.nodes.astype(np.int64) * dim
    rows = inverse.data_offsets[block] + (start - body[..., None]) * size[..., None]
    small = np.int32 if max(len(inverse.data), inverse.num_slots * dim) < 2**31 else np.int64
    start, body, size, rows = (a.astype(small) for a in (start, body, size, rows))
    turn = None if points.lever_arms is None else np.empty(0, small)
    couplings = Couplings(start, points.weights, body, size, rows, points.frame, inverse.data, turn)
    if points.branches is not None:
        couplings = couplings._replace(**find_cell(points.branches.node, inverse))
    return couple_again(couplings, points)


def find_cell(node: int, inverse: BodyInverse) -> dict:
    """Where the dofs of a cell that deforms are, and their w, the diagonal of its blocks."""
    dim, n = inverse.dim, inverse.uniform_size
    diagonal = np.einsum("bii->bi", inverse.data.reshape(-1, n, n)).ravel()
    first = np.int64(node * dim)
    return {"cell": first, "cell_w": diagonal[first : first + dim * dim].copy()}


def couple_nodes(nodes: np.ndarray, inverse: BodyInverse) -> Couplings:
    """Couplings of points with one node a side, each of which has a block of w.

    Args:
        nodes: shape (num_points, 2, 1).
        inverse: one block a node.

    Returns:
        Those between the nodes, whose weights and frames are none yet (`couple_again`).
    """
    dim = inverse.dim
    small = np.int32 if len(inverse.data) < 2**31 else np.int64
    start = (nodes * dim).astype(small)
    size = np.full(start.shape[:2], dim, small)
    none = np.zeros((0, 2, 1)), np.zeros((0, 1, dim))
    rows = (nodes.astype(np.int64) * dim * dim).astype(small)
    return Couplings(start, none[0], start[:, :, 0].copy(), size, rows, none[1], inverse.data)


def couple_again(couplings: Couplings, points: InteractionPoints) -> Couplings:
    """The couplings of points between the same nodes, which have moved."""
    # In 2D the normal alone tells the frame.
    frame = points.frame[:, :1] if points.frame.shape[1] == 2 else points.frame
    turn = couplings.rotation_dof
    if turn is not None:
        turn = (points.rotation_nodes().astype(np.int64) * points.dim).astype(turn.dtype)
    return couplings._replace(
        weights=points.weights,
        frame=np.ascontiguousarray(frame),
        rotation_dof=turn,
        lever_arms=points.lever_arms,
        branches=None if points.branches is None else points.branches.vectors,
    )


# Largest block whose rows are added as one vector each.
_VECTOR_DOFS = 16
# Doubles in a cache line, and how many visits ahead lines are asked for.
LINE, _AHEAD = np.uintp(8), np.uintp(8)


@cache
def _add_rows(count: int, size: int):
    """Kernel `add(v, base, w, row, f)`: v[base:base + size] += sum_d f[d] w[row + d size:...].

    With d below `count`, the number of f's components.

    As vector instructions, which the compiler does not find by itself in loops this short (it has
    to allow for `v` and `w` being the same memory): a third of a visit's time.
    """

    @intrinsic
    def add(context, v, base, w, row, f):
        def generate(context, builder, signature, arguments):
            vector = ir.VectorType(ir.DoubleType(), size)

            def entry(array_type, array, index):
                data = context.make_array(array_type)(context, builder, array).data
                return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())

            v, base, w, row, f = arguments
            v_type, _, w_type, row_type, _ = signature.args
            target = entry(v_type, v, base)
            total = None
            for d in range(count):
                index = builder.add(row, context.get_constant(row_type, d * size))
                line = builder.load(entry(w_type, w, index), align=8)
                single = ir.Constant(ir.VectorType(ir.IntType(32), size), [0] * size)
                undefined = ir.Constant(vector, ir.Undefined)
                factor = builder.insert_element(
                    undefined, builder.extract_value(f, d), ir.Constant(ir.IntType(32), 0)
                )
                factor = builder.shuffle_vector(factor, undefined, single)
                product = builder.fmul(factor, line, flags=("contract",))
                total = product if d == 0 else builder.fadd(total, product, flags=("contract",))
            # Rounded before it is added: an impulse and its opposite then nearly always cancel.
            before = builder.load(target, align=8)
            builder.store(builder.fadd(before, total), target, align=8)
            return context.get_dummy_value()

        return types.none(v, base, w, row, f), generate

    return add


@cache
def point_velocity(sides: Sides):
    """Kernel `read(v, c, i) -> u` of the local relative velocity of a point."""
    dim, components, k, lever_arms, branches = sides
    world = for_dimension(dim)
    to_local = for_dimension(dim, components).to_local
    add, subtract = world.add, world.subtract
    turned = lever_arm_kernels(dim)[0] if lever_arms else None
    stretched = stretching_kernel(dim) if branches else None

    @njit(inline="always")
    def side(v, c, i, s):
        if dim == 2:
            p = np.uintp(c.start[i, s, 0])
            if k == 1:
                return v[p], v[p + np.uintp(1)]
            x, y = 0.0, 0.0
            for j in range(k):
                p, weight = c.start[i, s, j], c.weights[i, s, j]
                x += weight * v[p]
                y += weight * v[p + 1]
            return x, y
        p = c.start[i, s, 0]
        if k == 1:
            return v[p], v[p + 1], v[p + 2]
        x, y, z = 0.0, 0.0, 0.0
        for j in range(k):
            p, weight = c.start[i, s, j], c.weights[i, s, j]
            x += weight * v[p]
            y += weight * v[p + 1]
            z += weight * v[p + 2]
        return x, y, z

    @njit(**MERGED)
    def read(v, c, i):
        if lever_arms:
            candidate = add(side(v, c, i, 0), turned(v, c, i, 0))
            antagonist = add(side(v, c, i, 1), turned(v, c, i, 1))
            apart = subtract(candidate, antagonist)
            if branches:
                apart = add(apart, stretched(v, c, i))
            return to_local(c.frame, i, apart)
        return to_local(c.frame, i, subtract(side(v, c, i, 0), side(v, c, i, 1)))

    return read


@cache
def point_impulse(sides: Sides, blocks: Blocks):
    """Kernel `push(v, c, i, r)`: v += w H r for the local impulse of a point.

    Called with i unsigned, as a sweep does (an index that may be negative is checked): another type
    of i is another version.
    """
    dim, components, k, lever_arms, branches = sides
    size = blocks.size
    to_global, times = for_dimension(dim, components).to_global, for_dimension(dim).scale
    vector = 0 < size <= _VECTOR_DOFS and not config.DISABLE_JIT
    moment = lever_arm_kernels(dim)[2] if lever_arms else None
    turns = dim if dim == 3 else 1  # components of a rotation
    add_rows = _add_rows(dim, size) if vector else None
    add_turns = _add_rows(turns, size) if vector else None

    @njit(**MERGED)
    def push(v, c, i, impulse):
        f = to_global(c.frame, i, impulse)
        sign = 1.0
        for s in range(2):
            if blocks.aligned:
                n = np.uintp(size)
                base = np.uintp(c.start[i, s, 0]) // n * n
            else:
                n = np.uintp(size) if size > 0 else np.uintp(c.size[i, s])
                base = np.uintp(c.body[i, s])
            for j in range(k):
                scale = sign if k == 1 else sign * c.weights[i, s, j]
                # blocks of one size: row d of w starts at d times the size
                if blocks.aligned:
                    row = np.uintp(c.start[i, s, j]) * n
                else:
                    row = np.uintp(c.rows[i, s, j])
                if vector:
                    add_rows(v, base, c.w, row, times(scale, f))
                elif dim == 2:
                    f0, f1 = scale * f[0], scale * f[1]
                    for m in range(n):
                        v[base + m] += c.w[row + m] * f0 + c.w[row + n + m] * f1
                else:
                    f0, f1, f2 = scale * f[0], scale * f[1], scale * f[2]
                    for m in range(n):
                        v[base + m] += (
                            c.w[row + m] * f0 + c.w[row + n + m] * f1 + c.w[row + n + n + m] * f2
                        )
            if lever_arms and c.rotation_dof[i, s] != c.start[i, s, 0]:
                # only a rigid side, of one node, has a rotation
                row = np.uintp(c.rows[i, s, 0]) + np.uintp(dim) * n
                g = moment(c, i, s, times(sign, f))
                if vector:
                    add_turns(v, base, c.w, row, g)
                else:
                    for d in range(turns):
                        for m in range(n):
                            v[base + m] += c.w[row + np.uintp(d) * n + m] * g[d]
            sign = -1.0
        if branches:
            for j in range(dim):
                for d in range(dim):
                    at = j * dim + d
                    v[c.cell + at] += c.cell_w[at] * c.branches[i, j] * f[d]

    return push


@cache
def stretching_kernel(dim: int):
    """Kernel `stretched(v, c, i) -> dFbar/dt b` of a point's branch b."""
    world = for_dimension(dim)

    @njit(inline="always")
    def column(v, c, j):
        at = c.cell + j * dim
        if dim == 2:
            return v[at], v[at + 1]
        return v[at], v[at + 1], v[at + 2]

    @njit(inline="always")
    def stretched(v, c, i):
        total = world.scale(c.branches[i, 0], column(v, c, 0))
        for j in range(1, dim):
            total = world.add(total, world.scale(c.branches[i, j], column(v, c, j)))
        return total

    return stretched


if config.DISABLE_JIT:

    def prefetch(array, index):
        """Nothing: no cache is waited for where the Python source runs."""

else:

    @intrinsic
    def prefetch(context, array, index):
        """Let the cache line of an entry of an array come from memory meanwhile."""

        def generate(context, builder, signature, arguments):
            data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
            kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
            prefetch = builder.module.declare_intrinsic("llvm.prefetch", (byte,), kind)
            line = builder.bitcast(builder.gep(data, [arguments[1]]), byte)
            # data, to be read, to be kept in all caches
            builder.call(prefetch, [line, word(0), word(3), word(1)])
            return context.get_dummy_value()

        return types.none(array, index), generate


@cache
def fetch_kernel(sides: Sides, blocks: Blocks):
    """Kernel `fetch(v, c, i)`: what a visit of point i will want of v and w begins to come.

    Points lie in memory in the order of their visits, so that the processor sees what comes next;
    velocities and blocks of w lie in the order of the bodies. Blocks that take many lines come
    by themselves after the first.
    """
    count = sides.dim * blocks.size  # entries of w that a node's impulse meets
    if not 0 < blocks.size <= _VECTOR_DOFS:

        @njit(inline="always")
        def fetch(v, c, i):
            pass

        return fetch

    offsets = tuple(map(np.uintp, (*range(0, count - 1, LINE), count - 1)))
    size, k = np.uintp(blocks.size), sides.k

    @njit(inline="always")
    def fetch(v, c, i):
        for s in range(2):
            for j in range(k):
                start = np.uintp(c.start[i, s, j])
                row = start * size if blocks.aligned else np.uintp(c.rows[i, s, j])
                for offset in offsets:
                    prefetch(c.w, row + offset)
                prefetch(v, start)

    return fetch


@cache
def lever_arm_kernels(dim: int):
    """Kernels of a side's arm a, omega in 2D having one component.

    `turned(v, c, i, s) -> omega x a`, `turned_unit(c, i, s, x)`, the same for the unit rotation x,
    `moment(c, i, s, f) -> a x f`.
    """
    if dim == 2:

        @njit(inline="always")
        def turned(v, c, i, s):
            omega = v[c.rotation_dof[i, s]]
            return -omega * c.lever_arms[i, s, 1], omega * c.lever_arms[i, s, 0]

        @njit(inline="always")
        def turned_unit(c, i, s, x):
            return -c.lever_arms[i, s, 1], c.lever_arms[i, s, 0]

        @njit(inline="always")
        def moment(c, i, s, f):
            return (c.lever_arms[i, s, 0] * f[1] - c.lever_arms[i, s, 1] * f[0],)

    else:

        @njit(inline="always")
        def turned(v, c, i, s):
            p = c.rotation_dof[i, s]
            a, b, d = c.lever_arms[i, s, 0], c.lever_arms[i, s, 1], c.lever_arms[i, s, 2]
            x, y, z = v[p], v[p + 1], v[p + 2]
            return y * d - z * b, z * a - x * d, x * b - y * a

        @njit(inline="always")
        def turned_unit(c, i, s, x):
            a, b, d = c.lever_arms[i, s, 0], c.lever_arms[i, s, 1], c.lever_arms[i, s, 2]
            if x == 0:
                return 0.0, -d, b
            if x == 1:
                return d, 0.0, -a
            return -b, a, 0.0

        @njit(inline="always")
        def moment(c, i, s, f):
            a, b, d = c.lever_arms[i, s, 0], c.lever_arms[i, s, 1], c.lever_arms[i, s, 2]
            return b * f[2] - d * f[1], d * f[0] - a * f[2], a * f[1] - b * f[0]

    return turned, turned_unit, moment


@cache
def push_kernel(sides: Sides, blocks: Blocks):
    """Kernel `push_all(v, couplings, impulses)`: v += w H r over all points of a group."""
    row = for_dimension(sides.dim, sides.components).row
    push = point_impulse(sides, blocks)

    @njit(**LEAN_ENTRY)
    def push_all(v, c, r):
        for number in range(len(r)):
            i = np.uintp(number)
            push(v, c, i, row(r, i))

    return push_all


@cache
def point_force(sides: Sides):
    """Kernel `give(p, couplings, i, f)`: p += H f for the force f, in global axes, of a point."""
    dim, _, k, lever_arms, branches = sides
    moment = lever_arm_kernels(dim)[2] if lever_arms else None
    times = for_dimension(dim).scale
    turns = dim if dim == 3 else 1

    @njit(inline="always")
    def give(p, c, i, f):
        for j in range(k):
            candidate, antagonist = np.uintp(c.start[i, 0, j]), np.uintp(c.start[i, 1, j])
            for d in range(dim):
                if k == 1:
                    p[candidate + np.uintp(d)] += f[d]
                    p[antagonist + np.uintp(d)] -= f[d]
                else:
                    p[candidate + np.uintp(d)] += c.weights[i, 0, j] * f[d]
                    p[antagonist + np.uintp(d)] -= c.weights[i, 1, j] * f[d]
        if lever_arms:
            sign = 1.0
            for s in range(2):
                g = moment(c, i, s, times(sign, f))
                for d in range(turns):
                    p[c.rotation_dof[i, s] + d] += g[d]  # nothing where the side is not rigid
                sign = -1.0
        if branches:
            for j in range(dim):
                for d in range(dim):
                    p[c.cell + j * dim + d] += c.branches[i, j] * f[d]

    return give


@cache
def spread_kernel(sides: Sides):
    """Kernel `spread(p, couplings, impulses)`: p += H r over all points of a group."""
    algebra = for_dimension(sides.dim, sides.components)
    row, to_global = algebra.row, algebra.to_global
    give = point_force(sides)

    @njit(**LEAN_ENTRY)
    def spread(p, c, r):
        for i in range(len(r)):
            give(p, c, i, to_global(c.frame, i, row(r, i)))

    return spread


@cache
def sweep_kernel(
    law: LawKernels, sides: Sides, blocks: Blocks, parallel: bool, as_velocities: bool = False
):
    """One sweep over the tiles of a law's points that are marked.

    Kernel `sweep(tiles, colors, marked, stats, v, couplings, r, ...)`; it writes, for each tile
    visited, [sum |dr|^2, sum |r|^2, max |dr|^2 / area^2] into its row of `stats`. Taken as
    velocities, changes count as sum dr . W_aa dr.
    """
    algebra = for_dimension(sides.dim, sides.components)
    row, set_row, dot = algebra.row, algebra.set_row, algebra.dot
    sym_row, sym_vector = algebra.sym_row, algebra.sym_vector
    add, scale, subtract = algebra.add, algebra.scale, algebra.subtract
    read, push = point_velocity(sides), point_impulse(sides, blocks)
    fetch = fetch_kernel(sides, blocks)
    solve = law.solve

    # Without reference counting (nothing is allocated here): the counts of the law's arrays, atomic
    # and not pruned across its branches, would cost more than the visit itself.
    @njit(fastmath={"contract"}, **LEAN_INNER)
    def visit_tile(
        tile, tiles, stats, v, c, r, w_points, inverse_area, parameters, terms, details, relax
    ):
        changed, total, largest = 0.0, 0.0, 0.0
        last = np.uintp(len(r) - 1)
        for number in range(tiles[tile], tiles[tile + 1]):
            i = np.uintp(number)  # a signed index would be checked for being negative
            fetch(v, c, min(i + _AHEAD, last))
            old = row(r, i)
            new, smooth = solve(i, read(v, c, i), old, w_points, parameters, terms, details)
            change = subtract(new, old)
            size_of_change = dot(change, change)
            if size_of_change == 0.0:
                total += dot(new, new)
                continue
            if smooth:
                change = scale(relax, change)
                new = add(old, change)
            set_row(r, i, new)
            push(v, c, i, change)
            if as_velocities:
                changed += dot(change, sym_vector(sym_row(w_points, i), change))
            else:
                changed += size_of_change
            total += dot(new, new)
            largest = max(largest, size_of_change * inverse_area[i] * inverse_area[i])
        stats[tile, 0], stats[tile, 1], stats[tile, 2] = changed, total, largest

    if not parallel:

        @njit(**LEAN_INNER)
        def sweep(
            tiles, colors, marked, stats, v, c, r, w_points, inverse_area, parameters, terms,
            details, relax,
        ):  # fmt: skip
            for tile in range(len(marked)):
                if marked[tile]:
                    visit_tile(
                        tile, tiles, stats, v, c, r, w_points, inverse_area, parameters, terms,
                        details, relax,
                    )  # fmt: skip

        return sweep

    # threads are handed arrays that count references, whatever the caller is compiled with
    @njit(parallel=True, nogil=True, error_model="numpy", _nrt=True)
    def sweep(
        tiles, colors, marked, stats, v, c, r, w_points, inverse_area, parameters, terms, details,
        relax,
    ):  # fmt: skip
        for color in range(len(colors) - 1):
            for tile in prange(colors[color], colors[color + 1]):
                if marked[tile]:
                    visit_tile(
                        tile, tiles, stats, v, c, r, w_points, inverse_area, parameters, terms,
                        details, relax,
                    )  # fmt: skip

    return sweep
