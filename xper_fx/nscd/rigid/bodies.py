# SPDX-License-Identifier: LGPL-3.0-or-later
"""All rigid bodies of a scene as flat arrays, for compiled kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from xper_fx.nscd.rigid.body import ResolvedBody, RigidBody, resolve
from xper_fx.nscd.rigid.shapes import POLYGON, POLYHEDRON, Piece, Shape


class ShapeTables(NamedTuple):
    """Shapes of the bodies, for compiled kernels; m.

    Shapes are convex *pieces*, in the order of their bodies: one a body, but for clusters. A piece
    that has corners has an entry in the tables of corners, shared by all bodies of the same shape
    object. Entry s has vertices `vertex_offsets[s]:vertex_offsets[s + 1]`, faces
    `face_offsets[s]:face_offsets[s + 1]` and edges `edge_offsets[s]:edge_offsets[s + 1]`; vertex
    and face numbers within an entry count from its first. Faces of a polygon are its edges: face i
    goes from vertex i to i + 1; it has no entries among the edges.
    """

    kind: np.ndarray  #: numbers of `shapes`, shape (num_pieces,), int8
    radius: np.ndarray  #: of discs and spheres, 0 for others, shape (num_pieces,)
    #: about the centre of the piece, inf for walls, shape (num_pieces,)
    bounding_radius: np.ndarray
    #: of each piece in the tables of corners, -1 if it has none, shape (num_pieces,), int32
    entry: np.ndarray
    body: np.ndarray  #: of each piece, shape (num_pieces,), int32, rising
    #: of the piece's centre from the body's centre of mass, in the body's axes, shape (num_pieces,
    #: dim)
    offset: np.ndarray
    vertex_offsets: np.ndarray  #: shape (num_entries + 1,), int32
    #: about the centre of the piece in the body's axes, shape (num_vertices, dim)
    vertices: np.ndarray
    face_offsets: np.ndarray  #: shape (num_entries + 1,), int32
    loop_offsets: np.ndarray  #: first place in `loops` of each face, shape (num_faces + 1,), int32
    loops: np.ndarray  #: vertices of the faces, counter-clockwise from outside, int32
    face_normal: np.ndarray  #: outward unit normals in the body's axes, shape (num_faces, dim)
    #: of the face's plane from the centre of the piece, shape (num_faces,)
    face_distance: np.ndarray
    edge_offsets: np.ndarray  #: shape (num_entries + 1,), int32
    edges: np.ndarray  #: vertices (a, b), a < b, of edges of polyhedra, shape (num_edges, 2), int32
    #: the face that runs from a to b, and that from b to a, shape (num_edges, 2)
    edge_faces: np.ndarray

    @property
    def ball_radius(self) -> np.ndarray:
        """Radius of the bodies that are one disc or sphere, 0 of others, shape (num_bodies,)."""
        count = np.bincount(self.body)
        alone = (count[self.body] == 1) & ~self.offset.any(axis=1)
        radius = np.zeros(len(count))
        radius[self.body[alone]] = self.radius[alone]
        return radius

    def place(self, position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centres and rotations of the pieces from those of the bodies, which have their axes.

        Args:
            position: of the bodies' centres of mass, shape (num_bodies, dim), m.
            rotation: angles, shape (num_bodies,), rad (2D); matrices from body to space,
                (num_bodies, 3, 3) (3D).

        Returns:
            The same of the pieces; the given arrays where each body is one piece about its centre.
        """
        if not self.offset.any():
            return position, rotation
        own = rotation[self.body]
        turn = plane_rotations(own) if own.ndim == 1 else own
        return position[self.body] + np.einsum("pij,pj->pi", turn, self.offset), own


def plane_rotations(angle: np.ndarray) -> np.ndarray:
    """Matrices of rotations in the plane, shape (n, 2, 2), from angles (rad)."""
    matrices = np.empty((len(angle), 2, 2))
    matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(angle)
    matrices[:, 1, 0] = np.sin(angle)
    np.negative(matrices[:, 1, 0], out=matrices[:, 0, 1])
    return matrices


def _offsets(lengths: list[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(np.array(lengths, int))]).astype(np.int32)


def _stack(parts: list[np.ndarray], shape: tuple[int, ...], dtype: type) -> np.ndarray:
    empty = np.zeros((0, *shape), dtype)
    return np.ascontiguousarray(np.concatenate([empty, *parts]).astype(dtype))


