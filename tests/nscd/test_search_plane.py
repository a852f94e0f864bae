# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of discs, polygons and half planes."""

import numpy as np
import pytest
from search_cases import check, make

from xper_fx.nscd.rigid import Disc, HalfPlane, Polygon
from xper_fx.nscd.search.rigid_search import RigidSearch


def random_polygon(rng, size):
    count = rng.integers(3, 9)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    while np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max() > 0.9 * np.pi:
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    points = np.stack([np.cos(angle), rng.uniform(0.1, 1.0) * np.sin(angle)], axis=1)
    return Polygon(size * points)


def random_scene(rng, kinds, count, decades, clustered):
    shapes = []
    for _ in range(count):
        size = 10.0 ** rng.uniform(-decades, 0.0)
        kind = rng.choice(kinds)
        shapes.append(Disc(size) if kind == "disc" else random_polygon(rng, size))
    spread = 0.3 * np.sqrt(count) if clustered else 0.8 * np.sqrt(count)
    position = rng.uniform(-spread, spread, (count, 2))
    if "wall" in kinds:
        shapes[3], shapes[7] = HalfPlane(), HalfPlane()
        position[[3, 7]] = [[0.0, -0.7 * spread], [0.7 * spread, 0.0]]
    return shapes, position, rng.uniform(-7.0, 7.0, count)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kinds", [["disc"], ["disc", "polygon"], ["disc", "wall"], ["polygon", "wall"]]
)
# each two of them together
@pytest.mark.parametrize(
    ("clustered", "decades", "offset"),
    [(False, 0.3, 0.0), (True, 0.3, 1e5), (False, 3.0, 1e5), (True, 3.0, 0.0)],
)
def test_contacts_are_those_of_brute_force(kinds, clustered, decades, offset):
    rng = np.random.default_rng(int(10 * decades) + clustered)
    touching = 0
    for _ in range(3):
        shapes, position, angle = random_scene(rng, kinds, 50, decades, clustered)
        bodies = make(shapes, position + offset, angle)
        search = RigidSearch(bodies, [("a", "a")], reach=0.1)
        tolerance = 1e-12 * (10.0 + 10.0 * offset)
        contacts = search.find(bodies.position, bodies.rotation)
        touching += check(bodies, contacts, bodies.position, bodies.rotation, 0.1, tolerance)
    assert touching >= 10


@pytest.mark.slow
def test_contacts_of_bodies_that_move_for_long_and_renewals():
    """Between renewals no contact is missed; all move with a common speed besides their own."""
    rng = np.random.default_rng(3)
    shapes, position, angle = random_scene(rng, ["disc", "polygon", "wall"], 60, 0.7, True)
    bodies = make(shapes, position, angle)
    search = RigidSearch(bodies, [("a", "a")], reach=0.05)
    free = ~np.isinf(bodies.shapes.bounding_radius)
    velocity, spin = rng.normal(size=(2, 60, 2)) * 0.004
    position, angle = bodies.position.copy(), bodies.rotation.copy()
    for step in range(120):
        position[free] += velocity[free] + [0.1, 0.0]
        angle += spin[:, 0]
        contacts = search.find(position, angle)
        if step % 10 == 0:
            assert check(bodies, contacts, position, angle, 0.05, 1e-10) > 5
        fresh = RigidSearch(bodies, [("a", "a")], reach=0.05).find(position, angle)
        assert np.array_equal(contacts.key, fresh.key)
        assert np.array_equal(contacts.gap, fresh.gap)
    # The fastest two approach by 0.03 m a step; a skin of a tenth of a body lasts a few steps.
    assert 2 < search.renewals < 40
    assert search.searches == 120


def test_bodies_that_fall_together_keep_their_list():
    rng = np.random.default_rng(4)
    shapes, position, angle = random_scene(rng, ["disc", "polygon"], 60, 0.7, False)
    bodies = make(shapes, position, angle)
    search = RigidSearch(bodies, [("a", "a")], reach=0.05)
    for step in range(100):
        search.find(bodies.position - [0.0, 0.1 * step**2], bodies.rotation)
    assert search.renewals == 1


def test_the_skin_follows_the_motion():
    """Least cost: dim skin^2 + (dim - 1) k s skin = k s D, with k = 10 for discs."""
    bodies = make([Disc(0.5), Disc(0.5), Disc(0.5)], [[0.0, 0.0], [1.2, 0.0], [0.0, 1.2]])
    search = RigidSearch(bodies, [("a", "a")], reach=0.2)
    assert search.skin == pytest.approx(0.12, rel=1e-15)
    speed = 1e-3
    position = bodies.position.copy()
    for _ in range(200):
        search.find(position, bodies.rotation)
        position[1, 0] += speed
        position[2, 1] += speed
        assert search.skin <= 1.2
    assert 2 < search.renewals < 30
    # About the mean displacement the two move by (2/3, -1/3) and (-1/3, 2/3) of their speed.
    rate = 2.0 * np.hypot(2.0, 1.0) / 3.0 * speed
    spent = 10.0 * rate
    assert 2.0 * search.skin**2 + spent * search.skin == pytest.approx(spent * 1.2, rel=1e-3)


