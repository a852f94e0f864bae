# SPDX-License-Identifier: LGPL-3.0-or-later
"""Implicit and static scenes whose cells are one mesh until rigid bonds are near to opening."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import BACK, BOTTOM, LEFT, RIGHT, box_bodies

import xper_fx as xf
from xper_fx.bulk import breaking_vertices, monolithic_scheme
from xper_fx.simulation import model

ELASTIC = xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)
W, S = 1e-4, 1e-2
BRITTLE = xf.laws.RigidCohesiveZone(S, 0.1 * W, friction=0.3)
UNBREAKABLE = xf.laws.RigidCohesiveZone(1e3, 1e3)
BOXES = {
    2: ("crossed", (2.0, 1.0), (4, 2)),
    3: ("tetrahedron", (2.0, 1.0, 1.0), (2, 1, 1)),
}
in_both = pytest.mark.parametrize("dim", [2, 3])


def middle(x):
    """A strength that is higher by a half but in the middle of the bar."""
    return np.where(np.abs(x[0] - 1.0) < 1e-9, 1.0, 1.5) * S


TOUGH = xf.laws.RigidCohesiveZone(middle, 2.0 * W, friction=0.3)


def box(dim, law, label=None, step=0.05, material=ELASTIC, **options):
    kind, lengths, cells = BOXES[dim]
    bodies = box_bodies(lengths, cells, kind, label=label)
    names = ("loads", "initial_velocity", "order", "walls", "damping")
    scene = {name: options.pop(name) for name in names if name in options}
    return xf.Simulation(
        xf.Scene(bodies, {1: material}, default_interaction=law, **scene), step,
        **{"solver": "monolithic", "newton_tolerance": 1e-11, "num_threads": 1} | options,
    )  # fmt: skip


def drawn(dim, law, inertia, **options):
    """A bar whose end is drawn out, softly at first."""
    held = [(LEFT, 0), (BOTTOM, 1), (BACK, 2)][:dim]
    loads = [xf.PrescribedDisplacement(*side, 0.0) for side in held]
    loads.append(xf.PrescribedDisplacement(RIGHT, 0, lambda t: 0.02 * t**2))
    return box(dim, law, loads=loads, inertia=inertia, **options)


@pytest.fixture
def pointed(monkeypatch):
    """Makes simulations that have points on all facets from the start."""

    def make(simulation, *args, **options):
        with monkeypatch.context() as patch:
            patch.setattr(model, "condenses", lambda scene, laws: False)
            made = simulation(*args, **options)
        assert made.interactions.fused is None
        return made

    return make


def at_nodes(simulation):
    """Positions and displacements of the nodes of V."""
    V, dim = simulation.forms.V, simulation.bulk.dim
    u = simulation.bulk.unknowns.expand(simulation.state.displacement).reshape(-1, dim)
    return V.tabulate_dof_coordinates()[:, :dim], u


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("inertia", [True, False])
@in_both
def test_whole_vertices_are_nodes_of_finite_elements(dim, inertia, order):
    """The exploded mesh moves as the same mesh in one piece does, to rounding, without a point."""
    runs = [
        drawn(dim, law, inertia, order=order, label=label, step=0.25, solver=solver)
        for law, label, solver in ((UNBREAKABLE, None, "monolithic"), (None, 0, "auto"))
    ]
    for simulation in runs:
        list(simulation.steps(2.0))
    (x, u), (x1, u1) = map(at_nodes, runs)
    place = np.array([np.argmin(np.sum((x1 - p) ** 2, axis=1)) for p in x])
    assert np.abs(u).max() > 0.07
    assert np.abs(u - u1[place]).max() < 1e-13 * np.abs(u).max()
    assert all(len(group) == 0 for group in runs[0].interactions.groups)
    for p in np.unique(x, axis=0):  # to the bit
        assert len(np.unique(u[np.all(x == p, axis=1)], axis=0)) == 1
    work, reaction = (
        [s.ledger.energies.external_work for s in runs],
        [s.reaction(RIGHT)[0] for s in runs],
    )
    assert work[0] == pytest.approx(work[1], rel=1e-12)
    assert reaction[0] == pytest.approx(reaction[1], rel=1e-11)


DUCTILE = xf.materials.J2SmallStrain(
    young=1.0, poisson=0.3, yield_stress=8e-3, hardening=xf.materials.Linear(0.5), density=1.0
)
TURNING = xf.materials.SaintVenantKirchhoff(young=1.0, poisson=0.3, density=1.0)


def agree(runs, reference, end, error):
    """Take all to the end; displacements, reactions and energies are those of the reference."""
    steps = [run.steps(end) for run in runs]
    for _ in reference.steps(end):
        u, force = reference.state.displacement, reference.reaction(RIGHT)
        for run, step in zip(runs, steps, strict=True):
            next(step)
            assert np.abs(run.state.displacement - u).max() < error * np.abs(u).max()
            assert np.abs(run.reaction(RIGHT) - force).max() < error * S
    expected = reference.ledger.energies
    names = ("external_work", "elastic", "kinetic", "dissipated_cohesion", "dissipated_numerical")
    for run, step in zip(runs, steps, strict=True):
        assert next(step, None) is None
        e = run.ledger.energies
        for name in names:
            assert abs(getattr(e, name) - getattr(expected, name)) < error * e.external_work
    assert expected.dissipated_cohesion > 0.1 * W
    return expected


@pytest.mark.parametrize(
    ("dim", "inertia", "options"),
    [
        (2, True, {}),
        (3, True, {"theta": 0.7, "damping": xf.RayleighDamping(0.1, 0.05)}),
        (2, False, {}),
        (3, False, {}),
        (2, True, {"material": DUCTILE}),
        (2, False, {"material": TURNING}),
    ],
    ids=["plane", "space, damped", "plane, static", "space, static", "ductile", "turning"],
)
def test_the_result_is_that_of_points_on_all_facets(dim, inertia, options, pointed, monkeypatch):
    """Whatever the share of its strength at which a vertex is split."""
    step, end = (0.1, 1.4) if inertia else (0.125, 1.25)
    runs = []
    for share in (0.6, 1.0)[: 2 if dim == 2 else 1]:
        monkeypatch.setattr(breaking_vertices, "_AHEAD", share)
        runs.append(drawn(dim, TOUGH, inertia, step=step, **options))
        list(runs[-1].steps(0.8))
    reference = pointed(drawn, dim, TOUGH, inertia, step=step, **options)
    list(reference.steps(0.8))
    agree(runs, reference, end, 1e-9)
    split = [len(run.interactions.fused.split) for run in runs]
    assert 0 < split[-1] <= split[0]
    assert split[-1] < runs[0].interactions.fused.graphs.num_vertices


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_a_cracking_plate_takes_a_handful_of_iterations(tolerance, monkeypatch):
    """Bonds that reach their strength open at once; Newton's method needs no help and no cut.

    Where it went on from what bonds bear, and where bonds that open by little bore less than sound
    ones, a step in four took 22 to 62 corrections.
    """

    def no_help(*args):
        raise AssertionError("Newton's method went round in circles")

    monkeypatch.setattr(monolithic_scheme, "find_contacts", no_help)
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (10, 10))
    sides = {
        1: lambda x: (x[0] < 1e-9) & (x[1] < 0.35),
        2: lambda x: (x[0] < 1e-9) & (x[1] > 0.65),
        3: lambda x: x[0] > 1.0 - 1e-9,
        4: lambda x: (np.abs(x[1] - 0.5) < 1e-9) & (x[0] < 0.301),
    }

    def strength(x):
        return np.where(np.abs(x[1] - 0.5) < 1e-9, 1.0, 2.0) * S

    law = xf.laws.RigidCohesiveZone(strength, 0.5 * W, viscosity=0.01)
    motions = [(1, 1, lambda t: -0.01 * t**2), (2, 1, lambda t: 0.01 * t**2)]
    motions += [(3, axis, 0.0) for axis in (0, 1)]
    scene = xf.Scene(
        xf.explode(mesh, facet_tags=xf.tag_facets(mesh, sides)), {1: ELASTIC},
        default_interaction=law, facet_interactions={4: None},
        loads=[xf.PrescribedDisplacement(*motion) for motion in motions],
    )  # fmt: skip
    simulation = xf.Simulation(scene, 0.05, solver="monolithic", newton_tolerance=tolerance)
    taken = [record.newton_iterations for record in simulation.steps(2.0)]
    assert len(taken) == 40
    assert max(taken) < 20
    assert np.mean(taken) < 6
    energies = simulation.ledger.energies
    assert energies.dissipated_cohesion == pytest.approx(0.7814 * 0.5 * W, rel=2e-3)
    assert abs(simulation.ledger.closure) < 1e-7 * energies.external_work


def flying_apart(x):
    """A field that tears a body apart and makes it spin."""
    return np.array([0.04 * np.sin(2.0 * x[0]) - 0.005 * x[1], 0.005 * x[0], 0.0 * x[0]])


@in_both
def test_a_body_that_breaks_in_flight_keeps_its_momenta_and_its_energy(dim):
    simulation = box(dim, BRITTLE, initial_velocity=lambda x: flying_apart(x)[:dim])
    mass = simulation.bulk.mass.reshape(-1, dim)
    x, _ = at_nodes(simulation)

    def momenta():
        p = mass * simulation.state.velocity.reshape(-1, dim)
        return np.append(p.sum(axis=0), (x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0]).sum())

    start, kinetic = momenta(), simulation.ledger.energies.kinetic
    for _ in simulation.steps(1.2):
        assert abs(simulation.ledger.closure) < 1e-11 * kinetic
    assert np.abs(momenta() - start).max() < 1e-10 * np.abs(start).max()
    spent, area = (simulation.interactions.gather(n) for n in ("spent", "area"))
    assert min(map(np.count_nonzero, (spent > 0.99, spent == 0.0))) > 2
    cracked = simulation.ledger.energies.dissipated_cohesion
    assert cracked == pytest.approx(BRITTLE.fracture_energy * (spent @ area), rel=1e-11)


def test_cells_bonded_to_a_driven_one_are_driven(pointed):
    """Only the upper half of a side is pulled: its end is a vertex with driven and free corners."""

    def pulled():
        mesh = xf.crossed_rectangle((0.0, 0.0), (2.0, 1.0), (4, 2))
        sides = {1: lambda x: x[0] < 1e-9, 2: lambda x: (x[0] > 1.999) & (x[1] > 0.499)}
        bodies = xf.explode(mesh, facet_tags=xf.tag_facets(mesh, sides))
        loads = [xf.PrescribedDisplacement(1, axis, 0.0) for axis in (0, 1)]
        loads.append(xf.PrescribedDisplacement(2, 0, lambda t: 0.02 * t**2))
        scene = xf.Scene(bodies, {1: ELASTIC}, default_interaction=TOUGH, loads=loads)
        return xf.Simulation(scene, 0.1, solver="monolithic", newton_tolerance=1e-11)

    ours, reference = pulled(), pointed(pulled)
    for _ in zip(ours.steps(0.8), reference.steps(0.8), strict=True):
        force = reference.reaction(2)
        np.testing.assert_allclose(ours.reaction(2), force, atol=1e-9 * np.abs(force).max())
    assert 0 < len(ours.interactions.fused.split) < 12
    assert abs(ours.ledger.closure) < 1e-11 * ours.ledger.energies.external_work


def test_what_motions_tear_apart_is_split_at_once():
    """Two sides that meet at a corner move apart: its cells are not one from the first step on."""
    sides = {1: lambda x: x[0] < 1e-9, 2: lambda x: x[1] < 1e-9}
    mesh = xf.crossed_rectangle((0.0, 0.0), (1.0, 1.0), (2, 2))
    bodies = xf.explode(mesh, facet_tags=xf.tag_facets(mesh, sides))
    loads = [xf.PrescribedVelocity(1, 0, 0.0), xf.PrescribedVelocity(2, 0, 1e-3)]
    scene = xf.Scene(bodies, {1: ELASTIC}, default_interaction=TOUGH, loads=loads)
    simulation = xf.Simulation(scene, 0.05, solver="monolithic")
    list(simulation.steps(0.1))
    x, u = at_nodes(simulation)
    assert len(simulation.interactions.fused.split) > 0
    prescribed = simulation.bulk.layout.prescribed.reshape(-1, 2)[:, 0]
    corner = prescribed & (np.abs(x).max(axis=1) < 1e-9)
    np.testing.assert_allclose(np.unique(u[corner, 0]), [0.0, 7.5e-5], atol=1e-16)


def test_a_bond_to_the_ground_has_its_points_from_the_start():
    wall = xf.Wall(BOTTOM, (0.0, 0.0), (0.0, 1.0), xf.laws.RigidCohesiveZone(1e-3 * S, W))
    simulation = box(2, UNBREAKABLE, walls=[wall], loads=[xf.BodyForce((0.0, 1e-4))])
    list(simulation.steps(2.0))
    spent = simulation.interactions.gather("spent")[-5:]
    assert len(simulation.interactions.fused.split) == 5
    assert np.all(spent > 0.0)


def test_other_laws_at_a_vertex_are_asked_with_its_bonds(pointed):
    """A notch of contact: its vertices have their points from the start."""

    def pressed():
        mesh = xf.crossed_rectangle((0.0, 0.0), (2.0, 1.0), (4, 2))
        tags = {1: lambda x: x[0] < 1e-9, 2: lambda x: x[0] > 1.999,
                7: lambda x: (np.abs(x[0] - 1.0) < 1e-9) & (x[1] < 0.501)}  # fmt: skip
        bodies = xf.explode(mesh, facet_tags=xf.tag_facets(mesh, tags))
        loads = [xf.PrescribedDisplacement(1, axis, 0.0) for axis in (0, 1)]
        loads.append(xf.PrescribedDisplacement(2, 0, lambda t: 0.01 * np.sin(2.0 * t) ** 2))
        scene = xf.Scene(
            bodies, {1: ELASTIC}, default_interaction=TOUGH, loads=loads,
            facet_interactions={7: xf.laws.SignoriniCoulomb(0.3)},
        )  # fmt: skip
        return xf.Simulation(scene, 0.1, solver="monolithic", newton_tolerance=1e-11)

    ours, reference = pressed(), pointed(pressed)
    assert len(ours.interactions.fused.split) == 2
    for _ in zip(ours.steps(1.2), reference.steps(1.2), strict=True):
        u, u1 = ours.state.displacement, reference.state.displacement
        assert np.abs(u - u1).max() < 1e-9 * np.abs(u1).max()
    assert len(ours.interactions.fused.split) < 23


def test_dynamic_runs_are_solved_in_one_system_where_cells_share_unknowns():
    """Sweeps stay where points are everywhere, and where an explicit bulk is asked for."""
    picked = drawn(2, TOUGH, True, solver="auto")
    assert picked.model.monolithic and picked.interactions.fused is not None
    assert not drawn(2, TOUGH, True, solver="auto", scheme="explicit", step=0.01).model.monolithic
    elastic = xf.laws.CohesiveZone(50.0, W, S)
    assert not drawn(2, elastic, True, solver="auto").model.monolithic
    touching = [xf.Contact(("a", "a"), xf.laws.SignoriniCoulomb(0.3))]
    for more in ({"points": "gauss"}, {"surfaces": {"a": (1,)}, "contacts": touching}):
        bodies = box_bodies((2.0, 1.0), (4, 2))
        scene = xf.Scene(bodies, {1: ELASTIC}, default_interaction=TOUGH, **more)
        assert not xf.Simulation(scene, 0.1, scheme="implicit").model.monolithic


def test_sweeps_take_over_from_a_system_that_was_picked(monkeypatch):
    """Bonds that have opened stay open, as in a run of sweeps alone; a restart goes on the same."""
    options = {"inertia": True, "tolerance": 1e-10, "max_sweeps": 100_000}
    runs = [drawn(2, TOUGH, solver=solver, **options) for solver in ("auto", "newton")]
    ours, reference = runs
    attempt = monolithic_scheme.MonolithicScheme.attempt

    def fails(self, state, *args):
        outcome = attempt(self, state, *args)
        return outcome._replace(converged=state.time < 1.6)

    monkeypatch.setattr(monolithic_scheme.MonolithicScheme, "attempt", fails)
    for simulation in runs:
        list(simulation.steps(1.6))
    assert ours.model.monolithic
    opened = ours.ledger.energies.dissipated_cohesion
    for simulation in runs:
        list(simulation.steps(1.8))
    assert not ours.model.monolithic and ours.interactions.fused is None
    assert ours.step_number == reference.step_number
    e = ours.ledger.energies
    assert 0.1 * W < opened < e.dissipated_cohesion
    u, u1 = ours.state.displacement, reference.state.displacement
    assert np.abs(u - u1).max() < 1e-7 * np.abs(u1).max()
    assert abs(ours.ledger.closure) < 1e-8 * e.external_work

    again = drawn(2, TOUGH, solver="auto", **options)
    again.restore(ours.saved_in_order())
    for simulation in (ours, again):
        list(simulation.steps(2.0))
    assert not again.model.monolithic
    assert np.array_equal(again.state.displacement, ours.state.displacement)
    assert again.ledger.energies == ours.ledger.energies


def test_what_bursts_runs_to_its_end():
    """A plate that comes apart at once, where Newton's method alone stopped at 0.45 s."""
    bodies = box_bodies((1.0, 1.0), (8, 8), "crossed")
    scene = xf.Scene(
        bodies, {1: ELASTIC},
        default_interaction=xf.laws.RigidCohesiveZone(S, 2.0 * W, friction=0.3),
        initial_velocity=lambda x: np.array([0.1 * (x[0] - 0.5), -0.05 * (x[1] - 0.5)]),
    )  # fmt: skip
    simulation = xf.Simulation(scene, 0.05, scheme="implicit", num_threads=1)
    assert simulation.model.monolithic
    list(simulation.steps(2.0))
    e = simulation.ledger.energies
    assert e.dissipated_cohesion > 0.5 * W
    assert abs(simulation.ledger.closure) < 1e-9 * e.dissipated_cohesion


