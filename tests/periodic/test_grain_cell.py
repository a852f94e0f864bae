"""Rigid bodies in a periodic cell: exact states, invariances, balances."""

from dataclasses import replace

import numpy as np
import pytest

from xper_fx.forms.loads import Gravity
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.nscd.rigid import Disc, HalfPlane, Polygon, RigidBody, Sphere
from xper_fx.output.contact_forces import find_contact_forces
from xper_fx.output.present_bodies import rigid_bodies_now
from xper_fx.periodic.drive import MacroscopicDrive
from xper_fx.scene.contact import Contact
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.saved_rows import Rows

SMOOTH = SignoriniCoulomb()
ROUGH = SignoriniCoulomb(friction=0.4, restitution=0.1)


def grains_scene(bodies, lattice, law=ROUGH, **options) -> Scene:
    return Scene(rigid=bodies, lattice=lattice, contacts=[Contact(("g", "g"), law)], **options)


def disc(x, y, **options) -> RigidBody:
    return RigidBody(Disc(0.5), (x, y), "g", density=1.0, **options)


def run(simulation, end_time):
    """The last record, and the largest error of the energy balance of all."""
    worst = 0.0
    for record in simulation.steps(end_time):  # noqa: B007
        worst = max(worst, abs(record.energies["closure"]))
    return record, worst


def packing(count=36, seed=0) -> tuple[list[RigidBody], float]:
    """Discs that do not overlap, at rest as a whole, and the period of their square."""
    rng, side = np.random.default_rng(seed), int(np.sqrt(count))
    radius = rng.uniform(0.4, 0.6, count)
    places = np.stack(np.meshgrid(range(side), range(side)), -1).reshape(-1, 2) * 1.22
    velocity = rng.normal(0.0, 0.1, (count, 2))
    velocity -= (radius**2) @ velocity / (radius @ radius)
    bodies = [
        RigidBody(Disc(r), x, "g", density=1.0, velocity=v)
        for r, x, v in zip(radius, places, velocity, strict=True)
    ]
    return bodies, 1.22 * side


MIXED = MacroscopicDrive(rate={"12": 0.2}, gradient={"21": 0.0}, stress={"11": -1.5, "22": -1.0})


@pytest.mark.fast
@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_a_compressed_lattice_of_discs_bears_what_is_asked_for(theta):
    """Four discs in a hexagonal lattice, which leaves the single forces open.

    Those of the rows along x, and of the others, have p d / sqrt 3 as their means; what else they
    have is in balance by itself.
    """
    places = np.array([(0, 0), (1, 0), (0.5, 0.75**0.5), (1.5, 0.75**0.5)]) + (0.3, 0.9)
    lattice = np.array([[2.0, 0.0], [1.0, 3.0**0.5]])
    drive = MacroscopicDrive(gradient={"21": 0.0}, stress={"11": -2.0, "22": -2.0, "12": 0.0})
    scene = grains_scene([disc(*x) for x in places], lattice, SMOOTH, macroscopic=drive)
    simulation = Simulation(scene, 1e-2, theta=theta, tolerance=1e-10)
    record, _ = run(simulation, 0.1)
    forces = find_contact_forces(simulation)
    assert len(forces.bodies) == 12
    push = (forces.force * forces.normal).sum(1)
    assert push.min() > 0.0
    for angle in (0.0, 60.0, 120.0):
        direction = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
        row = np.abs(forces.normal @ direction) > 0.9
        assert np.count_nonzero(row) == 4
        assert push[row].mean() == pytest.approx(2.0 / 3.0**0.5, rel=1e-7)
    assert np.allclose(simulation.macroscopic.cauchy, -2.0 * np.eye(2), atol=1e-9)
    assert np.allclose(simulation.rigid.state.position, places, atol=1e-9)
    assert record.energies["kinetic"] < 1e-15


@pytest.mark.fast
def test_spheres_bear_three_stresses():
    """A cubic lattice: the 4 columns along an axis bear -Pi of their face, whose area is 4."""
    places = np.stack(np.meshgrid(range(2), range(2), range(2)), -1).reshape(-1, 3)
    bodies = [RigidBody(Sphere(0.5), x, "g", density=1.0) for x in places]
    pressures = 1.0, 2.0, 3.0
    drive = MacroscopicDrive(
        gradient=dict.fromkeys(("12", "13", "21", "23", "31", "32"), 0.0),
        stress={f"{i + 1}{i + 1}": -p for i, p in enumerate(pressures)},
    )
    simulation = Simulation(
        grains_scene(bodies, (2.0, 2.0, 2.0), SMOOTH, macroscopic=drive), 1e-2, tolerance=1e-9
    )
    run(simulation, 0.05)
    forces = find_contact_forces(simulation)
    pushes, along = (forces.force * forces.normal).sum(1), np.abs(forces.normal).argmax(1)
    means = [pushes[along == axis].mean() for axis in range(3)]
    assert np.allclose(means, pressures, rtol=1e-7)
    assert np.allclose(simulation.macroscopic.stress, -np.diag(pressures), atol=1e-8)


