# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of several convex parts: their mass, their contacts, and how they move."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from scenes import box_bodies
from scipy.spatial.transform import Rotation
from search_cases import hull_gap

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import (
    Cluster,
    Disc,
    HalfPlane,
    MassProperties,
    Part,
    Polygon,
    Polyhedron,
    RigidBodies,
    RigidBody,
    Sphere,
    body_outlines,
    wall,
)
from xper_fx.nscd.rigid.bodies import plane_rotations
from xper_fx.nscd.rigid.motion import RigidMotion
from xper_fx.nscd.search.rigid_search import RigidSearch
from xper_fx.output.body_shapes import rigid_moments
from xper_fx.scene.contact import Contact
from xper_fx.scene.mesh_overlaps import mesh_overlaps
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.study import equilibrium


def rectangle(left, bottom, right, top):
    return Polygon([[left, bottom], [right, bottom], [right, top], [left, top]])


def block(low, high):
    """A box between two corners."""
    return Polyhedron.hull(np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3))


# A foot of 3 by 1 m and a shaft of 1 by 2 m on its left end.
BOOT = Cluster([rectangle(0, 0, 3, 1), rectangle(0, 1, 1, 3)])
# Of three bars, their centre at the origin.
CROSS = Cluster(
    [rectangle(-1, -0.2, 1, 0.2), rectangle(-0.2, 0.2, 0.2, 1), rectangle(-0.2, -1, 0.2, -0.2)]
)
SPACE_CROSS = Cluster(
    [
        block((-1, -0.2, -0.2), (1, 0.2, 0.2)),
        block((-0.2, 0.2, -0.2), (0.2, 1, 0.2)),
        block((-0.2, -1, -0.2), (0.2, -0.2, 0.2)),
    ]
)


def found(*bodies, reach=0.02):
    """Contacts between all of the bodies."""
    groups = {body.group for body in bodies}
    arrays = RigidBodies(bodies)
    search = RigidSearch(arrays, [(a, b) for a in groups for b in groups], reach)
    return search.find(arrays.position, arrays.rotation)


# ------------------------------------------------------------------------------------ mass


def test_mass_of_a_boot_is_that_of_a_square_without_a_corner():
    mass, centre, inertia = BOOT.mass_properties(7.0)
    whole, corner = 7.0 * 9.0, 7.0 * 4.0
    assert mass == pytest.approx(whole - corner, rel=1e-14)
    expected = (whole * 1.5 - corner * 2.0) / mass
    assert centre == pytest.approx([expected, expected], rel=1e-14)
    about_corner = whole * (9.0 / 6.0 + 2 * 1.5**2) - corner * (4.0 / 6.0 + 2 * 2.0**2)
    assert inertia == pytest.approx(about_corner - mass * 2.0 * expected**2, rel=1e-13)
    furthest = np.hypot(3.0 - expected, expected)
    assert BOOT.bounding_radius == pytest.approx(furthest, rel=1e-14)
    body = RigidBodies([RigidBody(BOOT, None, "a", density=7.0)])
    assert body.position[0] == pytest.approx(centre, rel=1e-14)


def test_mass_of_a_turned_box_cut_in_two():
    """A cut along a diagonal plane; the prisms' inertia turns with them."""
    corners = block((0, 0, 0), (3.0, 2.0, 1.0)).vertices
    side = corners[:, 0] / 3.0 + corners[:, 1] / 2.0
    prisms = [Polyhedron.hull(corners[keep]) for keep in (side <= 1.0, side >= 1.0)]
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7])
    shift = np.array([5.0, -2.0, 1.0])
    parts = [
        Part(prism, turn.apply(prism.unit_properties.centre) + shift, rotation=turn)
        for prism in prisms
    ]
    mass, centre, inertia = Cluster(parts).unit_properties
    r = turn.as_matrix()
    exact = Polyhedron.box((3.0, 2.0, 1.0)).unit_properties.inertia
    assert mass == pytest.approx(6.0, rel=1e-13)
    assert centre == pytest.approx(turn.apply([1.5, 1.0, 0.5]) + shift, rel=1e-13)
    assert inertia == pytest.approx(r @ exact @ r.T, abs=1e-12)


