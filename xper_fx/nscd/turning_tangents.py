# SPDX-License-Identifier: LGPL-3.0-or-later
r"""How forces of points whose frames turn change with the bodies: for Newton's method.

The impulses r of a point act on what its jump is made of (`turning_frames.py`), d and the tangents
a_alpha of the middle of both lips, all of q_m, which are linear in the displacements:

    y = (d, l a_1 (, l a_2)) = Q q,   U(y) = F(a) d,   p = Q^T W^T r,   W = dU/dy:

forces F^T r on the lips and those of their couple together. l is the size of the facet. A bond's
impulse hangs on (1 - theta) U0 + theta U1, which is U(y) where a point is of the first kind and
where theta = 1. So springs K of a law, dr = g - K du, come with du = W Q dv and

    dp = Q^T [W^T dr + h theta^2 M Q dv],   M = sum_i r_i d^2 U_i / dy^2,

as dq_m = h theta^2 dv of the velocities at the end of the step; the matrix is symmetric where K is.
With theta < 1 points of the second kind have more terms, which are smaller by the turn of a step
and left out.

With the spin domega = sum_alpha Omega_alpha da_alpha of the frame, Omega_alpha =
n (x) c_alpha - b_alpha (x) n (2D: b), f = F^T r, m = f x d, and e_i the rows of F,

    dU_i = e_i . dd + (e_i x d) . domega,        df = domega x f,
    p_alpha = Omega_alpha^T m = c_alpha (n . m) - n (b_alpha . m),
    dm = f (domega . d) - domega (f . d) + f x dd,
    dn = domega x n,   dc_alpha = domega x c_alpha - c_alpha sum_beta (t_beta . da_beta) / tau,
    db_1 = da_2 / A - b_1 dA / A,   db_2 = -da_1 / A - b_2 dA / A,   A = |a_1 x a_2|,
    dA / A = sum_beta (b_beta x n) . da_beta,   tau = t_1 . a_1 + t_2 . a_2,

where t_1 . a_2 = t_2 . a_1 leaves no spin in dtau. In 2D, with phi the angle of a, dphi = b . da,

    dU = F dd + (U_t, -U_n) dphi,   d(r . dU / dphi) = -(r . U) dphi + (J f) . dd,
    db / da = (t (x) n + n (x) t) / |a|^2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.point_group import PointGroup


def motion_of_lips(group: PointGroup, cell: int) -> tuple[np.ndarray, np.ndarray]:
    """Where y of the points of a group comes from.

    Args:
        group: of points that turn.
        cell: how many entries the gradient Fbar has that lips go with, dim^2 or 0.

    Returns:
        Slots of nodes, shape (n, k), and Q of their motions and those of Fbar, column after
        column, shape (n, dim^2, k dim + cell).
    """
    points, turning, dim = group.points, group.turning, group.sides.dim
    lips = turning.nodes[turning.site]
    width = lips.shape[2]
    gradient = 0.5 * _size(turning)[:, None, None, None] * turning.gradient
    own = points.nodes[..., None] == lips[:, :, None, :]
    first = own & (np.cumsum(own, axis=3) == 1)
    signed = points.weights * np.array([1.0, -1.0])[:, None]
    slots, apart = lips, np.einsum("psk,pskj->psj", signed, first)
    if not own.any(axis=3).all():
        slots = np.concatenate([points.nodes, lips], axis=2)
        apart = np.concatenate([signed, np.zeros(lips.shape)], axis=2)
    more = slots.shape[2] - width
    along = np.pad(gradient, ((0, 0), (0, 0), (more, 0), (0, 0)))[turning.site]
    scalars = np.concatenate([apart[..., None], along], axis=3)
    q = np.einsum("psja,de->padsje", scalars, np.eye(dim))
    q = q.reshape(-1, dim * dim, 2 * slots.shape[2] * dim)
    if cell:
        tangent = (_size(turning)[:, None, None] * turning.tangent)[turning.site]
        of_cell = np.zeros((len(group), dim, dim, dim, dim))
        of_cell[:, 1:] = np.einsum("pay,de->padye", tangent, np.eye(dim))
        q = np.concatenate([q, of_cell.reshape(-1, dim * dim, cell)], axis=2)
    return slots.reshape(-1, 2 * slots.shape[2]), q


def changes_of_jumps(
    group: PointGroup, slots: np.ndarray, motion: Sequence[np.ndarray]
) -> np.ndarray:
    """W Q dv of the points of a group, shape (n, components), m/s.

    Args:
        group: of points that turn.
        slots: change of velocities, shape (num_slots, dim), m/s.
        motion: Fbar of a periodic cell and its rate; without entries where there is none.
    """
    points, turning = group.points, group.turning
    sides = np.einsum("psk,pskd->psd", points.weights, slots[points.nodes])
    along = 0.5 * np.einsum("psja,psjd->pad", turning.gradient, slots[turning.nodes])
    if len(motion):
        along += np.einsum("de,pae->pad", motion[1], turning.tangent)
    along = (_size(turning)[:, None, None] * along)[turning.site]
    moved = np.concatenate([(sides[:, 0] - sides[:, 1])[:, None], along], axis=1)
    rows = rows_of_jumps(group)
    return np.einsum("piy,py->pi", rows, moved.reshape(-1, rows.shape[2]))


def rows_of_jumps(group: PointGroup) -> np.ndarray:
    """W of the points of a group, shape (n, components, dim^2)."""
    turning, d, dim = group.turning, group.turning.jump, group.sides.dim
    axes, arms = _axes(turning), turning.arms[turning.site]
    if dim == 2:
        turns = np.stack([d[:, 1], -d[:, 0]], axis=1)[..., None] * arms
    else:
        levers = np.cross(axes, np.einsum("pi,pij->pj", d, axes)[:, None])
        turns = (levers[:, None] @ _spins(axes, arms)).transpose(0, 2, 1, 3).reshape(-1, 3, 6)
    turns /= _size(turning)[turning.site, None, None]
    turns[turning.kept] = 0.0
    components = group.impulse.shape[1]
    frame = group.points.frame[:, :components]
    return np.concatenate([frame, turns[:, :components]], axis=2)


def springs(group: PointGroup, stiffness: np.ndarray, reach: float) -> np.ndarray:
    """W^T K W - h theta^2 M of the points of a group, shape (n, dim^2, dim^2).

    Args:
        group: of points that turn, with their impulses r.
        stiffness: K, shape (n, components, components).
        reach: h theta^2 (s).
    """
    w = rows_of_jumps(group)
    return w.transpose(0, 2, 1) @ stiffness @ w - reach * curvature(group)


def curvature(group: PointGroup) -> np.ndarray:
    """M of the points of a group for their impulses, shape (n, dim^2, dim^2)."""
    turning, dim = group.turning, group.sides.dim
    r = np.zeros((len(group), dim))
    r[:, : group.impulse.shape[1]] = group.impulse
    find = _curvature_in_plane if dim == 2 else _curvature_in_space
    out = find(_axes(turning), turning.arms[turning.site], r, turning.jump)
    out[:, dim:] /= _size(turning)[turning.site, None, None]
    out[:, :, dim:] /= _size(turning)[turning.site, None, None]
    out[turning.kept] = 0.0
    return out


def _size(turning) -> np.ndarray:
    """l of each site (m): that of its facet, or any where frames stay (of a wall)."""
    steepest = np.abs(turning.gradient).max(axis=(1, 2, 3))
    return 1.0 / np.where(steepest > 0.0, steepest, 1.0)


def _axes(turning) -> np.ndarray:
    """F of each point, shape (n, dim, dim), all of its rows."""
    axes = turning.axes[turning.site]
    if axes.shape[2] == 3:
        return axes
    return np.concatenate([axes, np.stack([-axes[..., 1], axes[..., 0]], axis=2)], axis=1)


def _spins(axes: np.ndarray, arms: np.ndarray) -> np.ndarray:
    """Omega_alpha, shape (n, 2, 3, 3)."""
    n, b, c = axes[:, None, 0], arms[:, :2], arms[:, 2:]
    return n[..., :, None] * c[..., None, :] - b[..., :, None] * n[..., None, :]


def _outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., :, None] * b[..., None, :]


def _curvature_in_plane(
    axes: np.ndarray, arms: np.ndarray, r: np.ndarray, d: np.ndarray
) -> np.ndarray:
    """M in (d, a) of axes F, arms b, impulses r and local d, shape (n, 4, 4)."""
    n, t, b = axes[:, 0], axes[:, 1], arms[:, 0]
    out = np.zeros((len(r), 4, 4))
    turned = r[:, :1] * t - r[:, 1:] * n
    out[:, :2, 2:] = _outer(turned, b)
    out[:, 2:, :2] = out[:, :2, 2:].transpose(0, 2, 1)
    along = np.sum(r * d, axis=1)[:, None, None]
    moment = (r[:, 0] * d[:, 1] - r[:, 1] * d[:, 0])[:, None, None]
    bends = (_outer(t, n) + _outer(n, t)) * np.sum(b * b, axis=1)[:, None, None]
    out[:, 2:, 2:] = moment * bends - along * _outer(b, b)
    return out


def _turned(spins: np.ndarray, a: np.ndarray) -> np.ndarray:
    """What spins, shape (..., 3, 3), make of vectors a, shape (..., 3): domega x a."""
    across = np.cross(np.eye(3), a[..., None, :])  # rows e_j x a
    return np.swapaxes(across, -1, -2) @ spins


def _curvature_in_space(
    axes: np.ndarray, arms: np.ndarray, r: np.ndarray, d: np.ndarray
) -> np.ndarray:
    """M in (d, a_1, a_2) of axes F, arms b, c, impulses r and local d, shape (n, 9, 9)."""
    count = len(r)
    n, b, c, spins = axes[:, 0], arms[:, :2], arms[:, 2:], _spins(axes, arms)
    f, d = np.einsum("pi,pij->pj", r, axes), np.einsum("pi,pij->pj", d, axes)
    m = np.cross(f, d)
    of_spin = _outer(f, d) - np.sum(f * d, axis=1)[:, None, None] * np.eye(3)
    turned = _turned(spins, f[:, None])  # df
    area = np.sum(n * np.cross(b[:, 0], b[:, 1]), axis=1)[:, None, None] * np.eye(3)  # 1 / A
    stretched = np.cross(b, n[:, None])  # dA / A
    drill = np.sum(axes[:, 2] * c[:, 0], axis=1)  # 1 / tau
    tilted = _turned(spins, n[:, None])  # dn
    out = np.zeros((count, 9, 9))
    nm, bm = np.sum(n * m, axis=1), np.einsum("pai,pi->pa", b, m)
    for alpha in range(2):
        rows = slice(3 + 3 * alpha, 6 + 3 * alpha)
        out[:, :3, rows] = turned[:, alpha]
        out[:, rows, :3] = turned[:, alpha].transpose(0, 2, 1)
        for beta in range(2):
            dc = _turned(spins[:, beta], c[:, alpha])
            dc -= _outer(c[:, alpha], drill[:, None] * axes[:, 1 + beta])
            db = -_outer(b[:, alpha], stretched[:, beta])
            if alpha != beta:
                db += area if alpha == 0 else -area
            block = spins[:, alpha].transpose(0, 2, 1) @ of_spin @ spins[:, beta]
            block += nm[:, None, None] * dc
            block += _outer(c[:, alpha], np.einsum("pi,pij->pj", m, tilted[:, beta]))
            block -= bm[:, alpha, None, None] * tilted[:, beta]
            block -= _outer(n, np.einsum("pi,pij->pj", m, db))
            out[:, rows, 3 + 3 * beta : 6 + 3 * beta] = block
    return out
