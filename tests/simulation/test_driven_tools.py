# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies that are driven in runs without inertia: punches, rollers, moving walls."""

from dataclasses import replace

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box
from scenes import COMM

import xper_fx as xf
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.driven_motion import DrivenMotion
from xper_fx.output.checkpoint import restore, save

YOUNG, SPEED = 1e9, 1e-2
STILL = {0: 0.0, 1: 0.0, 2: 0.0}
ELASTIC = xf.materials.LinearElastic(YOUNG, 0.3, 1000.0)


def indented(motion, friction=0.3, material=ELASTIC, shape=xf.rigid.Disc(0.5), place=(0.0, 0.5)):
    """A block on a fixed ground, and a disc that is moved into its top."""
    mesh = xf.crossed_rectangle((-1, -1), (1, 0), (12, 6))
    tags = xf.tag_facets(mesh, {1: lambda x: x[1] < -1 + 1e-9})
    one = np.zeros(xf.geometry_dofmap(mesh).shape[0], int)
    tool = xf.RigidBody(shape, place, "tool", prescribed=STILL | motion)
    law = xf.laws.SignoriniCoulomb(friction, contact="position")
    return xf.Scene(
        xf.explode(mesh, one, facet_tags=tags),
        {1: material},
        surfaces={"block": (1,)},
        rigid=[tool],
        contacts=[xf.Contact(("block", "tool"), law)],
        loads=[xf.PrescribedDisplacement(1, i, 0.0) for i in (0, 1)],
    )


def run(scene, step=0.1, **options):
    simulation = xf.Simulation(scene, step, inertia=False, **options)
    *_, last = simulation.steps(1.0)
    return simulation, last.energies


@pytest.mark.parametrize(
    "material",
    [
        ELASTIC,
        xf.materials.SaintVenantKirchhoff(YOUNG, 0.3, 1000.0),
        xf.materials.J2SmallStrain(YOUNG, 0.3, 5e6, xf.materials.Linear(1e8), 1000.0),
    ],
)
def test_a_disc_is_pressed_into_a_block_whatever_the_solver(material):
    forces = []
    for solver in ("auto", "monolithic", "newton"):
        # plastic flow with friction may go to one side or the other
        friction = 0.0 if "J2" in type(material).__name__ else 0.3
        scene = indented({1: -SPEED}, friction, material)
        simulation, energies = run(scene, solver=solver, tolerance=1e-9)
        force = simulation.reaction_of("tool")
        assert simulation.reaction(1) == pytest.approx(-force, rel=1e-6, abs=1e-6 * abs(force[1]))
        assert force[0] == pytest.approx(0.0, abs=1e-6 * abs(force[1]))  # as the scene is symmetric
        forces.append(force[1])
        assert energies["kinetic"] == 0.0
        nonlinear = 0.0 if material is ELASTIC else 0.01
        assert abs(energies["closure"]) <= max(1e-8, nonlinear) * energies["external_work"]
    assert forces == pytest.approx([forces[0]] * 3, rel=1e-5)


def test_what_tools_do_tends_to_one_curve_with_the_step():
    """Contacts are those of the start of a step, so that the force is of first order in it."""
    runs = (run(indented({1: -SPEED}), step)[0] for step in (0.1, 0.05, 0.025))
    force = [simulation.reaction_of("tool")[1] for simulation in runs]
    apart = np.diff(force)
    assert apart[1] / apart[0] == pytest.approx(0.5, abs=0.15)
    assert abs(apart[1] / force[2]) < 5e-3


def test_a_tool_is_where_its_velocities_lead():
    """By Gauss's rule over each step, whatever its size: a cubic is exact."""
    motion = {0: lambda t: 3e-3 * t**2, 1: lambda t: -SPEED, 2: lambda t: 4.0 * t**3}
    simulation, _ = run(indented(motion, friction=0.1), 0.25)
    state = simulation.rigid.state
    assert state.position[0] == pytest.approx([1e-3, 0.5 - SPEED], abs=1e-15)
    assert state.turn.rotation[0] == pytest.approx(1.0, rel=1e-14)


