# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time a step of the homogeneous notched plate at h = 1e-9 s, and where it goes.

The plate of `demos/notched_plate.py` without inclusions, implicit bulk, 100 steps of 1e-9 s: 45
times the explicit limit of the bonds at 40 x 40. LMGC90 (Fortran, stored W, relative tolerance
1e-4) was measured at 104 sweeps and 91 ms a step at 20 x 20, 369 sweeps and 1540 ms at 40 x 40, on
a machine of the same kind; its residual is taken to be what as many plain sweeps from the last
step's impulses leave. The *true residual* here is the error of the impulses against a solution
converged to 1e-9, in the Euclidean norm.

Run: ./fenicsx python3 benchmarks/homogeneous_plate.py [--cells 20 40] [--steps 100]
"""

import argparse
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "demos"))
from notched_plate import notched_plate  # noqa: E402

from xper_fx.nscd.solvers import NonlinearGaussSeidel, SolveOptions, Solver  # noqa: E402
from xper_fx.simulation.simulation import Simulation  # noqa: E402

STEP = 1e-9
LMGC90 = {20: (104, 91.0), 40: (369, 1540.0)}


def impulses(simulation: Simulation) -> np.ndarray:
    """Impulses of the step, in the scene's order."""
    return simulation.interactions.gather("impulse")


def true_residuals(cells: int, steps: int, tolerance: float, relaxation: float) -> tuple:
    """Largest relative error over the steps: ours, and that of LMGC90's number of plain sweeps."""
    simulation = Simulation(notched_plate(cells, "strong", homogeneous=True), STEP)
    errors = []

    class Compared(Solver):
        name = "compared"

        def solve(self, interactions, velocity, options):
            return compared(interactions, velocity)

    def compared(interactions, velocity):
        free, start = velocity.copy(), [g.impulse.copy() for g in interactions.groups]
        found = []
        for options in (
            {"tolerance": 1e-9, "relaxation": 1.5, "max_sweeps": 100_000},
            {"tolerance": 1e-300, "relaxation": 1.0, "max_sweeps": LMGC90[cells][0]},
            {"tolerance": tolerance, "relaxation": relaxation},
        ):
            velocity[:] = free
            for g, impulse in zip(interactions.groups, start, strict=True):
                g.impulse[:] = impulse
            interactions.prepare()
            report = NonlinearGaussSeidel().solve(interactions, velocity, SolveOptions(**options))
            found.append(impulses(simulation))
        exact = np.linalg.norm(found[0])
        errors.append([np.linalg.norm(r - found[0]) / exact for r in found[1:]])
        return report

    simulation.solver = Compared()
    for _ in simulation.steps(steps * STEP):
        pass
    plain, ours = np.array(errors).T
    return ours, plain


def timed(cells: int, steps: int, tolerance: float, relaxation: float, threads: int):
    """Milliseconds and sweeps a step, and milliseconds of each phase."""
    simulation = Simulation(
        notched_plate(cells, "strong", homogeneous=True), STEP, tolerance=tolerance,
        relaxation=relaxation, num_threads=threads,
    )  # fmt: skip
    for _ in simulation.steps(STEP):  # compile
        pass
    simulation.stopwatch.restart()
    start, sweeps = perf_counter(), 0
    for record in simulation.steps((steps + 1) * STEP):
        sweeps += record.sweeps
    total = 1e3 * (perf_counter() - start) / steps
    phases = {name: 1e3 * s / steps for name, s in simulation.stopwatch.seconds.items()}
    return total, sweeps / steps, phases


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[20, 40])
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--tolerance", type=float, default=2.5e-3)
    parser.add_argument("--relaxation", type=float, default=1.5)
    options = parser.parse_args()
    for cells in options.cells:
        ours, plain = true_residuals(cells, 10, options.tolerance, options.relaxation)
        print(
            f"{cells} x {cells}: true residual over 10 steps, ours {ours.max():.1e} (median "
            f"{np.median(ours):.1e}), {LMGC90[cells][0]} plain sweeps {plain.max():.1e} "
            f"(median {np.median(plain):.1e})"
        )
        for threads in (1, 2):
            total, sweeps, phases = timed(
                cells, options.steps, options.tolerance, options.relaxation, threads
            )
            print(
                f"  {threads} thread: {total:.1f} ms a step, {sweeps:.0f} sweeps; LMGC90 "
                f"{LMGC90[cells][1]:.0f} ms, ratio {LMGC90[cells][1] / total:.1f}; "
                + ", ".join(f"{name} {ms:.2f} ms" for name, ms in phases.items())
            )


if __name__ == "__main__":
    main()
