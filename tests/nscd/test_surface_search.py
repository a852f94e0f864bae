# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of meshed surfaces against brute force, and what they owe to mechanics: continuous gaps,
keys that stay, momentum, areas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba import njit
from surfaces import assemble, block, hull, loop, rectangle

from xper_fx.nscd.search.contact_pairs import spin_arms
from xper_fx.nscd.search.edge_edge import BENT, edge_bends, surface_edges
from xper_fx.nscd.search.facet_geometry import closest_weights
from xper_fx.nscd.search.surface_search import SurfaceSearch

NODE_FACET, EDGE_EDGE = 1, 2


def kind(contacts):
    return contacts.key[:, 0] >> 60


def on_segment(p, a, b):
    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return a + t * (b - a)


def closest_on_triangle(p, corner, normal):
    """Closest point, and whether it is inside."""
    q = p - (p - corner[0]) @ normal * normal
    sides = zip(corner, np.roll(corner, -1, axis=0), strict=True)
    if all(np.cross(b - a, q - a) @ normal > 0 for a, b in sides):
        return q, True
    ends = [on_segment(p, a, b) for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True)]
    return min(ends, key=lambda e: np.linalg.norm(p - e)), False


def closest_on_edge(p, corner, normal):
    q = on_segment(p, *corner)
    return q, bool(abs((p - q) @ (corner[1] - corner[0])) < 1e-12)


def outward_normals(x, facets):
    corner = x[facets]
    if x.shape[1] == 2:
        along = corner[:, 1] - corner[:, 0]
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    else:
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return normal / np.linalg.norm(normal, axis=1)[:, None]


def convex_contacts(search, x):
    """All contacts of nodes of convex bodies, by looking at every facet of the others."""
    surface = search.surface
    normal = outward_normals(x, surface.facets)
    share = surface.measure(x) / surface.dim
    closest = closest_on_edge if surface.dim == 2 else closest_on_triangle
    found = {}
    for node in range(surface.num_nodes):
        own = np.flatnonzero((surface.facets == node).any(axis=1))
        p = x[node]

        def faces(n, own=own):
            area = share[own] * np.maximum(0.0, -normal[own] @ n)
            return area.sum() >= 0.05 * share[own].sum()

        for body in set(surface.body) - {surface.body[own[0]]}:
            facets = np.flatnonzero(surface.body == body)
            height = ((p - x[surface.facets[facets, 0]]) * normal[facets]).sum(axis=1)
            if height.max() > search.reach:
                continue
            points = [closest(p, x[surface.facets[f]], normal[f]) for f in facets]
            if height.max() > 0:
                q, inside = min(points, key=lambda r: np.linalg.norm(p - r[0]))
                gap = np.linalg.norm(p - q)
                n = (p - q) / gap
                around = x[np.unique(surface.facets[own])] - p
                if gap > search.reach or not faces(n) or (not inside and (around @ n).min() < 0):
                    continue
                found[node, body] = (gap, n)
            else:
                ways = [
                    (height[i], f)
                    for i, f in enumerate(facets)
                    if points[i][1] and height[i] >= -search.depth[f] and faces(normal[f])
                ]
                if ways:
                    gap, f = max(ways)
                    found[node, body] = (gap, normal[f])
    return found


@njit
def closest_point(p, x, facets, weights):
    return closest_weights(p, x, facets, 0, weights, 0)


PLACES = st.integers(-8, 8)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.lists(st.tuples(PLACES, PLACES, PLACES), min_size=4, max_size=4))
def test_the_closest_point_of_a_triangle(points):
    """Of any triangle, obtuse and thin ones too: against its edges one by one."""
    *x, p = np.array(points, float)
    x = np.array(x)
    normal = np.cross(x[1] - x[0], x[2] - x[0])
    assume(np.linalg.norm(normal) > 1e-9)
    expected, _ = closest_on_triangle(p, x, normal / np.linalg.norm(normal))
    weights = np.empty((1, 3))
    square, _ = closest_point(p, x, np.arange(3)[None], weights)
    assert square == pytest.approx(((p - expected) ** 2).sum(), abs=1e-9)
    assert weights[0] @ x == pytest.approx(expected, abs=1e-6)
    assert weights.min() >= -1e-9 and weights.sum() == pytest.approx(1.0, abs=1e-12)


