# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scenes whose cells are one mesh until initially rigid bonds between them let go."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from scenes import BOTTOM, LEFT, RIGHT, box_bodies

import xper_fx as xf
from xper_fx.nscd.laws.law import ALL_ENERGIES
from xper_fx.simulation.cohesive_scales import cohesive_scales

ELASTIC = xf.materials.LinearElastic(young=1.0, poisson=0.3, density=1.0)
W, S = 1e-4, 1e-2
BOND = xf.laws.RigidCohesiveZone(S, W, friction=0.3)
BRITTLE = xf.laws.RigidCohesiveZone(S, 0.1 * W, friction=0.3)
MODES = xf.laws.RigidMixedMode((S, 1.5 * S), (0.15 * W, 0.25 * W), 1.5, friction=0.3)
UNBREAKABLE = xf.laws.RigidCohesiveZone(1e3, 1e3)
ONE = {"num_threads": 1, "scheme": "explicit"}
BOXES = {
    2: ("crossed", (2.0, 1.0), (4, 2)),
    3: ("tetrahedron", (2.0, 1.0, 1.0), (2, 1, 1)),
}
in_both = pytest.mark.parametrize("dim", [2, 3])


def box(dim, law=BOND, label=None, **options):
    kind, lengths, cells = BOXES[dim]
    bodies = box_bodies(lengths, options.pop("cells", cells), kind, label=label)
    return xf.Scene(bodies, {1: ELASTIC}, default_interaction=law, **options)


def pulled(dim, speed=0.05, **options):
    loads = [xf.PrescribedVelocity(LEFT, 0, 0.0), xf.PrescribedVelocity(RIGHT, 0, speed)]
    return box(dim, loads=loads, **options)


def flying_apart(x):
    """A field that tears a body apart and makes it spin."""
    rest = 0.0 * x[0]
    return np.array([0.04 * np.sin(2.0 * x[0]) - 0.005 * x[1], 0.005 * x[0], rest])


def at_nodes(simulation):
    """Positions and displacements of the nodes of V."""
    V, dim = simulation.forms.V, simulation.bulk.dim
    u = simulation.bulk.unknowns.expand(simulation.state.displacement).reshape(-1, dim)
    return V.tabulate_dof_coordinates()[:, :dim], u


@pytest.mark.parametrize("order", [1, 2])
@in_both
def test_whole_vertices_are_nodes_of_finite_elements(dim, order):
    """The exploded mesh moves as the same mesh in one piece does, to rounding, without a point."""
    exploded = xf.Simulation(pulled(dim, 0.01, law=UNBREAKABLE, order=order), **ONE)
    step = exploded.step_size
    one = xf.Simulation(pulled(dim, 0.01, law=None, label=0, order=order), step, **ONE)
    for simulation in (exploded, one):
        list(simulation.steps(60 * step))
    x, u = at_nodes(exploded)
    x1, u1 = at_nodes(one)
    place = np.array([np.argmin(np.sum((x1 - p) ** 2, axis=1)) for p in x])
    assert np.abs(u).max() > 1e-3
    assert np.abs(u - u1[place]).max() < 1e-14 * np.abs(u).max() * 60
    assert all(len(group) == 0 for group in exploded.interactions.groups)
    for p in np.unique(x, axis=0):  # to the bit
        assert len(np.unique(u[np.all(x == p, axis=1)], axis=0)) == 1
    energies = [s.ledger.energies for s in (exploded, one)]
    assert energies[0].external_work == pytest.approx(energies[1].external_work, rel=1e-12)


