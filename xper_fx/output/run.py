# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs a simulation into a folder, with a progress bar; the options that all runs share."""

from __future__ import annotations

import logging
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from signal import Signals

from tqdm.auto import tqdm

from xper_fx.output.recorder import CHECKPOINT_EVERY, Recorder
from xper_fx.output.signals import Interruption
from xper_fx.plotting.figures import plot_profile
from xper_fx.simulation.options import SOLVERS
from xper_fx.simulation.step_record import StepRecord
from xper_fx.support.checks import require_kind, require_positive
from xper_fx.support.profile import profile_table

logger = logging.getLogger(__name__)

# Simulated time, and by the clock what has passed and what is left.
_BAR = (
    "{desc}: {percentage:5.1f} %|{bar}| {n:.3g} of {total:.3g} s [{elapsed}<{remaining}{postfix}]"
)


def add_run_options(parser: ArgumentParser, out: Path, accuracy: float | None = None) -> None:
    """Give a command line the options of a run that no scene changes.

    Args:
        parser: of the command line.
        out: default of the folder for results.
        accuracy: default of the accuracy asked for, None for none.
    """
    if not callable(getattr(parser, "add_argument", None)):
        raise TypeError(f"parser should be an ArgumentParser, got {parser!r}.")
    add = parser.add_argument
    add(
        "--accuracy",
        type=float,
        default=accuracy,
        help="relative error asked for; picks and adapts step and tolerance unless they are given",
    )
    add("--theta", type=float, default=0.5, help="weight of the end of the step, implicit bulk")
    add("--tolerance", type=float, help="relative error of the impulses")
    add("--solver", choices=SOLVERS, default="auto", help="of the interactions")
    add("--threads", type=int, help="of the interaction solver (default: all)")
    add("--fields", type=int, default=20, help="number of times at which fields are written")
    add("--out", type=Path, default=out)
    add(
        "--checkpoint-every",
        type=float,
        default=CHECKPOINT_EVERY,
        metavar="SECONDS",
        help="time between checkpoints; 0 for none",
    )
    add("--restart", action="store_true", help="go on from the checkpoint in the folder")
    add("--profile", action="store_true", help="print and draw what took how long")
    add("--no-plot", action="store_true")
    add("--quiet", action="store_true", help="no progress bar")


def recorded_steps(
    recorder: Recorder, end_time: float, title: str, quiet: bool = False, profile: bool = False
) -> Iterator[tuple[StepRecord, float]]:
    """Advance a recorder's simulation, writing each step; close the recorder at the end.

    On SIGTERM, SIGINT or SIGHUP (the terminal is closed) the run ends after the present step, with
    a checkpoint; a second signal ends it at once.

    Args:
        recorder: records the simulation.
        end_time: when to stop (s).
        title: of the progress bar.
        quiet: no bar.
        profile: print the profile at the end, and draw it into the folder as `profile.png`.

    Yields:
        Each step and the strain of the gauge after it.

    Raises:
        TypeError, ValueError: no recorder, an end time that is not above zero.
        ConvergenceError: as `Simulation.steps`; what was written stays.
        SystemExit: a signal came; its status is 128 and the signal's number.
    """
    require_kind("recorder", recorder, Recorder)
    require_positive("end_time", end_time)
    simulation, interruption = recorder.simulation, Interruption()
    made, first = 0, simulation.time
    bar = tqdm(
        total=end_time, initial=min(first, end_time), desc=title, bar_format=_BAR, disable=quiet
    )  # fmt: skip
    with recorder, bar, interruption:
        for made, step in enumerate(simulation.steps(end_time), start=1):  # noqa: B007 - told below
            strain, _ = recorder.record(step)
            bar.update(min(step.time, end_time) - bar.n)
            error = abs(step.energies["closure"]) / max(step.energies["external_work"], 1e-300)
            bar.set_postfix(sweeps=step.sweeps, energy_error=f"{error:.0e}", refresh=False)
            yield step, strain
            number = int(simulation.team.max(interruption.number))
            if number:
                path = recorder.checkpoint()
                with suppress(OSError):  # the terminal may be gone
                    tqdm.write(
                        f"{title}: ended by {Signals(number).name} at {simulation.time:.6g} s, "
                        f"saved in {path}; the same command with --restart "
                        "(Recorder(restart=True)) goes on from there",
                        file=sys.stderr,
                    )
                raise SystemExit(128 + number)
        found = simulation.verdict()
        if found is not None and found.reached and not quiet:  # else a warning has told
            tqdm.write(f"{title}: {found.text}")
        if recorder.restarted and not made:
            logger.warning("%s: complete until %g s, there is nothing left to do", title, first)
        elif recorder.checkpoint_every > 0.0:
            recorder.checkpoint()
    if profile:
        rows = simulation.stopwatch.rows()
        tqdm.write(f"\n{title}\n{profile_table(rows)}")
        plot_profile(rows, recorder.folder / "profile.png", title)
