# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies as flat arrays, and the bad input that is refused with the body's number."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid import (
    Disc,
    HalfPlane,
    Polygon,
    Polyhedron,
    RigidBodies,
    RigidBody,
    Sphere,
    wall,
)
from xper_fx.nscd.rigid.shapes import DISC, HALF_PLANE, POLYGON

DISC_BODY = RigidBody(Disc(1.0), (0, 0), "grains", density=1.0)


def test_position_is_of_the_centroid_and_shapes_are_shared():
    triangle = Polygon([[10, 10], [13, 10], [10, 13]])
    bodies = RigidBodies(
        [
            RigidBody(triangle, (1, 2), "bricks", density=2.0, angle=0.5),
            RigidBody(Disc(0.5), (5, 5), "grains", mass=3.0),
            RigidBody(triangle, None, "bricks", mass=9.0, inertia=4.0, velocity=(1, -1), spin=2.0),
            wall((0, 0), (0, 1), "floor"),
        ]
    )
    assert bodies.groups == ("bricks", "grains", "floor")
    assert bodies.group_of.tolist() == [0, 1, 0, 2]
    tables = bodies.shapes
    assert tables.kind.tolist() == [POLYGON, DISC, POLYGON, HALF_PLANE]
    assert tables.entry.tolist() == [0, -1, 0, -1]
    assert tables.radius.tolist() == [0.0, 0.5, 0.0, 0.0]
    assert np.allclose(tables.vertices, [[-1, -1], [2, -1], [-1, 2]])
    assert tables.vertex_offsets.tolist() == [0, 3]
    assert tables.loops.tolist() == [0, 1, 1, 2, 2, 0]
    assert np.allclose(tables.face_distance, [1.0, 0.5**0.5, 1.0])
    assert np.allclose(bodies.position, [[1, 2], [5, 5], [11, 11], [0, 0]])
    assert bodies.mass == pytest.approx([9.0, 3.0, 9.0, 0.0])
    assert bodies.inertia == pytest.approx([9.0 * 36.0 / 36.0, 0.375, 4.0, 0.0])
    assert bodies.spin.tolist() == [0.0, 0.0, 2.0, 0.0]
    assert bodies.is_prescribed.tolist() == [[False] * 3] * 3 + [[True] * 3]


def test_tables_of_polyhedra_describe_each_in_its_own_numbers():
    box, prism = Polyhedron.box((1, 2, 3)), Polyhedron.hull(np.eye(4)[:, :3])
    bodies = RigidBodies(
        [RigidBody(s, (k, 0, 0), "a", density=1.0) for k, s in enumerate((box, prism, box))]
    )
    t = bodies.shapes
    assert t.entry.tolist() == [0, 1, 0]
    assert (len(t.vertices), len(t.edges), len(t.face_normal)) == (12, 18, 10)
    for entry in range(2):
        x = t.vertices[t.vertex_offsets[entry] : t.vertex_offsets[entry + 1]]
        for f in range(t.face_offsets[entry], t.face_offsets[entry + 1]):
            height = x @ t.face_normal[f] - t.face_distance[f]
            on = t.loops[t.loop_offsets[f] : t.loop_offsets[f + 1]]
            assert np.allclose(height[on], 0.0, atol=1e-14)
            assert np.all(np.delete(height, on) < -0.1)
            for a, b in zip(on, np.roll(on, -1), strict=True):
                first = t.edge_offsets[entry]
                edges = t.edges[first : t.edge_offsets[entry + 1]].tolist()
                side = first + edges.index(sorted([a, b]))
                assert t.edge_faces[side, 0 if a < b else 1] == f - t.face_offsets[entry]


def test_walls_turn_their_normal_outward():
    rng = np.random.default_rng(0)
    normals = [(0, 0, 1), (0, 0, -3), *rng.normal(size=(20, 3))]
    bodies = RigidBodies([wall((1, 2, 3), n, "w", velocity=(0, 0, 2.0)) for n in normals])
    units = np.array(normals) / np.linalg.norm(normals, axis=1)[:, None]
    assert np.allclose(bodies.rotation[:, :, 2], units, atol=1e-15)
    assert np.allclose(np.linalg.det(bodies.rotation), 1.0)
    assert np.all(bodies.velocity == [0, 0, 2.0])
    bodies = RigidBodies([wall((1, 2), n[:2], "w") for n in normals[2:]])
    normal = np.column_stack([-np.sin(bodies.rotation), np.cos(bodies.rotation)])
    units = np.array(normals)[2:, :2]
    assert np.allclose(normal, units / np.linalg.norm(units, axis=1)[:, None], atol=1e-15)


def test_rotations_come_as_quaternions_or_scipy_ones():
    turn = Rotation.from_rotvec([0.1, 0.2, -0.7])
    bodies = RigidBodies(
        [
            RigidBody(Sphere(1.0), (0, 0, 0), "a", density=1.0, rotation=r)
            for r in (turn, 3.0 * turn.as_quat(), None)
        ]
    )
    assert np.allclose(bodies.rotation[0], turn.as_matrix(), atol=1e-15)
    assert np.allclose(bodies.rotation[1], turn.as_matrix(), atol=1e-15)
    assert np.array_equal(bodies.rotation[2], np.eye(3))


