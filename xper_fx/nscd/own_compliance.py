# SPDX-License-Identifier: LGPL-3.0-or-later
"""W_aa: what a unit impulse at a point does to its own relative velocity."""

from __future__ import annotations

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.algebra.small import SINGULAR, sym_indices
from xper_fx.nscd.inverse_blocks import BodyInverse
from xper_fx.nscd.kernel_options import LEAN_ENTRY
from xper_fx.nscd.point_group import PointGroup

# Compliance of a point beside that of the loosest of its nodes, at which it is held: where those
# that can move have a share of 1e-4 of it, their impulses would be 1e4 times what holds them.
_HELD = 1e-8


def update_compliance(group: PointGroup, inverse: BodyInverse) -> None:
    """Take the values of w; the compliances of a group's points follow."""
    group.show_frames()
    rows, cols = sym_indices(group.kernels.components)
    group.couplings = group.couplings._replace(w=inverse.data)
    if inverse.diagonal:
        nodal = inverse.data.reshape(-1, inverse.dim)[group.points.nodes]
        w = np.einsum("psk,pskd->pd", group.points.weights**2, nodal)
        frame = group.points.frame
        w[w.sum(axis=1) <= _HELD * nodal.max(axis=(1, 2, 3))] = 0.0
        group.compliance[:] = np.einsum("ped,pd,ped->pe", frame[:, rows], w, frame[:, cols])
        return
    arguments = group.couplings, group.points.frame, rows, cols, group.compliance
    if not group.sides.lever_arms:
        _compliance(*arguments)
        return
    dim, components, k, _, branches = group.sides
    columns = k * dim + (dim if dim == 3 else 1)
    h, at = np.empty((components, columns)), np.empty(columns, np.int64)
    _compliance_with_lever_arms(*arguments, h, at)
    if branches:
        c, frame = group.couplings, group.points.frame
        w = c.branches**2 @ c.cell_w.reshape(dim, dim)
        group.compliance += np.einsum("ped,pd,ped->pe", frame[:, rows], w, frame[:, cols])


def diagonals(group: PointGroup, which: np.ndarray) -> np.ndarray:
    """Of some points, where w is diagonal, what unit impulses along the axes of space do to them.

    Returns:
        Shape (len(which), dim), 1/kg.
    """
    out = np.zeros((len(which), group.points.dim))
    _add_diagonals(which, group.couplings, out)
    return out


def update_diagonal(group: PointGroup, which: np.ndarray, diagonal: np.ndarray) -> None:
    """Renew the compliances of some points, whose frames have turned, with their `diagonals`."""
    rows, cols = sym_indices(group.kernels.components)
    _turn_diagonals(which, diagonal, group.couplings.frame, rows, cols, group.compliance)


@njit(**LEAN_ENTRY)
def _add_diagonals(which, c, out):
    k, dim = c.start.shape[2], out.shape[1]
    for number in range(len(which)):
        i = which[number]
        for s in range(2):
            for j in range(k):
                first = c.rows[i, s, j] + c.start[i, s, j] - c.body[i, s]
                for d in range(dim):
                    out[number, d] += c.weights[i, s, j] ** 2 * c.w[first + d * (c.size[i, s] + 1)]


@njit(inline="always")
def _direction(frame, i, x, d):
    """Component d of direction x; in 2D the tangent, which is not held, is n turned by +90."""
    if x < frame.shape[1]:
        return frame[i, x, d]
    return frame[i, 0, 0] if d == 1 else -frame[i, 0, 1]


@njit(**LEAN_ENTRY)
def _turn_diagonals(which, diagonal, frame, rows, cols, out):
    for number in range(len(which)):
        i = which[number]
        for entry in range(len(rows)):
            total = 0.0
            for d in range(diagonal.shape[1]):
                own = _direction(frame, i, rows[entry], d) * _direction(frame, i, cols[entry], d)
                total += diagonal[number, d] * own
            out[i, entry] = total


@njit(**LEAN_ENTRY)
def _compliance_with_lever_arms(c, frame, rows, cols, out, h, at):
    """As `_compliance`, of points with lever arms: H_s of a component is written out for its body.

    `h`, shape (components, n), and `at`, shape (n,), have room for the n columns of one side.
    """
    k, dim = c.start.shape[2], frame.shape[2]
    components = frame.shape[1]
    turns = dim if dim == 3 else 1
    count = k * dim + turns
    for i in range(len(out)):
        for entry in range(len(rows)):
            out[i, entry] = 0.0
        for s in range(2):
            base, n = c.body[i, s], c.size[i, s]
            first = c.rows[i, s, 0] - (c.start[i, s, 0] - base) * n
            for j in range(k):
                for d in range(dim):
                    at[j * dim + d] = c.start[i, s, j] - base + d
                    for x in range(components):
                        h[x, j * dim + d] = c.weights[i, s, j] * frame[i, x, d]
            rigid = c.rotation_dof[i, s] != c.start[i, s, 0]
            for d in range(turns):
                at[k * dim + d] = c.rotation_dof[i, s] - base + d if rigid else 0
                for x in range(components):
                    e, g = (0, 1) if dim == 2 else ((d + 1) % 3, (d + 2) % 3)
                    h[x, k * dim + d] = (
                        c.lever_arms[i, s, e] * frame[i, x, g]
                        - c.lever_arms[i, s, g] * frame[i, x, e]
                    )
            for entry in range(len(rows)):
                total = 0.0
                for a in range(count):
                    for b in range(count):
                        total += (
                            h[rows[entry], a] * c.w[first + at[a] * n + at[b]] * h[cols[entry], b]
                        )
                out[i, entry] += total


@njit(**LEAN_ENTRY)
def _compliance(c, frame, rows, cols, out):
    """W_aa = H_c^T w H_c + H_a^T w H_a at each point, packed symmetric.

    Where the normal stands alone, zero if it is rounding beside the trace over all directions; so
    is all of it where next to nothing of a point is on nodes that can move.
    """
    k, dim = c.start.shape[2], frame.shape[2]
    for i in range(len(out)):
        trace = loosest = 0.0
        for s in range(2):
            for a in range(k):
                column = c.start[i, s, a] - c.body[i, s]
                for x in range(dim):
                    own = c.w[c.rows[i, s, a] + x * c.size[i, s] + column + x]
                    loosest = max(loosest, own)
        for entry in range(len(rows)):
            total = 0.0
            for s in range(2):
                base, n = c.body[i, s], c.size[i, s]
                for a in range(k):
                    for b in range(k):
                        weight = c.weights[i, s, a] * c.weights[i, s, b]
                        column = c.start[i, s, b] - base
                        for x in range(dim):
                            trace += weight * c.w[c.rows[i, s, a] + x * n + column + x]
                        for x in range(dim):
                            fx = weight * frame[i, rows[entry], x]
                            for y in range(dim):
                                total += (
                                    fx
                                    * c.w[c.rows[i, s, a] + x * n + column + y]
                                    * frame[i, cols[entry], y]
                                )
            out[i, entry] = total
        if len(rows) == 1 and out[i, 0] <= SINGULAR * trace:
            out[i, 0] = 0.0
        if trace <= _HELD * loosest:
            for entry in range(len(rows)):
                out[i, entry] = 0.0