def test_a_wall_that_comes_presses_as_one_that_stays():
    """A block between its held side and a wall: either is moved."""

    def pressed(wall_moves):
        mesh = xf.crossed_rectangle((0, 0), (1, 1), (4, 4))
        tags = xf.tag_facets(mesh, {1: lambda x: x[1] < 1e-9, 2: lambda x: x[1] > 1 - 1e-9})
        law = xf.laws.SignoriniCoulomb(0.2, contact="position")
        given = (0.0, 0.0) if wall_moves else (lambda t: 3e-4 * t, lambda t: SPEED * t)
        more = {}
        if wall_moves:
            velocity = (-3e-4, -SPEED)
            more["rigid"] = [xf.rigid.wall((0, 1), (0, -1), "wall", velocity=velocity)]
            more["surfaces"] = {"block": (1,)}
            more["contacts"] = [xf.Contact(("block", "wall"), law)]
        else:
            more["walls"] = [xf.Wall(2, (0, 1), (0, -1), law)]
        scene = xf.Scene(
            xf.explode(mesh, np.zeros(64, int), facet_tags=tags),
            {1: ELASTIC},
            loads=[xf.PrescribedDisplacement(1, i, u) for i, u in enumerate(given)],
            **more,
        )
        simulation, energies = run(scene)
        return simulation.reaction(1), energies

    (force, energies), (same, others) = pressed(True), pressed(False)
    assert force == pytest.approx(same, rel=1e-3)  # nodes touch the one, points of facets the other
    assert force[0] != 0.0 and abs(force[0]) < 0.2 * force[1]
    for name in ("external_work", "elastic", "dissipated_friction"):
        assert energies[name] == pytest.approx(others[name], rel=1e-3, abs=1e-9)


def bent(rollers, friction=0.0, above=0.0, push=-1e-3, **options):
    """A beam in three-point bending that cracks in its middle, on knife edges or on rollers."""
    length, height, span, radius, young = 0.4, 0.08, 0.32, 0.01, 30e9
    mesh = xf.crossed_rectangle((-length / 2, 0), (length / 2, height), (40, 8))
    middle = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 0] > 0
    tags = xf.tag_facets(
        mesh,
        {
            1: lambda x: (x[1] < 1e-9) & (abs(x[0] + span / 2) < 0.011),
            2: lambda x: (x[1] < 1e-9) & (abs(x[0] - span / 2) < 0.011),
            3: lambda x: (x[1] > height - 1e-9) & (abs(x[0]) < 0.011),
            4: lambda x: (abs(x[0]) < 1e-9) & (x[1] < 0.011),
        },
    )
    bonds = xf.laws.CohesiveZone(50 * young / 0.01, fracture_energy=100.0, strength=3e6)
    beam = xf.explode(mesh, middle.astype(int), facet_tags=tags)
    edges = [(1, 0, 0.0, -span / 2)] if friction == 0.0 else []
    if rollers:
        slides = xf.laws.SignoriniCoulomb(friction, contact="position")
        disc, below = xf.rigid.Disc(radius), -radius
        punch = STILL | {1: push}
        more = {
            "surfaces": {"beam": (1,)},
            "rigid": [
                xf.RigidBody(disc, (-span / 2, below), "rollers", prescribed=STILL),
                xf.RigidBody(disc, (span / 2, below), "rollers", prescribed=STILL),
                xf.RigidBody(disc, (0.0, height + radius + above), "punch", prescribed=punch),
            ],
            "contacts": [
                xf.Contact(("beam", "rollers"), slides),
                xf.Contact(("beam", "punch"), slides),
                xf.Contact(("beam", "beam"), slides),
                xf.Contact(("rollers", "punch"), None),
            ],
        }
    else:
        edges += [(1, 1, 0.0, -span / 2), (2, 1, 0.0, span / 2), (3, 1, lambda t: -1e-3 * t, 0.0)]
        more = {}
    scene = xf.Scene(
        beam,
        {1: xf.materials.LinearElastic(young, 0.2, 2400.0)},
        default_interaction=bonds,
        facet_interactions={4: None},
        loads=[
            xf.PrescribedDisplacement(tag, i, u, where=lambda x, at=at: np.isclose(x[0], at))
            for tag, i, u, at in edges
        ],
        **more,
    )
    simulation = xf.Simulation(scene, 0.01, inertia=False, **options)
    curve = []
    for last in simulation.steps(0.15 + above / 1e-3):
        force = simulation.reaction_of("punch") if rollers else simulation.reaction(3)
        curve.append((last.time, -force[1]))
    return np.array(curve), last.energies


