# SPDX-License-Identifier: LGPL-3.0-or-later
"""Periodic tessellations and their meshes: exact shapes, ownership of points, translates."""

import signal
from itertools import product
from math import factorial

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial import Delaunay, cKDTree

import xper_fx.periodic.microstructure.tessellation as tessellation_module
from xper_fx.bodies.explode import explode
from xper_fx.bodies.meshes import facet_cells, facet_geometry_nodes
from xper_fx.periodic.microstructure.box_cut import cut_by_box
from xper_fx.periodic.microstructure.mesh import mesh_tessellation
from xper_fx.periodic.microstructure.seeds import random_seeds
from xper_fx.periodic.microstructure.short_edges import lengthen_short_edges
from xper_fx.periodic.microstructure.tessellation import nearest_grains, tessellate
from xper_fx.support.compat import geometry_dofmap

SHORTEST = {2: 0.25, 3: 0.1}  # edges of relaxed tessellations, in the mean distance of seeds


def spacing(tessellation):
    """Return the mean distance of seeds."""
    return (tessellation.periods.prod() / tessellation.num_grains) ** (1 / tessellation.dim)


def regular(count, periods, seed):
    """Return a relaxed random tessellation without short edges."""
    tessellation = tessellate(random_seeds(count, periods, seed), periods)
    return lengthen_short_edges(tessellation, SHORTEST[len(periods)] * spacing(tessellation))


def lattice_points(cells, motif):
    """Return the points of a motif in each of cells x ... x cells unit boxes."""
    origins = np.array(list(product(*map(range, cells))), dtype=float)
    return (origins[:, np.newaxis] + np.array(motif)).reshape(-1, len(cells))


def owners(points, tessellation):
    """Return the seed of the smallest power of each point, and its shift, by trying all."""
    least = np.full(len(points), np.inf)
    owner = np.full(len(points), -1)
    place = np.zeros(points.shape, dtype=int)
    for shift in product((-2, -1, 0, 1, 2), repeat=tessellation.dim):
        apart = points[:, np.newaxis] - (tessellation.seeds + shift * tessellation.periods)
        power = (apart**2).sum(axis=-1) - tessellation.weights
        nearest = power.argmin(axis=1)
        better = power.min(axis=1) < least
        least[better] = power.min(axis=1)[better]
        owner[better] = nearest[better]
        place[better] = shift
    return owner, place


def edge_lengths(tessellation, side):
    """Return the lengths of the edges of a grain's face."""
    x = tessellation.face_corners(side)
    around = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
    return around if tessellation.dim == 3 else around[:1]


SLOW = pytest.mark.slow
RANDOM = [
    pytest.param(dim, count, weighted, seed, marks=SLOW if (dim, count) == (3, 20) else ())
    for dim, count in ((2, 1), (2, 2), (2, 3), (2, 30), (3, 1), (3, 2), (3, 20))
    for weighted, seed in ((False, 0), (True, 1))
]


@pytest.mark.slow
@pytest.mark.parametrize(("dim", "count", "weighted", "seed"), RANDOM)
def test_random_points_are_in_their_seeds_grain(dim, count, weighted, seed):
    """Grains fill the box, and each holds the points of which its seed has the smallest power."""
    generator = np.random.default_rng(seed)
    periods = np.array([2e-4, 1.1e-4, 0.9e-4][:dim])
    seeds = random_seeds(count, periods, seed, relaxation=2)
    mean = (periods.prod() / count) ** (1 / dim)
    weights = generator.random(count) * 0.2 * mean**2 if weighted else None
    tessellation = tessellate(seeds, periods, weights)
    assert np.isclose(tessellation.volumes.sum(), periods.prod(), rtol=1e-12, atol=0)
    points = generator.random((2000, dim)) * periods
    grains, shifts = owners(points, tessellation)
    assert len(set(grains)) == count
    local = points - shifts * periods
    for grain in range(count):
        mine = local[grains == grain]
        for side in tessellation.boundaries[grain]:
            corners = tessellation.face_corners(side)
            along = corners[1] - corners[0]
            if dim == 2:
                outward = np.array([along[1], -along[0]])
            else:
                outward = sum(
                    np.cross(a - corners[0], b - corners[0])
                    for a, b in zip(corners[1:], corners[2:], strict=False)
                )
            outward /= np.linalg.norm(outward)
            assert np.all((mine - corners[0]) @ outward < 1e-10 * mean)
    share = np.bincount(grains, minlength=count) / len(points)
    assert np.allclose(share, tessellation.volumes / periods.prod(), atol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("dim", "count", "weighted", "seed"), RANDOM)
