# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks that run one script after another, so that libraries and kernels are loaded once.

The first rank reads lines of JSON, `[COUNT, SCRIPT, ARGUMENT, ...]`, and writes one that is `DONE`
when the first `COUNT` ranks have run it; to them they are all there are. Where a script raises, all
end.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import json
import os
import runpy
import socket
import sys
import traceback
from pathlib import Path

from mpi4py import MPI

DONE = "all ranks have run it"
_TESTS = str(Path(__file__).parents[1])
_LONGEST_LINE = 100_000


def serve() -> None:
    """Run what is asked for until the input ends."""
    comm = MPI.COMM_WORLD.Dup()
    importlib.import_module("petsc4py.PETSc")  # begins on all ranks at once
    parts = [comm.Split(comm.rank >= count, comm.rank) for count in range(1, comm.size + 1)]
    # a rank that waits in MPI polls, and would take its share of a core
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wake:
        wake.bind(f"\0xper_fx-{os.getpid()}")
        names = comm.allgather(wake.getsockname())
        while line := _next_line(comm.rank, wake, names):
            count, *command = json.loads(line)
            _run(command, parts[count - 1])


def _run(command: list[str], part: MPI.Comm) -> None:
    """Run a script on the ranks of a part, whose `MPI.COMM_WORLD` is the part from now on.

    The package has asked for `MPI.COMM_WORLD` when it was imported: the object stays.
    """
    ctypes.memmove(MPI._addressof(MPI.COMM_WORLD), MPI._addressof(part), MPI._sizeof(MPI.Comm))
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(_TESTS):
            del sys.modules[name]  # a script may have set what is in it
    script, *sys.argv[1:] = command
    sys.argv[0], sys.path[0] = script, str(Path(script).parent)
    try:
        runpy.run_path(script, run_name="__main__")
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
        part.Abort(1)
    gc.collect()
    sys.stdout.flush()
    part.Barrier()
    if part.rank == 0:
        print(DONE, flush=True)


def _next_line(rank: int, wake: socket.socket, names: list[bytes]) -> str:
    """What this rank is to run next, empty at the end; the first rank wakes the others."""
    if rank > 0:
        return wake.recv(_LONGEST_LINE).decode()
    line = sys.stdin.readline()
    for name in names[1 : json.loads(line)[0] if line else None]:
        wake.sendto(line.encode(), name)
    return line


if __name__ == "__main__":
    serve()
