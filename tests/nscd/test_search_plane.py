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


@pytest.mark.parametrize("kinds", [["disc"], ["polygon"], ["disc", "polygon"], ["disc", "wall"],
                                   ["polygon", "wall"]])  # fmt: skip
@pytest.mark.parametrize("clustered", [False, True])
@pytest.mark.parametrize("decades", [0.3, 3.0])
@pytest.mark.parametrize("offset", [0.0, 1e5])
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
    assert touching > 10
