# SPDX-License-Identifier: LGPL-3.0-or-later
"""A cube of tetrahedra, each a body, that breaks along its middle plane, with what it costs.

    ./fenicsx python3 benchmarks/breaking_block.py [--cells 34]

The cube flies apart along x. Bonds are initially rigid, and a quarter as strong in the middle plane
as elsewhere. Whatever the mesh and the step, the crack spends w times the area of the plane. The
line has the processor time of a step before anything cracks, of the step in which all bonds of the
plane let go, and of a step once they soften or have broken.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import replace

import numpy as np
from dolfinx.mesh import CellType, create_box
from mpi4py import MPI

import xper_fx as xf

STRENGTH, ENERGY, RATE, END = 1e-2, 2e-5, 0.1, 0.4


def block(cells: int) -> xf.Simulation:
    """A cube of side 1 with an even number of cells along it, each cut into six tetrahedra."""
    mesh = create_box(MPI.COMM_SELF, [[0.0] * 3, [1.0] * 3], [cells] * 3, CellType.tetrahedron)

    middle = xf.tag_facets(mesh, {1: lambda x: np.abs(x[0] - 0.5) < 1e-9})
    bond = xf.laws.RigidCohesiveZone(STRENGTH, ENERGY, friction=0.3)
    scene = xf.Scene(
        xf.explode(mesh, facet_tags=middle), {1: xf.materials.LinearElastic(1.0, 0.3, 1.0)},
        facet_interactions={1: bond}, default_interaction=replace(bond, strength=4.0 * STRENGTH),
        initial_velocity=lambda x: RATE * np.stack([x[0] - 0.5, 0.0 * x[0], 0.0 * x[0]]),
    )  # fmt: skip
    return xf.Simulation(scene, scheme="explicit", num_threads=1)


def main(arguments: list[str] | None = None) -> None:
    """Break the cube, print its line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=34, help="cells along an edge, even")
    options = parser.parse_args(arguments)
    block(2)  # kernels are compiled
    simulation = block(options.cells)
    kinetic, times, split = simulation.ledger.energies.kinetic, [], []
    start = time.process_time()
    for _ in simulation.steps(END):
        times.append(time.process_time() - start)
        split.append(len(simulation.interactions.fused.split))
        start = time.process_time()
    opened = int(np.argmax(np.array(split) > 0))
    seconds = np.median(times[2:opened]), max(times[opened:]), np.median(times[opened + 1 :])
    spent = simulation.ledger.energies.dissipated_cohesion / ENERGY - 1.0
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print("| tetrahedra | steps | s before, as it opens, after | split | w off by | closure | GB |")
    print(7 * "|---" + "|")
    print(
        f"| {6 * options.cells**3} | {len(times)} | {seconds[0]:.2f}, {seconds[1]:.2f}, "
        f"{seconds[2]:.2f} | {split[-1]} of {simulation.interactions.fused.graphs.num_vertices} | "
        f"{spent:.0e} | {simulation.ledger.closure / kinetic:.0e} | {memory:.1f} |"
    )


if __name__ == "__main__":
    main()
