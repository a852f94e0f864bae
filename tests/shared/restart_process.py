# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that are interrupted, each in a process of its own; prints what became of them as JSON.

A process that has compiled everything forks the runs, which are then quick to start. Usage:
`restart_process.py FOLDER`.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
from collections.abc import Callable
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parent))

from scenes import LEFT, RIGHT, box_bodies  # noqa: E402

from xper_fx.forms.loads import PrescribedVelocity  # noqa: E402
from xper_fx.materials import LinearElastic  # noqa: E402
from xper_fx.nscd.laws import CohesiveZone  # noqa: E402
from xper_fx.output.gauges import TensileGauge  # noqa: E402
from xper_fx.output.hdf5_tree import read_tree  # noqa: E402
from xper_fx.output.recorder import Recorder  # noqa: E402
from xper_fx.output.run import recorded_steps  # noqa: E402
from xper_fx.scene.scene import Scene  # noqa: E402
from xper_fx.simulation.simulation import Simulation  # noqa: E402

# The lock of tqdm is one for all forked processes: a run killed while it holds it stops the rest.
tqdm.set_lock(threading.RLock())

STEP, STEPS, FIELDS, KILLS = 0.02, 200, 66, 6
ALWAYS, NEVER = 1e-9, 1e9  # seconds between checkpoints
GOES_ON = 12  # steps that a run makes at most between what it says and its death


def run(folder: Path, at_step: Callable[[], object] | None = None, **options) -> None:
    """A bar of two halves that is pulled until its bond breaks; something is done at each step."""
    bodies = box_bodies((2.0, 1.0), (2, 1), label=lambda x: x[0] > 1.0)
    scene = Scene(
        bodies,
        {1: LinearElastic(young=1.0, poisson=0.3, density=1.0)},
        default_interaction=CohesiveZone(10.0, 1e-4, 1e-2),
        loads=[PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 0.01)],
    )
    simulation = Simulation(scene, STEP, num_threads=1, solver="nlgs")
    gauge = TensileGauge(LEFT, RIGHT, 0, 2.0, 1.0)
    end = STEP * STEPS
    recorder = Recorder(simulation, folder, end_time=end, gauge=gauge, fields=FIELDS, **options)
    for _ in recorded_steps(recorder, end, "bar", quiet=True):
        if at_step is not None:
            at_step()


def start(folder: Path, first: Callable[[], object] | None = None, **options) -> int:
    """A run in a new process, which does something first; its number."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
        if first is not None:
            first()
        with open(folder.with_suffix(".log"), "ab", buffering=0) as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        run(folder, **options)
        status = 0
    except SystemExit as end:
        status = end.code
    finally:
        sys.stderr.flush()
        os._exit(status)


def status_of(child: int) -> int:
    """Wait for the end of a process: its status, or minus the signal that killed it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def lines(folder: Path) -> int:
    """Steps in a history."""
    path = folder / "history.csv"
    return path.read_bytes().count(b"\n") - 1 if path.exists() else 0


def calls_of(work: Callable[[], object]) -> int:
    """Functions that are called, and left, in some work."""
    calls = 0

    def note(*_) -> None:
        nonlocal calls
        calls += 1

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return calls


def killed_after(calls: int) -> None:
    """Let this process kill itself once it has called so many functions."""
    left = count(calls, -1)

    def note(*_) -> None:
        if next(left) <= 0:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.setprofile(note)


def killed_at(folder: Path, step: int, **options) -> int:
    """Kill a run that says that it has made a step and goes on, for some steps at most; its status.

    The moment is any, however busy the machine is.
    """
    told, telling = os.pipe()
    never, _open = os.pipe()
    steps = count(1)

    def tell() -> None:
        made = next(steps)
        if made == step:
            os.write(telling, b"!")
        elif made == step + GOES_ON:
            os.read(never, 1)

    child = start(folder, at_step=tell, **options)
    os.read(told, 1)
    os.kill(child, signal.SIGKILL)
    status = status_of(child)
    for end in (told, telling, never, _open):
        os.close(end)
    return status


def at(number: int, then: Callable[[], object]) -> Callable[[], object]:
    """Something to call at each step, which does something at one of them."""
    steps = count(1)
    return lambda: then() if next(steps) == number else None


def kill_often(folder: Path, setup: int) -> dict:
    """Kill a run at random moments, restart it each time, and let the last one end.

    Every third is killed before its first step. Of the others every second has written lines that
    no checkpoint knows.

    Args:
        folder: of the run.
        setup: functions that are called in a run before its first step.
    """
    rng = np.random.default_rng(8)
    reached, saved, statuses = [], [], []
    for number in range(KILLS):
        options = {"restart": True, "checkpoint_every": NEVER if number % 2 else ALWAYS}
        if number % 3 == 2:
            calls = int(rng.uniform(0.1, 0.9) * setup)
            statuses.append(status_of(start(folder, partial(killed_after, calls), **options)))
        else:
            statuses.append(killed_at(folder, int(rng.integers(1, 40)), **options))
        reached.append(lines(folder))
        path = folder / "checkpoint.h5"
        saved.append(read_tree(path)["simulation"]["step_number"] if path.exists() else 0)
    last = status_of(start(folder, restart=True))
    return {"reached": reached, "saved": saved, "statuses": statuses, "last": last}


def signalled(folder: Path, number: int, times: int = 1) -> dict:
    """Send a signal to a run that stands still after five steps, then restart it."""
    told, telling = os.pipe()
    waited_for, go_on = os.pipe()

    def stand_still() -> None:
        os.write(telling, b"!")
        os.read(waited_for, 1)

    child = start(folder, at_step=at(5, stand_still))
    os.read(told, 1)
    for time in range(times):
        os.kill(child, number)
        while time + 1 < times and handles(child, number):  # until it has noted this one
            os.sched_yield()
    os.write(go_on, b"!")
    out = {"status": status_of(child), "steps": lines(folder)}
    out["saved"] = (folder / "checkpoint.h5").exists()
    if times == 1:
        out["after"] = status_of(start(folder, restart=True))
    return out


def handles(process: int, number: int) -> bool:
    """Whether a process has a handler of a signal, which it gives up at the first."""
    rows = dict(row.split(":", 1) for row in Path(f"/proc/{process}/status").open())
    return bool(int(rows["SigCgt"], 16) >> (number - 1) & 1)


if __name__ == "__main__":
    where = Path(sys.argv[1])
    # `nohup` ignores the first, a shell the second for what it starts in the background
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    run(where / "whole")
    complete = start(where / "whole", restart=True)
    result = {
        "complete": status_of(complete),
        "killed": kill_often(
            where / "killed", calls_of(lambda: run(where / "whole", restart=True))
        ),
        "terminated": signalled(where / "terminated", signal.SIGTERM),
        "interrupted": signalled(where / "interrupted", signal.SIGINT),
        "hung_up": signalled(where / "hung_up", signal.SIGHUP),
        "twice": signalled(where / "twice", signal.SIGTERM, 2),
    }
    print(json.dumps(result))
