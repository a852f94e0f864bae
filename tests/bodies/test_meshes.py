# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes: rectangles, Gmsh models and files, tags by geometry, and refusals."""

import logging
import signal

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import CellType, create_unit_cube
from mpi4py import MPI
from ufl import Measure, dx

from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import (
    crossed_rectangle,
    facet_cells,
    facet_geometry_nodes,
    read_gmsh,
    tag_cells,
    tag_facets,
)
from xper_fx.forms.compiled import compiled_form
from xper_fx.support.compat import geometry_dofmap


def area(mesh, measure=dx):
    """Return the integral of 1."""
    return fem.assemble_scalar(compiled_form(fem.Constant(mesh, 1.0) * measure(domain=mesh)))


def test_crossed_rectangle():
    """Four equal triangles to a quadrilateral, the right extent."""
    mesh = crossed_rectangle((-1, 2), (2, 4), (3, 5))
    x = mesh.geometry.x
    assert geometry_dofmap(mesh).shape == (4 * 3 * 5, 3)
    assert len(x) == 4 * 6 + 3 * 5
    assert x.min(axis=0).tolist() == [-1, 2, 0]
    assert x.max(axis=0).tolist() == [2, 4, 0]
    corners = x[geometry_dofmap(mesh)]
    edges = corners[:, 1:, :2] - corners[:, :1, :2]
    assert np.allclose(np.abs(np.linalg.det(edges)) / 2, 6 / 60)


@pytest.mark.parametrize(
    ("lower", "upper", "cells", "error", "message"),
    (
        ((0, 0), (0, 1), (2, 2), ValueError, "empty or not finite"),
        ((0, 0), (1, -1), (2, 2), ValueError, "empty or not finite"),
        ((0, 0), (1, np.inf), (2, 2), ValueError, "empty or not finite"),
        ((0, np.nan), (1, 1), (2, 2), ValueError, "empty or not finite"),
        ((0, 0, 0), (1, 1, 1), (2, 2), ValueError, "`lower` should be a pair"),
        ((0, 0), (1, 1), (2, 0), ValueError, "at least 1"),
        ((0, 0), (1, 1), (2, 2.0), TypeError, "two integers"),
        ((0, 0), (1, 1), (2, 2, 2), TypeError, "two integers"),
    ),
)
def test_crossed_rectangle_refuses(lower, upper, cells, error, message):
    """Empty rectangles and wrong numbers of cells."""
    with pytest.raises(error, match=message):
        crossed_rectangle(lower, upper, cells)


def test_tag_cells():
    """Tags follow the midpoints; what nobody claims has the default."""
    mesh = crossed_rectangle((0, 0), (4, 1), (4, 1))
    tags = tag_cells(mesh, {7: lambda x: x[0] < 1, -2: lambda x: x[0] > 3}, default=5)
    midpoints = mesh.geometry.x[geometry_dofmap(mesh)].mean(axis=1)
    expected = np.where(midpoints[:, 0] < 1, 7, np.where(midpoints[:, 0] > 3, -2, 5))
    assert tags.values.dtype == np.int32
    assert np.array_equal(tags.indices, np.arange(16))
    assert np.array_equal(tags.values, expected)
    assert sorted(set(expected)) == [-2, 5, 7]


def test_tag_facets():
    """All vertices and the midpoint must fit; interior facets count."""
    mesh = crossed_rectangle((0, 0), (4, 4), (4, 4))
    tags = tag_facets(
        mesh,
        {
            1: lambda x: np.isclose(x[0], 2) & (x[1] < 2.7),
            2: lambda x: np.isclose(x[1], 0) | np.isclose(x[0], 4),
        },
    )
    cells, local = facet_cells(mesh)
    x = mesh.geometry.x[facet_geometry_nodes(mesh, cells[:, 0], local[:, 0])]
    assert np.all(np.diff(tags.indices) > 0)
    assert (
        len(tags.find(1)) == 2
    )  # from y = 0 to 2; of that from 2 to 3 only the midpoint and a vertex fit
    assert np.allclose(x[tags.find(1), :, 0], 2)
    assert len(tags.find(2)) == 8
    assert np.all(cells[tags.find(2), 1] == -1)
    assert np.all(cells[tags.find(1), 1] >= 0)


def test_tag_facets_looks_at_midpoints():
    """A facet whose vertices fit and whose midpoint does not stays untagged."""
    mesh = crossed_rectangle((0, 0), (1, 1), (1, 1))
    assert len(tag_facets(mesh, {1: lambda x: np.abs(x[0] - 0.5) > 0.4}).indices) == 2
    assert len(tag_facets(mesh, {1: lambda x: (x[0] < 0.1) | (x[0] > 0.9)}).indices) == 2


