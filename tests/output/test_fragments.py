# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pieces cut at known bonds, moving in known ways: numbers of fragments to rounding."""

from __future__ import annotations

import csv

import meshio
import numpy as np
import pytest
from scenes import box_bodies, nodes, run

import xper_fx as xf
from xper_fx.materials.hardening import Linear
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb
from xper_fx.output.connectivity import find_fragments
from xper_fx.output.fragments import measure_fragments
from xper_fx.output.history import read_history

CUT, DENSITY, YOUNG = 7, 2.0, 1000.0
LINEAR = xf.materials.LinearElastic(YOUNG, 0.3, DENSITY)
NEO_HOOKEAN = xf.materials.NeoHookean(YOUNG, 0.3, DENSITY)
BOND = CohesiveZone(2e4, 0.05, 10.0)
# Of the short and of the long piece of a strip.
VELOCITY, SPIN = np.array([[0.3, -0.7, 0.2], [1.1, 0.4, -0.5]]), np.array([[3.0], [-2.0]])
SPINS = np.array([[0.5, -1.0, 2.0], [-0.3, 0.8, 1.5]])


def strip(dim, cell, order=1, material=LINEAR, start=None):
    """Five blocks of side 1 in a row, bonded for good but at x = 2: pieces of 2 and of 3."""
    bodies = box_bodies(
        (5, 1, 1)[:dim], (5, 2, 2)[:dim], cell, label=lambda x: x[0],
        material={2: lambda x: x[0] > 2.0 - 1e-9},
        interior={CUT: lambda x: np.abs(x[0] - 2.0) < 1e-9},
    )  # fmt: skip
    scene = xf.Scene(
        bodies, {1: material, 2: material}, order=order, default_interaction=PerfectBond(),
        facet_interactions={CUT: SignoriniCoulomb()}, initial_velocity=start,
    )  # fmt: skip
    return xf.Simulation(scene, 1e-3, num_threads=1)


def turning(x, centre, velocity, spin):
    """Velocity of a rigid piece, shape (dim, n)."""
    arm = x[: len(centre)].T - centre
    if len(centre) == 2:
        return (velocity[:2] + spin * np.column_stack([-arm[:, 1], arm[:, 0]])).T
    return (velocity + np.cross(spin, arm)).T


def flying(dim, cell, order=1, stretching=0.0):
    """The strip, its short piece and its long one turning about their centres.

    The long one stretches along x besides.
    """
    centres = np.array([[1.0, 0.5, 0.5], [3.5, 0.5, 0.5]])[:, :dim]
    spins = SPIN if dim == 2 else SPINS

    def short(x):
        return turning(x, centres[0], VELOCITY[0], spins[0])

    def long(x):
        out = turning(x, centres[1], VELOCITY[1], spins[1])
        out[0] += stretching * (x[0] - 3.5)
        return out

    return strip(dim, cell, order, start={1: short, 2: long})


CELLS = [
    (2, "crossed", 1), (2, "triangle", 2), (2, "quadrilateral", 1), (2, "quadrilateral", 2),
    (3, "hexahedron", 1), (3, "tetrahedron", 2),
]  # fmt: skip


@pytest.mark.parametrize("dim, cell, order", CELLS)
def test_masses_motion_and_sizes_of_two_pieces(dim, cell, order):
    simulation = flying(dim, cell, order)
    found = measure_fragments(simulation)
    exact = {"rel": 1e-12, "abs": 1e-12}
    assert len(found) == 2 and found.time == 0.0
    # the heaviest first: three blocks, those of x > 2
    assert found.fragment.tolist() == [1, 1, 0, 0, 0]
    assert found.bodies.tolist() == [3, 2]
    assert found.mass == pytest.approx([3.0 * DENSITY, 2.0 * DENSITY], **exact)
    assert found.volume == pytest.approx([3.0, 2.0], **exact)
    middle = [0.5] * (dim - 1)
    assert found.centre == pytest.approx(np.array([[3.5, *middle], [1.0, *middle]]), **exact)
    assert found.lengths == pytest.approx(
        np.array([[3.0, *[1.0] * (dim - 1)], [2.0, *[1.0] * (dim - 1)]]), **exact
    )
    assert found.elongation == pytest.approx([3.0, 2.0], **exact)
    ball = np.pi * found.diameter**dim / (4.0 if dim == 2 else 6.0)
    assert ball == pytest.approx(found.volume, **exact)
    assert found.velocity == pytest.approx(VELOCITY[::-1, :dim], **exact)
    assert found.spin == pytest.approx((SPIN if dim == 2 else SPINS)[::-1], **exact)
    translation = 0.5 * found.mass * np.sum(VELOCITY[::-1, :dim] ** 2, axis=1)
    assert found.translation == pytest.approx(translation, **exact)
    assert found.vibration == pytest.approx([0.0, 0.0], abs=1e-12)
    assert found.elastic == pytest.approx([0.0, 0.0], abs=1e-12)
    assert not found.border.any() and not found.inside.any()


