# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid motions of bodies that what is prescribed leaves free: in them a stiffness is singular."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.support.ranks import Ranks

# Eigenvalue, beside the largest, below which a motion is not held: a body's lever arms against
# its size, squared.
_NOT_HELD = 1e-12


def free_rigid_motions(x: np.ndarray, offsets: np.ndarray, held: np.ndarray) -> np.ndarray:
    """How many translations and infinitesimal rotations of each body nothing holds.

    A body is held if no rigid motion but zero vanishes on its held components, that is if
    sum m m^T over these is regular, m being the components of the motions there.

    Args:
        x: positions of the nodes, body by body, shape (num_nodes, dim), m.
        offsets: shape (num_bodies + 1,), first node of each body.
        held: components whose motion is given, shape (num_nodes, dim), bool.

    Returns:
        Shape (num_bodies,): from 0 to 3 in 2D, to 6 in 3D.
    """
    motions, starts = _rigid_motions(x, offsets) * held[:, :, None], offsets[:-1]
    grams = np.add.reduceat(np.einsum("ncm,nck->nmk", motions, motions), starts)
    return _not_held(np.linalg.eigvalsh(grams)).sum(axis=1)


def loose_group(
    x: np.ndarray, offsets: np.ndarray, held: np.ndarray, joined: np.ndarray
) -> tuple[np.ndarray, int]:
    """The first group of joined bodies that is free to move as a whole.

    Args:
        x, offsets, held: as of `free_rigid_motions`.
        joined: pairs of bodies, shape (n, 2).

    Returns:
        Its bodies, none if all groups are held, and in how many ways it is free.
    """
    graph = coo_array((np.ones(len(joined)), tuple(joined.T)), shape=2 * (len(offsets) - 1,))
    _, group = connected_components(graph, directed=False)
    group_of_node = np.repeat(group, np.diff(offsets))
    order = np.argsort(group_of_node, kind="stable")
    firsts = np.concatenate([[0], np.cumsum(np.bincount(group_of_node))])
    free = free_rigid_motions(x[order], firsts, held[order])
    if not np.any(free):
        return np.empty(0, int), 0
    loose = int(np.argmax(free > 0))
    return np.flatnonzero(group == loose), int(free[loose])


def loose_bodies(
    x: np.ndarray,
    sizes: np.ndarray,
    held: np.ndarray,
    joined: np.ndarray,
    numbers: np.ndarray | None,
    ranks: Ranks,
) -> tuple[np.ndarray, int, np.ndarray]:
    """The first group of joined bodies that is free to move; all ranks call it together.

    Args:
        x, held: as of `free_rigid_motions`, of this rank's bodies.
        sizes: shape (num_bodies,), nodes of each.
        joined: pairs of the bodies of all ranks, shape (n, 2).
        numbers: shape (num_bodies,), which of the bodies of all ranks they are; None if all are.
        ranks: that divide the bodies.

    Returns:
        Its bodies, none if all groups are held, in how many ways it is free, and the mean position
        of its nodes, shape (dim,), m.
    """
    if numbers is not None:
        everyone = ranks.comm.allgather
        numbers, sizes = (np.concatenate(everyone(a)) for a in (numbers, sizes))
        order = np.argsort(np.repeat(numbers, sizes), kind="stable")
        x, held = (np.concatenate(everyone(a))[order] for a in (x, held))
        sizes = sizes[np.argsort(numbers)]
    bodies, ways = loose_group(x, np.concatenate([[0], np.cumsum(sizes)]), held, joined)
    there = np.isin(np.repeat(np.arange(len(sizes)), sizes), bodies)
    return bodies, ways, x[there].mean(axis=0) if len(bodies) else np.zeros(x.shape[1])


def free_rigid_modes(x: np.ndarray, held: np.ndarray) -> np.ndarray:
    """The rigid motions of one body that nothing holds.

    Args:
        x: positions of its nodes, shape (num_nodes, dim), m.
        held: components whose motion is given, shape (num_nodes, dim), bool.

    Returns:
        Orthonormal columns, shape (num_nodes * dim, number of motions); they vanish where held.
    """
    motions = _rigid_motions(x, np.array([0, len(x)]))
    fixed = motions[held]
    values, vectors = np.linalg.eigh(fixed.T @ fixed)
    free = motions.reshape(held.size, -1) @ vectors[:, _not_held(values)]
    free[held.ravel()] = 0.0
    return np.linalg.qr(free)[0]


def _rigid_motions(x: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Translations and rotations about the centre of each body, of like size.

    Returns:
        Shape (num_nodes, dim, number of motions).
    """
    dim, starts, sizes = x.shape[1], offsets[:-1], np.diff(offsets)
    centre = np.add.reduceat(x, starts) / sizes[:, None]
    arm = x - np.repeat(centre, sizes, axis=0)
    arm /= np.repeat(np.maximum.reduceat(np.abs(arm).max(axis=1), starts), sizes)[:, None]
    planes = list(combinations(range(dim), 2))
    motions = np.zeros((*x.shape, dim + len(planes)))
    motions[:, range(dim), range(dim)] = 1.0
    for number, (i, j) in enumerate(planes, start=dim):
        motions[:, i, number], motions[:, j, number] = -arm[:, j], arm[:, i]
    return motions


def _not_held(values: np.ndarray) -> np.ndarray:
    """Which eigenvalues of sum m m^T, ascending along the last axis, stand for free motions."""
    return values <= _NOT_HELD * np.maximum(values[..., -1:], 1.0)
