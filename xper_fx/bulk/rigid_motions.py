# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid motions of bodies that what is prescribed leaves free: in them a stiffness is singular."""

from __future__ import annotations

from itertools import combinations

import numpy as np

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


def loose_bodies(
    x: np.ndarray,
    sizes: np.ndarray,
    held: np.ndarray,
    joined: np.ndarray,
    numbers: np.ndarray | None,
    ranks: Ranks,
) -> tuple[np.ndarray, int, np.ndarray]:
    """The first group of joined bodies that is free to move; all ranks call it together.

    A rank knows no more than its own bodies and what they are joined to: groups that reach over
    several ranks are put together at the cuts, and what is summed over their nodes is told to all.

    Args:
        x, held: as of `free_rigid_motions`, of this rank's bodies.
        sizes: shape (num_bodies,), nodes of each.
        joined: pairs of bodies, shape (n, 2); those of other ranks may be among them.
        numbers: shape (num_bodies,), which of the bodies of all ranks they are; None if all are.
        ranks: that divide the bodies.

    Returns:
        Its bodies, none if all groups are held, in how many ways it is free, and the mean position
        of its nodes, shape (dim,), m.
    """
    from scipy.sparse import coo_array

    if numbers is None:
        numbers = np.arange(len(sizes))
    group, num_shared, num_groups = joined_groups(joined, numbers, ranks)
    group_of_node = np.repeat(group, sizes)
    count, dim = len(x), x.shape[1]
    places = (group_of_node, np.arange(count))
    collect = coo_array((np.ones(count), places), shape=(num_groups, count)).tocsr()

    def of_all(values: np.ndarray, combine) -> np.ndarray:
        values[:num_shared] = combine(values[:num_shared])
        return values

    total = of_all(collect @ np.column_stack([np.ones(count), x]), ranks.sum)
    centre = total[:, 1:] / total[:, :1]
    arm, reach = x - centre[group_of_node], np.zeros(num_groups)
    np.maximum.at(reach, group_of_node, np.abs(arm).max(axis=1))
    reach = of_all(reach, ranks.max)
    motions = _motions(arm / reach[group_of_node, None]) * held[:, :, None]
    grams = np.einsum("ncm,nck->nmk", motions, motions)
    square = grams.shape[1:]
    rows = collect @ grams.reshape(count, np.prod(square))
    grams = of_all(rows.reshape(num_groups, *square), ranks.sum)
    free = _not_held(np.linalg.eigvalsh(grams)).sum(axis=1)

    first = np.full(num_groups, np.inf)
    np.minimum.at(first, group, numbers)
    first = -of_all(-first, ranks.max)
    least = -ranks.max(-first[free > 0].min(initial=np.inf))
    if not np.isfinite(least):
        return np.empty(0, int), 0, np.zeros(dim)
    loose = (free > 0) & (first == least)
    bodies = np.sort(np.concatenate(ranks.comm.allgather(numbers[loose[group]])))
    told = np.full(1 + dim, -np.inf)
    if np.any(loose):
        told = np.concatenate([free[loose], *centre[loose]])
    ways, *place = ranks.max(told).tolist()
    return bodies, int(ways), np.array(place)


def joined_groups(
    joined: np.ndarray, numbers: np.ndarray, ranks: Ranks
) -> tuple[np.ndarray, int, int]:
    """The groups of joined bodies, those that reach over several ranks first.

    Args:
        joined, numbers, ranks: as of `loose_bodies`, which call it together.

    Returns:
        The group of each of this rank's bodies, how many groups all ranks have alike, and how many
        there are here, these among them.
    """
    joined, own = joined[np.isin(joined, numbers).any(axis=1)], len(numbers)
    known = np.concatenate([numbers, np.setdiff1d(joined, numbers)])
    part = _components(_places(known, joined), len(known))
    count = part.max(initial=-1) + 1
    part += ranks.before(count)
    told = ranks.comm.allgather((known[own:], part[own:]))
    asked, by = (np.concatenate(column) for column in zip(*told, strict=True))
    mine = np.isin(asked, numbers)
    meet = np.column_stack([by[mine], part[_places(numbers, asked[mine])]])
    pairs = np.concatenate(ranks.comm.allgather(meet))
    crossing, ends = np.unique(pairs, return_inverse=True)
    group = _components(ends.reshape(-1, 2), len(crossing))
    num_shared = group.max(initial=-1) + 1
    parts, of_body = np.unique(part[:own], return_inverse=True)
    over = np.isin(parts, crossing)
    group_of_part = num_shared + np.cumsum(~over) - 1
    group_of_part[over] = group[np.searchsorted(crossing, parts[over])]
    return group_of_part[of_body], num_shared, num_shared + np.count_nonzero(~over)


def _places(numbers: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Where numbers that are asked for stand in an array that has them all."""
    order = np.argsort(numbers)
    return order[np.searchsorted(numbers, asked, sorter=order)]


def _components(pairs: np.ndarray, count: int) -> np.ndarray:
    """Which of a number of things pairs join, shape (count,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


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
    starts, sizes = offsets[:-1], np.diff(offsets)
    centre = np.add.reduceat(x, starts) / sizes[:, None]
    arm = x - np.repeat(centre, sizes, axis=0)
    arm /= np.repeat(np.maximum.reduceat(np.abs(arm).max(axis=1), starts), sizes)[:, None]
    return _motions(arm)


def _motions(arm: np.ndarray) -> np.ndarray:
    """Translations and rotations at lever arms, shape (n, dim, number of motions)."""
    dim = arm.shape[1]
    planes = list(combinations(range(dim), 2))
    motions = np.zeros((*arm.shape, dim + len(planes)))
    motions[:, range(dim), range(dim)] = 1.0
    for number, (i, j) in enumerate(planes, start=dim):
        motions[:, i, number], motions[:, j, number] = -arm[:, j], arm[:, i]
    return motions


def _not_held(values: np.ndarray) -> np.ndarray:
    """Which eigenvalues of sum m m^T, ascending along the last axis, stand for free motions."""
    return values <= _NOT_HELD * np.maximum(values[..., -1:], 1.0)
