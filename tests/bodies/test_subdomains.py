# SPDX-License-Identifier: LGPL-3.0-or-later
"""Perfect bonds as domain decomposition: the field of the uncut mesh, at no growing cost."""

from dataclasses import replace

import numpy as np
import pytest
from outside_law import Weld
from scenes import (
    BOTTOM,
    LEFT,
    RIGHT,
    TOP,
    box_bodies,
    field,
    mesh_of,
    midpoints,
    nodes,
    run,
    side_tags,
)
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from xper_fx.bodies.explode import EACH_CELL, explode
from xper_fx.bodies.join import join_meshes
from xper_fx.bodies.meshes import facet_cells, tag_cells
from xper_fx.bodies.partition import partition
from xper_fx.forms.loads import PrescribedDisplacement, SurfaceTraction
from xper_fx.materials import J2SmallStrain, Linear, LinearElastic, NeoHookean
from xper_fx.nscd.laws import CohesiveZone, PerfectBond, SignoriniCoulomb
from xper_fx.nscd.solvers import BondedGradients
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

ELASTIC = LinearElastic(young=100.0, poisson=0.3, density=1.0)
KIND = {2: "triangle", 3: "tetrahedron"}
STATIC = {"inertia": False, "theta": 1.0}


def clamped(dim, cells, count, materials=None, tags=None, force=1.0, **options):
    """A unit box clamped at its left and loaded at its right, cut into subdomains (or labels)."""
    lengths = (1.0,) * dim
    mesh = mesh_of(lengths, (cells,) * dim, KIND[dim])
    labels = partition(mesh, count) if isinstance(count, int) else count(mesh)
    bodies = explode(mesh, labels, tag_cells(mesh, tags or {}), side_tags(mesh, lengths))
    loads = [PrescribedDisplacement(LEFT, axis, 0.0) for axis in range(dim)]
    pull = force * np.array((1.0, -2.0, 0.5)[:dim])
    return Scene(
        bodies,
        materials or {1: ELASTIC},
        default_interaction=PerfectBond(),
        loads=[*loads, SurfaceTraction(RIGHT, pull)],
        **options,
    )


def difference(ours, reference, where=lambda x: np.ones(len(x), bool)) -> float:
    """Largest difference of displacements, relative; nodes are matched by their parent's."""

    def by_parent(simulation):
        V, bodies = simulation.forms.V, simulation.scene.bodies
        node = np.empty(len(V.mesh.geometry.x), int)
        node[V.mesh.geometry.dofmap.ravel()] = V.dofmap.list.ravel()
        return field(simulation)[node], bodies.parent_vertex

    values, parent = by_parent(ours)
    uncut, place = by_parent(reference)
    whole = np.empty_like(uncut)
    whole[place] = uncut
    here = where(ours.scene.bodies.mesh.geometry.x)
    return float(np.abs(values - whole[parent])[here].max() / np.abs(whole).max())


# Cutting


def number_connected(mesh, labels):
    """How many sets of cells of one label hang together by facets."""
    pairs = facet_cells(mesh)[0]
    pairs = pairs[(pairs[:, 1] >= 0)]
    inside = pairs[labels[pairs[:, 0]] == labels[pairs[:, 1]]]
    graph = coo_array((np.ones(len(inside)), tuple(inside.T)), shape=2 * (len(labels),))
    return connected_components(graph, directed=False)[0]


@pytest.mark.parametrize("kind, cells", [("crossed", (9, 7)), ("tetrahedron", (4, 3, 3))])
@pytest.mark.parametrize("count", (1, 4, 16, 64))
def test_parts_hang_together_and_are_alike(kind, cells, count):
    mesh = mesh_of(np.ones(len(cells)), cells, kind)
    labels = partition(mesh, count, 1.5)
    sizes = np.bincount(labels)
    assert len(sizes) == count and sizes.min() > 0
    assert sizes.max() <= max(1.5 * len(labels) / count, len(labels) / count + 3)
    assert number_connected(mesh, labels) == count


def test_parts_are_the_same_twice():
    mesh = mesh_of((1, 1), (64, 64), "triangle")
    first = partition(mesh, 16)
    assert all(np.array_equal(partition(mesh, 16), first) for _ in range(5))


def test_every_cell_may_be_a_subdomain():
    mesh = mesh_of((1, 1), (2, 2))
    np.testing.assert_array_equal(np.sort(partition(mesh, 16)), np.arange(16))


def test_pieces_of_a_mesh_are_cut_by_their_size():
    mesh = join_meshes([mesh_of((1, 1), (4, 4)), mesh_of((1, 1), (8, 8))]).mesh
    labels = partition(mesh, 5)
    assert len(set(labels[:64])) == 1 and len(set(labels[64:])) == 4
    with pytest.raises(ValueError, match=r"count is 1; expected a number from 2, the pieces"):
        partition(mesh, 1)


