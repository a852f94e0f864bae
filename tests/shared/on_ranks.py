# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scripts run by several MPI processes."""

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

# Whether the present test is marked `ranks`; tests/conftest.py says so.
marked = True
FOLDER = Path(__file__).parents[1]
# More ranks than cores, as the tests are one of several things that a machine does.
_SETTINGS = {
    "OMPI_MCA_rmaps_base_oversubscribe": "true",
    "OMPI_MCA_mpi_yield_when_idle": "true",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    "PRTE_MCA_hwloc_default_binding_policy": "none",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "NUMBA_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}


def _take_one_core() -> None:
    """Leave the other cores to the other workers: a rank that waits for another one polls.

    On one core ranks yield to each other at once; beside a worker they would wait for its slice of
    time at each message.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is not None:
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[int(worker.removeprefix("gw")) % len(cores)]})


def on_ranks(count: int, script: Path, *arguments, timeout: float = 1800.0):
    """Run a Python script on `count` ranks.

    Args:
        count: number of ranks.
        script: path, relative to the tests' folder or absolute.
        arguments: of the script.
        timeout: seconds after which it is stopped.

    Returns:
        The completed process with its output as text.
    """
    if not marked:
        raise RuntimeError("This test runs mpirun: mark it with `pytest.mark.ranks`.")
    if shutil.which("mpirun") is None:
        pytest.skip("mpirun is not installed")
    paths = [
        FOLDER.parent,
        FOLDER / "shared",
        FOLDER.parent / "demos",
        os.environ.get("PYTHONPATH", ""),
    ]
    environment = os.environ | _SETTINGS | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    command = ["mpirun", "-n", count, sys.executable, FOLDER / script, *arguments]
    with subprocess.Popen(
        list(map(str, command)), env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=_take_one_core,
    ) as process:  # fmt: skip
        try:
            out, error = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.terminate()  # mpirun then ends its ranks; a kill would leave them
            process.communicate()
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, error)


def runs_of(script: Path, scenes: dict[int, tuple[str, ...]], run_alone, factory):
    """What scenes give on numbers of ranks; those of as many ranks share one start.

    Args:
        script: writes `NAME.npz` into the folder of its first argument for each other argument.
        scenes: names of the scenes that are run on a number of ranks.
        run_alone: what the script does for a name, on one rank.
        factory: `tmp_path_factory`.

    Returns:
        `found(name, count, number=1)`, arrays by name; with another `number` the scene runs again.
    """

    @cache  # one that fails is not run again for the next test
    def run_all(names: tuple[str, ...], count: int, number: int):
        folder = factory.mktemp(f"{Path(script).stem}_{count}_{number}")
        return folder, on_ranks(count, script, folder, *names)

    @cache
    def found(name: str, count: int, number: int = 1) -> dict[str, np.ndarray]:
        if count == 1:
            return run_alone(name)
        names = scenes[count] if number == 1 else (name,)
        folder, done = run_all(names, count, number)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "simulates the whole scene" not in done.stdout + done.stderr
        return dict(np.load(folder / f"{name}.npz"))

    return found