@pytest.mark.parametrize("dim, cell, order", CELLS[:1] + CELLS[-1:])
def test_sums_over_pieces_are_those_of_the_scheme(dim, cell, order):
    simulation = flying(dim, cell, order, stretching=0.9)
    run(simulation, 2)
    found = measure_fragments(simulation)
    mass = simulation.bulk.mass.reshape(-1, dim)
    x = nodes(simulation) + simulation.state.displacement.reshape(-1, dim)
    p = mass * simulation.state.velocity.reshape(-1, dim)
    exact = {"rel": 1e-12, "abs": 1e-12}
    assert found.mass.sum() == pytest.approx(mass[:, 0].sum(), rel=1e-13)
    of_pieces = found.mass[:, None] * found.velocity
    assert of_pieces.sum(axis=0) == pytest.approx(p.sum(axis=0), **exact)
    wide = [np.pad(a, ((0, 0), (0, 3 - dim))) for a in (x, p, found.centre, of_pieces)]
    angular = np.cross(wide[0], wide[1]).sum(axis=0)
    orbital = np.cross(wide[2], wide[3]).sum(axis=0)
    orbital[3 - found.spin.shape[1] :] += found.angular_momentum.sum(axis=0)
    assert orbital == pytest.approx(angular, **exact)
    kinetic = found.translation + found.rotation + found.vibration
    energies = simulation.ledger.energies
    assert kinetic.sum() == pytest.approx(energies.kinetic, rel=1e-12)
    assert found.elastic.sum() == pytest.approx(energies.elastic, rel=1e-12)
    assert energies.elastic > 0.0


def test_what_stretches_is_vibration():
    simulation = flying(2, "crossed", stretching=0.9)
    found = measure_fragments(simulation)
    mass = simulation.bulk.mass[::2]
    own = nodes(simulation)[:, 0] - 3.5
    x = own[simulation.bulk.layout.body_of_node() >= 2]
    m = mass[simulation.bulk.layout.body_of_node() >= 2]
    assert found.vibration == pytest.approx([0.5 * 0.81 * m @ x**2, 0.0], rel=1e-12, abs=1e-13)
    assert found.spin == pytest.approx(SPIN[::-1], rel=1e-12)


HARDENING = Linear(50.0)
MATERIALS = {
    "linear": LINEAR,
    "neo-Hookean": NEO_HOOKEAN,
    "plastic": xf.materials.J2SmallStrain(YOUNG, 0.3, 6.0, HARDENING, DENSITY),
    "viscous": xf.materials.LinearViscoelastic(YOUNG, 0.3, [(0.5, 1e-3)], DENSITY),
}


@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_energy_is_stored_in_the_piece_that_is_stretched(material):
    """The short piece is twice as long: its lengths, and the ledger's energy, are all its own."""
    simulation = strip(2, "crossed", material=material)
    x = nodes(simulation)
    short = simulation.bulk.layout.body_of_node() < 2
    state, bulk = simulation.state, simulation.bulk
    amount = 1e-4 if hasattr(material, "response") else 1.0
    state.displacement.reshape(-1, 2)[short, 0] = amount * x[short, 0]
    state.internal[:] = bulk.internal(state.displacement)
    found = measure_fragments(simulation)
    stored = bulk.elastic_energy(state.displacement, state.internal)
    assert stored > 0.0
    assert found.elastic == pytest.approx([0.0, stored], rel=1e-12, abs=1e-12 * stored)
    assert found.lengths[1] == pytest.approx(sorted([2.0 * (1.0 + amount), 1.0])[::-1], rel=1e-12)
    assert found.volume[1] == pytest.approx(2.0 * (1.0 + amount), rel=1e-12)
    assert found.mass[1] == pytest.approx(2.0 * DENSITY, rel=1e-12)


