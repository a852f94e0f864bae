# SPDX-License-Identifier: LGPL-3.0-or-later
"""What ranks gain where bodies are divided among them anew as the load moves.

    mpirun -n 2 python3 benchmarks/moving_load.py [--rows 64 --apart 0.1] [--stay] [--spread]

Rows of blocks, apart from each other, fall on a wall and pile up, the lowest first: a tall column
of them has its load at the lower end for long, where one rank has all blocks. Printed are, of some
steps, contacts and those of the rank that has most over the mean, contacts between bodies of two
ranks, nodes of other ranks that a rank knows, the cost of the partition
(`xper_fx.parallel.division.cost_of_partition`), and the processor time of a step since the last
line, outside of messages and waits: mean of the ranks, and the busiest; at the end how often bodies
were divided, and the same of all steps. With `--stay` bodies stay; with `--spread` DOLFINx spreads
the mesh over the ranks.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import wraps

import numpy as np
from mpi4py import MPI

import xper_fx as xf
from xper_fx.bodies.meshes import midpoints_of
from xper_fx.parallel import rebalancing
from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.launch import run_together
from xper_fx.support.compat import geometry_dofmap
from xper_fx.support.ranks import Ranks

GAP, APART, SPEED, STEP = 0.02, 0.5, 1.0, 4e-3


class Messages:
    """Processor time that this rank spends in messages, where it waits for others too."""

    def __init__(self):
        self.seconds, self._within = 0.0, False

        class Watched(MPI.Intracomm):
            """A communicator whose messages are timed."""

        for name in ("allgather", "alltoall", "bcast", "exscan", "gather", "Allgather",
                     "Allgatherv", "Allreduce", "Bcast", "Gatherv", "Reduce"):  # fmt: skip
            setattr(Watched, name, self._timed(getattr(MPI.Intracomm, name)))
        for name in ("forward", "back", "add_back"):
            setattr(Exchange, name, self._timed(getattr(Exchange, name)))
        begin = Ranks.__init__

        def watched(ranks: Ranks, comm: MPI.Comm) -> None:
            begin(ranks, comm)
            if comm.size > 1:
                ranks.comm = Watched(comm)
                ranks.comm.of = comm  # which is not to be freed before

        Ranks.__init__ = watched

    def _timed(self, call: Callable) -> Callable:
        @wraps(call)
        def timed(*arguments, **named):
            if self._within:
                return call(*arguments, **named)
            self._within, begin = True, time.thread_time()
            try:
                return call(*arguments, **named)
            finally:
                self.seconds += time.thread_time() - begin
                self._within = False

        return timed

    def work(self) -> float:
        """Processor time of this rank so far, outside of messages (s)."""
        return time.process_time() - self.seconds


def blocks(columns: int, rows: int, comm: MPI.Comm) -> xf.Bodies:
    """Blocks of size one side by side, row by row, each of 4 triangles."""
    mesh = xf.crossed_rectangle((0.0, 0.0), (columns, rows), (columns, rows), comm)
    own = mesh.topology.index_map(2).size_local
    middle = midpoints_of(mesh.geometry.x, geometry_dofmap(mesh)[:own])
    column, row = np.floor(middle[:, :2]).astype(int).T
    return xf.explode(mesh, columns * row + column)


def pile(columns: int, rows: int, comm: MPI.Comm, apart: float = APART) -> xf.Scene:
    """Rows of blocks fall on a wall, so far `apart` at the start (m)."""
    bodies = blocks(columns, rows, comm)
    row, column = np.divmod(bodies.labels, columns)
    aside = np.random.default_rng(1).uniform(-0.04, 0.04, columns * rows)[bodies.labels]
    cells, geometry = geometry_dofmap(bodies.mesh), bodies.mesh.geometry
    body = np.zeros(len(geometry.x), int)
    body[cells] = bodies.body_of_cell[:, None]
    shift = np.stack([0.1 * column + aside, GAP + apart * row], axis=1)
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
    scene: xf.Scene, steps: int, every: int, work: Callable[[], float] = time.process_time
) -> dict[str, np.ndarray]:
    """Run a pile and print the counts of some steps.

    Args:
        scene: the pile.
        steps: how many.
        every: of how many one is printed.
        work: gives the processor time of this rank so far (s).

    Returns:
        After each step in which there were contacts, cost, unevenness of contacts, and how often
        bodies had been divided anew.
    """
    simulation = xf.Simulation(scene, STEP, scheme="implicit", solver="nlgs", num_threads=1)
    ranks, part = simulation.ranks, simulation.part
    print("step contacts max/mean cut ghosts cost divided ms/step,mean busiest")
    divided, rows, spent, printed = 0, [], [], 0
    going = simulation.steps(steps * STEP)
    for number in range(1, steps + 1):
        begin = work()
        next(going)
        spent.append(work() - begin)
        divided += simulation.part is not part
        part, balance = simulation.part, simulation.model.balance
        contacts, uneven, cut, ghosts = counts(simulation)
        cost = 1.0 if balance is None else balance.cost
        if contacts:
            rows.append((cost, uneven, divided))
        if number % every == 0:
            mean, most = mean_and_busiest(ranks, spent[printed:])
            printed = number
            print(f"{number} {contacts} {uneven:.2f} {cut} {ghosts:.0f} {cost:.2f} {divided} "
                  f"{mean:.2f} {most:.2f}")  # fmt: skip
    mean, most = mean_and_busiest(ranks, spent)
    share = simulation.stopwatch.seconds.get("balance of ranks", 0.0)
    cost, uneven, often = np.array(rows).T
    print(
        f"mean cost {cost.mean():.3f}, contacts {uneven.mean():.2f} of the mean, divided {divided} "
        f"times; {mean:.2f} ms a step, {most:.2f} of the busiest, of which "
        f"{1e3 * ranks.max(share) / steps:.2f} looks and divisions, waits included"
    )
    return {"cost": cost, "uneven": uneven, "divided": often}


def mean_and_busiest(ranks: Ranks, spent: list[float]) -> tuple[float, float]:
    """Mean over steps of what they took, of all ranks and of the rank that is busiest (ms)."""
    taken = 1e3 * np.mean(spent)
    return ranks.sum(taken) / ranks.size, ranks.max(taken)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--columns", type=int, default=16, help="blocks in a row")
    parser.add_argument("--rows", type=int, default=16, help="of blocks")
    parser.add_argument("--apart", type=float, default=APART, help="distance of rows")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--every", type=int, default=100, help="steps of which a line is printed")
    parser.add_argument("--stay", action="store_true", help="never divide anew")
    parser.add_argument("--spread", action="store_true", help="a mesh that is spread over ranks")
    a = parser.parse_args()
    if a.stay:
        rebalancing._PRICE = np.inf
    messages = Messages()
    comm = MPI.COMM_WORLD if a.spread else MPI.COMM_SELF
    run(pile(a.columns, a.rows, comm, a.apart), a.steps, a.every, messages.work)


if __name__ == "__main__":
    run_together(main)