def test_what_is_not_condensed_has_all_points():
    """Points at several nodes a side, sweeps, which know no system of all cells, and paths."""
    halves = box_bodies((2.0, 1.0), (4, 2), label=lambda x: x[0] > 1.0)
    for points, solver in (("gauss", "monolithic"), ("nodal", "nlgs")):
        scene = xf.Scene(halves, {1: ELASTIC}, default_interaction=TOUGH, points=points)
        assert xf.Simulation(scene, 0.1, solver=solver).interactions.fused is None
    middle = {7: lambda x: np.abs(x[0] - 1.0) < 1e-9}
    loads = [xf.PrescribedDisplacement(LEFT, axis, 0.0) for axis in (0, 1)]
    loads.append(xf.PrescribedDisplacement(RIGHT, 0, lambda t: 0.01 * t))
    scene = xf.Scene(
        box_bodies((2.0, 1.0), (4, 2), interior=middle), {1: ELASTIC}, loads=loads,
        default_interaction=UNBREAKABLE, facet_interactions={7: xf.laws.CohesiveZone(50.0, W, S)},
    )  # fmt: skip
    on_path = xf.Simulation(scene, 0.1, inertia=False, path=xf.GrowthControl(0.2))
    list(on_path.steps(4.0))
    assert on_path.interactions.fused is None
    assert on_path.ledger.energies.dissipated_cohesion > 0.0
