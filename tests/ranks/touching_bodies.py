# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshed bodies whose contacts are searched, run by all ranks; the first writes what came out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from asked_scenes import run_asked
from scenes import BOTTOM, box_bodies, mesh_of

from xper_fx.bodies.explode import explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import tag_cells
from xper_fx.forms.loads import Gravity, PrescribedVelocity
from xper_fx.materials import LinearElastic, NeoHookean
from xper_fx.nscd.laws import (
    CohesiveZone,
    RigidCohesiveZone,
    SignoriniCoulomb,
    SlipWeakening,
)
from xper_fx.nscd.laws.fields import Weibull
from xper_fx.nscd.rigid import Disc, Polygon, Polyhedron, RigidBody, Sphere, wall
from xper_fx.output.contact_forces import find_contact_forces
from xper_fx.output.fragments import measure_fragments
from xper_fx.output.joint_forces import find_joint_forces
from xper_fx.output.recorder import Recorder
from xper_fx.output.run import recorded_steps
from xper_fx.parallel.launch import run_together
from xper_fx.scene import Scene, Wall
from xper_fx.scene.contact import Contact
from xper_fx.scene.joints import Hinge, Slider, Tendon
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.compat import geometry_dofmap

ELASTIC = LinearElastic(1000.0, 0.3, 1.0)
BOND = CohesiveZone(2e4, 0.05, 10.0, friction=0.3)
GLUE = CohesiveZone(2e4, 50.0, 1000.0)
RUB = SignoriniCoulomb(0.4)
LAST = 14  # step of runs that are recorded
HELD = dict.fromkeys(range(3), 0.0)
EACH_OTHER = {
    "interactions": {(1, 1): None},
    "surfaces": {"blocks": (1,)},
    "contacts": [Contact(("blocks", "blocks"), RUB)],
}


def apart(counts, cells, kind="crossed", gap=0.02, seed=3):
    """Blocks of a box pulled apart, each moved at random by up to a fifth of the gap."""
    counts = np.array(counts)

    def label(x):
        place = (x[: len(counts)].T * counts * (1.0 - 1e-9)).astype(int)
        return np.ravel_multi_index(tuple(place.T), counts)

    bodies = box_bodies((1.0,) * len(counts), cells, kind=kind, label=label)
    random = np.random.default_rng(seed)
    moved = random.uniform(-0.2, 0.2, (counts.prod(), len(counts)))
    place = np.stack(np.unravel_index(bodies.labels, counts), axis=1)
    shift = gap * (place + moved[bodies.labels])
    body = np.zeros(len(bodies.mesh.geometry.x), int)
    body[geometry_dofmap(bodies.mesh)] = bodies.body_of_cell[:, None]
    bodies.mesh.geometry.x[:, : len(counts)] += shift[body]
    return bodies


def inwards(x):
    """Towards the middle, turning."""
    out = 1.2 * (0.55 - x)
    out[0] += x[1] - 0.5
    return out


def cloud():
    """Blocks fly into each other; nothing else is there."""
    scene = Scene(
        apart((4, 3), (12, 9)), {1: ELASTIC}, initial_velocity=lambda x: 2.0 * inwards(x[:2]),
        **EACH_OTHER,
    )  # fmt: skip
    return scene, {"step": 2e-3, "tolerance": 1e-10, "scheme": "implicit"}, 13


def explicit():
    """The same by an explicit bulk."""
    scene, _, _ = cloud()
    return scene, {"scheme": "explicit", "tolerance": 1e-11}, 26


def boxes():
    """Hexahedra and edges that cross."""
    scene = Scene(
        apart((2, 2, 2), (4, 4, 4), "hexahedron"), {1: ELASTIC}, initial_velocity=inwards,
        **EACH_OTHER,
    )  # fmt: skip
    return scene, {"step": 2e-3, "tolerance": 1e-10, "scheme": "implicit"}, 16


def heap():
    """Courses of order 2 at finite strain fall on a wall and on each other."""
    scene = Scene(
        apart((2, 3), (4, 6)), {1: NeoHookean(1000.0, 0.3, 1.0)}, order=2,
        walls=[Wall(BOTTOM, (0.0, -5e-3), (0.0, 1.0), RUB)], loads=[Gravity((2.0, -20.0))],
        initial_velocity=lambda x: np.stack([0.0 * x[0], -1.0 + 0.0 * x[0]]), **EACH_OTHER,
    )  # fmt: skip
    return scene, {"step": 1e-3, "tolerance": 1e-10, "newton_tolerance": 1e-11}, 26


