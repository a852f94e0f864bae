# SPDX-License-Identifier: LGPL-3.0-or-later
"""A recorded run of all ranks: FOLDER END_STEP [restart]."""

import sys

from meshed_scenes import blocks
from scenes import LEFT, RIGHT

from xper_fx.parallel.launch import run_together
from xper_fx.recorder import Recorder, TensileGauge
from xper_fx.runner import recorded_steps
from xper_fx.simulation import Simulation

STEPS = 20


def main() -> None:
    folder, last = sys.argv[1], int(sys.argv[2])
    scene, options, _ = blocks()
    simulation = Simulation(scene, **options)
    end = STEPS * simulation.step_size
    recorder = Recorder(
        simulation, folder, end_time=end, fields=5, gauge=TensileGauge(LEFT, RIGHT, 0, 1.0, 1.0),
        restart="restart" in sys.argv,
    )  # fmt: skip
    for _ in recorded_steps(recorder, last * simulation.step_size, "recorded", quiet=True):
        pass


run_together(main)