def convex_bodies(dim, rng, count, spread):
    parts = []
    for _ in range(count):
        centre = rng.uniform(0, spread, dim)
        if dim == 2:
            angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
            points = centre + np.stack([np.cos(angle), np.sin(angle)], axis=1)
            parts.append(loop(points, rng.integers(1, 3, 9)))
        else:
            points = rng.normal(size=(14, 3))
            parts.append(hull(centre + points / np.linalg.norm(points, axis=1)[:, None]))
    return assemble(*parts)


@pytest.mark.slow
@pytest.mark.parametrize("dim, count, spread", [(2, 12, 5.0), (3, 10, 3.5)])
def test_every_contact_of_convex_bodies_is_found(dim, count, spread):
    rng = np.random.default_rng(dim)
    total = np.zeros(2, int)
    for _ in range(6):
        surface, x = convex_bodies(dim, rng, count, spread)
        search = SurfaceSearch(surface, x, 0.2, self_contact=False)
        contacts = search.find(x)
        contacts = contacts.take(np.flatnonzero(kind(contacts) == NODE_FACET))
        expected = convex_contacts(search, x)
        node = contacts.nodes[:, 0, 0]
        facet_node = contacts.nodes[:, 1, 0]
        body_of = np.empty(surface.num_nodes, int)
        body_of[surface.facets] = surface.body[:, None]
        found = {
            (a, body_of[b]): (g, n)
            for a, b, g, n in zip(node, facet_node, contacts.gap, contacts.normal, strict=True)
        }
        assert len(found) == len(contacts)
        assert found.keys() == expected.keys()
        for pair, (gap, normal) in expected.items():
            assert found[pair][0] == pytest.approx(gap, abs=1e-11)
            assert found[pair][1] == pytest.approx(normal, abs=1e-7)
        gaps = contacts.gap
        total += (gaps > 0).sum(), (gaps < 0).sum()
    assert (total > 30).all()


def segments_distance(a, b, c, d):
    """Distance of two segments by minimising over the square of their shares."""
    u, v, r = b - a, d - c, a - c
    best = min(
        np.linalg.norm(p - on_segment(p, *s))
        for p, s in ((a, (c, d)), (b, (c, d)), (c, (a, b)), (d, (a, b)))
    )
    matrix = np.array([[u @ u, -u @ v], [-u @ v, v @ v]])
    s, t = np.linalg.solve(matrix, [-r @ u, r @ v])
    if 0 < s < 1 and 0 < t < 1:
        best = min(best, np.linalg.norm(r + s * u - t * v))
    return best


@pytest.mark.slow
def test_the_distance_of_two_solids_is_a_contact():
    """Nodes, facets and edges together: the smallest gap is the distance of convex solids."""
    rng = np.random.default_rng(3)
    kinds = []
    for _ in range(6):
        surface, x = convex_bodies(3, rng, 2, 0.0)
        facets, body = surface.facets, surface.body
        second = np.unique(facets[body == 1])
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        first = np.unique(facets[body == 0])
        x[second] += direction * (
            (x[first] @ direction).max() - (x[second] @ direction).min() + 0.02
        )
        normal = outward_normals(x, facets)
        nodes = [
            np.linalg.norm(x[node] - closest_on_triangle(x[node], x[facets[f]], normal[f])[0])
            for nodes, other in ((first, 1), (second, 0))
            for node in nodes
            for f in np.flatnonzero(body == other)
        ]
        edges = [
            np.sort(np.concatenate([own[:, [0, 1]], own[:, [1, 2]], own[:, [2, 0]]]))
            for own in (facets[body == 0], facets[body == 1])
        ]
        edges = [np.unique(e, axis=0) for e in edges]
        between = [segments_distance(*x[a], *x[b]) for a in edges[0] for b in edges[1]]
        distance = min(*nodes, *between)
        contacts = SurfaceSearch(surface, x, 1.5 * distance).find(x)
        assert contacts.gap.min() == pytest.approx(distance, abs=1e-12)
        kinds.append(kind(contacts)[contacts.gap.argmin()])
    assert kinds.count(EDGE_EDGE) > 0
    assert kinds.count(NODE_FACET) > 0