@pytest.mark.parametrize(
    "count, error, message",
    [(0, ValueError, "count is 0"), (17, ValueError, "to 16, its cells"), (2.0, TypeError, "2.0")],
)
def test_a_number_that_makes_no_sense_is_refused(count, error, message):
    with pytest.raises(error, match=message):
        partition(mesh_of((1, 1), (2, 2)), count)


def test_a_bound_on_the_imbalance_is_kept():
    """Where the partitioner's parts miss it cells change parts, which stay connected."""
    mesh = mesh_of((1, 1), (40, 40))
    labels = partition(mesh, 7, 1.0)
    sizes = np.bincount(labels)
    assert sizes.max() <= len(labels) / 7 + 3 and number_connected(mesh, labels) == len(sizes) == 7


def test_a_bound_that_cannot_be_kept_is_refused():
    mesh = join_meshes([mesh_of((1, 1), (4, 4)), mesh_of((1, 1), (8, 8))]).mesh
    with pytest.raises(ValueError, match=r"The largest of 2 subdomains .* imbalance of 1.2 allows"):
        partition(mesh, 2)


# The field of the uncut mesh


@pytest.mark.slow
@pytest.mark.parametrize("dim, cells", [(2, 16), (3, 5)])
@pytest.mark.parametrize(
    "step, options",
    [(1.0, STATIC), (0.02, {}), (0.3, {"theta": 0.7})],
    ids=("static", "short", "long"),
)
def test_cut_and_uncut_have_one_field(dim, cells, step, options):
    """Displacement after two steps, to 1e-10; impulses hold each body without any help."""
    uncut = Simulation(clamped(dim, cells, 1), step, **options)
    run(uncut, 2)
    iterations = []
    for count in (4, 16, 64):
        cut = Simulation(
            clamped(dim, cells, count), step, tolerance=1e-12, solver="subdomains", **options
        )
        iterations.append(run(cut, 2)[0].sweeps)
        assert difference(cut, uncut) < 1e-10, count
        assert cut.interactions.anchors is None or np.any(cut.interactions.anchors.velocity)
    assert max(iterations) < 30


def iterations_of(dim, cells, counts, coarse_space, options):
    """Iterations of the first solve to 1e-8; without a coarse space bodies float on springs."""
    first = []

    class Counted(BondedGradients):
        def solve(self, *arguments):
            report = super().solve(*arguments)
            first.append(report.sweeps)
            return report

    out = []
    for count in counts:
        first.clear()
        simulation = Simulation(
            clamped(dim, cells, count), 1.0, tolerance=1e-8, newton_tolerance=0.1,
            solver=Counted(coarse_space=coarse_space), **options,
        )  # fmt: skip
        run(simulation, 1)
        out.append(first[0])
    return np.array(out)


@pytest.mark.slow
@pytest.mark.parametrize("options", (STATIC, {"theta": 0.5}), ids=("static", "dynamic"))
def test_iterations_do_not_grow_with_the_number_of_subdomains(options):
    """Not from 16 to 64 (four have hardly an inside); several times without the coarse space."""
    with_it = iterations_of(2, 48, (4, 16, 64), True, options)
    assert with_it[2] <= with_it[1] + 1 and with_it.max() <= 1.5 * with_it[0]
    without = iterations_of(2, 48, (4, 16, 64), False, options)
    assert np.all(without[1:] > 2.5 * without[:-1]) and without[2] > 10 * with_it[2]


def test_a_first_guess_is_made_use_of():
    """The second static step under a steady load has nothing left to find."""
    simulation = Simulation(clamped(2, 16, 16), 1.0, tolerance=1e-8, solver="subdomains", **STATIC)
    first, second = run(simulation, 2)
    assert first.sweeps > 5 and second.sweeps == 1


def test_stiffness_may_jump_between_subdomains():
    """A checkerboard of moduli 1 : 1e4 that follows the cuts costs a few iterations more."""

    def squares(mesh):
        x = midpoints(mesh)
        return ((4 * x[0]).astype(int) + 4 * (4 * x[1]).astype(int)).astype(int)

    def stiff(x):
        return (np.floor(4 * x[0]) + np.floor(4 * x[1])) % 2 == 1

    materials = {1: ELASTIC, 2: LinearElastic(young=1e6, poisson=0.3, density=1.0)}
    scenes = [clamped(2, 16, count, materials, {2: stiff}) for count in (1, squares)]
    uncut, cut = (
        Simulation(s, 1.0, tolerance=1e-12, solver=solver, **STATIC)
        for s, solver in zip(scenes, ("auto", "subdomains"), strict=True)
    )
    run(uncut, 1)
    assert run(cut, 1)[0].sweeps < 40
    assert difference(cut, uncut) < 1e-9


