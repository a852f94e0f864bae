# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors on one rank, on all, and in what the first rank does for all."""

import sys

from mpi4py import MPI

from xper_fx.parallel.launch import run_together
from xper_fx.support.ranks import Ranks


def main() -> None:
    comm, kind = MPI.COMM_WORLD, sys.argv[1]
    sys.stdout.write(f"said by {comm.rank}\n")
    if kind == "all":
        raise ValueError("wrong on all")
    if kind == "last" and comm.rank == comm.size - 1:
        raise ValueError("wrong on the last")
    if kind == "root":

        def write():
            raise OSError(28, "no space")

        try:
            Ranks(comm).at_root(write)
        except OSError as error:
            told = comm.allgather(str(error))
            print("told", told)
            return
    comm.barrier()


run_together(main)
