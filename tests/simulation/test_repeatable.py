# SPDX-License-Identifier: LGPL-3.0-or-later
"""The same run twice leaves the same files, to the bit, but for the times in its summary.

Twice in a process, and in another with another seed of Python's hashes; by two threads.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, box_bodies

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle
from xper_fx.forms.loads import Gravity, PrescribedVelocity
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.nscd.laws import CohesiveZone, SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, RigidBody, wall
from xper_fx.output.recorder import Recorder
from xper_fx.output.summary import TIMING_KEYS, without_times
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

SOLID = LinearElastic(100.0, 0.3, 1.0)
BOND = CohesiveZone(1e4, 1e-3, 0.3)
TOUCH = SignoriniCoulomb(restitution=0.2)


def plate():
    """Explicit, each cell a body; the accuracy picks steps and tolerances; bonds break."""
    loads = [PrescribedVelocity(LEFT, 0, 0.0), PrescribedVelocity(RIGHT, 0, 0.1)]
    scene = Scene(box_bodies((1, 1), (6, 6)), {1: SOLID}, default_interaction=BOND, loads=loads)
    return Simulation(scene, accuracy=0.05, scheme="explicit", num_threads=2), 0.05


def blocks():
    """Implicit, finite strain, four blocks that press and slide on each other."""
    bodies = box_bodies((2, 2), (6, 6), label=lambda x: np.floor(x[0]) + 2 * np.floor(x[1]))
    held = [PrescribedVelocity(BOTTOM, i, 0.0) for i in (0, 1)]
    scene = Scene(
        bodies,
        {1: NeoHookean(100.0, 0.3, 1.0)},
        default_interaction=TOUCH,
        loads=[Gravity((0.3, -1.0)), *held],
    )
    return Simulation(scene, 0.01, theta=0.7, num_threads=2), 0.1


def discs():
    """Rigid bodies: contacts come and go, their number is not the same in each step."""
    shift = np.random.default_rng(1).random(48)
    bodies = [
        RigidBody(Disc(0.4), (n % 6 + 0.1 * shift[n], n // 6 + 1.0), "discs", density=1.0)
        for n in range(48)
    ]
    box = [
        wall((0, 0), (0, 1), "box"),
        wall((-1, 0), (1, 0.2), "box"),
        wall((7, 0), (-1, 0), "box"),
    ]
    scene = Scene(
        rigid=[*bodies, *box],
        contacts=[Contact(("discs", "discs"), TOUCH), Contact(("discs", "box"), TOUCH)],
        loads=[Gravity((0.0, -10.0))],
    )
    return Simulation(scene, 0.01, num_threads=2), 0.4


def cell():
    """Periodic, driven by strain and stress; bonds break."""
    bodies = explode(crossed_rectangle((0, 0), (1, 1), (3, 3)), np.arange(36), lattice=(1.0, 1.0))
    drive = MacroscopicDrive(rate={"11": 1.0, "21": 0.0, "12": 0.0}, stress={"22": 0.0})
    scene = Scene(bodies, {1: SOLID}, default_interaction=BOND, macroscopic=drive)
    return Simulation(scene, 0.001, num_threads=2), 0.01


SCENES = {make.__name__: make for make in (plate, blocks, discs, cell)}


def left_by(make, folder: Path) -> dict:
    """Run a scene into a folder: its summary without times, a digest of every other file."""
    simulation, end = make()
    with Recorder(simulation, folder, end_time=end, fields=3, parameters={"b": 1, "a": 2}) as to:
        for step in simulation.steps(end):
            to.record(step)
    summary = json.loads((folder / "summary.json").read_text())
    assert set(TIMING_KEYS) <= set(summary)
    files = sorted(path for path in folder.iterdir() if path.name != "summary.json")
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    return {"summary": without_times(summary), "files": digests}


CODE = """
import json, sys
from pathlib import Path
import test_repeatable as t

left = {
    name: [t.left_by(make, Path(sys.argv[1]) / f"{name}{time}") for time in (1, 2)]
    for name, make in t.SCENES.items()
}
(Path(sys.argv[1]) / "left.json").write_text(json.dumps(left))
"""


@pytest.fixture(scope="module")
def left(tmp_path_factory) -> list[dict]:
    """What each of two processes leaves, which run every scene twice."""
    tests = Path(__file__).parents[1]
    paths = [str(Path(__file__).parent), str(tests / "shared"), str(tests.parent)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
    folders = [tmp_path_factory.mktemp(f"process{seed}") for seed in (1, 271)]
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", CODE, folder], env=environment | {"PYTHONHASHSEED": seed}
        )
        for folder, seed in zip(folders, ("1", "271"), strict=True)
    ]
    assert [process.wait() for process in processes] == [0, 0]
    return [json.loads((folder / "left.json").read_text()) for folder in folders]


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_the_same_run_leaves_the_same_files(name, left):
    (first, again), elsewhere = (process[name] for process in left)
    assert first == again
    assert [first, again] == elsewhere
    assert {"history.csv"} < set(first["files"]) and first["summary"]["steps"] > 5


def test_times_are_left_out_wherever_they_are():
    summary = {"seconds": {"a": 1.0}, "effects": [{"seconds": 2.0, "bytes": 3}], "time": 4.0}
    assert without_times(summary) == {"effects": [{"bytes": 3}], "time": 4.0}
