# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a scene of rigid bodies and contacts refuses, and overlaps that it moves apart."""

import numpy as np
import pytest
from scenes import box_bodies, run

from xper_fx.forms.loads import BodyForce, Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, Polygon, RigidBody, Sphere, wall
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

LAW = SignoriniCoulomb()


def disc(position, group="discs", **options):
    return RigidBody(Disc(1.0), position, group, density=1.0, **options)


def within(group="discs"):
    return [Contact((group, group), LAW)]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, "an exploded mesh, rigid bodies, or both"),
        ({"rigid": [disc((0, 0))]}, "No contact names the group 'discs'.*rigid body 0"),
        (
            {"rigid": [disc((0, 0))], "contacts": [Contact(("discs", "floor"), LAW)]},
            r"groups \['floor'\], which do not exist; those that do: \['discs'\]",
        ),
        ({"rigid": [disc((0, 0))], "contacts": 2 * within()}, "name the pair once"),
        ({"rigid": 2 * [disc((0, 0))], "contacts": within()}, "bodies 0 and 1 are the same object"),
        ({"rigid": [disc((0, 0))], "contacts": within(), "order": 2}, "no order, got 2"),
        (
            {"rigid": [disc((0, 0))], "contacts": within(), "default_interaction": LAW},
            "no default_interaction; leave it out",
        ),
        (
            {"rigid": [disc((0, 0))], "contacts": within(), "loads": [BodyForce((0, 1))]},
            "only gravity acts on rigid bodies",
        ),
        (
            {"rigid": [disc((0, 0))], "contacts": within(), "loads": [Gravity(lambda t: 9.81)]},
            "9.81 at t = 0.0 s; it should have 2 components",
        ),
        (
            {"rigid": [disc((0, 0))], "contacts": within(), "surfaces": {"a": (1,)}},
            "without a mesh has no surfaces",
        ),
        (
            {"rigid": [disc((0, 0)), disc((1.5, 0))], "contacts": within()},
            "0 and 1 by 0.5 m; place them apart",
        ),
        (
            {
                "bodies": "mesh", "surfaces": {"block": (7,)},
                "contacts": [Contact(("block", "block"), LAW)],
            },
            r"'block' needs cell tags that occur, got \[7\]",
        ),
        ({"bodies": "mesh", "surfaces": {"block": (1,)}}, r"surfaces \['block'\]; leave them out"),
        (
            {
                "bodies": "mesh", "contacts": within("balls"),
                "rigid": [RigidBody(Sphere(1.0), (5, 0, 0), "balls", density=1.0)],
            },
            "dimension 2, the rigid bodies 3",
        ),
    ],
)  # fmt: skip
def test_scenes_that_make_no_sense_are_refused(given, words):
    if given.get("bodies") == "mesh":
        material = LinearElastic(young=1.0, poisson=0.3, density=1.0)
        mesh = {"bodies": box_bodies((1, 1), (1, 1), label=0), "materials": {1: material}}
        given = given | mesh
    with pytest.raises(ValueError, match=words):
        Scene(**given)


@pytest.mark.parametrize("between", [("a",), ("a", 1), ("a", "b", "c")])
def test_a_contact_is_between_two_names(between):
    with pytest.raises(ValueError, match="between two groups"):
        Contact(between, LAW)


def test_a_reach_is_a_length():
    with pytest.raises(ValueError, match="positive length"):
        Contact(("a", "b"), LAW, reach=0.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "takes a step"),
        ({"step": 1.0, "scheme": "explicit"}, "no scheme of the bulk"),
        ({"step": 1.0, "theta": 1.0, "inertia": False}, "Rigid body 0 is free to move.*theta = 1"),
    ],
)
def test_runs_that_make_no_sense_are_refused(options, words):
    scene = Scene(rigid=[disc((0, 0))], contacts=within())
    with pytest.raises(ValueError, match=words):
        Simulation(scene, **options)


def test_overlaps_are_moved_apart_by_the_least_motion():
    """Two discs of one mass part symmetrically, a wall does not move, and nothing else does."""
    rigid = [disc((0, 0)), disc((1.5, 0)), disc((10, 0.75)), wall((0, 0), (0, 1), "floor")]
    contacts = [*within(), Contact(("discs", "floor"), LAW)]
    scene = Scene(rigid=rigid[:2], contacts=within(), resolve_overlaps=True)
    apart = scene.rigid_bodies.position
    np.testing.assert_allclose(apart, [[-0.25, 0.0], [1.75, 0.0]], atol=2e-6)
    scene = Scene(rigid=rigid, contacts=contacts, resolve_overlaps=True)
    position = scene.rigid_bodies.position
    np.testing.assert_allclose(position[2:], [[10, 1.0], [0, 0]], atol=2e-6)
    np.testing.assert_allclose(position[:2, 1], 1.0, atol=2e-6)


def test_neighbours_take_part_in_the_least_motion():
    """The first of a row of 121 discs, with gaps g, overlaps the second by d.

    It moves by a, the others by b, b - g, b - 2 g, ..., with a + b = d; the least sum of squares is
    that of b = (d + 7140 g) / 121. Overlaps alone would take a round a disc, too many.
    """
    d, g = 0.05, 5e-6
    places = [0.0, *((2.0 + g) * np.arange(1, 121) - g - d)]
    rigid = [disc((x, 0)) for x in places]
    position = Scene(rigid=rigid, contacts=within(), resolve_overlaps=True).rigid_bodies.position
    b = (d + 7140 * g) / 121
    expected = [b - d, *(b - g * np.arange(120))]
    np.testing.assert_allclose(position[:, 0] - places, expected, atol=2e-5)
    np.testing.assert_allclose(position[:, 1], 0.0, atol=1e-12)


def test_crowded_polygons_are_moved_apart():
    """A heap of squares thrown at random into each other ends without an overlap."""
    rng = np.random.default_rng(3)
    square = Polygon.box((1.0, 1.0))
    rigid = [
        RigidBody(square, rng.uniform(0, 3, 2), "squares", angle=rng.uniform(0, 1), density=1.0)
        for _ in range(12)
    ]
    with pytest.raises(ValueError, match="and [0-9]+ more"):
        Scene(rigid=rigid, contacts=within("squares"))
    scene = Scene(rigid=rigid, contacts=within("squares"), resolve_overlaps=True)
    bodies = scene.rigid_bodies
    simulation = Simulation(scene, 1.0)
    search = simulation.detection._rigid
    assert search.overlaps(bodies.position, bodies.rotation, 1e-6) == []


def test_a_body_that_spins_too_fast_for_the_step_is_stepped_in_pieces():
    box = RigidBody(Sphere(1.0), (0, 0, 0), "a", mass=1.0, inertia=np.diag([1.0, 2.0, 2.5]),
                    spin=(1e-3, 30.0, 0.0))  # fmt: skip
    simulation = Simulation(Scene(rigid=[box], contacts=within("a")), 1.0, max_halvings=10)
    before = simulation.rigid.angular_momentum()
    records = run(simulation, 1)
    assert simulation.time == pytest.approx(1.0) and len(records) >= 1
    np.testing.assert_allclose(simulation.rigid.angular_momentum(), before, rtol=1e-12)