def flying_plates(bodies, shift, speed, spread, material, bond, one_mesh=True):
    """Two plates, of material 1 and 2, fly into each other as they are drawn out of shape."""
    second = np.unique(geometry_dofmap(bodies.mesh)[bodies.material_of_cell == 2])
    bodies.mesh.geometry.x[second, :2] += shift
    velocity = {
        tag: lambda x, v=v: np.stack([v + 0.5 * (x[0] - 1.0), spread * (x[1] - 0.5)])
        for tag, v in ((1, speed), (2, -speed))
    }
    return Scene(
        bodies, {1: material, 2: material}, default_interaction=bond,
        interactions={(1, 2): None} if one_mesh else {}, surfaces={"left": (1,), "right": (2,)},
        contacts=[
            Contact(pair, RUB)
            for pair in (("left", "right"), ("left", "left"), ("right", "right"))
        ],
        initial_velocity=velocity,
    )  # fmt: skip


def shards():
    """Two plates of bonded blocks, drawn out of shape, break and fly into each other."""
    bodies = box_bodies(
        (2.0, 1.0), (12, 6),
        label=lambda x: 3 * (2.999 * x[0]).astype(int) + (2.999 * x[1]).astype(int),
        material={2: lambda x: x[0] > 1.0 - 1e-9},
    )  # fmt: skip
    scene = flying_plates(bodies, (0.01, 0.13), 0.7, 6.0, ELASTIC, BOND)
    return scene, {"step": 1e-3, "tolerance": 1e-10, "scheme": "implicit"}, 30


def at_finite_strain(scene):
    """The same, of a material whose bonds turn with it."""
    return replace(scene, materials=dict.fromkeys(scene.materials, NeoHookean(1000.0, 0.3, 1.0)))


def turning_shards():
    """The same at finite strain, until the plates have met."""
    scene, options, _ = shards()
    return at_finite_strain(scene), options, 13


def explicit_shards():
    """The same by an explicit bulk."""
    scene, _, _ = shards()
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 16


def split_shards():
    """Two plates of cells that initially rigid bonds join fly into each other and break."""
    bodies = box_bodies((2.0, 1.0), (10, 5), material={2: lambda x: x[0] > 1.0 - 1e-9})
    bond = RigidCohesiveZone(Weibull(10.0, 12.0, seed=1), 0.1)
    scene = flying_plates(bodies, (0.004, 0.13), 0.5, 4.0, ELASTIC, bond)
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 24


def turning_split_shards():
    """The same at finite strain."""
    scene, options, steps = split_shards()
    return at_finite_strain(scene), options, steps


def lone():
    """A plate that initially rigid bonds join flies into one body, alone on its rank."""
    meshes = [mesh_of((1.0, 1.0), (cells, cells)) for cells in (4, 9)]
    meshes[1].geometry.x[:, 0] += 1.0
    tags = [tag_cells(mesh, {tag: everywhere}) for tag, mesh in enumerate(meshes, 1)]
    joined = join_meshes(meshes, tags)
    each_and_one = np.minimum(np.arange(len(joined.part)), 64)
    bodies = explode(joined.mesh, each_and_one, joined.cell_tags)
    bond = RigidCohesiveZone(Weibull(10.0, 12.0, seed=1), 0.1)
    scene = flying_plates(bodies, (0.004, 0.13), 0.5, 4.0, ELASTIC, bond, one_mesh=False)
    # the critical step of bodies of several sizes is estimated, on other ranks otherwise
    return scene, {"step": 1e-3, "scheme": "explicit", "tolerance": 1e-10}, 36


def turning_lone():
    """The same at finite strain, where the block's rank has no points whose frames turn."""
    scene, options, steps = lone()
    return at_finite_strain(scene), options, steps


def everywhere(x):
    """At all cells."""
    return np.ones(x.shape[1], bool)


