# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies that all ranks divide anew again and again; the first writes what came out."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import scenes
import touching_bodies
from asked_scenes import run_asked
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import moving_load

from xper_fx.bodies.explode import Bodies
from xper_fx.bodies.meshes import facets_of_cells
from xper_fx.bodies.moved import moved
from xper_fx.nscd.touching import touching_clusters
from xper_fx.output import checkpoint
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.parallel import rebalancing, spread_rebalancing
from xper_fx.parallel.launch import run_together
from xper_fx.parallel.local_bodies import divide
from xper_fx.parallel.rebalancing import Rebalancing
from xper_fx.parallel.spread_rebalancing import SpreadRebalancing
from xper_fx.scene.joints import Hinge
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap
from xper_fx.support.ranks import Ranks

LAST = 16  # step of runs that are recorded
# A step has no work but what is counted; bodies are partitioned at each look.
SMALL = {"_STEP": 0, "_EXCHANGES": 0}
AT_EACH_LOOK = SMALL | {"_LOOKS_EVERY": 4, "_PRICE": -1.0, "_WORTH": -np.inf}
# In steps 7 and 13.
TWICE = AT_EACH_LOOK | {"_LOOKS_EVERY": 3, "_PRICE": 0.3}


def run(name: str) -> dict[str, np.ndarray]:
    """A scene of `touching_bodies`, and how often its bodies were partitioned; or the pile."""
    if name == "pile":
        with patch.multiple(rebalancing, **SMALL, _PRICE=10.0):
            return moving_load.run(moving_load.pile(6, 6, MPI.COMM_SELF), 160, 160)
    if name == "hinged":
        return hinged()
    if name == "again":
        return again()
    if name == "there_and_back":
        return there_and_back()
    if name == "asked":
        return asked()
    partition = rebalancing.partition_bodies
    with (
        patch.multiple(rebalancing, **AT_EACH_LOOK),
        patch.object(rebalancing, "partition_bodies", wraps=partition) as calls,
    ):
        return touching_bodies.run(name) | {"partitions": calls.call_count}


def hinged() -> dict[str, np.ndarray]:
    """A run goes on with a hinge between spheres that two ranks had."""
    scene, options, _ = touching_bodies.pelted()
    first = Simulation(scene, **options)
    for _ in first.steps(4 * first.step_size):
        pass
    share = first.model.rigid_share
    ranks = np.zeros(2) if share is None else share.rank_of_body[:2]
    hinge = Hinge(scene.rigid[:2], at=(0.5, 0.5, 0.5), axis=(0.0, 0.0, 1.0))
    second = Simulation(replace(scene, joints=[hinge], after=first.snapshot()), **options)
    for _ in second.steps(8 * second.step_size):
        pass
    return {"ranks": ranks, "solids": second.rigid.state.velocity}


@contextmanager
def to_and_fro() -> Iterator[None]:
    """Let bodies of spread meshes go to the other end of the ranks every four steps."""
    bisected = spread_rebalancing.bisected

    def turned(ranks, x, work):
        mean = ranks.sum(x.sum(axis=0)) / ranks.sum(len(x))
        ahead = ranks.comm.bcast(x.mean(axis=0)) - mean
        first_is_low = ahead[np.argmax(np.abs(ahead))] < 0.0
        return bisected(ranks, -x if first_is_low else x, work)

    with (
        patch.multiple(rebalancing, **AT_EACH_LOOK),
        patch.object(spread_rebalancing, "bisected", turned),
    ):
        yield


def spread_plates() -> Simulation:
    """Plates that break, of a mesh that is spread over all ranks and made anew."""
    scenes.COMM = MPI.COMM_WORLD
    scene, options, _ = touching_bodies.explicit_shards()
    scenes.COMM = MPI.COMM_SELF
    return Simulation(scene, **options)