def sides(contacts, x):
    """Points at which the two meshed sides act."""
    return np.einsum("nsk,nskd->nsd", contacts.weights, x[contacts.nodes])


@pytest.mark.parametrize("dim", [2, 3])
def test_impulses_along_the_normal_keep_momenta(dim):
    rng = np.random.default_rng(10 + dim)
    surface, x = convex_bodies(dim, rng, 14, 4.0)
    contacts = SurfaceSearch(surface, x, 0.3, depth=0.5).find(x)
    assert len(contacts) > 50
    assert contacts.weights.sum(axis=2) == pytest.approx(np.ones((len(contacts), 2)), abs=1e-13)
    lever = sides(contacts, x)
    lever = lever[:, 0] - lever[:, 1]
    along = contacts.gap[:, None] * contacts.normal
    assert lever == pytest.approx(along, abs=1e-13)
    assert np.linalg.norm(contacts.normal, axis=1) == pytest.approx(1.0, abs=1e-13)


def test_keys_are_sorted_and_unique():
    surface, x = convex_bodies(3, np.random.default_rng(5), 14, 4.0)
    key = SurfaceSearch(surface, x, 0.3, depth=0.5).find(x).key
    order = np.lexsort(key.T[::-1])
    assert (order == np.arange(len(key))).all()
    assert len(np.unique(key, axis=0)) == len(key)


@pytest.mark.parametrize("overlap", [1e-9, 1e-3])
def test_areas_of_pressed_boxes_are_the_overlap(overlap):
    below, above = rectangle((0, 0), (1, 1), (3, 2, 4, 2)), rectangle((0, 1), (1, 2), (7, 2, 3, 2))
    surface, x = assemble(below, above)
    x[len(below[0]) :, 1] -= overlap
    contacts = SurfaceSearch(surface, x, 0.01).find(x)
    assert contacts.area.sum() == pytest.approx(1.0, abs=1e-12)
    assert contacts.gap == pytest.approx(-overlap, abs=1e-15)
    assert np.abs(contacts.normal[:, 1]) == pytest.approx(1.0, abs=1e-15)
    assert len(contacts) == 5 + 8

    below, above = block((0, 0, 0), (1, 1, 1), (2, 3, 1)), block((0, 0, 1), (1, 1, 2), (4, 2, 1))
    surface, x = assemble(below, above)
    x[len(below[0]) :, 2] -= overlap
    contacts = SurfaceSearch(surface, x, 0.01).find(x)
    assert contacts.area.sum() == pytest.approx(1.0, abs=1e-12)
    assert contacts.gap == pytest.approx(-overlap, abs=1e-15)
    assert len(contacts) == 12 + 15


@pytest.mark.slow
def test_a_gap_slides_across_facets_without_jumps():
    """A small diamond over hills, a plain and a bend: its lowest node's gap is the distance."""
    hills = [(0.0, 0.0), (1.0, 0.2), (1.6, 0.3), (2.2, 0.3), (3.0, 0.2), (4.0, 0.25), (5.0, 0.2)]
    ground = loop([(0, -2), (5, -2), *hills[::-1]])
    probe = np.array([(0, 0), (0.05, 0.08), (0, 0.16), (-0.05, 0.08)])
    surface, x = assemble(ground, loop(probe))
    tip = len(ground[0])
    search = SurfaceSearch(surface, x, 0.1)
    places = np.linspace(0.1, 4.9, 801)
    height = np.interp(places, *np.array(hills).T) + 0.03
    gaps, distances, keys = [], [], set()
    for place in zip(places, height, strict=True):
        x[tip:] = probe + place
        contacts = search.find(x)
        mine = contacts.nodes[:, 0, 0] == tip
        gaps.append(contacts.gap[mine].min())
        keys |= {tuple(k) for k in contacts.key[mine]}
        distances.append(
            min(np.linalg.norm(place - on_segment(np.array(place), *x[edge])) for edge in ground[1])
        )
    assert gaps == pytest.approx(distances, abs=1e-12)
    assert np.abs(np.diff(gaps)).max() <= np.hypot(*np.diff([places, height]).max(axis=1))
    assert len(keys) == 1  # nearly plane bends: never two at once
    assert search.lists.renewals < 801 / 4


