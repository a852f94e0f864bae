# SPDX-License-Identifier: LGPL-3.0-or-later
"""A script on several ranks: one of them speaks, and an error on any stops all."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable

from mpi4py import MPI

from xper_fx.support.compiling_note import note_compiling
from xper_fx.support.ranks import Ranks, end_all


def run_together(main: Callable[[], object]) -> None:
    """Run a script's main function on all ranks that were started, as `mpirun` does.

    The first rank alone writes to the terminal. What any rank raises is printed once and ends all
    of them, also those that wait for it; on one rank it is raised as usual. Where nobody reads what
    the script prints any more (`| head -1`), it ends with the status of SIGPIPE.

    Args:
        main: the script.

    Raises:
        TypeError: no function.
    """
    if not callable(main):
        raise TypeError(f"main should be a function without arguments, got {main!r}.")
    note_compiling()
    comm = MPI.COMM_WORLD
    if comm.size == 1:
        _run_alone(main)
        return
    terminal = sys.stderr
    with open(os.devnull, "w") as nowhere:
        if comm.rank > 0:
            sys.stdout = sys.stderr = nowhere
        try:
            main()
        except SystemExit:
            Ranks(comm).end_unless_all_fail()
            raise
        except BaseException:
            end_all(comm, terminal)
        finally:
            sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__


def _run_alone(main: Callable[[], object]) -> None:
    """Run a script's main function on the one rank there is."""
    try:
        main()
        sys.stdout.flush()
    except BrokenPipeError:
        # what is still to be printed goes nowhere, also when Python ends
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        raise SystemExit(128 + signal.SIGPIPE) from None
