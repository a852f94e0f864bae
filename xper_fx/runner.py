# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs a simulation into a folder, with a progress bar."""

from __future__ import annotations

from collections.abc import Iterator

from tqdm.auto import tqdm

from xper_fx.recorder import Recorder
from xper_fx.simulation import StepRecord


def recorded_steps(
    recorder: Recorder, end_time: float, title: str, quiet: bool = False
) -> Iterator[tuple[StepRecord, float]]:
    """Advance a recorder's simulation, writing each step; close the recorder at the end.

    Args:
        recorder: records the simulation.
        end_time: when to stop (s).
        title: of the progress bar.
        quiet: no bar.

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
