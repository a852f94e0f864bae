# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies: counts, matching nodes, orientation, tags, permutations and refusals."""

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    Mesh,
    create_box,
    create_interval,
    create_mesh,
    create_rectangle,
    create_submesh,
    exterior_facet_indices,
    locate_entities,
    meshtags,
)
from mpi4py import MPI

from xper_fx.bodies.explode import EACH_CELL, explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import SerialOnlyError, crossed_rectangle, tag_cells, tag_facets
from xper_fx.bodies.node_positions import node_positions
from xper_fx.bodies.partition import partition
from xper_fx.forms.compiled import compiled_form
from xper_fx.support.compat import create_exploded_mesh, geometry_dofmap

COMM = MPI.COMM_SELF
LOWER, UPPER = (-0.3, 0.2, 0.1), (1.1, 0.9, 1.3)


def box(cell: str, n: int = 3) -> Mesh:
    """Return a box of uneven sides, cut into n x (n + 1) (x n) blocks."""
    cell_type = CellType[cell] if hasattr(CellType, "__getitem__") else getattr(CellType, cell)
    if cell in ("triangle", "quadrilateral"):
        return create_rectangle(COMM, [LOWER[:2], UPPER[:2]], (n, n + 1), cell_type)
    return create_box(COMM, [LOWER, UPPER], (n, n + 1, n), cell_type)


CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")


def grains(mesh: Mesh) -> np.ndarray:
    """Label the cells 2 and 9 on either side of the middle of x."""
    x = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)[:, 0]
    return np.where(x < np.median(np.unique(x.round(9))) + 1e-9, 9, 2)


def renumbered(mesh: Mesh, seed: int) -> Mesh:
    """Return the same mesh with its cells and nodes shuffled and each cell's vertices turned."""
    rng = np.random.default_rng(seed)
    cells = geometry_dofmap(mesh).astype(np.int64)
    nodes = rng.permutation(len(mesh.geometry.x))
    x = np.empty((len(nodes), mesh.geometry.dim))
    x[nodes] = mesh.geometry.x[:, : mesh.geometry.dim]
    cells = nodes[cells][rng.permutation(len(cells))]
    if mesh.topology.cell_name() in ("triangle", "tetrahedron"):
        cells = rng.permuted(cells, axis=1)
    else:  # reflect along one axis of the reference cell
        cells = cells.reshape(len(cells), *(2,) * mesh.topology.dim)[:, ::-1].reshape(cells.shape)
    element = basix.ufl.element("Lagrange", mesh.topology.cell_name(), 1, shape=(x.shape[1],))
    return create_mesh(COMM, cells=cells, x=x, e=ufl.Mesh(element))


def space(mesh: Mesh, degree: int) -> fem.FunctionSpace:
    """Return the blocked Lagrange space of displacements."""
    return fem.functionspace(mesh, ("Lagrange", degree, (mesh.geometry.dim,)))


def test_counts_of_crossed_rectangle():
    """2 x 2 crossed quads: 16 triangles, 16 * 3 = 48 edges of which 8 are outside."""
    bodies = explode(crossed_rectangle((0, 0), (1, 1), (2, 2)))
    assert bodies.num_bodies == 16
    assert len(bodies.facets) == (48 - 8) // 2
    assert bodies.mesh.geometry.x.shape == (48, 3)
    assert bodies.mesh.topology.index_map(0).size_local == 48
    assert np.array_equal(bodies.body_of_cell, np.arange(16))
    assert np.array_equal(bodies.material_of_cell, np.ones(16))
    assert bodies.body_of_cell.dtype == bodies.facets.cells.dtype == np.int32
    assert len(bodies.facet_tags.indices) == 0


def test_counts_of_cube_of_tetrahedra():
    """2^3 cubes of 6 tetrahedra: 48 * 4 faces, 6 * 4 * 2 outside."""
    bodies = explode(create_box(COMM, [(0, 0, 0), (1, 1, 1)], (2, 2, 2)))
    assert bodies.num_bodies == 48
    assert len(bodies.facets) == (48 * 4 - 48) // 2
    assert bodies.mesh.topology.index_map(0).size_local == 48 * 4