def test_mass_of_a_dumbbell_and_of_parts_that_overlap():
    balls = [Part(Sphere(0.5), (0.0, 0.0, -1.0)), Part(Sphere(0.5), (0.0, 0.0, 1.0))]
    ball = 4.0 / 3.0 * np.pi * 0.125
    mass, centre, inertia = Cluster(balls).unit_properties
    assert (mass, *centre) == pytest.approx((2.0 * ball, 0.0, 0.0, 0.0), rel=1e-14)
    across = 2.0 * ball * (0.4 * 0.25 + 1.0)
    assert inertia == pytest.approx(np.diag([across, across, 0.2 * ball]), rel=1e-14)

    bars = [rectangle(-1, -0.2, 1, 0.2), rectangle(-0.2, -1, 0.2, 1)]
    with pytest.raises(ValueError, match="Parts 0 and 1 of a cluster overlap by 1.2 m"):
        Cluster(bars)
    given = MassProperties(*CROSS.unit_properties)
    whole = Cluster(bars, given)
    assert whole.mass_properties(2.0).inertia == 2.0 * given.inertia
    bodies = RigidBodies([RigidBody(whole, (0.0, 0.0), "a", density=1.0)])
    state = RigidMotion(bodies).state
    assert np.trace(rigid_moments(bodies, [whole], state).second[0]) == pytest.approx(given.inertia)


@pytest.mark.parametrize(
    ("cluster", "tips"),
    [(BOOT, [(0, 0), (3, 0), (3, 1), (1, 3)]), (SPACE_CROSS, [(1, 0.2, 0.2), (-0.2, 1, 0.2)])],
)
def test_what_is_drawn_and_measured_fills_the_cluster(cluster, tips):
    """Triangles of the outline, and moments, of a body that has been turned and moved."""
    unit, dim = cluster.unit_properties, cluster.dim
    turn = {"angle": 0.7} if dim == 2 else {"rotation": Rotation.from_rotvec([0.3, 0.2, 0.4])}
    place = np.array([3.0, -1.0, 2.0][:dim])
    bodies = RigidBodies([RigidBody(cluster, place, "a", density=1.0, **turn)])
    state = RigidMotion(bodies).state
    outline = body_outlines(bodies)
    corners = outline.positions(state.position, state.turn.rotation)[outline.cells]
    r = turn["rotation"].as_matrix() if dim == 3 else plane_rotations(np.array([0.7]))[0]
    for tip in (np.array(tips) - unit.centre) @ r.T + place:
        assert np.linalg.norm(corners - tip, axis=2).min() < 1e-12
    assert not outline.body_of_point.any() and not outline.body_of_cell.any()
    if dim == 2:
        u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        volume = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        first = volume @ corners.mean(axis=1)
    else:
        volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        first = volume @ corners.sum(axis=1) / 4.0
    assert volume.sum() == pytest.approx(unit.mass, rel=1e-13)
    assert first / unit.mass == pytest.approx(place, rel=1e-12)
    moments = rigid_moments(bodies, [cluster], state)
    second = moments.second[0] - unit.mass * np.outer(place, place)
    if dim == 2:
        # of a square of 3 m without one of 2 m
        along = 9 * (0.75 + 1.5**2) - 4 * (1 / 3 + 2.0**2) - 5 * 1.1**2
        mixed = 9 * 1.5**2 - 4 * 2.0**2 - 5 * 1.1**2
        exact = np.array([[along, mixed], [mixed, along]])
        assert second == pytest.approx(r @ exact @ r.T, rel=1e-12)
    else:
        assert np.trace(second) * np.eye(3) - second == pytest.approx(
            r @ unit.inertia @ r.T, abs=1e-12
        )


@pytest.mark.parametrize(
    ("parts", "kind", "words"),
    [
        ([], TypeError, "should be a list"),
        (Disc(1.0), TypeError, "should be a list"),
        ([Disc(1.0)], ValueError, "Part 0 of a cluster: It needs a position"),
        ([rectangle(0, 0, 1, 1), "x"], TypeError, "Part 1 of a cluster should be a Part"),
        ([rectangle(0, 0, 1, 1), block((0, 0, 0), (1, 1, 1))], ValueError, "dimension 3, part 0"),
        ([BOOT], TypeError, "Part 0 of a cluster is a cluster itself"),
        ([HalfPlane()], TypeError, "is a wall"),
        ([Part(Disc(1.0), (0.0,))], ValueError, "Part 0 of a cluster: The position"),
    ],
)
def test_bad_parts_are_refused(parts, kind, words):
    with pytest.raises(kind, match=words):
        Cluster(parts)


