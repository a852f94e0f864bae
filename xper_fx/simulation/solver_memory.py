# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a solver keeps from step to step, as it is saved: of each rank in the order of its visits.

It is of use to as many ranks that visit the same points in the same order, which a number tells
that is made of their numbers; others begin without.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np

from xper_fx.nscd.interactions import Interactions
from xper_fx.nscd.solvers.solver import Solver
from xper_fx.support.ranks import Ranks
from xper_fx.support.saved_rows import Rows


def saved_memory(solver: Solver, interactions: Interactions, ranks: Ranks) -> dict:
    """What `restore_memory` takes; all ranks call it together.

    Returns:
        `visits`, shape (num_ranks,): of the points that each rank visits; then, by the owner of
        what is kept and by its name, `Rows` of all ranks, one after the other, and their `counts`,
        shape (num_ranks,), -1 where a rank has none.
    """
    held = {
        (owner, name): array
        for owner, arrays in solver.saved(interactions).items()
        for name, array in arrays.items()
    }
    kinds = {key: (len(array), array.shape[1:], array.dtype) for key, array in held.items()}
    told = [(_visits(interactions), kinds)]
    told = told if ranks.alone else ranks.comm.allgather(told[0])
    out: dict = {"visits": np.array([visits for visits, _ in told])}
    # of a rank without points an array may have another shape, of which nothing is left
    every = [(key, kind) for _, kinds in told for key, kind in kinds.items()]
    of_all = dict(sorted(every, key=lambda one: one[1][0] > 0))
    for (owner, name), (_, shape, dtype) in sorted(of_all.items()):
        counts = np.array([kinds.get((owner, name), (-1,))[0] for _, kinds in told])
        values = held.get((owner, name), ())
        values = values if len(values) else np.empty((0, *shape), dtype)
        first = np.maximum(counts[: ranks.rank], 0).sum()
        rows = Rows(first + np.arange(len(values)), values)
        out.setdefault(owner, {})[name] = {"rows": rows, "counts": counts}
    return out


def restore_memory(
    solver: Solver, interactions: Interactions, ranks: Ranks, saved: Mapping
) -> None:
    """Let a solver go on with what `saved_memory` gave; all ranks call it together."""
    visits = np.atleast_1d(saved.get("visits", ()))
    same = len(visits) == ranks.size and visits[ranks.rank] == _visits(interactions)
    if not ranks.all(same):
        return
    memory: dict = {}
    for owner, arrays in saved.items():
        for name, kept in arrays.items() if owner != "visits" else ():
            counts = np.atleast_1d(kept["counts"])
            first = np.maximum(counts[: ranks.rank], 0).sum()
            if counts[ranks.rank] >= 0:
                number = first + np.arange(counts[ranks.rank])
                memory.setdefault(owner, {})[name] = kept["rows"][number]
    solver.restore(interactions, memory)


def _visits(interactions: Interactions) -> int:
    """A number made of those of this rank's permanent points, in the order of their visits."""
    visited = [np.zeros(0, np.int64), *(g.indices for g in interactions.permanent)]
    return zlib.crc32(interactions.numbers[np.concatenate(visited)])
