# SPDX-License-Identifier: LGPL-3.0-or-later
"""Volumes of bodies and their first and second moments, int dV, int x dV and int x x^T dV."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import basix
import numpy as np

from xper_fx.bodies.meshes import determinants
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.rigid.motion import RigidState
from xper_fx.nscd.rigid.shapes import CLUSTER, DISC, POLYGON, Shape


class Moments(NamedTuple):
    """Moments of some solids, in 2D per metre of depth."""

    volume: np.ndarray  #: shape (n,), m^3 (2D: m^2)
    first: np.ndarray  #: shape (n, dim), m^4 (2D: m^3)
    second: np.ndarray  #: shape (n, dim, dim), m^5 (2D: m^4)


def cell_moments(V, x: np.ndarray) -> Moments:
    """Moments of the cells of a mesh as they are, sides that are curved included; exact.

    Args:
        V: vector Lagrange space.
        x: positions of the nodes of each cell, shape (num_cells, nodes a cell, dim), m.
    """
    element, dim = V.sub(0).element.basix_element, x.shape[2]
    degree, simplex = element.degree, V.mesh.topology.cell_name() in ("triangle", "tetrahedron")
    # of det(dx/dX) x x^T
    needed = dim * (degree - 1) + 2 * degree if simplex else (dim + 2) * degree
    points, weights = basix.make_quadrature(element.cell_type, max(needed, 1))
    tables = element.tabulate(1, points)[..., 0]
    moments = Moments(np.zeros(len(x)), np.zeros_like(x[:, 0]), np.zeros((len(x), dim, dim)))
    for q, weight in enumerate(weights):
        place = tables[0, q] @ x
        size = weight * np.abs(determinants(tables[1:, q] @ x))
        moments.volume[:] += size
        moments.first[:] += size[:, None] * place
        moments.second[:] += size[:, None, None] * place[:, :, None] * place[:, None]
    return moments


def rigid_moments(bodies: RigidBodies, shapes: list, state: RigidState) -> Moments:
    """Moments of rigid bodies where they are.

    Args:
        bodies: the bodies.
        shapes: of those whose moments are wanted, None for the others, which get zeros.
        state: of all bodies.
    """
    dim = bodies.dim
    volume, own = np.zeros(len(shapes)), np.zeros((len(shapes), dim, dim))
    for i, shape in enumerate(shapes):
        if shape is not None:
            volume[i], own[i] = _about_centre(shape)
    rotation = state.turn.rotation
    if dim == 2:
        c, s = np.cos(rotation), np.sin(rotation)
        rotation = np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)
    own = rotation @ own @ rotation.transpose(0, 2, 1)
    x = state.position
    shifted = volume[:, None, None] * x[:, :, None] * x[:, None]
    return Moments(volume, volume[:, None] * x, own + shifted)


def equal_diameters(shapes: Sequence[Shape]) -> np.ndarray:
    """Diameters of the discs or balls as large as some shapes, NaN for walls; m."""
    volume = np.array(
        [s.mass_properties(1.0).mass if np.isfinite(s.bounding_radius) else np.nan for s in shapes]
    )
    return 2.0 * np.sqrt(volume / np.pi) if shapes[0].dim == 2 else np.cbrt(6.0 * volume / np.pi)


def _about_centre(shape) -> tuple[float, np.ndarray]:
    """Volume and second moment about the centroid in the axes of the body."""
    unit = shape.mass_properties(1.0)
    if shape.kind == CLUSTER and shape.dim == 2:
        second = np.zeros((2, 2))
        for piece, offset in shape.pieces:
            volume, own = _about_centre(piece)
            second += own + volume * np.outer(offset, offset)
        # parts that overlap count twice in the sum, not in the inertia
        return unit.mass, unit.inertia / np.trace(second) * second
    if shape.kind == DISC:
        return unit.mass, 0.5 * unit.inertia * np.eye(2)
    if shape.kind == POLYGON:
        a = shape.centred_vertices
        b = np.roll(a, -1, axis=0)
        # triangles of the centroid and an edge
        area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        second = sum(np.einsum("e,ei,ej->ij", area, y, y) for y in (a, b, a + b)) / 12.0
        return unit.mass, second
    return unit.mass, 0.5 * np.trace(unit.inertia) * np.eye(3) - unit.inertia