def test_faces_are_where_powers_are_equal(dim, count, weighted, seed):
    """Corners have the same power to both grains of a face, and no smaller one to any other."""
    periods = np.array([1.0, 0.8, 1.3][:dim])
    seeds = random_seeds(count, periods, seed, relaxation=1)
    weights = np.linspace(-0.05, 0.05, count) / count ** (2 / dim) if weighted else None
    tessellation = tessellate(seeds, periods, weights)
    w = tessellation.weights
    shifts = np.array(list(product((-2, -1, 0, 1, 2), repeat=dim))) * periods
    for face in tessellation.faces:
        i, j = face.pieces
        x = tessellation.vertices[face.corners] + face.corner_shifts * periods
        first = ((x - tessellation.seeds[i]) ** 2).sum(axis=1) - w[i]
        second = ((x - tessellation.seeds[j] - face.shift * periods) ** 2).sum(axis=1) - w[j]
        assert np.allclose(first, second, rtol=0, atol=1e-12)
        images = tessellation.seeds[:, np.newaxis] + shifts
        every = ((x[:, np.newaxis, np.newaxis] - images) ** 2).sum(axis=-1) - w[:, np.newaxis]
        assert np.all(every.reshape(len(x), -1).min(axis=1) > first - 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("dim", (2, 3))
@pytest.mark.parametrize("margin", (0.1, 1.0))
def test_too_few_images_are_noticed(monkeypatch, dim, margin):
    """Begun with the images near the box only, the search for the cells goes on until right."""
    monkeypatch.setattr(tessellation_module, "_FIRST_MARGIN", margin)
    periods = np.array([1.0, 0.8, 1.3][:dim])
    for count in (1, 2, 3, 5, 12):
        for seed in range(2):
            seeds = random_seeds(count, periods, seed, relaxation=0)
            weights = np.random.default_rng(seed).random(count) * 0.3 * periods.min() ** 2 / count
            found = tessellate(seeds, periods, weights)
            with monkeypatch.context() as all_images:
                all_images.setattr(tessellation_module, "_FIRST_MARGIN", np.inf)
                expected = tessellate(seeds, periods, weights)
            assert len(found.faces) == len(expected.faces)
            assert np.allclose(found.volumes, expected.volumes, rtol=1e-10)


def test_honeycomb():
    """A triangular lattice of seeds gives regular hexagons."""
    a = 3e-5
    points = lattice_points((4, 3), [(0.1, 0.2), (0.6, 0.7)]) * (a, np.sqrt(3) * a)
    tessellation = tessellate(points, (4 * a, 3 * np.sqrt(3) * a))
    assert np.allclose(tessellation.volumes, np.sqrt(3) / 2 * a**2, rtol=1e-12, atol=0)
    assert np.allclose(tessellation.centroids, tessellation.seeds, rtol=0, atol=1e-12 * a)
    assert len(tessellation.vertices) == 2 * 24
    assert len(tessellation.faces) == 3 * 24
    for sides in tessellation.boundaries:
        assert len(sides) == 6
        for side in sides:
            assert np.allclose(edge_lengths(tessellation, side), a / np.sqrt(3), rtol=1e-12, atol=0)


@pytest.mark.parametrize("cells", ((1, 1, 1), (2, 3, 2)))
def test_body_centred_cubic_seeds(cells):
    """They give truncated octahedra: six squares and eight hexagons with edges a sqrt(2) / 4."""
    a = 2e-5
    points = lattice_points(cells, [(0, 0, 0), (0.5, 0.5, 0.5)]) * a
    tessellation = tessellate(points, np.multiply(cells, a))
    assert np.allclose(tessellation.volumes, a**3 / 2, rtol=1e-12, atol=0)
    for sides in tessellation.boundaries:
        edges = [edge_lengths(tessellation, side) for side in sides]
        assert sorted(map(len, edges)) == [4] * 6 + [6] * 8
        assert np.allclose(np.concatenate(edges), a * np.sqrt(2) / 4, rtol=1e-12, atol=0)
    assert len(tessellation.vertices) == 6 * len(points)
    assert np.isclose(tessellation.shortest_edge, a * np.sqrt(2) / 4)


@pytest.mark.parametrize("noise", (0, 1e-16, 1e-14))
@pytest.mark.parametrize(
    ("motif", "cells", "sides", "corners", "num_vertices"),
    (
        ([(0, 0)], (4, 3), 4, 2, 1),
        ([(0, 0, 0)], (3, 2, 3), 6, 4, 1),
        ([(0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)], (2, 1, 2), 12, 4, 12),
    ),
)
def test_lattices_where_many_grains_meet(motif, cells, sides, corners, num_vertices, noise):
    """Squares, cubes, rhombic dodecahedra: vertices of more than dim + 1 seeds, up to rounding."""
    points = lattice_points(cells, motif)
    points += noise * np.random.default_rng(0).standard_normal(points.shape)
    tessellation = tessellate(points, cells)
    assert len(tessellation.vertices) == num_vertices * np.prod(cells)
    assert np.allclose(tessellation.volumes, 1 / len(motif), rtol=1e-12)
    for faces in tessellation.boundaries:
        assert [len(tessellation.faces[s.face].corners) for s in faces] == [corners] * sides


def test_laguerre_weights_move_the_boundary():
    """Between two seeds it lies at (d + (w1 - w2) / d) / 2 from the first."""
    seeds = np.array([(0.1, 0.5), (0.6, 0.5)])
    for difference in (0.0, 0.07, -0.12, 0.249):
        tessellation = tessellate(seeds, (1, 1), (5 + difference, 5))
        reach = (0.5 + difference / 0.5) / 2
        expected = np.sort(np.mod([0.1 - reach, 0.1 + reach], 1))
        assert np.allclose(np.unique(tessellation.vertices[:, 0].round(13)), expected, atol=1e-12)
        assert np.allclose(tessellation.volumes, (2 * reach, 1 - 2 * reach), atol=1e-12)
    # a seed outside its own grain: all by itself between two heavy neighbours
    chain = np.column_stack([[0.1, 0.2, 0.7], np.full(3, 0.5), np.full(3, 0.5)])
    tessellation = tessellate(chain, (1, 1, 1), (0.03, 0, 0))
    left = 0.1 + (0.1 + 0.03 / 0.1) / 2
    assert left > 0.2
    assert np.isclose(tessellation.volumes[1], 0.45 - left, rtol=1e-12)
    assert np.isclose(tessellation.centroids[1, 0], (0.45 + left) / 2, rtol=1e-12)


@pytest.mark.parametrize("dim", (2, 3))
def test_origin_does_not_matter(dim):
    """Shifted seeds, by any vector and whole periods, have the same grains around them."""
    periods = np.array([1.0, 2.0, 1.5][:dim])
    seeds = random_seeds(15, periods, 4, relaxation=1)
    first = tessellate(seeds, periods)
    move = np.array([0.37, -5.21, 12.9][:dim])
    second = tessellate(seeds + move, periods)
    assert np.all((second.seeds >= 0) & (second.seeds < periods))
    assert np.allclose(second.volumes, first.volumes, rtol=1e-11)
    offset = first.centroids - first.seeds
    assert np.allclose(second.centroids - second.seeds, offset, atol=1e-12)
    assert len(first.vertices) == len(second.vertices)
    places = cKDTree(np.mod(first.vertices + move, periods), boxsize=periods)
    assert places.query(np.mod(second.vertices, periods))[0].max() < 1e-12


@pytest.mark.parametrize("periods", [(1.0, 2.0), (1.0, 2.0, 1.5)])
@pytest.mark.parametrize("pieces", [lambda whole: whole, cut_by_box], ids=["whole", "cut"])
def test_volumes_and_centroids_are_those_of_the_corners_triangulation(periods, pieces):
    tessellation = pieces(tessellate(random_seeds(8, periods, 3, relaxation=0), periods))
    for piece, sides in enumerate(tessellation.boundaries):
        corners = np.concatenate([tessellation.face_corners(side) for side in sides])
        simplices = corners[Delaunay(corners).simplices]
        arms = simplices[:, 1:] - simplices[:, :1]
        volumes = np.abs(np.linalg.det(arms)) / factorial(tessellation.dim)
        centroid = volumes @ simplices.mean(axis=1) / volumes.sum()
        assert tessellation.piece_volumes[piece] == pytest.approx(volumes.sum(), rel=1e-9)
        np.testing.assert_allclose(tessellation.centroids[piece], centroid, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_random_seeds():
    """Reproducible; relaxed ones are more regular."""
    periods = (1e-4, 2e-4)
    seeds = random_seeds(40, periods, 7)
    assert np.array_equal(seeds, random_seeds(40, periods, 7))
    assert not np.array_equal(seeds, random_seeds(40, periods, 8))
    assert seeds.shape == (40, 2)
    assert np.all((seeds >= 0) & (seeds < periods))
    spread = [
        np.std(tessellate(random_seeds(40, periods, 7, steps), periods).volumes)
        for steps in (0, 2, 20)
    ]
    assert spread[0] > 2 * spread[1] > 3 * spread[2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dim", "count", "weighted"), ((2, 60, False), (2, 60, True), (3, 12, True))
)
def test_short_edges_are_lengthened(dim, count, weighted):
    """Without leaving power diagrams, and leaving what is long enough."""
    periods = np.full(dim, 1e-4)
    weights = np.linspace(0, 0.02, count) * 1e-8 / count ** (2 / dim) if weighted else None
    before = tessellate(random_seeds(count, periods, 0, relaxation=3), periods, weights)
    length = SHORTEST[dim] * spacing(before)
    assert before.shortest_edge < 0.5 * length
    after = lengthen_short_edges(before, length)
    assert after.shortest_edge >= length
    again = tessellate(after.seeds, periods, weights)
    assert np.array_equal(again.vertices, after.vertices)
    moved = after.seeds - before.seeds
    moved -= periods * np.rint(moved / periods)
    assert np.linalg.norm(moved, axis=1).max() < 0.5 * spacing(before)
    assert lengthen_short_edges(after, length) is after
    with pytest.raises(ValueError, match=r"3 at most.* ask for a smaller length"):
        lengthen_short_edges(after, 0.9 * spacing(after), max_steps=3)
    squares = tessellate(lattice_points((3, 3), [(0.2, 0.3)]), (3, 3))
    with pytest.raises(ValueError, match="ask for a smaller length"):
        lengthen_short_edges(squares, 1.1)
    with pytest.raises(ValueError, match="length should be .* got nan"):
        lengthen_short_edges(after, np.nan)


@pytest.mark.slow
@pytest.mark.parametrize("dim", (2, 3))
def test_nearest_grains(dim):
    """The first is the grain around the point; images count."""
    periods = np.array([1.0, 1.4, 0.8][:dim])
    tessellation = tessellate(random_seeds(20, periods, 2), periods, np.linspace(0, 0.01, 20))
    for point in np.random.default_rng(0).uniform(-2, 2, (50, dim)):
        found = nearest_grains(tessellation, point, 4)
        assert len(set(found)) == 4
        assert found[0] == owners(np.mod(point, periods)[np.newaxis], tessellation)[0][0]
    assert sorted(nearest_grains(tessellation, np.zeros(dim), 20)) == list(range(20))


@pytest.mark.parametrize(
    ("arguments", "message"),
    (
        ((np.zeros((3, 3)), (1, 1)), r"seeds has shape \(3, 3\); expected \(n, 2\)"),
        ((np.zeros((0, 2)), (1, 1)), r"seeds has shape \(0, 2\)"),
        (([(0.1, np.nan)], (1, 1)), r"seeds\[0\] is .*nan"),
        (([(0.1, 0.2)], (1, 0)), r"periods is \[1.0, 0.0\]; expected positive"),
        (([(0.1, 0.2)], (1, np.inf)), "periods is .*expected positive"),
        (([0.1], (1,)), "expected two or three lengths"),
        (([(0.1, 0.2), (0.3, 0.3), (1.1, -0.8)], (1, 1)), "Seeds 0 and 2 coincide modulo"),
        (([(0.1, 0.2), (0.3, 0.3)], (1, 1), (1,)), r"weights has shape \(1,\)"),
        (([(0.1, 0.2), (0.3, 0.3)], (1, 1), (1, np.inf)), r"weights\[1\] is inf"),
        (([(0.1, 0.2), (0.3, 0.3)], (1, 1), (2, 0)), "Seed 1 has no cell .*weights"),
    ),
)
def test_tessellate_refuses(arguments, message):
    """Shapes, numbers, coinciding seeds and hidden ones."""
    with pytest.raises(ValueError, match=message):
        tessellate(*arguments)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    (
        (lambda t: random_seeds(0, (1, 1), 1), ValueError, "count is 0; expected at least 1"),
        (lambda t: random_seeds(2.0, (1, 1), 1), TypeError, "count is 2.0"),
        (lambda t: random_seeds(2, (1, 1), None), TypeError, "seed is None"),
        (lambda t: random_seeds(2, (1, 1), -1), ValueError, "seed is -1"),
        (lambda t: random_seeds(2, (1, 1), 1, -1), ValueError, "relaxation is -1"),
        (lambda t: random_seeds(2, (1, -1), 1), ValueError, "periods is"),
        (lambda t: nearest_grains(t, (0, 0, 0), 1), ValueError, "expected 2 finite"),
        (lambda t: nearest_grains(t, (0, 0), 6), ValueError, "count is 6; .*grains, 5"),
        (lambda t: nearest_grains(t, (0, 0), 1.5), TypeError, "count is 1.5"),
        (lambda t: mesh_tessellation(t, 0), ValueError, "size should be .* above zero, got 0"),
        (lambda t: mesh_tessellation(t, np.nan), ValueError, "size should be .* got nan"),
        (lambda t: mesh_tessellation(t, 1, [1, 2]), ValueError, r"phase has shape \(2,\)"),
        (lambda t: mesh_tessellation(t, 1, np.ones(5)), TypeError, "phase has dtype float64"),
        (lambda t: mesh_tessellation(t, 1, [1, 1, 1, 1, 2**31]), ValueError, "32 bits"),
    ),
)
def test_others_refuse(call, error, message):
    """Numbers and phases."""
    tessellation = tessellate(random_seeds(5, (1, 1), 0), (1, 1))
    with pytest.raises(error, match=message):
        call(tessellation)


# ------------------------------------------------------------------------------------- meshes


def cell_corners(mesh):
    """Return the vertices of each cell, shape (num_cells, dim + 1, dim)."""
    return mesh.geometry.x[:, : mesh.geometry.dim][geometry_dofmap(mesh)]


def cell_volumes(mesh):
    """Return the volume of each cell."""
    x = cell_corners(mesh)
    return np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / (2 if mesh.geometry.dim == 2 else 6)


def radius_ratios(mesh):
    """Return dim times the inscribed over the circumscribed radius of each cell: 1 if regular."""
    x = cell_corners(mesh)
    edges = x[:, 1:] - x[:, :1]
    slopes = np.linalg.inv(edges).transpose(0, 2, 1)  # gradients of barycentric coordinates
    slopes = np.concatenate([slopes, -slopes.sum(axis=1, keepdims=True)], axis=1)
    inscribed = 1 / np.linalg.norm(slopes, axis=2).sum(axis=1)
    centre = np.linalg.solve(2 * edges, (edges**2).sum(axis=2)[..., np.newaxis])[..., 0]
    return mesh.geometry.dim * inscribed / np.linalg.norm(centre, axis=1)


def check_translates(microstructure):
    """Each exterior facet has one translate by a lattice vector; vertices match to 1e-12."""
    mesh, periods = microstructure.mesh, np.diag(microstructure.lattice)
    dim = len(periods)
    assert np.array_equal(microstructure.lattice, np.diag(periods))
    cells, local = facet_cells(mesh)
    exterior = cells[:, 1] < 0
    nodes = facet_geometry_nodes(mesh, cells[exterior, 0], local[exterior, 0])
    x = mesh.geometry.x[:, :dim][nodes]
    midpoints = x.mean(axis=1)
    inside = np.mod(midpoints, periods)
    inside[inside >= periods] = 0
    pairs = cKDTree(inside, boxsize=periods).query_pairs(
        1e-9 * periods.min(), output_type="ndarray"
    )
    assert np.array_equal(np.sort(pairs.ravel()), np.arange(len(midpoints)))
    way = np.rint((midpoints[pairs[:, 1]] - midpoints[pairs[:, 0]]) / periods) * periods
    assert np.all(np.abs(way).max(axis=1) > 0.5 * periods.min())
    there = x[pairs[:, 0]] + way[:, np.newaxis]
    apart = np.linalg.norm(there[:, :, np.newaxis] - x[pairs[:, 1]][:, np.newaxis], axis=-1)
    assert apart.min(axis=2).max() < 1e-12 * periods.max()
    assert apart.min(axis=1).max() < 1e-12 * periods.max()


def check_grains(microstructure, tessellation, phase):
    """Each cell lies in its grain, a whole one in its own place, with its phase; volumes agree."""
    mesh = microstructure.mesh
    grain = microstructure.grain
    volumes = cell_volumes(mesh)
    assert grain.dtype == np.int32
    assert grain.shape == volumes.shape
    owner, shift = owners(cell_corners(mesh).mean(axis=1), tessellation)
    assert np.array_equal(grain, owner)
    assert tessellation.is_cut or not shift.any()
    by_grain = np.bincount(grain, volumes, minlength=tessellation.num_grains)
    assert np.allclose(by_grain, tessellation.volumes, rtol=1e-11, atol=0)
    assert np.isclose(volumes.sum(), tessellation.periods.prod(), rtol=1e-12, atol=0)
    assert np.array_equal(microstructure.cell_tags.indices, np.arange(len(volumes)))
    assert np.array_equal(microstructure.cell_tags.values, np.asarray(phase)[grain])


def check_conforming(microstructure, tessellation):
    """The facets between grains have the area of the faces inside the periodic cell."""
    bodies = explode(microstructure.mesh, microstructure.grain, microstructure.cell_tags)
    assert bodies.num_bodies == tessellation.num_grains
    inside = 0.0
    for face in tessellation.faces:
        first, second = tessellation.grain_of_piece[list(face.pieces)]
        if first != second and not face.shift.any():
            x = tessellation.vertices[face.corners] + face.corner_shifts * tessellation.periods
            if tessellation.dim == 2:
                inside += np.linalg.norm(x[1] - x[0])
            else:
                crosses = np.cross(x[1:-1] - x[0], x[2:] - x[0])
                inside += np.linalg.norm(crosses.sum(axis=0)) / 2
    assert np.isclose(bodies.facets.measure.sum(), inside, rtol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_plane_meshes(seed):
    """50 to 100 grains on 100 um: periodic, conforming, of good cells near the size asked for."""
    pytest.importorskip("gmsh")
    count = (50, 100)[seed]
    periods = np.array([1e-4, (1.7e-4, 1e-4)[seed]])
    tessellation = regular(count, periods, seed)
    phase = np.where(np.isin(np.arange(count), nearest_grains(tessellation, (0, 0), 5)), 7, 3)
    size = 0.3 * spacing(tessellation)
    microstructure = mesh_tessellation(tessellation, size, phase, MPI.COMM_SELF)
    check_translates(microstructure)
    check_grains(microstructure, tessellation, phase)
    check_conforming(microstructure, tessellation)
    assert radius_ratios(microstructure.mesh).min() > 0.45
    x = cell_corners(microstructure.mesh)
    lengths = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2)
    assert 0.9 * size < np.median(lengths) < 1.1 * size
    assert lengths.max() < 1.7 * size


@pytest.mark.slow
@pytest.mark.parametrize(("count", "seed"), ((10, 0), (15, 1)))
def test_solid_meshes(count, seed):
    """The same in 3D."""
    pytest.importorskip("gmsh")
    periods = np.array([1e-4, 1.2e-4, 0.9e-4])
    tessellation = regular(count, periods, seed)
    phase = 1 + np.arange(count) % 3
    size = 0.35 * spacing(tessellation)
    microstructure = mesh_tessellation(tessellation, size, phase, MPI.COMM_SELF)
    ratios = radius_ratios(microstructure.mesh)
    check_translates(microstructure)
    check_grains(microstructure, tessellation, phase)
    check_conforming(microstructure, tessellation)
    assert ratios.min() > 0.1
    assert np.quantile(ratios, 0.01) > 0.28
    x = cell_corners(microstructure.mesh)
    lengths = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2)
    assert 0.8 * size < np.median(lengths) < 1.3 * size
    assert lengths.max() < 2.2 * size


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dim", "count"), ((2, 1), (2, 2), (2, 3), (2, 40), (3, 1), (3, 2), (3, 8))
)
@pytest.mark.parametrize("weighted", (False, True))
def test_meshes_of_rough_tessellations(dim, count, weighted):
    """Few grains, random ones with short edges, weighted ones: what is asked for, but quality."""
    pytest.importorskip("gmsh")
    periods = np.array([1.0, 1.5, 0.8][:dim])
    weights = np.linspace(0, 0.1, count) / count ** (2 / dim) if weighted else None
    tessellation = tessellate(random_seeds(count, periods, 5, relaxation=0), periods, weights)
    microstructure = mesh_tessellation(tessellation, 0.3 * spacing(tessellation))
    check_translates(microstructure)
    check_grains(microstructure, tessellation, np.ones(count, dtype=int))
    check_conforming(microstructure, tessellation)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dim", "count", "keep_origin"),
    ((2, 1, False), (2, 3, True), (2, 60, False), (2, 60, True), (3, 1, False), (3, 12, False)),
)
def test_grains_cut_by_the_box(dim, count, keep_origin):
    """The periodic cell is the box; grains keep their volumes; pieces face each other."""
    pytest.importorskip("gmsh")
    periods = np.array([1e-4, 1.3e-4, 0.9e-4][:dim])
    whole = tessellate(random_seeds(count, periods, 1), periods)
    if count > 3:
        whole = lengthen_short_edges(whole, SHORTEST[dim] * spacing(whole))
    cut = cut_by_box(whole, keep_origin)
    assert cut.is_cut
    assert not whole.is_cut
    assert np.allclose(cut.volumes, whole.volumes, rtol=1e-11, atol=0)
    assert np.allclose(tessellate(cut.seeds, periods).volumes, whole.volumes, rtol=1e-11, atol=0)
    assert np.array_equal(cut.seeds, whole.seeds) == keep_origin
    phase = np.arange(count)
    size = 0.3 * spacing(whole)
    microstructure = mesh_tessellation(cut, size, phase)
    check_translates(microstructure)
    check_grains(microstructure, cut, phase)
    check_conforming(microstructure, cut)
    mesh = microstructure.mesh
    cells, local = facet_cells(mesh)
    exterior = cells[:, 1] < 0
    nodes = facet_geometry_nodes(mesh, cells[exterior, 0], local[exterior, 0])
    x = mesh.geometry.x[:, :dim][nodes]
    on_side = np.isclose(x / periods, 0, atol=1e-12) | np.isclose(x / periods, 1, atol=1e-12)
    assert np.all(on_side.all(axis=1).any(axis=1))
    if not keep_origin:
        assert cut.shortest_edge > {2: 0.1, 3: 0.02}[dim] * spacing(whole)
        assert radius_ratios(mesh).min() > {2: 0.3, 3: 0.06}[dim]
    with pytest.raises(ValueError, match="cut by the box already"):
        cut_by_box(cut)
    with pytest.raises(ValueError, match="cut by the box; lengthen"):
        lengthen_short_edges(cut, 0)