def again() -> dict[str, np.ndarray]:
    """Energies of bodies that go to and fro; of runs that go on, before and after a division.

    And of one in which sweeps take the place of turns in a step in which bodies are to be divided.
    """
    found: dict[str, list] = {}
    with to_and_fro(), TemporaryDirectory() as own:
        base, simulation = Path(MPI.COMM_WORLD.bcast(own)), spread_plates()
        for record in simulation.steps(LAST * simulation.step_size):
            found.setdefault("whole", []).append(list(record.energies.values()))
            if record.step in (8, 10):
                checkpoint.save(base / f"{record.step}.h5", simulation)
        for step in (8, 10):
            simulation = spread_plates()
            checkpoint.restore(base / f"{step}.h5", simulation)
            for record in simulation.steps(LAST * simulation.step_size):
                found.setdefault(f"from_{step}", []).append(list(record.energies.values()))
    with patch.multiple(rebalancing, **AT_EACH_LOOK), patch.object(touching_clusters, "_TURNS", 1):
        scene, options, _ = touching_bodies.explicit_shards()
        simulation = Simulation(scene, max_halvings=0, **options)
        for record in simulation.steps(LAST * simulation.step_size):
            found.setdefault("swept", []).append(list(record.energies.values()))
        found["sweeps"] = [simulation.model.sweeps]
    return {name: np.array(energies) for name, energies in found.items()}


