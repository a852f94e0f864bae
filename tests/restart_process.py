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
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from scenes import LEFT, RIGHT, box_bodies  # noqa: E402

from xper_fx.forms.loads import PrescribedVelocity  # noqa: E402
from xper_fx.materials import LinearElastic  # noqa: E402
from xper_fx.nscd.laws import CohesiveZone  # noqa: E402
from xper_fx.recorder import Recorder, TensileGauge  # noqa: E402
from xper_fx.restart.tree_file import read_tree  # noqa: E402
from xper_fx.runner import recorded_steps  # noqa: E402
from xper_fx.scene import Scene  # noqa: E402
from xper_fx.simulation import Simulation  # noqa: E402

STEP, STEPS, FIELDS, KILLS = 0.02, 300, 100, 20


def run(folder: Path, pause: float = 0.0, **options) -> None:
    """A bar of two halves that is pulled until its bond breaks."""
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
        time.sleep(pause)


def start(folder: Path, **options) -> int:
    """A run in a new process; its number."""
    child = os.fork()
    if child:
        return child
    status = 1
    try:
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


def kill_often(folder: Path, setup: float) -> dict:
    """Kill a run at random moments, restart it each time, and let the last one end.

    Args:
        folder: of the run.
        setup: time that a run takes before its first step (s).
    """
    rng = np.random.default_rng(8)
    reached, saved, statuses = [], [], []
    for _ in range(KILLS):
        child = start(folder, pause=3e-3, restart=True, checkpoint_every=0.02)
        time.sleep(rng.uniform(0.5, 2.0) * setup)
        os.kill(child, signal.SIGKILL)
        statuses.append(status_of(child))
        reached.append(lines(folder))
        path = folder / "checkpoint.h5"
        saved.append(read_tree(path)["simulation"]["step_number"] if path.exists() else 0)
    last = status_of(start(folder, restart=True))
    return {"reached": reached, "saved": saved, "statuses": statuses, "last": last}


def signalled(folder: Path, number: int, times: int = 1) -> dict:
    """Send a signal to a run after some steps, then restart it."""
    child = start(folder, pause=0.2 if times > 1 else 2e-3)
    while lines(folder) < 5:
        time.sleep(1e-3)
    for _ in range(times):
        os.kill(child, number)
        time.sleep(0.02)
    out = {"status": status_of(child), "steps": lines(folder)}
    out["saved"] = (folder / "checkpoint.h5").exists()
    if times == 1:
        out["after"] = status_of(start(folder, restart=True))
    return out


if __name__ == "__main__":
    where = Path(sys.argv[1])
    run(where / "whole")
    began = time.monotonic()
    complete = status_of(start(where / "whole", restart=True))
    result = {
        "complete": complete,
        "killed": kill_often(where / "killed", time.monotonic() - began),
        "terminated": signalled(where / "terminated", signal.SIGTERM),
        "interrupted": signalled(where / "interrupted", signal.SIGINT),
        "twice": signalled(where / "twice", signal.SIGTERM, 2),
    }
    print(json.dumps(result))
