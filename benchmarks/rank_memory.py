# SPDX-License-Identifier: LGPL-3.0-or-later
"""Memory and time of a rank, of a mesh that is whole on each rank or spread over them.

    ./fenicsx python3 benchmarks/rank_memory.py [--cells 160 ...] [--ranks 1 2 4] [--meshes spread]

A square of crossed triangles, each a body, with cohesive bonds and the explicit bulk. Each number
of ranks is a process group of its own (`mpirun -n N`), one thread a rank. Printed are, of the rank
that has most, the growth of the highest resident memory (Linux) from before the mesh is made to
after the set-up and after some steps, both in bytes for each body of all ranks, and the sum of all
ranks' after steps. Where nothing is whole on a rank the first two fall as 1 / N. What Python,
DOLFINx and the kernels take before is left out, kernels are loaded by a small run first. Times are
processor times of the rank that takes most: mesh, bodies, simulation and the first step, which
makes the inverses of the vertices; and a later step. A body has three points, two on each of three
facets that it shares. Of several sizes, exponents follow.

913 cells a side are 3.3 million bodies, ten million points.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
from itertools import islice
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


def memory(name: str) -> int:
    """A line of the process's status, "VmRSS" or "VmHWM", in bytes."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(re.search(rf"{name}:\s+(\d+) kB", status)[1])


def measure(cells: int, spread: bool) -> dict:
    """Bytes a body of all, on all ranks that were started."""
    world = MPI.COMM_WORLD
    comm = world if spread else MPI.COMM_SELF
    for _ in islice(simulation_of(8, comm).steps(1.0), STEPS):
        pass
    Path("/proc/self/clear_refs").write_text("5")
    before = memory("VmRSS")
    times = [time.process_time()]
    simulation = simulation_of(cells, comm)
    set_up = memory("VmHWM") - before
    steps = simulation.steps(1.0)
    for count in (1, STEPS):
        for _ in islice(steps, count):
            pass
        times.append(time.process_time())
    bodies = 4 * cells**2
    after = memory("VmHWM") - before
    making, stepping = np.diff(times)
    return {
        "largest share": world.allreduce(simulation.bodies.num_bodies, MPI.MAX) / bodies,
        "set-up, a rank": world.allreduce(set_up, MPI.MAX) / bodies,
        "steps, a rank": world.allreduce(after, MPI.MAX) / bodies,
        "steps, all ranks": world.allreduce(after) / bodies,
        "set-up (s)": world.allreduce(making, MPI.MAX),
        "a step (s)": world.allreduce(stepping, MPI.MAX) / STEPS,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[160])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--meshes", nargs="+", default=["whole", "spread"])
    parser.add_argument("--worker", choices=("whole", "spread"))
    options = parser.parse_args()
    if options.worker:
        found = measure(options.cells[0], options.worker == "spread")
        if MPI.COMM_WORLD.rank == 0:
            print(json.dumps(found))
        return
    print("Bytes for each body of all ranks")
    for mesh in options.meshes:
        for count in options.ranks:
            rows = []
            for cells in options.cells:
                command = ["mpirun", "--oversubscribe", "-n", str(count), sys.executable, __file__]
                command += ["--worker", mesh, "--cells", str(cells)]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                found = json.loads(done.stdout.splitlines()[-1])
                rows.append(list(found.values()))
                told = ", ".join(f"{name} {value:.4g}" for name, value in found.items())
                print(f"{mesh}, {4 * cells**2} bodies on {count}: {told}", flush=True)
            if len(rows) > 1:
                # exponents in the number of bodies, which is the square of that of cells
                grown = np.polyfit(np.log(options.cells), np.log(rows), 1)[0] / 2.0
                told = ", ".join(f"{name} {p:.2f}" for name, p in zip(found, grown, strict=True))
                print(f"{mesh}, exponents: {told}", flush=True)


if __name__ == "__main__":
    main()
