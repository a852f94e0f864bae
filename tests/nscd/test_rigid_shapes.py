# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of rigid bodies: exact mass properties, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid import Disc, HalfPlane, HalfSpace, Polygon, Polyhedron, Sphere

TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TETRAHEDRON_FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]


def sampled_properties(inside, low, high, cells):
    """Mass, centre and second moment about it at density 1, by the midpoint rule."""
    axes = [a + (np.arange(cells) + 0.5) * (b - a) / cells for a, b in zip(low, high, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(low))
    x = x[inside(x)]
    volume = np.prod((np.array(high) - low) / cells)
    centre = x.mean(axis=0)
    return volume * len(x), centre, volume * (x - centre).T @ (x - centre)


def test_disc_and_sphere_have_their_textbook_inertia():
    mass, centre, inertia = Disc(2.0).mass_properties(3.0)
    assert mass == pytest.approx(12.0 * np.pi, rel=1e-15)
    assert inertia == pytest.approx(24.0 * np.pi, rel=1e-15)
    assert np.array_equal(centre, np.zeros(2))
    mass, centre, inertia = Sphere(2.0).mass_properties(3.0)
    assert mass == pytest.approx(32.0 * np.pi, rel=1e-15)
    assert np.allclose(inertia, 0.4 * mass * 4.0 * np.eye(3), rtol=1e-15)
    assert np.array_equal(centre, np.zeros(3))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1e3, -2e3)])
def test_rectangle_and_triangle_are_exact_wherever_drawn(shift):
    mass, centre, inertia = Polygon(Polygon.box((3.0, 2.0)).vertices + shift).mass_properties(5.0)
    assert mass == pytest.approx(30.0, rel=1e-13)
    assert centre == pytest.approx(shift, abs=1e-12)
    assert inertia == pytest.approx(30.0 * (9.0 + 4.0) / 12.0, rel=1e-12)
    # About the centroid of a triangle: m (a^2 + b^2 + c^2) / 36 with the sides a, b, c.
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [1.0, 2.0]])
    mass, centre, inertia = Polygon(corners + shift).mass_properties(2.0)
    assert mass == pytest.approx(6.0, rel=1e-13)
    assert centre == pytest.approx(corners.mean(axis=0) + shift, abs=1e-12)
    assert inertia == pytest.approx(6.0 * (9.0 + 8.0 + 5.0) / 36.0, rel=1e-12)


def test_many_sided_polygon_tends_to_its_disc():
    sides, disc = 1000, Disc(1.5).mass_properties(2.0)
    polygon = Polygon.regular(sides, 1.5).mass_properties(2.0)
    # The area of a regular polygon is (n/2) sin(2 pi/n) r^2.
    assert polygon.mass == pytest.approx(sides * np.sin(2 * np.pi / sides) * 1.5**2, rel=1e-13)
    assert polygon.inertia == pytest.approx(disc.inertia, rel=2e-5)


@pytest.mark.parametrize("turn", [None, [0.3, -1.2, 2.0]])
def test_box_and_tetrahedron_are_exact_turned_and_shifted(turn):
    turn = Rotation.identity() if turn is None else Rotation.from_rotvec(turn)
    q, shift = turn.as_matrix(), np.array([10.0, -20.0, 5.0])
    box = Polyhedron.box((1.0, 2.0, 3.0))
    mass, centre, inertia = Polyhedron(box.vertices @ q.T + shift, box.faces).mass_properties(4.0)
    assert mass == pytest.approx(24.0, rel=1e-13)
    assert centre == pytest.approx(shift, abs=1e-13)
    expected = 24.0 / 12.0 * np.diag([4.0 + 9.0, 1.0 + 9.0, 1.0 + 4.0])
    assert inertia == pytest.approx(q @ expected @ q.T, abs=1e-11)
    # The corner of a cube: products of inertia int xy = -1/120 about its corner, by hand.
    solid = Polyhedron(TETRAHEDRON @ q.T + shift, TETRAHEDRON_FACES)
    mass, centre, inertia = solid.mass_properties(6.0)
    assert mass == pytest.approx(1.0, rel=1e-13)
    assert centre == pytest.approx(q @ [0.25, 0.25, 0.25] + shift, abs=1e-13)
    second = 6.0 * (np.eye(3) / 60.0 + (1 - np.eye(3)) / 120.0) - np.full((3, 3), 1.0 / 16.0)
    expected = np.trace(second) * np.eye(3) - second
    assert inertia == pytest.approx(q @ expected @ q.T, abs=1e-12)


def test_hull_agrees_with_sampling():
    rng = np.random.default_rng(3)
    hull = Polyhedron.hull(rng.normal(size=(20, 3)) + 7.0)
    low, high = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
    corner = np.array([hull.vertices[face[0]] for face in hull.faces])
    height = np.sum(corner * hull.face_normals, axis=1)
    mass, centre, second = sampled_properties(
        lambda x: (x @ hull.face_normals.T <= height).all(axis=1), low, high, 100
    )
    exact = hull.mass_properties(1.0)
    assert exact.mass == pytest.approx(mass, rel=2e-3)
    assert exact.centre == pytest.approx(centre, abs=2e-3)
    assert exact.inertia == pytest.approx(np.trace(second) * np.eye(3) - second, abs=1e-2 * mass)