def test_sizes_are_of_the_volume_and_centres_of_the_mass():
    """One half is three times as dense."""
    bodies = box_bodies((2, 1), (2, 1), "quadrilateral", 0, material={2: lambda x: x[0] > 0.99})
    dense = xf.materials.LinearElastic(YOUNG, 0.3, 3.0 * DENSITY)
    found = measure_fragments(xf.Simulation(xf.Scene(bodies, {1: LINEAR, 2: dense}), 1e-3))
    assert found.mass == pytest.approx([4.0 * DENSITY], rel=1e-12)
    assert found.centre == pytest.approx(np.array([[1.25, 0.5]]), rel=1e-12)
    assert found.lengths == pytest.approx(np.array([[2.0, 1.0]]), rel=1e-12)


# Which bonds are broken


def bonded(lengths=(3, 1), cells=(3, 1), kind="quadrilateral", bond=BOND, **options):
    bodies = box_bodies(lengths, cells, kind, label=lambda x: x[0] + 10 * (x[1] > 1.0))
    return xf.Simulation(
        xf.Scene(bodies, {1: LINEAR}, default_interaction=bond, **options), 1e-3, num_threads=1
    )


def damage(simulation, points):
    """Break the bonds of points."""
    for group in simulation.interactions.groups:
        if "damage" in group.kernels.state_names:
            here = np.isin(group.indices, points)
            group.state[here, group.kernels.state_names.index("damage")] = 0.0


def test_a_facet_holds_as_long_as_one_of_its_points_does():
    simulation = bonded()
    assert np.all(find_fragments(simulation) == 0)
    damage(simulation, [0])  # one of the two points at x = 1
    assert np.all(find_fragments(simulation) == 0)
    damage(simulation, [1])
    assert find_fragments(simulation).tolist() == [1, 0, 0]
    found = measure_fragments(simulation)
    assert found.mass == pytest.approx([4.0, 2.0])
    half = 0.5 * BOND.fracture_energy
    assert found.border == pytest.approx([half, half], rel=1e-12)
    assert not found.inside.any()


def test_bonds_that_differ_from_place_to_place_cost_what_they_are_there():
    """Fracture energy and soundness are fields; the wall's points are of another law."""
    bond = CohesiveZone(
        2e4, lambda x: 0.05 * x[0], 10.0, initial_damage=lambda x: np.where(x[0] > 1.5, 0.5, 1.0)
    )
    wall = xf.Wall(3, (0.0, -1.0), (0.0, 1.0), SignoriniCoulomb())
    simulation = bonded(bond=bond, walls=[wall])
    damage(simulation, [0, 1, 2, 3])  # at x = 1 and x = 2
    found = measure_fragments(simulation)
    assert found.fragment.tolist() == [0, 1, 2]
    first, second = 0.5 * 0.05, 0.5 * 0.5 * 0.10
    assert found.border == pytest.approx([first, first + second, second], rel=1e-12)


def test_cracks_that_cut_nothing_off_are_inside():
    """Of four blocks around a vertex one facet breaks, then two that free a corner."""
    simulation = bonded((2, 2), (2, 2))
    facets = simulation.scene.bodies.facets
    broken = []
    for pair in ([0, 1], [0, 2]):
        facet = np.flatnonzero(np.all(np.sort(facets.bodies, axis=1) == pair, axis=1))[0]
        broken += [2 * facet, 2 * facet + 1]
        damage(simulation, broken[-2:])
        if len(broken) == 2:
            found = measure_fragments(simulation)
            assert len(found) == 1 and found.border.tolist() == [0.0]
            assert found.inside == pytest.approx([BOND.fracture_energy], rel=1e-12)
    found = measure_fragments(simulation)
    assert found.fragment.tolist() == [1, 0, 0, 0]
    assert found.border == pytest.approx([BOND.fracture_energy] * 2, rel=1e-12)
    assert found.inside.tolist() == [0.0, 0.0]


def test_equal_pieces_come_by_their_first_body():
    simulation = bonded((4, 1), (4, 1))
    damage(simulation, [2, 3])
    assert find_fragments(simulation).tolist() == [0, 0, 1, 1]