def test_a_beam_cracks_on_rollers_as_on_knife_edges():
    edges, _ = bent(False)
    rollers, energies = bent(True)
    assert rollers[:, 1] == pytest.approx(edges[:, 1], rel=5e-3)
    assert abs(energies["closure"]) < 1e-7 * energies["external_work"]
    assert energies["dissipated_friction"] == 0.0


def test_rollers_that_do_not_turn_hold_a_beam_back_along_its_path_as_in_steps():
    """Their friction presses the lower side of the beam together."""
    steps, energies = bent(True, friction=0.3)
    path, followed = bent(True, friction=0.3, path=xf.GrowthControl())
    free, _ = bent(True)
    assert 1.1 < steps[:, 1].max() / free[:, 1].max() < 1.2
    assert path[:, 1].max() == pytest.approx(steps[:, 1].max(), rel=3e-3)
    assert path[-1, 0] == pytest.approx(0.15)
    assert path[-1, 1] == pytest.approx(steps[-1, 1], rel=2e-2)
    for each in (energies, followed):
        assert each["dissipated_friction"] > 0.1 * each["dissipated_cohesion"]
        assert abs(each["closure"]) < 1e-7 * each["external_work"]


def test_a_punch_that_comes_from_above_along_a_path_does_not_sink_in():
    """Through 56.85 mm; steps of a twentieth of the path, 2.85 mm, would not see it come.

    A quarter of a facet, 2.5 mm, is seen, and no step moves the punch by more.
    """
    comes, _ = bent(True, above=56.85e-3, path=xf.GrowthControl())
    stays, _ = bent(True, path=xf.GrowthControl())
    assert np.all(comes[comes[:, 0] < 56.8499, 1] == 0.0)
    assert comes[:, 1].max() == pytest.approx(stays[:, 1].max(), rel=3e-3)
    assert comes[-1, 1] == pytest.approx(stays[-1, 1], rel=2e-2)


def test_a_punch_that_stood_still_does_not_sink_in_as_it_sets_out():
    """It comes in the last of four steps alone, from beyond where it is seen: by 2.75 mm."""
    since, end = 0.75 * 2.75, 2.75

    def push(time):
        return -2.0 * 2.75e-3 * max(time - since, 0.0) / (end - since) ** 2

    path = xf.GrowthControl(longest=0.25)
    curve, _ = bent(True, above=2.6e-3, push=push, path=path)
    stays, _ = bent(True, path=xf.GrowthControl())
    assert curve[:, 1].max() == pytest.approx(stays[:, 1].max(), rel=3e-3)
    assert curve[-1, 1] == pytest.approx(stays[-1, 1], rel=2e-2)


@pytest.mark.parametrize(
    "shape, place, speed",
    [
        (xf.rigid.Polygon([(-0.3, -0.3), (0.3, -0.3), (0.3, 0.3), (-0.3, 0.3)]), (1.33, 0.8), -1.2),
        (xf.rigid.Disc(0.5), (1.502, 0.3), -0.8),
    ],
    ids=["square", "disc"],
)
def test_a_tool_that_goes_past_a_corner_is_not_held_by_it(shape, place, speed):
    """At 0.2 and 0.012 facets from the side, by up to 0.7 facets a step: nothing is touched."""
    scene = indented({1: speed}, shape=shape, place=place)
    simulation = xf.Simulation(scene, 0.1, inertia=False)
    for step in simulation.steps(1.0):
        assert not simulation.reaction_of("tool").any()
        assert step.energies["external_work"] == 0.0


