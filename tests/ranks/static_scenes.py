# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static and monolithic runs of meshed bodies by all ranks; the first writes what came out."""

from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from unittest.mock import patch

import meshed_scenes
import numpy as np
import periodic_cells
import scenes
from asked_scenes import run_asked
from dolfinx.mesh import create_box
from mpi4py import MPI
from scenes import BOTTOM, LEFT, RIGHT, TOP, box_bodies, mesh_of, midpoints

import xper_fx as xf
from xper_fx.bodies.join import join_meshes
from xper_fx.bulk import augmented_lagrangian
from xper_fx.bulk.rigid_motions import loose_bodies
from xper_fx.output.recorder import Recorder, macroscopic_columns
from xper_fx.output.run import recorded_steps
from xper_fx.parallel import coupled_rows
from xper_fx.parallel.exchange import Exchange
from xper_fx.parallel.launch import run_together
from xper_fx.simulation import path
from xper_fx.support.ranks import Ranks

ELASTIC = xf.materials.LinearElastic(1.0, 0.3, 1.0)
ELASTIC_CELL = xf.materials.LinearElastic(100.0, 0.3, 1.0)
GLUE = xf.laws.CohesiveZone(1e3, 1e3, 1e2)
STATIC = {"inertia": False, "newton_tolerance": 1e-11}


def moved(*motions):
    """Displacements of sides; a rate is one of time."""
    return [
        xf.PrescribedDisplacement(side, axis, (lambda t, r=rate: r * t) if rate else 0.0)
        for side, axis, rate in motions
    ]


def quarters(x):
    return 4 * (1.999 * x[1]).astype(int) + (1.999 * x[0]).astype(int)


def uneven(stiffness, energy):
    """Bonds that are weak here and strong there."""
    return xf.laws.CohesiveZone(
        stiffness, energy, lambda x: 1e-2 * (1.0 + 0.3 * np.sin(3.0 * x[0] + x[1])), friction=0.3
    )


