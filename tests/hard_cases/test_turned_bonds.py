# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds that turn with their bodies keep momenta, and do not know in which axes they are seen.

That they are as strong, as tough and as closed as before is in `test_spinning_plates.py`.
"""

from __future__ import annotations

import logging

import numpy as np
import pytest
from scenes import (
    LEFT,
    RIGHT,
    box_bodies,
    field,
    mesh_of,
    nodes,
    run,
    side_tags,
    unmatched_plates,
)

from xper_fx.bodies.explode import EACH_CELL, explode
from xper_fx.bodies.meshes import tag_facets
from xper_fx.forms.loads import Gravity, SurfaceTraction
from xper_fx.materials import LinearElastic, NeoHookean, SaintVenantKirchhoff
from xper_fx.nscd.laws import Adhesion, CohesiveZone, MixedMode, PerfectBond, SignoriniCoulomb
from xper_fx.scene.scene import Scene
from xper_fx.scene.tie import Tie
from xper_fx.scene.wall import Wall
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.errors import ConvergenceError, SmallStrainError

YOUNG = 100.0

SPUN = {
    "2D nodal": ((1, 1), (1, 1), "crossed", 1, "nodal"),
    "2D Gauss": ((1, 1), (1, 1), "crossed", 1, "gauss"),
    "2D quadratic": ((1, 1), (1, 1), "crossed", 2, "nodal"),
    "2D quadrilaterals": ((1, 1), (2, 2), "quadrilateral", 1, "nodal"),
    "3D tetrahedra": ((1, 1, 1), (1, 1, 1), "tetrahedron", 1, "nodal"),
    "3D Gauss": ((1, 1, 1), (1, 1, 1), "tetrahedron", 1, "gauss"),
    "3D quadratic": ((1, 1, 1), (1, 1, 1), "tetrahedron", 2, "gauss"),
    "3D hexahedra": ((1, 1, 1), (2, 1, 1), "hexahedron", 1, "nodal"),
}


def momenta(simulation):
    """Linear momentum, and the angular one about the origin."""
    x, v = nodes(simulation) + field(simulation), field(simulation, "velocity")
    p = simulation.bulk.mass.reshape(v.shape) * v
    turning = np.cross(x, p) if x.shape[1] == 3 else x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0]
    return p.sum(axis=0), turning.sum(axis=0)


@pytest.mark.parametrize("kind", SPUN)
@pytest.mark.parametrize("tangential", [None, 300.0])
def test_momenta_are_kept_to_rounding(kind, tangential, figure):
    """Bonded cells that spin fast, an explicit bulk: a quarter turn, bonds that open and close."""
    lengths, cells, shape, order, points = SPUN[kind]
    dim = len(lengths)
    omega = np.sqrt(YOUNG) / 10.0 * np.array([0.3, -0.2, 1.0])
    centre = 0.5 * np.ones((dim, 1))

    def velocity(x):
        if dim == 2:
            return omega[2] * np.stack([-(x[1] - 0.5), x[0] - 0.5])
        return np.cross(omega, (x - centre).T).T

    scene = Scene(
        box_bodies(lengths, cells, shape),
        {1: SaintVenantKirchhoff(YOUNG, 0.3, 1.0)},
        default_interaction=CohesiveZone(1000.0, 0.5, 8.0, tangential, friction=0.3),
        initial_velocity=velocity,
        order=order,
        points=points,
    )
    simulation = Simulation(scene, scheme="explicit", tolerance=1e-7, num_threads=1)
    linear, angular = momenta(simulation)
    size = np.linalg.norm(angular)
    opened = 0.0
    for record in simulation.steps(0.5 * np.pi / np.linalg.norm(omega)):  # noqa: B007 - the last
        now, turned = momenta(simulation)
        assert np.abs(now - linear).max() < 1e-13 * size
        error = np.abs(turned - angular).max() / size
        assert error < 1e-13
        opened = max(opened, np.abs(simulation.interactions.gather("jump")).max())
    assert opened > 1e-5
    figure(f"momenta, {kind}, C_T = {tangential}", "angular momentum error < 1e-13", error)
    assert abs(record.energies["dissipated_numerical"]) < 1e-4 * size


@pytest.mark.slow
def test_what_is_booked_as_numerical_falls_with_the_step(figure):
    """C_N unlike C_T: half a turn; the energy of jumps read anew is of higher order than two."""
    booked = []
    for share in (1.0, 0.5):
        scene = Scene(
            box_bodies((1, 1), (2, 2)),
            {1: NeoHookean(YOUNG, 0.3, 1.0)},
            default_interaction=CohesiveZone(1000.0, 0.5, 8.0, 300.0),
            initial_velocity=lambda x: np.stack([0.5 - x[1], x[0] - 0.5]),
        )
        critical = Simulation(scene, scheme="explicit").step_size
        simulation = Simulation(scene, share * critical, tolerance=1e-10, num_threads=1)
        *_, record = simulation.steps(np.pi)
        kinetic = simulation.ledger.energies.kinetic
        booked.append(abs(record.energies["dissipated_numerical"]) / kinetic)
        assert np.all(simulation.interactions.gather("damage") == 1.0)
    figure("half a turn, C_N unlike C_T", "booked as numerical < 5e-6 of the energy", booked[0])
    assert booked[0] < 5e-6
    assert booked[1] < 0.25 * booked[0]


def test_cells_of_unlike_masses_spend_their_energy_as_they_spin(figure):
    """Torn apart along all bonds: what is spent is w times the area, to the third order at least.

    Couples of a bond leave its own jump alone, but not those of the other cells at its nodes.
    """
    mesh = mesh_of((2.0, 1.0), (2, 1))
    x = mesh.geometry.x
    x[:, 0] += 0.2 * x[:, 0] ** 2 * (1.0 + x[:, 1])
    energy = 0.05
    scene = Scene(
        explode(mesh, EACH_CELL),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=CohesiveZone(1000.0, energy, 4.0),
        initial_velocity=lambda x: np.stack(
            [6.0 * (x[0] - 1.0) - 4.0 * (x[1] - 0.5), 4.0 * (x[0] - 1.0) + 5.0 * (x[1] - 0.5)]
        ),
    )
    critical, errors = Simulation(scene, scheme="explicit").step_size, []
    for share in (0.4, 0.2):
        simulation = Simulation(
            scene, share * critical, scheme="explicit", tolerance=1e-12, num_threads=1
        )
        for record in simulation.steps(1.2):  # noqa: B007 - the last is looked at
            if simulation.interactions.gather("damage").max() == 0.0:
                break
        assert simulation.interactions.gather("damage").max() == 0.0
        whole = energy * simulation.interactions.points.area.sum()
        errors.append(abs(record.energies["dissipated_cohesion"] / whole - 1.0))
    figure("cells torn as they spin", "energy spent beside w < 1e-4", errors[1])
    assert errors[1] < 1e-4
    assert errors[1] < errors[0] / 8.0


ANGLE = np.radians(37.0)
TURN = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
TURN_IN_SPACE = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0


def breaking_box(dim, R, wind, scheme, bond):
    """A box of cells that is torn and sheared by tractions and gravity, seen in turned axes.

    Args:
        dim: 2 or 3.
        R: the whole scene is turned by it.
        wind: velocity of all at the start, in the turned axes (m/s).
        scheme: of the bulk.
        bond: law between cells.
    """
    lengths, cells = (2.0, 1.0, 1.0)[:dim], (2, 1, 1)[:dim]
    mesh = mesh_of(lengths, cells, "crossed" if dim == 2 else "tetrahedron")
    tags = side_tags(mesh, lengths)
    mesh.geometry.x[:, :dim] = mesh.geometry.x[:, :dim] @ R.T
    pulls = (np.array([7.0, 3.0, 2.0]), np.array([-7.0, 1.0, 0.5]))
    loads = [
        SurfaceTraction(side, tuple(R @ pull[:dim]))
        for side, pull in zip((RIGHT, LEFT), pulls, strict=True)
    ]
    weight = R @ np.array([0.3, -1.0, 0.7])[:dim]
    fast = R @ np.array([0.5, -0.2, 0.3])[:dim]

    def velocity(x):
        inside = R.T @ x[:dim]
        return np.outer(fast, inside[0] * inside[1]) + np.asarray(wind)[:, None]

    scene = Scene(
        explode(mesh, EACH_CELL, None, tags),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=bond,
        loads=[*loads, Gravity(tuple(weight))],
        initial_velocity=velocity,
    )
    step = None if scheme == "explicit" else 0.01
    tight = {"tolerance": 1e-12, "newton_tolerance": 1e-13}
    return Simulation(scene, step, scheme=scheme, **tight, num_threads=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "dim, scheme, tangential",
    [(2, "explicit", None), (2, "implicit", 300.0), (3, "explicit", 300.0), (3, "implicit", None)],
)
def test_turned_or_moving_scenes_have_the_same_history(dim, scheme, tangential, figure):
    """The whole scene turned by 37 degrees (3D: 60 about a diagonal), or in steady motion."""
    bond = CohesiveZone(1000.0, 0.3, 5.0, tangential)
    still, R = np.zeros(dim), TURN if dim == 2 else TURN_IN_SPACE
    wind = np.array([0.7, -0.4, 0.5])[:dim]
    plain = breaking_box(dim, np.eye(dim), still, scheme, bond)
    turned = breaking_box(dim, R, still, scheme, bond)
    moving = breaking_box(dim, np.eye(dim), wind, scheme, bond)
    steps = 60
    records = [run(simulation, steps)[-1] for simulation in (plain, turned, moving)]
    damage = plain.interactions.gather("damage")
    assert damage.min() < 0.5
    size = np.abs(field(plain)).max()
    apart = np.abs(field(turned) - field(plain) @ R.T).max() / size
    carried = field(moving) - wind * records[2].time
    steady = np.abs(carried - field(plain)).max() / size
    what = f"frame indifference, {dim}D, {scheme}, C_T = {tangential}"
    figure(what, "turned, displacement < 1e-9", apart)
    figure(what, "moving, displacement < 1e-9", steady)
    assert apart < 1e-9
    assert steady < 1e-9
    for name in ("elastic", "cohesive", "dissipated_cohesion"):
        energies = [record.energies[name] for record in records]
        assert energies == pytest.approx([energies[0]] * 3, rel=1e-7, abs=1e-12)


OTHERS = {
    "viscous adhesion": Adhesion(1000.0, 0.05, viscosity=0.02),
    "modes apart": MixedMode(1000.0, (5.0, 7.0), (0.3, 0.5), 2.0, tangential_stiffness=600.0),
    "half broken": CohesiveZone(1000.0, 0.3, 5.0, 300.0, friction=0.2, initial_damage=0.5),
    "contact": SignoriniCoulomb(0.4, contact="position"),
}


@pytest.mark.parametrize("law", OTHERS)
def test_other_laws_have_the_same_history(law, figure):
    """As above, in 2D with an explicit bulk; bonds turn by 10 degrees and more within it."""
    still, wind = np.zeros(2), np.array([0.7, -0.4])
    plain, turned, moving = runs = [
        breaking_box(2, R, v, "explicit", OTHERS[law])
        for R, v in ((np.eye(2), still), (TURN, still), (np.eye(2), wind))
    ]
    *_, record = [run(simulation, 60)[-1] for simulation in runs]
    size = np.abs(field(plain)).max()
    apart = np.abs(field(turned) - field(plain) @ TURN.T).max() / size
    steady = np.abs(field(moving) - wind * record.time - field(plain)).max() / size
    figure(f"frame indifference, {law}", "turned, displacement < 1e-9", apart)
    figure(f"frame indifference, {law}", "moving, displacement < 1e-9", steady)
    assert apart < 1e-9
    assert steady < 1e-9
    normals = plain.interactions.points.frame[:, 0]
    start = np.repeat(plain.scene.bodies.facets.normal, 2, axis=0)
    assert np.einsum("pd,pd->p", normals, start).min() < np.cos(np.radians(10.0))


def test_a_facet_that_flips_ends_the_run_and_is_named():
    """A block that collapses through its centre within any step: no normal is left."""
    scene = Scene(
        box_bodies((1, 1), (1, 1)),
        {1: SaintVenantKirchhoff(YOUNG, 0.3, 1.0)},
        default_interaction=PerfectBond(),
        initial_velocity=lambda x: 1e5 * np.stack([0.5 - x[0], 0.5 - x[1]]),
    )
    simulation = Simulation(scene, scheme="explicit", num_threads=1)
    with pytest.raises(ConvergenceError, match=r"facet at \(0\.\d+, 0\.\d+\) flips"):
        run(simulation, 1)


def test_a_step_in_which_a_facet_flips_is_cut(caplog):
    """A plate whose sides would be through its centre after half a step springs back."""
    scene = Scene(
        box_bodies((1, 1), (1, 1)),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=CohesiveZone(1000.0, 0.5, 8.0),
        initial_velocity=lambda x: 2.5 * np.stack([0.5 - x[0], 0.5 - x[1]]),
    )
    simulation = Simulation(scene, 1.0, scheme="implicit", num_threads=1)
    with caplog.at_level(logging.INFO, logger="xper_fx"):
        first, *_ = run(simulation, 1)
    told = [r.getMessage() for r in caplog.records if "flips or degenerates" in r.getMessage()]
    assert told and first.size < 1.0
    assert simulation.interactions.gather("damage").min() == 1.0


def small_strain(forgiving=False, scheme="implicit"):
    scene = Scene(
        box_bodies((1, 1), (1, 1)),
        {1: LinearElastic(YOUNG, 0.3, 1.0)},
        default_interaction=CohesiveZone(1000.0, 0.5, 8.0),
        initial_velocity=lambda x: np.stack([0.5 - x[1], x[0] - 0.5]),
    )
    step = None if scheme == "explicit" else 0.02
    return Simulation(scene, step, scheme=scheme, forgiving=forgiving, num_threads=1)


@pytest.mark.parametrize("scheme", ["explicit", "implicit"])
def test_small_strain_stops_where_bonds_turn(scheme):
    """A free block that spins: after some 10 degrees an error with angle, bond and cure."""
    simulation = small_strain(scheme=scheme)
    with pytest.raises(SmallStrainError, match=r"degrees.*NeoHookean") as caught:
        list(simulation.steps(3.0))
    most = np.radians(10.0) + (40 if scheme == "explicit" else 1) * simulation.step_size
    assert np.radians(10.0) < caught.value.angle < most
    assert "(0." in str(caught.value)
    if scheme == "implicit":  # the explicit block has stretched by then
        assert simulation.time == pytest.approx(caught.value.angle, abs=0.05)


def test_small_strain_may_go_on(caplog):
    """With forgiving=True it is told once and counted."""
    simulation = small_strain(forgiving=True)
    run(simulation, 15)
    told = [r.getMessage() for r in caplog.records if "bonds turn beyond" in r.getMessage()]
    assert len(told) == 2
    assert int(told[1].split()[0]) == 7  # from 0.16 to 0.3 rad


def grain_on_a_slope():
    """A disc of cells that rolls down a slope on a wall that stands across it."""
    radius, slope, speed = 0.05, np.radians(20.0), 1.5
    mesh = mesh_of((2, 2), (6, 6))
    x = mesh.geometry.x
    u, v = x[:, 0] - 1.0, x[:, 1] - 1.0
    x[:, 0] = radius * u * np.sqrt(1.0 - 0.5 * v * v)
    x[:, 1] = radius * v * np.sqrt(1.0 - 0.5 * u * u)
    outside = {1: lambda x: np.abs(np.hypot(x[0], x[1]) - radius) < 0.02 * radius}
    up = np.array([np.sin(slope), np.cos(slope)])
    down = np.array([np.cos(slope), -np.sin(slope)])
    walls = [
        Wall(1, tuple(-radius * up), tuple(up), SignoriniCoulomb(0.6)),
        Wall(1, tuple((1.0 + 0.1 * np.pi) * radius * down), tuple(-down), SignoriniCoulomb(0.3)),
    ]
    scene = Scene(
        explode(mesh, EACH_CELL, facet_tags=tag_facets(mesh, outside)),
        {1: NeoHookean(1e8, 0.2, 2000.0)},
        default_interaction=CohesiveZone(1e12, 2.0, 2e5, friction=0.4),
        walls=walls,
        loads=[Gravity((0.0, -9.81))],
        initial_velocity=lambda x: speed * down[:, None] + speed / radius * np.stack([x[1], -x[0]]),
    )
    return Simulation(scene, scheme="explicit", num_threads=1), speed / radius


@pytest.mark.slow
def test_a_grain_rolls_and_breaks(figure):
    """Its bonds turn with it; it breaks when it hits the wall; the energies are closed."""
    simulation, spin = grain_on_a_slope()
    kinetic = simulation.ledger.energies.kinetic
    bonds = slice(0, 408)
    *_, record = simulation.steps(9e-3)
    assert simulation.interactions.gather("damage")[bonds].min() == 1.0
    frame = simulation.interactions.points.frame[0]
    start = simulation.scene.bodies.facets.normal[0]
    turned = np.arccos(np.clip(frame[0] @ start, -1.0, 1.0))
    assert turned == pytest.approx(spin * 9e-3, abs=0.02)
    assert abs(record.energies["closure"]) < 1e-6 * kinetic
    *_, record = simulation.steps(12.5e-3)
    energies = record.energies
    broken = np.mean(simulation.interactions.gather("damage")[bonds] == 0.0)
    figure("rolling grain that breaks", "energy error < 1e-3", abs(energies["closure"]) / kinetic)
    assert broken > 0.1
    assert energies["dissipated_cohesion"] > 0.02 * kinetic
    assert abs(energies["closure"]) < 1e-3 * kinetic
    assert abs(energies["dissipated_numerical"]) < 1e-2 * kinetic


def test_tied_meshes_turn_with_their_surfaces():
    """Two meshes that do not match, bonded with C_N unlike C_T, spin: momenta, no damage."""
    joined = unmatched_plates()
    scene = Scene(
        explode(joined.mesh, joined.part, facet_tags=joined.facet_tags),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        ties=[Tie(8, 7, CohesiveZone(1000.0, 0.5, 8.0, 300.0))],
        initial_velocity=lambda x: np.stack([0.5 - x[1], x[0] - 1.0]),
        points="gauss",
    )
    simulation = Simulation(scene, scheme="explicit", tolerance=1e-10, num_threads=1)
    linear, angular = momenta(simulation)
    for record in simulation.steps(0.5 * np.pi):  # noqa: B007 - the last is looked at
        now, turned = momenta(simulation)
        assert np.abs(now - linear).max() < 1e-13 * angular
        assert abs(turned - angular) < 1e-12 * angular
    normals = simulation.interactions.points.frame[:, 0]
    angles = np.arctan2(normals[:, 1], normals[:, 0])
    assert angles == pytest.approx(0.5 * np.pi, abs=0.05)
    assert simulation.interactions.gather("damage").min() == 1.0
    kinetic = simulation.ledger.energies.kinetic
    assert abs(record.energies["dissipated_numerical"]) < 1e-5 * kinetic


def test_walls_have_the_ground_beside_bonds_that_turn():
    """Points of walls and of facets of one law are one group, and the ground is at rest in it."""
    law = SignoriniCoulomb(0.0)
    mesh = mesh_of((1.0, 1.0), (2, 2))
    tags = tag_facets(mesh, {7: lambda x: x[1] < 1e-9})
    scene = Scene(
        explode(mesh, EACH_CELL, facet_tags=tags),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=law,
        walls=[Wall(7, (0.0, -0.3), (0.0, 1.0), law)],
        initial_velocity=lambda x: np.stack([0.0 * x[0], 0.0 * x[0] - 0.5]),
    )
    simulation = Simulation(scene, scheme="explicit", num_threads=1)
    assert len(simulation.interactions.groups) == 1
    # the slot of the ground is the last one, after those of all nodes
    assert not simulation.interactions.turn_on_nodes(len(nodes(simulation)))
    bonds = 2 * len(scene.bodies.facets.normal)
    for _ in range(2):
        list(simulation.steps(simulation.time + 0.5))
        at = simulation.interactions.points.nodes[bonds:, 0, 0]
        y = simulation.forms.V.tabulate_dof_coordinates()[:, 1] + field(simulation)[:, 1]
        jump = simulation.interactions.gather("jump")[bonds:, 0]
        assert jump == pytest.approx(y[at] + 0.3, abs=1e-12)
    assert momenta(simulation)[0][1] > -0.45  # it has hit the wall
    assert simulation.ledger.closure == pytest.approx(0.0, abs=1e-3)


def test_slid_lips_that_their_bodies_have_left_are_told(caplog):
    """Two loose blocks, pressed and slid, that turn on without a search: a warning, once."""

    def pressing(t, component, sign):
        along, across = (np.cos(0.5 * t), np.sin(0.5 * t)), (-np.sin(0.5 * t), np.cos(0.5 * t))
        return sign * (-along[component] + (0.6 if t < 0.5 else 0.0) * across[component])

    loads = [
        SurfaceTraction(side, tuple(lambda t, c=c, s=s: pressing(t, c, s) for c in range(2)))
        for side, s in ((RIGHT, 1.0), (LEFT, -1.0))
    ]
    scene = Scene(
        box_bodies((2, 1), (4, 2), label=lambda x: x[0] > 1),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=SignoriniCoulomb(0.1, contact="position"),
        loads=loads,
        initial_velocity=lambda x: 0.5 * np.stack([0.5 - x[1], x[0] - 1.0]),
    )
    simulation = Simulation(scene, scheme="explicit", num_threads=1)
    list(simulation.steps(1.6))
    told = [r.getMessage() for r in caplog.records if "name a contact" in r.getMessage()]
    assert len(told) == 1


def slid_blocks(step):
    """Two loose blocks that spin, pressed by tractions that go with them, and slide at first.

    Args:
        step: h (s).

    Returns:
        Simulation, loads at the nodes (N/m) in axes that turn with the blocks, and the list of the
        angle of these axes (rad), which has to follow.
    """
    angle, speed, spin = [0.0], 0.25, 0.5
    loads = [
        SurfaceTraction(
            side,
            tuple(lambda t, f=f, s=sign: s * f(angle[0]) for f in (np.cos, np.sin)),
        )
        for side, sign in ((RIGHT, -1.0), (LEFT, 1.0))
    ]

    def velocity(x):
        upwards = speed * np.where(x[0] > 1.0, 1.0, -1.0) * (np.abs(x[0] - 1.0) > 1e-9)
        return spin * np.stack([0.5 - x[1], x[0] - 1.0]) + np.stack([0.0 * x[0], upwards])

    scene = Scene(
        box_bodies((2, 1), (4, 2), label=lambda x: x[0] > 1),
        {1: NeoHookean(YOUNG, 0.3, 1.0)},
        default_interaction=SignoriniCoulomb(0.3, contact="position"),
        loads=loads,
        initial_velocity=velocity,
    )
    simulation = Simulation(scene, step, scheme="explicit", num_threads=1)
    x = nodes(simulation)
    along = np.where(x[:, 0] < 1e-9, 1.0, np.where(x[:, 0] > 2.0 - 1e-9, -1.0, 0.0))
    pushes = along * np.where(np.abs(x[:, 1] - 0.5) < 0.1, 0.5, 0.25)
    return simulation, pushes, angle


@pytest.mark.slow
def test_slid_lips_turn_with_their_bodies(figure):
    """Slid by an eighth of a facet, pressed, turned by 150 degrees: contact, slip, momentum.

    What the couples add to the contact's energy is booked and falls with the step. At the coarse
    one it hangs on when lips let go: last digits move it from 0.035 to 0.073.
    """
    for step, bound in ((8e-3, 0.12), (2e-3, 0.015)):
        simulation, pushes, angle = slid_blocks(step)
        x, points = nodes(simulation), simulation.interactions.groups[0]
        left = np.flatnonzero(x[:, 0] < 1e-9)
        bottom, top = left[np.argsort(x[left, 1])][[0, -1]]
        _, angular = momenta(simulation)
        given, size, closed = 0.0, abs(angular), []
        kinetic, old = simulation.ledger.energies.kinetic, simulation.state
        for record in simulation.steps(3.0):
            middle = x + (old.displacement + 0.5 * record.size * old.velocity).reshape(-1, 2)
            across = middle[:, 0] * np.sin(angle[0]) - middle[:, 1] * np.cos(angle[0])
            given += record.size * float(pushes @ across)
            old, at = simulation.state, x + field(simulation)
            edge = at[top] - at[bottom]
            angle[0] = np.unwrap([angle[0], np.arctan2(-edge[0], edge[1])])[1]
            closed.append(points.jump[:, 0].max() < 2e-3)
        _, turned = momenta(simulation)
        error = abs(turned - angular - given) / size
        slip = np.abs(points.jump[:, 1])
        figure(f"slid lips that turn, h = {step}", "angular momentum error < 1e-12", error)
        figure(f"slid lips that turn, h = {step}", "slip of 0.04 to 0.07", slip.max())
        assert error < 1e-12
        assert angle[0] > np.radians(140.0)
        assert 0.04 < slip.min() and slip.max() < 0.07
        assert np.mean(closed[len(closed) // 3 :]) > 0.95
        assert abs(record.energies["closure"]) < 1e-3 * kinetic
        booked = abs(record.energies["dissipated_numerical"]) / kinetic
        figure(f"slid lips that turn, h = {step}", f"booked as numerical < {bound}", booked)
        assert booked < bound