def asked() -> dict[str, np.ndarray]:
    """Costs, as ranks ask for them and where all know all; ranks and work of bodies that move."""
    scenes.COMM = comm = MPI.COMM_WORLD
    ranks = Ranks(comm)
    # ten strips, the lower half of four cells each, the upper of twelve
    label = lambda x: (10 * x[0]).astype(int) + 10 * (x[1] > 0.25)  # noqa: E731
    bodies = scenes.box_bodies((1, 1), (10, 4), label=label)
    scenes.COMM = MPI.COMM_SELF
    part, meshed = divide(bodies, ranks), 20
    at = np.array(bodies.numbers_on_all(part.body_numbers))
    rank_of_all, cells = np.zeros((2, meshed), int)
    rank_of_all[at], cells[at] = comm.rank, np.bincount(part.bodies.body_of_cell)
    rank_of_all, cells = ranks.sum(np.stack([rank_of_all, cells])).astype(int)
    # of two rigid bodies the second is held
    rank_of_rigid, moves = np.array([1, 0]), np.array([True, False])
    own = np.stack([at, np.where(at % 10 == 2, meshed, meshed + 1)], axis=1)
    contacts = np.repeat(own, np.where(at % 10 < 3, 4, 1), axis=0)
    facing = bodies.numbers_on_all(bodies.facets.bodies)
    points = facing[rank_of_all[facing[:, 0]] == comm.rank]
    near = np.concatenate([own[:1, :1], own[:1, :1]], axis=1)
    spread = SpreadRebalancing(ranks, part, rank_of_rigid, moves, np.arange(2))
    whole = Rebalancing(ranks, np.r_[rank_of_all, rank_of_rigid], cells, moves, np.arange(2))
    with patch.multiple(rebalancing, **AT_EACH_LOOK):
        places = np.stack([at % 10 + 0.5, at // 10 + 0.5], axis=1)
        places = np.concatenate([places, [[0.0, 0.0], [0.0, 0.0]]])
        costs = []
        for pairs in (own, contacts):
            spread.look(points, pairs, near, lambda: places)
            whole.look(np.concatenate(comm.allgather(points)), pairs, near)
            costs.append((spread.cost, whole.cost))
    saved = spread.saved()
    of_cell = ranks.gather(*saved["rank_of_cell"])
    label = ranks.gather(part.bodies.parent_cell, part.bodies.labels[part.bodies.body_of_cell])
    every = np.concatenate(comm.allgather(contacts))
    work = 2 * np.bincount(label) + 30 * np.bincount(every[:, 0], minlength=meshed)
    work += 2 * np.bincount(np.concatenate(comm.allgather(points)).ravel(), minlength=meshed)
    rank = np.empty(meshed, int)
    rank[label] = of_cell
    return {
        "costs": np.array(costs).T, "rank": rank, "work": work,
        "rank_of_rigid": saved["rank_of_body"],
        "work_of_rigid": 30 * np.count_nonzero(every[:, 1] == meshed),
    }  # fmt: skip


def there_and_back() -> dict[str, np.ndarray]:
    """What a rank knows of blocks at first, on the next rank, and back; cells that each knows."""
    scenes.COMM = comm = MPI.COMM_WORLD
    label = lambda x: np.where(x[1] < 0.4, (4 * x[0]).astype(int), 1e4 * x[0] + 1e8 * x[1])  # noqa: E731
    bodies = scenes.box_bodies((1, 1), (8, 8), label=label, material={2: lambda x: x[0] > 0.5})
    scenes.COMM = MPI.COMM_SELF
    bodies.mesh.geometry.x[:, 0] += 0.1 * bodies.parent_vertex  # not where it was cut
    table = bodies.facets.midpoint @ (3.0, 5.0)
    knows, told = [bodies], [table]
    for step in (1, -1):
        now, spread = knows[-1], knows[-1].spread
        own = spread.rank_of_body[now.body_of_cell] == comm.rank
        there = np.full(np.count_nonzero(own), (comm.rank + step) % comm.size)
        now, (table,) = moved(now, there, told[-1:])
        knows.append(now)
        told.append(table)
        np.testing.assert_allclose(table, now.facets.midpoint @ (3.0, 5.0), rtol=1e-14)
    described = [of_all(known, comm) for known in knows]
    numbers = np.array([comm.allgather(len(known.body_of_cell)) for known in knows])
    return described[0] | {f"then_{k}": v for k, v in described[1].items()} | {
        f"back_{k}": v for k, v in described[2].items()
    } | {"known": numbers}  # fmt: skip


def of_all(bodies: Bodies, comm: MPI.Comm) -> dict[str, np.ndarray]:
    """What ranks know of bodies together, in an order that none decides."""
    facets, cells = bodies.facets, geometry_dofmap(bodies.mesh)
    tag = np.zeros(bodies.mesh.topology.index_map(1).size_local)
    tag[bodies.facet_tags.indices] = bodies.facet_tags.values
    by_cell = np.column_stack([
        bodies.parent_cell, bodies.labels[bodies.body_of_cell], bodies.material_of_cell,
        bodies.cell_tags.values, tag[facets_of_cells(bodies.mesh)], bodies.parent_vertex[cells],
        bodies.mesh.geometry.x[cells].reshape(len(cells), -1),
    ])  # fmt: skip
    pairs = bodies.parent_cell[facets.cells], bodies.labels[facets.bodies]
    by_facet = np.column_stack([*pairs, *(
        array.reshape(len(facets), -1)
        for name, array in vars(facets).items() if name not in ("cells", "bodies")
    )])  # fmt: skip
    whole = {name: np.concatenate(comm.allgather(rows))
             for name, rows in (("cells", by_cell), ("facets", by_facet))}  # fmt: skip
    return {name: rows[np.lexsort(rows.T[::-1])] for name, rows in whole.items()}


def record(folder: str, last: int, restart: bool) -> None:
    """Run plates that break up to a step, or go on to it; the folder's name says how meshed."""
    spread = folder.endswith("spread")
    scene, options, _ = touching_bodies.explicit_shards()
    with to_and_fro() if spread else patch.multiple(rebalancing, **TWICE):
        simulation = spread_plates() if spread else Simulation(scene, **options)
        end = LAST * simulation.step_size
        recorder = Recorder(
            simulation, folder, end_time=end, fields=6, fragments=True, restart=restart
        )
        part = simulation.part
        for step, _ in recorded_steps(recorder, last * simulation.step_size, "run", quiet=True):
            if simulation.part is not part:
                part = simulation.part
                print("divided anew in step", step.step)


if __name__ == "__main__":
    run_together(lambda: run_asked(run, record))