def shape_tables(shapes: Sequence[Shape]) -> ShapeTables:
    """Tables of the shapes of all bodies, a shape each, which are of one dimension."""
    dim = shapes[0].dim
    parted = [getattr(shape, "pieces", [Piece(shape, np.zeros(dim))]) for shape in shapes]
    body = np.repeat(np.arange(len(shapes), dtype=np.int32), [len(own) for own in parted])
    pieces = [piece for own in parted for piece in own]
    shapes = [piece.shape for piece in pieces]
    unique = {id(shape): shape for shape in shapes}
    cornered = [s for s in unique.values() if s.kind in (POLYGON, POLYHEDRON)]
    entry_of = {id(shape): entry for entry, shape in enumerate(cornered)}
    bounding = {key: shape.bounding_radius for key, shape in unique.items()}
    vertices, loops, normals, distances, edges, edge_faces = [], [], [], [], [], []
    num_faces, loop_lengths = [], []
    for shape in cornered:
        corners = shape.centred_vertices
        if dim == 2:
            numbers = np.arange(len(corners))
            faces = np.column_stack([numbers, np.roll(numbers, -1)]).tolist()
            normal = shape.edge_normals
        else:
            faces, normal = shape.faces, shape.face_normals
            ends, sides = shape.edges
            edges.append(ends)
            edge_faces.append(sides)
        vertices.append(corners)
        normals.append(normal)
        distances.append(
            np.array([corners[list(f)].mean(0) @ n for f, n in zip(faces, normal, strict=True)])
        )
        num_faces.append(len(faces))
        loop_lengths += [len(face) for face in faces]
        loops += [np.array(face) for face in faces]
    return ShapeTables(
        kind=np.array([shape.kind for shape in shapes], np.int8),
        radius=np.array([getattr(shape, "radius", 0.0) for shape in shapes], float),
        bounding_radius=np.array([bounding[id(shape)] for shape in shapes]),
        entry=np.array([entry_of.get(id(shape), -1) for shape in shapes], np.int32),
        body=body,
        offset=np.array([piece.offset for piece in pieces]),
        vertex_offsets=_offsets([len(v) for v in vertices]),
        vertices=_stack(vertices, (dim,), np.float64),
        face_offsets=_offsets(num_faces),
        loop_offsets=_offsets(loop_lengths),
        loops=_stack(loops, (), np.int32),
        face_normal=_stack(normals, (dim,), np.float64),
        face_distance=_stack(distances, (), np.float64),
        edge_offsets=_offsets([len(e) for e in edges] if dim == 3 else [0] * len(cornered)),
        edges=_stack(edges, (2,), np.int32),
        edge_faces=_stack(edge_faces, (2,), np.int32),
    )


class RigidBodies:
    """Rigid bodies as flat arrays, checked.

    Attributes:
        dim: 2 or 3.
        groups: names of the groups, in the order in which bodies first name them.
        group_of: of each body, shape (n,), int32.
        shapes: `ShapeTables`.
        bounding_radius: about the centre of mass, inf for walls, shape (n,), m.
        mass: shape (n,), kg (2D: kg/m); 0 for a prescribed body without any.
        inertia: about the centre of mass, shape (n,) in 2D, kg m; (n, 3, 3) in the body's axes in
            3D, kg m^2.
        position: of the centres of mass at time 0, shape (n, dim), m.
        rotation: at time 0: angle (2D), shape (n,), rad; from the axes of the body to those of
            space (3D), shape (n, 3, 3).
        velocity: at time 0, shape (n, dim), m/s.
        spin: at time 0, shape (n,) in 2D, (n, 3) in the axes of space in 3D, rad/s.
        prescribed: of each body: component -> constant or function of time.
        is_prescribed: which degrees of freedom are, shape (n, dofs), dofs = 3 or 6.
        force, torque: of each body as it was given: None, constant, or function of time.

    Args:
        bodies: one or more, all 2D or all 3D.

    Raises:
        TypeError, ValueError: bad input, with the number of the body in the list.
    """

    def __init__(self, bodies: Sequence[RigidBody]):
        bodies = list(bodies)
        if not bodies:
            raise ValueError("RigidBodies needs at least one body.")
        first_of = {id(body): number for number, body in reversed(list(enumerate(bodies)))}
        resolved: list[ResolvedBody] = []
        for number, body in enumerate(bodies):
            if first_of[id(body)] != number:
                raise ValueError(
                    f"Rigid bodies {first_of[id(body)]} and {number} are the same object, so that "
                    "they would be in one place twice; make a RigidBody for each."
                )
            try:
                resolved.append(resolve(body))
            except (TypeError, ValueError) as error:
                raise type(error)(f"Rigid body {number}: {error}") from error
            if resolved[-1].dim != resolved[0].dim:
                raise ValueError(
                    f"Rigid body {number} is of dimension {resolved[-1].dim}, body 0 of dimension "
                    f"{resolved[0].dim}: they cannot be in one scene."
                )
        self.dim = dim = resolved[0].dim
        number_of = {name: g for g, name in enumerate(dict.fromkeys(b.group for b in bodies))}
        self.groups = tuple(number_of)
        self.group_of = np.array([number_of[b.group] for b in bodies], np.int32)
        shapes = [b.shape for b in bodies]
        self.shapes = shape_tables(shapes)
        radius = {id(shape): shape.bounding_radius for shape in shapes}
        self.bounding_radius = np.array([radius[id(shape)] for shape in shapes])
        self.mass = np.array([b.mass for b in resolved])
        self.inertia = np.array([b.inertia for b in resolved])
        self.position = np.array([b.position for b in resolved])
        rotation = np.array([b.rotation for b in resolved])
        self.rotation = rotation if dim == 2 else Rotation.from_quat(rotation).as_matrix()
        self.velocity = np.array([b.velocity for b in resolved])
        self.spin = np.array([b.spin for b in resolved])
        self.prescribed = [b.prescribed for b in resolved]
        self.is_prescribed = np.zeros((len(bodies), 3 * (dim - 1)), bool)
        for number, body in enumerate(resolved):
            self.is_prescribed[number, list(body.prescribed)] = True
        self.force = [b.force for b in bodies]
        self.torque = [b.torque for b in bodies]

    def __len__(self) -> int:
        """Number of bodies."""
        return len(self.mass)
