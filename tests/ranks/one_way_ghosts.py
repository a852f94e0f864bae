# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ghosts along a chain: each rank follows the one before it, which has none of its slots."""

import numpy as np
from mpi4py import MPI

from xper_fx.parallel.halo import Exchange
from xper_fx.parallel.launch import run_together
from xper_fx.support.ranks import Ranks

OWN, GHOST = slice(0, 6), slice(6, 8)  # three own slots of two dofs, then a ghost


def main() -> None:
    comm = MPI.COMM_WORLD
    rank, last = comm.rank, comm.size - 1
    given = {} if rank == last else {rank + 1: np.array([2])}
    ghosts = {} if rank == 0 else {rank - 1: np.array([3])}
    exchange = Exchange(Ranks(comm), given, ghosts, 2)

    values = 10.0 * rank + np.arange(8.0)
    exchange.forward(values)
    before = 10.0 * (rank - 1) + np.array([4.0, 5.0])
    expected = before if rank > 0 else [6.0, 7.0]
    np.testing.assert_array_equal(values[GHOST], expected)

    values[OWN], values[GHOST] = 1.0, [rank, -rank]
    exchange.add_back(values)
    more = [0.0, 0.0] if rank == last else [rank + 1.0, -rank - 1.0]
    np.testing.assert_array_equal(values[OWN], np.ones(6) + [0, 0, 0, 0, *more])

    exchange.back(values)
    expected = [1.0, 1.0] if rank == last else more
    np.testing.assert_array_equal(values[OWN], [1, 1, 1, 1, *expected])
    print("exchanged", flush=True)


run_together(main)
