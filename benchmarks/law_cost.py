# SPDX-License-Identifier: LGPL-3.0-or-later
"""What laws cost beside each other: curves, modes apart, fields.

    ./fenicsx python3 benchmarks/law_cost.py [--cells 40] [--steps 300] [--repeat R]

A crossed plate whose every triangle is a body is pulled apart by an explicit bulk until it has
broken in many places. For each law the time of a point and step, all of the step's work on the
points (constants, solution, damage, energies), beside that of the first one of its group: the
kernels of a linear softening bond written by hand (`tests/shared/outside_law.py`), and the default
law. Laws take turns, and of each step the least time of R runs counts. Then, what setting up a
simulation of 99 000 facets takes with a number, with a random strength and with a correlated one.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

import xper_fx as xf

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from outside_law import LinearSoftening  # noqa: E402
from scenes import LEFT, RIGHT, box_bodies  # noqa: E402

STIFFNESS, ENERGY, STRENGTH, VISCOSITY = 2e4, 0.05, 10.0, 1e-5
ELASTIC = xf.materials.LinearElastic(1000.0, 0.3, 1.0)
PHASES = ("interaction terms", "interaction solve", "energy")


@xf.njit
def _line(x, strength, end):
    return strength * (end - x) / (end - STRENGTH / STIFFNESS)


def laws() -> dict[str, xf.laws.Law]:
    """Laws by what they are called, of one strength, stiffness and energy."""
    curves, zone = xf.laws.curves, xf.laws.CohesiveZone
    numbers = (STIFFNESS, ENERGY, STRENGTH)
    end = 2.0 * ENERGY / STRENGTH
    every = {
        "linear, by hand": LinearSoftening(STIFFNESS, STRENGTH, ENERGY),
        "linear, a curve": zone(*numbers, curve=curves.Linear()),
        "linear, a user's function": xf.laws.CohesiveCurve(
            _line, {"strength": STRENGTH, "end": end}, end=end, normal_stiffness=STIFFNESS
        ),
        "linear, a table": xf.laws.CohesiveCurve(
            ([0.0, STRENGTH / STIFFNESS, end], [0.0, STRENGTH, 0.0])
        ),
        "linear, modes apart": xf.laws.MixedMode(
            STIFFNESS, (STRENGTH, STRENGTH), (ENERGY, ENERGY), 2.0
        ),
        "linear, strength a field": zone(
            STIFFNESS, ENERGY, lambda x: STRENGTH + 0.0 * x[0], curve=curves.Linear()
        ),
        "parabolic": zone(*numbers),
    }
    for curve in (curves.Petersson(), curves.Trapezoidal(), curves.Exponential()):
        every[type(curve).__name__.lower()] = zone(*numbers, curve=curve)
    every["linear, viscous"] = zone(*numbers, curve=curves.Linear(), viscosity=VISCOSITY)
    every["adhesion"] = xf.laws.Adhesion(STIFFNESS, ENERGY)
    every["adhesion, viscous"] = xf.laws.Adhesion(STIFFNESS, ENERGY, VISCOSITY)
    for curve in (curves.XuNeedleman(), curves.Tvergaard()):
        every[type(curve).__name__.lower()] = zone(None, ENERGY, STRENGTH, curve=curve)
    return every


def times_of_steps(law, cells: int, steps: int) -> tuple[np.ndarray, float]:
    """Nanoseconds a point in each step, and the share of the bonds that are worn at the end."""
    scene = xf.Scene(
        box_bodies((1, 1), (cells, cells)), {1: ELASTIC}, default_interaction=law,
        loads=[xf.PrescribedVelocity(LEFT, 0, -5.0), xf.PrescribedVelocity(RIGHT, 0, 5.0)],
        initial_velocity=lambda x: np.stack([10.0 * x[0] - 5.0, 0.0 * x[0]]),
    )  # fmt: skip
    simulation = xf.Simulation(scene, 5e-5, scheme="explicit", num_threads=1)
    run = simulation.steps(1.0)
    for _ in range(5):  # compiles
        next(run)
    spent = [sum(simulation.stopwatch.seconds[phase] for phase in PHASES)]
    for _ in range(steps):
        next(run)
        spent.append(sum(simulation.stopwatch.seconds[phase] for phase in PHASES))
    worn = float(np.mean(simulation.interactions.gather("damage") < 1.0))
    return 1e9 * np.diff(spent) / simulation.interactions.num_points, worn


def set_up(repeat: int) -> None:
    """Print what simulations of many facets take to be made."""
    mesh = create_rectangle(MPI.COMM_SELF, [[0, 0], [1, 1]], [182, 182], CellType.triangle)
    bodies = xf.explode(mesh)
    strengths = {
        "a number": STRENGTH,
        "Weibull, a facet each": xf.fields.Weibull(STRENGTH, 9.0, seed=1),
        "lognormal, correlated": xf.fields.Lognormal(STRENGTH, 0.2, 0.1, seed=1),
    }
    print(f"\n| strength, {len(bodies.facets)} facets | set-up (s) |\n|---|---:|")
    least = dict.fromkeys(strengths, np.inf)
    for _ in range(repeat):
        for name, strength in strengths.items():
            start = time.perf_counter()
            law = xf.laws.CohesiveZone(STIFFNESS, ENERGY, strength)
            scene = xf.Scene(bodies, {1: ELASTIC}, default_interaction=law)
            xf.Simulation(scene, 1e-5, scheme="explicit")
            least[name] = min(least[name], time.perf_counter() - start)
    for name, seconds in least.items():
        print(f"| {name} | {seconds:.2f} |")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cells", type=int, default=40, help="quadrilaterals a side")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    every = laws()
    times = {name: [] for name in every}
    worn = {}
    for _ in range(options.repeat):
        for name, law in every.items():
            spent, worn[name] = times_of_steps(law, options.cells, options.steps)
            times[name].append(spent)
    print("| law | ns a point and step | beside that by hand | beside the default | bonds worn |")
    print("|---|---:|---:|---:|---:|")
    least = {name: np.mean(np.min(found, axis=0)) for name, found in times.items()}
    for name, spent in least.items():
        by_hand, default = spent / least["linear, by hand"], spent / least["parabolic"]
        print(f"| {name} | {spent:.0f} | {by_hand:.2f} | {default:.2f} | {worn[name]:.2f} |")
    set_up(options.repeat)


if __name__ == "__main__":
    main()
