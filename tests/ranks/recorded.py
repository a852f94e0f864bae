# SPDX-License-Identifier: LGPL-3.0-or-later
"""Recorded runs of all ranks, one after the other: FOLDER=LAST ... [rigid | cell] [restart].

A signal ends the run into a folder named "signalled", of which one rank alone hears; ties, and an
explicit bulk, are in those whose names say so.
"""

import signal
import sys

from meshed_scenes import blocks, explicit, tied
from rigid_bodies import clouds, pressed
from scenes import LEFT, RIGHT

from xper_fx.output.gauges import TensileGauge
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.parallel import rigid_partition as rigid_division
from xper_fx.parallel.launch import run_together
from xper_fx.simulation.simulation import Simulation

SIGNALLED = 45
RIGID = {"rigid": clouds, "cell": pressed}


def run(folder: str, last: int, restart: bool, rigid: str | None = None) -> None:
    if rigid:
        rigid_division._FEW = 0
        simulation, steps, gauge = RIGID[rigid](), 60, None
    else:
        named = {"tied": tied, "explicit": explicit}
        made = next((scene for name, scene in named.items() if name in folder), blocks)
        scene, options, steps = made()
        simulation, gauge = Simulation(scene, **options), TensileGauge(LEFT, RIGHT, 0, 1.0, 1.0)
    end = steps * simulation.step_size
    recorder = Recorder(
        simulation, folder, end_time=end, fields=5, gauge=gauge, restart=restart,
        fragments=rigid is None,
    )  # fmt: skip
    for record, _ in recorded_steps(recorder, last * simulation.step_size, "recorded", quiet=True):
        last_rank = simulation.team.size - 1
        one_is_told = folder.endswith("signalled") and simulation.team.rank == last_rank
        if one_is_told and record.step == SIGNALLED:
            signal.raise_signal(signal.SIGTERM)


def main() -> None:
    rigid = next((name for name in RIGID if name in sys.argv), None)
    for argument in sys.argv[1:]:
        if "=" in argument:
            folder, last = argument.rsplit("=", 1)
            run(folder, int(last), "restart" in sys.argv, rigid)


if __name__ == "__main__":
    run_together(main)
