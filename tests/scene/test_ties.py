# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ties between surfaces meshed apart: patch tests, convergence, other laws, what is refused."""

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box, create_rectangle
from scenes import BACK, BOTTOM, COMM, LEFT, RIGHT, field, mesh_of, midpoints, nodes, run, side_tags
from scipy.spatial import cKDTree

from xper_fx.bodies.explode import explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import facet_cells, tag_cells, tag_facets
from xper_fx.forms.loads import Gravity, PrescribedDisplacement, SurfaceTraction
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone, PerfectBond
from xper_fx.nscd.mortar import nonmatching_points
from xper_fx.scene.scene import Scene
from xper_fx.scene.tie import Tie
from xper_fx.simulation.simulation import Simulation

YOUNG, POISSON = 100.0, 0.3
STATIC = {"inertia": False, "theta": 1.0}
# Facets of the left and of the right box at x = 1; tags of the other sides are those of the left
# box, and those plus 100 of the right.
ON_LEFT, ON_RIGHT = 11, 12


def two_boxes(dim, left, right, label=None, width=1.0):
    """Boxes of edge 1 side by side, of some cells an edge each; the left one of another width."""
    meshes, tags = [], []
    for i, n in enumerate((left, right)):
        lower, upper = np.zeros(dim), np.ones(dim)
        lower[0], upper[0] = i, i + 1
        if i == 0:
            upper[1] = width
        if dim == 2:
            mesh = create_rectangle(COMM, [lower, upper], [n] * 2, CellType.triangle)
        else:
            mesh = create_box(COMM, [lower, upper], [n] * 3, CellType.tetrahedron)
        outer = {LEFT: (0, 0.0)} if i == 0 else {RIGHT: (0, 2.0)}
        outer |= {100 * i + BOTTOM: (1, 0.0)} | ({100 * i + BACK: (2, 0.0)} if dim == 3 else {})
        outer[(ON_LEFT, ON_RIGHT)[i]] = (0, 1.0)
        sides = {
            tag: lambda x, axis=axis, at=at: np.abs(x[axis] - at) < 1e-9
            for tag, (axis, at) in outer.items()
        }
        meshes.append(mesh)
        tags.append(tag_facets(mesh, sides))
    joined = join_meshes(meshes, facet_tags=tags)
    labels = joined.part if label is None else label(joined)
    return explode(joined.mesh, labels, facet_tags=joined.facet_tags)


def rollers(dim):
    held = [PrescribedDisplacement(LEFT, 0, 0.0)]
    for axis, tag in ((1, BOTTOM), (2, BACK))[: dim - 1]:
        held += [
            PrescribedDisplacement(tag, axis, 0.0),
            PrescribedDisplacement(100 + tag, axis, 0.0),
        ]
    return held


def tied(dim, left, right, tie, loads, solver="subdomains", tolerance=1e-12, **boxes):
    scene = Scene(
        two_boxes(dim, left, right, **boxes),
        {1: LinearElastic(YOUNG, POISSON, 1.0)},
        default_interaction=PerfectBond(),
        loads=[*rollers(dim), *loads],
        ties=[tie],
    )
    return Simulation(scene, 1.0, tolerance=tolerance, solver=solver, **STATIC)


def error_of_tension(simulation) -> float:
    """Largest error beside a uniform tension of 1 along x, relative."""
    x, u = nodes(simulation), field(simulation)
    plane = simulation.bulk.dim == 2
    along = (1.0 - POISSON**2 if plane else 1.0) / YOUNG
    across = -POISSON * (1.0 + POISSON if plane else 1.0) / YOUNG
    exact = x * np.array([along] + [across] * (simulation.bulk.dim - 1))
    return float(np.abs(u - exact).max() / np.abs(exact).max())


def pull(dim):
    return [SurfaceTraction(RIGHT, (1.0, 0.0, 0.0)[:dim])]


FINE, COARSE = (ON_RIGHT, ON_LEFT), (ON_LEFT, ON_RIGHT)


@pytest.mark.parametrize("sides", (FINE, COARSE), ids=("fine", "coarse"))
@pytest.mark.parametrize("dim, left, right", [(2, 3, 5), (2, 4, 8), (3, 2, 3), (3, 2, 4)])
def test_a_mortar_passes_a_uniform_stress(dim, left, right, sides):
    """Whichever side bears the points, nested or not."""
    simulation = tied(dim, left, right, Tie(*sides, PerfectBond()), pull(dim))
    run(simulation, 1)
    assert error_of_tension(simulation) < 1e-10


