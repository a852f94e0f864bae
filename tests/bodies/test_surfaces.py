# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of exploded meshes: what they are, and what breaking bonds does to their contacts."""

from __future__ import annotations

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_mesh, create_rectangle
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import crossed_rectangle, tag_cells, tag_facets
from xper_fx.bodies.surfaces import extract_surface
from xper_fx.nscd.rigid import Polygon, RigidBody
from xper_fx.nscd.rigid.bodies import RigidBodies
from xper_fx.nscd.search.edge_edge import BENT
from xper_fx.nscd.search.surface_search import SurfaceSearch
from xper_fx.support.compat import geometry_dofmap


def space(bodies, order=1):
    dim = bodies.mesh.geometry.dim
    return fem.functionspace(bodies.mesh, ("Lagrange", order, (dim,)))


def positions(V):
    return V.tabulate_dof_coordinates()[:, : V.mesh.geometry.dim].copy()


def box(cell, counts):
    if len(counts) == 2:
        return create_rectangle(MPI.COMM_SELF, [(0, 0), (2, 1)], counts, CellType[cell])
    return create_box(MPI.COMM_SELF, [(0, 0, 0), (2, 1, 1)], counts, CellType[cell])


CELLS = [
    ("triangle", (4, 3)),
    ("quadrilateral", (4, 3)),
    ("tetrahedron", (3, 2, 2)),
    ("hexahedron", (3, 2, 2)),
]


