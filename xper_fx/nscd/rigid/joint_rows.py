# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of joints: scalar constraints between two rigid bodies, as points of the interaction layer.

A row joins body a, the antagonist, and body b, the candidate. Where the bodies have been moved to,
it has a gap g, a unit normal n and lever arms such that dg/dt = n . (dv at the arms) exactly:

    plane   g = s n . (x_b - x_a) + g0,  n = s R_a d:  x_a, x_b are points of the bodies, d a
            direction of a. Both arms lead to x_b, so that n may turn with a;
    length  g = L - |x_b - x_a|,  n = (x_a - x_b) / |x_b - x_a|:  an impulse r > 0 pulls the ends
            together; each arm leads to its own end;
    turn    2D: g = s (angle_b - angle_a) + g0 of the two bodies;
    align   3D: g = e . c / |c x e|,  n = c x e / |c x e|:  e is a direction of a, c one of b, at
            right angles where g = 0;
    twist   3D: g = s phi + g0,  n = s R_a d:  phi in (-pi, pi] is the angle of b about the axis d.

The first two act on velocities of points, the others on the spins: such a row has the nodes of the
rotations and no arms, and its impulse is a moment. All forces and moments come in opposite pairs at
one point or along one line: no row changes the momentum or the angular momentum of all bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from xper_fx.cache import njit
from xper_fx.nscd.found_contacts import FoundPoints
from xper_fx.nscd.kernel_options import ENTRY, MERGED
from xper_fx.nscd.laws.law import Law
from xper_fx.nscd.points import InteractionPoints
from xper_fx.nscd.rigid.bodies import RigidBodies, plane_rotations

PLANE, LENGTH, TURN, ALIGN, TWIST = range(5)
# Arms that are as good as none, relative to the smallest body.
_LEAST = 1e-6


class Row(NamedTuple):
    """A row in space as the bodies are placed."""

    kind: int  #: PLANE, LENGTH, TURN, ALIGN or TWIST
    law: Law  #: of its gap
    ends: np.ndarray  #: points of a and b, shape (2, dim), m
    #: two of a and one of b, shape (3, dim), unit: d, e and c. PLANE takes the first, ALIGN the
    #: others, at right angles; TWIST all, e and c the same and at right angles to d.
    directions: np.ndarray
    sign: float = 1.0  #: s
    offset: float = 0.0  #: g0, or L of a length (m, rad)


class Place(NamedTuple):
    """Rows where the bodies have been moved to."""

    gap: np.ndarray  #: shape (n,), m or rad
    normal: np.ndarray  #: shape (n, dim)
    arms: np.ndarray  #: from the centres of b and a, shape (n, 2, dim), m; zero of rows on spins