def test_bonds_that_a_run_breaks_have_dissipated_what_its_ledger_says():
    start = lambda x: np.stack([0.8 * (x[0] - 1.5), 0.1 * x[0]])  # noqa: E731
    simulation = bonded((3, 2), (6, 4), "crossed", initial_velocity=start)
    before = measure_fragments(simulation)
    assert len(before) == 1 and before.border.tolist() == before.inside.tolist() == [0.0]
    run(simulation, 60)
    found = measure_fragments(simulation)
    energies = simulation.ledger.energies
    assert len(found) > 1 and found.border.min() > 0.0
    assert found.border.sum() + found.inside.sum() == pytest.approx(
        energies.dissipated_cohesion, rel=1e-7
    )
    assert np.all(np.diff(found.mass) <= 1e-9)
    # with a smaller share more is broken
    assert len(measure_fragments(simulation, share=1e-6)) >= len(found)


@pytest.mark.parametrize("name", ["plastic", "viscous"])
def test_elastic_energy_is_that_of_the_committed_state(name):
    """After steps that flow or relax the ledger has told the energy at their end."""
    start = {tag: lambda x: np.stack([0.5 * x[0], 0.0 * x[0]]) for tag in (1, 2)}
    simulation = strip(2, "crossed", material=MATERIALS[name], start=start)
    run(simulation, 20)
    energies = simulation.ledger.energies
    lost = {"plastic": energies.dissipated_plastic, "viscous": energies.dissipated_viscous}
    assert lost[name] > 0.01 * energies.elastic > 0.0
    found = measure_fragments(simulation)
    assert found.elastic.sum() == pytest.approx(energies.elastic, rel=1e-9)
    assert found.elastic.min() > 0.0


def test_ties_hold_and_break_as_facets_do():
    """Two boxes meshed apart, of nodes that do not match, and the cohesive zone between them."""
    meshes, tags = [], []
    for side, cells in enumerate(((2, 2), (3, 3))):
        mesh = xf.crossed_rectangle((side, 0.0), (side + 1.0, 1.0), cells)
        meshes.append(mesh)
        tags.append(xf.tag_facets(mesh, {11 + side: lambda x: np.abs(x[0] - 1.0) < 1e-9}))
    joined = xf.join_meshes(meshes, facet_tags=tags)
    scene = xf.Scene(
        xf.explode(joined.mesh, joined.part, facet_tags=joined.facet_tags), {1: LINEAR},
        ties=[xf.Tie(12, 11, BOND)],
    )  # fmt: skip
    simulation = xf.Simulation(scene, 1e-3, num_threads=1)
    assert find_fragments(simulation).tolist() == [0, 0]
    count = simulation.interactions.num_points
    damage(simulation, np.arange(count - 1))
    assert find_fragments(simulation).tolist() == [0, 0]
    damage(simulation, [count - 1])
    found = measure_fragments(simulation)
    assert found.fragment.tolist() == [0, 1]
    half = 0.5 * BOND.fracture_energy
    assert found.border == pytest.approx([half, half], rel=1e-12)


# Rigid bodies


def test_rigid_bodies_are_fragments_with_the_sizes_of_their_shapes():
    box = xf.rigid.Polygon.box((2.0, 1.0))
    rigid = [
        xf.rigid.wall((0.0, -5.0), (0.0, 1.0), "ground"),
        xf.RigidBody(
            box, (1.0, 2.0), "any", angle=0.3, density=3.0, velocity=(1.0, -2.0), spin=4.0
        ),
        xf.RigidBody(xf.rigid.Disc(0.5), (5.0, 1.0), "any", density=1.0, spin=-1.0),
    ]
    pairs = ("any", "any"), ("any", "ground")
    scene = xf.Scene(rigid=rigid, contacts=[xf.Contact(p, SignoriniCoulomb()) for p in pairs])
    found = measure_fragments(xf.Simulation(scene, 1e-3, num_threads=1))
    assert found.fragment.tolist() == [-1, 0, 1]
    assert found.bodies.tolist() == [1, 1]
    assert found.mass == pytest.approx([6.0, 0.25 * np.pi], rel=1e-14)
    assert found.volume == pytest.approx([2.0, 0.25 * np.pi], rel=1e-14)
    assert found.centre == pytest.approx(np.array([[1.0, 2.0], [5.0, 1.0]]), rel=1e-14)
    assert found.lengths[0] == pytest.approx([2.0, 1.0], rel=1e-12)
    assert found.lengths[1] == pytest.approx([0.5 * np.sqrt(3.0)] * 2, rel=1e-12)
    assert found.diameter[1] == pytest.approx(1.0, rel=1e-12)
    assert found.spin == pytest.approx(np.array([[4.0], [-1.0]]), rel=1e-12)
    assert found.translation == pytest.approx([15.0, 0.0], abs=1e-14)
    assert found.rotation == pytest.approx(
        [0.5 * 6.0 * 5.0 / 12.0 * 16.0, 0.5 * 0.125 * 0.25 * np.pi], rel=1e-12
    )
    assert found.vibration == pytest.approx([0.0, 0.0], abs=1e-12)


