# SPDX-License-Identifier: LGPL-3.0-or-later
"""One static step of bonded triangles: iterations and time of the monolithic solver.

    ./fenicsx python3 benchmarks/slow_loads.py [--rows 8 32] [--factors 10 1000]

A strip of 0.4 x 0.1 m, each triangle a body, bonds of `factor` E/h, clamped on the left, pulled by
1 um or bent by a traction, the lips without friction or with mu = 0.5, to 1e-10 of the largest
nodal force. The first row of each mesh compiles or loads kernels; its time counts once more.
"""

from __future__ import annotations

import argparse
from time import perf_counter

import xper_fx as xf

YOUNG, WIDTH, HEIGHT = 30e9, 0.4, 0.1
LEFT, RIGHT = 1, 2


def strip(rows: int, factor: float, load, friction: float) -> xf.Scene:
    """The strip of 16 rows^2 triangles under a load."""
    mesh = xf.crossed_rectangle((0, 0), (WIDTH, HEIGHT), (4 * rows, rows))
    tags = {LEFT: lambda x: x[0] < 1e-9, RIGHT: lambda x: x[0] > WIDTH - 1e-9}
    held = [xf.PrescribedDisplacement(LEFT, axis, 0.0) for axis in (0, 1)]
    bond = xf.laws.CohesiveZone(factor * YOUNG * rows / HEIGHT, 1e9, 3e6, friction=friction)
    return xf.Scene(
        xf.explode(mesh, facet_tags=xf.tag_facets(mesh, tags)),
        {1: xf.materials.LinearElastic(YOUNG, 0.2, 2400.0, plane="stress")},
        default_interaction=bond,
        loads=[*held, load],
    )


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, nargs="+", default=[8, 32])
    parser.add_argument("--factors", type=float, nargs="+", default=[10.0, 1000.0])
    options = parser.parse_args(arguments)
    loads = {
        "pulled": xf.PrescribedDisplacement(RIGHT, 0, lambda t: 1e-6 * t),
        "bent": xf.SurfaceTraction(RIGHT, (0.0, lambda t: -1e3 * t)),
    }
    print(" cells  K h/E  load    mu   iterations  seconds")
    for rows in options.rows:
        for factor in options.factors:
            for name, load in loads.items():
                for friction in (0.0, 0.5):
                    scene = strip(rows, factor, load, friction)
                    simulation = xf.Simulation(
                        scene, 1.0, inertia=False, newton_tolerance=1e-10
                    )  # fmt: skip
                    start = perf_counter()
                    (step,) = simulation.steps(1.0)
                    print(
                        f"{16 * rows**2:6d} {factor:6g}  {name:6s} {friction:3.1f} "
                        f"{step.newton_iterations:8d} {perf_counter() - start:12.2f}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
