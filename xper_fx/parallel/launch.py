# SPDX-License-Identifier: LGPL-3.0-or-later
"""A script on several ranks: one of them speaks, and an error on any stops all."""

from __future__ import annotations

import os
import sys
import time
import traceback
from collections.abc import Callable

from mpi4py import MPI

# Seconds that a rank leaves to those before it, which may be about to say the same.
_GRACE, _TURN, _LONGEST = 1.0, 0.2, 10.0


def run_together(main: Callable[[], object]) -> None:
    """Run a script's main function on all ranks that were started, as `mpirun` does.

    The first rank alone writes to the terminal. What any rank raises is printed once and ends all
    of them, also those that wait for it; on one rank it is raised as usual.

    Args:
        main: the script.
    """
    comm = MPI.COMM_WORLD
    if comm.size == 1:
        main()
        return
    terminal = sys.stderr
    with open(os.devnull, "w") as nowhere:
        if comm.rank > 0:
            sys.stdout = sys.stderr = nowhere
        try:
            main()
        except Exception:
            if comm.rank > 0:
                time.sleep(min(_GRACE + _TURN * comm.rank, _LONGEST))
            print(f"Rank {comm.rank} of {comm.size} failed:", file=terminal)
            traceback.print_exc(file=terminal)
            terminal.flush()
            comm.Abort(1)
        finally:
            sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