def slide():
    """A beam of bonded blocks slides over another, from block to block; friction weakens.

    A node that has slid passes to a block of another rank, and rubs again from step 31 on.
    """
    bodies = box_bodies(
        (2.0, 0.5), (16, 4), label=lambda x: 2 * (1.9999 * x[0]).astype(int) + (x[1] > 0.25),
        material={2: lambda x: x[1] > 0.25 - 1e-9},
    )  # fmt: skip
    upper = np.unique(geometry_dofmap(bodies.mesh)[bodies.material_of_cell == 2])
    bodies.mesh.geometry.x[upper, :2] += (0.03, 1e-4)
    scene = Scene(
        bodies, {1: ELASTIC, 2: ELASTIC}, interactions={(1, 2): None}, default_interaction=GLUE,
        surfaces={"lower": (1,), "upper": (2,)},
        contacts=[
            Contact(("lower", "upper"), SlipWeakening(0.6, 0.1, 0.2)),
            Contact(("lower", "lower"), None), Contact(("upper", "upper"), None),
        ],
        loads=[PrescribedVelocity(BOTTOM, 0, 0.0), PrescribedVelocity(BOTTOM, 1, 0.0),
               Gravity((0.0, -10.0))],
        initial_velocity={
            tag: lambda x, v=v: np.stack([v + 0.0 * x[0], 0.0 * x[0]])
            for tag, v in ((1, 0.0), (2, 2.0))
        },
    )  # fmt: skip
    return scene, {"step": 2e-3, "tolerance": 1e-10, "scheme": "implicit"}, 36


def struck():
    """Two discs, one after the other, break a plate on an anvil; shards fall on a wall."""
    bodies = box_bodies(
        (1.0, 0.5), (8, 4), label=lambda x: 2 * (3.999 * x[0]).astype(int) + (x[1] > 0.25)
    )
    solids = [
        RigidBody(Disc(0.1), (0.37, 0.62), "ball", density=20.0, velocity=(0.3, -3.0), spin=2.0),
        RigidBody(Disc(0.1), (0.46, 0.87), "ball", density=20.0, velocity=(0.0, -4.0)),
        RigidBody(Polygon.box((0.2, 0.1)), (0.42, -0.051), "anvil", prescribed=HELD),
        wall((0.0, -0.02), (0.0, 1.0), "floor"),
    ]
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=BOND, surfaces={"plate": (1,)}, rigid=solids,
        contacts=[
            Contact(pair, RUB)
            for pair in (
                ("plate", "plate"), ("plate", "ball"), ("ball", "ball"), ("plate", "anvil"),
                ("plate", "floor"), ("ball", "anvil"), ("ball", "floor"),
            )
        ],
        loads=[Gravity((0.0, -10.0))],
    )  # fmt: skip
    return scene, {"step": 1e-3, "tolerance": 1e-10, "scheme": "implicit"}, 48


def split_struck():
    """Cells that initially rigid bonds join, drawn out of shape, fly into discs and on a floor.

    Discs resist rolling on each other; one tows an arm that a wire holds.
    """
    solids = [
        RigidBody(Disc(0.15), (1.17, 0.53), "ball", density=5.0, velocity=(-1.0, 0.1), spin=2.0),
        RigidBody(Disc(0.1), (1.45, 0.57), "ball", density=20.0, velocity=(-1.5, 0.0)),
        RigidBody(Polygon.box((0.4, 0.05)), (1.65, 0.57), "arm", density=5.0, velocity=(-1.5, 0.0)),
        wall((0.0, -0.05), (0.0, 1.0), "floor"),
    ]
    scene = Scene(
        box_bodies((1.0, 1.0), (5, 5)), {1: ELASTIC}, surfaces={"plate": (1,)}, rigid=solids,
        default_interaction=RigidCohesiveZone(Weibull(10.0, 12.0, seed=1), 0.1),
        contacts=[
            Contact(pair, RUB)
            for pair in (
                ("plate", "plate"), ("plate", "ball"), ("plate", "floor"), ("ball", "floor"),
            )
        ] + [Contact(("ball", "ball"), SignoriniCoulomb(0.4, rolling=0.2))]
        + [Contact((name, "arm"), None) for name in ("plate", "ball", "arm", "floor")],
        joints=[
            Hinge((solids[1], solids[2]), at=(1.45, 0.57), friction=0.05, limits=(-0.1, 0.1)),
            Tendon((None, solids[2]), at=[(2.2, 0.9), (1.85, 0.57)], stiffness=20.0, prestress=1.0),
        ],
        initial_velocity=lambda x: np.stack([1.0 + 0.5 * (x[0] - 1.0), 4.0 * (x[1] - 0.5)]),
    )  # fmt: skip
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 34