def test_prescribed_values_at_time_0_come_before_given_ones():
    body = RigidBody(
        Disc(1.0),
        (0, 0),
        "a",
        density=1.0,
        velocity=(7, 8),
        spin=9.0,
        prescribed={0: lambda t: 3.0 + t, 2: -1.0},
    )
    bodies = RigidBodies([body])
    assert bodies.velocity.tolist() == [[3.0, 8.0]]
    assert bodies.spin.tolist() == [-1.0]


def test_a_fully_prescribed_body_needs_no_mass():
    bodies = RigidBodies([RigidBody(Disc(1.0), (0, 0), "a", prescribed=dict.fromkeys(range(3), 0))])
    assert bodies.mass.tolist() == [0.0]


def _body(**changes):
    shape = changes.pop("shape", Disc(1.0))
    position = changes.pop("position", (0.0,) * shape.dim)
    return RigidBody(shape, position, changes.pop("group", "a"), **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "needs a density"),
        ({"prescribed": {0: 1.0}}, "needs a density"),
        ({"mass": 0.0}, "mass .* positive number, got 0"),
        ({"mass": -2.0}, "mass .* positive"),
        ({"mass": np.inf}, "mass .* finite"),
        ({"density": np.nan}, "density .* finite"),
        ({"density": 0.0}, "density .* positive"),
        ({"density": 1.0, "mass": 1.0}, "not both"),
        ({"density": 1.0, "inertia": 1.0}, "inertia goes with a mass"),
        ({"mass": 1.0, "inertia": -1.0}, "inertia in 2D"),
        ({"density": 1.0, "group": ""}, "name of a group"),
        ({"density": 1.0, "group": None}, "name of a group"),
        ({"density": 1.0, "position": (0, np.nan)}, "position .* not finite"),
        ({"density": 1.0, "position": (0, 0, 0)}, "position .* shape"),
        ({"density": 1.0, "position": None}, "needs a position"),
        ({"density": 1.0, "velocity": (1,)}, "velocity .* shape"),
        ({"density": 1.0, "velocity": (np.inf, 0)}, "velocity .* not finite"),
        ({"density": 1.0, "spin": (0, 0, 1)}, "spin .* shape"),
        ({"density": 1.0, "angle": np.nan}, "angle .* not finite"),
        ({"density": 1.0, "rotation": (0, 0, 0, 1)}, "takes an angle"),
        ({"density": 1.0, "prescribed": {3: 0.0}}, "0 .. 2, got 3"),
        ({"density": 1.0, "prescribed": {"x": 0.0}}, "0 .. 2, got 'x'"),
        ({"density": 1.0, "prescribed": {0: lambda t: np.nan}}, "component 0 at t = 0"),
        ({"density": 1.0, "force": (1, 2, 3)}, "force .* shape"),
        ({"density": 1.0, "force": lambda t: (1, 2, 3)}, "force .* shape"),
        ({"density": 1.0, "torque": np.nan}, "torque .* not finite"),
        ({"density": 1.0, "torque": "big"}, "torque .* shape"),
        ({"shape": HalfPlane(), "density": 1.0}, "no mass"),
        ({"shape": Sphere(1.0), "density": 1.0, "angle": 0.5}, "takes a rotation"),
        ({"shape": Sphere(1.0), "density": 1.0, "rotation": np.zeros(4)}, "must not vanish"),
        ({"shape": Sphere(1.0), "mass": 1.0, "inertia": np.diag([1, 1, 3])}, "principal moments"),
        ({"shape": Sphere(1.0), "mass": 1.0, "inertia": np.triu(np.ones((3, 3)))}, "symmetric"),
    ],
)
def test_bad_bodies_are_refused_by_number(changes, message):
    with pytest.raises(ValueError, match=f"Rigid body 1: .*{message}"):
        RigidBodies([DISC_BODY, _body(**changes)])


def test_lists_that_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        RigidBodies([])
    with pytest.raises(ValueError, match="Rigid body 1 is of dimension 3, body 0 of dimension 2"):
        RigidBodies([DISC_BODY, RigidBody(Sphere(1.0), (0, 0, 0), "a", density=1.0)])
    with pytest.raises(TypeError, match="Rigid body 1: Expected a RigidBody, got Disc"):
        RigidBodies([DISC_BODY, Disc(1.0)])


@pytest.mark.parametrize(
    ("point", "normal", "message"),
    [
        ((0, 0), (0, 0), "no normal"),
        ((0, 0, 0), (0, 0, 0), "no normal"),
        ((0, 0), (0, 0, 1), "normal of a wall must be of shape"),
        ((0, 0), (np.nan, 1), "not finite"),
        ((0,), (1,), "2 or 3 coordinates"),
    ],
)
def test_bad_walls_are_refused(point, normal, message):
    with pytest.raises(ValueError, match=message):
        wall(point, normal, "floor")
