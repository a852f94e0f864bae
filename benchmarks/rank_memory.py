# SPDX-License-Identifier: LGPL-3.0-or-later
"""Memory of a rank, of a mesh that is whole on each rank and of one that is spread over them.

    ./fenicsx python3 benchmarks/rank_memory.py [--cells 160] [--ranks 1 2 4]

A square of crossed triangles, each a body, with cohesive bonds and the explicit bulk. Each number
of ranks is a process group of its own (`mpirun -n N`), one thread a rank. Printed are, of the rank
that has most, the growth of the highest resident memory (Linux) from before the mesh is made to
after the set-up and after some steps, both in bytes for each body of all ranks, and the sum of all
ranks' after steps. Where nothing is whole on a rank the first two fall as 1 / N. What Python,
DOLFINx and the kernels take before is left out, kernels are loaded by a small run first.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

import xper_fx as xf

STEPS = 3


def simulation_of(cells: int, comm: MPI.Comm) -> xf.Simulation:
    """The square, with its mesh on a communicator."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells), comm)
    sides = xf.tag_facets(mesh, {1: lambda x: x[0] < 1e-9, 2: lambda x: x[0] > 1.0 - 1e-9})
    scene = xf.Scene(
        xf.explode(mesh, facet_tags=sides),
        {1: xf.materials.LinearElastic(1000.0, 0.3, 1.0)},
        default_interaction=xf.laws.CohesiveZone(1e3 * cells * 20.0, 0.05, 10.0),
        loads=[xf.PrescribedVelocity(1, 0, -0.1), xf.PrescribedVelocity(2, 0, 0.1)],
        initial_velocity=lambda x: np.stack([0.1 * (2.0 * x[0] - 1.0), 0.0 * x[0]]),
    )
    return xf.Simulation(scene, scheme="explicit", comm=MPI.COMM_WORLD)


def advance(simulation: xf.Simulation) -> None:
    """Some steps."""
    for _ in simulation.steps(STEPS * simulation.step_size):
        pass


def memory(name: str) -> int:
    """A line of the process's status, "VmRSS" or "VmHWM", in bytes."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(re.search(rf"{name}:\s+(\d+) kB", status)[1])


def measure(cells: int, spread: bool) -> dict:
    """Bytes a body of all, on all ranks that were started."""
    world = MPI.COMM_WORLD
    comm = world if spread else MPI.COMM_SELF
    advance(simulation_of(8, comm))
    Path("/proc/self/clear_refs").write_text("5")
    before = memory("VmRSS")
    simulation = simulation_of(cells, comm)
    set_up = memory("VmHWM") - before
    advance(simulation)
    bodies = 4 * cells**2
    after = memory("VmHWM") - before
    return {
        "set_up": world.allreduce(set_up, MPI.MAX) / bodies,
        "steps": world.allreduce(after, MPI.MAX) / bodies,
        "sum": world.allreduce(after) / bodies,
        "own": world.allreduce(simulation.bodies.num_bodies, MPI.MAX) / bodies,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=160)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--worker", choices=("whole", "spread"))
    options = parser.parse_args()
    if options.worker:
        found = measure(options.cells, options.worker == "spread")
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found))
        return
    print(f"{4 * options.cells**2} bodies; bytes for each of them")
    print("mesh    ranks  largest share  set-up, a rank  steps, a rank  steps, all ranks")
    for kind in ("whole", "spread"):
        for count in options.ranks:
            command = ["mpirun", "--oversubscribe", "-n", str(count), sys.executable, __file__]
            command += ["--worker", kind, "--cells", str(options.cells)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found = json.loads(done.stdout.splitlines()[-1])
            print(
                f"{kind:7}{count:6d}{found['own']:15.3f}{found['set_up']:16.0f}"
                f"{found['steps']:15.0f}{found['sum']:18.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
