# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accuracy against time: one scene, run with its parameters turned one way and another.

A `Study` names a function that builds the scene, the settings to try, what to compare, and a
reference: the finest setting or known values. `run_study` makes the runs one after the other, each
in a process of its own, and keeps each result in a file: a study that was interrupted goes on
where it was. `StudyResults` (`results.py`) has errors, tables, the Pareto front and advice,
`plots.py` draws.

    study = Study(
        "plate", plate, end_time=1e-7,
        quantities={"peak stress": PeakStress(gauge)},
        families={"step": vary(default, "courant", [0.35, 0.7, 1.4])},
        default=default, reference=default | {"courant": 0.1, "tolerance": 1e-8},
    )
    print(run_study(study, "results/plate").table())

Results are read by name from files, so processes start afresh ("spawn"): a script that runs
studies guards its main part with `if __name__ == "__main__":`.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.process
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mpi4py import MPI
from tqdm.auto import tqdm

from xper_fx.output.output_folder import prepare_folder
from xper_fx.study.definition import Setting, Study, as_text, varied
from xper_fx.study.process import run_job
from xper_fx.study.results import TIMES, Run, StudyResults
from xper_fx.support.checks import require_kind, require_path, require_positive
from xper_fx.support.ranks import Ranks

# Beginnings of the variables by which launchers tell a process which rank it is.
_OF_RANKS = ("OMPI_COMM", "PMIX_", "PMI_", "PRTE_", "HYDRA_", "MPI_LOCAL")


def run_study(
    study: Study,
    folder: str | Path,
    *,
    time: str = "seconds",
    patience: float | None = None,
    quiet: bool = False,
) -> StudyResults:
    """Make the runs of a study that its folder does not hold yet; of several ranks the first does.

    A run that does not converge or is refused is kept with its reason; one whose process died or
    ran out of patience is in the results, and is tried again by the next call.

    Args:
        study: what to run.
        folder: of the results, one JSON file (and one npz of arrays) a run.
        time: see `StudyResults`.
        patience: seconds after which a run is given up.
        quiet: no progress bar.

    Returns:
        All runs.

    Raises:
        TypeError, ValueError: no study, no folder, another word for the time, no patience.
        OSError: the folder cannot be written.
        RuntimeError: the reference's run failed.
    """
    require_kind("study", study, Study)
    folder = require_path("folder", folder).resolve()
    if time not in TIMES:
        raise ValueError(f"time should be one of {', '.join(TIMES)}, got {time!r}.")
    if patience is not None:
        require_positive("patience", patience)
    team, settings = Ranks(MPI.COMM_WORLD), study.settings()
    paths = [folder / study.key(setting) for setting in settings]
    failures: dict[Path, str | None] = {}

    def make() -> None:
        prepare_folder(folder)
        parameters = varied(settings)
        with tqdm(
            list(zip(settings, paths, strict=True)), desc=study.name, unit="run", disable=quiet
        ) as bar:
            for setting, path in bar:
                bar.set_postfix_str(as_text(setting, parameters))
                if not path.with_suffix(".json").exists():
                    failures[path] = _run_in_process(study, setting, path, patience)

    team.at_root(make)
    failures = team.comm.bcast(failures)
    runs = []
    for setting, path in zip(settings, paths, strict=True):
        families = tuple(name for name, members in study.families.items() if setting in members)
        failure = failures.get(path)
        if failure is None:
            runs.append(Run.read(setting, families, path))
        else:
            runs.append(Run(setting, families, {"status": "failed", "reason": failure}, {}))
    return StudyResults(study, runs, time)


def _run_in_process(
    study: Study, setting: Setting, path: Path, patience: float | None
) -> str | None:
    """Run a setting; why there is no record of it, or None."""
    header = {"study": study.name, "setting": setting}
    process = multiprocessing.get_context("spawn").Process(
        target=run_job, args=(study.job(setting), path, header)
    )
    with _outside_of_ranks():
        process.start()
    try:
        process.join(patience)
        if process.is_alive():
            return f"took more than {patience:g} s"
    finally:
        if process.is_alive():
            process.terminate()
            process.join()
    if not path.with_suffix(".json").exists():
        return f"its process ended with exit status {process.exitcode}"
    return None


@contextmanager
def _outside_of_ranks() -> Iterator[None]:
    """Processes started within do not take themselves for the rank that starts them."""
    hidden = {k: v for k, v in os.environ.items() if k.startswith(_OF_RANKS)}
    for name in hidden:
        del os.environ[name]
    try:
        yield
    finally:
        os.environ.update(hidden)
