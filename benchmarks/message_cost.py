# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an exchange between two ranks costs, by the library it is made with.

    ./fenicsx mpirun -n 2 python3 benchmarks/message_cost.py

So many numbers of a cut go to the other rank and as many come from it, packed and unpacked:

- *requests*: persistent requests of mpi4py, as `parallel/exchange.py` does;
- *index map*: by DOLFINx (a neighbourhood collective), numbers packed by NumPy;
- *compiled*: all of it within one compiled function: loops that pack, and the same requests, which
  MPI's C functions start and wait for (Open MPI: the null pointer ignores statuses).

Medians over calls that both ranks begin together, the slower rank's. Compiled code saves about 1 us
of an exchange, where a step with 20 of them takes 3 ms for 10 000 points a rank: not worth the
binding to one MPI's types.
"""

import ctypes
from functools import partial

import numba
import numpy as np
from dolfinx import la
from dolfinx.common import IndexMap
from mpi4py import MPI
from rank_scaling import cost_of_call

from xper_fx.parallel.exchange import Exchange
from xper_fx.support.ranks import Ranks

COUNTS = 200, 1200
RANKS = Ranks(MPI.COMM_WORLD)
OTHER = 1 - RANKS.rank


def compiled(values, own, ghosts, given, taken, requests):
    """An exchange within compiled code; requests are persistent ones of MPI."""
    library = ctypes.CDLL("libmpi.so", ctypes.RTLD_GLOBAL)
    start_all, wait_all = library.MPI_Startall, library.MPI_Waitall
    start_all.argtypes, start_all.restype = [ctypes.c_int, ctypes.c_void_p], ctypes.c_int
    wait_all.argtypes, wait_all.restype = [ctypes.c_int, *[ctypes.c_void_p] * 2], ctypes.c_int
    handles = np.array([MPI._handleof(request) for request in requests], np.uintp)

    @numba.njit
    def exchange(values, own, ghosts, given, taken, handles):
        for i in range(len(own)):
            given[i] = values[own[i]]
        start_all(2, handles.ctypes.data)
        wait_all(2, handles.ctypes.data, 0)
        for i in range(len(ghosts)):
            values[ghosts[i]] = taken[i]

    return lambda: exchange(values, own, ghosts, given, taken, handles)


def by_index_map(count, values, own, ghosts):
    """An exchange by DOLFINx."""
    others = np.array([OTHER], np.int32)
    numbers = OTHER * count + np.arange(count)
    shared = IndexMap(RANKS.comm, count, [others, others], numbers, np.full(count, OTHER, np.int32))
    vector = la.vector(shared, 1, dtype=np.float64)
    array = vector.array  # to make this view takes nearly as long as to exchange

    def exchange() -> None:
        array[:count] = values[own]
        vector.scatter_forward()
        values[ghosts] = array[count:]

    return exchange


def main() -> None:
    """Measure and print."""
    for count in COUNTS:
        values = RANKS.rank + np.arange(2.0 * count)
        own, ghosts = np.arange(count), count + np.arange(count)
        given, taken = np.empty(count), np.empty(count)
        requests = [RANKS.comm.Recv_init(taken, OTHER), RANKS.comm.Send_init(given, OTHER)]
        exchange = Exchange(RANKS, {OTHER: own}, {OTHER: ghosts}, 1)
        ways = {
            "requests": partial(exchange.forward, values),
            "index map": by_index_map(count, values, own, ghosts),
            "compiled": compiled(values, own, ghosts, given, taken, requests),
        }
        for _ in range(2):
            for name, call in ways.items():
                found = 1e6 * cost_of_call(RANKS, call)
                if RANKS.rank == 0:
                    print(f"{count:5d} numbers, {name:10}{found:6.2f} us", flush=True)
        np.testing.assert_array_equal(values[ghosts], OTHER + np.arange(count))


if __name__ == "__main__":
    main()