@pytest.mark.parametrize("law", [BRITTLE, dataclasses.replace(BRITTLE, viscosity=0.2), MODES])
@in_both
def test_a_body_that_breaks_in_flight_keeps_its_momenta_and_its_energy(dim, law):
    simulation = xf.Simulation(
        box(dim, law, initial_velocity=lambda x: flying_apart(x)[:dim]), **ONE
    )  # fmt: skip
    mass = simulation.bulk.mass.reshape(-1, dim)
    x, _ = at_nodes(simulation)

    def momenta():
        p = mass * simulation.state.velocity.reshape(-1, dim)
        turning = x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0]
        return np.append(p.sum(axis=0), turning.sum())

    start, kinetic = momenta(), simulation.ledger.energies.kinetic
    for _ in simulation.steps(4.0):
        e = simulation.ledger.energies
        assert abs(simulation.ledger.closure) < 1e-13 * kinetic
    assert np.abs(momenta() - start).max() < 1e-13 * np.abs(start).max()
    spent, area = (simulation.interactions.gather(n) for n in ("spent", "area"))
    assert min(map(np.count_nonzero, (spent > 0.99, spent < 0.99, spent == 0.0))) > 2
    if law is not MODES:
        energy = law.fracture_energy * (spent @ area)
        assert e.dissipated_cohesion == pytest.approx(energy, rel=1e-12)
    else:  # each bond has spent what is between both
        least, most = (w * area[spent == 1.0].sum() for w in law.fracture_energies)
        assert least < e.dissipated_cohesion < most
    assert abs(e.dissipated_numerical) < 1e-3 * e.dissipated_cohesion
    viscous = e.dissipated_viscous_bonds / e.dissipated_cohesion
    assert (0.05 < viscous < 0.5) if law.viscosity else viscous == 0.0


@in_both
def test_quadratic_cells_break_as_linear_ones_do(dim):
    """Nodes on edges split as well: w exact, the ledger closed."""
    start = {"initial_velocity": lambda x: flying_apart(x)[:dim]}
    simulation = xf.Simulation(box(dim, BRITTLE, order=2, **start), **ONE)
    kinetic = simulation.ledger.energies.kinetic
    for _ in simulation.steps(2.0):
        assert abs(simulation.ledger.closure) < 1e-13 * kinetic
    spent, area = (simulation.interactions.gather(n) for n in ("spent", "area"))
    assert min(map(np.count_nonzero, (spent > 0.99, spent == 0.0))) > 2
    cracked = simulation.ledger.energies.dissipated_cohesion
    assert cracked == pytest.approx(BRITTLE.fracture_energy * (spent @ area), rel=1e-12)


def test_a_bar_breaks_at_its_strength():
    """Uniform stretching: no stress above s, and the first crack within a step of it."""
    rate, modulus = 0.02, 1.0 / (1.0 - 0.3**2)
    loads = [xf.PrescribedVelocity(LEFT, 0, -rate), xf.PrescribedVelocity(RIGHT, 0, rate)]
    scene = box(2, loads=loads, initial_velocity=lambda x: rate * np.array([x[0] - 1.0, 0 * x[0]]))
    simulation = xf.Simulation(scene, **ONE)
    for _ in simulation.steps(2.0):
        if len(simulation.interactions.fused.split):
            break
    confined = (1.0 - 0.3) / ((1.0 + 0.3) * (1.0 - 0.6))  # before waves of the sides arrive
    stress = rate * simulation.time * modulus, rate * simulation.time * confined
    assert stress[0] < 1.3 * S
    assert stress[1] > S - 2.0 * rate * simulation.step_size * confined


def test_bonds_at_a_driven_face_break_too():
    """The cells of the last column alone are weak: vertices whose corners are partly driven."""
    weak = lambda x: np.where(x[0] > 1.6, 1.0, 100.0) * S  # noqa: E731
    law = xf.laws.RigidCohesiveZone(weak, W)
    simulation = xf.Simulation(pulled(2, speed=0.2, law=law), **ONE)
    for _ in simulation.steps(3.0):
        pass
    spent, graphs = simulation.interactions.gather("spent"), simulation.interactions.fused.graphs
    prescribed = simulation.bulk.layout.prescribed
    assert set(simulation.state.velocity[prescribed]) == {0.0, 0.2}
    held = np.repeat(graphs.compliance_of_vertex == 0.0, np.diff(graphs.bond_offsets))
    driven = graphs.point[held]
    assert np.count_nonzero(spent[driven] > 0.99) > 1
    work = simulation.ledger.energies.external_work
    assert abs(simulation.ledger.closure) < 1e-12 * work


