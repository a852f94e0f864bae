# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies that lie inside of meshed bodies at the start, too deep for a search of contacts.

Contacts are looked for near the surfaces of bodies: what is deeper goes its way unseen. Looked at
are the middles of cells and the positions of rigid bodies.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from dolfinx.geometry import bb_tree, compute_colliding_cells, compute_collisions_points

from xper_fx.bodies.meshes import midpoints_of
from xper_fx.scene.body_pieces import pieces_of_bodies
from xper_fx.support.compat import geometry_dofmap

if TYPE_CHECKING:
    from xper_fx.scene.scene import Scene

# Cells beyond which looking at each would take longer than a step.
_MANY = 20_000


def mesh_overlaps(scene: Scene) -> Iterator[str]:
    """A sentence for the first meshed body, and for the first rigid one, that lies in another.

    Args:
        scene: checked, with a mesh.
    """
    pairs = {frozenset(c.between) for c in scene.contacts if c.law is not None}
    if not any(pair & set(scene.surfaces) for pair in pairs):
        return
    bodies, mesh = scene.bodies, scene.bodies.mesh
    tree = bb_tree(mesh, mesh.topology.dim)
    group_of_tag = {tag: name for name, tags in scene.surfaces.items() for tag in tags}
    piece = pieces_of_bodies(bodies, scene.law_of_facet()[1])[bodies.body_of_cell]

    def cells_at(points: np.ndarray) -> Iterator[tuple[int, int]]:
        """Points and cells that they are in."""
        found = compute_colliding_cells(mesh, compute_collisions_points(tree, points), points)
        yield from zip(
            np.repeat(np.arange(len(points)), np.diff(found.offsets)), found.array, strict=True
        )

    def touch(first: str | None, cell: int) -> bool:
        return frozenset((first, group_of_tag.get(bodies.material_of_cell[cell]))) in pairs

    if len(piece) <= _MANY and piece.max() > 0:
        middles = midpoints_of(mesh.geometry.x, geometry_dofmap(mesh))
        for cell, other in cells_at(middles):
            own = group_of_tag.get(bodies.material_of_cell[cell])
            if piece[cell] != piece[other] and touch(own, other):
                first, second = bodies.body_of_cell[cell], bodies.body_of_cell[other]
                yield (
                    f"meshed bodies {first} and {second} overlap at "
                    f"{middles[cell, : scene.dim].tolist()} m at the start, where no contact is "
                    "found; place them apart"
                )
                break
    rigid = scene.rigid_bodies
    if rigid is None:
        return
    shapes = rigid.shapes
    bounded = np.flatnonzero(np.isfinite(shapes.bounding_radius))
    points = np.zeros((len(bounded), 3))
    # of a cluster its parts: its own centre may lie outside of it
    points[:, : scene.dim] = shapes.place(rigid.position, rigid.rotation)[0][bounded]
    for number, cell in cells_at(points):
        body = shapes.body[bounded[number]]
        if touch(rigid.groups[rigid.group_of[body]], cell):
            yield (
                f"rigid body {body} lies in the meshed body "
                f"{bodies.body_of_cell[cell]} at the start, where no contact is found; place them "
                "apart"
            )
            break
