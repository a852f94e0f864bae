# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which bodies the search looks at, what it reports, and how its work grows."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from search_cases import check, make
from test_search_plane import boxes

from xper_fx.nscd.rigid import (
    Disc,
    HalfPlane,
    HalfSpace,
    Polygon,
    Polyhedron,
    RigidBodies,
    RigidBody,
    Sphere,
)
from xper_fx.nscd.search.rigid_search import RigidSearch


def pairs_of(contacts):
    return sorted({(min(pair), max(pair)) for pair in contacts.body.tolist()})


def four_discs(groups, prescribed):
    """Discs of radius 0.5 at the corners of a unit square, each touching two."""
    places = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    fixed = {0: 0.0, 1: 0.0, 2: 0.0}
    bodies = RigidBodies(
        [
            RigidBody(Disc(0.5), place, group, density=1.0, prescribed=fixed if held else {})
            for place, group, held in zip(places, groups, prescribed, strict=True)
        ]
    )
    return bodies


@pytest.mark.parametrize(
    ("pairs", "expected"),
    [
        ([("a", "a")], [(0, 1)]),
        ([("a", "b")], [(0, 3), (1, 2)]),
        ([("b", "a")], [(0, 3), (1, 2)]),
        ([("a", "a"), ("b", "b")], [(0, 1), (2, 3)]),
        ([("a", "a"), ("a", "b"), ("b", "b")], [(0, 1), (0, 3), (1, 2), (2, 3)]),
        ([], []),
    ],
)
def test_groups_that_are_named_touch(pairs, expected):
    bodies = four_discs("aabb", [False] * 4)
    contacts = RigidSearch(bodies, pairs, 0.1).find(bodies.position, bodies.rotation)
    assert pairs_of(contacts) == expected


def test_prescribed_bodies_do_not_touch_each_other():
    bodies = four_discs("aabb", [True, True, False, True])
    pairs = [("a", "a"), ("a", "b"), ("b", "b")]
    contacts = RigidSearch(bodies, pairs, 0.1).find(bodies.position, bodies.rotation)
    assert pairs_of(contacts) == [(1, 2), (2, 3)]
    wall_and_held = RigidBodies(
        [
            RigidBody(HalfPlane(), [0.0, 0.0], "a"),
            RigidBody(Disc(0.5), [0.0, 0.5], "a", density=1.0, prescribed={0: 0, 1: 0, 2: 0}),
            RigidBody(Disc(0.5), [5.0, 0.5], "a", density=1.0, prescribed={0: 0, 1: 0}),
        ]
    )
    search = RigidSearch(wall_and_held, [("a", "a")], 0.1)
    contacts = search.find(wall_and_held.position, wall_and_held.rotation)
    assert contacts.body.tolist() == [[2, 0]]


def test_overlaps_at_the_start():
    bodies = boxes((0, 0, 0), (0.9, 0.2, 0), (3, 0, 0), (4, 0.1, 0), (0, 5, 0), (0, 5.97, 0.05))
    search = RigidSearch(bodies, [("a", "a")], 0.1)
    overlaps = search.overlaps(bodies.position, bodies.rotation, tolerance=1e-9)
    assert [pair[:2] for pair in overlaps] == [(0, 1), (4, 5)]
    deep = 0.5 + 0.5 * (np.cos(0.05) + np.sin(0.05)) - 0.97
    assert [pair[2] for pair in overlaps] == pytest.approx([0.1, deep], rel=1e-12)
    search = RigidSearch(bodies, [("a", "a")], 0.1)
    assert search.overlaps(bodies.position, bodies.rotation, tolerance=0.2) == []


@pytest.mark.parametrize(
    ("pairs", "reach", "words"),
    [
        ([("a", "c")], 0.1, "'c'"),
        (["ab"], 0.1, "pair of groups"),
        ([("a", "a")], 0.0, "reach"),
        ([("a", "a")], np.inf, "reach"),
    ],
)
def test_bad_input_is_refused(pairs, reach, words):
    with pytest.raises(ValueError, match=words):
        RigidSearch(four_discs("aabb", [False] * 4), pairs, reach)