L_SHAPE = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]


@pytest.mark.parametrize("dx, dy", [(4e-3, 2e-3), (4e-3, -2e-3), (-4e-3, 2e-3), (-4e-3, -3e-3)])
def test_both_walls_of_a_pocket_touch_a_corner(dx, dy):
    """Apart from both walls, in one of them, in both: the gaps are those of the two planes."""
    notched = loop(L_SHAPE)
    surface, x = assemble(notched, rectangle((1 + dx, 1 + dy), (1.3, 1.3)))
    contacts = SurfaceSearch(surface, x, 0.01).find(x)
    mine = contacts.take(np.flatnonzero(contacts.nodes[:, 0, 0] == len(notched[0])))
    across = np.argmax(mine.normal[:, 1])
    assert len(mine) == 2
    assert mine.gap[across] == pytest.approx(dy, abs=1e-14)
    assert mine.gap[1 - across] == pytest.approx(dx, abs=1e-14)
    assert mine.normal[across] == pytest.approx([0, 1], abs=1e-14)
    assert mine.normal[1 - across] == pytest.approx([1, 0], abs=1e-14)
    lever = sides(mine, x)
    assert lever[:, 0] - lever[:, 1] == pytest.approx(mine.gap[:, None] * mine.normal, abs=1e-14)


@pytest.mark.parametrize("degrees", [1.0, 5.0, 15.0])
@pytest.mark.parametrize("height", [5e-3, 0.0, -5e-3])
def test_both_sides_of_a_mild_hollow_hold_a_node(degrees, height):
    """A node over, at and behind the bottom of a hollow: the gaps are those of the two planes."""
    slope = np.tan(np.radians(0.5 * degrees))
    ground = loop([(0, -1), (2, -1), (2, slope), (1, 0), (0, slope)])
    probe = loop([(1, height), (1.2, 0.5), (0.8, 0.5)])
    surface, x = assemble(ground, probe)
    contacts = SurfaceSearch(surface, x, 0.01, hollows=True).find(x)
    mine = contacts.take(np.flatnonzero(contacts.nodes[:, 0, 0] == len(ground[0])))
    assert len(mine) == 2
    assert mine.gap == pytest.approx(height * np.cos(np.arctan(slope)), abs=1e-14)
    assert sorted(np.degrees(np.arctan2(*mine.normal.T))) == pytest.approx(
        [-0.5 * degrees, 0.5 * degrees], abs=1e-9
    )