def test_cut_refuses_vertices_on_the_boundary():
    """Squares whose corners are at the box's corners; with a free origin, halves and quarters."""
    tessellation = tessellate([(0.5, 0.5), (1.5, 0.5)], (2, 1))
    with pytest.raises(ValueError, match="A vertex at .* lies on the box's boundary"):
        cut_by_box(tessellation, keep_origin=True)
    cut = cut_by_box(tessellation)
    assert np.allclose(np.sort(cut.piece_volumes), [0.25] * 4 + [0.5] * 2)


@pytest.mark.slow
@pytest.mark.parametrize("motif", ([(0.3, 0.2)], [(0, 0, 0.1)], [(0, 0, 0), (0.5, 0.5, 0.5)]))
def test_meshes_of_lattices(motif):
    """Squares, cubes and truncated octahedra; also a size larger than the grains."""
    pytest.importorskip("gmsh")
    cells = (2, 3, 2)[: len(motif[0])]
    tessellation = tessellate(lattice_points(cells, motif), cells)
    for size in (0.3, 5):
        microstructure = mesh_tessellation(tessellation, size)
        check_translates(microstructure)
        check_grains(microstructure, tessellation, np.ones(tessellation.num_grains, dtype=int))
        check_conforming(microstructure, tessellation)


@pytest.mark.slow
@pytest.mark.parametrize("dim", (2, 3))
def test_meshes_are_reproducible(dim):
    """The same seed gives the same mesh, node for node."""
    pytest.importorskip("gmsh")
    periods = np.full(dim, 1e-4)
    first, second = (
        mesh_tessellation(tessellate(random_seeds(8, periods, 3), periods), 2e-5) for _ in range(2)
    )
    assert np.array_equal(first.mesh.geometry.x, second.mesh.geometry.x)
    assert np.array_equal(geometry_dofmap(first.mesh), geometry_dofmap(second.mesh))
    assert np.array_equal(first.grain, second.grain)


