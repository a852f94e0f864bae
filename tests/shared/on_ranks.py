# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scripts run by several MPI processes."""

import atexit
import json
import os
import shutil
import subprocess
import sys
import threading
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import standing_ranks

# Whether the present test is marked `ranks`; tests/conftest.py says so.
marked = True
FOLDER = Path(__file__).parents[1]
# Ranks that have run scripts and wait for the next, of which each takes the first few: one at most.
_standing: list[subprocess.Popen] = []
MOST_RANKS = 4
# Seconds after which a script is stopped.
_PATIENCE = 1800.0
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


def _require_ranks() -> None:
    if not marked:
        raise RuntimeError("This test runs mpirun: mark it with `pytest.mark.ranks`.")
    if shutil.which("mpirun") is None:
        pytest.skip("mpirun is not installed")


def _start(count: int, *command, **options) -> subprocess.Popen:
    """Run Python on `count` ranks, its output as text."""
    paths = [
        FOLDER.parent,
        FOLDER / "shared",
        FOLDER.parent / "demos",
        os.environ.get("PYTHONPATH", ""),
    ]
    return subprocess.Popen(
        list(map(str, ["mpirun", "-n", count, sys.executable, *command])), text=True,
        env=os.environ | _SETTINGS | {"PYTHONPATH": os.pathsep.join(map(str, paths))},
        stdout=subprocess.PIPE, preexec_fn=_take_one_core, **options,
    )  # fmt: skip


def on_new_ranks(count: int, script: Path, *arguments, timeout: float = _PATIENCE):
    """Run a Python script on ranks of its own, of which one may fail.

    Args:
        count: number of ranks.
        script: path, relative to the tests' folder or absolute.
        arguments: of the script.
        timeout: seconds after which it is stopped.

    Returns:
        The completed process with its output as text.
    """
    _require_ranks()
    with _start(count, FOLDER / script, *arguments, stderr=subprocess.PIPE) as process:
        try:
            out, error = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.terminate()  # mpirun then ends its ranks; a kill would leave them
            process.communicate()
            raise
    return subprocess.CompletedProcess(process.args, process.returncode, out, error)


def on_ranks(count: int, script: Path, *arguments):
    """Run a Python script on ranks that have run others before, and will run the next.

    Args:
        count: number of ranks, `MOST_RANKS` at most.
        script: path, relative to the tests' folder or absolute.
        arguments: of the script.

    Returns:
        The completed process with all its output as text; of one that has failed, that of the
        ranks, which have ended.
    """
    _require_ranks()
    ranks = _standing_ranks()
    command = [count, str(FOLDER / script), *map(str, arguments)]
    stop = threading.Timer(_PATIENCE, ranks.terminate)
    stop.start()
    out, end, status = "", f"{standing_ranks.DONE}\n", 0
    try:
        print(json.dumps(command), file=ranks.stdin, flush=True)
        while not out.endswith(end):  # a script may leave its last line open
            if not (line := ranks.stdout.readline()):  # they have ended: the next script has others
                status = _end(ranks)
                break
            out += line
    except BaseException:  # as of Ctrl-C: what they do is not asked for any more
        ranks.terminate()
        _end(ranks)
        raise
    finally:
        stop.cancel()
    return subprocess.CompletedProcess(command, status, out.removesuffix(end), "")


def _standing_ranks() -> subprocess.Popen:
    if not _standing or _standing[0].poll() is not None:
        _dismiss()
        options = {"stdin": subprocess.PIPE, "stderr": subprocess.STDOUT}
        _standing.append(_start(MOST_RANKS, standing_ranks.__file__, **options))
    return _standing[0]


@atexit.register
def _dismiss() -> None:
    while _standing:
        _end(_standing.pop())


def _end(ranks: subprocess.Popen) -> int:
    """Ask for no more; what the ranks exit with."""
    with suppress(BrokenPipeError):  # of ranks that have ended
        ranks.stdin.close()
    with ranks:
        if not ranks.stdout.closed:
            ranks.stdout.read()
    return ranks.returncode


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
        assert done.returncode == 0, done.stdout
        assert "simulates the whole scene" not in done.stdout
        return dict(np.load(folder / f"{name}.npz"))

    return found
