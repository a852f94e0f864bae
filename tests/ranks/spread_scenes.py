# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes of meshes that DOLFINx spreads over the ranks; the first writes what came out.

FOLDER, then names of `meshed_scenes`, what to record as NAME=LAST, "held", "balance", "places" or
"wrong".
"""

import sys
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from tempfile import TemporaryDirectory

import cells
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
from xper_fx.periodic.microstructure.mesh import mesh_tessellation
from xper_fx.periodic.microstructure.seeds import random_seeds
from xper_fx.periodic.microstructure.tessellation import tessellate
from xper_fx.scene.fingerprint import fingerprint
from xper_fx.scene.tie import tie_points
from xper_fx.simulation.bulk_resolution import bulk_resolution
from xper_fx.simulation.simulation import Simulation
from xper_fx.study.quantities import CrackPattern, DisplacementL2
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
    found = pieces(simulation) | studied(simulation) | {"crack_area": np.array(broken)}
    found["bulk"] = np.array(bulk_resolution(simulation) or 0.0)
    if scene.dim == 2:
        cracks = xf.output.find_cracks(simulation, inclusion=1, share=0.5)
        told = scenes.COMM.allgather((cracks.segments, cracks.length))
        segments, length = map(np.concatenate, zip(*told, strict=True))
        assert np.all(cracks.kind == 2) and np.isclose(length.sum(), broken, rtol=1e-12)
        ends = np.sort(segments, axis=1).reshape(-1, 4)
        found["crack_ends"] = ends[np.lexsort(ends.round(9).T)]
        if name == "uneven":
            found |= panel(simulation, cracks)
    return (
        {name: np.array(values) for name, values in history.items()}
        | found
        | {
            "damage": np.sort(gather("damage")),
            "jump": np.sort(np.linalg.norm(gather("jump"), axis=1)),
            "area": np.sort(gather("area")),
        }
    )


def panel(simulation: Simulation, cracks: xf.output.Cracks) -> dict[str, np.ndarray]:
    """A panel of cracks on the first rank, by what no numbers decide; others have no cracks."""
    with TemporaryDirectory() as own:
        folder, count = scenes.COMM.bcast(own), len(cracks.kind)
        recorder = xf.Recorder(simulation, folder, end_time=1.0, fields=0)
        made = xf.output.crack_panel(recorder, cracks, "cracks")
        recorder.close()
    assert len(made.crack_kind) == len(made.crack_segments) >= count or scenes.COMM.rank > 0
    corners = (made.points + made.displacement)[made.triangles]
    ends = np.sort(made.crack_segments, axis=1).reshape(-1, 4)
    return {
        "panel": np.sort(corners.mean(axis=1), axis=0),
        "panel_ends": ends[np.lexsort(ends.round(9).T)],
    }


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


def studied(simulation: Simulation) -> dict[str, np.ndarray]:
    """What a study reads of a run: displacements, and cracks beside the same ones moved aside."""
    samples, near = DisplacementL2(300), CrackPattern(radius=0.0937)
    near.observe(simulation, None, None)
    told, cracks = samples.value(simulation, None), near.value(simulation, None)
    aside = np.linspace(0.08, 0.13, simulation.scene.dim)
    others = [cracks | {"points": cracks["points"] + share * aside} for share in (0.5, 0.7, 1.0)]
    every = np.concatenate(scenes.COMM.allgather(cracks["points"]))
    area = np.concatenate(scenes.COMM.allgather(cracks["area"]))
    third = np.lexsort(every.round(9).T)[::3]
    others.append({"points": every[third] + aside, "area": area[third]})  # whole on each rank
    return {
        "samples": np.nan_to_num(told["displacement"]),
        "unlike": np.array([near.error(cracks, other) for other in others]),
        "unlike_back": np.array([near.error(other, cracks) for other in others]),
    }


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


def divisions_of_one_mesh() -> int:
    """How many ways a mesh is partitioned that is made several times."""
    made = [scenes.mesh_of((1, 1), (20, 20)).topology for _ in range(6)]
    return len({tuple(t.original_cell_index[: t.index_map(2).size_local]) for t in made})


def bodies_of_few() -> int:
    """Bodies of this rank, of a plate of a large block and two small ones beside it."""
    label = lambda x: np.where(x[0] < 0.75, 2, 2.0 * x[1])  # noqa: E731
    bodies = scenes.box_bodies((1, 1), (8, 6), label=label)
    return np.count_nonzero(bodies.spread.rank_of_body == WORLD.rank)


def grains(shear: float, hole: bool) -> xf.Bodies:
    """A periodic cell: grains of rectangles, some on both sides, and a hole, or tetrahedra."""
    comm = scenes.COMM
    if hole:
        scenes.COMM = MPI.COMM_SELF
        within = lambda x: np.all(np.abs(x[:2] - 0.5).T < [0.06, 0.13], axis=1)  # noqa: E731
        mesh = cells.without(scenes.mesh_of((1, 1), (9, 8), "quadrilateral"), within, comm)
        scenes.COMM = comm
        tags, voids = {7: lambda x: x[1] < 1e-9, cells.VOID: within}, [cells.VOID]
    else:
        mesh, voids = scenes.mesh_of((1, 1, 1), (6, 3, 3), "tetrahedron"), []
        tags = {7: lambda x: (x[1] < 1e-9) | (x[1] > 1 - 1e-9)}
    dim = mesh.topology.dim
    x = scenes.midpoints(mesh)[:dim, : mesh.topology.index_map(dim).size_local]
    places = np.floor((x.T + 0.2) % 1.0 * ([3, 2] if hole else 99) + 1e-9)
    label = (places @ [1, 99, 9801][:dim]).astype(int)
    tagged = xf.tag_cells(mesh, {2: lambda x: x[1] > 0.5}), xf.tag_facets(mesh, tags)
    mesh.geometry.x[:, 0] += shear * mesh.geometry.x[:, 1]
    lattice = np.eye(dim)
    lattice[1, 0] = shear
    return xf.explode(mesh, label, *tagged, lattice=lattice, voids=voids)


def grown() -> xf.Bodies:
    """Grains that Gmsh has meshed."""
    grains = tessellate(random_seeds(6, (1, 1), 0), (1, 1))
    made = mesh_tessellation(grains, 0.1, [1, 2, 1, 2, 1, 2], scenes.COMM)
    return xf.explode(made.mesh, made.grain, made.cell_tags, lattice=made.lattice)


def places_of_facets(bodies_of: Callable, *given) -> float:
    """How far facets are from those of the whole mesh whose places they should have."""
    scenes.COMM = MPI.COMM_SELF
    whole = bodies_of(*given)
    scenes.COMM = WORLD
    bodies = bodies_of(*given)
    places, count = bodies.facet_places()
    own = bodies.spread.rank_of_body == WORLD.rank
    known, there = own[bodies.facets.bodies], own[bodies.ties.bodies[:, 0]]
    sides = np.sum(WORLD.allgather([np.count_nonzero(known), 2 * np.count_nonzero(there)]), axis=0)
    far = [abs(count - len(whole.facets)), *np.subtract(sides, [2 * count, 2 * len(whole.ties)])]
    far.append(bodies.facet_nodes(2) - whole.facet_nodes(2)[places])
    for name in ("normal", "measure", "tag", "materials"):
        far.append(getattr(bodies.facets, name) - getattr(whole.facets, name)[places])
    if whole.lattice is not None:
        far.append(bodies.labels[bodies.facets.bodies] - whole.labels[whole.facets.bodies[places]])
        x = whole.mesh.geometry.x[:, : whole.mesh.geometry.dim]
        at = cells.wrap(x, whole.lattice).round(9) + 0.0
        vertex = np.unique(at, axis=0, return_inverse=True)[1].ravel()
        vertex = vertex[geometry_dofmap(whole.mesh)]
        label = whole.labels[whole.body_of_cell]
        here = np.isin(vertex, vertex[np.isin(label, bodies.labels[own])]).any(axis=1)
        far.append(len(np.setxor1d(label[here], bodies.labels)))
    return max(np.abs(one).max() for one in far)


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
    run = Simulation(scene, **options)
    pattern = CrackPattern(radius=0.1, ignored_facets=(9,))
    moved_nowhere = xf.PrescribedVelocity(scenes.LEFT, 0, 1.0, where=lambda x: x[0] > 5.0)
    told = []
    spread_state = Simulation(scene, **options).saved_in_order()
    for call in (
        lambda: Simulation(whole, **options),
        lambda: Simulation(scene, step=1e-4 * (1 + WORLD.rank)),
        lambda: Simulation(scene, comm=MPI.COMM_SELF, **options),
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
        lambda: xf.explode(mesh, lattice=(2.0, 0.5)),
        lambda: Simulation(scene, **options).restore(one_state),
        lambda: Simulation(alone, comm=MPI.COMM_SELF, **options).restore(spread_state),
        lambda: replace(scene, loads=[holed_stress]),
        lambda: replace(scene, loads=[moved_nowhere]),
        lambda: pattern.observe(run, None, None),
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
            found["divisions"] = WORLD.gather(divisions_of_one_mesh())
        elif name == "places":
            made = (
                (scenes.box_bodies, (1.0, 3.0), (5, 4), "crossed"),
                (scenes.box_bodies, (1.0, 1.0, 2.0), (2, 3, 2), "tetrahedron"),
                (grains, 0.0, True), (grains, 0.25, False),
            )  # fmt: skip
            made += ((grown,),) if find_spec("gmsh") else ()
            found = {
                "distance": WORLD.gather([places_of_facets(*one) for one in made]),
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