def test_bad_positions_are_refused_and_do_no_harm():
    bodies = four_discs("aabb", [False] * 4)
    search = RigidSearch(bodies, [("a", "b")], 0.1)
    expected = search.find(bodies.position, bodies.rotation)
    lost = bodies.position.copy()
    lost[2, 0] = np.nan
    with pytest.raises(ValueError, match="position of body 2"):
        search.find(lost, bodies.rotation)
    with pytest.raises(ValueError, match="shapes"):
        search.find(bodies.position, np.zeros((4, 3, 3)))
    again = search.find(bodies.position, bodies.rotation)
    assert np.array_equal(again.key, expected.key) and search.renewals == 1


def test_balls_whose_centres_coincide_have_a_normal():
    for shape in (Disc(0.5), Sphere(0.5)):
        bodies = make([shape, shape], np.zeros((2, shape.dim)))
        contacts = RigidSearch(bodies, [("a", "a")], 0.1).find(bodies.position, bodies.rotation)
        assert contacts.normal[0].tolist() == [1.0] + [0.0] * (shape.dim - 1)
        assert contacts.gap.tolist() == [-1.0]


@pytest.mark.parametrize("dim", [2, 3])
def test_a_ball_at_a_corner_an_edge_and_inside(dim):
    solid = Polygon.box((2.0, 2.0)) if dim == 2 else Polyhedron.box((2.0, 2.0, 2.0))
    ball = Disc(0.5) if dim == 2 else Sphere(0.5)
    rest = [0.0] * (dim - 2)
    cases = [
        ([1.3, 1.4, *rest], 0.0, [0.6, 0.8, *rest]),
        ([1.0, 1.0, *rest], -0.5, None),  # the centre on the corner: either side's normal
        ([0.2, 1.5, *rest], 0.0, [0.0, 1.0, *rest]),
        ([0.2, 0.9, *rest], -0.6, [0.0, 1.0, *rest]),
    ]
    for place, gap, normal in cases:
        bodies = make([solid, ball], [[0.0] * dim, place])
        contacts = RigidSearch(bodies, [("a", "a")], 0.1).find(bodies.position, bodies.rotation)
        assert contacts.body.tolist() == [[1, 0]]
        assert contacts.gap == pytest.approx([gap], abs=1e-14)
        if normal is None:
            assert sorted(contacts.normal[0].tolist()) == [0.0] * (dim - 1) + [1.0]
        else:
            assert contacts.normal[0] == pytest.approx(normal, abs=1e-14)
        assert contacts.key.tolist() == [[1, 0]] and contacts.area.tolist() == [1.0]


@pytest.mark.parametrize("dim", [2, 3])
def test_contacts_with_walls_that_move_and_turn(dim):
    """Walls have no lists: they may do what they like without renewals."""
    rng = np.random.default_rng(dim)
    if dim == 2:
        shapes = [HalfPlane(), *[Disc(0.1), Polygon.regular(5, 0.1)] * 10]
    else:
        shapes = [HalfSpace(), *[Sphere(0.1), Polyhedron.box((0.1, 0.2, 0.15))] * 10]
    position = np.concatenate([np.zeros((1, dim)), rng.uniform(-3.0, 3.0, (20, dim))])
    bodies = make(shapes, position)
    search = RigidSearch(bodies, [("a", "a")], 0.05)
    position, rotation = bodies.position.copy(), bodies.rotation.copy()
    touching = 0
    for step in range(20):
        angle = 0.4 * step
        position[0] = [0.2 * np.cos(3 * angle), 0.3 * np.sin(angle), 0.0][:dim]
        if dim == 2:
            rotation[0] = angle
        else:
            c, s = np.cos(angle), np.sin(angle)
            rotation[0] = [[c, -s, 0], [0, 0, -1], [s, c, 0]]
        contacts = search.find(position, rotation)
        touching += check(bodies, contacts, position, rotation, 0.05, 1e-13)
    assert touching > 50
    assert search.renewals == 1


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("dim", [2, 3])
def test_boxes_on_a_grid_and_their_mirror_images(dim, offset):
    """Faces, edges and corners that meet exactly, or nearly; either body first."""
    rng = np.random.default_rng(11)
    box = Polygon.box if dim == 2 else Polyhedron.box
    both = [("a", "a")]
    touching = 0
    for _ in range(60):
        shapes = [box(rng.choice([1.0, 2.0], dim)) for _ in range(2)]
        places = np.zeros((2, dim))
        places[1] = 0.5 * rng.integers(-4, 5, dim) + offset * rng.normal(size=dim)
        bodies = make(shapes, places)
        contacts = RigidSearch(bodies, both, 0.1).find(bodies.position, bodies.rotation)
        touching += check(bodies, contacts, bodies.position, bodies.rotation, 0.1, 2e-12)
        mirror = make(shapes[::-1], places[::-1])
        others = RigidSearch(mirror, both, 0.1).find(mirror.position, mirror.rotation)
        assert len(others) == len(contacts)
        assert np.sort(others.gap) == pytest.approx(np.sort(contacts.gap), abs=2e-12)
        if len(contacts) and contacts.gap.max() > -1e-5:  # else two ways out may be equal
            order, same = (np.lexsort(c.point.round(4).T) for c in (contacts, others))
            if np.abs(contacts.normal[0] + others.normal[0]).max() < 1e-6:
                assert others.point[same] == pytest.approx(contacts.point[order], abs=1e-6)
    assert touching > 20