def test_facets_come_in_the_order_of_what_the_mesh_was_made_from():
    """Where facets are equally near, the first is touched, however ranks number cells."""
    made = box("tetrahedron", (3, 2, 2))
    cells = np.random.default_rng(1).permutation(geometry_dofmap(made)).astype(np.int64)
    mesh = create_mesh(MPI.COMM_SELF, cells=cells, x=made.geometry.x, e=made.ufl_domain())
    bodies = explode(mesh)
    surface = extract_surface(bodies, space(bodies))
    given = made.geometry.x[cells].mean(axis=1)
    middle = bodies.mesh.geometry.x[geometry_dofmap(bodies.mesh)].mean(axis=1)[surface.body]
    number = np.linalg.norm(middle[:, None] - given, axis=2).argmin(axis=1)
    assert np.all(np.diff(number) >= 0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell, counts", CELLS)
def test_facets_enclose_their_bodies(cell, counts, order):
    """The divergence theorem: sum of n . x over all facets of a body is dim times its volume."""
    bodies = explode(box(cell, counts))
    V = space(bodies, order)
    x = positions(V)
    surface = extract_surface(bodies, V)
    dim = surface.dim
    corner = x[surface.facets]
    if dim == 2:
        along = corner[:, 1] - corner[:, 0]
        area = np.stack([along[:, 1], -along[:, 0]], axis=1)
    else:
        area = 0.5 * np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    volume = np.bincount(surface.body, (area * corner.mean(axis=1)).sum(axis=1)) / dim
    assert volume == pytest.approx(2.0 / bodies.num_bodies, rel=1e-12)
    outer = surface.bond < 0
    assert surface.measure(x)[outer].sum() == pytest.approx(6.0 if dim == 2 else 10.0)
    # nodes that a bond joins coincide
    both = x[surface.bond_nodes]
    assert both[:, 0] == pytest.approx(both[:, 1], abs=1e-14)
    if cell in ("quadrilateral", "hexahedron"):
        heights = {round(length / n, 9) for length, n in zip((2, 1, 1), counts, strict=False)}
        assert set(np.round(surface.thickness, 9)) == heights


def test_groups_and_tags_choose_facets():
    mesh = crossed_rectangle((0, 0), (2, 1), (4, 2))
    tags = tag_cells(mesh, {1: lambda x: x[0] < 1, 2: lambda x: x[0] > 1})
    sides = tag_facets(mesh, {7: lambda x: x[0] > 2 - 1e-9})
    bodies = explode(mesh, tags.values, tags, sides)
    V = space(bodies)
    surface = extract_surface(bodies, V, {"left": [1], "right": [2]})
    x = positions(V)
    assert surface.groups == ("left", "right")
    assert (x[surface.facets].mean(axis=1)[:, 0] > 1)[surface.bond < 0].sum() == 6
    alone = extract_surface(bodies, V, {"right": [2]}, facet_tags=[7])
    outer = alone.bond < 0
    assert outer.sum() == 2
    assert x[alone.facets[outer], 0] == pytest.approx(2.0)
    assert len(alone) == 4
    with pytest.raises(ValueError, match=r"\[3\]"):
        extract_surface(bodies, V, {"left": [3]})
    with pytest.raises(ValueError, match="'a' and 'b'"):
        extract_surface(bodies, V, {"a": [1], "b": [1, 2]})
    with pytest.raises(ValueError, match=r"\[8\]"):
        extract_surface(bodies, V, facet_tags=[8])


def test_a_bonded_plate_does_not_touch_itself():
    """Every cell a body: no contact while bonds hold, whatever small openings there are."""
    bodies = explode(crossed_rectangle((0, 0), (1, 1), (4, 4)))
    V = space(bodies)
    x = positions(V)
    search = SurfaceSearch(extract_surface(bodies, V), x, 0.02)
    x += 1e-4 * np.random.default_rng(0).normal(size=x.shape)
    assert len(search.find(x)) == 0
    assert (search.bonds.fragment == 0).all()
    search.expose(np.arange(len(bodies.facets)))
    assert search.bonds.exposed.all()
    assert len(search.find(x)) == 0  # lips still meet by their bonds alone
    search.release(np.arange(len(bodies.facets)))
    assert (search.bonds.fragment == np.arange(64)).all()
    assert len(search.find(x)) > 500


def split_plate(order=1):
    """A plate of cells with the bonds along x = 1 / 2, and which nodes are right of it."""
    bodies = explode(crossed_rectangle((0, 0), (1, 1), (4, 4)))
    V = space(bodies, order)
    crack = np.flatnonzero(np.abs(bodies.facets.midpoint[:, 0] - 0.5) < 1e-9)
    right = np.zeros(len(positions(V)), bool)
    centre = bodies.mesh.geometry.x[bodies.mesh.geometry.dofmap].mean(axis=1)
    right[V.dofmap.list[centre[:, 0] > 0.5]] = True
    return bodies, V, crack, right


@pytest.mark.parametrize("order", [1, 2])
def test_halves_of_a_broken_plate_meet_again_elsewhere(order):
    """Halves part: one is set upon the other, then slid along the crack."""
    bodies, V, crack, right = split_plate(order)
    x = positions(V)
    search = SurfaceSearch(extract_surface(bodies, V), x, 0.02)
    x[right] += np.array([-0.5, 1.003])
    contacts = search.find(x)  # outer facets meet
    assert contacts.area.sum() == pytest.approx(0.5, abs=1e-12)
    assert contacts.gap == pytest.approx(0.003, abs=1e-12)
    # facets and a half up: lips of bonds that broke touch other lips
    shift = 0.625 if order == 1 else 0.5625
    x = positions(V)
    x[right] += np.array([0.004, shift])
    assert len(search.find(x)) == 0
    search.expose(crack)
    slid = search.find(x)
    search.release(crack)
    contacts = search.find(x)
    for found in (slid, contacts):  # far from where they parted bonds make no difference
        assert found.area.sum() == pytest.approx(1.0 - shift, abs=1e-12)
        assert found.gap == pytest.approx(0.004, abs=1e-12)
        assert np.abs(found.normal[:, 0]) == pytest.approx(1.0, abs=1e-12)
    assert len(np.unique(search.bonds.fragment)) == 2


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
def test_lips_of_a_crack_have_edges_of_their_own(cell, order):
    """Each half of a broken box has twelve, which move with it while the bond still welds them."""
    mesh = box(cell, (2, 1, 1))
    centre = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)
    bodies = explode(mesh, (centre[:, 0] > 1.0).astype(int))
    V = space(bodies, order)
    x = positions(V)
    search = SurfaceSearch(extract_surface(bodies, V), x, 0.02)
    facets, body = search.surface.facets, search.surface.body

    def bent():
        """Length of the edges that count, and their facets."""
        search.find(x)
        lists = search.lists
        counts = lists.bends < -BENT
        (first, corner), other = np.divmod(lists.edges[counts], 3), lists.others[counts]
        ends = x[facets[first, (corner + 1) % 3]] - x[facets[first, corner]]
        assert (first != other).all()
        return np.linalg.norm(ends, axis=1).sum(), first, other

    length, first, other = bent()
    assert length == pytest.approx(16.0, abs=1e-12)
    search.expose(np.arange(len(search.bonds.released)))
    x[np.unique(facets[body == 1]), 0] += 0.3
    length, first, other = bent()
    assert length == pytest.approx(24.0, abs=1e-12)
    assert (body[first] == body[other]).all()