def turning_split_struck():
    """The same at finite strain."""
    scene, options, steps = split_struck()
    return at_finite_strain(scene), options, steps


def split_walled():
    """As `split_shards`, beside a floor that rubs."""
    scene, options, steps = split_shards()
    return replace(scene, walls=[Wall(BOTTOM, (0.0, -0.02), (0.0, 1.0), RUB)]), options, steps


def turning_split_walled():
    """The same at finite strain."""
    scene, options, steps = split_walled()
    return at_finite_strain(scene), options, steps


def split_pelted():
    """Tetrahedra that initially rigid bonds join are drawn out of shape; solids fly into them."""
    scene, _, _ = pelted()
    sphere, _, box = scene.rigid
    scene = replace(
        scene, bodies=box_bodies((1, 1, 1), (3, 3, 2), kind="tetrahedron"), rigid=[sphere, box],
        interactions={}, default_interaction=RigidCohesiveZone(Weibull(10.0, 12.0, seed=1), 0.1),
        initial_velocity=lambda x: np.stack([3.0 * (x[0] - 0.5), 2.0 * (x[1] - 0.5), 0.0 * x[2]]),
    )  # fmt: skip
    # later contacts can push in more ways than one
    return scene, {"scheme": "explicit", "tolerance": 1e-10}, 11


def rammed():
    """A hinged ball on a swinging bar and a sliding one that tows a weight break a plate."""
    bodies = box_bodies(
        (1.0, 0.5), (8, 4), label=lambda x: 2 * (3.999 * x[0]).astype(int) + (x[1] > 0.25)
    )
    bar = RigidBody(Polygon.box((0.05, 0.4)), (-0.12, 0.7), "bar", density=5.0,
                    velocity=(1.0, 0.0), spin=5.0)  # fmt: skip
    hung = RigidBody(Disc(0.1), (-0.12, 0.3), "ball", density=20.0, velocity=(3.0, 0.0), spin=5.0)
    held = RigidBody(Disc(0.1), (1.12, 0.21), "ball", density=20.0, velocity=(-3.0, 0.0))
    weight = RigidBody(Disc(0.05), (1.5, 0.3), "bar", density=20.0, velocity=(-2.0, 0.1))
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=BOND, surfaces={"plate": (1,)},
        rigid=[held, bar, weight, hung],
        contacts=[
            Contact(("plate", "plate"), RUB), Contact(("plate", "ball"), RUB),
            Contact(("plate", "bar"), RUB), Contact(("ball", "ball"), None),
            Contact(("ball", "bar"), None), Contact(("bar", "bar"), None),
        ],
        joints=[
            Slider((None, held), at=held.position, axis=(1.0, 0.0), friction=0.5),
            Hinge((bar, hung), at=(-0.12, 0.5), friction=0.01, limits=(-0.1, 0.1)),
            Tendon((held, weight), at=[held.position, weight.position], stiffness=50.0,
                   prestress=1.0),
            Hinge((None, bar), at=(-0.12, 0.9)),
        ],
    )  # fmt: skip
    return scene, {"step": 1e-3, "tolerance": 1e-10, "scheme": "implicit"}, 13


def pelted():
    """Spheres and a tumbling box fly into hexahedra in space, and meet none of each other."""
    solids = [
        RigidBody(Sphere(0.2), (0.25, 0.25, 1.25), "solid", density=5.0, velocity=(0.2, 0.1, -4.0)),
        RigidBody(Sphere(0.2), (0.78, 0.8, -0.25), "solid", density=5.0, velocity=(0.0, -0.2, 4.0)),
        RigidBody(
            Polyhedron.box((0.3, 0.3, 0.3)), (0.8, 1.22, 0.5), "solid", density=5.0,
            velocity=(-0.3, -3.0, 0.0), spin=(3.0, 1.0, 2.0),
        ),
    ]  # fmt: skip
    scene = Scene(
        apart((2, 2, 2), (4, 4, 4), "hexahedron"), {1: ELASTIC}, rigid=solids,
        interactions={(1, 1): None}, surfaces={"blocks": (1,)},
        contacts=[
            Contact(("blocks", "blocks"), RUB), Contact(("blocks", "solid"), RUB),
            Contact(("solid", "solid"), None),
        ],
    )  # fmt: skip
    return scene, {"step": 2e-3, "tolerance": 1e-10, "scheme": "implicit"}, 16