@pytest.mark.fast
@pytest.mark.parametrize("rate", ["number", "function"])
def test_a_gas_that_nothing_meets_is_compressed_reversibly(rate):
    """Along the axis v# F11 stays what it is: v# doubles as the cell is halved.

    The kinetic stress -sum m v# v# / V does the work that the fluctuation gains.
    """
    bodies = [disc(0.0, 0.0, velocity=(0.3, 0.1)), disc(0.0, 5.0, velocity=(-0.3, -0.1))]
    given = -0.5 if rate == "number" else lambda time: -0.5
    drive = MacroscopicDrive(rate={"11": given}, gradient={"12": 0.0, "21": 0.0, "22": 1.0})
    simulation = Simulation(grains_scene(bodies, (40.0, 10.0), macroscopic=drive), 0.01)
    start = simulation.ledger.energies.kinetic
    record, worst = run(simulation, 1.0)
    cell, mass = simulation.macroscopic, np.pi / 4
    assert cell.gradient[0, 0] == pytest.approx(0.5, abs=1e-12)
    assert np.allclose(simulation.rigid.fluctuation, [[0.6, 0.1], [-0.6, -0.1]], atol=1e-12)
    gained = mass * (0.6**2 - 0.3**2)
    assert record.energies["kinetic"] - start == pytest.approx(gained, rel=1e-10)
    assert record.energies["external_work"] == pytest.approx(gained, rel=1e-10)
    assert worst < 1e-14
    # v and x are those of a body that nothing pushes
    assert np.allclose(simulation.rigid.state.position[1], [-0.3, 4.9], atol=1e-12)
    # the mean over the step, in which F11 falls by 2 %
    expected = -2.0 * mass * np.array([[0.36, 0.06], [0.06, 0.01]]) / 200.0
    assert np.allclose(cell.cauchy, expected, rtol=0.03)


@pytest.mark.fast
def test_a_contact_across_the_border_meets_the_moving_images():
    """Two discs in a cell that shrinks: U = dF b at the contact, W = 2/m + b^2/m_c.

    With restitution e and Fbar prescribed the discs leave with -e U; the cell gets the reaction.
    """
    rebound, rate = 0.5, -0.2
    law = SignoriniCoulomb(restitution=rebound)
    # disc 0 touches the image of 1 at 0.05, far from 1 itself at 3.05
    bodies = [
        RigidBody(Disc(0.5), (0.8, 0.0), "g", density=1.0),
        RigidBody(Disc(0.25), (3.05, 0.0), "g", density=4.0),
    ]
    drive = MacroscopicDrive(rate={"11": rate}, gradient={"12": 0.0, "21": 0.0, "22": 1.0})
    scene = grains_scene(bodies, (3.0, 4.0), law, macroscopic=drive)
    simulation = Simulation(scene, 1e-3, theta=1.0, tolerance=1e-12)
    run(simulation, 1e-3)
    mass, branch = np.pi / 4, 0.75  # b of the reference cell, up to the step
    push = -0.5 * mass * rate * branch * (1.0 + rebound)
    moved = push / mass
    assert np.allclose(simulation.rigid.fluctuation[:, 0], [moved, -moved], rtol=2e-3)
    forces = find_contact_forces(simulation)
    assert np.allclose(forces.force, [[push / 1e-3, 0.0]], rtol=2e-3)
    assert np.allclose(forces.position, [[0.3, 0.0]], atol=1e-3)  # left of disc 0
    # sigma_11 V = -f l in the mean over the step
    stress = -push * branch / 1e-3 / 12.0
    assert simulation.macroscopic.stress[0, 0] == pytest.approx(stress, rel=2e-3)

    free = MacroscopicDrive(gradient={"12": 0.0, "21": 0.0, "22": 1.0}, stress={"11": -1.0})
    simulation = Simulation(grains_scene(bodies, (3.0, 4.0), law, macroscopic=free), 1e-3)
    run(simulation, 1e-3)
    cell_mass = 2.0 * mass * (9.0 + 16.0) / 24.0
    (group,) = simulation.interactions.contacts
    expected = 2.0 / mass + branch**2 / cell_mass
    assert group.compliance[0, 0] == pytest.approx(expected, rel=1e-12)
    # pushed from rest by h V / m_c, which the contact, at rest before, takes a part of
    given = 1e-3 * 12.0 / cell_mass
    held = given * branch**2 / expected / cell_mass
    assert simulation.macroscopic.rate[0, 0] == pytest.approx(held - given, rel=1e-9)