@pytest.mark.parametrize(
    ("properties", "kind"),
    [(3.0, TypeError), ((1.0, (0, 0), None), TypeError), ((1.0, (0, 0), -1.0), ValueError)],
)
def test_bad_properties_are_refused(properties, kind):
    with pytest.raises(kind, match="properties of a cluster"):
        Cluster([rectangle(0, 0, 1, 1)], properties)


# ------------------------------------------------------------------------------------ contacts


def random_cluster(rng, dim):
    """Two or three boxes in a row that touch, beyond them a ball, and a box that is turned.

    Returns the cluster and, of each part, corners (of a ball the centre) in its axes and the radius
    of a ball.
    """
    parts, told, end = [], [], 0.0
    for _ in range(rng.integers(2, 4)):
        size = rng.uniform(0.3, 0.8, dim)
        low = rng.uniform(-0.2, 0.2, dim) - 0.5 * size
        low[0], end = end, end + size[0]
        parts.append((rectangle if dim == 2 else block)(*([*low, *low + size] if dim == 2 else
                                                          (low, low + size))))  # fmt: skip
        told.append((parts[-1].vertices, 0.0))
    place = np.eye(dim)[0] * (end + 0.2)
    parts.append(Part((Disc if dim == 2 else Sphere)(0.2), place))
    told.append((place[None], 0.2))
    place = place + 0.6 * np.eye(dim)[0]
    if dim == 2:
        angle, box = rng.uniform(0.0, 3.0), Polygon.box((0.5, 0.2))
        parts.append(Part(box, place, angle=angle))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    else:
        rotation, box = Rotation.from_rotvec(rng.normal(size=3)), Polyhedron.box((0.5, 0.3, 0.2))
        parts.append(Part(box, place, rotation=rotation))
        turn = rotation.as_matrix()
    told.append((place + box.vertices @ turn.T, 0.0))
    return Cluster(parts), told


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_contacts_are_those_of_brute_force(dim):
    """Bodies that are apart: the smallest gap of each pair, over all parts, and where it is."""
    rng = np.random.default_rng(dim)
    side, reach = (6 if dim == 2 else 3), 2.0
    site = np.stack(np.meshgrid(*[np.arange(side)] * dim), -1).reshape(-1, dim)
    bodies, parts = [], []
    for place in 3.1 * site + rng.uniform(-0.2, 0.2, site.shape):
        cluster, told = random_cluster(rng, dim)
        if dim == 2:
            turn = {"angle": rng.uniform(0.0, 6.0)}
            c, s = np.cos(turn["angle"]), np.sin(turn["angle"])
            matrix = np.array([[c, -s], [s, c]])
        else:
            turn = {"rotation": Rotation.from_rotvec(rng.normal(size=3))}
            matrix = turn["rotation"].as_matrix()
        bodies.append(RigidBody(cluster, place, "a", density=1.0, **turn))
        for corners, radius in told:
            x = place + (corners - cluster.unit_properties.centre) @ matrix.T
            # a ball as a tiny solid about its centre
            x = x if len(x) > 1 else x + 1e-9 * np.vstack([np.eye(dim), -np.ones(dim)])
            parts.append((len(bodies) - 1, x, radius))
    gaps = {}
    for (a, p, r), (b, q, s) in combinations(parts, 2):
        middle = np.linalg.norm(p.mean(axis=0) - q.mean(axis=0))
        if a != b and middle < reach + 1.5:
            gaps[a, b] = min(hull_gap(p, q) - r - s, gaps.get((a, b), np.inf))
    assert min(gaps.values()) > 0.0
    arrays = RigidBodies(bodies)
    contacts = RigidSearch(arrays, [("a", "a")], reach).find(arrays.position, arrays.rotation)
    least = {}
    for (a, b), gap in zip(np.sort(contacts.body, axis=1).tolist(), contacts.gap, strict=True):
        least[a, b] = min(gap, least.get((a, b), np.inf))
    assert least.keys() == {pair for pair, gap in gaps.items() if gap <= reach}
    assert len(least) > 20
    for pair, gap in least.items():
        assert gap == pytest.approx(gaps[pair], abs=1e-7)
    assert np.array_equal(contacts.key, np.unique(contacts.key, axis=0))
    assert np.all(contacts.body[:, 0] != contacts.body[:, 1])