@pytest.mark.parametrize("side", [-1, 1])
def test_of_nearly_one_plane_the_nearer_side_holds_a_node(side):
    """A hollow of 0.4 degrees, over whose bottom a node is a little to one side."""
    slope = np.tan(np.radians(0.2))
    ground = loop([(0, -1), (2, -1), (2, slope), (1, 0), (0, slope)])
    place = 1 + side * 1e-5, 5e-3
    surface, x = assemble(ground, loop([place, (1.2, 0.5), (0.8, 0.5)]))
    contacts = SurfaceSearch(surface, x, 0.01, hollows=True).find(x)
    mine = contacts.take(np.flatnonzero(contacts.nodes[:, 0, 0] == len(ground[0])))
    assert len(mine) == 1 and np.sign(mine.normal[0, 0]) == -side


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.integers(-59, 11), st.integers(-59, 11))
def test_walls_of_a_pocket_go_on_behind_each_other_by_their_own_depths(right, up):
    """A floor sought to 0.05 m and a side of half a metre, sought to 0.02 m: who touches a corner.

    Behind the other wall by at most its own depth and that of the other, and not deeper behind
    itself than that.
    """
    reach, floor, side = 0.01, 0.05, 0.02
    dx, dy = 1e-3 * (right + 0.5), 1e-3 * (up + 0.5)
    notched = loop([(0, 0), (2, 0), (2, 1), (1, 1), (1, 1.4), (0, 1.4)])
    surface, x = assemble(notched, rectangle((1 + dx, 1 + dy), (1.3, 1.3)))
    search = SurfaceSearch(surface, x, reach, depth=0.05)
    assert search.depth[2] == pytest.approx(floor) and search.depth[3] == pytest.approx(side)
    contacts = search.find(x)
    mine = contacts.take(np.flatnonzero(contacts.nodes[:, 0, 0] == len(notched[0])))
    found = {
        int(np.argmax(n)): g
        for n, g in zip(mine.normal, mine.gap, strict=True)
        if n.max() > 1.0 - 1e-9  # else it is the corner itself
    }

    def touches(height, own, behind, others):
        """Height over a wall, and by how much over the other one."""
        if not -own <= height <= reach:
            return False
        if behind >= 0.0:
            return True
        return -behind <= min(own, others) and -height <= others

    expected = {}
    if touches(dx, side, dy, floor):
        expected[0] = dx
    if touches(dy, floor, dx, side):
        expected[1] = dy
    assert found == pytest.approx(expected, abs=1e-13)


def test_a_corner_is_told_from_outside_by_the_angles_of_its_facets():
    """An apex, one of whose four sides is cut into many slivers: these count as one."""
    slivers, height = 40, 3.0
    rim = [(1.0, -1.0), (1.0, 1.0)] + [(-1.0, y) for y in np.linspace(1.0, -1.0, slivers + 1)]
    base = np.column_stack([np.array(rim), np.full(len(rim), -height)])
    points = np.concatenate([np.zeros((1, 3)), base])
    around = 1 + np.arange(len(rim))
    sides = [(0, a, b) for a, b in zip(around, np.roll(around, -1), strict=True)]
    floor = [(1, b, a) for a, b in zip(around[1:-1], around[2:], strict=True)]
    pyramid = points, np.array(sides + floor)
    steep = np.array([height, 0.0, 1.0]) / np.hypot(height, 1.0)  # normal of the side at x = 1
    assert outward_normals(*pyramid)[0] == pytest.approx(steep)
    n = 0.9 * steep + 0.1 * np.array([0.0, 0.0, 1.0])
    n /= np.linalg.norm(n)
    across = np.array([[0.0, 1.0, 0.0], np.cross(n, [0.0, 1.0, 0.0])])
    tip, distance = 0.02 * n, 0.02
    probe = tip + np.array([0.0 * n, n + across[0], n - across[0] + across[1], n - across.sum(0)])
    surface, x = assemble(pyramid, hull(probe))
    tip_node = int(np.linalg.norm(x - tip, axis=1).argmin())
    contacts = SurfaceSearch(surface, x, 0.05).find(x)
    mine = contacts.take(np.flatnonzero(contacts.nodes[:, 0, 0] == tip_node))
    assert len(mine) == 1
    assert mine.gap[0] == pytest.approx(distance, rel=1e-9)
    assert mine.normal[0] == pytest.approx(n, abs=1e-9)