def test_rigid_bodies_in_space_and_those_that_adhesion_joins():
    """Two cubes that a contact bonds, one of them spinning, and a sphere by itself."""
    cube = xf.rigid.Polyhedron.box((1.0, 1.0, 1.0))
    rigid = [
        xf.RigidBody(xf.rigid.Sphere(0.5), (9.0, 0.0, 0.0), "balls", density=1.0),
        xf.RigidBody(cube, (0.0, 0.0, 0.0), "cubes", density=1.0),
        xf.RigidBody(
            cube, (1.0, 0.0, 0.0), "cubes", density=1.0, velocity=(0.0, 2e-3, 0.0),
            spin=(0.0, 0.0, 1e-3),
        ),
    ]  # fmt: skip
    glue = CohesiveZone(1e3, 1.0, 10.0)
    contacts = [xf.Contact(("cubes", "cubes"), glue), xf.Contact(("balls", "cubes"), None)]
    simulation = xf.Simulation(xf.Scene(rigid=rigid, contacts=contacts), 1e-4, num_threads=1)
    assert find_fragments(simulation).tolist() == [2, 0, 1]  # contacts are found in a step
    run(simulation, 1)
    found = measure_fragments(simulation)
    assert found.fragment.tolist() == [1, 0, 0]
    assert found.mass == pytest.approx([2.0, np.pi / 6.0], rel=1e-12)
    assert found.lengths[0] == pytest.approx([2.0, 1.0, 1.0], rel=1e-5)
    assert found.lengths[1] == pytest.approx([0.5 * np.sqrt(12.0 / 5.0)] * 3, rel=1e-12)
    assert found.centre[0] == pytest.approx([0.5, 0.0, 0.0], abs=1e-6)
    motion = simulation.rigid
    momentum = found.mass[:, None] * found.velocity
    assert momentum.sum(axis=0) == pytest.approx(motion.momentum(), abs=1e-16)
    angular = np.cross(found.centre, momentum) + found.angular_momentum
    assert angular.sum(axis=0) == pytest.approx(motion.angular_momentum(), abs=1e-15)
    kinetic = (found.translation + found.rotation + found.vibration).sum()
    assert kinetic == pytest.approx(motion.kinetic, rel=1e-12)
    assert found.vibration[0] > 1e-3 * kinetic


@pytest.mark.parametrize("glued", ["bricks", "plate"])
def test_glue_joins_bricks_but_not_through_a_plate_without_mass(glued):
    """Two bricks drawn upright and turned by a quarter, end to end on a plate that is driven."""
    brick, plate = xf.rigid.Polygon.box((1.0, 2.0)), xf.rigid.Polygon.box((6.0, 1.0))
    turned = {"angle": 0.5 * np.pi, "density": 1.0}
    rigid = [
        xf.RigidBody(brick, (0.0, 0.5), "bricks", **turned),
        xf.RigidBody(brick, (2.0, 0.5), "bricks", **turned),
        xf.RigidBody(plate, (1.0, -0.5), "plate", prescribed=dict.fromkeys(range(3), 0.0)),
    ]
    law = {"bricks": SignoriniCoulomb(), "plate": SignoriniCoulomb()}
    law[glued] = CohesiveZone(1e3, 1.0, 10.0)
    contacts = [xf.Contact(("bricks", other), law[other]) for other in law]
    simulation = xf.Simulation(xf.Scene(rigid=rigid, contacts=contacts), 1e-4, num_threads=1)
    run(simulation, 1)
    found = measure_fragments(simulation)
    if glued == "plate":
        assert found.fragment.tolist() == [0, 1, -1]
    else:
        assert found.fragment.tolist() == [0, 0, -1]
        assert found.lengths[0] == pytest.approx([4.0, 1.0], rel=1e-9)
        assert found.centre[0] == pytest.approx([1.0, 0.5], rel=1e-9)


