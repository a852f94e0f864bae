# SPDX-License-Identifier: LGPL-3.0-or-later
"""Facets across a periodic cell's boundary: counts, translations, sides, ties, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from cells import VOID, cell_of, moved, without, wrap
from dolfinx import fem
from scenes import box_bodies, mesh_of, midpoints

from xper_fx.bodies.explode import EACH_CELL, explode
from xper_fx.bodies.lattice import check_volume, checked_lattice, match_facets, translates
from xper_fx.bodies.meshes import tag_facets
from xper_fx.support.compat import geometry_dofmap

# kind, lengths, cells, pairs of facets on the boundary
BOXES = [
    ("crossed", (2.0, 3.0), (2, 4), 2 + 4),
    ("triangle", (2.0, 3.0), (2, 4), 2 + 4),
    ("quadrilateral", (2.0, 3.0), (2, 4), 2 + 4),
    ("tetrahedron", (1.0, 2.0, 3.0), (2, 3, 4), 2 * (6 + 12 + 8)),
    ("hexahedron", (1.0, 2.0, 3.0), (2, 3, 4), 6 + 12 + 8),
]
# cells, facets of a cell inside a periodic medium, nodes of it of order 1 and 2, all a block
PER_BLOCK = {
    "crossed": (4, 3, 2, 8),
    "triangle": (2, 3, 1, 4),
    "quadrilateral": (1, 4, 1, 4),
    "tetrahedron": (6, 4, 1, 8),
    "hexahedron": (1, 6, 1, 8),
}


def space(bodies, degree):
    dim = bodies.mesh.geometry.dim
    return fem.functionspace(bodies.mesh, ("Lagrange", degree, (dim,)))


def facing(bodies, degree=1, facets="facing"):
    """Coordinates of matched nodes, shape (n, 2, k, dim)."""
    V = space(bodies, degree)
    nodes = bodies.nodes_on_facets(V, bodies.facets if facets == "facing" else bodies.ties)
    return V.tabulate_dof_coordinates()[nodes][..., : bodies.mesh.geometry.dim]


def signature(facets, lattice):
    """Rows (midpoint modulo the lattice, normal, measure), sorted."""
    rows = np.column_stack([wrap(facets.midpoint, lattice), facets.normal, facets.measure])
    rows = rows.round(8) + 0.0
    return rows[np.lexsort(rows.T[::-1])]


@pytest.mark.parametrize("kind, lengths, cells, pairs", BOXES, ids=[b[0] for b in BOXES])
@pytest.mark.parametrize("degree", (1, 2))
def test_facets_across_a_box(kind, lengths, cells, pairs, degree):
    """X_a - X_c is the period along the normal on the boundary's facets, zero inside.

    A torus has no outside: facing facets = cells * facets a cell / 2.
    """
    bodies = cell_of(lengths, cells, kind, label=None)
    count, sides = PER_BLOCK[kind][:2]
    blocks = int(np.prod(cells))
    facets = bodies.facets
    assert len(facets) == count * blocks * sides // 2
    assert len(bodies.ties) == 0
    x = facing(bodies, degree)
    jump = x[:, 1] - x[:, 0]
    assert np.abs(jump - jump[:, :1]).max() < 1e-13  # all nodes of a facet move alike
    across = np.abs(jump[:, 0]).max(axis=1) > 1e-9
    assert np.count_nonzero(across) == pairs
    axis = np.argmax(facets.normal[across], axis=1)
    assert facets.normal[across] == pytest.approx(np.eye(len(cells))[axis], abs=1e-14)
    assert jump[across, 0] == pytest.approx(np.diag(lengths)[axis], abs=1e-13)
    # opposite sides have as many facets as blocks, twice as many for tetrahedra
    twice = 2 if kind == "tetrahedron" else 1
    assert np.bincount(axis).tolist() == [twice * blocks // n for n in cells]
    # the pair lies where its antagonist lies, and its nodes' mean is its midpoint (order 1)
    if degree == 1:
        assert x[:, 1].mean(axis=1) == pytest.approx(facets.midpoint, abs=1e-13)


@pytest.mark.parametrize("kind, lengths, cells, pairs", BOXES, ids=[b[0] for b in BOXES])
def test_sides_of_a_periodic_facet(kind, lengths, cells, pairs):
    """n points from antagonist to candidate, once the candidate stands beside its antagonist."""
    bodies = cell_of(lengths, cells, kind, label=None)
    facets = bodies.facets
    x = facing(bodies)
    centre = midpoints(bodies.mesh).T[:, : len(lengths)]
    translation = x[:, 1, 0] - x[:, 0, 0]
    towards = [
        centre[facets.cells[:, 0]] + translation - facets.midpoint,
        centre[facets.cells[:, 1]] - facets.midpoint,
    ]
    assert np.all(np.einsum("fi,fi->f", towards[0], facets.normal) > 0)
    assert np.all(np.einsum("fi,fi->f", towards[1], facets.normal) < 0)
    first = facets.normal[np.arange(len(facets)), np.argmax(np.abs(facets.normal) > 1e-9, axis=1)]
    assert np.all(first > 0)
    # each cell is closed on the torus: sum of outward areas is zero
    total = np.zeros((bodies.num_bodies, len(lengths)))
    for side, sign in ((0, -1.0), (1, 1.0)):
        np.add.at(total, facets.bodies[:, side], sign * facets.measure[:, None] * facets.normal)
    assert np.abs(total).max() < 1e-13


@pytest.mark.parametrize("shear", (0.5, -0.3, 1.25))
def test_oblique_lattice_and_its_other_bases(shear):
    """A sheared cell has rows (L, 0), (s H, H); any basis of that lattice gives the same facets."""
    lengths, cells = (2.0, 3.0), (4, 3)
    mesh = mesh_of(lengths, cells)
    mesh.geometry.x[:, 0] += shear * mesh.geometry.x[:, 1]
    a, b = np.array([2.0, 0.0]), np.array([shear * 3.0, 3.0])
    reference = explode(mesh, lattice=np.array([a, b]))
    assert len(reference.facets) == 4 * 12 * 3 // 2
    x = facing(reference)
    jump = np.unique((x[:, 1] - x[:, 0]).reshape(-1, 2).round(9) + 0.0, axis=0)
    # from the candidate to the antagonist along the normals (1, -s) and (0, 1)
    assert jump == pytest.approx(np.unique([[0.0, 0.0], a, b], axis=0), abs=1e-9)
    for other in ([a, a + b], [-b, a], [3 * a + b, -a]):
        bodies = explode(mesh, lattice=np.array(other))
        assert signature(bodies.facets, np.array([a, b])) == pytest.approx(
            signature(reference.facets, np.array([a, b]))
        )
        assert np.array_equal(bodies.facets.bodies, reference.facets.bodies)


def test_running_bond():
    """A box whose rows are offset by a column, rows (L, 0), (L / 4, H): top meets bottom askew."""
    bodies = explode(mesh_of((4, 2), (4, 2), "quadrilateral"), lattice=[(4, 0), (1, 2)])
    assert len(bodies.facets) == 16
    x = facing(bodies)
    jump = x[:, 1, 0] - x[:, 0, 0]
    up = np.isclose(jump[:, 1], 2.0)
    assert np.count_nonzero(up) == 4
    # three columns find their partner one to the right, the last at the other end
    assert sorted(jump[up, 0].round(9)) == [-3.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize("kind, lengths, cells, pairs", BOXES, ids=[b[0] for b in BOXES])
def test_a_jagged_cell_is_the_same_medium(kind, lengths, cells, pairs):
    """Blocks moved by periods, at random: the same facets modulo the lattice, the same torus."""
    lattice = np.diag(lengths)
    box = mesh_of(lengths, cells, kind)
    block = np.floor(midpoints(box)[: len(cells)].T / (np.array(lengths) / cells)).astype(int)
    number = np.ravel_multi_index(block.T, cells)
    rng = np.random.default_rng(3)
    shifts = rng.integers(-1, 2, size=(np.prod(cells), len(cells))) @ lattice
    jagged = moved(box, shifts[number])
    reference = explode(box, lattice=lengths)
    bodies = explode(jagged, lattice=lengths)
    assert signature(bodies.facets, lattice) == pytest.approx(
        signature(reference.facets, lattice), abs=1e-7
    )
    x = facing(bodies)
    apart = (x[:, 1] - x[:, 0]) @ np.linalg.inv(lattice)
    assert np.abs(apart - np.round(apart)).max() < 1e-9
    assert np.abs(apart).max() > 1.5  # some are moved by two periods against each other
    one = np.zeros(len(number), int)
    for degree in (1, 2):
        whole = explode(jagged, one, lattice=lengths)
        count = PER_BLOCK[kind][1 + degree] * np.prod(cells)
        assert whole.node_classes(space(whole, degree))[1] == count
        assert len(whole.facets) == 0


@pytest.mark.parametrize("kind, lengths, cells, pairs", BOXES, ids=[b[0] for b in BOXES])
@pytest.mark.parametrize("degree", (1, 2))
def test_node_classes_of_a_torus(kind, lengths, cells, pairs, degree):
    """Classes are the nodes of the torus: as many as nodes a block, each one point modulo L."""
    bodies = cell_of(lengths, cells, kind)
    assert len(bodies.facets) == 0
    assert len(bodies.ties) == pairs
    V = space(bodies, degree)
    classes, number = bodies.node_classes(V)
    assert classes.dtype == np.int32
    assert number == PER_BLOCK[kind][1 + degree] * np.prod(cells)
    x = wrap(V.tabulate_dof_coordinates()[:, : len(cells)], np.diag(lengths))
    _, first = np.unique(classes, return_index=True)
    assert np.array_equal(first, np.sort(first))  # in the order of their first nodes
    assert np.abs(x - x[first[classes]]).max() < 1e-12
    assert len(np.unique(x[first].round(9), axis=0)) == number
    # cut into bodies of a cell each, nothing is tied
    apart = cell_of(lengths, cells, kind, label=None)
    alone, count = apart.node_classes(space(apart, degree))
    assert count == len(alone)


def test_a_grain_across_the_boundary_is_tied_to_itself():
    """Labels 0 (0.5 < x < 1.5) and 1: 1 goes on over x = 0, both over y = 0."""
    label = lambda x: (x[0] < 0.5) | (x[0] > 1.5)  # noqa: E731
    bodies = cell_of((2, 1), (4, 2), label=label)
    assert bodies.num_bodies == 2
    assert sorted(bodies.facets.midpoint[:, 0].round(9)) == [0.5, 0.5, 1.5, 1.5]
    normal = bodies.ties.normal
    assert np.count_nonzero(normal[:, 0] > 0.5) == 2  # x = 0, label 1
    assert np.count_nonzero(normal[:, 1] > 0.5) == 4  # y = 0, both
    assert np.all(bodies.ties.bodies[:, 0] == bodies.ties.bodies[:, 1])


@pytest.mark.parametrize(
    "kind, cells, facets, ties",
    [
        ("quadrilateral", (1, 1), 0, 2),
        ("quadrilateral", (1, 3), 3, 3),
        ("quadrilateral", (2, 1), 2, 2),
        ("crossed", (1, 1), 4 + 2, 0),
        ("triangle", (1, 1), 3, 0),
        ("hexahedron", (1, 1, 1), 0, 3),
        ("hexahedron", (1, 1, 2), 2, 4),
        ("tetrahedron", (1, 1, 1), 12, 0),
    ],
)
def test_cells_one_wide(kind, cells, facets, ties):
    """A cell that faces itself is tied; two that meet twice face each other twice."""
    lengths = np.arange(1.0, len(cells) + 1)
    bodies = cell_of(lengths, cells, kind, label=None)
    assert (len(bodies.facets), len(bodies.ties)) == (facets, ties)
    if facets == 0:
        assert bodies.node_classes(space(bodies, 1))[1] == 1


def test_tags_of_periodic_facets():
    """A pair bears a tag if both its facets do; the copies of the boundary keep theirs."""
    mesh = mesh_of((2, 1), (4, 2))
    tags = tag_facets(
        mesh,
        {
            5: lambda x: np.isclose(x[0], 0.0) | np.isclose(x[0], 2.0),
            6: lambda x: np.isclose(x[1], 0.0),
            7: lambda x: np.isclose(x[1], 1.0) & (x[0] < 1.01),
        },
    )
    bodies = explode(mesh, facet_tags=tags, lattice=(2, 1))
    x = facing(bodies)
    across = np.linalg.norm(x[:, 1, 0] - x[:, 0, 0], axis=1) > 1e-9
    normal, tag = bodies.facets.normal, bodies.facets.tag
    assert tag[across & (normal[:, 0] > 0.9)].tolist() == [5, 5]
    assert tag[across & (normal[:, 1] > 0.9)].tolist() == [0, 0, 0, 0]
    assert np.all(tag[~across] == 0)
    assert [len(bodies.facet_tags.find(t)) for t in (5, 6, 7)] == [4, 4, 2]


def test_a_lattice_alone_changes_nothing_inside():
    """Facets inside, vertices and maps are those of the same mesh without a lattice."""
    lengths, cells = (2, 3), (2, 4)
    plain = box_bodies(lengths, cells)
    cell = cell_of(lengths, cells, label=None)
    assert np.array_equal(plain.mesh.geometry.x, cell.mesh.geometry.x)
    assert np.array_equal(plain.parent_cell, cell.parent_cell)
    x = facing(cell)
    inside = np.abs(x[:, 1] - x[:, 0]).max(axis=(1, 2)) < 1e-9
    assert np.array_equal(cell.facets.cells[inside], plain.facets.cells)
    assert plain.lattice is None and len(plain.ties) == 0
    assert cell.lattice == pytest.approx(np.diag([2.0, 3.0]))


# Voids


def hole_in_the_middle(x):
    return (np.abs(x[0] - 1.0) < 0.5) & (np.abs(x[1] - 1.0) < 0.5)


def test_a_void_faces_nothing():
    """A 2 x 2 hole in 4 x 4 quadrilaterals: 12 cells, (48 - 8) / 2 facets."""
    bodies = cell_of((2, 2), (4, 4), "quadrilateral", label=None, hole=hole_in_the_middle)
    assert bodies.num_bodies == 12
    assert len(bodies.facets) == 20
    assert len(bodies.facet_tags.find(VOID)) == 8


def test_a_void_across_the_boundary_faces_nothing():
    """The hole cut by the cell's corner: the same torus, 20 facets, no facing over the hole."""
    hole = lambda x: hole_in_the_middle((np.asarray(x) + 1.0) % 2.0)  # noqa: E731
    bodies = cell_of((2, 2), (4, 4), "quadrilateral", label=None, hole=hole)
    assert bodies.num_bodies == 12
    assert len(bodies.facets) == 20
    middle = cell_of((2, 2), (4, 4), "quadrilateral", label=None, hole=hole_in_the_middle)
    rows = middle.facets
    rows = np.column_stack([wrap(rows.midpoint + 1.0, 2 * np.eye(2)), rows.normal, rows.measure])
    rows = rows.round(8) + 0.0
    assert signature(bodies.facets, 2 * np.eye(2)) == pytest.approx(rows[np.lexsort(rows.T[::-1])])