def test_a_tool_that_goes_past_a_corner_along_a_path_is_not_held_by_it():
    """A square at 0.1 facets beside a beam, whose steps are a quarter of a facet."""
    mesh = xf.crossed_rectangle((-0.2, 0.0), (0.2, 0.08), (40, 8))
    right = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 0] > 0
    tags = xf.tag_facets(mesh, {1: lambda x: x[1] < 1e-9})
    square = xf.rigid.Polygon([(-0.02, -0.02), (0.02, -0.02), (0.02, 0.02), (-0.02, 0.02)])
    tool = xf.RigidBody(square, (0.221, 0.1308), "tool", prescribed=STILL | {1: -1e-3})
    scene = xf.Scene(
        xf.explode(mesh, right.astype(int), facet_tags=tags),
        {1: xf.materials.LinearElastic(30e9, 0.2, 2400.0)},
        default_interaction=xf.laws.CohesiveZone(1.5e14, fracture_energy=100.0, strength=3e6),
        surfaces={"beam": (1,)},
        rigid=[tool],
        contacts=[xf.Contact(("beam", "tool"), xf.laws.SignoriniCoulomb(0.3, contact="position"))],
        loads=[xf.PrescribedDisplacement(1, i, 0.0) for i in (0, 1)],
    )
    simulation = xf.Simulation(scene, 0.01, inertia=False, path=xf.GrowthControl())
    for _ in simulation.steps(60.0):
        assert not simulation.reaction_of("tool").any()


def test_arms_of_tools_that_turn_count():
    """A bar of 2 m that turns by 0.5 and a disc: 0.25 m come to 1/2 s, and to no limit."""
    bar = xf.rigid.Polygon([(-1.0, -0.01), (1.0, -0.01), (1.0, 0.01), (-1.0, 0.01)])
    for shape, share in ((bar, 0.5), (xf.rigid.Disc(1.0), 1.0)):
        tool = xf.RigidBody(shape, (0.0, 0.0), "tool", prescribed=STILL | {2: 0.5})
        motion = DrivenMotion(RigidBodies([tool]))
        assert motion.time_within(0.25, 3.0, 1.0) == pytest.approx(share, rel=1e-3)
    # a dumbbell of 2.2 m, a body of several pieces, beside one that stands still
    ends = [xf.rigid.Part(xf.rigid.Disc(0.1), (x, 0.0)) for x in (-1.0, 1.0)]
    bell = xf.RigidBody(xf.rigid.Cluster(ends), None, "tool", prescribed=STILL | {2: 0.5})
    still = xf.RigidBody(bar, (0.0, 3.0), "tool", prescribed=STILL)
    motion = DrivenMotion(RigidBodies([still, bell]))
    assert motion.time_within(0.25, 3.0, 1.0) == pytest.approx(0.5 / 1.1, rel=1e-3)


def test_a_roller_draws_a_sheet_in_and_leaves_the_gap(caplog):
    """Half of a sheet that is rolled from 10 to 9 mm; what has passed is as thick as the gap."""
    radius, gap, spin, entry = 0.05, 4.5e-3, 0.5, 0.022
    mesh = xf.crossed_rectangle((-0.03, 0.0), (0.0, 5e-3), (24, 4))
    tags = xf.tag_facets(mesh, {1: lambda x: x[1] < 1e-9, 2: lambda x: x[0] < -0.03 + 1e-9})
    one = np.zeros(xf.geometry_dofmap(mesh).shape[0], int)
    place = np.sqrt(radius**2 - (radius + gap - 5e-3) ** 2), gap + radius  # its nose touches
    scene = xf.Scene(
        xf.explode(mesh, one, facet_tags=tags),
        {1: xf.materials.J2FiniteStrain(70e9, 0.3, 1e8, xf.materials.Linear(5e8), 2700.0)},
        surfaces={"sheet": (1,)},
        rigid=[xf.RigidBody(xf.rigid.Disc(radius), place, "roller", prescribed=STILL | {2: spin})],
        contacts=[
            xf.Contact(("sheet", "roller"), xf.laws.SignoriniCoulomb(0.2, contact="position"))
        ],
        loads=[xf.PrescribedVelocity(1, 1, 0.0), xf.PrescribedVelocity(2, 0, entry)],
    )
    simulation = xf.Simulation(scene, 0.01, inertia=False, num_threads=1)
    with caplog.at_level("WARNING", logger="xper_fx"):
        *_, last = simulation.steps(0.6)
    assert not caplog.records
    held, pushed = simulation.reaction_of("roller"), simulation.reaction(2)
    assert held[0] == pytest.approx(-pushed[0], rel=1e-6) and held[1] < -1e6
    bulk, moved = simulation.model.bulk, simulation.state.displacement
    x = bulk.forms.V.tabulate_dof_coordinates()[:, :2]
    x = x + bulk.unknowns.expand(moved).reshape(-1, 2)
    passed = x[(x[:, 0] > place[0]) & (x[:, 1] > 0.9 * gap)]
    assert len(passed) >= 3
    assert passed[:, 1] == pytest.approx(gap, rel=3e-3)
    assert last.energies["dissipated_friction"] > 0.05 * last.energies["dissipated_plastic"]


