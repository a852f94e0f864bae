# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks that run one script after another, so that libraries and kernels are loaded once.

The first rank reads lines of JSON, `[SCRIPT, ARGUMENT, ...]`, and writes one that is `DONE` when
all ranks have run it. Where a script raises, all end.
"""

from __future__ import annotations

import gc
import json
import runpy
import sys
import time
import traceback
from pathlib import Path

from mpi4py import MPI

DONE = "all ranks have run it"
# A rank that waits in MPI polls: it would take its share of a core.
_PAUSE = 0.01
_TESTS = str(Path(__file__).parents[1])


def serve() -> None:
    """Run what is asked for until the input ends."""
    comm = MPI.COMM_WORLD.Dup()
    while (line := _next_line(comm)) is not None:
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


def _next_line(comm: MPI.Comm) -> str | None:
    """The same on all ranks, None at the end."""
    if comm.rank > 0:
        while not comm.Iprobe(source=0):
            time.sleep(_PAUSE)
        return comm.recv(source=0)
    line = sys.stdin.readline() or None
    for rank in range(1, comm.size):
        comm.send(line, rank)
    return line


if __name__ == "__main__":
    serve()