def test_a_void_not_named_is_refused():
    """The surface of a hole has no translate; a missing volume is seen first."""
    mesh = without(mesh_of((2, 2), (4, 4)), hole_in_the_middle)
    with pytest.raises(ValueError, match=r"fill 3 of the 4 .*voids"):
        explode(mesh, lattice=(2, 2))
    tags = tag_facets(mesh, {VOID: lambda x: np.isclose(x[0], 0.5) & (np.abs(x[1] - 1) < 0.51)})
    with pytest.raises(ValueError, match=r"nodes on the cell's boundary .*voids"):
        explode(mesh, facet_tags=tags, lattice=(2, 2), voids=[VOID])


# Refusals


@pytest.mark.parametrize("factor", (1.0 + 1e-4, 0.5, 2.0))
def test_a_wrong_period_is_refused(factor):
    """|cells| differs from |lattice|."""
    with pytest.raises(ValueError, match=r"fill 6 of the .*give the periods of this mesh"):
        explode(mesh_of((2, 3), (2, 3)), lattice=(2 * factor, 3))


def test_periods_of_the_right_volume_and_wrong_lengths_name_nodes():
    """3 x 2 for a cell of 2 x 3: no volume tells, the nodes do."""
    with pytest.raises(ValueError, match=r"2 of 10 .*among them \(1\.0, 0\.0\); .*setPeriodic"):
        explode(mesh_of((2, 3), (2, 3)), lattice=(3, 2))


