# SPDX-License-Identifier: LGPL-3.0-or-later
"""One run of a study, in a process of its own, so that its memory and time are its own.

What is timed is the stepping alone. Before it a simulation of the same scene makes two steps and
is thrown away, so that forms and kernels are compiled; what Numba still compiles later, when a run
first meets a contact or another solver, is timed by Numba's own events and taken off.
"""

from __future__ import annotations

import gc
import resource
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numba.core.event import install_listener

from xper_fx.cache.compiling import KIND, CompilationListener
from xper_fx.output.effects import effects_of
from xper_fx.output.recorder import Recorder
from xper_fx.output.summary import write_summary
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.study.quantities import EnergyClosure, Quantity
from xper_fx.support.errors import ConvergenceError

_WARM_UP = 2


@dataclass(frozen=True)
class Job:
    """What one process does."""

    build: Callable[..., Scene]  #: makes the scene from `scene_parameters`
    scene_parameters: Mapping[str, Any]  #: of `build`
    simulation_parameters: Mapping[str, Any]  #: of `Simulation`
    #: step over the critical step of the scene's explicit bulk, None to leave it
    courant: float | None
    fields: int  #: number of times at which fields are written while time is measured
    end_time: float  #: s
    quantities: Mapping[str, Quantity]  #: by name


class _Compiling(CompilationListener):
    """Seconds that Numba compiles, of the wall and of the processor."""

    def __init__(self) -> None:
        super().__init__()
        self.wall = self.cpu = 0.0

    def begin(self) -> None:
        self._begin = perf_counter(), process_time()

    def end(self) -> None:
        self.wall += perf_counter() - self._begin[0]
        self.cpu += process_time() - self._begin[1]


def run_job(job: Job, path: Path, header: Mapping[str, Any]) -> None:
    """Run a job and write `path`.json, and `path`.npz if there are arrays; at once or not at all.

    Args:
        job: what to run.
        path: of the files, without suffix.
        header: written into the record beside what is measured.
    """
    try:
        record, arrays = _measure(job)
        if arrays:
            partial = path.with_suffix(".partial.npz")
            np.savez(partial, **arrays)
            partial.replace(path.with_suffix(".npz"))
        write_summary(path.with_suffix(".json"), header | record)
    except (ConvergenceError, ValueError) as error:
        failure = {"status": "failed", "reason": f"{type(error).__name__}: {error}"}
        write_summary(path.with_suffix(".json"), header | failure)


def _measure(job: Job) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The record of a run, and its arrays by "quantity: name"."""
    step = _warm_up(job)
    gc.collect()
    begin = perf_counter()
    scene = job.build(**job.scene_parameters)
    simulation = Simulation(scene, **(dict(job.simulation_parameters) | step))
    set_up = perf_counter() - begin
    watched = {**job.quantities, "": EnergyClosure()}
    seen: dict[str, Any] = dict.fromkeys(watched)
    totals = {"steps": 0, "sweeps": 0, "newton_iterations": 0}
    wall = cpu = 0.0
    compiling = _Compiling()
    with tempfile.TemporaryDirectory() as folder, install_listener(KIND, compiling):
        recorder = (
            Recorder(simulation, folder, end_time=job.end_time, fields=job.fields)
            if job.fields
            else None
        )
        with recorder or nullcontext():
            steps = simulation.steps(job.end_time)
            while True:
                begin = perf_counter(), process_time()
                record = next(steps, None)
                if record is not None and recorder is not None:
                    recorder.record(record)
                wall += perf_counter() - begin[0]
                cpu += process_time() - begin[1]
                if record is None:
                    break
                totals["steps"] += 1
                totals["sweeps"] += record.sweeps
                totals["newton_iterations"] += record.newton_iterations
                for name, quantity in watched.items():
                    seen[name] = quantity.observe(simulation, record, seen[name])
    values = {name: q.value(simulation, seen[name]) for name, q in watched.items()}
    closure = values.pop("")
    arrays = {
        f"{name}: {part}": array
        for name, value in values.items()
        if isinstance(value, Mapping)
        for part, array in value.items()
    }
    measured = {
        "status": "done",
        "seconds": wall - compiling.wall,
        "cpu_seconds": cpu - compiling.cpu,
        "set_up_seconds": set_up,
        "peak_memory": peak_memory(),
        "array_bytes": sum(effect.memory for effect in effects_of(simulation)),
        "step_size": simulation.step_size,
        **totals,
        "closure": closure,
        "estimated_error": simulation.estimated_error,
        "values": {k: float(v) for k, v in values.items() if not isinstance(v, Mapping)},
    }
    return measured, arrays


def _warm_up(job: Job) -> dict[str, float]:
    """Make two steps so that everything is compiled.

    Returns:
        The step as `Simulation` takes it: a whole number of steps, not longer than asked for, ends
        at the end time, so that runs compare at the same time. Nothing if the simulation picks its
        steps itself.
    """
    parameters = dict(job.simulation_parameters)
    scene = job.build(**job.scene_parameters)
    if job.courant is not None:
        parameters["step"] = job.courant * Simulation(scene).bulk.critical_step()
    simulation = Simulation(scene, **parameters)
    size = simulation.step_size
    for _ in simulation.steps(min(_WARM_UP * size, job.end_time)):
        pass
    if parameters.get("accuracy") is not None and parameters.get("step") is None:
        return {}
    return {"step": job.end_time / ceil(job.end_time / size - 1e-9)}


def peak_memory() -> int:
    """Largest resident memory of this process (bytes).

    Linux keeps the parent's peak in `getrusage` of a process that it started; `VmHWM` is this
    process's own.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