@pytest.mark.parametrize(
    "dim, left, right, sides, passes",
    [
        (2, 4, 8, FINE, True),
        (3, 2, 4, FINE, True),
        (2, 4, 8, COARSE, False),
        (2, 3, 5, FINE, False),
    ],
)
def test_nodes_pass_it_from_the_fine_side_of_nested_meshes_alone(dim, left, right, sides, passes):
    simulation = tied(dim, left, right, Tie(*sides, PerfectBond(), rule="nodes"), pull(dim))
    run(simulation, 1)
    assert (error_of_tension(simulation) < 1e-10) == passes
    # a linear displacement opens no point either way
    x = nodes(simulation)
    slots = simulation.scheme.inverse(1.0, simulation.state.displacement).nodes
    linear = np.zeros((simulation.interactions.inverse.num_slots, dim))
    linear[: len(slots)] = x[slots] @ np.arange(1.0, dim * dim + 1.0).reshape(dim, dim)
    assert np.abs(simulation.interactions.points.relative(linear)).max() < 1e-12


def test_weights_and_areas_are_those_of_the_surface():
    """Weights of a side add up to one, areas to that of the surface, the normal points back."""
    simulation = tied(3, 2, 3, Tie(*FINE, PerfectBond()), pull(3))
    points = simulation.interactions.points
    np.testing.assert_allclose(points.weights.sum(axis=2), 1.0, rtol=1e-12)
    np.testing.assert_allclose(points.area.sum(), 1.0, rtol=1e-12)
    assert np.abs(points.frame[:, 0] - [1.0, 0.0, 0.0]).max() < 1e-12


def errors_under_weight(rule):
    """Errors of displacement in L2 and largest next to the tie, by halving, and uncut."""

    def uncut(n):
        mesh = mesh_of((2.0, 1.0), (2 * n, n), "triangle")
        bodies = explode(mesh, np.zeros(4 * n * n, int), facet_tags=side_tags(mesh, (2.0, 1.0)))
        loads = [
            PrescribedDisplacement(LEFT, 0, 0.0),
            PrescribedDisplacement(BOTTOM, 1, 0.0),
            weight,
        ]
        scene = Scene(bodies, {1: LinearElastic(YOUNG, POISSON, 1.0)}, loads=loads)
        return Simulation(scene, 1.0, **STATIC)

    weight = Gravity((1.0, -2.0))
    reference = uncut(96)
    run(reference, 1)
    tree, whole = cKDTree(nodes(reference)), field(reference)

    def error(simulation):
        run(simulation, 1)
        distance, place = tree.query(nodes(simulation))
        assert distance.max() < 1e-9
        left = field(simulation) - whole[place]
        near = np.abs(nodes(simulation)[:, 0] - 1.0) < 0.13
        mass = simulation.bulk.weights.reshape(left.shape)
        return np.sqrt((mass * left**2).sum()), np.abs(left[near]).max()

    sizes = ((4, 6), (8, 12), (16, 24))
    ours = [error(tied(2, *n, Tie(*FINE, PerfectBond(), rule), [weight])) for n in sizes]
    return np.array(ours), np.array([error(uncut(n)) for n, _ in sizes])


def test_a_mortar_converges_as_the_uncut_mesh():
    """Order two in L2, and next to the tie; no worse than the coarser mesh uncut."""
    ours, uncut = errors_under_weight("mortar")
    assert np.all(ours[:-1] > 3.4 * ours[1:])
    assert np.all(ours[:, 0] < uncut[:, 0]) and np.all(ours[:, 1] < 1.2 * uncut[:, 1])


def test_nodes_converge_slower_next_to_the_tie():
    ours, _ = errors_under_weight("nodes")
    ratio = ours[:-1, 1] / ours[1:, 1]
    assert np.all((1.9 < ratio) & (ratio < 3.0))


def test_ties_and_subdomains_go_together():
    """Both boxes cut; nodes take antagonists of several bodies, a mortar does not."""

    def cut(joined):
        height = np.where(joined.part == 0, 0.5, 0.25)
        return 2 * (midpoints(joined.mesh)[1] > height) + joined.part

    nested = {"dim": 2, "left": 4, "right": 8, "loads": pull(2), "label": cut}
    simulation = tied(tie=Tie(*FINE, PerfectBond(), "nodes"), **nested)
    run(simulation, 1)
    assert simulation.scene.bodies.num_bodies == 4
    assert error_of_tension(simulation) < 1e-10
    with pytest.raises(ValueError, match=r'of several bodies \(1 such nodes\): take rule="nodes"'):
        tied(tie=Tie(*FINE, PerfectBond()), **nested)


