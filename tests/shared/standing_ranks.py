# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks that run one script after another, so that libraries and kernels are loaded once.

The first rank reads lines of JSON, `[SCRIPT, ARGUMENT, ...]`, and writes one that is `DONE` when
all ranks have run it. Where a script raises, all end.
"""

from __future__ import annotations

import gc
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


def serve() -> None:
    """Run what is asked for until the input ends."""
    comm = MPI.COMM_WORLD.Dup()
    # a rank that waits in MPI polls, and would take its share of a core
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wake:
        wake.bind(f"\0xper_fx-{os.getpid()}")
        _serve(comm, wake, comm.allgather(wake.getsockname()))


def _serve(comm: MPI.Comm, wake: socket.socket, names: list[bytes]) -> None:
    while (line := _next_line(comm, wake, names)) is not None:
        script, *sys.argv[1:] = json.loads(line)
        for name, module in list(sys.modules.items()):
            if (getattr(module, "__file__", None) or "").startswith(_TESTS):
                del sys.modules[name]  # a script may have set what is in it
        sys.argv[0], sys.path[0] = script, str(Path(script).parent)
        try:
            runpy.run_path(script, run_name="__main__")
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            MPI.COMM_WORLD.Abort(1)
        gc.collect()
        sys.stdout.flush()
        comm.Barrier()
        if comm.rank == 0:
            print(DONE, flush=True)


def _next_line(comm: MPI.Comm, wake: socket.socket, names: list[bytes]) -> str | None:
    """The same on all ranks, None at the end."""
    if comm.rank > 0:
        wake.recv(1)
    else:
        line = sys.stdin.readline() or None
        for name in names[1:]:
            wake.sendto(b" ", name)
    return comm.bcast(line if comm.rank == 0 else None)


if __name__ == "__main__":
    serve()