def test_a_crack_that_grows():
    """Bonds released one by one: at each the lips behind the tip meet, those around it do not, and
    lists that were added to find what new ones do."""
    bodies, V, crack, right = split_plate()
    x = positions(V)
    surface = extract_surface(bodies, V)
    search = SurfaceSearch(surface, x, 0.02)
    search.find(x)
    x[right, 0] += 1e-3
    order = crack[np.argsort(bodies.facets.midpoint[crack, 1])]
    released = np.zeros(len(bodies.facets), bool)
    before = 0
    for number, bond in enumerate(order):
        search.expose([bond])
        assert len(search.find(x)) == before
        search.release([bond])
        released[bond] = True
        contacts, fresh = search.find(x), SurfaceSearch(surface, x, 0.02, released=released)
        fresh, before = fresh.find(x), len(contacts)
        assert (contacts.key == fresh.key).all()
        assert contacts.gap == pytest.approx(1e-3, abs=1e-15)
        assert contacts.point[:, 1].max() <= 0.25 * (number + 1) + 1e-12
        assert (contacts.nodes == fresh.nodes).all()
    assert search.lists.renewals == 1
    assert len(np.unique(search.bonds.fragment)) == 2
    assert contacts.area.sum() == pytest.approx(1.0, abs=1e-12)


def test_rims_of_a_crack_cross_once_its_lips_are_released():
    """Until then the rims of both lips are one edge, which is not convex (3D)."""
    mesh = create_box(MPI.COMM_SELF, [np.zeros(3), np.ones(3)], [2, 2, 2])
    centre = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)
    bodies = explode(mesh, (centre[:, 0] > 0.5).astype(int))
    V = space(bodies)
    x, surface = positions(V), extract_surface(bodies, V)
    right = np.zeros(len(x), bool)
    right[V.dofmap.list[bodies.body_of_cell == 1]] = True
    turn = Rotation.from_rotvec([0.7, 0.02, 0.03])
    search = SurfaceSearch(surface, x, 0.02)
    search.find(x)
    crack = np.arange(len(bodies.facets))
    x[right] = turn.apply(x[right] - 0.5) + [0.5, 0.5, 0.52]
    search.expose(crack)
    search.find(x)
    search.release(crack)
    fresh = SurfaceSearch(surface, x, 0.02, released=np.ones(len(crack), bool))
    found, expected = search.find(x), fresh.find(x)
    edges = expected.key[:, 0] >> 60 == 2
    assert edges.any()
    assert sorted(map(tuple, found.key)) == sorted(map(tuple, expected.key))


def test_corner_of_a_surface_on_the_corner_of_a_shape():
    """A plate ends flush with its support: the end's node, of another cell, is not pushed aside."""
    bodies = explode(crossed_rectangle((0.0, 0.0), (2.0, 1.0), (4, 2)))
    V = space(bodies)
    x = positions(V)
    support = RigidBody(Polygon.box((0.3, 0.4)), (0.15, -0.2), "support", density=1.0)
    rigid = RigidBodies([support])
    search = SurfaceSearch(extract_surface(bodies, V), x, 1e-3, rigid=rigid)
    for depth in (0.0, 1e-6):
        contacts = search.find(x - [0.0, depth], rigid.position, rigid.rotation)
        assert len(contacts) >= 2
        assert np.abs(contacts.normal[:, 1]) == pytest.approx(1.0)
        assert contacts.gap == pytest.approx(-depth, abs=1e-12)