@pytest.mark.parametrize("dim", [2, 3])
def test_many_balls_against_a_tree(dim):
    """Contacts are those of a k-d tree; the list grows as the bodies do, 8 bytes a pair."""
    rng = np.random.default_rng(0)
    shape = Disc(0.5) if dim == 2 else Sphere(0.5)
    a_body = []
    for count in (1000, 16000):
        side = round(count ** (1.0 / dim))
        count = side**dim
        lattice = np.stack(np.meshgrid(*[np.arange(side)] * dim), axis=-1).reshape(-1, dim)
        position = lattice + 0.02 * rng.normal(size=(count, dim))
        bodies = make([shape] * count, position)
        search = RigidSearch(bodies, [("a", "a")], 0.01)
        contacts = search.find(bodies.position, bodies.rotation)
        expected = cKDTree(position).query_pairs(1.01, output_type="ndarray")
        expected = expected[np.lexsort(expected.T[::-1])]
        assert np.array_equal(contacts.body, expected)
        difference = position[expected[:, 0]] - position[expected[:, 1]]
        assert contacts.gap == pytest.approx(np.linalg.norm(difference, axis=1) - 1.0, abs=1e-13)
        assert search.nbytes == 8 * search.num_candidates
        near = cKDTree(position).query_pairs(1.01 + search.skin, output_type="ndarray")
        assert search.num_candidates == len(near)
        a_body.append(search.num_candidates / (count - side ** (dim - 1)))
    assert a_body[1] == pytest.approx(a_body[0], rel=0.05)


@pytest.mark.parametrize("dim", [2, 3])
def test_two_balls_that_approach_are_not_missed(dim):
    """Both move by the skin's half before the list must be made anew."""
    ball = Disc(0.5) if dim == 2 else Sphere(0.5)
    bodies = make([ball, ball], [[0.0] * dim, [1.2] + [0.0] * (dim - 1)])
    search = RigidSearch(bodies, [("a", "a")], 0.01)
    start = 1.0 + search.reach + 1.01 * search.skin
    step = 0.02 * search.skin
    position = np.zeros((2, dim))
    for k in range(80):
        position[:, 0] = [0.5 * k * step, start - 0.5 * k * step]
        contacts = search.find(position, bodies.rotation)
        assert len(contacts) == (start - k * step <= 1.0 + search.reach)
    assert len(contacts) == 1 and search.renewals == 2


@pytest.mark.parametrize("dim", [2, 3])
def test_the_tip_of_a_rod_that_turns_is_not_missed(dim):
    rod = Polygon.box((10.0, 0.1)) if dim == 2 else Polyhedron.box((10.0, 0.1, 0.1))
    ball = Disc(0.1) if dim == 2 else Sphere(0.1)
    height = [4.0, 3.0, 0.0][:dim]
    bodies = make([rod, ball], [[0.0] * dim, height])
    search = RigidSearch(bodies, [("a", "a")], 0.01)
    rotation = bodies.rotation.copy()
    met = []
    for k in range(60):
        angle = 0.02 * k
        if dim == 2:
            rotation[0] = angle
        else:
            c, s = np.cos(angle), np.sin(angle)
            rotation[0] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        contacts = search.find(bodies.position, rotation)
        across = np.abs(4.0 * np.sin(angle) - 3.0 * np.cos(angle))
        assert len(contacts) == (across - 0.15 <= 0.01)
        met.append(len(contacts))
    assert sum(met) in (3, 4) and met[-1] == 0