def test_a_run_with_a_tool_goes_on_to_the_bit(tmp_path):
    def made():
        return xf.Simulation(indented({1: lambda t: -SPEED * (1 + t)}), 0.1, inertia=False)

    whole, first, second = made(), made(), made()
    *_, expected = whole.steps(1.0)
    for _ in first.steps(0.5):
        pass
    save(tmp_path / "half.h5", first)
    restore(tmp_path / "half.h5", second)
    *_, last = second.steps(1.0)
    assert np.array_equal(second.state.displacement, whole.state.displacement)
    assert last.energies == expected.energies
    assert np.array_equal(second.reaction_of("tool"), whole.reaction_of("tool"))


def test_a_scene_goes_on_from_a_run_with_a_tool():
    """The same scene goes on with the same bits."""
    scene = indented({1: lambda t: -SPEED * (1 + t)})
    first, whole = (xf.Simulation(scene, 0.1, inertia=False) for _ in range(2))
    for _ in first.steps(0.5):
        pass
    second = xf.Simulation(replace(scene, after=first.snapshot()), 0.1, inertia=False)
    *_, last = second.steps(1.0)
    *_, expected = whole.steps(1.0)
    assert np.array_equal(second.reaction_of("tool"), whole.reaction_of("tool"))
    assert last.energies == expected.energies


def test_a_sphere_bends_bonded_blocks_in_space():
    """On four others, elastic: forces balance, and points of bonds and contacts are not parted."""
    corner, cells = np.array([0.2, 0.1, 0.08]), [4, 2, 2]
    mesh = create_box(COMM, [corner * (-1, 0, 0), corner], cells, CellType.hexahedron)
    right = mesh.geometry.x[xf.geometry_dofmap(mesh)].mean(axis=1)[:, 0] > 0
    still, ball = dict.fromkeys(range(6), 0.0), xf.rigid.Sphere(0.02)
    below = [(x, y, -0.02) for x in (-0.15, 0.15) for y in (0.025, 0.075)]
    rubs = xf.laws.SignoriniCoulomb(0.2, contact="position")
    scene = xf.Scene(
        xf.explode(mesh, right.astype(int)),
        {1: xf.materials.LinearElastic(30e9, 0.2, 2400.0)},
        default_interaction=xf.laws.CohesiveZone(3e13, fracture_energy=100.0, strength=3e6),
        surfaces={"beam": (1,)},
        rigid=[
            *(xf.RigidBody(ball, place, "below", prescribed=still) for place in below),
            xf.RigidBody(ball, (0.0, 0.05, 0.1), "punch", prescribed=still | {2: -1e-3}),
        ],
        contacts=[
            xf.Contact(("beam", "below"), rubs),
            xf.Contact(("beam", "punch"), rubs),
            xf.Contact(("beam", "beam"), rubs),
            *(xf.Contact((name, "below"), None) for name in ("below", "punch")),
        ],
    )
    forces = []
    for solver in ("auto", "newton"):
        simulation = xf.Simulation(scene, 5e-3, inertia=False, solver=solver, tolerance=1e-9)
        *_, step = simulation.steps(1e-2)
        punch, others = (simulation.reaction_of(name) for name in ("punch", "below"))
        assert punch + others == pytest.approx(0.0, abs=1e-6 * abs(punch[2]))
        assert abs(step.energies["closure"]) < 1e-8 * step.energies["external_work"]
        forces.append(punch[2])
    assert forces[0] < -1000.0 and forces[1] == pytest.approx(forces[0], rel=2e-3)