def roof(size, height, along):
    """A body below a ridge at a height, along x (0) or y (1); upside down where size is < 0."""
    ridge = [(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    corners = np.array(ridge + [(i, j, -1.0) for i in (-1.0, 1.0) for j in (-1.0, 1.0)])
    corners[:, 2] *= np.sign(size)
    if along == 1:
        corners = corners[:, [1, 0, 2]]
    return hull(abs(size) * corners + [0.0, 0.0, height])


@pytest.mark.parametrize("gap", [0.02, 1e-6, -1e-6, -0.03])
@pytest.mark.parametrize("size", [1.0, 0.4])
def test_ridges_that_cross_touch_in_one_point_apart_or_not(gap, size):
    """Their area is that of the smaller body, their normal leads from one to the other."""
    surface, x = assemble(roof(1.0, 0.0, 0), roof(-size, gap, 1))
    contacts = SurfaceSearch(surface, x, 0.05).find(x)
    crossed = contacts.take(np.flatnonzero(kind(contacts) == EDGE_EDGE))
    assert len(crossed) == 1
    assert crossed.gap[0] == pytest.approx(gap, abs=1e-12)
    assert np.abs(crossed.normal[0]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    lever = sides(crossed, x)[0]
    assert lever[0] - lever[1] == pytest.approx(gap * crossed.normal[0], abs=1e-12)
    slope = np.sqrt(2.0) * size**2  # area of half of a roof's plane, which hull cuts in two
    assert crossed.area[0] == pytest.approx(slope / 3.0, rel=1e-12)


def test_spin_of_surfaces_about_the_normal():
    """Facets and edges that turn as one spin by omega . n, however they move on; nodes do not."""
    size, gap = 0.7, 0.01
    surface, x = assemble(
        roof(1.0, 0.0, 0), roof(-size, gap, 1), block((3, 0, 0), (4, 1, 1), (1, 1, 1)),
        block((3.2, 0.2, 1.01), (3.7, 0.7, 2), (1, 1, 1)),
    )  # fmt: skip
    contacts = SurfaceSearch(surface, x, 0.05).find(x)
    assert set(kind(contacts)) == {NODE_FACET, EDGE_EDGE}
    omega = np.array([0.3, -0.4, 1.1])
    v = np.cross(omega, x - 0.2) + np.array([1.0, 2.0, -0.5])
    spin = np.einsum("pskd,pskd->ps", spin_arms(contacts, x), v[contacts.nodes])
    expected = np.repeat((contacts.normal @ omega)[:, None], 2, axis=1)
    expected[kind(contacts) == NODE_FACET, 0] = 0.0
    assert np.abs(spin - expected).max() < 1e-12


def test_edges_of_a_hollow_are_not_convex():
    """Of a notched prism the reflex edge is left out, and so are the diagonals of its sides."""
    outline = np.array(L_SHAPE, float)
    count = len(outline)
    x = np.concatenate([np.column_stack([outline, np.full(count, z)]) for z in (0.0, 1.0)])
    caps = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    i = np.arange(count)
    j = np.roll(i, -1)
    walls = np.concatenate([np.stack([i, j, j + count], 1), np.stack([i, j + count, i + count], 1)])
    facets = np.concatenate([caps[:, ::-1], caps + count, walls])
    normal = outward_normals(x, facets)
    pairs = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=2), axis=2)
    edges, others = surface_edges(facets, np.arange(len(facets)), pairs @ [len(x), 1])
    bent = edge_bends(x, facets, edges, others, normal) < -BENT
    edges, others = edges[bent], others[bent]
    ends = np.sort(np.stack([facets[edges // 3, edges % 3], facets[edges // 3, (edges + 1) % 3]]).T)
    found = {tuple(e) for e in ends.tolist()}
    outer = {tuple(sorted((a + z, b + z))) for a, b in zip(i, j, strict=True) for z in (0, count)}
    upright = {(a, a + count) for a in i if a != 3}  # 3 is the reflex corner
    assert len(edges) == len(found)
    assert found == {tuple(map(int, e)) for e in outer | upright}
    for own, other in zip(edges // 3, others, strict=True):
        assert np.dot(normal[own], normal[other]) == pytest.approx(0.0, abs=1e-12)


def test_convex_corners_touch_once_a_side():
    surface, x = assemble(rectangle((0, 0), (1, 1)), rectangle((1.003, 1.004), (2, 2)))
    contacts = SurfaceSearch(surface, x, 0.02).find(x)
    assert contacts.gap == pytest.approx([5e-3, 5e-3], abs=1e-14)
    assert contacts.normal == pytest.approx(np.array([[-0.6, -0.8], [0.6, 0.8]]), abs=1e-11)
    # pressed together they part the short way
    x[4:] += np.array([-0.013, -0.034])
    contacts = SurfaceSearch(surface, x, 0.02).find(x)
    assert contacts.gap == pytest.approx([-0.01, -0.01], abs=1e-14)
    assert np.abs(contacts.normal[:, 0]) == pytest.approx([1.0, 1.0])


def test_thin_plates_are_touched_from_their_own_side_alone():
    """A plate of two facets, as thin as the reach: nothing from behind, nor with itself."""
    plate = rectangle((-2, -0.01), (3, 0), 4)
    surface, x = assemble(plate, rectangle((0, 0.002), (1, 1), 2))
    thickness = np.where(surface.body == 0, 0.01, 1.0)
    surface = type(surface)(surface.facets, surface.body, surface.num_nodes, thickness=thickness)
    contacts = SurfaceSearch(surface, x, 0.02).find(x)
    assert contacts.gap == pytest.approx(0.002, abs=1e-14)
    assert len(contacts) == 4  # three nodes of the block, one of the plate
    x[len(plate[0]) :, 1] -= 0.004
    contacts = SurfaceSearch(surface, x, 0.02).find(x)
    assert contacts.gap == pytest.approx(-0.002, abs=1e-14)
    assert len(contacts) == 4


def test_a_body_folds_onto_itself():
    """A horseshoe whose tips meet; with self_contact off they do not."""
    mouth = 0.004
    shape = [(0, 0), (3, 0), (3, 3), (1.5 + mouth, 3), (1.5 + mouth, 2), (2, 2), (2, 1), (1, 1)]
    shape += [(1, 2), (1.5, 2), (1.5, 3), (0, 3)]
    surface, x = assemble(loop(shape, 3))
    contacts = SurfaceSearch(surface, x, 0.01).find(x)
    assert contacts.gap == pytest.approx(mouth, abs=1e-14)
    assert contacts.area.sum() == pytest.approx(1.0, abs=1e-12)
    assert np.abs(contacts.normal[:, 0]) == pytest.approx(1.0)
    assert len(SurfaceSearch(surface, x, 0.01, self_contact=False).find(x)) == 0


@pytest.mark.parametrize("dim", [2, 3])
def test_lists_lose_nothing(dim):
    """Bodies that fly about: lists in use find what fresh ones do, and last a while."""
    rng = np.random.default_rng(20 + dim)
    surface, x = convex_bodies(dim, rng, 12, 5.0 if dim == 2 else 3.5)
    velocity = rng.normal(size=(12, dim))
    body_of = np.empty(surface.num_nodes, int)
    body_of[surface.facets] = surface.body[:, None]
    search = SurfaceSearch(surface, x, 0.1, depth=0.05)
    for _ in range(60):
        x += 6e-3 * velocity[body_of] + 1e-3 * rng.normal(size=x.shape) + 0.05
        mine, fresh = search.find(x), SurfaceSearch(surface, x, 0.1, depth=0.05)
        fresh.depth, fresh.extent, fresh._share = search.depth, search.extent, search._share
        fresh = fresh.find(x)
        assert (mine.key == fresh.key).all()
        assert mine.gap == pytest.approx(fresh.gap, abs=1e-12)
    assert 2 <= search.lists.renewals <= 30


def test_groups_that_may_not_touch_do_not():
    parts = rectangle((0, 0), (1, 1)), rectangle((0, 1.001), (1, 2)), rectangle((1.001, 0), (2, 1))
    surface, x = assemble(*parts, names=("a", "b", "c"))
    found = SurfaceSearch(surface, x, 0.01, pairs=[("b", "a")]).find(x)
    assert np.abs(found.normal[:, 1]) == pytest.approx(1.0)
    assert found.area.sum() == pytest.approx(1.0)
    with pytest.raises(ValueError, match="'d'"):
        SurfaceSearch(surface, x, 0.01, pairs=[("d", "a")])


def test_bad_input():
    surface, x = assemble(rectangle((0, 0), (1, 1)))
    with pytest.raises(ValueError, match="reach"):
        SurfaceSearch(surface, x, 0.0)
    with pytest.raises(ValueError, match="shape"):
        SurfaceSearch(surface, x, 0.1).find(x[:3])
    with pytest.raises(ValueError, match="finite"):
        SurfaceSearch(surface, x, 0.1).find(np.full_like(x, np.nan))
