# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies that all ranks divide anew again and again; the first writes what came out."""

import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import scenes
import touching_bodies
from asked_scenes import run_asked
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import moving_load

from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.parallel import rebalancing
from xper_fx.parallel.launch import run_together
from xper_fx.scene.joints import Hinge
from xper_fx.simulation.simulation import Simulation

LAST = 16  # step of runs that are recorded
# A step has no work but what is counted; bodies are partitioned at each look.
SMALL = {"_STEP": 0, "_EXCHANGES": 0}
AT_EACH_LOOK = SMALL | {"_LOOKS_EVERY": 4, "_PRICE": -1.0, "_WORTH": -np.inf}
# In steps 7 and 13.
TWICE = AT_EACH_LOOK | {"_LOOKS_EVERY": 3, "_PRICE": 0.3}


def run(name: str) -> dict[str, np.ndarray]:
    """A scene of `touching_bodies`, and how often its bodies were partitioned; or the pile."""
    if name == "pile":
        with patch.multiple(rebalancing, **SMALL, _PRICE=10.0):
            return moving_load.run(6, 1, 160, 160)
    if name == "hinged":
        return hinged()
    partition = rebalancing.partition_bodies
    with (
        patch.multiple(rebalancing, **AT_EACH_LOOK),
        patch.object(rebalancing, "partition_bodies", wraps=partition) as calls,
    ):
        return touching_bodies.run(name) | {"partitions": calls.call_count}


def hinged() -> dict[str, np.ndarray]:
    """A run goes on with a hinge between spheres that two ranks had."""
    scene, options, _ = touching_bodies.pelted()
    first = Simulation(scene, **options)
    for _ in first.steps(4 * first.step_size):
        pass
    share = first.model.rigid_share
    ranks = np.zeros(2) if share is None else share.rank_of_body[:2]
    hinge = Hinge(scene.rigid[:2], at=(0.5, 0.5, 0.5), axis=(0.0, 0.0, 1.0))
    second = Simulation(replace(scene, joints=[hinge], after=first.snapshot()), **options)
    for _ in second.steps(8 * second.step_size):
        pass
    return {"ranks": ranks, "solids": second.rigid.state.velocity}


def record(folder: str, last: int, restart: bool) -> None:
    """Run plates that break up to a step, or go on to it; the folder's name says how meshed."""
    if "spread" in folder:
        scenes.COMM = MPI.COMM_WORLD
    scene, options, _ = touching_bodies.explicit_shards()
    scenes.COMM = MPI.COMM_SELF
    with patch.multiple(rebalancing, **TWICE):
        simulation = Simulation(scene, **options)
        end = LAST * simulation.step_size
        recorder = Recorder(
            simulation, folder, end_time=end, fields=6, fragments=True, restart=restart
        )
        part = simulation.part
        for step, _ in recorded_steps(recorder, last * simulation.step_size, "run", quiet=True):
            if simulation.part is not part:
                part = simulation.part
                print("divided anew in step", step.step)


if __name__ == "__main__":
    run_together(lambda: run_asked(run, record))