class JointRows:
    """The rows of all joints.

    Args:
        bodies: as they are placed.
        pairs: bodies a and b of each row, shape (n, 2), int; len(bodies) is the ground, at rest.
        rows: n rows.

    Attributes:
        pairs, kind: of each row.
        on_spins: whether a row's impulse is a moment, shape (n,).
    """

    def __init__(self, bodies: RigidBodies, pairs: np.ndarray, rows: Sequence[Row]):
        self.pairs, self._dim, self._count = pairs, bodies.dim, len(bodies)
        self.kind = np.array([row.kind for row in rows])
        self.on_spins = ~np.isin(self.kind, (PLANE, LENGTH))
        self._sign = np.array([row.sign for row in rows])
        self._offset = np.array([row.offset for row in rows], float)
        centre, axes = self._with_ground(bodies.position, _matrices(bodies.rotation))
        ends = np.array([row.ends for row in rows])
        directions = np.array([row.directions for row in rows])
        # in the axes of the bodies
        self._ends = np.einsum("nsji,nsj->nsi", axes[pairs], ends - centre[pairs])
        self._directions = np.einsum("nsji,nsj->nsi", axes[pairs[:, [0, 0, 1]]], directions)
        size = bodies.shapes.bounding_radius
        self._least = _LEAST * size[np.isfinite(size)].min(initial=np.inf)
        if bodies.dim == 2:
            turns = self.kind == TURN
            self._offset[turns] -= (self._sign * self._turned(bodies.rotation))[turns]

    def __len__(self) -> int:
        return len(self.kind)

    def stay_as(self, rows: JointRows, number: np.ndarray) -> None:
        """Let rows go on as they were placed in another scene.

        Args:
            rows: of that scene.
            number: of each row there, -1 of a new one; shape (n,).
        """
        known = np.flatnonzero(number >= 0)
        for own, other in (
            (self._ends, rows._ends),
            (self._directions, rows._directions),
            (self._offset, rows._offset),
        ):
            own[known] = other[number[known]]

    @property
    def nbytes(self) -> int:
        """Memory held, in bytes."""
        return sum(a.nbytes for a in vars(self).values() if isinstance(a, np.ndarray))

    def _with_ground(self, position: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        none, still = np.zeros((1, self._dim)), np.eye(self._dim)[None]
        return np.concatenate([position, none]), np.concatenate([axes, still])

    def _turned(self, angle: np.ndarray) -> np.ndarray:
        """Angle of b less that of a, in 2D (rad)."""
        angle = np.append(angle, 0.0)
        return angle[self.pairs[:, 1]] - angle[self.pairs[:, 0]]

    def at(self, position: np.ndarray, rotation: np.ndarray) -> Place:
        """Gaps, normals and arms.

        Args:
            position: of the centres of mass, shape (num_bodies, dim), m.
            rotation: angles (2D) or matrices from the bodies to space (3D).
        """
        centre, axes = self._with_ground(position, _matrices(rotation))
        angle = np.append(rotation, 0.0) if self._dim == 2 else np.zeros(len(centre))
        count = len(self)
        place = Place(
            np.empty(count), np.zeros((count, self._dim)), np.zeros((count, 2, self._dim))
        )
        rows = self.kind, self._sign, self._offset, self.pairs, self._ends, self._directions
        _place_rows(rows, (centre, axes, angle), (place.gap, place.normal, place.arms))
        return place

    def reach(self, place: Place) -> np.ndarray:
        """Size of what turns with each row, shape (n,): its arms or its length, m; 1 on spins."""
        moves = self.pairs[:, ::-1] < self._count
        arms = np.where(moves, np.linalg.norm(place.arms, axis=2), 0.0).sum(axis=1)
        reach = np.where(self.kind == LENGTH, self._offset, arms + self._least)
        return np.where(self.on_spins, 1.0, reach)

    def points(
        self, place: Place, slots: np.ndarray, ground: int, law: np.ndarray, which: np.ndarray
    ) -> FoundPoints:
        """Some rows as points of the interaction layer, candidate b and antagonist a.

        Args:
            place: of all rows.
            slots: first of the two nodes of each body, shape (num_bodies,).
            ground: number of the ground's node.
            law: index of each row's law, shape (n,).
            which: numbers of the rows, ascending.
        """
        sides = self.pairs[which, ::-1]
        moves = sides < self._count
        nodes = np.where(moves, np.append(slots, 0)[sides] + self.on_spins[which, None], ground)
        count = len(which)
        points = InteractionPoints(
            nodes[:, :, None].astype(np.int32),
            np.ones((count, 2, 1)),
            place.normal[which, None],
            np.ones(count),
            place.gap[which],
            np.where(moves[..., None], place.arms[which], 0.0),
        )
        return FoundPoints(points, law[which], np.stack([which, np.zeros_like(which)], axis=1))


def _matrices(rotation: np.ndarray) -> np.ndarray:
    """From the axes of the bodies to those of space, from angles in 2D."""
    return rotation if rotation.ndim == 3 else plane_rotations(rotation)


@njit(**ENTRY)
def _place_rows(rows, bodies, place):
    """See the module docstring; directions are d, e and c in the axes of a, a and b."""
    (kind, sign, offset, pairs, ends, directions), (centre, axes, angle) = rows, bodies
    gap, normal, arms = place
    dim = centre.shape[1]
    apart, arm = np.zeros(3), np.zeros((2, 3))
    turned = np.zeros((3, 3))
    for row in range(len(kind)):
        a, b = pairs[row]
        for k in range(dim):
            for side in range(2):
                arm[side, k] = _turned(axes[pairs[row, side]], ends[row, side], k)
            apart[k] = centre[b, k] + arm[1, k] - centre[a, k] - arm[0, k]
            for which in range(3):
                body = b if which == 2 else a
                turned[which, k] = _turned(axes[body], directions[row, which], k)
        d, e, c = turned
        if kind[row] == PLANE:
            gap[row] = offset[row]
            for k in range(dim):
                normal[row, k] = sign[row] * d[k]
                gap[row] += normal[row, k] * apart[k]
                arms[row, 0, k] = arm[1, k]
                arms[row, 1, k] = centre[b, k] + arm[1, k] - centre[a, k]
        elif kind[row] == LENGTH:
            length = np.sqrt(_dot(apart, apart))
            gap[row] = offset[row] - length
            normal[row, 0] = 1.0  # whatever it is where both ends are in one place
            for k in range(dim):
                if length > 0.0:
                    normal[row, k] = -apart[k] / length
                arms[row, 0, k], arms[row, 1, k] = arm[1, k], arm[0, k]
        elif kind[row] == TURN:
            normal[row, 0] = sign[row]
            gap[row] = sign[row] * (angle[b] - angle[a]) + offset[row]
        elif kind[row] == ALIGN:
            across = _cross(c, e)
            size = np.sqrt(_dot(across, across))
            gap[row] = _dot(e, c) / size
            for k in range(3):
                normal[row, k] = across[k] / size
        else:
            phi = np.arctan2(_dot(d, _cross(e, c)), _dot(e, c))
            gap[row] = sign[row] * phi + offset[row]
            for k in range(3):
                normal[row, k] = sign[row] * d[k]


@njit(**MERGED)
def _turned(axes, vector, k):
    """Component k in space of a vector in the axes of a body."""
    found = 0.0
    for j in range(len(vector)):
        found += axes[k, j] * vector[j]
    return found


@njit(**MERGED)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(**MERGED)
def _cross(a, b):
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