@pytest.mark.parametrize("parts", [1, 2])
def test_a_disc_that_is_heavier_on_one_side(parts):
    """It touches the ground under its middle, not under its centre of mass."""
    disc = Part(Disc(0.5), (0.0, 0.0))
    far = [Part(Disc(0.1), (2.0, 0.0))] if parts == 2 else []
    loaded = Cluster([disc, *far], MassProperties(1.0, (0.3, 0.0), 0.1))
    angle = 0.5 * np.pi + 0.2
    contacts = found(
        RigidBody(loaded, (1.0, 0.8), "a", mass=2.0, angle=angle), wall((0, 0), (0, 1), "b"),
        reach=0.2,
    )  # fmt: skip
    middle = np.array([1.0, 0.8]) - 0.3 * np.array([np.cos(angle), np.sin(angle)])
    assert contacts.body.tolist() == [[0, 1]]
    assert contacts.gap == pytest.approx(middle[1] - 0.5, abs=1e-14)
    assert contacts.point[0] == pytest.approx([middle[0], 0.5 * (middle[1] - 0.5)], abs=1e-14)


def test_parts_of_one_body_do_not_touch():
    assert len(found(RigidBody(CROSS, (0.0, 0.0), "a", density=1.0))) == 0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("depth", [0.0, 1e-12, 1e-4])
def test_a_seam_has_no_sides(dim, depth):
    """Just before a seam and upon it, a block has vertical contacts alone, and an edge a disc."""
    if dim == 2:
        floor = Cluster([rectangle(0, 0, 1, 1), rectangle(1, -1, 2, 1)])
        small, ball, rest = Polygon.box((0.3, 0.3)), Disc(0.3), ()
    else:
        floor = Cluster([block((0, 0, 0), (1, 1, 1)), block((1, 0, -1), (2, 1, 1))])
        small, ball, rest = Polyhedron.box((0.3, 0.3, 0.3)), Sphere(0.3), (0.5,)
    for x, shape, height in (
        (1.0 - 0.15 - 1e-3, small, 0.15),
        (1.0, small, 0.15),
        (1.0 - 1e-3, ball, 0.3),
        (1.0 + 1e-3, ball, 0.3),
    ):
        place = (x, *rest, 1.0 + height - depth) if dim == 3 else (x, 1.0 + height - depth)
        contacts = found(
            RigidBody(floor, None, "floor", density=1.0), RigidBody(shape, place, "small",
                                                                    density=1.0)
        )  # fmt: skip
        assert len(contacts) > 0
        assert np.abs(contacts.normal[:, -1]) == pytest.approx(1.0, abs=1e-14)
        # the floor has only an upper side here: in 3D it is z = 1
        assert contacts.gap == pytest.approx(-depth, abs=1e-12)


def test_a_corner_in_a_reentrant_corner_touches_both_sides():
    """Though the least translation that parts it from the shaft is along an edge of its own."""
    corner = np.array([1.0, 1.0]) - 1e-4
    wedge = Polygon([[0, 0], [1, 0.4], [0.4, 1]])
    contacts = found(
        RigidBody(BOOT, None, "boot", density=1.0),
        RigidBody(wedge, corner + wedge.unit_properties.centre, "wedge", density=1.0),
    )
    assert contacts.body.tolist() == [[0, 1], [0, 1]]
    assert np.abs(contacts.normal) == pytest.approx(np.array([[0, 1], [1, 0]]), abs=1e-12)
    assert contacts.gap == pytest.approx(-1e-4, rel=1e-9)
    shaft = contacts.take(np.array([1]))
    assert shaft.point[0] == pytest.approx(corner + [0.5e-4, 0.0], abs=1e-12)


# ------------------------------------------------------------------------------------ motion