def test_hull_makes_one_face_of_a_plane_and_drops_points_inside():
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 4)] * 3), -1).reshape(-1, 3)
    cube = Polyhedron.hull(grid)
    assert len(cube.vertices) == 8 and sorted(map(len, cube.faces)) == [4] * 6
    assert len(cube.edges[0]) == 12
    assert cube.mass_properties(1.0).inertia == pytest.approx(np.eye(3) / 6.0, abs=1e-14)


def test_normals_point_outward_and_edges_know_their_faces():
    box = Polyhedron.box((1.0, 2.0, 3.0))
    centres = np.array([box.vertices[list(face)].mean(axis=0) for face in box.faces])
    half = np.array([0.5, 1.0, 1.5])
    assert np.allclose(centres, box.face_normals * half, atol=1e-15)
    for (a, b), (left, right) in zip(*box.edges, strict=True):
        assert {a, b} <= set(box.faces[left]) & set(box.faces[right])
        face = box.faces[left]
        assert face[(face.index(a) + 1) % 4] == b
    square = Polygon.box((2.0, 2.0))
    middles = 0.5 * (square.vertices + np.roll(square.vertices, -1, axis=0))
    assert np.allclose(middles, square.edge_normals, atol=1e-15)


def test_bounding_radius_is_about_the_centroid():
    assert Polygon.box((6.0, 8.0)).bounding_radius == pytest.approx(5.0)
    assert Polyhedron(TETRAHEDRON + 9.0, TETRAHEDRON_FACES).bounding_radius == pytest.approx(
        np.sqrt(0.75**2 + 2 * 0.25**2)
    )
    assert Sphere(2.0).bounding_radius == 2.0
    assert HalfPlane().bounding_radius == HalfSpace().bounding_radius == np.inf


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([[0, 0], [1, 0]], r"n >= 3, got \(2, 2\)"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], r"got \(3, 3\)"),
        ([[0, 0], [1, 0], [0, np.nan]], "Vertex 2 .* not finite"),
        ([[0, 0], [0, 1], [1, 1], [1, 0]], "clockwise"),
        ([[0, 0], [2, 0], [2, 2], [1, 0.5], [0, 2]], "not convex at vertex 3"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], "Vertices 1 and 2 .* coincide"),
        ([[0, 0], [1, 0], [0, 1], [0, 0]], "Vertices 3 and 0 .* coincide"),
        ([[0, 0], [1, 0], [2, 0]], "turns back on itself at vertex 0"),
        ([[0, 2], [1, 0.5], [2, 2], [2, 0], [0, 0]], "clockwise"),
        (np.column_stack([f(4 * np.pi * np.arange(5) / 5) for f in (np.cos, np.sin)]), "once"),
    ],
)
def test_polygons_that_are_refused(vertices, message):
    with pytest.raises(ValueError, match=message):
        Polygon(vertices)


def test_straight_corners_of_a_polygon_are_kept():
    polygon = Polygon([[0, 0], [0.5, 0], [1, 0], [1, 1], [0, 1]])
    assert len(polygon.vertices) == 5
    assert polygon.mass_properties(1.0).inertia == pytest.approx(1.0 / 6.0, rel=1e-14)


def _box_with(faces=None, vertices=None):
    box = Polyhedron.box((1, 1, 1))
    return lambda: Polyhedron(
        box.vertices if vertices is None else vertices(box.vertices.copy()),
        box.faces if faces is None else faces(list(box.faces)),
    )


def _dented(x):
    x[7] = [0.1, 0.1, 0.1]
    return x


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_box_with(lambda f: f[:-1]), r"edge \(\d, \d\) belongs to face \d alone"),
        (_box_with(lambda f: [f[0][::-1], *f[1:]]), "Faces 0 and 2 .* inverted"),
        (_box_with(lambda f: [face[::-1] for face in f]), "are inverted"),
        (_box_with(vertices=_dented), "not plane"),
        (_box_with(lambda f: [(0, 2, 3, 9), *f[1:]]), "names vertices out of 0 .. 7"),
        (_box_with(lambda f: [(0, 2, 2, 1), *f[1:]]), "three or more different"),
        (_box_with(vertices=lambda x: np.vstack([x, [0, 0, 0]])), "Vertex 8 .* in no face"),
        (_box_with(vertices=lambda x: np.where(x > 0.4, np.inf, x)), "not finite"),
        (_box_with(vertices=lambda x: x * [1, 1, 0]), "no area|no volume"),
        (lambda: Polyhedron(TETRAHEDRON[:3], [(0, 1, 2)]), "n >= 4"),
        (lambda: Polyhedron.hull(np.eye(4)[:, :3] * [1, 1, 0]), "one plane"),
        (lambda: Polyhedron.box((1, 0, 1)), "finite positive"),
        (lambda: Sphere(-1.0), "finite positive"),
        (lambda: Disc(np.nan), "finite positive"),
        (lambda: Sphere(1.0).mass_properties(0.0), "density"),
        (lambda: Polygon.box((1, 1)).mass_properties(np.inf), "density"),
    ],
)
def test_solids_that_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_dent_in_triangles_is_not_convex():
    hull = Polyhedron.hull([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    vertices = hull.vertices.copy()
    vertices[0] *= -0.5
    with pytest.raises(ValueError, match="not convex: vertex"):
        Polyhedron(vertices, hull.faces)
