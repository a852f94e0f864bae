# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outlines of rigid bodies enclose what they should, where they should."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid import (
    Disc,
    Polygon,
    Polyhedron,
    RigidBodies,
    RigidBody,
    Sphere,
    wall,
)
from xper_fx.nscd.rigid.outline import body_outlines


def enclosed(points, cells):
    """Area (2D) or volume (3D) and centroid from outward triangles."""
    a, b, c = (points[cells[:, k]] for k in range(3))
    if points.shape[1] == 2:
        u, v = b - a, c - a
        part, middle = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]), (a + b + c) / 3.0
    else:
        part, middle = np.sum(a * np.cross(b, c), axis=1) / 6.0, (a + b + c) / 4.0
    return part.sum(), part @ middle / part.sum()


@pytest.mark.parametrize("dim", [2, 3])
def test_outlines_enclose_their_bodies_in_space(dim):
    rng = np.random.default_rng(4)
    if dim == 2:
        cornered = [Polygon([[5, 5], [8, 5], [5, 7]]), Polygon.regular(5, 2.0)]
        round_one, turns = Disc(1.5), [{"angle": a} for a in (0.3, -2.0, 1.0, 0.2)]
    else:
        cornered = [Polyhedron.hull(rng.normal(size=(12, 3)) + 9.0), Polyhedron.box((1, 2, 3))]
        round_one = Sphere(1.5)
        turns = [{"rotation": q} for q in rng.normal(size=(4, 4))]
    shapes = [cornered[0], round_one, cornered[1], cornered[0]]
    bodies = RigidBodies(
        [
            RigidBody(s, rng.normal(size=dim) * 5.0, "a", density=1.0, **turn)
            for s, turn in zip(shapes, turns, strict=True)
        ]
    )
    drawn = body_outlines(bodies, segments=200)
    assert np.all(np.diff(drawn.body_of_point) >= 0) and np.all(np.diff(drawn.body_of_cell) >= 0)
    assert np.array_equal(
        drawn.body_of_point[drawn.cells], drawn.body_of_cell[:, None] + np.zeros(3, int)
    )
    points = drawn.positions(bodies.position, bodies.rotation)
    for i, shape in enumerate(shapes):
        measure, centroid = enclosed(points, drawn.cells[drawn.body_of_cell == i])
        exact = bodies.mass[i]
        rounding = 1e-3 if shape is round_one else 1e-12
        assert measure == pytest.approx(exact, rel=rounding)
        assert measure <= exact * (1.0 + 1e-12)
        assert centroid == pytest.approx(bodies.position[i], abs=1e-11)
    # A vertex by hand: the position plus the turned vertex about the centroid.
    vertex = cornered[0].vertices[0] - cornered[0].unit_properties.centre
    if dim == 2:
        c, s = np.cos(0.3), np.sin(0.3)
        turned = np.array([[c, -s], [s, c]]) @ vertex
    else:
        turned = Rotation.from_quat(turns[0]["rotation"]).apply(vertex)
    assert points[0] == pytest.approx(bodies.position[0] + turned, abs=1e-13)


@pytest.mark.parametrize("segments", [3, 4, 7])
def test_coarse_spheres_are_closed(segments):
    drawn = body_outlines(
        RigidBodies([RigidBody(Sphere(1.0), (0, 0, 0), "a", density=1.0)]), segments
    )
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in drawn.cells for i in range(3)}
    assert len(edges) == 3 * len(drawn.cells)
    assert {e[::-1] for e in edges} == edges
    assert np.linalg.norm(drawn.points, axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_walls_are_slabs_below_their_surface_as_wide_as_the_scene(dim):
    normal, point = np.arange(1.0, dim + 1.0), np.full(dim, 2.0)
    unit = normal / np.linalg.norm(normal)
    grain = RigidBody((Disc if dim == 2 else Sphere)(1.0), point + 9.0 * unit, "a", density=1.0)
    bodies = RigidBodies([wall(point, normal, "floor"), grain])
    drawn = body_outlines(bodies)
    points = drawn.positions(bodies.position, bodies.rotation)[drawn.body_of_point == 0]
    height = (points - point) @ unit
    assert height.max() == pytest.approx(0.0, abs=1e-12)
    assert height.min() == pytest.approx(-0.5)
    assert enclosed(points, drawn.cells[drawn.body_of_cell == 0])[0] == pytest.approx(
        0.5 * 20.0 ** (dim - 1)
    )


@pytest.mark.parametrize("segments", [0, 2, 3.5, np.nan])
def test_too_few_segments_are_refused(segments):
    bodies = RigidBodies([RigidBody(Disc(1.0), (0, 0), "a", density=1.0)])
    with pytest.raises(ValueError, match="segments"):
        body_outlines(bodies, segments)