def simulated(bodies, step, steps, *, friction=0.3, gravity=None, restitution=0.0, **options):
    """A run of bodies, all of whose groups may touch."""
    law = SignoriniCoulomb(friction=friction, restitution=restitution)
    groups = sorted({body.group for body in bodies})
    pairs = [(a, b) for k, a in enumerate(groups) for b in groups[k:]]
    scene = Scene(
        rigid=bodies, contacts=[Contact(pair, law) for pair in pairs],
        loads=[] if gravity is None else [Gravity(gravity)],
    )  # fmt: skip
    simulation = Simulation(scene, step, num_threads=1, **options)
    for _ in simulation.steps(steps * step):
        pass
    return simulation


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("angle", "height"), [(0.0, 0.52), (0.6, 0.75)])
def test_two_halves_move_as_the_whole(dim, angle, height):
    """Thrown on the ground, a square or a cube lands flat and slides, or jumps off from an edge."""
    if dim == 2:
        halves = Cluster([rectangle(0, 0, 0.5, 1), rectangle(0.5, 0, 1, 1)])
        whole, turn = Polygon.box((1.0, 1.0)), {"angle": angle}
    else:
        halves = Cluster([block((0, 0, 0), (0.5, 1, 1)), block((0.5, 0, 0), (1, 1, 1))])
        whole = Polyhedron.box((1.0, 1.0, 1.0))
        turn = {"rotation": Rotation.from_rotvec([0.0, angle, 0.0])}
    place, throw, up = np.zeros(dim), np.zeros(dim), np.zeros(dim)
    place[-1], throw[0], up[-1] = height, 1.0, 1.0
    ends = []
    for shape in (halves, whole):
        body = RigidBody(shape, place, "a", density=1000.0, velocity=throw, **turn)
        simulation = simulated(
            [body, wall(np.zeros(dim), up, "b")], 2e-3, 75, gravity=-9.81 * up, tolerance=1e-11,
            restitution=0.5 if angle else 0.0,
        )  # fmt: skip
        state = simulation.rigid.state
        ends.append(np.concatenate([a.ravel() for a in (*state[:2], state.turn.rotation)]))
        assert state.velocity[0, 0] < 0.95
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_crosses_that_collide_keep_momentum_and_energy(dim):
    cross, spin = (CROSS, 1.0) if dim == 2 else (SPACE_CROSS, (0.3, -0.2, 1.0))
    offset = np.array([1.9, 0.7, 0.1])[:dim]
    bodies = [
        RigidBody(cross, -0.5 * offset, "a", density=3.0, velocity=[1.0] + [0.0] * (dim - 1)),
        RigidBody(cross, 0.5 * offset, "a", density=1.0, spin=spin),
    ]
    start = RigidMotion(RigidBodies(bodies))
    simulation = simulated(bodies, 5e-3, 120, friction=0.0, restitution=1.0, tolerance=1e-12)
    motion = simulation.rigid
    assert np.abs(motion.state.velocity[1]).max() > 0.1  # they have met
    assert motion.momentum() == pytest.approx(start.momentum(), abs=1e-11)
    assert motion.angular_momentum() == pytest.approx(start.angular_momentum(), abs=1e-11)
    assert motion.kinetic == pytest.approx(start.kinetic, rel=1e-9)
    simulated_work = simulation.ledger.closure
    assert abs(simulated_work) <= 1e-11 * start.kinetic


@pytest.mark.parametrize("dim", [2, 3])
def test_a_block_slides_over_seams_without_friction(dim):
    """It has sunk in by a little; its speed stays what it is."""
    ends = np.linspace(0.0, 2.0, 5)
    pieces = [
        rectangle(a, 0, b, 1) if dim == 2 else block((a, 0, 0), (b, 1, 1))
        for a, b in zip(ends[:-1], ends[1:], strict=True)
    ]
    fixed = dict.fromkeys(range(3 * (dim - 1)), 0.0)
    small = Polygon.box((0.3, 0.3)) if dim == 2 else Polyhedron.box((0.3, 0.3, 0.3))
    place = np.array([0.3, 0.5, 1.15 - 1e-7])[[0, 2] if dim == 2 else [0, 1, 2]]
    velocity = np.zeros(dim)
    velocity[0] = 1.0
    bodies = [
        RigidBody(Cluster(pieces), None, "floor", prescribed=fixed),
        RigidBody(small, place, "small", density=1.0, velocity=velocity),
    ]
    gravity = np.zeros(dim)
    gravity[-1] = -9.81
    law = SignoriniCoulomb()
    arrays = RigidBodies(bodies)
    scene = Scene(
        rigid=bodies, contacts=[Contact(("floor", "small"), law)], loads=[Gravity(gravity)]
    )
    simulation = Simulation(scene, 5e-3, num_threads=1, tolerance=1e-12)
    for _ in simulation.steps(1.2):
        pass
    state = simulation.rigid.state
    assert state.position[1, 0] == pytest.approx(1.5, abs=1e-9)
    assert state.velocity[1] == pytest.approx(velocity, abs=1e-9)
    assert state.position[1, -1] == pytest.approx(arrays.position[1, -1], abs=1e-9)


