# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an exchange between two ranks costs, by the library it is made with.

    ./fenicsx mpirun -n 2 python3 benchmarks/message_cost.py

200 velocities of a cut go to the other rank and as many come from it, packed and unpacked:

- *index map*: by DOLFINx, as `parallel/exchange.py` does (a neighbourhood collective);
- *requests*: persistent requests of mpi4py, numbers packed by NumPy;
- *compiled*: all of it within one compiled function: loops that pack, and the same requests, which
  MPI's C functions start and wait for (Open MPI: the null pointer ignores statuses).

Medians over calls that both ranks begin together, the slower rank's. Compiled code saves 1.5 us of
an exchange, where a step with 20 of them takes 3 ms for 10 000 points a rank: not worth the binding
to one MPI's types.
"""

import ctypes

import numba
import numpy as np
from mpi4py import MPI
from rank_scaling import cost_of_call

from xper_fx.parallel.exchange import Exchange
from xper_fx.support.ranks import Ranks

COUNT = 200
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


def main() -> None:
    """Measure and print."""
    values = RANKS.rank + np.arange(2.0 * COUNT)
    own, ghosts = np.arange(COUNT), COUNT + np.arange(COUNT)
    given, taken = np.empty(COUNT), np.empty(COUNT)
    requests = [RANKS.comm.Recv_init(taken, OTHER), RANKS.comm.Send_init(given, OTHER)]
    slots = np.arange(COUNT // 2)
    index_map = Exchange(RANKS, {OTHER: slots}, {OTHER: COUNT // 2 + slots}, 2)

    def by_requests() -> None:
        given[:] = values[own]
        MPI.Prequest.Startall(requests)
        MPI.Request.Waitall(requests)
        values[ghosts] = taken

    ways = {
        "index map": lambda: index_map.forward(values),
        "requests": by_requests,
        "compiled": compiled(values, own, ghosts, given, taken, requests),
    }
    for _ in range(2):
        for name, call in ways.items():
            found = 1e6 * cost_of_call(RANKS, call)
            if RANKS.rank == 0:
                print(f"{name:10} {found:6.2f} us", flush=True)
    np.testing.assert_array_equal(values[ghosts], OTHER + np.arange(COUNT))


if __name__ == "__main__":
    main()
