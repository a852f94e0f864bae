# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs a simulation into a folder, with a progress bar; the options that all runs share."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Iterator
from pathlib import Path

from tqdm.auto import tqdm

from xper_fx.plots import plot_profile
from xper_fx.profile import profile_table
from xper_fx.recorder import Recorder
from xper_fx.simulation import SOLVERS, StepRecord


def add_run_options(parser: ArgumentParser, out: Path, accuracy: float | None = None) -> None:
    """Give a command line the options of a run that no scene changes.

    Args:
        parser: of the command line.
        out: default of the folder for results.
        accuracy: default of the accuracy asked for, None for none.
    """
    add = parser.add_argument
    add(
        "--accuracy", type=float, default=accuracy,
        help="relative error asked for; picks and adapts step and tolerance unless they are given",
    )  # fmt: skip
    add("--theta", type=float, default=0.5, help="weight of the end of the step, implicit bulk")
    add("--tolerance", type=float, help="relative error of the impulses")
    add("--solver", choices=SOLVERS, default="auto", help="of the interactions")
    add("--threads", type=int, help="of the interaction solver (default: all)")
    add("--fields", type=int, default=20, help="number of times at which fields are written")
    add("--out", type=Path, default=out)
    add("--profile", action="store_true", help="print and draw what took how long")
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")


def recorded_steps(
    recorder: Recorder, end_time: float, title: str, quiet: bool = False, profile: bool = False
) -> Iterator[tuple[StepRecord, float]]:
    """Advance a recorder's simulation, writing each step; close the recorder at the end.

    Args:
        recorder: records the simulation.
        end_time: when to stop (s).
        title: of the progress bar.
        quiet: no bar.
        profile: print the profile at the end, and draw it into the folder as `profile.png`.

    Yields:
        Each step and the strain of the gauge after it.

    Raises:
        ConvergenceError: as `Simulation.steps`; what was written stays.
    """
    with recorder, tqdm(total=100.0, desc=title, unit="%", disable=quiet) as bar:
        for step in recorder.simulation.steps(end_time):
            strain, _ = recorder.record(step)
            bar.update(min(100.0 * step.time / end_time, 100.0) - bar.n)
            error = abs(step.energies["closure"]) / max(step.energies["external_work"], 1e-300)
            bar.set_postfix(sweeps=step.sweeps, energy_error=f"{error:.0e}", refresh=False)
            yield step, strain
    if profile:
        rows = recorder.simulation.stopwatch.rows()
        tqdm.write(f"\n{title}\n{profile_table(rows)}")
        plot_profile(rows, recorder.folder / "profile.png", title)