def test_grains_stay_connected_inside_only():
    """Two halves of a crossed square: only the vertices of the middle line are doubled."""
    mesh = crossed_rectangle((0, 0), (1, 1), (4, 4))
    bodies = explode(mesh, grains(mesh))
    assert bodies.num_bodies == 2
    assert bodies.labels.tolist() == [2, 9]
    assert len(bodies.facets) == 4
    num_vertices = 25 + 16
    assert len(mesh.geometry.x) == num_vertices
    assert len(bodies.mesh.geometry.x) == num_vertices + 5
    V = space(bodies.mesh, 2)
    assert V.dofmap.index_map.size_global == (num_vertices + 5) + (16 * 4 + 40 + 4)
    assert np.allclose(bodies.facets.midpoint[:, 0], 0.5)
    # label 2 is the right half, into which the normal (1, 0) points
    assert np.array_equal(bodies.labels[bodies.facets.bodies], np.tile((2, 9), (4, 1)))


def test_one_body_is_the_mesh_itself():
    """One label: nothing faces anything and no vertex is doubled."""
    mesh = box("tetrahedron")
    bodies = explode(mesh, np.zeros(mesh.topology.index_map(3).size_local, dtype=np.uint8))
    assert bodies.num_bodies == 1
    assert len(bodies.facets) == 0
    assert len(bodies.mesh.geometry.x) == len(mesh.geometry.x)
    assert bodies.facing_nodes(space(bodies.mesh, 2)).shape == (0, 2, 6)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("by_grain", (False, True))
def test_parent_maps(cell, by_grain):
    """Parent maps lead to the same points; no vertex is shared by two bodies; cells keep order."""
    mesh = box(cell)
    bodies = explode(mesh, grains(mesh) if by_grain else EACH_CELL)
    x, parent_x = bodies.mesh.geometry.x, mesh.geometry.x
    assert np.array_equal(x, parent_x[bodies.parent_vertex])
    dofmap = geometry_dofmap(bodies.mesh)
    parent_dofmap = geometry_dofmap(mesh)
    assert np.array_equal(bodies.parent_vertex[dofmap], parent_dofmap[bodies.parent_cell])
    assert sorted(bodies.parent_cell) == list(range(len(parent_dofmap)))
    assert np.all(np.diff(bodies.body_of_cell) >= 0)
    owner = np.full(len(x), -1)
    owner[dofmap] = bodies.body_of_cell[:, None]
    assert np.array_equal(owner[dofmap], np.tile(bodies.body_of_cell[:, None], dofmap.shape[1]))
    vertex_of_cell = bodies.mesh.topology.connectivity(mesh.topology.dim, 0).array
    pairs = np.unique(np.stack((vertex_of_cell, dofmap.ravel())), axis=1)
    assert pairs.shape[1] == len(x)  # topology and geometry are cut alike
    if by_grain:
        assert np.array_equal(bodies.labels[bodies.body_of_cell], grains(mesh)[bodies.parent_cell])
        assert len(x) < dofmap.size


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("by_grain", (False, True))
def test_facing_nodes_coincide(cell, degree, by_grain):
    """Matched nodes coincide, lie on the facet in the documented order, on their own bodies."""
    mesh = renumbered(box(cell), 3)
    bodies = explode(mesh, grains(mesh) if by_grain else EACH_CELL)
    V = space(bodies.mesh, degree)
    nodes = bodies.facing_nodes(V)
    per_facet = {
        "triangle": (2, 3),
        "quadrilateral": (2, 3),
        "tetrahedron": (3, 6),
        "hexahedron": (4, 9),
    }
    assert nodes.shape == (len(bodies.facets), 2, per_facet[cell][degree - 1])
    assert nodes.dtype == np.int32
    x = V.tabulate_dof_coordinates()
    assert np.abs(x[nodes[:, 0]] - x[nodes[:, 1]]).max() <= 1e-14 * np.abs(x).max()
    exact = node_positions(V)
    assert np.abs(exact - x).max() <= 1e-14 * np.abs(x).max()
    assert np.array_equal(exact[nodes[:, 0]], exact[nodes[:, 1]])
    # each node is in the dof map of its own side's cell, and no node is listed twice
    for side in (0, 1):
        rows = V.dofmap.list[bodies.facets.cells[:, side]]
        assert np.all((nodes[:, side, :, None] == rows[:, None, :]).any(axis=2))
    assert all(len(set(row)) == len(row) for row in nodes.reshape(len(nodes), -1).tolist())
    on_side = x[nodes[:, 0]][:, :, : mesh.geometry.dim]
    off = np.einsum("fki,fi->fk", on_side - bodies.facets.midpoint[:, None], bodies.facets.normal)
    assert np.abs(off).max() < 1e-14
    k = per_facet[cell][0]
    v = on_side[:, :k]
    assert np.allclose(v.mean(axis=1), bodies.facets.midpoint, rtol=0, atol=1e-14)
    if degree == 2:
        edges = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)], 4: [(0, 1), (0, 2), (1, 3), (2, 3)]}[k]
        middles = [0.5 * (v[:, a] + v[:, b]) for a, b in edges]
        if k == 4:
            middles.append(v.mean(axis=1))
        assert np.allclose(on_side[:, k:], np.stack(middles, axis=1), rtol=0, atol=1e-14)
    # the vertices turn round the normal
    if k == 2:
        along = v[:, 1] - v[:, 0]
        around = np.stack((along[:, 1], -along[:, 0]), axis=1)
    else:
        around = np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0])
    assert np.all(np.einsum("ij,ij->i", around, bodies.facets.normal) > 0)