@pytest.mark.parametrize("dim", (2, 3))
def test_meshes_do_not_depend_on_the_unit(dim):
    """Grains of a nanometre are meshed like those of a metre."""
    pytest.importorskip("gmsh")
    tessellation = tessellate(random_seeds(6, np.ones(dim), 3), np.ones(dim))
    scale = 2.0**-30
    small = tessellate(tessellation.seeds * scale, np.full(dim, scale))
    first, second = mesh_tessellation(tessellation, 0.2), mesh_tessellation(small, 0.2 * scale)
    assert np.array_equal(first.mesh.geometry.x * scale, second.mesh.geometry.x)
    assert np.array_equal(first.grain, second.grain)


@pytest.mark.slow
def test_a_users_session_stays():
    """Model, options and session are as before, and the user's options do not change the mesh."""
    gmsh = pytest.importorskip("gmsh")
    tessellation = tessellate(random_seeds(8, (1, 1), 3), (1, 1))
    handler = signal.getsignal(signal.SIGINT)
    alone = mesh_tessellation(tessellation, 0.1)
    assert not gmsh.isInitialized()
    assert signal.getsignal(signal.SIGINT) is handler
    gmsh.initialize(interruptible=False)
    try:
        options = {
            "General.Terminal": 0,
            "General.Verbosity": 3,
            "Mesh.MeshSizeFactor": 0.4,
            "Mesh.Algorithm": 5,
            "Mesh.RecombineAll": 1,
            "Mesh.ElementOrder": 2,
        }
        for option, value in options.items():
            gmsh.option.setNumber(option, value)
        gmsh.model.add("mine")
        gmsh.model.add("last")
        gmsh.model.setCurrent("mine")
        models = gmsh.model.list()
        within = mesh_tessellation(tessellation, 0.1)
        assert gmsh.model.getCurrent() == "mine"
        assert gmsh.model.list() == models
        assert {option: gmsh.option.getNumber(option) for option in options} == options
    finally:
        gmsh.finalize()
    assert np.array_equal(alone.mesh.geometry.x, within.mesh.geometry.x)
