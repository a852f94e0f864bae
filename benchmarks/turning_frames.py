# SPDX-License-Identifier: LGPL-3.0-or-later
"""What frames that turn cost an explicit step, and what they keep over many turns.

    ./fenicsx python3 benchmarks/turning_frames.py [--cells 40 8] [--turns 40]

Corrections: cells are pressed to half, sheared by 0.6 and pulled to twice their height, in ten
static steps, with the matrix of the monolithic solver and with one that lacks the second
derivatives of jumps (M of `nscd/turning_tangents.py`); the ratio of processor times is the median.

Cost: a plate and a box of neo-Hookean cells on bonds that hold, pulled slowly, are stepped by turns
with frames that turn and with frames that stay, one thread. They stay where no material names the
effect "finite strain". The ratio is that of processor times, the median over pairs of batches.

Drift: a square of bonded cells spins freely for many turns, with C_N = C_T and with another C_T, at
the step that is picked and at half of it: errors of momentum and of the energy that is held, what
contacts took, and what was booked as numerical.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from time import process_time
from unittest.mock import patch

import numpy as np
from dolfinx.mesh import CellType, create_box
from mpi4py import MPI

import xper_fx as xf
from xper_fx.bodies.explode import EACH_CELL
from xper_fx.bodies.meshes import crossed_rectangle, tag_facets
from xper_fx.nscd import turning_tangents
from xper_fx.support.errors import ConvergenceError

BATCH, PAIRS = 10, 24
LARGE = {"pressed": (0.0, -0.5), "sheared": (0.6, 0.0), "pulled": (0.0, 1.0)}
LOWER, UPPER = 1, 2


@dataclass(frozen=True)
class Unnamed(xf.materials.NeoHookean):
    """A neo-Hookean material that does not say that it is one: frames stay."""

    effects = ()


def pulled(dim: int, cells: int, material) -> xf.Simulation:
    """A plate or a box whose bonds hold."""
    if dim == 2:
        mesh = crossed_rectangle((0.0, 0.0), (1.0, 1.0), (cells, cells), MPI.COMM_SELF)
    else:
        corners = [np.zeros(3), np.ones(3)]
        mesh = create_box(MPI.COMM_SELF, corners, [cells] * 3, CellType.tetrahedron)
    tags = tag_facets(
        mesh, {LOWER: lambda x: np.isclose(x[1], 0.0), UPPER: lambda x: np.isclose(x[1], 1.0)}
    )
    scene = xf.Scene(
        xf.explode(mesh, EACH_CELL, facet_tags=tags),
        {1: material(100.0, 0.3, 1.0)},
        default_interaction=xf.laws.CohesiveZone(1e5, 1e-3, 2.0, friction=0.05),
        loads=[
            xf.PrescribedVelocity(UPPER, 1, 3e-3),
            xf.PrescribedVelocity(LOWER, 1, -3e-3),
        ],
    )
    simulation = xf.Simulation(scene, scheme="explicit", num_threads=1, forgiving=True)
    advance(simulation)
    return simulation


def advance(simulation: xf.Simulation) -> float:
    """Processor time of a step (s), the mean of a batch."""
    start = process_time()
    list(simulation.steps(simulation.time + BATCH * simulation.step_size))
    return (process_time() - start) / BATCH


def cost(dim: int, cells: int) -> str:
    """One line."""
    kept, turning = (pulled(dim, cells, kind) for kind in (Unnamed, xf.materials.NeoHookean))
    times = np.array([(advance(kept), advance(turning)) for _ in range(PAIRS)])
    ratio = np.median(times[:, 1] / times[:, 0])
    without, with_frames = 1e3 * np.median(times, axis=0)
    return (
        f"{dim}D, {len(kept.interactions)} points: {without:.1f} ms a step with frames that stay, "
        f"{with_frames:.1f} ms with frames that turn, ratio {ratio:.2f}"
    )


def strained(moved: tuple[float, float]) -> tuple[float, int, float]:
    """Processor time (s), corrections, and the time that the run came to, of 1 s."""
    mesh = crossed_rectangle((0.0, 0.0), (1.0, 1.0), (3, 3), MPI.COMM_SELF)
    tags = tag_facets(
        mesh, {LOWER: lambda x: np.isclose(x[1], 0.0), UPPER: lambda x: np.isclose(x[1], 1.0)}
    )
    loads = [xf.PrescribedVelocity(LOWER, i, 0.0) for i in range(2)]
    loads += [xf.PrescribedVelocity(UPPER, i, v) for i, v in enumerate(moved)]
    scene = xf.Scene(
        xf.explode(mesh, EACH_CELL, facet_tags=tags),
        {1: xf.materials.NeoHookean(1.0, 0.3, 1.0)},
        default_interaction=xf.laws.CohesiveZone(30.0, 50.0, 3.0, 10.0),
        loads=loads,
    )
    simulation = xf.Simulation(scene, 0.1, inertia=False, num_threads=1)
    start, corrections = process_time(), 0
    try:
        for record in simulation.steps(1.0):
            corrections += record.newton_iterations
    except ConvergenceError:
        pass
    return process_time() - start, corrections, simulation.time


def without_second_derivatives(moved: tuple[float, float]) -> tuple[float, int, float]:
    """As `strained`, with a matrix that lacks M."""
    whole = turning_tangents.springs
    with patch.object(turning_tangents, "springs", lambda g, k, _: whole(g, k, 0.0)):
        return strained(moved)


def corrections(name: str) -> str:
    """One line."""
    runs = [(strained(LARGE[name]), without_second_derivatives(LARGE[name])) for _ in range(3)]
    (_, few, end), (_, many, other) = runs[-1]
    ratio = np.median([exact[0] / rough[0] for exact, rough in runs])
    return (
        f"cells {name}: {few} corrections to {end:.2f} s, without second derivatives {many} to "
        f"{other:.2f} s, ratio of processor times {ratio:.2f}"
    )


def drift(turns: int, tangential: float, share: float) -> str:
    """One line.

    Args:
        turns: of the square.
        tangential: C_T, where C_N is 1000 (Pa/m).
        share: of the step that is picked.
    """
    scene = xf.Scene(
        xf.explode(crossed_rectangle((0.0, 0.0), (1.0, 1.0), (3, 3), MPI.COMM_SELF), EACH_CELL),
        {1: xf.materials.NeoHookean(100.0, 0.3, 1.0)},
        default_interaction=xf.laws.CohesiveZone(1000.0, 0.5, 8.0, tangential),
        initial_velocity=lambda x: np.stack([0.5 - x[1], x[0] - 0.5]),
    )
    step = share * xf.Simulation(scene, scheme="explicit").step_size
    simulation = xf.Simulation(scene, step, scheme="explicit", num_threads=1)
    x = simulation.forms.V.tabulate_dof_coordinates()[:, :2]
    mass = simulation.bulk.mass[::2]

    def momentum() -> float:
        place = x + simulation.state.displacement.reshape(-1, 2)
        p = mass[:, None] * simulation.state.velocity.reshape(-1, 2)
        return float(np.sum(place[:, 0] * p[:, 1] - place[:, 1] * p[:, 0]))

    start, kinetic = momentum(), simulation.ledger.energies.kinetic
    worst = total = 0.0
    for record in simulation.steps(2.0 * np.pi * turns):
        energies = record.energies
        worst = max(worst, abs(momentum() / start - 1.0))
        held = energies["kinetic"] + energies["elastic"] + energies["cohesive"]
        total = max(total, abs(held / kinetic - 1.0))
    lost = {name: energies[f"dissipated_{name}"] / kinetic for name in ("impact", "numerical")}
    return (
        f"C_T / C_N = {tangential / 1000.0:.1f}, {share:.1f} of the step, {turns} turns, "
        f"{simulation.step_number} steps: angular momentum off by {worst:.1e}, energy held by "
        f"{total:.1e}; contacts took {lost['impact']:.1e}, numerical {lost['numerical']:.1e}"
    )


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, nargs=2, default=[40, 8], help="a side, in 2D and 3D")
    parser.add_argument("--turns", type=int, default=40)
    arguments = parser.parse_args()
    for dim, cells in zip((2, 3), arguments.cells, strict=True):
        print(cost(dim, cells), flush=True)
    for name in LARGE:
        print(corrections(name), flush=True)
    for tangential, share in ((1000.0, 1.0), (300.0, 1.0), (300.0, 0.5)):
        print(drift(arguments.turns, tangential, share), flush=True)


if __name__ == "__main__":
    main()