@pytest.mark.parametrize("kind", ("crossed", "quadrilateral", "tetrahedron", "hexahedron"))
def test_a_moved_node_is_named(kind):
    """One vertex of the boundary slides by 1e-3 along it: it and its partner are named."""
    lengths = (2.0, 2.0, 2.0)[: 3 if "hedron" in kind else 2]
    mesh = mesh_of(lengths, (2,) * len(lengths), kind)
    x = mesh.geometry.x
    place = [0.0, 1.0, 1.0][: len(lengths)]
    node = np.flatnonzero(np.abs(x[:, : len(lengths)] - place).max(axis=1) < 1e-9)[0]
    x[node, 1] += 1e-3
    with pytest.raises(ValueError) as caught:
        explode(mesh, lattice=lengths)
    message = str(caught.value)
    assert message.startswith("2 of ")
    assert "(0.0, 1.001" in message and "(2.0, 1.0" in message


def test_a_node_off_by_rounding_is_taken():
    """1e-8 of a facet is no gap; 1e-4 is."""
    mesh = mesh_of((2, 2), (2, 2))
    x = mesh.geometry.x
    node = np.flatnonzero(np.abs(x[:, :2] - [0.0, 1.0]).max(axis=1) < 1e-9)[0]
    x[node, 1] += 1e-8
    assert len(explode(mesh, lattice=(2, 2)).facets) == 24
    x[node, 1] += 1e-4
    with pytest.raises(ValueError, match="no translate"):
        explode(mesh, lattice=(2, 2))


