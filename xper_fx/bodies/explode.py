# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies: a mesh cut into bodies that share no vertex, and the facets by which they face.

`explode` duplicates the vertices of a mesh so that each body has its own. What was one facet
between two bodies becomes two facets that coincide in space: a *facing facet*, the place of an
interaction. One of its sides is the *candidate*, the other the *antagonist*; the unit normal n
points from the antagonist to the candidate, so that n . (u_candidate - u_antagonist) > 0 is an
opening.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import basix
import numpy as np
import numpy.typing as npt
from dolfinx.fem import FunctionSpace
from dolfinx.mesh import Mesh, MeshTags, meshtags

from xper_fx.bodies.meshes import (
    cell_measure,
    check_mesh,
    facet_cells,
    facet_geometry_nodes,
    facets_of_cells,
    local_facet_vertices,
    midpoints_of,
    reference_cell,
)
from xper_fx.bodies.present_tags import PresentTags
from xper_fx.support.checks import require_kind
from xper_fx.support.compat import create_exploded_mesh, geometry_dofmap, original_cells
from xper_fx.support.ranks import Ranks

if TYPE_CHECKING:
    from xper_fx.bodies.lattice import FacetPairs
    from xper_fx.bodies.spread import Spread


EACH_CELL = "each cell"
"""Every cell is a body of its own."""

# A normal's component below this is rounding and does not decide the orientation; coordinates
# that differ by less than the second, relative to the size of the mesh, count as equal when
# facing facets are sorted.
_NEGLIGIBLE_COMPONENT = 1e-9
_EQUAL_COORDINATE = 1e-10


@dataclass(frozen=True, eq=False)
class FacingFacets:
    """The facets by which two bodies face each other, sorted by midpoint (x, then y, then z).

    Sides come in the order candidate, antagonist. Which one is the candidate depends on the
    geometry alone, not on the numbering of the mesh: the first component of the normal that is
    not negligible is positive.
    """

    cells: npt.NDArray[np.int32]  #: cells of the exploded mesh, shape (n, 2), int32
    #: number of the facet within each cell, shape (n, 2), int32
    local_facets: npt.NDArray[np.int32]
    tag: npt.NDArray[np.int32]  #: tag of the parent facet, 0 if it has none, shape (n,), int32
    #: unit normal from the antagonist to the candidate, shape (n, dim)
    normal: npt.NDArray[np.float64]
    #: length (m) or area (m^2), shape (n,); of a warped quadrilateral facet, the norm of its vector
    #: area
    measure: npt.NDArray[np.float64]
    midpoint: npt.NDArray[np.float64]  #: mean of the vertices, shape (n, dim), m
    bodies: npt.NDArray[np.int32]  #: the two bodies, shape (n, 2), int32
    materials: npt.NDArray[np.int32]  #: cell tags of the two cells, shape (n, 2), int32
    #: vertices of the facet within each cell, shape (n, 2, k), int32, matched: `local_vertices[f,
    #: 0, j]` and `local_vertices[f, 1, j]` coincide in space. In 2D the direction from j = 0 to j =
    #: 1 is the normal turned by +90 degrees; in 3D the vertices go round the normal
    #: counterclockwise (quadrilaterals: in the order 0, 1, 3, 2).
    local_vertices: npt.NDArray[np.int32]

    def __len__(self) -> int:
        """Return the number of facing facets."""
        return len(self.tag)