@pytest.mark.slow
def test_a_meshed_block_slides_over_seams():
    """It falls on a floor of one piece and of five, by little, and bounces on its springs."""
    ends = [-1.0, 0.13, 0.57, 1.05, 1.22, 3.0]
    parts = [rectangle(a, -1 - k % 2, b, -1e-7) for k, (a, b) in enumerate(pairwise(ends))]
    rest = dict.fromkeys(range(3), 0.0)
    moved = []
    for floor in (rectangle(-1, -1, 3, -1e-7), Cluster(parts)):
        scene = Scene(
            box_bodies((1.0, 0.5), (4, 2), label=1),
            {1: LinearElastic(young=1e6, poisson=0.3, density=1000.0)},
            surfaces={"block": (1,)},
            rigid=[RigidBody(floor, None, "floor", prescribed=rest)],
            contacts=[Contact(("block", "floor"), SignoriniCoulomb())],
            initial_velocity=lambda x: [1.0 + 0.0 * x[0], 0.0 * x[0]],
            loads=[Gravity((0.0, -9.81))],
        )
        simulation = Simulation(scene, 4e-3, num_threads=1, tolerance=1e-8)
        for _ in simulation.steps(0.4):
            pass
        assert sum(map(len, simulation.interactions.contacts)) > 4
        moved.append(simulation.state.displacement.reshape(-1, 2).mean(axis=0))
    assert moved[1][0] == pytest.approx(0.4, abs=1e-6)
    assert moved[1] == pytest.approx(moved[0], abs=1e-6)


def test_a_meshed_block_in_a_bracket_does_not_overlap_it():
    """The centre of mass of the bracket lies in the block, none of its parts does."""

    def doubts(gap):
        left, right = -gap, 1.0 + gap
        bracket = Cluster(
            [
                rectangle(left - 0.2, -0.2 - gap, right + 0.2, -gap),
                rectangle(left - 0.2, -gap, left, 0.5),
                rectangle(right, -gap, right + 0.2, 0.5),
            ]
        )
        scene = Scene(
            box_bodies((1.0, 0.5), (4, 2), label=1),
            {1: LinearElastic(young=1e6, poisson=0.3, density=1000.0)},
            surfaces={"block": (1,)},
            rigid=[RigidBody(bracket, None, "bracket", density=1.0)],
            contacts=[Contact(("block", "bracket"), SignoriniCoulomb())],
        )
        assert 0.0 < scene.rigid_bodies.position[0, 1] < 0.5
        return list(mesh_overlaps(scene))

    assert doubts(1e-3) == []
    (doubt,) = doubts(-0.15)
    assert "rigid body 0 lies in the meshed body" in doubt


@pytest.mark.parametrize(("push", "stands"), [(0.999, True), (1.001, False)])
def test_a_boot_tips_when_its_weight_leaves_the_foot(push, stands):
    """Pushed to the left, about its heel: its centre of mass lies at (1.1, 1.1) m from it."""
    scene = Scene(
        rigid=[RigidBody(BOOT, None, "boot", density=1.0), wall((0, 0), (0, 1), "ground")],
        contacts=[Contact(("boot", "ground"), SignoriniCoulomb(friction=2.0))],
        loads=[Gravity((-push * 9.81, -9.81))],
    )
    state = equilibrium(scene)
    assert state.stands == stands
    if stands:
        force, point = state.forces.force, state.forces.position
        sign = np.sign(force[:, 1].sum())
        weight = 5.0 * 9.81
        assert sign * force.sum(axis=0) == pytest.approx([push * weight, weight], rel=1e-6)
        moment = point[:, 0] * force[:, 1] - point[:, 1] * force[:, 0]
        exact = weight * 1.1 * (1.0 - push)
        assert sign * moment.sum() == pytest.approx(exact, abs=1e-5 * weight)


def test_clusters_that_overlap_are_moved_apart():
    """Two crosses, an arm of each in one of the other: refused, or moved and turned apart."""
    bodies = [RigidBody(CROSS, place, "a", density=1.0) for place in ((0.0, 0.0), (1.199, 0.6))]
    contact = Contact(("a", "a"), SignoriniCoulomb())
    with pytest.raises(ValueError, match="0 and 1 by 0.001 m"):
        Scene(rigid=bodies, contacts=[contact])
    scene = Scene(rigid=bodies, contacts=[contact], resolve_overlaps=True)
    moved = scene.rigid_bodies.position - [body.position for body in bodies]
    assert moved.sum(axis=0) == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.all(moved[:, 0] * [-1, 1] > 1e-4) and np.abs(scene.rigid_bodies.rotation).max() > 1e-5
    search = RigidSearch(scene.rigid_bodies, [("a", "a")], 1e-3)
    assert not search.overlaps(scene.rigid_bodies.position, scene.rigid_bodies.rotation, 1e-6)
