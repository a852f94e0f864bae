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
    spread = 0.4 * np.cbrt(count) if clustered else 0.6 * np.cbrt(count)
    position = rng.uniform(-spread, spread, (count, 3))
    if "wall" in kinds:
        shapes[3], shapes[7] = HalfSpace(), HalfSpace()
        position[[3, 7]] = [[0.0, -0.7 * spread, 0.0], [0.7 * spread, 0.0, 0.0]]
    return shapes, position, list(Rotation.random(count, random_state=rng.integers(1000)))


@pytest.mark.parametrize("kinds", [["sphere"], ["polyhedron"], ["sphere", "polyhedron"],
                                   ["sphere", "wall"], ["polyhedron", "wall"]])  # fmt: skip
@pytest.mark.parametrize("clustered", [False, True])
@pytest.mark.parametrize("decades", [0.3, 3.0])
@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_contacts_are_those_of_brute_force(kinds, clustered, decades, offset):
    rng = np.random.default_rng(int(10 * decades) + clustered)
    shapes, position, rotation = random_scene(rng, kinds, 60, decades, clustered)
    bodies = make(shapes, position + offset, rotation)
    search = RigidSearch(bodies, [("a", "a")], reach=0.1)
    tolerance = 1e-12 * (10.0 + 10.0 * offset)
    contacts = search.find(bodies.position, bodies.rotation)
    touching = check(bodies, contacts, bodies.position, bodies.rotation, 0.1, tolerance)
    assert touching > 3