class CellFacets(NamedTuple):
    """Facets by cells that have them, as in `FacingFacets`: (n, s), (n, s) and (n, s, k)."""

    cells: npt.NDArray[np.int32]
    local_facets: npt.NDArray[np.int32]
    local_vertices: npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Bodies:
    """A mesh cut into bodies that share no vertex; made by `explode`.

    The cells of a body are consecutive, and bodies are numbered in the order of their labels
    (each cell a body: in the order of the parent's cells), so that neighbours in number are
    neighbours in space as far as the parent's numbering makes them so.

    A periodic cell is cut as a piece of the periodic medium: cells that meet across its boundary
    face each other there if they belong to two bodies, and are tied if they belong to one.

    Of a mesh that is spread over ranks, these are the bodies that this rank knows: its own, and
    of others the cells that share a vertex with them. Cells and vertices of the parent are then
    those of what the mesh was made from (`Topology.original_cell_index`), and facing facets are
    sorted by them.

    Attributes:
        mesh: the exploded mesh, of the same dimension as the parent.
        num_bodies: number of bodies.
        labels: the label that each body had in `explode`, shape (num_bodies,), int64.
        body_of_cell: body of each cell, shape (num_cells,), int32, ascending.
        parent_cell: cell of the parent mesh, shape (num_cells,), int32.
        parent_vertex: geometry node of the parent mesh for each geometry node of the exploded
            mesh, shape (num_geometry_nodes,), int32.
        cell_tags: tag of each cell: its material; 1 if the parent had no cell tags.
        material_of_cell: the same as an array, shape (num_cells,), int32.
        facet_tags: tags on the exploded facets. An exterior parent facet, or one inside a body,
            hands its tag to its copy; one between two bodies to both its copies.
        lattice: period vectors as rows, shape (dim, dim), m; None if the mesh is no periodic cell.
        ties: facets across which one body goes on over the cell's boundary; empty without a
            lattice.
        spread: which rank has which body, of a mesh that is spread over ranks; None if each rank
            has all.
    """

    mesh: Mesh
    num_bodies: int
    labels: npt.NDArray[np.int64]
    body_of_cell: npt.NDArray[np.int32]
    parent_cell: npt.NDArray[np.int32]
    parent_vertex: npt.NDArray[np.int32]
    cell_tags: MeshTags
    material_of_cell: npt.NDArray[np.int32]
    facet_tags: MeshTags
    facets: FacingFacets
    lattice: npt.NDArray[np.float64] | None
    ties: FacingFacets
    spread: Spread | None = None

    @cached_property
    def present(self) -> PresentTags:
        """The tags that occur, on any rank."""
        if self.spread is not None:
            return self.spread.present
        facets = self.facets
        rows = np.column_stack([np.sort(facets.materials, axis=1), facets.tag])
        return PresentTags(
            frozenset(np.unique(self.material_of_cell).tolist()),
            frozenset(np.unique(self.facet_tags.values).tolist()),
            frozenset(map(tuple, np.unique(rows, axis=0).tolist())),
        )

    @property
    def counts(self) -> tuple[int, int]:
        """Number of bodies and of cells, on all ranks together."""
        if self.spread is None:
            return self.num_bodies, len(self.body_of_cell)
        return self.spread.num_bodies, self.spread.num_cells

    def numbers_on_all(self, bodies: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
        """Numbers of bodies on which all ranks agree: of a mesh that is spread, their labels."""
        return bodies if self.spread is None else self.labels[bodies]

    def facet_places(self) -> tuple[npt.NDArray[np.int64], int]:
        """Return where the facing facets are among those of all ranks, sorted by midpoints.

        Of a mesh that is spread all ranks call it together. A facet has the place that it would
        have in `facets` if one rank had the mesh: a table of numbers for the facets of that mesh
        is read as `table[bodies.facet_places()[0]]`.

        Returns:
            Shape (num_facing_facets,), int64, and the number of all facing facets.
        """
        points = self.facets.midpoint
        if self.spread is None:
            return np.arange(len(points)), len(points)
        from xper_fx.bodies.keepers import places_of_points

        ranks = self.spread.ranks
        ends = ranks.max(np.stack([e.max(axis=0, initial=-np.inf) for e in (points, -points)]))
        return places_of_points(ranks, points, _EQUAL_COORDINATE * ends.sum(axis=0).max())

    def order_of_facets(self) -> npt.NDArray[np.intp]:
        """Order of the facing facets, of a mesh that is spread, that no partition decides.

        Where bonds at a vertex may break in more ways than one, it decides. All ranks call it
        together.
        """
        lower = self.parent_cell[self.facets.cells].min(axis=1, initial=self.spread.num_cells)
        return np.lexsort((lower, self.facet_places()[0]))

    def facing_nodes(self, V: FunctionSpace) -> npt.NDArray[np.int32]:
        """Return the nodes of V on both sides of each facing facet, matched in space.

        Args:
            V: continuous Lagrange space of order 1 or 2 on `mesh`, scalar or blocked.

        Returns:
            Nodes (block dofs), shape (num_facing_facets, 2, k), int32: candidate, antagonist.
            `[f, 0, j]` and `[f, 1, j]` coincide in space. j runs over the vertices of the facet
            as in `FacingFacets.local_vertices`, then (order 2) over its edges: the midpoint in
            2D; those opposite to each vertex, (1,2), (0,2), (0,1), for triangles; (0,1), (0,2),
            (1,3), (2,3) and the centre for quadrilaterals.

        Raises:
            ValueError: V is on another mesh, is no continuous Lagrange space of order 1 or 2, or
                is mixed.
        """
        return self.nodes_on_facets(V, self.facets)

    def facet_nodes(self, degree: int) -> npt.NDArray[np.float64]:
        """Return where the nodes of the facing facets are, at the candidate's side.

        Args:
            degree: order of the space that the nodes are of, 1 or 2.

        Returns:
            Shape (num_facing_facets, nodes of a facet, dim), m; nodes as in `facing_nodes`.

        Raises:
            ValueError: another degree.
        """
        if degree not in (1, 2):
            raise ValueError(f"degree should be 1 or 2, got {degree!r}.")
        facets, cell = self.facets, reference_cell(self.mesh)
        corners = geometry_dofmap(self.mesh)[facets.cells[:, :1], facets.local_vertices[:, 0]]
        x = self.mesh.geometry.x[corners, : self.mesh.geometry.dim]
        if degree == 1:
            return x
        edges = x[:, np.array(facet_edges(cell))].mean(axis=2)
        centre = [x.mean(axis=1, keepdims=True)] if x.shape[1] == 4 else []
        return np.concatenate([x, edges, *centre], axis=1)

    def node_classes(self, V: FunctionSpace) -> tuple[npt.NDArray[np.int32], int]:
        """Return which nodes of V are one node of the periodic medium.

        Args:
            V: continuous Lagrange space of order 1 or 2 on `mesh`, scalar or blocked.

        Returns:
            The class of each node, shape (num_nodes,), int32, numbered in the order of their first
            nodes, and their number; without ties every node is a class of its own.

        Raises:
            ValueError: as `facing_nodes`.
        """
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        count = V.dofmap.index_map.size_local
        pairs = self.nodes_on_facets(V, self.ties).transpose(1, 0, 2).reshape(2, -1)
        if self.lattice is not None and count:
            pairs = np.concatenate([pairs, self._translates_within_bodies(V)], axis=1)
        graph = coo_array((np.ones(pairs.shape[1]), tuple(pairs)), shape=(count, count))
        number, label = connected_components(graph, directed=False)
        _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
        rank = np.empty(number, np.int32)
        rank[np.argsort(first)] = np.arange(number, dtype=np.int32)
        return rank[inverse], number

    def _translates_within_bodies(self, V: FunctionSpace) -> npt.NDArray[np.int32]:
        """Return pairs of nodes of one body that differ by a period, shape (2, n).

        Parts of a body that touch at a vertex or an edge only share it inside the cell; they do so
        across its boundary too.
        """
        from xper_fx.bodies.lattice import translates

        nodes, offsets = self.node_permutation(V)
        body = np.empty(len(nodes), np.int32)
        body[nodes] = np.repeat(np.arange(self.num_bodies, dtype=np.int32), np.diff(offsets))
        x = V.tabulate_dof_coordinates()[:, : self.mesh.geometry.dim]
        pairs = translates(x, self.lattice, _EQUAL_COORDINATE * np.ptp(x, axis=0).max())
        # a cell on its own that touches its own image at a vertex is not tied to it
        several = np.bincount(self.body_of_cell, minlength=self.num_bodies) > 1
        first, second = body[pairs].T
        return pairs[(first == second) & several[first]].T

    def nodes_on_facets(
        self, V: FunctionSpace, facets: FacingFacets | CellFacets
    ) -> npt.NDArray[np.int32]:
        """Return the nodes of V on facets that are named by s cells each, as `facing_nodes`.

        Args:
            V: as in `facing_nodes`.
            facets: with `cells` and `local_facets`, shape (n, s), and `local_vertices`, (n, s, k).

        Returns:
            Nodes (block dofs), shape (n, s, number of nodes of a facet), int32.

        Raises:
            ValueError: as `facing_nodes`.
        """
        degree = self._checked_degree(V)
        layout = V.dofmap.dof_layout
        cell = reference_cell(self.mesh)
        topology = basix.topology(cell)
        num_vertices = len(topology[0])
        vertex_dof = np.array([layout.entity_dofs(0, v)[0] for v in range(num_vertices)])
        vertices = facets.local_vertices
        local = [vertex_dof[vertices]]
        if degree == 2:
            edge_dof = np.full((num_vertices, num_vertices), -1)
            for e, (a, b) in enumerate(topology[1]):
                edge_dof[a, b] = edge_dof[b, a] = layout.entity_dofs(1, e)[0]
            for a, b in facet_edges(cell):
                local.append(edge_dof[vertices[:, :, a], vertices[:, :, b]][:, :, np.newaxis])
            if len(topology) == 4 and len(topology[2][0]) == 4:
                face_dof = np.array([layout.entity_dofs(2, i)[0] for i in range(len(topology[2]))])
                local.append(face_dof[facets.local_facets][:, :, np.newaxis])
        dofs = np.concatenate(local, axis=2)
        return V.dofmap.list[facets.cells[:, :, np.newaxis], dofs].astype(np.int32)

    def node_permutation(
        self, V: FunctionSpace
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """Return the nodes of V body by body.

        Args:
            V: continuous Lagrange space of order 1 or 2 on `mesh`, scalar or blocked.

        Returns:
            `node_order`, shape (num_nodes,), int32, and `offsets`, shape (num_bodies + 1,),
            int32: `node_order[offsets[b]:offsets[b + 1]]` are the nodes (block dofs) of body b,
            in the order in which the rows of V's dof map, cell after cell, first name them.

        Raises:
            ValueError: as `facing_nodes`.
        """
        self._checked_degree(V)
        dofmap = V.dofmap.list
        num_nodes = V.dofmap.index_map.size_local
        named = dofmap.ravel()
        place = np.arange(named.size, dtype=np.int32)
        first = np.empty(num_nodes, dtype=np.int32)
        first[named[::-1]] = place[::-1]  # of repeated indices the last assignment stays
        node_order = named[first[named] == place]
        body_of_node = np.empty(num_nodes, dtype=np.int32)
        body_of_node[named] = np.repeat(self.body_of_cell, dofmap.shape[1])
        offsets = np.zeros(self.num_bodies + 1, dtype=np.int32)
        np.cumsum(np.bincount(body_of_node, minlength=self.num_bodies), out=offsets[1:])
        return node_order.astype(np.int32), offsets

    def _checked_degree(self, V: FunctionSpace) -> int:
        """Return the order of a continuous Lagrange space of order 1 or 2 on `mesh`, or raise."""
        require_kind("V", V, FunctionSpace)
        if V.mesh.topology._cpp_object is not self.mesh.topology._cpp_object:
            raise ValueError(
                "V is on another mesh than these bodies; build it as "
                'dolfinx.fem.functionspace(bodies.mesh, ("Lagrange", 1, (dim,))).'
            )
        element = V.ufl_element()
        try:
            base = element.basix_element
        except NotImplementedError:  # mixed: of no single element
            base = None
        if (
            base is None
            or base.family != basix.ElementFamily.P
            or base.discontinuous
            or base.degree not in (1, 2)
        ):
            raise ValueError(
                f"V has the element {element}; expected continuous Lagrange of order 1 or 2, "
                "scalar or blocked (a mixed space: take a collapsed subspace)."
            )
        return base.degree


def explode(
    mesh: Mesh,
    bodies: str | npt.ArrayLike = EACH_CELL,
    cell_tags: MeshTags | None = None,
    facet_tags: MeshTags | None = None,
    lattice: npt.ArrayLike | None = None,
    voids: Sequence[int] = (),
) -> Bodies:
    """Cut a mesh into bodies that share no vertex.

    Args:
        mesh: mesh of first-order triangles, quadrilaterals, tetrahedra or hexahedra. Of one that
            DOLFINx has spread over ranks (made with `MPI.COMM_WORLD`), each rank cuts its share:
            all ranks call `explode` together, and none holds the whole.
        bodies: `EACH_CELL`, or an integer label for each cell of `mesh`, shape (num_cells,), not
            negative: the cells of one label are one body and stay connected as they were. On
            ranks: for the cells that the rank owns, labels that are the same on all ranks; a body
            goes whole to the rank that has most of its cells, or where ranks would have unlike
            work, to one that has the bodies next to it.
        cell_tags: a tag for every cell of `mesh` (materials).
        facet_tags: tags of some facets of `mesh` (boundaries, precracks).
        lattice: makes the mesh a periodic cell: edges of its box, shape (dim,), or period vectors
            as rows, shape (dim, dim), m. A body may cross the cell's boundary: its parts bear one
            label.
        voids: facet tags of the free surfaces inside a periodic cell.

    Returns:
        The bodies, on a new mesh; `mesh` is left as it was.

    Raises:
        TypeError: `bodies`, `cell_tags`, `facet_tags` or `voids` is of the wrong type.
        ValueError: labels or tags do not fit the mesh; a cell is degenerate; a facet is shared
            by three cells; two cells overlap at a facet; the geometry is not first order; facets
            of a periodic cell's boundary have no translate.
    """
    spread = isinstance(mesh, Mesh) and mesh.comm.size > 1
    check_mesh(mesh, spread=spread)
    lattice = _checked_periods(mesh, lattice, voids, facet_tags)
    if spread:
        return _explode_share(mesh, bodies, cell_tags, facet_tags, lattice, voids)
    pairs = None
    if lattice is not None:
        pairs = partial(_pairs_of_whole, lattice=lattice, voids=voids)
    return _cut(mesh, bodies, cell_tags, facet_tags, lattice, pairs)


def _checked_periods(
    mesh: Mesh, lattice: npt.ArrayLike | None, voids: Sequence[int], facet_tags: MeshTags | None
) -> npt.NDArray[np.float64] | None:
    """Return the period vectors of a periodic cell, or raise; ranks of the mesh call it."""
    if not np.iterable(voids):
        raise TypeError(f"voids should be a list of facet tags, got {voids!r}.")
    if len(voids) and lattice is None:
        raise ValueError(
            f"voids is {list(voids)} without a lattice; they are those of a periodic cell."
        )
    if lattice is None:
        return None
    here = np.unique(getattr(facet_tags, "values", ())).tolist()
    present = set().union(*mesh.comm.allgather(here))
    if unknown := set(voids) - present - {0}:
        raise ValueError(
            f"voids names facet tags {sorted(unknown)}, which no facet bears; tags that do: "
            f"{sorted(present - {0})}."
        )
    from xper_fx.bodies.lattice import checked_lattice

    return checked_lattice(lattice, mesh.topology.dim)


def _cut(
    mesh: Mesh,
    bodies: str | npt.ArrayLike,
    cell_tags: MeshTags | None,
    facet_tags: MeshTags | None,
    lattice: npt.NDArray[np.float64] | None,
    pairs: Callable[..., FacetPairs] | None,
) -> Bodies:
    """Cut a mesh on one process; the arguments of `explode` that have been checked.

    Args:
        pairs: gives the pairs of facets that are one across a periodic cell's boundary, from the
            mesh, the cells of its facets and their tags.
    """
    tdim = mesh.topology.dim
    num_cells = mesh.topology.index_map(tdim).size_local
    labels, body_of_parent = _body_labels(bodies, num_cells)
    parent_material = _materials(cell_tags, mesh, num_cells)
    parent_facet_tag = _facet_tag_array(facet_tags, mesh)
    cells_of_facet = facet_cells(mesh)
    meeting = _meeting_cells(mesh, cells_of_facet, parent_facet_tag[1])
    if pairs is not None:
        found = pairs(mesh, cells_of_facet, parent_facet_tag[1])
        across = _meeting_across(cells_of_facet, parent_facet_tag[1], found)
        meeting = _Meeting(*(np.concatenate(both) for both in zip(meeting, across, strict=True)))
    one_body = body_of_parent[meeting.cells[:, 0]] == body_of_parent[meeting.cells[:, 1]]
    apart = np.any(meeting.translation != 0.0, axis=1)

    # cells, body by body
    by_body = np.argsort(body_of_parent, kind="stable").astype(np.int32)
    new_cell = np.empty(num_cells, dtype=np.int32)
    new_cell[by_body] = np.arange(num_cells, dtype=np.int32)
    body_of_cell = body_of_parent[by_body]
    material_of_cell = parent_material[by_body]
    parent_nodes = geometry_dofmap(mesh)[by_body].astype(np.int64)

    # one vertex for each pair (body, parent vertex)
    if len(labels) == num_cells:
        cells = np.arange(parent_nodes.size, dtype=np.int64).reshape(parent_nodes.shape)
        node_of_vertex = parent_nodes.ravel()
    else:
        num_parent_nodes = len(mesh.geometry.x)
        keys = body_of_cell[:, np.newaxis].astype(np.int64) * num_parent_nodes + parent_nodes
        unique, inverse = np.unique(keys.ravel(), return_inverse=True)
        cells = inverse.reshape(parent_nodes.shape)
        node_of_vertex = unique % num_parent_nodes
    x = mesh.geometry.x[:, :tdim]
    numbers = original_cells(mesh)[by_body]
    exploded = create_exploded_mesh(mesh, cells, x[node_of_vertex], numbers)
    exploded.name = mesh.name
    parent_vertex = node_of_vertex[exploded.geometry.input_global_indices].astype(np.int32)

    everywhere = np.arange(num_cells, dtype=np.int32)
    exploded_cell_tags = meshtags(exploded, tdim, everywhere, material_of_cell)
    exploded_cell_tags.name = "cell_tags" if cell_tags is None else cell_tags.name
    exploded_facet_tags = _exploded_facet_tags(
        exploded, mesh, cells_of_facet, new_cell, parent_facet_tag
    )
    exploded_facet_tags.name = "facet_tags" if facet_tags is None else facet_tags.name

    return Bodies(
        mesh=exploded,
        num_bodies=len(labels),
        labels=labels,
        body_of_cell=body_of_cell,
        parent_cell=by_body,
        parent_vertex=parent_vertex,
        cell_tags=exploded_cell_tags,
        material_of_cell=material_of_cell,
        facet_tags=exploded_facet_tags,
        facets=_facing_facets(
            mesh, meeting.take(~one_body), new_cell, body_of_parent, parent_material
        ),
        lattice=lattice,
        ties=_facing_facets(
            mesh, meeting.take(one_body & apart), new_cell, body_of_parent, parent_material
        ),
    )


def _explode_share(
    mesh: Mesh,
    bodies: str | npt.ArrayLike,
    cell_tags: MeshTags | None,
    facet_tags: MeshTags | None,
    lattice: npt.NDArray[np.float64] | None,
    voids: Sequence[int],
) -> Bodies:
    """Cut what this rank knows of a mesh that is spread; all ranks call it together."""
    from xper_fx.bodies.spread import UNTAGGED, Spread, known_cells

    ranks, tdim = Ranks(mesh.comm), mesh.topology.dim
    count = mesh.topology.index_map(tdim).size_local
    mesh.topology.create_connectivity(tdim, tdim - 1)

    def checked() -> tuple:
        labels, body = _body_labels(bodies, count)
        tagged, tag = _facet_tag_array(facet_tags, mesh)
        tag_of_facet = np.full(len(tag), UNTAGGED, np.int32)
        tag_of_facet[tagged] = tag[tagged]
        return (
            None if isinstance(bodies, str) else labels[body],
            _materials(cell_tags, mesh, count),
            tag_of_facet[facets_of_cells(mesh)[:count]],
        )

    label, material, facet_tag = ranks.together(checked)
    border = pairs = None
    if lattice is not None:
        from xper_fx.bodies.spread_lattice import border_of

        border = border_of(ranks, mesh, facet_tag, lattice, voids)
    cells = known_cells(ranks, mesh, label, material, facet_tag, border)
    if cells.pair is not None:
        pairs = partial(_pairs_known, pair=cells.pair)
    for tags, given in ((cells.cell_tags, cell_tags), (cells.facet_tags, facet_tags)):
        if given is not None:
            tags.name = given.name

    known = ranks.together(
        lambda: _cut(cells.mesh, cells.label, cells.cell_tags, cells.facet_tags, lattice, pairs)
    )
    rank_of_cell = cells.rank[known.parent_cell]
    rank_of_body = np.empty(known.num_bodies, np.int32)
    rank_of_body[known.body_of_cell] = rank_of_cell
    own = rank_of_body == ranks.rank
    parent_cell = cells.number[known.parent_cell]
    spread = replace(
        known,
        parent_cell=parent_cell,
        parent_vertex=cells.vertex[known.parent_vertex],
        spread=Spread(
            ranks,
            rank_of_body,
            int(ranks.sum(np.count_nonzero(own))),
            int(ranks.sum(np.count_nonzero(rank_of_cell == ranks.rank))),
            PresentTags.union(ranks.comm.allgather(known.present)),
        ),
    )
    order = spread.order_of_facets()
    facets = FacingFacets(**{n: array[order] for n, array in vars(known.facets).items()})
    return replace(spread, facets=facets)


def _body_labels(
    bodies: str | npt.ArrayLike, num_cells: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
    """Return the distinct labels and, for each parent cell, its body (the rank of its label)."""
    expected = f'expected EACH_CELL ("{EACH_CELL}") or one integer label for each of {num_cells}'
    if isinstance(bodies, str):
        if bodies != EACH_CELL:
            raise ValueError(f"bodies is {bodies!r}; {expected} cells.")
        return np.arange(num_cells), np.arange(num_cells, dtype=np.int32)
    if isinstance(bodies, MeshTags):
        raise TypeError(f"bodies is a MeshTags; {expected} cells: give its `values`.")
    given = np.asarray(bodies)
    if not np.issubdtype(given.dtype, np.integer):
        raise TypeError(f"bodies has dtype {given.dtype}; {expected} cells.")
    if given.shape != (num_cells,):
        raise ValueError(
            f"bodies has shape {given.shape}; {expected} cells, shape ({num_cells},), in the "
            "order of the mesh's own cells (`mesh.topology.original_cell_index` leads back to "
            "the order of the input)."
        )
    if given.size and given.min() < 0:
        cell = int(np.argmin(given >= 0))
        raise ValueError(f"bodies[{cell}] is {given[cell]}; labels must not be negative.")
    labels, body = np.unique(given, return_inverse=True)
    return labels.astype(np.int64), body.reshape(-1).astype(np.int32)


def _check_tags(tags: MeshTags, mesh: Mesh, dim: int, name: str, entities: str) -> None:
    """Raise unless `tags` are integer tags of entities of dimension `dim` of `mesh`."""
    if not isinstance(tags, MeshTags):
        raise TypeError(f"{name} is a {type(tags).__name__}; expected dolfinx.mesh.MeshTags.")
    if tags.dim != dim:
        raise ValueError(f"{name} has dimension {tags.dim}; expected tags of {entities}: {dim}.")
    if tags.topology is not mesh.topology._cpp_object:
        raise ValueError(f"{name} belongs to another mesh; expected tags of the mesh to explode.")
    if not np.issubdtype(tags.values.dtype, np.integer):
        raise TypeError(f"{name} has values of dtype {tags.values.dtype}; expected integers.")
    if np.any(np.diff(tags.indices) <= 0):
        raise ValueError(
            f"{name} names an entity twice or is not sorted; give each of the {entities} one tag."
        )


def _materials(cell_tags: MeshTags | None, mesh: Mesh, num_cells: int) -> npt.NDArray[np.int32]:
    """Return the tag of each parent cell of this rank, 1 if there are no tags."""
    if cell_tags is None:
        return np.ones(num_cells, dtype=np.int32)
    _check_tags(cell_tags, mesh, mesh.topology.dim, "cell_tags", "cells")
    own = cell_tags.indices < num_cells  # the others are known here and belong to other ranks
    if np.count_nonzero(own) != num_cells:
        tagged = np.zeros(num_cells, dtype=bool)
        tagged[cell_tags.indices[own]] = True
        raise ValueError(
            f"cell_tags leaves {np.count_nonzero(~tagged)} of {num_cells} cells without "
            f"a tag, the first of them cell {int(np.argmin(tagged))}; tag every cell."
        )
    return cell_tags.values[own].astype(np.int32)


def _facet_tag_array(
    facet_tags: MeshTags | None, mesh: Mesh
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the tagged parent facets and, for every parent facet, its tag or 0."""
    fdim = mesh.topology.dim - 1
    if facet_tags is not None:
        _check_tags(facet_tags, mesh, fdim, "facet_tags", "facets")
    mesh.topology.create_entities(fdim)
    facets = mesh.topology.index_map(fdim)
    tag = np.zeros(facets.size_local + facets.num_ghosts, dtype=np.int32)
    if facet_tags is None:
        return np.empty(0, dtype=np.int32), tag
    tag[facet_tags.indices] = facet_tags.values
    return facet_tags.indices, tag


def _exploded_facet_tags(
    exploded: Mesh,
    mesh: Mesh,
    cells_of_facet: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
    new_cell: npt.NDArray[np.int32],
    tagged: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
) -> MeshTags:
    """Hand the tags of the parent facets to their copies.

    A cell has the same vertices in the same order in both meshes, hence the same local facets.
    """
    tdim = mesh.topology.dim
    cells, local = cells_of_facet
    facets, tag = tagged
    cells, local = cells[facets], local[facets]
    there = cells >= 0
    copies = facets_of_cells(exploded)[new_cell[cells[there]], local[there]]
    values = np.broadcast_to(tag[facets, np.newaxis], cells.shape)[there]
    copies, first = np.unique(copies, return_index=True)
    return meshtags(exploded, tdim - 1, copies.astype(np.int32), values[first].astype(np.int32))


class _Meeting(NamedTuple):
    """Facets at which two cells of the parent mesh meet, as they lie or across the boundary."""

    #: cells, local_facets: shape (n, 2), int32
    cells: npt.NDArray[np.int32]
    local_facets: npt.NDArray[np.int32]
    #: shape (n, dim), from the facet of the first cell to that of the second, m
    translation: npt.NDArray[np.float64]
    tag: npt.NDArray[np.int32]  #: shape (n,), int32

    def take(self, which: npt.NDArray[np.bool_]) -> _Meeting:
        return _Meeting(*(a[which] for a in self))


def _meeting_cells(
    mesh: Mesh,
    cells_of_facet: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
    facet_tag: npt.NDArray[np.int32],
) -> _Meeting:
    """Facets inside the mesh."""
    cells, local = cells_of_facet
    inner = cells[:, 1] >= 0
    still = np.zeros((np.count_nonzero(inner), mesh.geometry.dim))
    return _Meeting(cells[inner], local[inner], still, facet_tag[inner])


def _meeting_across(
    cells_of_facet: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
    facet_tag: npt.NDArray[np.int32],
    pairs: FacetPairs,
) -> _Meeting:
    """Facets of a periodic cell's boundary; the pair has a tag if both facets bear it."""
    cells, local = cells_of_facet
    tags = facet_tag[pairs.facets]
    both = np.where(tags[:, 0] == tags[:, 1], tags[:, 0], 0).astype(np.int32)
    return _Meeting(cells[pairs.facets, 0], local[pairs.facets, 0], pairs.translation, both)


def _pairs_of_whole(
    mesh: Mesh,
    cells_of_facet: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
    facet_tag: npt.NDArray[np.int32],
    lattice: npt.NDArray[np.float64],
    voids: Sequence[int],
) -> FacetPairs:
    """Pairs of facets of a periodic cell's boundary."""
    from xper_fx.bodies.lattice import check_volume, match_facets, match_tolerance

    cells, local = cells_of_facet
    measure = cell_measure(mesh.topology.cell_name(), mesh.geometry.x[geometry_dofmap(mesh)])
    check_volume(float(measure.sum()), lattice, len(voids) > 0)
    outer = np.flatnonzero((cells[:, 1] < 0) & ~np.isin(facet_tag, list(voids)))
    nodes = facet_geometry_nodes(mesh, cells[outer, 0], local[outer, 0])
    x = mesh.geometry.x[nodes][:, :, : mesh.geometry.dim]
    pairs = match_facets(x, lattice, match_tolerance(x))
    return pairs._replace(facets=outer[pairs.facets])


def _pairs_known(
    mesh: Mesh,
    cells_of_facet: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
    facet_tag: npt.NDArray[np.int32],
    pair: npt.NDArray[np.int64],
) -> FacetPairs:
    """As `_pairs_of_whole`, of the cells that a rank knows, by the numbers `CellBorder` gives."""
    from xper_fx.bodies.lattice import FacetPairs

    cells, local = (array[:, 0] for array in cells_of_facet)
    number = pair[cells, local]
    order = np.argsort(number, kind="stable")
    same = np.flatnonzero((np.diff(number[order]) == 0) & (number[order][1:] >= 0))
    facets = order[np.column_stack([same, same + 1])]
    nodes = facet_geometry_nodes(mesh, cells[facets].ravel(), local[facets].ravel())
    middle = midpoints_of(mesh.geometry.x[:, : mesh.geometry.dim], nodes)
    middle = middle.reshape(*facets.shape, mesh.geometry.dim)
    return FacetPairs(facets, middle[:, 1] - middle[:, 0])


def _facing_facets(
    mesh: Mesh,
    meeting: _Meeting,
    new_cell: npt.NDArray[np.int32],
    body_of_parent: npt.NDArray[np.int32],
    material: npt.NDArray[np.int32],
) -> FacingFacets:
    """Give facets sides, normals and an order; those across a boundary lie at the antagonist's."""
    cells, local, translation, tag = meeting
    cells, local = cells.copy(), local.copy()
    dim = mesh.topology.dim
    x = mesh.geometry.x[:, :dim].astype(np.float64)
    dofmap = geometry_dofmap(mesh)
    nodes = facet_geometry_nodes(mesh, cells[:, 0], local[:, 0])
    vertices = x[nodes]
    midpoint = midpoints_of(x, nodes)
    centre = midpoints_of(x, dofmap)

    area = _vector_area(vertices)
    measure = np.linalg.norm(area, axis=1)
    normal = area / measure[:, np.newaxis]
    deciding = np.argmax(np.abs(normal) > _NEGLIGIBLE_COMPONENT, axis=1)
    backward = normal[np.arange(len(normal)), deciding] < 0
    normal[backward] *= -1

    # the candidate is the cell into which the normal points
    centres = (centre[cells[:, 0]], centre[cells[:, 1]] - translation)
    inside = [np.einsum("ij,ij->i", c - midpoint, normal) for c in centres]
    same = np.flatnonzero(inside[0] * inside[1] >= 0)
    if same.size:
        a, b = cells[same[0]]
        raise ValueError(
            f"Cells {a} and {b} lie on the same side of the facet they share, at "
            f"{midpoint[same[0]].tolist()}: they overlap. Mend the mesh."
        )
    swap = inside[0] < 0
    cells[swap] = cells[swap, ::-1]
    local[swap] = local[swap, ::-1]
    midpoint[~swap] += translation[~swap]
    # from the candidate's facet to the antagonist's
    translation = np.where(swap[:, np.newaxis], -translation, translation)

    # vertices of the candidate's facet, turning round the normal, and their partners
    table = local_facet_vertices(mesh)
    candidate = table[local[:, 0]]
    order = _order_round_normal(x[dofmap[cells[:, :1], candidate]], normal)
    candidate = np.take_along_axis(candidate, order, axis=1)
    antagonist = table[local[:, 1]]
    gap = (
        x[dofmap[cells[:, :1], candidate]][:, :, np.newaxis]
        + translation[:, np.newaxis, np.newaxis]
        - x[dofmap[cells[:, 1:], antagonist]][:, np.newaxis]
    )
    nearest = np.argmin(np.einsum("fijd,fijd->fij", gap, gap), axis=2)
    antagonist = np.take_along_axis(antagonist, nearest, axis=1)

    order = _lexicographic(midpoint)
    cells, local = cells[order], local[order]
    return FacingFacets(
        cells=new_cell[cells],
        local_facets=local,
        tag=tag[order],
        normal=normal[order],
        measure=measure[order],
        midpoint=midpoint[order],
        bodies=body_of_parent[cells],
        materials=material[cells],
        local_vertices=np.stack((candidate, antagonist), axis=1)[order].astype(np.int32),
    )


def facet_edges(cell: basix.CellType) -> list[list[int]]:
    """Return the edges of the facets of a cell by their vertices within the facet."""
    facet = {
        basix.CellType.triangle: basix.CellType.interval,
        basix.CellType.quadrilateral: basix.CellType.interval,
        basix.CellType.tetrahedron: basix.CellType.triangle,
        basix.CellType.hexahedron: basix.CellType.quadrilateral,
    }[cell]
    return basix.topology(facet)[1]


def _vector_area(vertices: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return measure times normal of facets, vertices of shape (n, k, dim), shape (n, dim).

    Vertices turn round the result counterclockwise (3D); it is the direction from vertex 0 to
    vertex 1 turned by -90 degrees (2D).
    """
    if vertices.shape[2] == 2:
        along = vertices[:, 1] - vertices[:, 0]
        return np.stack((along[:, 1], -along[:, 0]), axis=1)
    if vertices.shape[1] == 3:
        return 0.5 * np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    return 0.5 * np.cross(vertices[:, 3] - vertices[:, 0], vertices[:, 2] - vertices[:, 1])


def _order_round_normal(
    vertices: npt.NDArray[np.float64], normal: npt.NDArray[np.float64]
) -> npt.NDArray[np.intp]:
    """Return the order in which the vertices of each facet turn round its normal.

    Exchanging vertices 0 and 1 of an interval, and 1 and 2 of a triangle or of a quadrilateral in
    tensor-product order, turns a facet over.
    """
    num_vertices = vertices.shape[1]
    order = np.tile(np.arange(num_vertices), (len(vertices), 1))
    over = np.einsum("ij,ij->i", _vector_area(vertices), normal) < 0
    a, b = (0, 1) if num_vertices == 2 else (1, 2)
    order[np.ix_(over, (a, b))] = (b, a)
    return order


def _lexicographic(points: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Return the order of points by x, then y, then z, blind to rounding.

    Coordinates are ranked by the gaps between them rather than rounded to a grid, for points on
    the boundary between two grid values would be torn apart by rounding.
    """
    if len(points) == 0:
        return np.empty(0, dtype=np.intp)
    tolerance = _EQUAL_COORDINATE * np.ptp(points, axis=0).max()
    ranks = np.empty(points.shape, dtype=np.int64)
    for i, coordinate in enumerate(points.T):
        order = np.argsort(coordinate)
        ranks[order[0], i] = 0
        ranks[order[1:], i] = np.cumsum(np.diff(coordinate[order]) > tolerance)
    return np.lexsort(ranks.T[::-1])
