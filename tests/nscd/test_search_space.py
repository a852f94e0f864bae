# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of spheres, polyhedra and half spaces."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from search_cases import check, make

from xper_fx.nscd.rigid import HalfSpace, Polyhedron, Sphere
from xper_fx.nscd.search.rigid_search import RigidSearch


def random_polyhedron(rng, size):
    if rng.random() < 0.4:
        return Polyhedron.box(size * rng.uniform(0.2, 1.2, 3))
    points = rng.normal(size=(rng.integers(5, 12), 3))
    return Polyhedron.hull(size * points / np.linalg.norm(points, axis=1)[:, None])


def random_scene(rng, kinds, count, decades, clustered):
    shapes = []
    for _ in range(count):
        size = 10.0 ** rng.uniform(-decades, 0.0)
        kind = rng.choice(kinds)
        shapes.append(Sphere(size) if kind == "sphere" else random_polyhedron(rng, size))
    spread = 0.3 * np.cbrt(count) if clustered else 0.45 * np.cbrt(count)
    position = rng.uniform(-spread, spread, (count, 3))
    if "wall" in kinds:
        shapes[3], shapes[7] = HalfSpace(), HalfSpace()
        position[[3, 7]] = [[0.0, -0.7 * spread, 0.0], [0.7 * spread, 0.0, 0.0]]
    return shapes, position, list(Rotation.random(count, random_state=rng.integers(1000)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kinds", [["sphere"], ["sphere", "polyhedron"], ["sphere", "wall"], ["polyhedron", "wall"]]
)
# each two of them together
@pytest.mark.parametrize(
    ("clustered", "decades", "offset"),
    [(False, 0.3, 0.0), (True, 0.3, 1e5), (False, 3.0, 1e5), (True, 3.0, 0.0)],
)
def test_contacts_are_those_of_brute_force(kinds, clustered, decades, offset):
    rng = np.random.default_rng(int(10 * decades) + clustered)
    count = 30 if decades < 1.0 else 60  # of unlike sizes, few are near each other
    shapes, position, rotation = random_scene(rng, kinds, count, decades, clustered)
    bodies = make(shapes, position + offset, rotation)
    search = RigidSearch(bodies, [("a", "a")], reach=0.1)
    tolerance = 1e-12 * (10.0 + 10.0 * offset)
    contacts = search.find(bodies.position, bodies.rotation)
    touching = check(bodies, contacts, bodies.position, bodies.rotation, 0.1, tolerance)
    assert touching > 3


def find(shapes, places, rotations=None, reach=0.01):
    bodies = make(shapes, places, rotations)
    return RigidSearch(bodies, [("a", "a")], reach).find(bodies.position, bodies.rotation)


def tilted(tilt, axis):
    return [Rotation.identity(), Rotation.from_rotvec(tilt * np.asarray(axis, float))]


CUBE = Polyhedron.box((1.0, 1.0, 1.0))


@pytest.mark.parametrize("tilt", [0.0, 1e-15, -1e-12, 1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("offset", [0.0, 1e-15, -1e-12, 1e-9, 0.3, -0.9])
@pytest.mark.parametrize("gap", [0.0, 1e-15, -1e-12, 1e-6, -1e-3])
def test_stacked_cubes_touch_at_the_corners_of_the_overlap(tilt, offset, gap):
    places = [[0.0, 0.0, 0.0], [offset, 0.2, 1.0 + gap]]
    contacts = find([CUBE, CUBE], places, tilted(tilt, [0.6, -0.5, 0.3]))
    assert len(contacts) == 4
    assert np.abs(contacts.normal - [0.0, 0.0, -1.0]).max() <= abs(tilt) + 1e-15
    assert contacts.area == pytest.approx([0.8 * (1.0 - abs(offset)) / 4] * 4, abs=2e-4)
    x = max(-0.5, offset - 0.5), min(0.5, offset + 0.5)
    expected = [[a, b] for a in x for b in (-0.3, 0.5)]
    order = np.lexsort(np.round(contacts.point[:, 1::-1], 2).T)
    assert contacts.point[order, :2] == pytest.approx(np.array(expected), abs=2e-4)
    assert contacts.gap == pytest.approx([gap] * 4, abs=1.2 * abs(tilt) + 1e-15)


def test_cubes_turned_by_an_eighth_keep_four_of_eight_corners():
    turn = [Rotation.identity(), Rotation.from_rotvec([0.0, 0.0, np.pi / 4])]
    for tilt in (0.0, 1e-5):
        tilting = Rotation.from_rotvec([tilt, 0.3 * tilt, 0.0])
        contacts = find([CUBE, CUBE], [[0, 0, 0], [0, 0, 1.0]], [turn[0], tilting * turn[1]])
        assert len(contacts) == 4
        octagon = 2.0 * (np.sqrt(2.0) - 1.0)
        assert contacts.area == pytest.approx([octagon / 4] * 4, rel=1e-4)
        assert (contacts.key[:, 1] % 4 == 2).all()  # crossings of edges
        x, y = contacts.point[:, :2].T
        order = np.argsort(np.arctan2(y, x))
        x, y = x[order], y[order]
        assert 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 0.55
        if tilt == 0.0:
            keys = contacts.key
    assert len(np.unique(keys, axis=0)) == 4


@pytest.mark.parametrize("direction", np.arange(0.0, 360.0, 15.0))
def test_of_many_corners_the_deepest_is_kept(direction):
    """Of the eight corners of an octagon four are kept, the lowest of a tilted cube among them."""
    tilt, a = 2e-3, np.radians(direction)
    turn = Rotation.from_rotvec([0.0, 0.0, np.pi / 4])
    lean = Rotation.from_rotvec(tilt * np.array([np.cos(a), np.sin(a), 0.0]))
    contacts = find([CUBE, CUBE], [[0, 0, 0], [0, 0, 1.0]], [Rotation.identity(), lean * turn])
    assert len(contacts) == 4
    corner = 0.5 * (np.sqrt(2.0) - 1.0)
    ring = [(x, y) for x in (-0.5, 0.5) for y in (-corner, corner)]
    ring += [(y, x) for x, y in ring]
    heights = tilt * np.array([y * np.cos(a) - x * np.sin(a) for x, y in ring])
    assert contacts.gap.min() == pytest.approx(heights.min(), abs=1e-2 * tilt)


def test_keys_stay_while_cubes_slide_rock_and_line_up():
    keys = []
    for shift in np.linspace(-0.3, -0.1, 50):
        rock = tilted(1e-4 * np.sin(90.0 * shift), [1.0, 0.3, 0.2])
        keys.append(find([CUBE, CUBE], [[0, 0, 0], [shift, 0.1, 1.0]], rock).key)
    assert all(np.array_equal(key, keys[0]) for key in keys)
    rng = np.random.default_rng(0)
    aligned = []
    for _ in range(50):
        place = 1e-9 * rng.normal(size=3) + [0.0, 0.0, 1.0]
        rock = tilted(1e-9, rng.normal(size=3))
        aligned.append(find([CUBE, CUBE], [[0, 0, 0], place], rock).key)
    assert all(np.array_equal(key, aligned[0]) for key in aligned)
    assert len(aligned[0]) == 4


def test_edge_across_edge():
    """Two cubes on their edges, crossed: one point, above the other edge's middle."""
    first = Rotation.from_rotvec([np.pi / 4, 0.0, 0.0])
    second = Rotation.from_rotvec([0.0, np.pi / 4, 0.0])
    for gap in (0.005, -0.005):
        height = np.sqrt(2.0) + gap
        contacts = find([CUBE, CUBE], [[0, 0, 0], [0.1, 0.2, height]], [first, second])
        assert len(contacts) == 1
        assert contacts.gap == pytest.approx([gap], abs=1e-14)
        assert contacts.normal[0] == pytest.approx([0.0, 0.0, -1.0], abs=1e-14)
        assert contacts.point[0] == pytest.approx([0.1, 0.0, 0.5 * height], abs=1e-14)


def test_cube_on_its_edge_touches_at_both_ends_of_it():
    turn = Rotation.from_rotvec([np.pi / 4, 0.0, 0.0])
    place = [0.3, 0.1, 0.5 + np.sqrt(0.5)]
    for shapes, rotations in (
        ([Polyhedron.box((4.0, 4.0, 1.0)), CUBE], [Rotation.identity(), turn]),
        ([HalfSpace(), CUBE], [Rotation.identity(), turn]),
    ):
        ground = 0.0 if isinstance(shapes[0], Polyhedron) else 0.5
        contacts = find(shapes, [[0, 0, ground], place], rotations)
        assert sorted(contacts.point[:, 0]) == pytest.approx([-0.2, 0.8], abs=1e-12)
        assert contacts.point[:, 1:] == pytest.approx(np.array([[0.1, 0.5]] * 2), abs=1e-12)


def test_vertex_above_face_edge_and_vertex():
    corner = Rotation.align_vectors([[0.0, 0.0, -1.0]], [[1.0, 1.0, 1.0]])[0]
    reach = 0.5 * np.sqrt(3.0)
    places = [[0.2, 0.1, 0.5 + reach + 0.004], [0.503, 0.1, 0.5 + reach + 0.004],
              [0.502, 0.503, 0.5 + reach + 0.006]]  # fmt: skip
    expected = [(0.004, [0, 0, -1]), (0.005, [-0.6, 0, -0.8]), (0.007, np.array([-2, -3, -6]) / 7)]
    for place, (gap, normal) in zip(places, expected, strict=True):
        contacts = find([CUBE, CUBE], [[0, 0, 0], place], [Rotation.identity(), corner])
        assert len(contacts) == 1
        assert contacts.gap == pytest.approx([gap], rel=1e-10)
        assert contacts.normal[0] == pytest.approx(normal, abs=1e-10)


def test_faces_cut_into_triangles_change_nothing():
    cut = Polyhedron(CUBE.vertices, CUBE.triangles)
    places = [[0.0, 0.0, 0.0], [0.2, 0.1, 1.0]]
    expected = find([CUBE, CUBE], places)
    for shapes in ([cut, CUBE], [CUBE, cut], [cut, cut]):
        contacts = find(shapes, places)
        order, same = (np.lexsort(c.point.round(6).T) for c in (contacts, expected))
        assert contacts.point[order] == pytest.approx(expected.point[same], abs=1e-12)
        assert contacts.area == pytest.approx([0.18] * 4, rel=1e-12)
    wall = find([cut, HalfSpace()], [[0, 0, 0.5], [0, 0, 0]])
    assert len(wall) == 4 and wall.area == pytest.approx([0.25] * 4, rel=1e-12)


@pytest.mark.slow
def test_contacts_of_bodies_that_move_for_long():
    rng = np.random.default_rng(5)
    shapes, position, rotation = random_scene(rng, ["sphere", "polyhedron", "wall"], 30, 0.7, True)
    bodies = make(shapes, position, rotation)
    free = ~np.isinf(bodies.shapes.bounding_radius)
    search = RigidSearch(bodies, [("a", "a")], reach=0.05)
    velocity = rng.normal(size=(30, 3)) * 0.004
    spin = Rotation.from_rotvec(rng.normal(size=(30, 3)) * 0.004)
    position, rotation = bodies.position.copy(), Rotation.from_matrix(bodies.rotation)
    for step in range(80):
        position[free] += velocity[free] + [0.1, 0.0, 0.0]
        rotation = spin * rotation
        contacts = search.find(position, rotation.as_matrix())
        if step % 20 == 0:
            assert check(bodies, contacts, position, rotation.as_matrix(), 0.05, 1e-10) > 5
        fresh = RigidSearch(bodies, [("a", "a")], 0.05).find(position, rotation.as_matrix())
        assert np.array_equal(contacts.key, fresh.key)
        assert np.array_equal(contacts.gap, fresh.gap)
    assert 1 < search.renewals < 40


def test_small_cube_at_the_corner_of_a_large_one():
    """Names and points are those of the small one, however large the other is."""
    for ratio in (1e3, 1e5):
        large = Polyhedron.box((ratio, ratio, ratio))
        edge = 0.5 * ratio
        for offset in (0.5, 0.2):  # inside the large face; over its edges
            place = [edge - offset - 0.01, edge - offset - 0.01, edge + 0.5]
            contacts = find([large, CUBE], [[0, 0, 0], place])
            assert len(contacts) == 4
            side = min(1.0, offset + 0.51)
            assert contacts.area == pytest.approx([side * side / 4] * 4, rel=1e-9)
            assert np.ptp(contacts.point[:, :2], axis=0) == pytest.approx([side] * 2, rel=1e-9)


@pytest.mark.slow
def test_mirror_images_of_contacts():
    """Which of two bodies comes first changes the sign of the normals alone."""
    rng = np.random.default_rng(1)
    touching = 0
    for _ in range(75):
        shapes = [random_polyhedron(rng, 1.0), random_polyhedron(rng, 1.0)]
        direction = rng.normal(size=3)
        apart = rng.uniform(0.5, 0.9) * sum(shape.bounding_radius for shape in shapes)
        places = np.stack([np.zeros(3), apart * direction / np.linalg.norm(direction)])
        rotations = list(Rotation.random(2, random_state=rng.integers(10**6)))
        contacts = find(shapes, places, rotations, reach=0.3)
        others = find(shapes[::-1], places[::-1], rotations[::-1], reach=0.3)
        assert len(contacts) == len(others)
        order, same = (np.lexsort(c.point.round(8).T) for c in (contacts, others))
        assert others.point[same] == pytest.approx(contacts.point[order], abs=1e-11)
        assert others.normal[same] == pytest.approx(-contacts.normal[order], abs=1e-11)
        assert others.gap[same] == pytest.approx(contacts.gap[order], abs=1e-11)
        touching += len(contacts) > 1
    assert touching > 10