def boxes(*places, lengths=(1.0, 1.0)):
    """Rectangles at (x, y, angle)."""
    places = np.array(places, float)
    return make([Polygon.box(lengths)] * len(places), places[:, :2], places[:, 2])


def find(bodies, reach=0.01):
    return RigidSearch(bodies, [("a", "a")], reach).find(bodies.position, bodies.rotation)


@pytest.mark.parametrize("tilt", [0.0, 1e-15, -1e-12, 1e-9, -1e-6, 1e-4])
@pytest.mark.parametrize("offset", [0.0, 1e-15, -1e-12, 1e-9, 0.3, -0.9])
@pytest.mark.parametrize("gap", [0.0, 1e-15, -1e-12, 1e-6, -1e-3])
def test_stacked_blocks_touch_at_both_ends_of_the_overlap(tilt, offset, gap):
    contacts = find(boxes((0, 0, 0), (offset, 1.0 + gap, tilt)))
    assert len(contacts) == 2
    assert np.abs(contacts.normal - [0.0, -1.0]).max() <= abs(tilt) + 1e-15
    overlap = 1.0 - abs(offset)
    assert contacts.area == pytest.approx([0.5 * overlap] * 2, abs=2e-4)
    ends = sorted([max(-0.5, offset - 0.5), min(0.5, offset + 0.5)])
    assert sorted(contacts.point[:, 0]) == pytest.approx(ends, abs=2e-4)
    assert contacts.point[:, 1] == pytest.approx([0.5, 0.5], abs=2e-3)
    assert contacts.gap == pytest.approx([gap, gap], abs=0.6 * abs(tilt) + 1e-15)


def test_keys_stay_while_blocks_slide_rock_and_line_up():
    keys = []
    for shift in np.linspace(-0.3, -0.1, 50):
        keys.append(find(boxes((0, 0, 0), (shift, 1.0, 1e-4 * np.sin(90.0 * shift)))).key)
    assert all(np.array_equal(key, keys[0]) for key in keys)
    rng = np.random.default_rng(0)
    aligned = [
        find(boxes((0, 0, 0), (*(rng.normal(size=2) * 1e-9 + [0, 1]), 1e-9 * rng.normal()))).key
        for _ in range(50)
    ]
    assert all(np.array_equal(key, aligned[0]) for key in aligned)
    # One end is always the left corner of one of the two, the other the right one.
    assert len(np.unique(keys[0][:, 1])) == 2 and len(np.unique(aligned[0][:, 1])) == 2


def test_corner_on_corner():
    contacts = find(boxes((0, 0, 0), (1.003, 1.004, 0)))
    assert len(contacts) == 1
    assert contacts.gap == pytest.approx([0.005], rel=1e-12)
    assert contacts.normal[0] == pytest.approx([-0.6, -0.8], rel=1e-12)
    assert contacts.point[0] == pytest.approx([0.5015, 0.502], rel=1e-12)
    assert 0.0 < contacts.area[0] < 1e-5
    for x in (0.0, 1e-16, 1e-14, -1e-14, 4e-13):
        # Corners that meet up to rounding: the normal is an edge's, not that of the rounding.
        contacts = find(boxes((0, 0, 0), (1.0 + x, 1.0 + 2 * x, 0)))
        assert np.sort(np.abs(contacts.normal), axis=1).tolist() == [[0.0, 1.0]] * len(contacts)
        assert np.abs(contacts.gap).max() < 1e-12
        assert np.abs(contacts.point - 0.5).max() < 1e-12


def test_wall_holds_a_block_at_its_lowest_edge():
    tilt = 1e-3
    bodies = make([HalfPlane(), Polygon.box((2.0, 1.0))], [[5.0, 0.1], [0.0, 0.6]], [0.0, tilt])
    contacts = find(bodies)
    assert contacts.body.tolist() == [[1, 0], [1, 0]]
    low = 0.5 - 0.5 * np.cos(tilt) + np.array([-1.0, 1.0]) * np.sin(tilt)
    assert contacts.gap == pytest.approx(low, abs=1e-15)
    assert contacts.area == pytest.approx([np.cos(tilt)] * 2, rel=1e-12)
    assert contacts.normal.tolist() == [[0.0, 1.0]] * 2


def test_straight_vertices_change_nothing():
    plain = Polygon.box((1.0, 1.0))
    extra = Polygon([[-0.5, -0.5], [0.1, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5], [-0.5, 0.2]])
    places = [[0.0, 0.0], [0.2, 1.0]]
    for shapes in ([extra, plain], [plain, extra], [extra, extra]):
        contacts = find(make(shapes, places))
        assert sorted(contacts.point[:, 0]) == pytest.approx([-0.3, 0.5], abs=1e-12)
        assert contacts.area == pytest.approx([0.4, 0.4], rel=1e-12)