def drawn():
    """Triangles whose bonds weaken and break, the weakest first; some close on each other."""
    scene = xf.Scene(
        box_bodies((2.0, 1.0), (6, 3)), {1: ELASTIC}, default_interaction=uneven(1e2, 4e-3),
        loads=moved((LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (RIGHT, 0, 2e-2)),
    )  # fmt: skip
    return scene, {"step": 0.25, **STATIC}, 20


def wedged():
    """Loose triangles of a strip that bends: nothing but contact and soft shear holds them."""
    bond = xf.laws.CohesiveZone(10.0, 1e3, 1e-4)
    scene = xf.Scene(
        box_bodies((4.0, 1.0), (16, 4)), {1: ELASTIC}, default_interaction=bond,
        loads=moved((LEFT, 0, 0.0), (LEFT, 1, 0.0), (RIGHT, 1, 1e-2)),
    )  # fmt: skip
    return scene, {"step": 1.0, **STATIC}, 2


def turned():
    """Blocks at finite strain whose bonds turn with them as the end is lifted, on a wall."""
    scene = xf.Scene(
        box_bodies((2.0, 1.0), (8, 4), label=quarters), {1: xf.materials.NeoHookean(1.0, 0.3, 1.0)},
        default_interaction=xf.laws.CohesiveZone(1e2, 4e-2, 5e-2),
        walls=[xf.Wall(BOTTOM, (0.0, -1e-2), (0.0, 1.0), xf.laws.SignoriniCoulomb(0.2))],
        loads=[*moved((LEFT, 0, 0.0), (LEFT, 1, 0.0), (RIGHT, 1, -5e-2)),
               xf.BodyForce((0.0, -1e-3))],
    )  # fmt: skip
    return scene, {"step": 1.0, **STATIC}, 4


def rigid():
    """Initially rigid bonds in space, of strengths from place to place, opened."""
    law = xf.laws.RigidCohesiveZone(lambda x: 1e-2 * (1.0 + 0.2 * np.sin(5.0 * x[1])), 8e-3)
    scene = xf.Scene(
        box_bodies((2.0, 1.0, 1.0), (4, 2, 2), "hexahedron"), {1: ELASTIC},
        default_interaction=law,
        loads=moved((LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (5, 2, 0.0), (RIGHT, 0, 8e-2)),
    )  # fmt: skip
    return scene, {"step": 1.0, **STATIC}, 6


def touching():
    """Two plates of bonded blocks, pressed together and shorn by a searched contact."""
    bodies = box_bodies(
        (2.0, 1.0), (8, 8), label=lambda x: (3.999 * x[0]).astype(int) + 4 * (x[1] > 0.5),
        material={2: lambda x: x[1] > 0.5 - 1e-9},
    )  # fmt: skip
    scene = xf.Scene(
        bodies, {1: ELASTIC, 2: ELASTIC}, interactions={(1, 2): None}, default_interaction=GLUE,
        surfaces={"lower": (1,), "upper": (2,)},
        contacts=[
            xf.Contact(("lower", "upper"), xf.laws.SignoriniCoulomb(0.3)),
            xf.Contact(("lower", "lower"), None), xf.Contact(("upper", "upper"), None),
        ],
        loads=moved((BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0), (TOP, 0, 1e-3), (TOP, 1, -2e-3)),
    )  # fmt: skip
    return scene, {"step": 1.0, **STATIC}, 4


def nearing():
    """Blocks on a plate and one that comes down on them, in steps picked until they touch."""
    meshes = [mesh_of((2.0, 1.0), (8, 4)), mesh_of((1.0, 1.0), (3, 3))]
    meshes[1].geometry.x[:, :2] += (0.5, 1.05)
    tags = [
        xf.tag_facets(
            meshes[0],
            {LEFT: lambda x: x[0] < 1e-9, RIGHT: lambda x: x[0] > 2.0 - 1e-9,
             BOTTOM: lambda x: x[1] < 1e-9},
        ),
        xf.tag_facets(meshes[1], {TOP: lambda x: x[1] > 2.05 - 1e-9}),
    ]  # fmt: skip
    cells = [xf.tag_cells(mesh, {}, number + 1) for number, mesh in enumerate(meshes)]
    joined = join_meshes(meshes, cell_tags=cells, facet_tags=tags)
    scene = xf.Scene(
        xf.explode(joined.mesh, joined.part, joined.cell_tags, joined.facet_tags),
        {1: ELASTIC, 2: ELASTIC}, surfaces={"lower": (1,), "upper": (2,)},
        contacts=[xf.Contact(("lower", "upper"), xf.laws.SignoriniCoulomb(0.3))],
        loads=moved((LEFT, 0, 0.0), (LEFT, 1, 0.0), (BOTTOM, 1, 0.0), (RIGHT, 0, 1e-2),
                    (TOP, 0, 0.0), (TOP, 1, -0.1)),
    )  # fmt: skip
    return scene, {"accuracy": 1e-2, "end_time": 0.6, "tolerance": 1e-12, **STATIC}, 200


def held():
    """Two blocks, each held by itself, that press each other: solved at their points."""
    scene = xf.Scene(
        box_bodies((2.0, 1.0), (8, 4), label=lambda x: (x[0] > 1.0).astype(int)), {1: ELASTIC},
        default_interaction=xf.laws.SignoriniCoulomb(0.3),
        loads=moved((LEFT, 0, 0.0), (LEFT, 1, 0.0), (RIGHT, 0, -1e-3), (RIGHT, 1, 1e-3)),
    )  # fmt: skip
    return scene, {"step": 1.0, "tolerance": 1e-11, **STATIC}, 3


def leaning():
    """Blocks that nothing holds: four on a wall, three on these, pushed aside by their weight."""
    scene = xf.Scene(
        box_bodies((4.0, 2.0), (16, 8), label=lambda x: np.where(x[1] < 1, x[0], 4 + x[0] / 1.34)),
        {1: ELASTIC}, default_interaction=xf.laws.SignoriniCoulomb(0.4, contact="position"),
        walls=[xf.Wall(BOTTOM, (0.0, 0.0), (0.0, 1.0), xf.laws.SignoriniCoulomb(0.5))],
        loads=[xf.Gravity(lambda t: (2.0 * t, -9.81 * t))],
    )  # fmt: skip
    return scene, {"step": 0.25, **STATIC}, 4


def pushed():
    """A wall of dry bricks under a beam that presses it and is pushed until it slides."""

    def brick(x):
        course = np.floor(x[1])
        column = np.floor(0.5 * (x[0] + course % 2))
        return np.where(x[1] > 4.0, 0, 1 + 9 * course + column).astype(int)

    scene = xf.Scene(
        box_bodies((6.0, 5.0), (12, 10), label=brick), {1: ELASTIC},
        default_interaction=xf.laws.SignoriniCoulomb(0.5, contact="position"),
        loads=[
            *moved((BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0)),
            xf.Gravity((0.0, -1e-4)),
            xf.SurfaceTraction(TOP, lambda t: (0.0, -1e-3 * min(t, 1.0))),
            xf.PrescribedDisplacement(TOP, 0, lambda t: 2e-2 * max(t - 1.0, 0.0)),
        ],
    )  # fmt: skip
    return scene, {"step": 0.25, **STATIC}, 12


def indented():
    """Four blocks under a disc that is driven into them and along them."""
    bodies = box_bodies((2.0, 1.0), (12, 6), label=lambda x: (1.999 * x[0]).astype(int))
    rubs = xf.laws.SignoriniCoulomb(0.3, contact="position")
    motion = {0: lambda t: 1e-3 * np.sin(3.0 * t), 1: -1e-2, 2: 0.0}
    scene = xf.Scene(
        bodies, {1: ELASTIC}, default_interaction=rubs, surfaces={"blocks": (1,)},
        rigid=[xf.RigidBody(xf.rigid.Disc(0.5), (1.13, 1.5), "tool", prescribed=motion)],
        contacts=[xf.Contact(("blocks", "tool"), rubs), xf.Contact(("blocks", "blocks"), rubs)],
        loads=moved((BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0)),
    )  # fmt: skip
    return scene, {"step": 0.1, "tolerance": 1e-11, **STATIC}, 6


def swept():
    """As `indented`, by sweeps."""
    scene, options, steps = indented()
    return scene, options | {"solver": "nlgs"}, steps


def sprung():
    """As `touching`, by Newton's method, for which floating blocks are on springs that let go."""
    scene, options, steps = touching()
    return scene, options | {"solver": "newton", "tolerance": 1e-11}, steps


def inert():
    """The system with inertia: a plate is torn by a wave."""
    scene, _, _ = drawn()
    loads = moved((LEFT, 0, 0.0), (BOTTOM, 1, 0.0))
    scene = replace(
        scene, default_interaction=uneven(20.0, 4e-2),
        loads=[*loads, xf.PrescribedVelocity(RIGHT, 0, 7e-3)],
        initial_velocity=lambda x: np.stack([np.where(x[0] > 1.999, 7e-3, 0.0), 0.0 * x[0]]),
    )  # fmt: skip
    return scene, {"step": 0.1, "solver": "monolithic", "newton_tolerance": 1e-10}, 16


def tied():
    """Two boxes of blocks, tied in halves by bonds that turn."""
    scene, _, _ = meshed_scenes.tied()
    loads = moved((LEFT, 0, 0.0), (LEFT, 1, 0.0), (RIGHT, 0, 1e-3))
    return replace(scene, loads=loads, initial_velocity=None), {"step": 1.0, **STATIC}, 3


def bridged():
    """Two boxes in space, each one body, which only a tie by nodes joins."""
    corners = [[(0.0, 0.0, 0.0), (0.5, 1.0, 1.0)], [(0.5, 0.0, 0.0), (1.0, 1.0, 1.0)]]
    halves = [create_box(MPI.COMM_SELF, c, (2, 2 + n, 2 + n)) for n, c in enumerate(corners)]
    mesh, tags = meshed_scenes.unmatched(
        join_meshes(halves),
        {LEFT: lambda x: x[0] < 1e-9, RIGHT: lambda x: x[0] > 1.0 - 1e-9,
         11: lambda x: np.abs(x[0] - 0.5) < 1e-9},
    )  # fmt: skip
    own = mesh.topology.index_map(3).size_local
    scene = xf.Scene(
        xf.explode(mesh, (midpoints(mesh)[0, :own] > 0.5).astype(int), facet_tags=tags),
        {1: ELASTIC}, ties=[xf.Tie(16, 11, xf.laws.CohesiveZone(10.0, 1e-2, 0.1), "nodes")],
        loads=moved((LEFT, 0, 0.0), (LEFT, 1, 0.0), (LEFT, 2, 0.0), (RIGHT, 0, 2e-2)),
    )  # fmt: skip
    return scene, {"step": 1.0, **STATIC}, 3


def blocks(x):
    return 4 * (x[1] > 0.0).astype(int) + (3.999 * x[0]).astype(int)


def arms(material):
    """Two arms of four blocks that are pulled apart at their ends: the load rises and falls."""
    mesh = xf.crossed_rectangle((0.0, -0.1), (1.0, 0.1), (12, 2), scenes.COMM)
    tags = xf.tag_facets(mesh, {
        LEFT: lambda x: (x[0] < 1e-9) & (x[1] < 1e-9),
        BOTTOM: lambda x: (x[0] < 1e-9) & (x[1] > -1e-9),
        RIGHT: lambda x: x[0] > 1.0 - 1e-9,
        7: lambda x: (abs(x[1]) < 1e-9) & (x[0] < 0.25 + 1e-9),
        8: lambda x: (abs(x[1]) < 1e-9) & (x[0] > 0.25 - 1e-9),
    })  # fmt: skip
    own = mesh.topology.index_map(2).size_local
    weak = xf.laws.CohesiveZone(1e2, 2e-4, 1e-2)
    return xf.Scene(
        xf.explode(mesh, blocks(midpoints(mesh))[:own], facet_tags=tags), {1: material},
        default_interaction=xf.laws.PerfectBond(), facet_interactions={7: None, 8: weak},
        loads=moved((LEFT, 1, -1e-2), (BOTTOM, 1, 1e-2), (RIGHT, 0, 0.0), (RIGHT, 1, 0.0)),
    )  # fmt: skip


# Steps of paths are to hang on no number of iterations.
MANY = 100


def peeled():
    """A path by growth; ranks have no bond that may weaken, or none that has opened yet."""
    path = xf.GrowthControl(0.1, iterations=MANY)
    return arms(ELASTIC), {"step": 1.0, "path": path, **STATIC}, 20


def unrolled():
    """A path by dissipation at finite strain, whose bonds turn with the arms."""
    path = xf.DissipationControl(1e-6, iterations=MANY)
    return arms(xf.materials.NeoHookean(1.0, 0.3, 1.0)), {"step": 1.0, "path": path, **STATIC}, 8


def row():
    """A row of blocks with one weak section, of which some ranks of a spread mesh know nothing."""
    bodies = box_bodies(
        (4.0, 1.0), (16, 2), "quadrilateral", label=lambda x: (1.999 * x[0]).astype(int),
        interior={7: lambda x: np.isclose(x[0], 0.5)},
    )  # fmt: skip
    weak = xf.laws.CohesiveZone(1e2, 2e-4, 1e-2)
    scene = xf.Scene(
        bodies, {1: ELASTIC}, default_interaction=xf.laws.PerfectBond(),
        facet_interactions={7: weak},
        loads=moved((LEFT, 0, 0.0), (BOTTOM, 1, 0.0), (RIGHT, 0, 1e-2)),
    )  # fmt: skip
    path = xf.GrowthControl(0.2, iterations=MANY)
    return scene, {"step": 1.0, "path": path, **STATIC}, 4


def stopped():
    """A block on a beam, pushed until it rocks and slides: its path has nowhere to go on to."""
    joint = xf.laws.CohesiveZone(82e9, 18.0, 0.25e6, friction=0.7)
    bodies = box_bodies(
        (0.88, 0.625), (8, 10), "quadrilateral",
        label=lambda x: np.where(x[1] > 0.0625, 1 + (x[0] / 0.22).astype(int), 0),
        interior={7: lambda x: np.isclose(x[1], 0.0625)},
    )  # fmt: skip
    scene = xf.Scene(
        bodies, {1: xf.materials.LinearElastic(16.7e9, 0.15, 1900.0)},
        default_interaction=xf.laws.PerfectBond(), facet_interactions={7: joint},
        loads=[*moved((BOTTOM, 0, 0.0), (BOTTOM, 1, 0.0), (TOP, 0, 4e-3)),
               xf.SurfaceTraction(TOP, (0.0, -0.3e6))],
    )  # fmt: skip
    return scene, {"step": 1.0, "path": xf.GrowthControl(), "inertia": False}, 100


def inert_cell():
    """The system of a cell with inertia."""
    scene, _ = periodic_cells.small_strain()
    return scene, {"step": 0.05, "solver": "monolithic", "newton_tolerance": 1e-10}, 6


def cell():
    """Grains of a periodic cell, some tied to themselves across its boundary, that come apart."""
    scene = periodic_cells.grains(ELASTIC_CELL, periodic_cells.MIXED)
    return scene, {"step": 0.1, **STATIC}, 5


def turned_cell():
    """Triangles at finite strain, of which ranks have neighbours across the boundary."""
    scene, _ = periodic_cells.each_cell()
    soft, stiff = (xf.materials.NeoHookean(young, 0.3, 1.0) for young in (100.0, 300.0))
    return replace(scene, materials={1: soft, 2: stiff}), {"step": 0.05, **STATIC}, 6


def celled_path():
    """A cell whose load is found: it goes past its peak."""
    drive = xf.MacroscopicDrive(
        gradient={"11": lambda t: 1.0 + 1e-2 * t, "21": 0.0},
        stress={name: 0.0 for name in ("12", "22")},
    )
    scene, _ = periodic_cells.each_cell()
    path = xf.GrowthControl(0.1, iterations=MANY)
    return replace(scene, macroscopic=drive), {"step": 1.0, "path": path, **STATIC}, 6


def bonded():
    """The blocks of `tied`, which perfect bonds alone hold and which hang on one side.

    Small bodies that are alike have w on all of their nodes; of one rank they are, of two not.
    """
    scene, _, _ = tied()
    bond = xf.laws.PerfectBond()
    scene = replace(
        scene, materials={1: ELASTIC}, default_interaction=bond,
        ties=[replace(tie, law=bond) for tie in scene.ties],
        loads=[*scene.loads, xf.BodyForce((0.0, -1e-3))],
    )  # fmt: skip
    return scene, {"step": 0.5, "tolerance": 1e-12, "solver": "subdomains", **STATIC}, 3


def loose():
    """The plate of `drawn`, which nothing holds."""
    scene, options, steps = drawn()
    return replace(scene, loads=[xf.BodyForce((1e-3, 0.0))]), options, steps


SCENES = {
    f.__name__: f
    for f in (drawn, wedged, turned, rigid, touching, nearing, held, leaning, pushed,
              indented, swept, sprung, inert, tied, bridged,
              peeled, unrolled, row, stopped, inert_cell, cell, turned_cell, celled_path,
              bonded, loose)
}  # fmt: skip


def groups() -> dict[str, np.ndarray]:
    """What is free to move of bodies at random places that are joined at random."""
    ranks, told = Ranks(MPI.COMM_WORLD), []
    for seed in range(30):
        rng, count = np.random.default_rng(seed), 60
        x, joined = rng.random((count, 3, 2)), rng.integers(0, count, (3 * seed + 20, 2))
        held = np.zeros(x.shape, bool)
        held[rng.random(count) < 0.03, 0] = held[rng.random(count) < 0.03, 1] = True
        numbers = np.arange(ranks.rank, count, ranks.size)
        bodies, ways, place = loose_bodies(
            x[numbers].reshape(-1, 2), np.full(len(numbers), 3), held[numbers].reshape(-1, 2),
            joined, numbers, ranks,
        )  # fmt: skip
        told.append([*place, ways, len(bodies), bodies.min(initial=count), bodies.sum()])
    return {"told": np.array(told)}


def stop(scene: xf.Scene, options: dict) -> dict[str, np.ndarray]:
    """Loads of a path up to where it stops, and what each rank tells, after few attempts."""
    loads, told = [], ""
    with (
        patch.object(path, "_LEAST", 0.9),
        patch.object(augmented_lagrangian, "_STANDS", 1),
        patch.object(augmented_lagrangian, "_CIRCLES", 1),
    ):
        simulation = xf.Simulation(scene, **options)
        try:
            for record in simulation.steps(1.0):
                loads.append([record.time, simulation.reaction(TOP)[0]])
        except xf.ConvergenceError as error:
            told = str(error)
    points, everyone = simulation.model.points, simulation.team.comm.allgather
    places = [points.place(k) for k in range(len(simulation.interactions.gather("damage")))]
    return {
        "loads": np.array(loads), "told": np.array(everyone(told)),
        "places": np.array(everyone(np.array(places))),
    }  # fmt: skip


def messages() -> dict[str, np.ndarray]:
    """How often ranks wait for each other: for a correction of `peeled`, in steps with inertia.

    The former counts sums, ghosts and decisions, the latter sums, beside sweeps.
    """
    counts = [0]

    def counted(call):
        def tell(*given):
            counts[0] += 1
            return call(*given)

        return tell

    scene, options, steps = peeled()
    simulation = xf.Simulation(scene, **options)
    sums = patch.object(Ranks, "_of_all", counted(Ranks._of_all))
    with ExitStack() as stack:
        stack.enter_context(sums)
        for name in ("forward", "add_back"):
            ghosts = counted(getattr(Exchange, name))
            stack.enter_context(patch.object(Exchange, name, ghosts))
        records = list(islice(simulation.steps(1e6), steps))
    told = {"messages": counts[0] / sum(record.newton_iterations for record in records)}
    scene, explicit, _ = meshed_scenes.explicit()
    soft = xf.laws.CohesiveZone(1e3, 1.0, 10.0)
    scene, step = replace(scene, default_interaction=soft), 0.002
    swept = {"scheme": "implicit", "solver": "nlgs", "tolerance": 1e-4, "step": step}
    for scheme, its in (("explicit", explicit), ("implicit", swept)):
        simulation = xf.Simulation(scene, **its)
        taken = simulation.steps(20 * simulation.step_size)
        list(islice(taken, 4))
        counts[0] = 0
        with sums:
            records = list(taken)
        told[scheme] = np.array([counts[0], sum(record.sweeps for record in records)]) / 16
    return told


def run(name: str) -> dict[str, np.ndarray]:
    """Histories and final values of a scene, the same on every rank.

    Where a name begins with "spread_" the mesh is spread over the ranks, and fields are sorted;
    where it begins with "factored_" all ranks factor the matrix, as they do a large one.
    """
    if name in ("groups", "messages"):
        return groups() if name == "groups" else messages()
    if name.startswith("factored_"):
        with patch.object(coupled_rows, "_ON_FIRST", 0):
            return run(name.removeprefix("factored_"))
    spread = name.startswith("spread_")
    scenes.COMM = MPI.COMM_WORLD if spread else MPI.COMM_SELF
    scene, options, steps = SCENES[name.removeprefix("spread_")]()
    scenes.COMM = MPI.COMM_SELF
    if name.endswith("stopped"):
        return stop(scene, options)
    path = "path" in options
    end = options.pop("end_time", 1e6 if path else steps * options.get("step", 0.0))
    simulation = xf.Simulation(scene, **options)
    history: dict[str, list] = {}
    sides = sorted({load.facets for load in scene.loads if hasattr(load, "facets")})
    for record in islice(simulation.steps(end), steps):
        if path and record.step == steps // 2:
            saved = simulation.saved_in_order()
        now = record.energies | {"iterations": record.newton_iterations, "time": record.time}
        now["sweeps"] = record.sweeps
        if scene.macroscopic is not None:
            now |= macroscopic_columns(simulation)
        now |= {f"reaction_{side}": simulation.reaction(side) for side in sides}
        for key, value in now.items():
            history.setdefault(key, []).append(value)
    cells = simulation.bodies.parent_cell
    dofmap = simulation.forms.V.dofmap.list
    found = {k: np.array(v) for k, v in history.items()}
    displacement = simulation.displacement.x.array.reshape(-1, scene.dim)[dofmap]
    found["displacement"] = simulation.ranks.gather(cells, displacement)
    if scene.macroscopic is not None:  # the node that is held is another one on ranks
        found["displacement"] -= found["displacement"].mean(axis=(0, 1))
    found["damage"] = simulation.interactions.gather("damage")
    if spread:
        found |= {key: np.sort(found[key].ravel()) for key in ("displacement", "damage")}
    if path:
        again = xf.Simulation(scene, **options)
        again.restore(saved)
        found["again"] = np.array([r.time for r in islice(again.steps(end), steps - steps // 2)])
    everyone = simulation.team.comm.allgather
    bulk = simulation.bulk
    dofs = bulk.num_dofs - (bulk.num_common if simulation.ranks.rank else 0)
    found["held"] = np.array(everyone([simulation.bodies.num_bodies, dofs]))
    return found


def record(folder: str, last: int, restart: bool) -> None:
    """Run to a step of `turned`, or go on to it."""
    scene, options, steps = turned()
    simulation = xf.Simulation(scene, **options)
    recorder = Recorder(simulation, folder, end_time=float(steps), restart=restart)
    for _ in recorded_steps(recorder, float(last), "turned", quiet=True):
        pass


if __name__ == "__main__":
    run_together(lambda: run_asked(run, record))