def test_each_cell_may_float():
    cut, uncut = (
        Simulation(clamped(2, 4, c), 1.0, tolerance=1e-12, solver="subdomains", **STATIC)
        for c in (lambda mesh: EACH_CELL, 1)
    )
    run(cut, 1), run(uncut, 1)
    assert cut.scene.bodies.num_bodies == 32
    assert difference(cut, uncut) < 1e-10


# Other laws, other solvers


def torn(count, law, **options):
    """Two halves with a law between them, each cut into subdomains, pulled apart."""
    mesh = mesh_of((2.0, 1.0), (8, 4), "triangle")
    right = midpoints(mesh)[0] > 1.0
    labels = right.astype(int) if count == 1 else 2 * partition(mesh, count, 1.5) + right
    tags = side_tags(mesh, (2.0, 1.0), {7: lambda x: np.abs(x[0] - 1.0) < 1e-9})
    loads = [PrescribedDisplacement(LEFT, 0, 0.0), PrescribedDisplacement(BOTTOM, 1, 0.0)]
    scene = Scene(
        explode(mesh, labels, facet_tags=tags),
        {1: ELASTIC},
        default_interaction=PerfectBond(),
        facet_interactions={7: law},
        loads=[*loads, PrescribedDisplacement(RIGHT, 0, lambda t: 0.02 * t)],
    )
    return Simulation(scene, 1.0, tolerance=1e-10, newton_tolerance=1e-10, **options)


@pytest.mark.parametrize("options", (STATIC, {"theta": 1.0}), ids=("static", "dynamic"))
def test_a_crack_between_subdomains_is_that_of_two_halves(options):
    """A cohesive zone on one interface, perfect bonds on the others; by the usual solvers."""
    law = CohesiveZone(1e3, fracture_energy=0.5, strength=5.0)
    halves, cut = torn(1, law, **options), torn(6, law, **options)
    run(halves, 5), run(cut, 5)
    assert cut.scene.bodies.num_bodies > 6
    damage, left = (s.interactions.gather("damage") for s in (halves, cut))
    assert 0.5 < damage.min() and damage.max() < 0.99
    np.testing.assert_allclose(np.sort(left[left > 0.0]), np.sort(damage), rtol=1e-6)
    np.testing.assert_allclose(cut.reaction(RIGHT), halves.reaction(RIGHT), rtol=1e-6, atol=1e-9)
    assert difference(cut, halves, lambda x: np.abs(x[:, 0] - 1.0) > 1e-9) < 1e-6


@pytest.mark.parametrize("dim, cells", [(2, 8), (3, 3)])
def test_a_law_of_ones_own_that_leaves_no_jump_joins_subdomains(dim, cells):
    """The field is that of the package's bonds, and so are the forces."""
    bonded = clamped(dim, cells, 4)
    welded = replace(bonded, default_interaction=Weld())
    package = Simulation(bonded, 0.3, tolerance=1e-12, solver="subdomains", theta=0.7)
    run(package, 2)
    own = Simulation(welded, 0.3, tolerance=1e-12, solver="subdomains", theta=0.7)
    run(own, 2)
    size = np.abs(field(package)).max()
    np.testing.assert_allclose(field(own), field(package), rtol=0.0, atol=1e-14 * size)
    np.testing.assert_allclose(own.reaction(LEFT), package.reaction(LEFT), rtol=1e-12)


def test_the_solver_of_bonds_refuses_other_laws():
    with pytest.raises(ValueError, match=r"PerfectBond at every point.*cohesive zone.*newton"):
        run(torn(1, CohesiveZone(1e3, 0.5, 5.0), solver="subdomains"), 1)


def test_what_auto_takes_for_bodies_that_float_finds_the_same():
    """Bulk and interactions in one system."""
    cut = Simulation(clamped(2, 16, 16), 1.0, **STATIC)
    same = Simulation(clamped(2, 16, 16), 1.0, tolerance=1e-10, solver="subdomains", **STATIC)
    assert run(cut, 1)[0].sweeps == 0
    assert run(same, 1)[0].sweeps > 0
    size = np.abs(field(same)).max()
    np.testing.assert_allclose(field(cut), field(same), atol=1e-7 * size)


@pytest.mark.parametrize("solver", ("newton", "nlgs"))
def test_springs_let_go(solver):
    """Solvers that know of no floating bodies: a few iterations of the bulk, the same field."""

    def halves(mesh):
        return (midpoints(mesh)[0] > 0.5).astype(int)

    uncut = Simulation(clamped(2, 2, 1), 1.0, **STATIC)
    cut = Simulation(
        clamped(2, 2, halves), 1.0, tolerance=1e-11, newton_tolerance=1e-10, solver=solver,
        max_sweeps=200_000, num_threads=1, **STATIC,
    )  # fmt: skip
    run(uncut, 1)
    assert 1 < run(cut, 1)[0].newton_iterations < 8
    assert difference(cut, uncut) < 1e-8


