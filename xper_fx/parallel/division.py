# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which rank has which bodies: a partition of the graph of bodies by SCOTCH.

A body weighs what its bulk and its points cost, a pair of bodies what is exchanged between them;
SCOTCH (Pellegrini and Roman 1996) evens out the first and keeps the second small. DOLFINx's own
`partitioner_scotch` takes neither of these weights, so the library that it is linked with is called
as it is.
"""

from __future__ import annotations

import ctypes
from contextlib import ExitStack

import dolfinx.cpp
import numpy as np
from scipy.sparse import coo_array

from xper_fx.parallel.ownership import owners_of_pairs
from xper_fx.support.ranks import ALONE, Ranks

# Of SCOTCH's strategies the one for small cuts, and the share by which parts may differ.
_QUALITY, _IMBALANCE = 1, 0.01


def partition_bodies(
    weights: np.ndarray, pairs: np.ndarray, exchanged: np.ndarray, num_ranks: int
) -> np.ndarray:
    """Divide bodies among ranks.

    Args:
        weights: shape (num_bodies,), work that each body is, whole numbers from 1 on.
        pairs: shape (n, 2), bodies that interact; a pair may come several times.
        exchanged: shape (n,), what has to be exchanged if the two are on different ranks, whole
            numbers from 1 on.
        num_ranks: number of ranks.

    Returns:
        The rank of each body, shape (num_bodies,), int32. Every rank has some; of fewer bodies
        than ranks the first ranks have one each. It depends on the arguments alone.
    """
    count = len(weights)
    if count < num_ranks:
        return np.arange(count, dtype=np.int32)
    if num_ranks == 1:
        return np.zeros(count, np.int32)
    rank_of_body = _scotch(np.asarray(weights), _graph(pairs, exchanged, count), num_ranks)
    return none_empty(rank_of_body, num_ranks)


def cost_of_partition(
    sides: np.ndarray,
    weights: np.ndarray,
    own: np.ndarray,
    exchanges: float = 0.0,
    ranks: Ranks = ALONE,
) -> float:
    """What a partition costs over what it would if the work could be divided evenly.

    With work_r what rank r does on its own, and cut_r what it has at cuts, which it sweeps in
    phases of their own (`turns.py`):

        cost = (max_r work_r + max_r cut_r + exchanges) / mean

    Args:
        sides: shape (n, 2), ranks of the bodies of what is between two.
        weights: shape (n,), its work.
        own: shape (num_ranks,), the rest of the work of each rank.
        exchanges: work of those that cuts ask for, where there are any.
        ranks: those that have some of `sides` and `weights` each, and all call it.
    """
    size, owner = len(own), owners_of_pairs(sides)
    alone = sides[:, 0] == sides[:, 1]
    inside, cut = (np.bincount(owner[of], weights[of], size) for of in (alone, ~alone))
    inside, cut = ranks.sum(np.stack([inside, cut]))
    work = (own + inside).max() + cut.max() + (0.0 if ranks.all(alone.all()) else exchanges)
    return float(size * work / (own.sum() + inside.sum() + cut.sum()))


def _graph(pairs, exchanged, count):
    """Adjacency of the bodies with the weights of their edges, symmetric, no diagonal."""
    a, b = pairs[pairs[:, 0] != pairs[:, 1]].T
    values = np.asarray(exchanged)[pairs[:, 0] != pairs[:, 1]]
    half = coo_array((values, (a, b)), shape=(count, count)).tocsr()
    whole = (half + half.T).tocsr()
    whole.sort_indices()
    return whole


def _scotch(weights, adjacency, num_ranks: int) -> np.ndarray:
    """SCOTCH's partition by one thread: by several it would depend on which comes first."""
    # symbols are looked for in the libraries that DOLFINx is linked with, too
    library = ctypes.CDLL(dolfinx.cpp.__file__)
    if not hasattr(library, "SCOTCH_contextInit"):
        raise ImportError(
            "DOLFINx was built without SCOTCH 7, which divides the bodies among ranks: take a "
            "build that has it (Debian's and conda-forge's do), or run on one rank."
        )
    kind = {4: np.int32, 8: np.int64}[library.SCOTCH_numSizeof()]
    number = ctypes.c_int32 if kind is np.int32 else ctypes.c_int64
    offsets, edges, sizes, costs = (
        np.ascontiguousarray(array, kind)
        for array in (adjacency.indptr, adjacency.indices, weights, adjacency.data)
    )
    parts = np.zeros(len(weights), kind)

    def address(array):
        return array.ctypes.data_as(ctypes.c_void_p)

    def check(status: int) -> None:
        if status != 0:
            raise RuntimeError("SCOTCH could not divide the bodies among the ranks.")

    with ExitStack() as stack:

        def made(kind: str):
            thing = ctypes.create_string_buffer(getattr(library, f"SCOTCH_{kind}Sizeof")())
            check(getattr(library, f"SCOTCH_{kind}Init")(thing))
            stack.callback(getattr(library, f"SCOTCH_{kind}Exit"), thing)
            return thing

        context, built, graph, strategy = map(made, ("context", "graph", "graph", "strat"))
        check(library.SCOTCH_contextThreadSpawn(context, ctypes.c_int(1), None))
        library.SCOTCH_contextRandomReset(context)
        check(
            library.SCOTCH_graphBuild(
                built, number(0), number(len(weights)), address(offsets), None,
                address(sizes), None, number(len(edges)), address(edges), address(costs),
            )
        )  # fmt: skip
        check(library.SCOTCH_contextBindGraph(context, built, graph))
        check(
            library.SCOTCH_stratGraphMapBuild(
                strategy, number(_QUALITY), number(num_ranks), ctypes.c_double(_IMBALANCE)
            )
        )
        check(library.SCOTCH_graphPart(graph, number(num_ranks), strategy, address(parts)))
    return parts.astype(np.int32)


def none_empty(rank_of_body: np.ndarray, num_ranks: int) -> np.ndarray:
    """Give each rank that has nothing, while there are any, a body of the rank that has most."""
    sizes = np.bincount(rank_of_body, minlength=num_ranks)
    spare = len(rank_of_body) - np.count_nonzero(sizes)
    for rank in np.flatnonzero(sizes == 0)[:spare]:
        largest = int(np.argmax(sizes))
        rank_of_body[np.flatnonzero(rank_of_body == largest)[-1]] = rank
        sizes[largest] -= 1
        sizes[rank] += 1
    return rank_of_body
