# SPDX-License-Identifier: LGPL-3.0-or-later
"""What scripts of `tests/ranks/` do with their arguments; `on_ranks.runs_of` gives them."""

import sys
from collections.abc import Callable

import numpy as np
from mpi4py import MPI


def run_asked(run: Callable[[str], dict], record: Callable[[str, int, bool], None]) -> None:
    """Run the scenes that the command line names, and record those that it gives a last step.

    The arguments are a folder, then `NAME`, whose arrays go to `NAME.npz` there, `FOLDER=STEP`, a
    run that is recorded in a folder below up to a step, and `restart`, with which that goes on.

    Args:
        run: arrays of a scene by its name.
        record: takes the folder, the last step, and whether to go on.
    """
    base, *asked = sys.argv[1:]
    for argument in asked:
        if "=" in argument:
            folder, last = argument.rsplit("=", 1)
            record(f"{base}/{folder}", int(last), "restart" in asked)
        elif argument != "restart":
            found = run(argument)
            if MPI.COMM_WORLD.rank == 0:
                np.savez(f"{base}/{argument}.npz", **found)
