# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where kernels put the contacts that they find, and the corners of bodies as they stand.

A kernel of a narrow phase counts all the contacts it finds and writes those for which there is
room: if there was too little, it is called once more with enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.kernel_options import MERGED
from xper_fx.nscd.search.contact_pairs import Contacts, in_order

# Area of a contact of corners, which have none, as a share of the smaller bounding radius (in 3D,
# of its square): an area stays positive.
POINT_AREA = 1e-6
# Two lengths closer than this, relative to the size of the pair, are taken as equal.
ROUNDING = 1e-13
# Corners of two bodies closer than this, relative to the smaller bounding radius, have one name.
SAME_CORNER = 1e-6


class Found(NamedTuple):
    """Room for contacts of rigid bodies; the arrays of `Contacts` that rigid bodies need."""

    body: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    area: np.ndarray
    key: np.ndarray


class Corners(NamedTuple):
    """Corners of polygons and polyhedra, turned as the bodies stand, about their centres.

    Body b has vertices `vertex_start[b]:vertex_start[b + 1]` and faces
    `face_start[b]:face_start[b + 1]`, none if it has no corners.
    """

    vertex_start: np.ndarray  #: shape (num_bodies + 1,), int64
    face_start: np.ndarray  #: shape (num_bodies + 1,), int64
    vertex: np.ndarray  #: shape (num_vertices, dim), m
    normal: np.ndarray  #: shape (num_faces, dim), outward unit normals


def collect(jobs: Sequence[tuple], dim: int, expected: int) -> Contacts:
    """Run kernels and give their contacts, sorted by key.

    Args:
        jobs: a kernel and its arguments each; called with `Found` and these, it returns how many
            contacts there are.
        expected: room at first, in contacts.
    """
    while True:
        found = Found(
            np.empty((expected, 2), np.int32),
            np.empty((expected, dim)),
            np.empty((expected, dim)),
            np.empty(expected),
            np.empty(expected),
            np.empty((expected, 2), np.int64),
        )
        count = 0
        for kernel, *arguments in jobs:
            count += kernel(Found(*(a[count:] for a in found)), *arguments)
        if count <= expected:
            break
        expected = count
    body, point, normal, gap, area, key = (a[:count] for a in found)
    nodes = np.zeros((count, 2, 1), np.int32)
    weights = np.zeros((count, 2, 1))
    return in_order(Contacts(body, nodes, weights, point, normal, gap, area, key))


@njit(**MERGED)
def contact_key(bodies, num_bodies, feature):
    """Key of a contact of two bodies, in whatever order, by the feature that it is known by."""
    i, j = bodies
    return min(i, j) * num_bodies + max(i, j), feature


@njit(**MERGED)
def put_contact(found, count, bodies, key, point, normal, gap, area):
    """Write a contact if there is room, and return the count with it."""
    if count < len(found.gap):
        found.body[count, 0], found.body[count, 1] = bodies
        for d in range(len(point)):
            found.point[count, d] = point[d]
            found.normal[count, d] = normal[d]
        found.gap[count] = gap
        found.area[count] = area
        found.key[count, 0], found.key[count, 1] = key
    return count + 1
