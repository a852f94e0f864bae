# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of meshes that DOLFINx spreads over the ranks; the first writes what came out.

FOLDER, then names of `meshed_scenes`, what to record as NAME=LAST, "held", "balance", "places" or
"wrong".
"""

import sys
import tracemalloc
from dataclasses import replace

import meshed_scenes
import numpy as np
import recorded
import scenes
from dolfinx.mesh import Mesh
from mpi4py import MPI
from scenes import RIGHT

import xper_fx as xf
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.output import row_blocks
from xper_fx.parallel.launch import run_together
from xper_fx.scene.fingerprint import fingerprint
from xper_fx.scene.tie import tie_points
from xper_fx.simulation.bulk_resolution import bulk_resolution
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

WORLD = MPI.COMM_WORLD


def run(name: str) -> dict[str, np.ndarray]:
    """Histories and final fields, these by size, of a scene with the mesh on `scenes.COMM`."""
    scene, options, steps = meshed_scenes.SCENES[name]()
    simulation = Simulation(scene, comm=scenes.COMM, **options)
    history: dict[str, list] = {}
    for record in simulation.steps(steps * simulation.step_size):
        history.setdefault("energies", []).append(list(record.energies.values()))
        history.setdefault("mean", []).append(simulation.mean_displacement(RIGHT))
        if scene.loads:
            history.setdefault("reaction", []).append(simulation.reaction(RIGHT))
    gather = simulation.interactions.gather
    broken = xf.output.crack_area(simulation, share=0.5)
    found = pieces(simulation) | {"crack_area": np.array(broken)}
    found["bulk"] = np.array(bulk_resolution(simulation) or 0.0)
    if scene.dim == 2:
        cracks = xf.output.find_cracks(simulation, inclusion=1, share=0.5)
        told = scenes.COMM.allgather((cracks.segments, cracks.length))
        segments, length = map(np.concatenate, zip(*told, strict=True))
        assert np.all(cracks.kind == 2) and np.isclose(length.sum(), broken, rtol=1e-12)
        ends = np.sort(segments, axis=1).reshape(-1, 4)
        found["crack_ends"] = ends[np.lexsort(ends.round(9).T)]
    return (
        {name: np.array(values) for name, values in history.items()}
        | found
        | {
            "damage": np.sort(gather("damage")),
            "jump": np.sort(np.linalg.norm(gather("jump"), axis=1)),
            "area": np.sort(gather("area")),
        }
    )


def pieces(simulation: Simulation) -> dict[str, np.ndarray]:
    """The table of fragments, those of one mass by their places, and how many cells each has."""
    found, everyone = xf.output.measure_fragments(simulation), scenes.COMM.allgather
    mass, centre = (np.concatenate(everyone(part)) for part in (found.mass, found.centre))
    assert np.all(np.diff(mass) < 1e-12 * mass.sum()) and found.count == len(mass)
    order = np.lexsort((*centre.round(9).T, mass.round(9)))
    of_body = xf.output.find_fragments(simulation)
    np.testing.assert_array_equal(of_body, found.fragment)
    bodies, rank = simulation.scene.bodies, scenes.COMM.rank
    own = bodies.spread.rank_of_body[bodies.body_of_cell] == rank if bodies.spread else slice(None)
    of_cell = np.concatenate(everyone(of_body[bodies.body_of_cell][own]))
    rows = {"piece_cells": np.bincount(of_cell, minlength=len(order))[order]}
    for name in meshed_scenes.PIECES:
        rows[f"piece_{name}"] = np.concatenate(everyone(getattr(found, name)))[order]
    return rows


def held_by_dust(comm: MPI.Comm) -> float:
    """Bytes at once to measure fragments of a cell each, over the number of bodies here."""
    scenes.COMM = comm
    bodies = scenes.box_bodies((1, 1), (24, 24))
    scene = xf.Scene(bodies, {1: meshed_scenes.ELASTIC}, default_interaction=meshed_scenes.CONTACT)
    simulation = Simulation(scene, scheme="explicit")
    tracemalloc.start()
    found = xf.output.measure_fragments(simulation)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.count == bodies.counts[0]
    return peak / simulation.bodies.num_bodies


def held(comm: MPI.Comm) -> float:
    """Bytes of all arrays on this rank of a simulation and of what it saves, over its bodies."""
    scenes.COMM = comm
    bodies = scenes.box_bodies((1, 1), (24, 24))
    bond = CohesiveZone(2e4, 0.05, xf.fields.Weibull(10.0, 12.0, seed=1))
    scene = xf.Scene(bodies, {1: meshed_scenes.ELASTIC}, default_interaction=bond)
    simulation = Simulation(scene, scheme="explicit")
    next(simulation.steps(simulation.step_size))
    return bytes_held([simulation, simulation.saved()]) / simulation.bodies.num_bodies


def told_of_ties(comm: MPI.Comm) -> int:
    """Bytes of the tied surfaces, and points on them, that this rank knows at set-up."""
    scenes.COMM = comm
    scene, options, _ = meshed_scenes.tied(16, 24)
    simulation, bodies = Simulation(scene, **options), scene.bodies
    V, part, ranks = simulation.forms.V, simulation.part, simulation.ranks
    return bytes_held([tie_points(tie, V, bodies, part, ranks, True) for tie in scene.ties])


def bytes_held(holder: object) -> int:
    """Bytes of all arrays that an object reaches on this rank."""
    seen: dict[int, int] = {}
    todo = [holder]
    while todo:
        item = todo.pop()
        if id(item) in seen:
            continue
        seen[id(item)] = 0
        if isinstance(item, np.ndarray):
            seen[id(item)] = item.nbytes
        elif isinstance(item, Mesh):
            seen[id(item)] = item.geometry.x.nbytes + geometry_dofmap(item).nbytes
        elif isinstance(item, dict):
            todo += item.values()
        elif isinstance(item, list | tuple | set | frozenset):
            todo += item
        elif type(item).__module__.startswith("xper_fx"):
            todo += vars(item).values() if hasattr(item, "__dict__") else []
    return sum(seen.values())


def blocks_of_one_rank() -> tuple[int, int]:
    """Blocks and their cells on this rank, where a block has most cells of it and some others."""
    mesh = scenes.mesh_of((1, 1), (6, 6))
    mesh_map = mesh.topology.index_map(2)
    # a block a rank, but for each rank's first cell, which is of the next rank's block
    label = np.full(mesh_map.size_local, WORLD.rank)
    label[0] = (WORLD.rank + 1) % WORLD.size
    bodies = xf.explode(mesh, label)
    mine = bodies.spread.rank_of_body == WORLD.rank
    own_label = int(bodies.labels[mine][0]) if np.count_nonzero(mine) == 1 else -1
    cells = int(np.count_nonzero(mine[bodies.body_of_cell]))
    return own_label, cells - mesh_map.size_local


def work_of_ranks() -> list[float]:
    """Work of the ranks over their mean, of a plate that is half two blocks and half cells."""

    def label(x):
        block, cell = np.round(x[1]).astype(int), (4e3 * x[:2]).astype(int)
        return np.where(x[0] < 0.5, block, 10 + 4000 * cell[0] + cell[1])

    bodies = scenes.box_bodies((1, 1), (12, 12), label=label)
    sides = bodies.facets.bodies
    work = np.bincount(bodies.body_of_cell) + 2 * np.bincount(sides.ravel())
    load = WORLD.allgather(int(work[bodies.spread.rank_of_body == WORLD.rank].sum()))
    return np.array(load) / np.mean(load)


def bodies_of_few() -> int:
    """Bodies of this rank, of a plate of a large block and two small ones beside it."""
    label = lambda x: np.where(x[0] < 0.75, 2, 2.0 * x[1])  # noqa: E731
    bodies = scenes.box_bodies((1, 1), (8, 6), label=label)
    return np.count_nonzero(bodies.spread.rank_of_body == WORLD.rank)


def places_of_facets(lengths, cells, kind) -> float:
    """How far facets are from those of the whole mesh of which they should have the places."""
    scenes.COMM = MPI.COMM_SELF
    there = scenes.box_bodies(lengths, cells, kind).facets.midpoint
    scenes.COMM = WORLD
    bodies = scenes.box_bodies(lengths, cells, kind)
    places, count = bodies.facet_places()
    return np.abs(there[places] - bodies.facets.midpoint).max() + abs(count - len(there))


def holed(x: np.ndarray) -> np.ndarray:
    """A field that is not finite at a corner of the unit square, which is on one rank."""
    return np.where(x[0] + x[1] > 1.8, np.nan, 0.0 * x[:2])


def wrong() -> list[str]:
    """What ranks are told that do not agree, or ask for what takes a whole mesh."""
    scenes.COMM = WORLD
    scene, options, _ = meshed_scenes.SCENES["explicit"]()
    other = replace(meshed_scenes.ELASTIC, young=1000.0 + WORLD.rank)
    whole = replace(scene, materials={1: other})
    holed_bond = replace(meshed_scenes.BOND, strength=lambda x: holed(x)[0] + 10.0)
    mesh = scenes.mesh_of((1, 1), (3, 3))
    own = mesh.topology.index_map(2).size_local
    scenes.COMM = MPI.COMM_SELF
    alone, _, _ = meshed_scenes.SCENES["explicit"]()
    one_state = Simulation(alone, comm=MPI.COMM_SELF, **options).saved_in_order()
    scenes.COMM = WORLD
    holed_stress = xf.InitialStress(lambda x: holed(x)[0] * np.eye(2)[..., None])
    moved_nowhere = xf.PrescribedVelocity(scenes.LEFT, 0, 1.0, where=lambda x: x[0] > 5.0)
    told = []
    spread_state = Simulation(scene, **options).saved_in_order()
    for call in (
        lambda: Simulation(whole, **options),
        lambda: Simulation(scene, step=1e-4 * (1 + WORLD.rank)),
        lambda: Simulation(scene, comm=MPI.COMM_SELF, **options),
        lambda: Simulation(scene, step=1e-4, scheme="implicit", solver="subdomains"),
        lambda: Simulation(
            replace(
                scene,
                default_interaction=replace(meshed_scenes.BOND, strength=np.full(9, 9.0)),
            ),
            **options,
        ),
        lambda: Simulation(replace(scene, initial_velocity=holed), **options),
        lambda: Simulation(replace(scene, default_interaction=holed_bond), **options),
        lambda: xf.explode(mesh, np.full(own, -WORLD.rank)),
        lambda: xf.explode(mesh, lattice=(1.0, 1.0)),
        lambda: xf.output.take_frame(Simulation(scene, **options), "", ""),
        lambda: Simulation(scene, **options).restore(one_state),
        lambda: Simulation(alone, comm=MPI.COMM_SELF, **options).restore(spread_state),
        lambda: replace(scene, loads=[holed_stress]),
        lambda: replace(scene, loads=[moved_nowhere]),
    ):
        try:
            call()
            told.append("nothing")
        except ValueError as error:
            told.append(f"{type(error).__name__}: {error}")
    return told


def main() -> None:
    folder = sys.argv[1]
    row_blocks._BLOCK = 1000  # bytes: checkpoints are written and read in many blocks
    for name in sys.argv[2:]:
        scenes.COMM = WORLD
        if "=" in name:
            found, last = name.split("=")
            recorded.run(f"{folder}/{found}", int(last), "restart" in found)
        elif name == "held":
            spread, divided = held(WORLD), held(MPI.COMM_SELF)
            found = {"spread": WORLD.gather(spread), "divided": WORLD.gather(divided)}
            ties = told_of_ties(WORLD), told_of_ties(MPI.COMM_SELF)
            found["ties"] = WORLD.gather(ties)
            found["dust"] = WORLD.gather(held_by_dust(WORLD))
        elif name == "balance":
            found = {"cells": WORLD.gather(blocks_of_one_rank()), "work": work_of_ranks()}
            found["few"] = WORLD.gather(bodies_of_few())
        elif name == "places":
            boxes = ((1.0, 3.0), (5, 4), "crossed"), ((1.0, 1.0, 2.0), (2, 3, 2), "tetrahedron")
            found = {
                "distance": WORLD.gather([places_of_facets(*box) for box in boxes]),
                "described": str(fingerprint(meshed_scenes.uneven()[0], [0.0])),
            }
            name = f"places_{WORLD.size}"
        elif name == "wrong":
            found = {"told": WORLD.gather(wrong())}
        else:
            found = run(name)
        if WORLD.rank == 0 and isinstance(found, dict):
            np.savez(f"{folder}/{name}.npz", **found)


if __name__ == "__main__":
    run_together(main)