def test_facets_that_share_vertices_only_are_refused():
    """Opposite faces cut along different diagonals: all nodes have translates, facets have not."""
    square = np.array([[0.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]])
    one, other = [[0, 1, 2], [1, 2, 3]], [[0, 1, 3], [0, 2, 3]]
    right = square + [1.0, 0, 0]
    match_facets(np.concatenate([square[one], right[one]]), np.eye(3), 1e-5)
    with pytest.raises(ValueError, match=r"facet of the cell's boundary at .* has 0 translates"):
        match_facets(np.concatenate([square[one], right[other]]), np.eye(3), 1e-5)


def test_pairs_on_their_own():
    """`match_facets` and `checked_lattice` by hand: two unit facets a period apart."""
    lattice = checked_lattice((2.0, 1.0), 2)
    assert np.array_equal(lattice, np.diag([2.0, 1.0]))
    facets = np.array([[[2.0, 0], [2.0, 1]], [[0.0, 1], [0.0, 0]]])
    pairs = match_facets(facets, lattice, 1e-5)
    assert pairs.facets.tolist() == [[0, 1]]
    assert pairs.translation == pytest.approx(np.array([[-2.0, 0.0]]))
    assert len(match_facets(np.zeros((0, 2, 2)), lattice, 1e-5).facets) == 0
    check_volume(2.0, lattice, voids=False)
    check_volume(1.0, lattice, voids=True)
    with pytest.raises(ValueError, match="fill 2.1 of the 2"):
        check_volume(2.1, lattice, voids=True)


