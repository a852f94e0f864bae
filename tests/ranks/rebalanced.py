# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies that all ranks divide anew again and again; the first writes what came out."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import scenes
import touching_bodies
from asked_scenes import run_asked
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import moving_load

from xper_fx.output import checkpoint
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.parallel import rebalancing, spread_rebalancing
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
    if name == "again":
        return again()
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


@contextmanager
def to_and_fro() -> Iterator[None]:
    """Let bodies of spread meshes go to the other end of the ranks every four steps."""
    bisected = spread_rebalancing.bisected

    def turned(ranks, x, work):
        mean = ranks.sum(x[:, 0].sum()) / ranks.sum(len(x))
        first_is_left = ranks.comm.bcast(x[:, 0].mean()) < mean
        return bisected(ranks, -x if first_is_left else x, work)

    with (
        patch.multiple(rebalancing, **AT_EACH_LOOK),
        patch.object(spread_rebalancing, "bisected", turned),
    ):
        yield


def spread_plates() -> Simulation:
    """Plates that break, of a mesh that is spread over all ranks and made anew."""
    scenes.COMM = MPI.COMM_WORLD
    scene, options, _ = touching_bodies.explicit_shards()
    scenes.COMM = MPI.COMM_SELF
    return Simulation(scene, **options)


def again() -> dict[str, np.ndarray]:
    """Energies of bodies that go to and fro; of runs that go on, before and after a division."""
    found: dict[str, list] = {}
    with to_and_fro(), TemporaryDirectory() as own:
        base, simulation = Path(MPI.COMM_WORLD.bcast(own)), spread_plates()
        for record in simulation.steps(LAST * simulation.step_size):
            found.setdefault("whole", []).append(list(record.energies.values()))
            if record.step in (8, 10):
                checkpoint.save(base / f"{record.step}.h5", simulation)
        for step in (8, 10):
            simulation = spread_plates()
            checkpoint.restore(base / f"{step}.h5", simulation)
            for record in simulation.steps(LAST * simulation.step_size):
                found.setdefault(f"from_{step}", []).append(list(record.energies.values()))
    return {name: np.array(energies) for name, energies in found.items()}


def record(folder: str, last: int, restart: bool) -> None:
    """Run plates that break up to a step, or go on to it; the folder's name says how meshed."""
    spread = folder.endswith("spread")
    scene, options, _ = touching_bodies.explicit_shards()
    with to_and_fro() if spread else patch.multiple(rebalancing, **TWICE):
        simulation = spread_plates() if spread else Simulation(scene, **options)
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