@pytest.mark.parametrize("theta", [0.5, 0.75])
def test_energy_and_momentum_of_a_packing_that_is_sheared_and_pressed(theta):
    bodies, period = packing()
    bodies[7] = replace(bodies[7], prescribed={2: 0.4})
    scene = grains_scene(bodies, (period, period), macroscopic=MIXED)
    simulation = Simulation(scene, 0.02, theta=theta, tolerance=1e-3)
    record, worst = run(simulation, 2.0)
    assert simulation.macroscopic.gradient[0, 1] == pytest.approx(0.4)
    assert record.energies["dissipated_friction"] > 0.1
    assert worst < 1e-12 * record.energies["external_work"]
    if theta == 0.5:
        lost = record.energies["dissipated_numerical"]
        assert abs(lost) < 1e-3 * record.energies["external_work"]
    # of masses whose first velocities have none
    assert np.abs(simulation.rigid.momentum()).max() < 1e-13 * scene.rigid_bodies.mass.sum()
    pushes = find_contact_forces(simulation)
    assert len(pushes.bodies) > 20


def test_nothing_depends_on_where_the_cell_is_cut():
    """A packing moved as a whole, images for bodies, another basis of the same lattice."""
    bodies, period = packing()
    rng, found = np.random.default_rng(2), []
    image = period * rng.integers(-3, 4, (36, 2))
    square = np.diag([period, period])
    for shift, lattice in (
        (np.zeros(2), square),
        (np.array([1.7, -3.1]), square),
        (image, square),
        (np.zeros(2), np.array([[1, 0], [3, 1]]) @ square),
    ):
        moved = [
            replace(body, position=np.asarray(body.position) + by)
            for body, by in zip(bodies, np.broadcast_to(shift, (36, 2)), strict=True)
        ]
        scene = grains_scene(moved, lattice, macroscopic=MIXED)
        simulation = Simulation(scene, 0.02, tolerance=1e-9, solver="nlgs")
        record, _ = run(simulation, 0.8)
        cell = simulation.macroscopic
        found.append([*cell.gradient.ravel(), *cell.stress.ravel(), *record.energies.values()])
        names = {tuple(sorted(pair)) for pair in find_contact_forces(simulation).bodies.tolist()}
        assert len(names) > 10
    assert np.allclose(found[1:], found[0], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("solver", ["newton", "accelerated", "friction_problem"])
def test_other_solvers_find_what_sweeps_find(solver):
    bodies, period = packing(16)
    stresses = []
    for name in ("nlgs", solver):
        scene = grains_scene(bodies, (period, period), macroscopic=MIXED)
        simulation = Simulation(scene, 0.05, tolerance=1e-9, solver=name)
        run(simulation, 1.0)
        assert len(find_contact_forces(simulation).bodies) > 5
        stresses.append(simulation.macroscopic.stress)
    assert np.allclose(*stresses, rtol=1e-5, atol=1e-7)


@pytest.mark.slow
def test_a_packing_goes_on_as_another_scene_after_five_periods_of_shear():
    """The cell that a new scene is given is the sheared one less five periods.

    Its Fbar begins as the identity, so that the rates are those of the velocity gradient. The
    contacts begin without impulses, which sweeps find again.
    """
    bodies, period = packing(16)
    drive = MacroscopicDrive(rate={"12": 2.0}, gradient={"21": 0.0, "11": 1.0}, stress={"22": -4.0})
    scene = grains_scene(bodies, (period, period), SMOOTH, macroscopic=drive)
    simulation = Simulation(scene, 5e-3, tolerance=1e-10, solver="nlgs")
    run(simulation, 2.5)
    assert np.ptp(simulation.rigid.state.position[:, 0]) > 4.0 * period
    assert np.ptp(simulation.rigid.displayed.position[:, 0]) < 1.6 * period
    cell = simulation.macroscopic
    lattice = np.diag([period, period]) @ cell.gradient.T
    lattice[1] -= 5.0 * lattice[0]
    rates = dict(zip(("12", "22"), (cell.rate @ np.linalg.inv(cell.gradient))[:, 1], strict=True))
    go_on = MacroscopicDrive(rate=rates, gradient={"21": 0.0, "11": 1.0})
    other = Simulation(
        grains_scene(rigid_bodies_now(simulation), lattice, SMOOTH, macroscopic=go_on,
                     resolve_overlaps=True), 5e-3, tolerance=1e-10, solver="nlgs",
    )  # fmt: skip
    of_grains = [
        s.rigid.kinetic - 0.5 * s.rigid.cell_mass * (s.macroscopic.rate**2).sum()
        for s in (simulation, other)
    ]
    assert of_grains[1] == pytest.approx(of_grains[0], rel=1e-9)


@pytest.mark.parametrize("driven", [True, False])
def test_a_restarted_cell_goes_on_with_the_same_bits(driven):
    bodies, period = packing(16)
    options = {"macroscopic": MIXED} if driven else {}
    whole, first, second = (
        Simulation(grains_scene(bodies, (period, period), **options), 0.05) for _ in range(3)
    )
    run(whole, 1.0)
    run(first, 0.5)
    second.restore(_in_order(first.saved()))
    run(second, 1.0)
    assert np.array_equal(second.rigid.state.position, whole.rigid.state.position)
    assert second.ledger.as_columns() == whole.ledger.as_columns()
    if driven:
        assert np.array_equal(second.macroscopic.stress, whole.macroscopic.stress)


def _in_order(saved):
    if isinstance(saved, dict):
        return {name: _in_order(part) for name, part in saved.items()}
    return saved.in_order() if isinstance(saved, Rows) else saved


@pytest.mark.fast
def test_a_chute_between_its_periods():
    """A cell that keeps its shape, free upwards, with a wall along its period.

    Discs slide down an inclined wall whose friction is smaller than its slope, through the border,
    with g (sin a - mu cos a), and polygons as well.
    """
    slope, friction = 0.5, 0.2
    law = SignoriniCoulomb(friction=friction)
    box = Polygon([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    wall = RigidBody(HalfPlane(), (0.0, 0.0), "wall")
    bodies = [RigidBody(box, (x, 0.5), "g", density=1.0) for x in (0.5, 1.5)]
    bodies.append(RigidBody(box, (2.5, 0.5), "g", density=1.0))
    gravity = Gravity((10.0 * np.sin(slope), -10.0 * np.cos(slope)))
    scene = Scene(
        rigid=[wall, *bodies], lattice=(3.0, None), loads=[gravity],
        contacts=[Contact(("g", "wall"), law), Contact(("g", "g"), SMOOTH)],
    )  # fmt: skip
    scene = replace(scene, lattice=scene.lattice)  # as rows
    simulation = Simulation(scene, 0.01, tolerance=1e-10)
    record, worst = run(simulation, 1.0)
    speed = 10.0 * (np.sin(slope) - friction * np.cos(slope))
    assert np.allclose(simulation.rigid.state.velocity[1:], [speed, 0.0], atol=1e-7)
    assert np.allclose(simulation.rigid.state.position[1:, 0], np.arange(3) + 0.5 + 0.5 * speed)
    shown = simulation.rigid.displayed.position[1:]
    assert np.all((shown[:, 0] >= 0.0) & (shown[:, 0] < 3.0))
    assert np.allclose(shown[:, 1], 0.5, atol=1e-9)
    assert worst < 1e-9
    assert simulation.macroscopic is None
    # walls and neighbours, on both sides: boxes touch at two corners of a side
    assert {tuple(pair) for pair in find_contact_forces(simulation).bodies.tolist()} >= {
        (1, 0), (2, 0), (3, 0),
    }  # fmt: skip


@pytest.mark.fast
def test_an_overlap_across_the_border_is_resolved_by_halves():
    """0.6 m between a disc and the image of another: each moves by 0.3 m, away from the border."""
    discs = [RigidBody(Disc(0.5), (x, 0.5), "g", density=1.0) for x in (0.2, 2.8)]
    scene = Scene(
        rigid=discs, lattice=(3.0, None), contacts=[Contact(("g", "g"), SignoriniCoulomb())],
        resolve_overlaps=True,
    )  # fmt: skip
    found = scene.rigid_bodies.position
    assert found == pytest.approx(np.array([[0.5, 0.5], [2.5, 0.5]]), abs=1e-6)
