# SPDX-License-Identifier: LGPL-3.0-or-later
"""Running a script on several ranks, from tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent

needs_mpirun = pytest.mark.skipif(shutil.which("mpirun") is None, reason="mpirun is missing")


def run_on_ranks(count: int, script: Path, *arguments, timeout: float = 600.0) -> str:
    """What a script says that `mpirun` starts, one thread a rank, also on fewer cores.

    Args:
        count: number of ranks.
        script: path of the script.
        arguments: its arguments.
        timeout: seconds after which ranks that wait for each other for ever are ended.
    """
    environment = os.environ | {
        "OPENBLAS_NUM_THREADS": "1",
        "NUMBA_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "PYTHONPATH": os.pathsep.join([str(TESTS.parent), str(TESTS)]),
    }
    # what this process would be in a run of its own
    inherited = ("OMPI_COMM", "PMIX", "PRTE")
    environment = {k: v for k, v in environment.items() if not k.startswith(inherited)}
    command = ["mpirun", "--oversubscribe", "-n", str(count), sys.executable, str(script)]
    done = subprocess.run(
        [*command, *map(str, arguments)],
        env=environment, capture_output=True, text=True, timeout=timeout,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout
