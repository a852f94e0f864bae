# SPDX-License-Identifier: LGPL-3.0-or-later
"""What implicit and static steps cost with vertices that are split ahead, and with all points.

    ./fenicsx python3 benchmarks/split_ahead.py [--cells 20 40] [--runs dynamic static]

A square plate of crossed triangles, notched from the left along a third of its length, whose lips
are pulled apart there; bonds are initially rigid. It is run twice by the monolithic solver, step by
step in turns: cells share unknowns until a vertex is near to breaking, or all points are there from
the start. Each line has the processor time of a step, compiling and output aside: the least of
those before the first bond opens, and the mean of all after that; what cracks took; how far the
displacements of both runs are apart, relative; how many vertices were split in the end, of how
many there are. "picked" compares what solver="auto" does in dynamics, instead, with its sweeps.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import xper_fx as xf
from xper_fx.simulation import model

STRENGTH, ENERGY = 1e-2, 5e-5
# Half the acceleration of the lips, step and end, of a dynamic run and of a static one.
RUNS = {
    "dynamic": (0.01, 0.05, 1.2),
    "static": (0.1, 0.03, 0.54),
    "picked": (0.01, 0.05, 1.2),
}


def plate(cells: int, pull: float) -> xf.Scene:
    """The plate, pulled apart by 2 pull t^2; bonds beside the line of the notch are stronger."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells))
    near = 1e-9
    tags = xf.tag_facets(
        mesh,
        {
            1: lambda x: (x[0] < near) & (x[1] < 0.35 + near),
            2: lambda x: (x[0] < near) & (x[1] > 0.65 - near),
            3: lambda x: x[0] > 1.0 - near,
            4: lambda x: (np.abs(x[1] - 0.5) < near) & (x[0] < 0.35 + near),
        },
    )

    def strength(x):
        return np.where(np.abs(x[1] - 0.5) < near, 1.0, 2.0) * STRENGTH

    def pulled(t):
        return pull * t**2

    driven = [(1, 1, lambda t: -pulled(t)), (2, 1, pulled), (3, 0, 0.0), (3, 1, 0.0)]
    return xf.Scene(
        xf.explode(mesh, facet_tags=tags),
        {1: xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)},
        default_interaction=xf.laws.RigidCohesiveZone(strength, ENERGY, viscosity=0.01),
        facet_interactions={4: None},
        loads=[xf.PrescribedDisplacement(*motion) for motion in driven],
    )


def made(cells: int, run: str, ahead: bool) -> xf.Simulation:
    """A run of the plate, with vertices that are split ahead or with all points."""
    kept, (pull, step, _) = model.condenses, RUNS[run]
    options = {} if run == "picked" else {"solver": "monolithic", "newton_tolerance": 1e-10}
    if not ahead:
        model.condenses = lambda scene, laws: False
    try:
        return xf.Simulation(
            plate(cells, pull), step, inertia=run != "static", num_threads=1, **options
        )
    finally:
        model.condenses = kept


def compare(cells: int, run: str) -> str:
    """A row of the table."""
    runs = [made(cells, run, ahead) for ahead in (True, False)]
    fused = runs[0].interactions.fused
    _, step, end = RUNS[run]
    before, after = [[], []], [[], []]
    apart = 0.0
    for number in range(1, round(end / step) + 1):
        opened = runs[0].ledger.energies.dissipated_cohesion > 0.0
        for which, simulation in enumerate(runs):
            start = time.process_time()
            list(simulation.steps(number * step))
            seconds = time.process_time() - start
            if number > 2:
                (after if opened else before)[which].append(1e3 * seconds)
        u, reference = (s.state.displacement for s in runs)
        apart = max(apart, np.abs(u - reference).max() / np.abs(reference).max())
    least, mean = [min(t) for t in before], [np.mean(t) for t in after]
    cracks = runs[0].ledger.energies.dissipated_cohesion / ENERGY
    return (
        f"| {run} | {cells} | {least[0]:.1f} | {least[1]:.1f} | "
        f"{least[1] / least[0]:.1f} | {mean[0]:.0f} | {mean[1]:.0f} | {mean[1] / mean[0]:.1f} | "
        f"{len(before[0])}, {len(after[0])} | {cracks:.3f} | {apart:.0e} | "
        f"{len(fused.split)} of {fused.graphs.num_vertices} |"
    )


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40])
    parser.add_argument("--runs", nargs="+", choices=RUNS, default=list(RUNS))
    options = parser.parse_args(arguments)
    print(
        "| run | quads | intact, ahead (ms) | all points | ratio | cracking, ahead (ms) | "
        "all points | ratio | steps | cracks (m) | apart | split |\n" + 12 * "|---" + "|"
    )
    for run in options.runs:
        for cells in options.cells:
            print(compare(cells, run), flush=True)


if __name__ == "__main__":
    main()