@pytest.mark.parametrize("dim", (2, 3))
@pytest.mark.parametrize("far", (0.0, 1e6))
def test_far_from_the_origin(dim, far):
    """Coordinates of 1e6 periods leave the pairs what they are."""
    kind = "crossed" if dim == 2 else "tetrahedron"
    bodies = cell_of((1.0,) * dim, (3,) * dim, kind, label=None, shift=np.full(dim, far))
    assert len(bodies.facets) == {2: 9 * 4 * 3 // 2, 3: 27 * 6 * 4 // 2}[dim]


def test_labels_touching_at_a_vertex_do_not_depend_on_the_cut():
    """Two grains in checks, cut elsewhere: as many nodes of the periodic medium either way."""
    counts = []
    for shift in (0.0, 0.5):
        label = lambda x, s=shift: (np.floor(x[0] + s) + np.floor(x[1] + s)) % 2  # noqa: E731
        bodies = cell_of((2, 2), (4, 4), "quadrilateral", label=label)
        counts.append(bodies.node_classes(space(bodies, 1))[1])
    assert counts[0] == counts[1]


@pytest.mark.parametrize("by_cell", (True, False))
def test_cells_keep_their_place(by_cell):
    """An exploded jagged cell has the volume and the cells of its parent."""
    mesh = mesh_of((2, 1), (2, 1))
    x = midpoints(mesh)
    shifts = np.where(x[1] > 0.7, 2.0, 0.0)[:, None] * np.array([[1.0, 0.0]])
    mesh = moved(mesh, shifts)
    labels = EACH_CELL if by_cell else np.zeros(8, int)
    bodies = explode(mesh, labels, lattice=(2, 1))
    parent = mesh.geometry.x[geometry_dofmap(mesh)][bodies.parent_cell]
    assert np.array_equal(bodies.mesh.geometry.x[geometry_dofmap(bodies.mesh)], parent)


@pytest.mark.parametrize("dim", [2, 3])
def test_points_that_coincide_are_no_translates_of_each_other(dim):
    """Two points at one place each have the third as their translate."""
    lattice = np.diag([2.0, 1.0, 3.0][:dim])
    points = np.zeros((4, dim))
    points[2] = lattice[0]
    points[3] = 0.3
    np.testing.assert_array_equal(translates(points, lattice, 1e-9), [[0, 2], [1, 2]])