def test_cells_bonded_to_a_driven_one_are_driven():
    """Only the upper half of a side is pulled, along a weak line: its cluster does not give way."""
    weak = xf.laws.RigidCohesiveZone(lambda x: np.where(abs(x[1] - 0.5) < 1e-9, S, 1e3 * S), W)
    mesh = xf.crossed_rectangle((0.0, 0.0), (2.0, 1.0), (4, 2))
    sides = {1: lambda x: x[0] < 1e-9, 2: lambda x: (x[0] > 1.999) & (x[1] > 0.499)}
    bodies = xf.explode(mesh, facet_tags=xf.tag_facets(mesh, sides))
    loads = [xf.PrescribedVelocity(1, 0, 0.0), xf.PrescribedVelocity(2, 0, 0.1)]
    scene = xf.Scene(bodies, {1: ELASTIC}, default_interaction=weak, loads=loads)
    simulation = xf.Simulation(scene, **ONE)
    prescribed = simulation.bulk.layout.prescribed
    for _ in simulation.steps(3.0):
        assert set(simulation.state.velocity[prescribed]) == {0.0, 0.1}
    assert np.count_nonzero(simulation.interactions.gather("spent")) > 2
    assert abs(simulation.ledger.closure) < 1e-12 * simulation.ledger.energies.external_work


def test_facets_that_may_crack_are_those_between_bodies_tagged_or_weak():
    """Halves as bodies, a tag beside strong bonds, strengths facet by facet: one crack, one motion.

    With a function of positions ends of slanting facets at the middle are weak as well.
    """
    start = {"initial_velocity": lambda x: np.array([0.05 * (x[0] - 1.0), 0.0 * x[0]])}
    halves = box_bodies((2.0, 1.0), (4, 2), label=lambda x: x[0] > 1.0)
    middle = {7: lambda x: np.abs(x[0] - 1.0) < 1e-9}
    tagged = box_bodies((2.0, 1.0), (4, 2), interior=middle)
    strong = np.where(tagged.facets.tag == 7, S, 1e6 * S)
    near = lambda x: np.where(np.abs(x[0] - 1.0) < 0.01, S, 1e6 * S)  # noqa: E731
    plain = {"default_interaction": BRITTLE}
    scenes = [
        xf.Scene(halves, {1: ELASTIC}, **plain, **start),
        xf.Scene(tagged, {1: ELASTIC}, default_interaction=UNBREAKABLE,
                 facet_interactions={7: BRITTLE}, **start),
        *(xf.Scene(tagged, {1: ELASTIC}, **start,
                   default_interaction=dataclasses.replace(BRITTLE, strength=strength))
          for strength in (strong, near)),
    ]  # fmt: skip
    step, found = 0.1, []
    for scene in scenes:
        simulation = xf.Simulation(scene, step, **ONE)
        list(simulation.steps(30 * step))
        x, u = at_nodes(simulation)
        sides = [u[np.abs(x - [end, 0.5]).max(axis=1) < 1e-9][0] for end in (0.0, 2.0)]
        spent = np.count_nonzero(simulation.interactions.gather("spent"))
        cracked = simulation.ledger.energies.dissipated_cohesion
        found.append([*np.ravel(sides), spent, cracked])
    assert found[0][-2:] == [4, pytest.approx(0.1 * W, rel=1e-12)]
    np.testing.assert_allclose(found[1:3], [found[0]] * 2, rtol=1e-9, atol=1e-13)
    assert found[3][-2] > 4


def test_rigid_bonds_beside_other_laws():
    """A vertex where contact, springs and rigid bonds meet is solved as one."""
    other = xf.laws.CohesiveZone(50.0, W, S, friction=0.3)
    bodies = box_bodies((2.0, 1.0), (4, 2), "crossed", material={2: lambda x: x[0] < 1.0})
    loads = [xf.PrescribedVelocity(LEFT, 0, -0.05), xf.PrescribedVelocity(RIGHT, 0, 0.05)]
    scene = xf.Scene(
        bodies, {1: ELASTIC, 2: ELASTIC}, loads=loads,
        interactions={(1, 1): BOND, (1, 2): xf.laws.SignoriniCoulomb(0.3), (2, 2): other},
    )  # fmt: skip
    simulation = xf.Simulation(scene, **ONE)
    for _ in simulation.steps(6.0):  # damage follows within the step: it leaves nothing to book
        energy = simulation.interactions.gather("energy")
        numerical = energy[:, ALL_ENERGIES.index("numerical")]
        assert np.abs(numerical).max() < 1e-9 * W
    e = simulation.ledger.energies
    assert abs(simulation.ledger.closure) < 1e-12 * e.external_work
    assert e.dissipated_cohesion > 0.1 * W


