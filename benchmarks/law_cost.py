# SPDX-License-Identifier: LGPL-3.0-or-later
"""What laws cost beside each other: curves, modes apart, fields.

    ./fenicsx python3 benchmarks/law_cost.py [--cells 10] [--steps 60] [--repeat R]

A crossed plate whose every triangle is a body flies apart: bodies so heavy that bonds hardly slow
them, each with the velocity of a homogeneous stretch at its middle. Every bond opens further in
every step, along its normal and along its tangent, and laws have the same openings and the same
sweeps. An explicit bulk, the scene within the caches.

Of each law the time of a point and step, all of the step's work on the points: constants, solution,
damage, energies. A *visit* is what the solution takes over its sweeps: velocities are read, the law
answers, damage follows, impulses are given to the bodies. Weakening: all bonds weaken in all steps.
Sound: none does, but of Xu and Needleman's curve and Tvergaard's, which do from the start. Beside
it stands the same of kernels written by hand for that one curve (`tests/shared/outside_law.py`):
exponential and Xu and Needleman's, by the primitive, all others beside linear softening.
Simulations make their steps by turns, and of each step the least time of R runs counts.

Then, what setting up a simulation of 99 000 facets takes with a number, with a random strength and
with a correlated one, in processor time.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from mpi4py import MPI

import xper_fx as xf

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "shared"))
from outside_law import LinearSoftening, softening_kernels  # noqa: E402
from scenes import box_bodies, nodes  # noqa: E402

STIFFNESS, ENERGY, STRENGTH, VISCOSITY = 2e4, 0.05, 10.0, 1e-5
HEAVY = xf.materials.LinearElastic(1000.0, 0.3, 1000.0)
STEP = 5e-5
# Velocity of a body over its place (1/s), for bonds that weaken from the first step counted on, and
# for bonds that stay sound.
STRETCH = np.array([[45.0, 22.0], [-22.0, 45.0]])
SLOW = 0.01
FIRST = 8
VISIT, PHASES = "interaction solve", ("interaction terms", "interaction solve", "energy")


@xf.njit
def _line(x, strength, end):
    return strength * (end - x) / (end - STRENGTH / STIFFNESS)


@xf.njit
def _falling(x, start, length):
    """exp(-(x - d0) / l) d0 / x up to d0 + 12 l."""
    if x <= start:
        return 1.0
    return start / x * np.exp((start - x) / length) if x < start + 12.0 * length else 0.0


@xf.njit
def _falling_mean(x1, x0, reached, beta, start, length):
    """As `mean_damage` there, from the primitive -d0 l exp(-(x - d0) / l) of g x."""
    low, top = max(reached, start), min(x1, start + 12.0 * length)
    if x1 <= low or beta == 0.0:
        return beta
    spent = beta * (low * low - x0 * x0)
    if top > low:
        rest = np.exp((start - low) / length) - np.exp((start - top) / length)
        spent += 2.0 * start * length * rest
    return spent / (x1 * x1 - x0 * x0)


@xf.njit
def _smooth(x, length, end):
    """exp(-x / l) up to dc."""
    return np.exp(-x / length) if x < end else 0.0


@xf.njit
def _smooth_mean(x1, x0, reached, beta, length, end):
    """As `mean_damage` there, from the primitive -l (l + x) exp(-x / l) of g x."""
    low, top = reached, min(x1, end)
    if x1 <= low or beta == 0.0:
        return beta
    spent = beta * (low * low - x0 * x0)
    if top > low:
        spent += 2.0 * length * (length + low) * np.exp(-low / length)
        spent -= 2.0 * length * (length + top) * np.exp(-top / length)
    return spent / (x1 * x1 - x0 * x0)


@dataclass(frozen=True)
class ByHand:
    """A curve in kernels written for it: its damage, the mean of it, k and two numbers."""

    damage: Callable
    mean_damage: Callable
    numbers: tuple[float, float, float]

    def kernels(self, dim: int):
        """See `Law`."""
        return softening_kernels(dim, self.damage, self.mean_damage, None)

    def parameters(self) -> tuple[float, ...]:
        """See `Law`."""
        return self.numbers

    def initial_state(self) -> tuple[float, ...]:
        """Largest opening so far (m) and damage."""
        return 0.0, 1.0


def laws() -> dict[str, tuple]:
    """By what they are called, laws of one strength and energy, and what each stands beside."""
    curves, zone = xf.laws.curves, xf.laws.CohesiveZone
    numbers = (STIFFNESS, ENERGY, STRENGTH)
    end = 2.0 * ENERGY / STRENGTH
    by_hand = LinearSoftening(STIFFNESS, STRENGTH, ENERGY)
    beside_lines = {
        "linear": zone(*numbers, curve=curves.Linear()),
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
        "linear, viscous": zone(*numbers, curve=curves.Linear(), viscosity=VISCOSITY),
        "parabolic": zone(*numbers),
    }
    for curve in (curves.Petersson(), curves.Trapezoidal()):
        beside_lines[type(curve).__name__] = zone(*numbers, curve=curve)
    beside_lines["Tvergaard"] = zone(None, ENERGY, STRENGTH, curve=curves.Tvergaard())
    stiff = 10.0 * STIFFNESS  # it has to be, to weaken at the openings of the others
    beside_lines["adhesion"] = xf.laws.Adhesion(stiff, ENERGY)
    beside_lines["adhesion, viscous"] = xf.laws.Adhesion(stiff, ENERGY, VISCOSITY)
    every = {name: (law, by_hand) for name, law in beside_lines.items()}
    falling, smooth = curves.Exponential(), curves.XuNeedleman()
    start, _, length = falling.shape(STIFFNESS, STRENGTH, ENERGY)
    of_falling = ByHand(_falling, _falling_mean, (STIFFNESS, start, length))
    every["Exponential"] = (zone(*numbers, curve=falling), of_falling)
    own = smooth.own_stiffness(STRENGTH, ENERGY)
    _, end, length = smooth.shape(own, STRENGTH, ENERGY)
    of_smooth = ByHand(_smooth, _smooth_mean, (own, length, end))
    every["XuNeedleman"] = (zone(None, ENERGY, STRENGTH, curve=smooth), of_smooth)
    return every


def flying_apart(law, cells: int, stretch: np.ndarray) -> xf.Simulation:
    """Bodies that fly apart."""
    scene = xf.Scene(box_bodies((1, 1), (cells, cells)), {1: HEAVY}, default_interaction=law)
    simulation = xf.Simulation(scene, STEP, scheme="explicit", num_threads=1)
    of_cell = simulation.forms.V.dofmap.list
    middles = nodes(simulation)[of_cell].mean(axis=1) - 0.5
    velocity = simulation.state.velocity.reshape(-1, 2)
    velocity[of_cell] = (middles @ stretch.T)[:, None]
    return simulation


def times_of_steps(pair, cells: int, steps: int, stretch: np.ndarray) -> np.ndarray:
    """Nanoseconds a point of laws that take turns, shape (steps, laws, [visits, all the work]).

    Raises:
        RuntimeError: laws whose solutions take other numbers of sweeps.
    """
    simulations = [flying_apart(law, cells, stretch) for law in pair]
    runs = [simulation.steps(1.0) for simulation in simulations]
    spent = np.empty((FIRST + steps, len(pair), 2))
    for number in range(len(spent)):
        sweeps = []
        for which, (simulation, run) in enumerate(zip(simulations, runs, strict=True)):
            before = simulation.stopwatch.seconds
            sweeps.append(next(run).sweeps)
            after = simulation.stopwatch.seconds
            parts = {phase: after[phase] - before.get(phase, 0.0) for phase in PHASES}
            spent[number, which] = parts[VISIT], sum(parts.values())
        if number >= FIRST and min(sweeps) < max(sweeps):
            raise RuntimeError(f"Laws take {sweeps} sweeps in step {number + 1}: compare others.")
    return 1e9 * spent[FIRST:] / simulations[0].interactions.num_points


def compare(law, reference, options) -> list[str]:
    """What is told of a law: of bonds that weaken and of sound ones, a visit and a step."""
    cells = []
    for stretch in (STRETCH, SLOW * STRETCH):
        runs = [
            times_of_steps((reference, law), options.cells, options.steps, stretch)
            for _ in range(options.repeat)
        ]
        by_hand, its_own = np.min(runs, axis=0).mean(axis=0)
        cells += [f"{its_own[0]:.0f}", f"{its_own[0] / by_hand[0]:.2f}"]
        cells += [f"{its_own[1]:.0f}", f"{its_own[1] / by_hand[1]:.2f}"]
    return cells


def set_up(repeat: int) -> None:
    """Print what simulations of many facets take to be made."""
    mesh = create_rectangle(MPI.COMM_SELF, [[0, 0], [1, 1]], [182, 182], CellType.triangle)
    bodies = xf.explode(mesh)
    strengths = {
        "a number": STRENGTH,
        "Weibull, a facet each": xf.fields.Weibull(STRENGTH, 9.0, seed=1),
        "lognormal, correlated": xf.fields.Lognormal(STRENGTH, 0.2, 0.1, seed=1),
    }
    print(f"\n| strength, {len(bodies.facets)} facets | set-up (processor time, s) |\n|---|---:|")
    least = dict.fromkeys(strengths, np.inf)
    for _ in range(repeat):
        for name, strength in strengths.items():
            start = time.process_time()
            law = xf.laws.CohesiveZone(STIFFNESS, ENERGY, strength)
            scene = xf.Scene(bodies, {1: HEAVY}, default_interaction=law)
            xf.Simulation(scene, 1e-5, scheme="explicit")
            least[name] = min(least[name], time.process_time() - start)
    for name, seconds in least.items():
        print(f"| {name} | {seconds:.2f} |")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cells", type=int, default=10, help="quadrilaterals a side")
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--repeat", type=int, default=10)
    parser.add_argument("--only", default="", help="laws with this in their name")
    options = parser.parse_args()
    print(
        "Nanoseconds a point and step, and beside the same by hand.\n\n"
        "| law | weakening: visits | | step | | sound: visits | | step | |\n"
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|"
    )
    for name, pair in laws().items():
        if options.only in name:
            print(f"| {name} | {' | '.join(compare(*pair, options))} |", flush=True)
    set_up(options.repeat)


if __name__ == "__main__":
    main()