def test_a_contact_in_compression_holds_a_block():
    """A block without inertia on another: friction holds it as it is pressed down."""
    bodies = box_bodies((1.0, 2.0), (2, 4), "triangle", label=lambda x: x[1] > 1.0)
    loads = [PrescribedDisplacement(BOTTOM, axis, 0.0) for axis in (0, 1)]
    scene = Scene(
        bodies,
        {1: LinearElastic(young=100.0, poisson=0.0, density=1.0)},
        default_interaction=SignoriniCoulomb(0.5, contact="position"),
        loads=[*loads, SurfaceTraction(TOP, (0.0, -1.0))],
    )
    simulation = Simulation(scene, 1.0, tolerance=1e-10, newton_tolerance=1e-8, **STATIC)
    run(simulation, 1)
    np.testing.assert_allclose(
        field(simulation)[:, 1], -nodes(simulation)[:, 1] / 100.0, rtol=1e-6, atol=1e-9
    )


# What holds what


def test_joined_bodies_that_nothing_holds_are_refused():
    scene = clamped(2, 4, 4)
    scene = Scene(
        scene.bodies, scene.materials, default_interaction=PerfectBond(),
        loads=[PrescribedDisplacement(LEFT, 0, 0.0)],
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"body 0 is free with the 3 it is joined to.* 1 way"):
        Simulation(scene, 1.0, **STATIC)


def test_a_body_on_a_hinge_is_refused():
    """Interactions at a single node."""
    bodies = box_bodies((2.0, 1.0), (2, 1), "quadrilateral", label=lambda x: x[0] > 1.0)
    scene = Scene(
        bodies, {1: ELASTIC}, default_interaction=PerfectBond(),
        loads=[PrescribedDisplacement(LEFT, axis, 0.0) for axis in (0, 1)],
    )  # fmt: skip
    from xper_fx.bulk.body_dofs import BodyLayout
    from xper_fx.bulk.floating_bodies import AnchoredInverse

    simulation = Simulation(scene, 1.0, **STATIC)
    layout: BodyLayout = simulation.bulk.layout
    x = nodes(simulation)
    one = layout.nodes[layout.offsets[1] : layout.offsets[1] + 1]
    with pytest.raises(ValueError, match=r"hold body 1, and they act at 1 node\(s\) of it"):
        AnchoredInverse(layout, x, one)
    with pytest.raises(ValueError, match="hold body 7, "):  # by its number on all ranks
        AnchoredInverse(layout, x, one, np.array([4, 7]))


# Several physics in one mesh


@pytest.mark.parametrize("options", (STATIC, {"theta": 1.0}), ids=("static", "dynamic"))
def test_each_subdomain_has_its_physics(options):
    """Small strain, plasticity and finite strain side by side: Newton's field is that uncut."""
    materials = {
        1: LinearElastic(young=100.0, poisson=0.3, density=1.0),
        2: J2SmallStrain(
            young=100.0, poisson=0.3, yield_stress=0.5, hardening=Linear(20.0), density=1.0
        ),
        3: NeoHookean(young=100.0, poisson=0.3, density=1.0),
    }
    tags = {2: lambda x: (x[0] > 0.33) & (x[0] <= 0.66), 3: lambda x: x[0] > 0.66}

    def six(mesh):
        x = midpoints(mesh)
        return (x[0] > 0.33).astype(int) + (x[0] > 0.66) + 3 * (x[1] > 0.5)

    results = []
    for count in (1, six):
        scene = clamped(2, 9, count, materials, tags)
        loads = [*scene.loads[:2], PrescribedDisplacement(RIGHT, 0, lambda t: 0.01 * t)]
        scene = Scene(
            scene.bodies, materials, default_interaction=PerfectBond(),
            loads=[*loads, PrescribedDisplacement(RIGHT, 1, lambda t: 0.02 * t)],
        )  # fmt: skip
        simulation = Simulation(
            scene, 0.5, tolerance=1e-11, newton_tolerance=1e-10, solver="subdomains",
            max_halvings=0, **options,
        )  # fmt: skip
        records = run(simulation, 3)
        assert max(record.newton_iterations for record in records) < 20
        results.append(simulation)
    uncut, cut = results
    assert cut.scene.bodies.num_bodies == 6
    assert difference(cut, uncut) < 1e-8
    plastic = uncut.ledger.as_columns()["dissipated_plastic"]
    assert plastic > 1e-4
    np.testing.assert_allclose(cut.ledger.as_columns()["dissipated_plastic"], plastic, rtol=1e-8)