def test_empty_tag_is_logged(caplog):
    """A predicate that claims nothing is probably wrong: a warning names it."""
    mesh = crossed_rectangle((0, 0), (1, 1), (1, 1))
    with caplog.at_level(logging.WARNING, logger="xper_fx.bodies.meshes"):
        tag_cells(mesh, {17: lambda x: x[0] > 2})
    assert "Tag 17 claims no cell" in caplog.text


@pytest.mark.parametrize("tag", (tag_cells, tag_facets))
@pytest.mark.parametrize(
    ("predicates", "error", "message"),
    (
        ({4: lambda x: x[0] < 1.6, 9: lambda x: x[0] > 0.4}, ValueError, "Tags 4 and 9 both"),
        ({4: lambda x: 1.0 * x[0]}, TypeError, "tag 4 returned float64; expected bool"),
        ({4: lambda x: x > 0}, ValueError, r"tag 4 returned shape \(3, \d+\)"),
        ({4: lambda x: True}, ValueError, r"tag 4 returned shape \(\)"),
        ({"left": lambda x: x[0] > 0}, TypeError, "'left' is a str"),
        ({True: lambda x: x[0] > 0}, TypeError, "True is a bool"),
        ({2**31: lambda x: x[0] > 0}, TypeError, "32 bits"),
    ),
)
def test_tags_refuse(tag, predicates, error, message):
    """Overlapping tags and predicates that are none."""
    mesh = crossed_rectangle((0, 0), (2, 1), (2, 1))
    with pytest.raises(error, match=message):
        tag(mesh, predicates)


def test_facet_cells():
    """Each facet's two cells see the same geometry nodes; the exterior ones have one."""
    for cell_type in (CellType.tetrahedron, CellType.hexahedron):
        mesh = create_unit_cube(MPI.COMM_SELF, 3, 2, 2, cell_type)
        cells, local = facet_cells(mesh)
        inner = cells[:, 1] >= 0
        assert np.all(local[~inner, 1] == -1)
        sides = [
            np.sort(facet_geometry_nodes(mesh, cells[inner, s], local[inner, s])) for s in (0, 1)
        ]
        assert np.array_equal(*sides)
        assert (~inner).sum() == (64 if cell_type == CellType.tetrahedron else 32)


@pytest.fixture
def gmsh():
    """A Gmsh session of the test's own."""
    module = pytest.importorskip("gmsh")
    module.initialize(interruptible=False)
    module.option.setNumber("General.Terminal", 0)
    yield module
    module.finalize()


def plate(gmsh, size=0.3, physical=True, quadrilaterals=False):
    """Build a plate 2 x 1 with a disc of radius 0.25 inside, tags 3 and 8, left side 5."""
    gmsh.model.add("plate")
    occ = gmsh.model.occ
    rectangle = occ.addRectangle(0, 0, 0, 2, 1)
    disc = occ.addDisk(0.6, 0.5, 0, 0.25, 0.25)
    _, pieces = occ.fragment([(2, rectangle)], [(2, disc)])
    occ.synchronize()
    inside = [t for _, t in pieces[1]]
    outside = [t for _, t in pieces[0] if t not in inside]
    left = [t for _, t in gmsh.model.getEntitiesInBoundingBox(-0.01, -1, -1, 0.01, 2, 1, 1)]
    if physical:
        gmsh.model.addPhysicalGroup(2, outside, 3)
        gmsh.model.addPhysicalGroup(2, inside, 8)
        gmsh.model.addPhysicalGroup(1, left, 5)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    if quadrilaterals:
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
        gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 2)
    gmsh.model.mesh.generate(2)
    return inside, outside


def check_plate(mesh, cell_tags, facet_tags):
    """Check areas, tags and bodies of the plate."""
    assert mesh.geometry.dim == 2
    assert np.isclose(area(mesh), 2.0)
    measure = Measure("dx", subdomain_data=cell_tags)
    assert np.isclose(area(mesh, measure(8)), np.pi / 16, rtol=0.1)
    assert np.isclose(area(mesh, measure(3)) + area(mesh, measure(8)), 2.0)
    boundary = Measure("ds", subdomain_data=facet_tags)
    assert np.isclose(area(mesh, boundary(5)), 1.0)
    bodies = explode(mesh, cell_tags.values, cell_tags, facet_tags)
    assert bodies.num_bodies == 2
    assert bodies.labels.tolist() == [3, 8]
    around = np.linalg.norm(bodies.facets.midpoint - (0.6, 0.5), axis=1)
    assert np.allclose(around, 0.25, rtol=0.15)
    assert np.isclose(bodies.facets.measure.sum(), np.pi / 2, rtol=0.05)
    assert np.array_equal(np.sort(bodies.facets.materials, axis=1)[0], (3, 8))
    assert len(bodies.facet_tags.find(5)) == len(facet_tags.find(5)) > 0