def test_a_cohesive_zone_acts_across_meshes():
    """Uniform tension: an opening t / C everywhere, one damage at all points, by a usual solver."""
    law = CohesiveZone(1e3, fracture_energy=0.5, strength=5.0)
    tie = Tie(*FINE, law)
    simulation = tied(2, 3, 5, tie, pull(2), solver="auto", tolerance=1e-11)
    run(simulation, 1)
    traction, jump = (simulation.interactions.gather(n) for n in ("traction", "jump"))
    np.testing.assert_allclose(traction[:, 0], -1.0, rtol=1e-6)
    np.testing.assert_allclose(jump[:, 0], jump[0, 0], rtol=1e-6)
    stiffness = 1e3 * simulation.interactions.gather("damage")
    np.testing.assert_allclose(stiffness * jump[:, 0], 1.0, rtol=1e-6)


# What is refused


def test_candidates_lie_within_antagonists():
    with pytest.raises(ValueError, match=r"cover 50 % of the candidate facet"):
        tied(2, 3, 2, Tie(*FINE, PerfectBond()), pull(2), width=0.75)
    with pytest.raises(ValueError, match=r"No antagonist facet holds the candidate node"):
        tied(2, 3, 2, Tie(*FINE, PerfectBond(), "nodes"), pull(2), width=0.75)
    run(tied(2, 3, 2, Tie(*COARSE, PerfectBond()), pull(2), width=0.75), 1)


def test_scenes_name_what_is_there():
    with pytest.raises(ValueError, match=r"A tie names facet tag 99, which occurs nowhere"):
        tied(2, 2, 3, Tie(ON_LEFT, 99, PerfectBond()), pull(2))
    with pytest.raises(ValueError, match="rule should be one of mortar, nodes, got 'gauss'"):
        Tie(1, 2, PerfectBond(), "gauss")
    with pytest.raises(ValueError, match="both facet tag 1"):
        Tie(1, 1, PerfectBond())
    bodies = two_boxes(2, 2, 3)
    elastic = {1: LinearElastic(YOUNG, POISSON, 1.0)}
    with pytest.raises(ValueError, match="triangle cells of order 2"):
        Scene(bodies, elastic, order=2, ties=[Tie(*FINE, PerfectBond())])
    scene = Scene(bodies, elastic, ties=[Tie(*FINE, PerfectBond())])
    with pytest.raises(ValueError, match=r"solves each vertex alone, and ties join several"):
        Simulation(scene, scheme="explicit")
    with pytest.raises(ValueError, match="of triangles of order 1, got facets of 4 nodes"):
        nonmatching_points(
            np.zeros((4, 3)), np.zeros((1, 4), int), np.zeros((1, 4), int), None, None
        )


# Joined meshes


def test_joined_meshes_keep_cells_tags_and_sides():
    one, two = mesh_of((1.0, 1.0), (2, 1)), mesh_of((1.0, 2.0), (1, 3))
    joined = join_meshes(
        [one, two],
        cell_tags=[None, tag_cells(two, {5: lambda x: x[1] > 1.0})],
        facet_tags=[tag_facets(one, {7: lambda x: x[0] < 1e-9}), None],
    )
    np.testing.assert_array_equal(np.bincount(joined.part), [8, 12])
    parts = [midpoints(mesh) for mesh in (one, two)]
    np.testing.assert_allclose(midpoints(joined.mesh), np.concatenate(parts, axis=1))
    expected = np.concatenate([np.ones(8), np.where(parts[1][1] > 1.0, 5, 1)])
    np.testing.assert_array_equal(joined.cell_tags.values, expected)
    cells = facet_cells(joined.mesh)[0]
    assert len(joined.facet_tags.find(7)) == 1
    assert np.all(joined.part[cells[joined.facet_tags.find(7), 0]] == 0)


def test_meshes_that_do_not_go_together_are_refused():
    flat, solid = mesh_of((1, 1), (1, 1)), mesh_of((1, 1, 1), (1, 1, 1), "tetrahedron")
    with pytest.raises(ValueError, match="meshes is empty"):
        join_meshes([])
    with pytest.raises(ValueError, match="tetrahedron and triangle cells"):
        join_meshes([flat, solid])
    with pytest.raises(ValueError, match=r"cell_tags has 1 entries for 2 meshes"):
        join_meshes([flat, flat], cell_tags=[None])
    with pytest.raises(ValueError, match=r"facet_tags\[0\] should tag entities of dimension 1"):
        join_meshes([flat], facet_tags=[tag_cells(flat, {})])
