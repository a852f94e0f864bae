# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks gain where bodies are divided among them anew as the load moves, by counts.

    mpirun -n 2 python3 benchmarks/moving_load.py [--blocks 16] [--stay] [--spread]

Rows of blocks, apart from each other, fall on a wall and pile up, the lowest first. Printed are, of
some steps, contacts and those of the rank that has most over the mean, contacts between bodies of
two ranks, nodes of other ranks that a rank knows, and the cost of the partition
(`xper_fx.parallel.division.cost_of_partition`); at the end how often bodies were divided, the
processor time of all ranks, and the seconds of looks and divisions. With `--stay` bodies stay; with
`--spread` DOLFINx spreads the mesh over the ranks.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from mpi4py import MPI

import xper_fx as xf
from xper_fx.bodies.meshes import midpoints_of
from xper_fx.parallel import rebalancing
from xper_fx.parallel.launch import run_together
from xper_fx.support.compat import geometry_dofmap

GAP, SPEED, STEP = 0.02, 1.0, 4e-3


def blocks(size: int, cells: int, comm: MPI.Comm) -> xf.Bodies:
    """Blocks of size one in a square, row by row, each of 4 cells^2 triangles."""
    count = size * cells
    mesh = xf.crossed_rectangle((0.0, 0.0), (size, size), (count, count), comm)
    own = mesh.topology.index_map(2).size_local
    middle = midpoints_of(mesh.geometry.x, geometry_dofmap(mesh)[:own])
    column, row = np.floor(middle[:, :2]).astype(int).T
    return xf.explode(mesh, size * row + column)


def pile(size: int, cells: int, comm: MPI.Comm) -> xf.Scene:
    """Rows of blocks fall on a wall, each half a block above the one below it."""
    bodies = blocks(size, cells, comm)
    row, column = np.divmod(bodies.labels, size)
    aside = np.random.default_rng(1).uniform(-0.04, 0.04, size**2)[bodies.labels]
    cells, geometry = geometry_dofmap(bodies.mesh), bodies.mesh.geometry
    body = np.zeros(len(geometry.x), int)
    body[cells] = bodies.body_of_cell[:, None]
    shift = np.stack([0.1 * column + aside, GAP + 0.5 * row], axis=1)
    geometry.x[:, :2] += shift[body]
    rub = xf.laws.SignoriniCoulomb(friction=0.3)
    return xf.Scene(
        bodies, {1: xf.materials.LinearElastic(1000.0, 0.3, 1.0)}, interactions={(1, 1): None},
        surfaces={"blocks": (1,)}, rigid=[xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "floor")],
        contacts=[xf.Contact(("blocks", name), rub) for name in ("blocks", "floor")],
        initial_velocity=lambda x: np.stack([0.0 * x[0], -SPEED + 0.0 * x[0]]),
    )  # fmt: skip


def counts(simulation: xf.Simulation) -> tuple[float, ...]:
    """Of contacts, unknowns and ghosts what the docstring names."""
    points, ranks = simulation.interactions, simulation.ranks
    slots = [g.points.nodes[:, :, 0] for g in points.contacts]
    slots = np.concatenate([np.zeros((0, 2), int), *slots])
    contacts = ranks.comm.allgather(len(slots))
    # slots of bodies of other ranks come after its own
    own, known = points.own_inverse.num_nodes, points.inverse.num_nodes
    cut = int(ranks.sum(np.count_nonzero(((own <= slots) & (slots < known)).any(axis=1))))
    ghosts = ranks.max(known - own)
    mean = max(np.mean(contacts), 1.0 / ranks.size)
    return sum(contacts), max(contacts) / mean, cut, ghosts


def run(
    size: int, cells: int, steps: int, every: int, comm: MPI.Comm = MPI.COMM_SELF
) -> dict[str, np.ndarray]:
    """Run the pile and print the counts of some steps.

    Returns:
        After each step in which there were contacts, cost, unevenness of contacts, and how often
        bodies had been divided anew.
    """
    simulation = xf.Simulation(
        pile(size, cells, comm), STEP, scheme="implicit", solver="nlgs", num_threads=1
    )
    print("step contacts max/mean cut ghosts cost divided")
    divided, part, began, rows = 0, simulation.part, time.process_time(), []
    for record in simulation.steps(steps * STEP):
        divided += simulation.part is not part
        part, balance = simulation.part, simulation.model.balance
        contacts, uneven, cut, ghosts = counts(simulation)
        cost = 1.0 if balance is None else balance.cost
        if contacts:
            rows.append((cost, uneven, divided))
        if record.step % every == 0:
            print(f"{record.step} {contacts} {uneven:.2f} {cut} {ghosts:.0f} {cost:.2f} {divided}")
    spent = simulation.ranks.sum(time.process_time() - began)
    share = simulation.stopwatch.seconds.get("balance of ranks", 0.0)
    cost, uneven, often = np.array(rows).T
    print(
        f"mean cost {cost.mean():.3f}, contacts {uneven.mean():.2f} of the mean, divided "
        f"{divided} times; {spent:.1f} s, looks and divisions {simulation.ranks.sum(share):.1f} s"
    )
    return {"cost": cost, "uneven": uneven, "divided": often}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--blocks", type=int, default=16, help="in a row")
    parser.add_argument("--cells", type=int, default=1, help="on a side of a block")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--every", type=int, default=100, help="steps of which a line is printed")
    parser.add_argument("--stay", action="store_true", help="never divide anew")
    parser.add_argument("--spread", action="store_true", help="a mesh that is spread over ranks")
    a = parser.parse_args()
    if a.stay:
        rebalancing._PRICE = np.inf
    comm = MPI.COMM_WORLD if a.spread else MPI.COMM_SELF
    run(a.blocks, a.cells, a.steps, a.every, comm)


if __name__ == "__main__":
    run_together(main)
