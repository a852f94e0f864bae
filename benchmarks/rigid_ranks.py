# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks spend on discs that lie in a box: search, sweeps, exchange, and bytes sent.

    mpirun -n 2 python3 benchmarks/rigid_ranks.py --columns 50 --rows 40

Times are processor times of the steps after the first few, in which kernels are compiled; the first
rank prints those of the slowest rank and the sum over ranks, a step.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from functools import wraps
from time import process_time

import numpy as np
from mpi4py import MPI

from xper_fx.forms.loads import Gravity
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, RigidBody, wall
from xper_fx.nscd.solvers import distributed
from xper_fx.parallel import halo, rigid_halo
from xper_fx.parallel import rigid_partition as rigid_division
from xper_fx.parallel.launch import run_together
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support import ranks

RADIUS, STEP = 0.01, 1e-3


def packed(columns: int, rows: int) -> Scene:
    """Discs of slightly different sizes on a lattice of triangles in a box."""
    random = np.random.default_rng(1)
    spacing = 2.0 * RADIUS
    bodies = [
        RigidBody(
            Disc(RADIUS * (1.0 - 1e-3 * random.random())),
            spacing * np.array([i + 0.5 + 0.5 * (j % 2), 0.5 + 0.5 * np.sqrt(3.0) * j]),
            "discs", density=1000.0,
        )
        for j in range(rows)
        for i in range(columns)
    ]  # fmt: skip
    bodies += [
        wall((0.0, 0.0), (0.0, 1.0), "box"),
        wall((0.0, 0.0), (1.0, 0.0), "box"),
        wall((spacing * (columns + 0.5), 0.0), (-1.0, 0.0), "box"),
    ]
    law = SignoriniCoulomb(friction=0.3)
    contacts = [Contact(("discs", "discs"), law), Contact(("discs", "box"), law)]
    return Scene(rigid=bodies, contacts=contacts, loads=[Gravity((0.0, -9.81))])


def timed(spent: dict[str, float], name: str, owner, method: str) -> None:
    """Add the processor time of a method to what its name has spent."""
    original = getattr(owner, method)

    @wraps(original)
    def measured(*arguments, **options):
        start = process_time()
        try:
            return original(*arguments, **options)
        finally:
            spent[name] += process_time() - start

    setattr(owner, method, measured)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--columns", type=int, default=50)
    parser.add_argument("--rows", type=int, default=40)
    parser.add_argument("--warm", type=int, default=4, help="steps before those measured")
    parser.add_argument("--steps", type=int, default=6, help="steps measured")
    parser.add_argument("--tolerance", type=float, default=1e-2)
    options = parser.parse_args()
    rigid_division._FEW = 0
    spent: dict[str, float] = defaultdict(float)
    timed(spent, "exchange", halo.Exchange, "forward")
    timed(spent, "exchange", halo.Exchange, "back")
    timed(spent, "all bodies", rigid_halo._AllBodies, "forward")
    timed(spent, "all bodies", rigid_halo._AllBodies, "add_back")
    timed(spent, "sums", ranks.Ranks, "sum")
    timed(spent, "division", rigid_division.RigidDivision, "own")
    timed(spent, "sweeps and their exchange", distributed, "sweep")
    scene = packed(options.columns, options.rows)
    simulation = Simulation(scene, STEP, tolerance=options.tolerance, num_threads=1, solver="nlgs")
    comm = MPI.COMM_WORLD
    timed(spent, "search", simulation.detection, "renew")
    timed(spent, "step", simulation._attempts, "step")
    for _ in simulation.steps(options.warm * STEP):
        pass
    spent.clear()
    sweeps = [r.sweeps for r in simulation.steps((options.warm + options.steps) * STEP)]
    contacts = sum(map(len, simulation.interactions.contacts))
    division = simulation.model.division
    found = simulation.interactions.halo
    bytes_sent = (0, 0) if found is None else (found.bytes_a_sweep, found.bytes_a_gather)
    everywhere = comm.gather((dict(spent), contacts, bytes_sent))
    if comm.rank > 0:
        return
    times, contacts, sent = zip(*everywhere, strict=True)
    print(f"{len(scene.rigid)} bodies, {comm.size} ranks, contacts {contacts}")
    print(f"sweeps a step {np.mean(sweeps):.1f}, kinetic {simulation.rigid.kinetic:.9e}")
    if division is not None:
        print(f"partitions {division.partitions}, bodies moved {division.moved}")
        print(
            f"bytes sent a sweep {[s[0] for s in sent]}, to put all together {[s[1] for s in sent]}"
        )
    for name in sorted({name for t in times for name in t}):
        each = [1e3 * t.get(name, 0.0) / options.steps for t in times]
        print(f"{name:30s} slowest {max(each):8.2f} ms a step, sum {sum(each):8.2f}")


if __name__ == "__main__":
    run_together(main)
