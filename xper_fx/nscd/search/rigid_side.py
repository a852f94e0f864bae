# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies as surfaces of meshed bodies meet them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from xper_fx.nscd.rigid.bodies import RigidBodies, plane_rotations
from xper_fx.nscd.rigid.shapes import HALF_PLANE, HALF_SPACE
from xper_fx.nscd.search.surface import Surface


class RigidSide:
    """The convex pieces of the rigid bodies as surfaces meet them, and where they are now.

    Attributes:
        meets: which piece each group of the surface may touch, shape (num_groups, n), bool.
        walls, solids: numbers of the pieces that are walls, and of the others.
        points: corners of polygons and polyhedra, and centres of discs and spheres, now.
        outward: from the centre of the piece to its corners, zero at centres.
        radius: of discs and spheres at their centres, 0 at corners.
        piece_of_point, body_of_point: shape (num_points,).
        in_parts: whether there are clusters.
    """

    def __init__(
        self, bodies: RigidBodies | None, surface: Surface, pairs: Sequence[tuple[str, str]] | None
    ):
        dim = surface.dim
        self.points = self.outward = np.empty((0, dim))
        self.walls = self.solids = np.empty(0, np.int64)
        names = () if bodies is None else bodies.groups
        both = set(names) & set(surface.groups)
        if both:
            raise ValueError(
                f"Groups {sorted(both)} are of rigid and of meshed bodies: give them two names."
            )
        unknown = {name for pair in pairs or () for name in pair} - set(names) - set(surface.groups)
        if unknown:
            raise ValueError(
                f"pairs names groups {sorted(unknown)}; there are "
                f"{sorted(set(names) | set(surface.groups))}."
            )
        self._count = 0 if bodies is None else len(bodies)
        self.in_parts = False
        if bodies is None:
            return
        if bodies.dim != dim:
            raise ValueError(f"Rigid bodies are of dimension {bodies.dim}, the surface of {dim}.")
        self.shapes = tables = bodies.shapes
        self.in_parts = len(tables.body) > len(bodies)
        self.meets = may_meet(surface.groups, names, pairs)[:, bodies.group_of[tables.body]]
        is_wall = np.isin(tables.kind, (HALF_PLANE, HALF_SPACE))
        self.walls, self.solids = np.flatnonzero(is_wall), np.flatnonzero(~is_wall)
        self.bounding = tables.bounding_radius
        starts = tables.vertex_offsets
        local, owner = [], []
        for piece in self.solids:
            entry = tables.entry[piece]
            corners = np.zeros((1, dim))
            if entry >= 0:
                corners = tables.vertices[starts[entry] : starts[entry + 1]]
            local.append(corners)
            owner.append(np.full(len(corners), piece, np.int32))
        self._local = np.concatenate([self.points, *local])
        self.piece_of_point = np.concatenate([np.empty(0, np.int32), *owner])
        self.body_of_point = tables.body[self.piece_of_point]
        self.radius = tables.radius[self.piece_of_point]

    def move(self, position: np.ndarray | None, rotation: np.ndarray | None) -> None:
        """Put the bodies where they are now."""
        if self._count == 0:
            return
        if position is None or rotation is None:
            raise ValueError("There are rigid bodies: give their positions and rotations.")
        position = np.ascontiguousarray(position, dtype=float)
        rotation = np.asarray(rotation, dtype=float)
        dim = self.points.shape[1]
        if position.shape != (self._count, dim) or len(rotation) != self._count:
            raise ValueError(
                f"Positions of {self._count} rigid bodies in dimension {dim} were expected, got "
                f"shapes {position.shape} and {rotation.shape}."
            )
        if not (np.isfinite(position).all() and np.isfinite(rotation).all()):
            raise ValueError("Positions and rotations of rigid bodies should be finite.")
        position, rotation = self.shapes.place(position, rotation)
        rotation = plane_rotations(rotation) if dim == 2 else np.ascontiguousarray(rotation)
        self.position, self.turn = position, rotation
        piece = self.piece_of_point
        self.outward = np.einsum("pij,pj->pi", self.turn[piece], self._local)
        self.points = position[piece] + self.outward

    def state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Positions, rotations and points, to be compared with later ones."""
        if self._count == 0:
            return None
        return self.position.copy(), self.turn.copy(), self.points.copy()

    def motion(self, old: tuple[np.ndarray, ...] | None, middle: np.ndarray) -> float:
        """Largest displacement of a piece since `old`, against `middle`; walls left out."""
        if len(self.solids) == 0:
            return 0.0
        shift = (self.position - old[0])[self.solids] - middle
        turned = np.sqrt(0.5 * ((self.turn - old[1])[self.solids] ** 2).sum(axis=(1, 2)))
        turned *= np.where(self.shapes.radius[self.solids] > 0, 0.0, self.bounding[self.solids])
        return float((np.linalg.norm(shift, axis=1) + turned).max())


def may_meet(
    rows: tuple[str, ...], columns: tuple[str, ...], pairs: Sequence[tuple[str, str]] | None
) -> np.ndarray:
    """Which group of `rows` may touch which of `columns`, bool."""
    named = None if pairs is None else {frozenset(pair) for pair in pairs}
    allowed = [[named is None or frozenset((a, b)) in named for b in columns] for a in rows]
    return np.array(allowed, bool).reshape(len(rows), len(columns))