def test_gmsh_model(gmsh):
    """A model with two groups of cells and one of facets."""
    plate(gmsh)
    check_plate(*read_gmsh(gmsh.model, 2))


def test_gmsh_quadrilaterals(gmsh):
    """The same in quadrilaterals."""
    plate(gmsh, quadrilaterals=True)
    mesh, cell_tags, facet_tags = read_gmsh(gmsh.model, 2)
    assert mesh.topology.cell_type == CellType.quadrilateral
    check_plate(mesh, cell_tags, facet_tags)


def test_msh_file_within_a_session(gmsh, tmp_path):
    """A file read within a session leaves the session's model as it was."""
    plate(gmsh)
    path = tmp_path / "plate.msh"
    gmsh.write(str(path))
    gmsh.model.add("mine")
    gmsh.model.add("last")
    gmsh.model.setCurrent("mine")
    models = gmsh.model.list()
    check_plate(*read_gmsh(path, 2))
    assert gmsh.model.getCurrent() == "mine"
    assert gmsh.model.list() == models


def test_msh_file_without_a_session(tmp_path):
    """A file read without a session leaves none, nor does it change what Ctrl-C does."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    plate(gmsh)
    path = tmp_path / "plate.msh"
    gmsh.write(str(path))
    gmsh.finalize()
    handler = signal.getsignal(signal.SIGINT)
    check_plate(*read_gmsh(str(path), 2))
    assert not gmsh.isInitialized()
    assert signal.getsignal(signal.SIGINT) is handler


def test_gmsh_box(gmsh):
    """Tetrahedra, without any group of facets: empty facet tags."""
    gmsh.model.add("box")
    box = gmsh.model.occ.addBox(0, 0, 0, 1, 2, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [box], 4)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
    gmsh.model.mesh.generate(3)
    mesh, cell_tags, facet_tags = read_gmsh(gmsh.model, 3)
    assert np.isclose(area(mesh), 2.0)
    assert set(cell_tags.values) == {4}
    assert facet_tags.dim == 2
    assert len(facet_tags.indices) == 0
    assert explode(mesh, cell_tags=cell_tags, facet_tags=facet_tags).num_bodies == len(
        cell_tags.values
    )


def test_gmsh_refuses(gmsh, tmp_path):
    """Models that are empty, ungrouped, doubly grouped, of another dimension, order or plane."""
    gmsh.model.add("nothing")
    with pytest.raises(ValueError, match="no cells of dimension 2.*generate"):
        read_gmsh(gmsh.model, 2)
    inside, outside = plate(gmsh, physical=False)
    with pytest.raises(ValueError, match="cells are in no physical group of dimension 2"):
        read_gmsh(gmsh.model, 2)
    gmsh.model.addPhysicalGroup(2, outside, 3)
    with pytest.raises(ValueError, match=r"\d+ of \d+ cells are in no physical group"):
        read_gmsh(gmsh.model, 2)
    gmsh.model.addPhysicalGroup(2, inside, 8)
    with pytest.raises(ValueError, match="no cells of dimension 3"):
        read_gmsh(gmsh.model, 3)
    with pytest.raises(ValueError, match="dim is 1; expected 2 or 3"):
        read_gmsh(gmsh.model, 1)
    gmsh.model.mesh.setOrder(2)
    with pytest.raises(ValueError, match="order 2.*expected first order"):
        read_gmsh(gmsh.model, 2)
    gmsh.model.mesh.setOrder(1)
    gmsh.model.addPhysicalGroup(2, inside, 9)
    with pytest.raises(ValueError, match="in two physical groups"):
        read_gmsh(gmsh.model, 2)
    gmsh.model.mesh.affineTransform([1, 0, 0, 0, 0, 1, 0, 0, 0.5, 0, 1, 0])
    gmsh.model.removePhysicalGroups([(2, 9)])
    with pytest.raises(ValueError, match="does not lie in a plane"):
        read_gmsh(gmsh.model, 2)
    with pytest.raises(FileNotFoundError, match=r"no\.msh"):
        read_gmsh(tmp_path / "no.msh", 2)
    broken = tmp_path / "broken.msh"
    broken.write_text("this is no mesh\n")
    with pytest.raises(ValueError, match=r"broken\.msh"):
        read_gmsh(broken, 2)
