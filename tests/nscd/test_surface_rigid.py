# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshed surfaces against rigid bodies: every shape, corners of rigid bodies, momentum, lists."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from surfaces import assemble, block, loop, rectangle
from test_surface_search import kind, on_segment

from xper_fx.nscd.rigid import Disc, Polygon, Polyhedron, RigidBodies, RigidBody, Sphere, wall
from xper_fx.nscd.search.surface_search import SurfaceSearch

NODE_RIGID, RIGID_FACET = 3, 4
SQUARE = Polygon([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
CUBE = Polyhedron.box((1.0, 1.0, 1.0))


def searched(parts, bodies, reach, **options):
    surface, x = assemble(*parts)
    rigid = RigidBodies(bodies)
    search = SurfaceSearch(surface, x, reach, rigid=rigid, **options)
    return search, x, rigid, search.find(x, rigid.position, rigid.rotation)


def of_kind(contacts, number):
    return contacts.take(np.flatnonzero(kind(contacts) == number))


@pytest.mark.parametrize("gap", [0.01, -0.01])
def test_a_block_on_walls(gap):
    """In a corner of two walls in 2D, three in 3D: the areas are those of the sides."""
    walls = [wall((0, -gap), (0, 1), "wall"), wall((1 + gap, 0), (-1, 0), "wall")]
    *_, contacts = searched([rectangle((0, 0), (1, 1), (4, 5, 2, 2))], walls, 0.02)
    assert contacts.gap == pytest.approx(gap, abs=1e-14)
    assert contacts.area.sum() == pytest.approx(2.0, abs=1e-12)
    assert len(contacts) == 5 + 6
    assert (contacts.body[:, 0] == -1).all()

    normals = np.array([(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
    points = [-gap * normals[0], -gap * normals[1], (0.0, 1.0 + gap, 0.0)]
    walls = [wall(p, n, "wall") for p, n in zip(points, normals, strict=True)]
    *_, contacts = searched([block((0, 0, 0), (1, 1, 1), (2, 3, 4))], walls, 0.02)
    assert contacts.gap == pytest.approx(gap, abs=1e-14)
    assert contacts.area.sum() == pytest.approx(3.0, abs=1e-12)
    assert contacts.normal == pytest.approx(normals[contacts.body[:, 1]], abs=1e-14)


@pytest.mark.parametrize("gap", [1e-3, -1e-3])
def test_a_disc_in_a_mild_hollow_touches_both_sides(gap):
    """A hollow of 10 degrees, in which an elastic body lies around what is pressed into it."""
    slope = np.tan(np.radians(5.0))
    ground = loop([(-1, -1), (1, -1), (1, slope), (0, 0), (-1, slope)])
    centre = (0.0, (0.3 + gap) * np.hypot(1.0, slope))
    disc = RigidBody(Disc(0.3), centre, "a", density=1.0)
    *_, contacts = searched([ground], [disc], 0.01, hollows=True)
    contacts = of_kind(contacts, RIGID_FACET)
    assert len(contacts) == 2
    assert contacts.gap == pytest.approx(gap, abs=1e-14)
    turned = np.degrees(np.arctan2(*contacts.normal.T))
    assert np.abs(turned) == pytest.approx(5.0, abs=1e-9) and turned.sum() == pytest.approx(0.0)


@pytest.mark.parametrize(
    "radius, beside, alone",
    [(0.3, 0.0, True), (0.3, 5e-3, True), (0.3, 0.1, False), (0.01, 5e-3, False)],
)
def test_a_disc_next_to_a_node_touches_it_alone(radius, beside, alone):
    """Above two facets of a floor, each a metre long; next to it beside the facet and the disc."""
    ground = loop([(-1, -1), (1, -1), (1, 0), (0, 0), (-1, 0)])
    disc = RigidBody(Disc(radius), (beside, radius - 1e-3), "a", density=1.0)
    *_, contacts = searched([ground], [disc], 0.02, hollows=True)
    node = of_kind(contacts, NODE_RIGID)
    assert node.gap == pytest.approx([np.hypot(beside, radius - 1e-3) - radius], abs=1e-14)
    assert of_kind(contacts, RIGID_FACET).gap == pytest.approx([] if alone else [-1e-3], abs=1e-14)


def test_a_rigid_corner_above_a_facet_is_no_corner_of_its_nodes():
    """The node beside it is not the foremost of its surface towards the corner."""
    beside = RigidBody(SQUARE, (0.6, 0.51), "a", density=1.0)  # its corners at x = 0.1 and 1.1
    *_, contacts = searched([rectangle((-2, -1), (2, 0), (2, 1, 2, 1))], [beside], 0.2)
    assert (kind(contacts) == RIGID_FACET).all() and len(contacts) == 2
    assert contacts.gap == pytest.approx(0.01, abs=1e-12)
    # above a ridge it is: there the node and the corner meet
    ridge = loop([(-1, -1), (1, -1), (0, 0)])
    above = RigidBody(SQUARE, (0.0, 0.01 + np.sqrt(0.5)), "a", angle=np.pi / 4, density=1.0)
    *_, contacts = searched([ridge], [above], 0.2)
    assert NODE_RIGID in kind(contacts)
    assert contacts.gap.min() == pytest.approx(0.01, abs=1e-12)


@pytest.mark.parametrize("down", [0.0, 1e-12, 1e-3])
def test_a_wall_touches_the_side_of_a_wedge_at_its_lower_corner(down):
    """A node of the wall is there: it is as near to the wedge's lower face, which faces it less."""
    side = np.array([np.cos(np.pi / 12), -np.sin(np.pi / 12)])
    slope = np.tan(np.pi / 12)
    right = loop([(-slope, -1), (1, -1), (1, 1), (slope, 1), (0, 0)])
    corners = np.array([(-1, 0), (0, 0), (slope, 1), (-1, 1)]) - (0.0, down)
    *_, contacts = searched([right], [RigidBody(Polygon(corners), None, "a", density=1.0)], 1e-6)
    at_corner = of_kind(contacts, NODE_RIGID)
    at_corner = at_corner.take(np.flatnonzero(np.abs(at_corner.point[:, 1]) < 1e-9))
    assert np.abs(at_corner.normal @ side) == pytest.approx([1.0])
    assert at_corner.gap == pytest.approx([down * side[1]], abs=1e-12)


@pytest.mark.parametrize("facing", [True, False])
def test_a_node_is_not_pushed_across_a_rigid_body(facing):
    """Just below the top of a square: a facet that looks down leaves by the top, else nothing."""
    facet = np.array([[1, 0]] if not facing else [[0, 1]])
    edge = np.array([(-0.1, 0.0), (0.1, 0.0)]), facet
    square = RigidBody(SQUARE, (0.0, -0.45), "a", density=1.0)
    *_, contacts = searched([edge], [square], 0.02)
    nodes = of_kind(contacts, NODE_RIGID)
    if facing:
        assert nodes.gap == pytest.approx([-0.05, -0.05], abs=1e-12)
        assert nodes.normal == pytest.approx(np.array([[0.0, 1.0]] * 2), abs=1e-12)
    else:
        assert len(nodes) == 0


def test_a_disc_touches_nodes_and_what_is_between():
    disc = RigidBody(Disc(0.3), (0.55, 1.301), "disc", density=1.0)
    *_, contacts = searched([rectangle((0, 0), (1, 1), 5)], [disc], 0.05)
    assert len(contacts) == 2 + 1
    nodes, facet = of_kind(contacts, NODE_RIGID), of_kind(contacts, RIGID_FACET)
    distance = np.hypot(0.301, [0.05, 0.15]) - 0.3
    assert nodes.gap == pytest.approx(distance, abs=1e-12)
    assert nodes.normal == pytest.approx(
        (nodes.point - disc.position) / (distance + 0.3)[:, None], abs=1e-12
    )
    assert facet.gap == pytest.approx([0.001], abs=1e-12)
    assert facet.body.tolist() == [[0, -1]]
    assert facet.weights[0, 1].sum() == pytest.approx(1.0)
    assert facet.point[0] == pytest.approx([0.55, 1.0], abs=1e-12)
    # over a corner the corner's node alone
    disc = RigidBody(Disc(0.3), (1.0 + 0.6 * 0.305, 1.0 + 0.8 * 0.305), "disc", density=1.0)
    *_, contacts = searched([rectangle((0, 0), (1, 1), 1)], [disc], 0.02)
    assert contacts.gap == pytest.approx([0.005], abs=1e-12)
    assert contacts.normal[0] == pytest.approx([-0.6, -0.8], abs=1e-12)


def test_a_sphere_touches_faces_edges_and_nodes():
    below = block((0, 0, 0), (1, 1, 1), (1, 1, 1))
    slant = np.sqrt(0.5)
    for centre, normal in [
        ((0.6, 0.2, 1.21), (0, 0, 1)),
        ((1 + 0.21 * slant, 0.4, 1 + 0.21 * slant), (slant, 0, slant)),
        (1 + 0.21 / np.sqrt(3) * np.ones(3), np.ones(3) / np.sqrt(3)),
    ]:
        sphere = RigidBody(Sphere(0.2), centre, "ball", density=1.0)
        *_, contacts = searched([below], [sphere], 0.02)
        assert contacts.gap == pytest.approx([0.01], abs=1e-12)
        sign = 1.0 if contacts.body[0, 0] == 0 else -1.0
        assert sign * contacts.normal[0] == pytest.approx(normal, abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.3])
@pytest.mark.parametrize("gap", [0.004, -0.004])
def test_a_rigid_square_on_a_meshed_one(angle, gap):
    """Turned by any angle the same: nodes under it, its corners on facets beside them."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points, edges = rectangle((0, 0), (2, 1), (1, 1, 9, 1))
    square = RigidBody(SQUARE, turn @ [0.9, 1.5 + gap], "stone", angle=angle, density=1.0)
    *_, contacts = searched([(points @ turn.T, edges)], [square], 0.02)
    nodes, corners = of_kind(contacts, NODE_RIGID), of_kind(contacts, RIGID_FACET)
    assert len(nodes) == 5  # 4/9 to 12/9 under 0.4 to 1.4
    assert nodes.area == pytest.approx(2 / 9)
    assert len(corners) == 2
    assert contacts.gap == pytest.approx(gap, abs=1e-12)
    up = turn @ [0, 1]
    assert nodes.normal == pytest.approx(np.tile(-up, (5, 1)), abs=1e-12)
    assert corners.normal == pytest.approx(np.tile(up, (2, 1)), abs=1e-12)


def test_a_rigid_cube_on_a_meshed_block():
    turn = Rotation.from_rotvec([0.2, -0.4, 0.3])
    points, triangles = block((0, 0, 0), (2, 2, 1), (7, 7, 1))
    cube = RigidBody(CUBE, turn.apply([0.95, 1.0, 1.503]), "cube", rotation=turn, density=1.0)
    search, x, rigid, contacts = searched([(turn.apply(points), triangles)], [cube], 0.02)
    nodes, corners = of_kind(contacts, NODE_RIGID), of_kind(contacts, RIGID_FACET)
    inside = (np.abs(points - [0.95, 1.0, 1.0]) < [0.5, 0.5, 1e-9]).all(axis=1)
    assert set(nodes.nodes[:, 0, 0]) == set(np.flatnonzero(inside))
    assert len(corners) == 4
    assert contacts.gap == pytest.approx(0.003, abs=1e-12)
    assert turn.inv().apply(nodes.normal) == pytest.approx(
        np.tile([0, 0, -1.0], (len(nodes), 1)), abs=1e-12
    )
    # sunk by 0.01: the same, none from below or from the sides
    sunk = search.find(x - turn.apply([0, 0, -0.013]), rigid.position, rigid.rotation)
    assert len(sunk) == len(contacts)
    assert sunk.gap == pytest.approx(-0.01, abs=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_distance_of_corners_against_all_facets(dim):
    """Random small stones near a big block: the least gap is the least distance of corners (2D),
    and no contact has a gap smaller than the distance of its sides."""
    rng = np.random.default_rng(dim)
    if dim == 2:
        part = rectangle((0, 0), (2, 1), (5, 3, 4, 2))
        shape = Polygon([(-0.1, -0.1), (0.1, -0.1), (0.05, 0.12)])
    else:
        part = block((0, 0, 0), (2, 1, 1), (3, 2, 2))
        shape = Polyhedron.hull(0.1 * np.random.default_rng(0).normal(size=(8, 3)))
    found = 0
    for _ in range(20):
        position = np.array([2.0, 1.0, 1.0])[:dim] * rng.uniform(-0.1, 1.1, dim)
        position[rng.integers(dim)] = -0.15
        turn = (
            {"angle": rng.uniform(0, 6)}
            if dim == 2
            else {"rotation": Rotation.random(random_state=rng)}
        )
        stone = RigidBody(shape, position, "stone", density=1.0, **turn)
        search, x, rigid, contacts = searched([part], [stone], 0.3)
        if dim == 2:
            c, s = np.cos(rigid.rotation[0]), np.sin(rigid.rotation[0])
            corners = position + shape.centred_vertices @ np.array([[c, s], [-s, c]])
            low = np.zeros(2)
        else:
            corners = position + shape.centred_vertices @ rigid.rotation[0].T
            low = np.zeros(3)
        high = np.array([2.0, 1.0, 1.0])[:dim]
        distance = np.linalg.norm(corners - np.clip(corners, low, high), axis=1)
        if distance.min() == 0.0:
            continue
        if dim == 2:
            sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
            nodes = [np.linalg.norm(p - on_segment(p, a, b)) for a, b in sides for p in x]
            assert contacts.gap.min() == pytest.approx(min(*nodes, distance.min()), abs=1e-12)
        corner = of_kind(contacts, RIGID_FACET)
        assert corner.gap.min(initial=np.inf) >= distance.min() - 1e-12
        found += len(corner)
    assert found > 15


@pytest.mark.parametrize("dim", [2, 3])
def test_impulses_of_any_direction_keep_momenta(dim):
    """Both sides act at one point, also along the tangent."""
    if dim == 2:
        part = rectangle((0, 0), (2, 1), (5, 3, 7, 2))
        bodies = [
            RigidBody(SQUARE, (0.9, 1.503), "a", density=1.0),
            RigidBody(Disc(0.2), (0.2, 1.199), "a", density=1.0),
        ]
    else:
        part = block((0, 0, 0), (2, 1, 1), (5, 3, 4))
        bodies = [
            RigidBody(CUBE, (0.9, 0.53, 1.503), "a", density=1.0),
            RigidBody(Sphere(0.2), (1.8, 0.2, 1.199), "a", density=1.0),
        ]
    _, x, _, contacts = searched([part], bodies, 0.02)
    assert len(contacts) >= 7
    acting = np.einsum("nsk,nskd->nsd", contacts.weights, x[contacts.nodes])
    meshed = contacts.body < 0
    at = np.repeat(contacts.point[:, None], 2, axis=1)
    assert acting[meshed] == pytest.approx(at[meshed], abs=1e-13)
    assert contacts.weights.sum(axis=2)[meshed] == pytest.approx(1.0, abs=1e-13)
    assert (contacts.weights[~meshed] == 0).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_lists_follow_rigid_bodies(dim):
    rng = np.random.default_rng(7)
    if dim == 2:
        part, shapes = rectangle((0, 0), (2, 1), 6), [SQUARE, Disc(0.3)]
    else:
        part, shapes = block((0, 0, 0), (2, 1, 1), (4, 3, 3)), [CUBE, Sphere(0.3)]
    bodies = [
        RigidBody(shape, np.array([k, 1.5, 0.5])[:dim], "stones", density=1.0)
        for k, shape in enumerate(shapes)
    ]
    bodies.append(wall((-0.01, 0, 0)[:dim], (1, 0, 0)[:dim], "wall"))
    search, x, rigid, _ = searched([part], bodies, 0.05)
    position, angle = rigid.position.copy(), 0.0
    for _ in range(50):
        position[:2, 1] -= 0.002
        angle += 0.004
        x += 1e-3 * rng.normal(size=x.shape)
        turn = np.full(3, angle)
        if dim == 3:
            turn = Rotation.from_rotvec(np.outer(turn, [0.3, 0.2, 0.9])).as_matrix()
        mine = search.find(x, position, turn)
        fresh = SurfaceSearch(search.surface, x, 0.05, rigid=rigid)
        fresh.depth, fresh.extent, fresh._share = search.depth, search.extent, search._share
        fresh = fresh.find(x, position, turn)
        assert (mine.key == fresh.key).all()
        assert mine.gap == pytest.approx(fresh.gap, abs=1e-12)
    assert {1, 2, 3} & set(np.unique(kind(mine)))
    assert search.lists.renewals < 15


def test_groups_of_rigid_bodies():
    walls = [wall((0, -0.001), (0, 1), "floor"), wall((1.001, 0), (-1, 0), "side")]
    part = [rectangle((0, 0), (1, 1))]
    *_, contacts = searched(part, walls, 0.02, pairs=[("side", "surface")])
    assert contacts.body[:, 1].tolist() == [1, 1]
    with pytest.raises(ValueError, match="two names"):
        searched(part, [wall((0, 0), (0, 1), "surface")], 0.02)
    surface, x = assemble(*part)
    search = SurfaceSearch(surface, x, 0.02, rigid=RigidBodies(walls))
    with pytest.raises(ValueError, match="positions"):
        search.find(x)