def test_facing_nodes_of_a_scalar_space():
    """A scalar space has the same nodes as the blocked one."""
    bodies = explode(box("triangle"))
    scalar = fem.functionspace(bodies.mesh, ("Lagrange", 2))
    assert np.array_equal(bodies.facing_nodes(scalar), bodies.facing_nodes(space(bodies.mesh, 2)))


def test_measures_and_normals_against_closed_form():
    """Crossed squares of side s: half the facets' length along the axes, half the diagonals."""
    n, s = 6, 0.25
    bodies = explode(crossed_rectangle((1, 2), (1 + n * s, 2 + n * s), (n, n)))
    facets = bodies.facets
    axis = np.isclose(np.abs(facets.normal), 1).any(axis=1)
    assert axis.sum() == 2 * n * (n - 1)
    assert np.allclose(facets.measure[axis], s)
    assert np.allclose(facets.measure[~axis], s / np.sqrt(2))
    assert np.isclose(facets.measure[~axis].sum(), 4 * n * n * s / np.sqrt(2))
    assert np.allclose(np.linalg.norm(facets.normal, axis=1), 1, rtol=0, atol=1e-15)
    # diagonals: (1, 1) and (1, -1) cancel in y
    sum_ = facets.measure @ facets.normal
    assert np.allclose(sum_, (n * (n - 1) * s + 2 * n * n * s, n * (n - 1) * s))


