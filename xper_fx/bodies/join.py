# SPDX-License-Identifier: LGPL-3.0-or-later
"""Several meshes as one, whose parts share no vertex: to be tied, or to touch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags, meshtags

from xper_fx.bodies.meshes import check_mesh, facet_cells, facets_of_cells
from xper_fx.support.checks import require_kind
from xper_fx.support.compat import create_exploded_mesh, geometry_dofmap


class JoinedMesh(NamedTuple):
    """A mesh made of parts."""

    mesh: Mesh  #: the mesh; cells are those of the first part, then those of the second and so on
    #: part of each cell, shape (num_cells,), int32: labels for `xper_fx.bodies.explode.explode`
    part: npt.NDArray[np.int32]
    cell_tags: MeshTags  #: tags of the cells, as the parts have them; of a part without, 1
    facet_tags: MeshTags  #: tags of the facets, as the parts have them


def join_meshes(
    meshes: Sequence[Mesh],
    cell_tags: Sequence[MeshTags | None] | None = None,
    facet_tags: Sequence[MeshTags | None] | None = None,
) -> JoinedMesh:
    """Put meshes side by side into one; vertices that coincide stay two.

    Args:
        meshes: meshes of one kind of cells, on one process; they are left as they were.
        cell_tags: of each mesh, or None.
        facet_tags: of each mesh, or None; name the sides that parts face each other with by tags
            that no other part uses.

    Returns:
        The mesh, the part of each cell, and the tags.

    Raises:
        TypeError: something that is no mesh, or no tags.
        ValueError: no meshes, several kinds of cells, or tags that do not fit the meshes.
    """
    meshes = list(meshes) if np.iterable(meshes) else [meshes]
    if not meshes:
        raise ValueError("meshes is empty; expected at least one mesh.")
    for mesh in meshes:
        check_mesh(mesh)
    kinds = {mesh.topology.cell_name() for mesh in meshes}
    if len(kinds) > 1:
        raise ValueError(f"The meshes have {' and '.join(sorted(kinds))} cells; expected one kind.")
    dim = meshes[0].topology.dim
    cell_tags = _one_a_mesh(cell_tags, meshes, dim, "cell_tags")
    facet_tags = _one_a_mesh(facet_tags, meshes, dim - 1, "facet_tags")
    vertices = np.cumsum([0] + [len(mesh.geometry.x) for mesh in meshes])
    cells = np.concatenate(
        [
            geometry_dofmap(m).astype(np.int64) + first
            for m, first in zip(meshes, vertices, strict=False)
        ]
    )
    points = np.concatenate([mesh.geometry.x[:, :dim] for mesh in meshes])
    joined = create_exploded_mesh(meshes[0], cells, points)
    sizes = [mesh.topology.index_map(dim).size_local for mesh in meshes]
    tag = np.ones(len(cells), np.int32)
    facets_of_cell = facets_of_cells(joined)
    facets, values = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
    first = 0
    for mesh, size, of_cells, of_facets in zip(meshes, sizes, cell_tags, facet_tags, strict=True):
        if of_cells is not None:
            tag[first + of_cells.indices] = of_cells.values
        if of_facets is not None:
            cell, local = (a[of_facets.indices, 0] for a in facet_cells(mesh))
            facets.append(facets_of_cell[first + cell, local])
            values.append(of_facets.values)
        first += size
    facets, values = np.concatenate(facets), np.concatenate(values)
    order = np.argsort(facets)
    joined_cell_tags = meshtags(joined, dim, np.arange(len(cells), dtype=np.int32), tag)
    joined_facet_tags = meshtags(joined, dim - 1, facets[order], values[order].astype(np.int32))
    joined_cell_tags.name, joined_facet_tags.name = "cell_tags", "facet_tags"
    part = np.repeat(np.arange(len(meshes), dtype=np.int32), sizes)
    return JoinedMesh(joined, part, joined_cell_tags, joined_facet_tags)


def _one_a_mesh(
    tags: Sequence[MeshTags | None] | None, meshes: Sequence[Mesh], dim: int, name: str
) -> list[MeshTags | None]:
    """Tags of each mesh, checked."""
    if tags is not None and not np.iterable(tags):
        raise TypeError(f"{name} should be a list with one entry a mesh, got {tags!r}.")
    tags = [None] * len(meshes) if tags is None else list(tags)
    if len(tags) != len(meshes):
        raise ValueError(f"{name} has {len(tags)} entries for {len(meshes)} meshes; give one each.")
    for number, (mesh, given) in enumerate(zip(meshes, tags, strict=True)):
        if given is None:
            continue
        require_kind(f"{name}[{number}]", given, MeshTags)
        if given.dim != dim or given.topology is not mesh.topology._cpp_object:
            raise ValueError(
                f"{name}[{number}] should tag entities of dimension {dim} of meshes[{number}]; it "
                "belongs to another mesh or dimension."
            )
    return tags
