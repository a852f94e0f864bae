# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps of 100 times the explicit limit of a plate of which half of the facets are broken.

    ./fenicsx python3 benchmarks/half_broken.py [--cells 20 40 80] [--solvers newton auto]

The plate of `stall_study.py` as a scene with an implicit bulk: each triangle a body, half of the
facets between them, drawn at random, without bond; stretched along x and pressed along y from
rest, so that broken lips slide and open. A residual of one solver is not that of another: their
velocities at the end are compared with those of the first one. The first steps, which compile,
are not timed; the others are, on one thread (processor time).
"""

from __future__ import annotations

import argparse
from time import process_time

import numpy as np
from dolfinx.mesh import meshtags

import xper_fx as xf

SIZE, BROKEN = 50e-6, 7
BOND = xf.laws.CohesiveZone(2e18, 0.5, 1e9, friction=0.05)


def plate(cells: int) -> xf.Scene:
    """The plate of 4 cells^2 triangles."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (SIZE, SIZE), (cells, cells))
    mesh.topology.create_connectivity(1, 2)
    sides = mesh.topology.connectivity(1, 2)
    between = np.flatnonzero(np.diff(sides.offsets) == 2).astype(np.int32)
    lost = between[np.random.default_rng(0).random(len(between)) < 0.5]
    return xf.Scene(
        xf.explode(mesh, facet_tags=meshtags(mesh, 1, lost, np.full(len(lost), BROKEN, np.int32))),
        {1: xf.materials.LinearElastic(99e9, 0.325, 7800.0)},
        default_interaction=BOND,
        facet_interactions={BROKEN: xf.laws.SignoriniCoulomb(0.05)},
        initial_velocity=lambda x: 4e4 * np.array([x[0] - SIZE / 2, SIZE / 2 - x[1]]),
    )


def run(cells: int, solver: str, steps: int, tolerance: float) -> tuple[float, str, np.ndarray]:
    """Seconds a step, what the steps took, and the velocities at the end."""
    step = 100 * 3.1e-11 * np.sqrt(20 / cells)
    simulation = xf.Simulation(
        plate(cells), step, scheme="implicit", solver=solver, tolerance=tolerance,
        newton_tolerance=1e-10 if solver == "monolithic" else 1e-8, num_threads=1,
    )  # fmt: skip
    next(simulation.steps(2 * step))
    start, taken = process_time(), []
    for record in simulation.steps((steps + 1) * step):
        taken.append(f"{record.sweeps} sweeps, {record.newton_iterations} Newton iterations")
    return (process_time() - start) / steps, "; ".join(taken), simulation.state.velocity


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40, 80])
    parser.add_argument("--solvers", nargs="+", default=["newton", "auto"])
    parser.add_argument("--steps", type=int, default=2)
    parser.add_argument("--tolerance", type=float, default=1e-6, help="of the solvers at points")
    options = parser.parse_args(arguments)
    seconds: dict[str, list[float]] = {}
    for cells in options.cells:
        exact = None
        for solver in options.solvers:
            spent, taken, velocity = run(cells, solver, options.steps, options.tolerance)
            seconds.setdefault(solver, []).append(spent)
            exact = velocity if exact is None else exact
            apart = np.linalg.norm(velocity - exact) / np.linalg.norm(exact)
            print(f"{cells}: {solver} {spent:.2f} s a step ({taken}), {apart:.1e} apart")
    for solver, spent in seconds.items():
        if len(spent) > 1:
            slope = np.polyfit(2.0 * np.log(options.cells), np.log(spent), 1)[0]
            print(f"{solver}: time like the number of points to the power {slope:.2f}")


if __name__ == "__main__":
    main()