@pytest.mark.parametrize("cell", CELLS)
def test_closed_surfaces(cell):
    """Around each cell the outward measures close and give its volume by the divergence theorem."""
    mesh = renumbered(box(cell), 5)
    dim = mesh.geometry.dim
    bodies = explode(mesh)
    facets = bodies.facets
    volume = np.zeros(bodies.num_bodies)
    outward = np.zeros((bodies.num_bodies, dim))
    for side, sign in ((0, -1.0), (1, 1.0)):  # the normal points into the candidate
        vector = sign * facets.measure[:, None] * facets.normal
        np.add.at(outward, facets.bodies[:, side], vector)
        np.add.at(
            volume, facets.bodies[:, side], np.einsum("ij,ij->i", vector, facets.midpoint) / dim
        )
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    to_cell = mesh.topology.connectivity(tdim - 1, tdim)
    on_border = [to_cell.links(f)[0] for f in exterior_facet_indices(mesh.topology)]
    inner = np.setdiff1d(np.arange(bodies.num_bodies), on_border)
    assert len(inner) > 0
    extent = np.prod(np.subtract(UPPER, LOWER)[:dim])
    assert np.abs(outward[inner]).max() < 1e-14
    assert np.allclose(volume[inner], extent / bodies.num_bodies, rtol=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_orientation_and_order_do_not_depend_on_numbering(cell):
    """Facets of the renumbered mesh are the same, in the same order, with the same sides."""
    mesh = box(cell)

    def facets(mesh):
        tags = tag_cells(mesh, {4: lambda x: x[0] + 0.3 * x[1] > 0.55, 6: lambda x: x[0] < 0.1})
        bodies = explode(mesh, EACH_CELL, tags)
        facets = bodies.facets
        x = bodies.mesh.geometry.x[geometry_dofmap(bodies.mesh)].mean(axis=1)
        return facets, x[facets.cells][:, :, : mesh.geometry.dim]

    reference, reference_centres = facets(mesh)
    inside = np.einsum(
        "fsi,fi->fs", reference_centres - reference.midpoint[:, None], reference.normal
    )
    assert np.all(inside[:, 0] > 0)
    assert np.all(inside[:, 1] < 0)
    first = np.argmax(np.abs(reference.normal) > 1e-9, axis=1)
    assert np.all(reference.normal[np.arange(len(first)), first] > 0)
    assert len(np.unique(reference.materials)) == 3
    order = np.lexsort(reference.midpoint.round(7).T[::-1])
    assert np.array_equal(order, np.arange(len(reference)))
    for seed in range(3):
        other, centres = facets(renumbered(mesh, seed))
        assert np.allclose(other.midpoint, reference.midpoint, rtol=0, atol=1e-14)
        assert np.allclose(other.normal, reference.normal, rtol=0, atol=1e-13)
        assert np.allclose(other.measure, reference.measure, rtol=1e-13)
        assert np.allclose(centres, reference_centres, rtol=0, atol=1e-14)
        assert np.array_equal(other.materials, reference.materials)


def test_rounding_does_not_decide_the_orientation():
    """Crossed squares turned by 45 degrees: normals along y with an x of either sign, 1e-16."""
    mesh = crossed_rectangle((0, 0), (1, 1), (9, 9))
    x = mesh.geometry.x
    x[:, :2] = x[:, :2] @ np.array([(1, 1), (-1, 1)]) * np.sqrt(0.5)
    normal = explode(mesh).facets.normal
    along_y = np.abs(normal[:, 0]) < 1e-9
    assert np.any(normal[along_y, 0] < 0)  # otherwise this test sees nothing
    assert np.any(normal[along_y, 0] > 0)
    assert np.all(normal[along_y, 1] > 0)
    assert np.all(normal[~along_y, 0] > 0)


def test_tags_are_carried():
    """Exterior tags stay, tags between bodies are doubled, tags inside a body are not."""
    mesh = crossed_rectangle((0, 0), (1, 1), (4, 4))
    cell_tags = tag_cells(mesh, {3: lambda x: x[1] > 0.5})
    facet_tags = tag_facets(
        mesh,
        {
            10: lambda x: np.isclose(x[0], 0),
            11: lambda x: np.isclose(x[0], 0.5) & (x[1] < 0.5 + 1e-12),
        },
    )
    assert facet_tags.values.tolist().count(10) == 4
    assert facet_tags.values.tolist().count(11) == 2
    for labels, copies in ((EACH_CELL, 2), (grains(mesh), 2), (np.zeros(64, dtype=int), 1)):
        bodies = explode(mesh, labels, cell_tags, facet_tags)
        assert np.array_equal(bodies.material_of_cell, cell_tags.values[bodies.parent_cell])
        assert np.array_equal(bodies.cell_tags.values, bodies.material_of_cell)
        assert bodies.facet_tags.values.tolist().count(10) == 4
        assert bodies.facet_tags.values.tolist().count(11) == 2 * copies
        # the tagged facets are where they should be
        exploded = bodies.mesh
        vertices = exploded.topology.connectivity(1, 0)
        exploded.topology.create_connectivity(0, 2)
        node = np.empty(len(exploded.geometry.x), dtype=int)
        node[exploded.topology.connectivity(2, 0).array] = geometry_dofmap(exploded).ravel()
        for tag, x in ((10, 0.0), (11, 0.5)):
            for facet in bodies.facet_tags.find(tag):
                assert np.allclose(exploded.geometry.x[node[vertices.links(facet)], 0], x)
        facets = bodies.facets
        precrack = facets.tag == 11
        assert precrack.sum() == (2 if copies == 2 else 0)
        assert np.all(facets.tag[~precrack] == 0)
        assert np.allclose(facets.midpoint[precrack, 0], 0.5)
        assert np.all(facets.midpoint[precrack, 1] < 0.5)
        assert np.array_equal(facets.materials, bodies.material_of_cell[facets.cells])
        assert np.array_equal(facets.bodies, bodies.body_of_cell[facets.cells])


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("by_grain", (False, True))
def test_node_permutation(cell, degree, by_grain):
    """Nodes come body by body; where each cell is a body, in the order of its dof map row."""
    mesh = box(cell)
    bodies = explode(mesh, grains(mesh) if by_grain else EACH_CELL)
    V = space(bodies.mesh, degree)
    node_order, offsets = bodies.node_permutation(V)
    assert offsets[0] == 0
    assert offsets[-1] == len(node_order) == V.dofmap.index_map.size_local
    assert np.array_equal(np.sort(node_order), np.arange(len(node_order)))
    for b in range(bodies.num_bodies):
        own = node_order[offsets[b] : offsets[b + 1]]
        rows = V.dofmap.list[bodies.body_of_cell == b]
        assert set(own) == set(rows.ravel())
        if by_grain:
            named = list(dict.fromkeys(rows.ravel().tolist()))
            assert own.tolist() == named
        else:
            assert np.array_equal(own, rows[0])


def test_the_exploded_mesh_is_a_mesh():
    """Forms assemble on it: volume and boundary are right, and bodies do not feel each other."""
    mesh = crossed_rectangle((0, 0), (2, 1), (4, 2))
    bodies = explode(mesh, EACH_CELL, facet_tags=tag_facets(mesh, {5: lambda x: x[0] < 1e-9}))
    one = fem.Constant(bodies.mesh, 1.0)
    assert np.isclose(fem.assemble_scalar(compiled_form(one * ufl.dx(bodies.mesh))), 2.0)
    ds = ufl.Measure("ds", bodies.mesh, subdomain_data=bodies.facet_tags)
    assert np.isclose(fem.assemble_scalar(compiled_form(one * ds(5))), 1.0)
    V = fem.functionspace(bodies.mesh, ("Lagrange", 1))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    A = fem.assemble_matrix(compiled_form(u * v * ufl.dx)).to_scipy().tocoo()
    body = np.empty(V.dofmap.index_map.size_local, dtype=int)
    body[V.dofmap.list] = bodies.body_of_cell[:, None]
    assert np.array_equal(body[A.row], body[A.col])


@pytest.mark.slow
def test_growth_is_linear():
    """16 times the cells may take 40 times the time, not the 256 of an O(n^2) way."""
    from time import process_time

    def seconds(n):
        mesh = crossed_rectangle((0, 0), (1, 1), (n, n))
        best = np.inf
        for _ in range(3):
            start = process_time()
            explode(mesh)
            best = min(best, process_time() - start)
        return best

    seconds(4)
    assert seconds(160) < 40 * seconds(40)


def two_triangles(x, cells):
    """Return a mesh of triangles given by hand, in the order given."""
    cells = np.array(cells, dtype=np.int64)
    return create_exploded_mesh(crossed_rectangle((0, 0), (1, 1), (1, 1)), cells, np.array(x))


class TestRefusals:
    """Bad input is refused with what was given and what was expected."""

    mesh = crossed_rectangle((0, 0), (1, 1), (2, 2))

    @pytest.mark.parametrize(
        ("bodies", "error", "message"),
        (
            ("each", ValueError, "'each'; expected EACH_CELL"),
            (np.zeros(15, dtype=int), ValueError, r"shape \(15,\).*each of 16"),
            (np.zeros((16, 1), dtype=int), ValueError, r"shape \(16, 1\)"),
            (np.zeros(16), TypeError, "float64"),
            (np.zeros(16, dtype=bool), TypeError, "bool"),
            (np.arange(16) - 3, ValueError, r"bodies\[0\] is -3.*negative"),
            (tag_cells(mesh, {}), TypeError, "MeshTags.*values"),
        ),
    )
    def test_labels(self, bodies, error, message):
        """Labels of a wrong kind, shape or sign."""
        with pytest.raises(error, match=message):
            explode(self.mesh, bodies)

    def test_tags(self):
        """Tags of another dimension, mesh or type, and cells without a tag."""
        some = np.arange(16, dtype=np.int32)
        with pytest.raises(ValueError, match="cell_tags has dimension 1; expected.*cells: 2"):
            explode(self.mesh, cell_tags=tag_facets(self.mesh, {}))
        with pytest.raises(ValueError, match="facet_tags has dimension 2; expected.*facets: 1"):
            explode(self.mesh, facet_tags=tag_cells(self.mesh, {}))
        with pytest.raises(ValueError, match="leaves 2 of 16 cells.*first of them cell 3"):
            kept = np.delete(some, (3, 7))
            explode(self.mesh, cell_tags=meshtags(self.mesh, 2, kept, kept))
        with pytest.raises(ValueError, match="another mesh"):
            other = crossed_rectangle((0, 0), (1, 1), (2, 2))
            explode(self.mesh, cell_tags=tag_cells(other, {}))
        with pytest.raises(TypeError, match="ndarray; expected dolfinx.mesh.MeshTags"):
            explode(self.mesh, cell_tags=some)
        with pytest.raises(TypeError, match="float64; expected integers"):
            explode(self.mesh, cell_tags=meshtags(self.mesh, 2, some, some / 2))

    def test_non_manifold(self):
        """A facet shared by three cells."""
        x = [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0), (0.5, -1.0), (0.7, -1.5)]
        mesh = two_triangles(x, [(0, 1, 2), (0, 1, 3), (1, 0, 4)])
        with pytest.raises(ValueError, match=r"shared by 3 cells, \[0, 1, 2\]"):
            explode(mesh)

    def test_overlapping_cells(self):
        """Two cells on the same side of their common facet."""
        x = [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0), (0.6, 0.5)]
        with pytest.raises(ValueError, match="Cells 0 and 1 lie on the same side"):
            explode(two_triangles(x, [(0, 1, 2), (0, 1, 3)]))

    @pytest.mark.parametrize("apex", ((2.0, 2e-14), (np.nan, 1.0)))
    def test_degenerate_cell(self, apex):
        """A cell without volume, or with a vertex that is not a number, is named."""
        x = [(0.0, 0.0), (1.0, 0.0), (0.5, 1.0), apex]
        with pytest.raises(ValueError, match=r"Cell 1 has zero volume.*\(1.0, 0.0\)"):
            explode(two_triangles(x, [(0, 1, 2), (1, 0, 3)]))

    def test_folded_quadrilateral(self):
        """A quadrilateral whose vertices go round instead of row by row."""
        element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
        x = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
        mesh = create_mesh(COMM, cells=np.array([[0, 1, 2, 3]]), x=x, e=ufl.Mesh(element))
        with pytest.raises(ValueError, match="Cell 0 has zero volume or is folded"):
            explode(mesh)

    def test_kind_of_mesh(self):
        """Curved geometry, manifolds in space, other dimensions, no mesh at all."""
        element = basix.ufl.element("Lagrange", "triangle", 2, shape=(2,))
        x = np.array([(0.0, 0.0), (1, 0), (0, 1), (0.5, 0.6), (0, 0.5), (0.5, 0)])
        curved = create_mesh(COMM, cells=np.arange(6).reshape(1, 6), x=x, e=ufl.Mesh(element))
        with pytest.raises(ValueError, match="geometry of order 2; expected order 1"):
            explode(curved)
        element = basix.ufl.element("Lagrange", "triangle", 1, shape=(3,))
        shell = create_mesh(
            COMM, cells=np.arange(3).reshape(1, 3), x=np.eye(3), e=ufl.Mesh(element)
        )
        with pytest.raises(ValueError, match="dimension 2 in space of dimension 3"):
            explode(shell)
        with pytest.raises(ValueError, match="cells of type interval; expected one of triangle"):
            explode(create_interval(COMM, 2, (0, 1)))
        with pytest.raises(TypeError, match="str; expected dolfinx.mesh.Mesh"):
            explode("mesh.msh")

    def test_several_processes(self, monkeypatch):
        """A mesh on two processes, feigned by its communicator."""
        mesh = crossed_rectangle((0, 0), (1, 1), (1, 1))

        class TwoProcesses:
            size = 2

        monkeypatch.setattr(type(mesh), "comm", TwoProcesses())
        for error in (SerialOnlyError, ValueError, NotImplementedError):
            with pytest.raises(error, match="spread over 2 processes"):
                partition(mesh, 2)
            with pytest.raises(error, match="spread over 2 processes"):
                join_meshes([mesh])

    def test_spaces(self):
        """Spaces on another mesh, discontinuous, of order 3, or mixed."""
        bodies = explode(self.mesh)
        taylor_hood = basix.ufl.mixed_element(
            [
                basix.ufl.element("Lagrange", "triangle", 2, shape=(2,)),
                basix.ufl.element("Lagrange", "triangle", 1),
            ]
        )
        with pytest.raises(ValueError, match="another mesh"):
            bodies.facing_nodes(space(self.mesh, 1))
        for element in (("DG", 1, (2,)), ("Lagrange", 3, (2,)), ("DG", 0), taylor_hood):
            V = fem.functionspace(bodies.mesh, element)
            for ask in (bodies.facing_nodes, bodies.node_permutation):
                with pytest.raises(ValueError, match="expected continuous Lagrange of order 1"):
                    ask(V)


def test_a_part_of_a_mesh_is_cut():
    """DOLFINx numbers no cells of what a submesh was made from."""
    mesh = create_rectangle(COMM, [(0.0, 0.0), (1.0, 1.0)], (4, 4))
    left = locate_entities(mesh, 2, lambda x: x[0] < 0.5 + 1e-9)
    bodies = explode(create_submesh(mesh, 2, left)[0])
    assert bodies.num_bodies == len(left) == 16
    assert np.array_equal(bodies.parent_cell, bodies.mesh.topology.original_cell_index)
