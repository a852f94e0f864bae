# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks give each other: along a chain, and from holder to holder of a body."""

import numpy as np
from mpi4py import MPI

from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.launch import run_together
from xper_fx.parallel.ownership import owners_of_pairs
from xper_fx.parallel.turns import divide_in_phases, hand_overs, phases_of_rows
from xper_fx.support.ranks import Ranks

OWN, GHOST = slice(0, 6), slice(6, 8)  # three own slots of two dofs, then a ghost


def main() -> None:
    """Both; said when nothing has failed."""
    chain(MPI.COMM_WORLD)
    turns(Ranks(MPI.COMM_WORLD))
    print("exchanged", flush=True)


def turns(ranks: Ranks) -> None:
    """Each row finds its units as the rows before it, on whichever rank, have left them.

    A unit counts its visits in decimal digits of the rows, in the order of phases; at the end all
    are at home.
    """
    rng = np.random.default_rng(8)
    home = rng.integers(0, ranks.size, 30)
    pairs = rng.integers(0, 30, (60, 2))
    pairs = pairs[home[pairs[:, 0]] != home[pairs[:, 1]]]
    owner, me = owners_of_pairs(home[pairs]), ranks.rank
    all_phases = phases_of_rows(pairs, owner)
    own = np.flatnonzero(owner == me)
    phase, visits = divide_in_phases(ranks, pairs[own], home[pairs[own]])
    np.testing.assert_array_equal(phase, all_phases[own])
    assert 2 < all_phases.max() < 9
    values, expected = np.zeros(30), np.zeros(30)
    steps = hand_overs(ranks, visits, visits.unit)
    assert len(steps) == 1 + all_phases.max()
    for step, (given, taken) in enumerate(steps):
        for row in np.flatnonzero(all_phases == step):
            expected[pairs[row]] = (3 * expected[pairs[row]] + row) % 1e6
        for row in own[phase == step]:
            values[pairs[row]] = (3 * values[pairs[row]] + row) % 1e6
        Exchange(ranks, given, taken, 1).forward(values)
    here = home == me
    np.testing.assert_array_equal(values[here], expected[here])


def chain(comm: MPI.Comm) -> None:
    """Each rank follows the one before it, which has none of its slots."""
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


run_together(main)