SCENES = {
    f.__name__: f
    for f in (
        cloud, explicit, boxes, heap, shards, turning_shards, explicit_shards, split_shards,
        turning_split_shards, lone, turning_lone, slide, struck, split_struck,
        turning_split_struck, split_walled, turning_split_walled, rammed, pelted, split_pelted,
    )
}  # fmt: skip


def run(name: str) -> dict[str, np.ndarray]:
    """Histories and final values of a scene, the same on every rank."""
    scene, options, steps = SCENES[name]()
    simulation = Simulation(scene, **options)
    history: dict[str, list] = {}

    def momentum():
        values = (simulation.bulk.mass * simulation.state.velocity).reshape(-1, scene.dim)
        solid = 0.0 if simulation.rigid is None else simulation.rigid.momentum()
        return simulation.ranks.sum(values.sum(axis=0)) + solid

    start, gather = momentum(), simulation.ranks.gather
    for record in simulation.steps(steps * simulation.step_size):
        forces = find_contact_forces(simulation)
        now = record.energies | {
            "momentum": momentum(), "pushed": len(forces.force), "sweeps": record.sweeps,
            "force": np.abs(forces.force).sum(axis=0),
        }  # fmt: skip
        for key, value in now.items():
            history.setdefault(key, []).append(value)
    cells = simulation.bodies.parent_cell
    dofmap = simulation.forms.V.dofmap.list
    found = {
        name: gather(cells, getattr(simulation.state, name).reshape(-1, scene.dim)[dofmap])
        for name in ("displacement", "velocity")
    }
    order = np.lexsort((*forces.position.T.round(6), *forces.bodies.T))
    found |= {f"contact_{k}": v[order] for k, v in forces._asdict().items()}
    pieces = measure_fragments(simulation)
    moved = np.column_stack([pieces.mass, pieces.mass[:, None] * pieces.velocity, pieces.volume])
    found |= {"fragment": pieces.fragment, "pieces": moved, "start": start}
    if scene.joints:
        rows = simulation.team.comm.allgather(len(simulation.model.joints.here))
        found |= {"joint_force": np.column_stack(find_joint_forces(simulation)), "rows": rows}
    interactions = simulation.interactions
    contacts = sum(map(len, interactions.contacts))
    others = sum(map(len, interactions.passing))
    permanent = simulation.ranks.sum(sum(map(len, interactions.groups)) - others)
    if simulation.rigid is not None:
        state = simulation.rigid.state
        found |= {"solids": np.column_stack([state.position, state.velocity, state.turn.spin])}
    found |= {"damage": interactions.gather("damage"), "jump": interactions.gather("jump"),
              "retired": interactions.num_points - permanent}  # fmt: skip
    everyone = simulation.team.comm.allgather
    found["held"] = np.array(everyone([
        simulation.bodies.num_bodies, simulation.bulk.num_dofs,
        contacts, interactions.inverse.num_nodes - interactions.own_inverse.num_nodes,
        *searched(simulation),
    ]))  # fmt: skip
    return {k: np.array(v) for k, v in (history | found).items()}


def searched(simulation) -> tuple[int, int]:
    """Pairs that this rank looks at, and facets of which it knows the nodes."""
    search = simulation.detection._surfaces
    lists = search.lists
    return lists.num_pairs, len(lists.known(np.arange(len(search.surface))))


RECORDED = {
    "rammed": rammed, "struck": split_struck, "walled": turning_split_walled,
}  # fmt: skip


def record(folder: str, last: int, restart: bool) -> None:
    """Run to a step of one of `RECORDED`, with whose name the folder's begins, or go on to it."""
    scene, options, _ = RECORDED[Path(folder).name.partition("_")[0]]()
    simulation = Simulation(scene, **options)
    end = LAST * simulation.step_size
    recorder = Recorder(simulation, folder, end_time=end, fields=10, restart=restart)
    for _ in recorded_steps(recorder, last * simulation.step_size, "run", quiet=True):
        pass


if __name__ == "__main__":
    run_together(lambda: run_asked(run, record))
