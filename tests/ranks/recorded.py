# SPDX-License-Identifier: LGPL-3.0-or-later
"""Recorded runs of all ranks, one after the other: FOLDER=LAST_STEP ... [restart]."""

import sys

from meshed_scenes import blocks
from scenes import LEFT, RIGHT

from xper_fx.parallel.launch import run_together
from xper_fx.recorder import Recorder, TensileGauge
from xper_fx.runner import recorded_steps
from xper_fx.simulation import Simulation

STEPS = 20


def run(folder: str, last: int, restart: bool) -> None:
    scene, options, _ = blocks()
    simulation = Simulation(scene, **options)
    end = STEPS * simulation.step_size
    recorder = Recorder(
        simulation, folder, end_time=end, fields=5, gauge=TensileGauge(LEFT, RIGHT, 0, 1.0, 1.0),
        restart=restart,
    )  # fmt: skip
    for _ in recorded_steps(recorder, last * simulation.step_size, "recorded", quiet=True):
        pass


def main() -> None:
    for argument in sys.argv[1:]:
        if argument != "restart":
            folder, last = argument.rsplit("=", 1)
            run(folder, int(last), "restart" in sys.argv)


run_together(main)
