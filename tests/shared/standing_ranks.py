# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ranks that run one script after another, so that libraries and kernels are loaded once.

The first rank reads lines of JSON, `[SCRIPT, ARGUMENT, ...]`, and each rank writes `DONE` when it
has run it. Where a script raises, all end. The others read each line from a pipe of
their own: a rank that waits in MPI polls, and would take its share of a core.
"""

from __future__ import annotations

import gc
import json
import os
import runpy
import shutil
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path

from mpi4py import MPI

DONE = "this rank has run it"
_TESTS = str(Path(__file__).parents[1])


def serve() -> None:
    """Run what is asked for until the input ends."""
    comm = MPI.COMM_WORLD.Dup()
    for line in _lines(comm):
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
        print(DONE, flush=True)


def _lines(comm: MPI.Comm) -> Iterator[str]:
    """Those of the first rank's input, on all ranks."""
    folder = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None))
    own = folder / str(comm.rank)
    os.mkfifo(own)
    comm.Barrier()
    if comm.rank > 0:
        with own.open() as pipe:
            yield from pipe
        return
    pipes = [(folder / str(rank)).open("w") for rank in range(1, comm.size)]
    shutil.rmtree(folder)
    for line in sys.stdin:
        for pipe in pipes:
            print(line, end="", file=pipe, flush=True)
        yield line
    for pipe in pipes:
        pipe.close()


if __name__ == "__main__":
    serve()