def test_the_scheme_that_is_picked():
    """Explicit where no step says that it should be longer, and each cell is a body."""
    elastic = xf.laws.CohesiveZone(10.0, W, S)
    for scene, step, scheme in (
        (pulled(2), None, "explicit"),
        (pulled(2), 1e-2, "implicit"),
        (pulled(2, law=elastic), None, "implicit"),
        (pulled(2, label=lambda x: x[0] > 1.0), None, "implicit"),
    ):
        assert xf.Simulation(scene, step, num_threads=1).options.scheme == scheme


@pytest.mark.parametrize("solver", ["nlgs", "newton", "monolithic"])
def test_other_schemes_take_the_law(solver):
    """One bond between two bodies, implicit: it spends w, and the ledger closes."""
    scene = pulled(2, speed=0.05, label=lambda x: x[0] > 1.0)
    simulation = xf.Simulation(scene, 0.05, scheme="implicit", solver=solver, num_threads=1)
    list(simulation.steps(10.0))
    e = simulation.ledger.energies
    assert e.dissipated_cohesion == pytest.approx(W, rel=1e-6)
    assert abs(simulation.ledger.closure) < 1e-10 * e.external_work


def test_a_block_converges_whose_bonds_all_soften_at_once():
    """Closed rings of bonds are redundant: steps along what moves no cell are of no account."""
    tough = xf.laws.RigidCohesiveZone(S, 10.0 * W, friction=0.3)
    scene = xf.Scene(
        box_bodies((1.0, 1.0, 1.0), (3, 3, 3), "tetrahedron"), {1: ELASTIC},
        default_interaction=tough, initial_velocity=lambda x: 0.05 * (x - 0.5),
    )  # fmt: skip
    simulation = xf.Simulation(scene, max_halvings=0, **ONE)
    list(simulation.steps(2.0))
    e, fused = simulation.ledger.energies, simulation.interactions.fused
    assert len(fused.split) > 0.9 * fused.graphs.num_vertices
    assert abs(e.dissipated_numerical) < 1e-4 * e.dissipated_cohesion


def test_scales_are_told_before_anything_has_cracked():
    """The softening number is that of cells for themselves, h^2/4 A W s/dc, as of elastic bonds."""
    elastic = xf.laws.CohesiveZone(1e9, W, S, curve=xf.laws.curves.Linear())
    found = []
    for law in (BOND, elastic):
        simulation = xf.Simulation(pulled(2, law=law), 0.1, **ONE)
        found.append(xf.cohesive_table(simulation))
    assert found[0] == found[1]
    assert "cohesive length 1.1 m" in found[0]
    assert "softening number 0.0" in found[0] and not found[0].endswith("number 0")


def test_bonds_across_a_gap_are_refused():
    walls = [xf.Wall(BOTTOM, (0.0, -0.1), (0.0, 1.0), BOND)]
    with pytest.raises(ValueError, match="span gaps of up to 0.1 m: move the wall"):
        xf.Simulation(box(2, walls=walls), **ONE)


def test_cells_that_move_apart_at_the_start_are_refused():
    bodies = box_bodies((2.0, 1.0), (4, 2), "crossed", material={2: lambda x: x[0] < 1.0})
    scene = xf.Scene(
        bodies, {1: ELASTIC, 2: ELASTIC}, default_interaction=BOND,
        initial_velocity={1: lambda x: np.array([1.0 + 0 * x[0], 0 * x[0]])},
    )  # fmt: skip
    with pytest.raises(ValueError, match="move apart at the start, by 1 m/s.*continuous"):
        xf.Simulation(scene, **ONE)


def test_bonds_that_a_step_spends_whole_are_told(caplog):
    """With the place, where the strength is high, and the step that would do."""
    strength = lambda x: np.where(x[0] > 1.9, 1e3, 1.0) * S  # noqa: E731
    for energy, told in ((W, False), (1e-10, True)):
        caplog.clear()
        simulation = xf.Simulation(box(2, xf.laws.RigidCohesiveZone(strength, 1e4 * energy)), **ONE)
        found = [r.getMessage() for r in caplog.records if "snap number" in r.getMessage()]
        assert len(found) == told
    place, number, step = re.search(
        r"at \((.*?), .*number may be (.*?); a step of (.*?) s", found[0]
    ).groups()
    assert float(place) > 1.7
    assert float(step) == pytest.approx(simulation.step_size / float(number) ** 0.5, rel=0.1)
    shorter = xf.Simulation(simulation.scene, float(step), **ONE)
    scale = cohesive_scales(shorter)[0]["softening_number"]
    assert scale == pytest.approx(1.0, rel=0.1)