# Files


def test_a_table_is_read_back(tmp_path):
    found = measure_fragments(flying(3, "hexahedron"))
    found.to_csv(tmp_path / "fragments.csv")
    with open(tmp_path / "fragments.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["fragment"] for row in rows] == ["0", "1"]
    assert [row["bodies"] for row in rows] == ["3", "2"]

    def column(name):
        return np.array([float(row[name]) for row in rows])

    for name in ("mass", "volume", "diameter", "elongation", "translation", "rotation", "border"):
        np.testing.assert_array_equal(column(name), getattr(found, name))
    for name in ("centre", "velocity", "spin", "angular_momentum"):
        for k, axis in enumerate("xyz"):
            np.testing.assert_array_equal(column(f"{name}_{axis}"), getattr(found, name)[:, k])
    np.testing.assert_array_equal(column("length_3"), found.lengths[:, 2])


def of_cells(path):
    """Cell fields of a series, time by time."""
    with meshio.xdmf.TimeSeriesReader(path) as reader:
        reader.read_points_cells()
        read = [reader.read_data(k) for k in range(reader.num_steps)]
    return [{name: values[0] for name, values in cellwise.items()} for *_, cellwise in read]


@pytest.mark.parametrize("asked", [True, False])
def test_a_recorder_writes_the_fragment_of_each_cell_when_asked(tmp_path, asked):
    wall = xf.rigid.wall((0.0, -5.0), (0.0, 1.0), "ground")
    ball = xf.RigidBody(xf.rigid.Disc(1.0), (9.0, 0.0), "ground", density=1.0)
    contact = xf.Contact(("ground", "ground"), None)
    simulation = bonded(rigid=[wall, ball], contacts=[contact])
    options = {"fragments": True} if asked else {}
    with xf.Recorder(simulation, tmp_path, end_time=4e-3, fields=2, **options) as recorder:
        for step in simulation.steps(4e-3):
            recorder.record(step)
            if step.step == 3:
                damage(simulation, [0, 1])
    history = read_history(tmp_path / "history.csv")
    bulk, rigid = (of_cells(tmp_path / f"{name}.xdmf") for name in ("bulk", "rigid"))
    if not asked:
        assert "fragments" not in history
        assert all("fragment" not in fields for fields in bulk + rigid)
        return
    assert history["fragments"].tolist() == [2, 2, 2, 3]
    # of masses pi, 2, 4: the disc, a block, and two that hold together
    assert bulk[0]["fragment"].tolist() == bulk[1]["fragment"].tolist() == [0, 0, 0]
    assert bulk[2]["fragment"].tolist() == [2, 0, 0]
    assert [set(fields["fragment"][fields["body"] == 0]) for fields in rigid] == [{-1.0}] * 3
    assert [set(fields["fragment"][fields["body"] == 1]) for fields in rigid] == [{1.0}] * 3


def test_a_restart_asks_for_the_same(tmp_path):
    simulation = bonded()
    with xf.Recorder(simulation, tmp_path, end_time=2e-3, fields=2, fragments=True) as recorder:
        for step in simulation.steps(1e-3):
            recorder.record(step)
        recorder.checkpoint()
    with pytest.raises(ValueError, match="fragments=True"):
        xf.Recorder(bonded(), tmp_path, end_time=2e-3, fields=2, restart=True)
    simulation = bonded()
    options = {"end_time": 2e-3, "fields": 2, "fragments": True, "restart": True}
    with xf.Recorder(simulation, tmp_path, **options) as recorder:
        for step in simulation.steps(2e-3):
            recorder.record(step)
    assert read_history(tmp_path / "history.csv")["fragments"].tolist() == [1, 1]


def test_a_periodic_cell_is_refused_but_its_bodies_have_numbers():
    bodies = xf.explode(xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (2, 2)), lattice=np.eye(2))
    drive = xf.MacroscopicDrive(gradient={"11": 1.0, "12": 0.0, "21": 0.0, "22": 1.0})
    scene = xf.Scene(bodies, {1: LINEAR}, default_interaction=BOND, macroscopic=drive)
    simulation = xf.Simulation(scene, 1e-4, num_threads=1)
    assert np.all(find_fragments(simulation) == 0)
    with pytest.raises(ValueError, match="periodic cell.*find_fragments"):
        measure_fragments(simulation)
