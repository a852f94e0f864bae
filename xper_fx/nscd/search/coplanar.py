# SPDX-License-Identifier: LGPL-3.0-or-later
"""Straight vertices and flat edges taken out of the tables of shapes.

Points of contact lie at the ends of the overlap of two edges, or faces: a side that is cut into
several would keep only those of one piece.
"""

from __future__ import annotations

import numpy as np

from xper_fx.nscd.rigid.bodies import ShapeTables, shape_tables
from xper_fx.nscd.rigid.polyhedron import Polyhedron

# Sine of the angle between neighbouring edges, or faces, up to which they are one.
_FLAT = 1e-9


def without_flats(tables: ShapeTables) -> ShapeTables:
    """The tables of the same solids with as few vertices, edges and faces as they need."""
    return _plane(tables) if tables.vertices.shape[1] == 2 else _space(tables)


def _plane(tables: ShapeTables) -> ShapeTables:
    offsets, normal = tables.vertex_offsets, tables.face_normal
    before = np.arange(len(normal)) - 1
    before[offsets[:-1]] = offsets[1:] - 1
    last = normal[before]
    turn = last[:, 0] * normal[:, 1] - last[:, 1] * normal[:, 0]
    kept = np.abs(turn) > _FLAT
    if kept.all():
        return tables
    offsets = np.concatenate([[0], np.cumsum(kept)])[offsets].astype(np.int32)
    vertices = tables.vertices[kept]
    after = np.arange(len(vertices)) + 1
    after[offsets[1:] - 1] = offsets[:-1]
    edge = vertices[after] - vertices
    edge /= np.linalg.norm(edge, axis=1)[:, None]
    normal = np.column_stack([edge[:, 1], -edge[:, 0]])
    first = np.repeat(offsets[:-1], np.diff(offsets))
    numbers = np.column_stack([np.arange(len(vertices)), after]) - first[:, None]
    return tables._replace(
        vertex_offsets=offsets,
        vertices=vertices,
        face_offsets=offsets,
        loop_offsets=np.arange(0, 2 * len(vertices) + 1, 2, dtype=np.int32),
        loops=numbers.ravel().astype(np.int32),
        face_normal=normal,
        face_distance=np.einsum("ij,ij->i", normal, vertices),
    )


def _space(tables: ShapeTables) -> ShapeTables:
    entry_of_edge = np.repeat(np.arange(len(tables.edge_offsets) - 1), np.diff(tables.edge_offsets))
    normals = tables.face_normal[tables.face_offsets[entry_of_edge, None] + tables.edge_faces]
    sine = np.linalg.norm(np.cross(normals[:, 0], normals[:, 1]), axis=1)
    flat = np.unique(entry_of_edge[sine <= _FLAT])
    if len(flat) == 0:
        return tables
    hulls = shape_tables(
        [
            Polyhedron.hull(tables.vertices[slice(*tables.vertex_offsets[[e, e + 1]])])
            for e in flat.tolist()
        ]
    )
    joined = {}
    for name in ShapeTables._fields[ShapeTables._fields.index("vertex_offsets") :]:
        old, new = getattr(tables, name), getattr(hulls, name)
        joined[name] = np.concatenate(
            [old, new[1:] + old[-1]] if name.endswith("offsets") else [old, new]
        )
    number = np.arange(len(tables.vertex_offsets))
    number[flat] = len(number) - 1 + np.arange(len(flat))
    entry = np.where(tables.entry < 0, -1, number[tables.entry]).astype(np.int32)
    return tables._replace(entry=entry, **joined)
