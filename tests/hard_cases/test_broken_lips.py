# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bonds broken, and what is left of them: pressed and sheared at once, or closed again at speed.

Lips that were bonded meet at position level: whatever happens they do not interpenetrate at the
end of any step, push and never pull, and friction stays within Coulomb's bound.
"""

from __future__ import annotations

import numpy as np
import pytest
from energies import bulk_energy, dissipations, missing_energy
from point_mass import PointMass
from scenes import BOTTOM, TOP, box_bodies, field, run

from xper_fx.forms.loads import Gravity, PrescribedDisplacement
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import CohesiveZone
from xper_fx.scene.scene import Scene
from xper_fx.simulation.simulation import Simulation

MU = 0.3
SCHEMES = [("implicit", s, 0.5) for s in ("nlgs", "newton", "accelerated", "auto")] + [
    ("implicit", "auto", 1.0),
    ("explicit", "auto", 0.5),
]


def assert_lips(jump, impulse, opening, size):
    """No interpenetration beside `opening` (m), no pull and no excess of friction, by points."""
    assert jump[:, 0].min() >= -1e-9 * opening
    assert impulse[:, 0].min() >= -1e-9 * size
    friction = np.linalg.norm(impulse[:, 1:], axis=1)
    assert np.all(friction <= MU * impulse[:, 0] + 1e-9 * size)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
def test_a_bond_broken_in_one_step_and_pressed_in_the_next(theta, dim, figure):
    """Then pressed, sheared and pulled at random by up to ten times its strength."""
    law, area, step, deepest = CohesiveZone(2e18, 0.5, 1e9, friction=MU), 1e-6, 1e-10, 0.0
    strength, opening = law.strength * area, law.critical_opening
    for seed in range(10):
        rng = np.random.default_rng(seed)
        bond = PointMass(law, 10.0 ** rng.uniform(-9, -7), np.zeros(dim), area=area, theta=theta)
        bond.step(step, [[1e6 * strength, *[0.0] * (dim - 1)]])
        assert bond.damage == 0.0
        bond.velocity[:] *= -1.0  # thrown back
        size = bond.masses[0] * np.abs(bond.velocity).max()
        for count in range(60):
            if count % 3 == 0:
                force = strength * rng.normal(size=(1, dim)) * 10.0 ** rng.uniform(-1.0, 1.0)
                force[0, 0] -= strength
            work = bond.step(step, force)
            assert bond.damage == 0.0 and work.stored == 0.0 and work.cohesion == 0.0
            assert work.friction >= 0.0 and work.impact >= 0.0
            assert_lips(bond.jump[None], bond.impulse[None], opening, size)
            deepest = max(deepest, -bond.jump[0] / opening)
    figure(f"bond broken and pressed, theta {theta}, {dim}D", "penetration / dc < 1e-9", deepest)


# -- bodies

C, W, R_MAX, STIFF, WIDTH = 100.0, 1.0, 10.0, LinearElastic(1e5, 0.2, 1e-3), 2.0


def driven(scheme, solver, theta):
    """Four cells, two above two, torn apart within 40 steps, closed in 10, pressed and sheared."""
    law = CohesiveZone(C, W, R_MAX, friction=MU)
    step, dc = 4e-5, law.critical_opening
    normal = ([0.0, 40 * step, 50 * step, 1.0], [0.0, 2.0 * dc, -0.05 * dc, -0.05 * dc])
    slip = ([0.0, 50 * step, 90 * step, 150 * step], [0.0, 0.0, 0.5 * dc, -0.5 * dc])
    scene = Scene(
        box_bodies((WIDTH, 2), (2, 2), "quadrilateral", lambda x: x[1] > 1.0),
        {1: STIFF},
        default_interaction=law,
        loads=[PrescribedDisplacement(BOTTOM, axis, 0.0) for axis in (0, 1)]
        + [
            PrescribedDisplacement(TOP, 0, lambda t: np.interp(t, *slip)),
            PrescribedDisplacement(TOP, 1, lambda t: np.interp(t, *normal)),
        ],
    )
    options = {"tolerance": 1e-11, "num_threads": 1}
    return Simulation(scene, step, scheme=scheme, solver=solver, theta=theta, **options), law


@pytest.mark.parametrize("scheme, solver, theta", SCHEMES)
def test_lips_torn_then_pressed_and_sheared(scheme, solver, theta, figure):
    simulation, law = driven(scheme, solver, theta)
    points, lost, deepest, sliding = simulation.interactions, np.zeros(3), 0.0, 0
    start = bulk_energy(simulation)
    run(simulation, 40)
    assert not points.gather("damage").any()
    assert simulation.ledger.energies.dissipated_cohesion == pytest.approx(W * WIDTH, rel=1e-9)
    size = R_MAX * WIDTH * simulation.step_size
    for _ in range(110):
        run(simulation, 1)
        before, lost = lost, dissipations(simulation)
        assert np.all(lost >= before - 1e-12 * W * WIDTH)
        assert not points.gather("damage").any()
        assert simulation.ledger.energies.cohesive == 0.0
        jump, impulse = points.gather("jump"), points.gather("impulse")
        assert_lips(jump, impulse, law.critical_opening, size)
        deepest = max(deepest, -jump[:, 0].min() / law.critical_opening)
        sliding += np.count_nonzero(points.gather("status") == 2)
    assert sliding > 30 and lost[1] > 1e-3 * W * WIDTH
    assert lost[0] == pytest.approx(W * WIDTH, rel=1e-9)
    missing = missing_energy(simulation, start) / start
    case = f"lips torn, pressed, sheared, {scheme}, {solver}, theta {theta}"
    figure(case, "penetration / dc < 1e-9", deepest)
    figure(case, "energy missing < 1e-10", missing)
    assert missing < 1e-10


GRAVITY = 20.0


def thrown(scheme, solver, theta):
    """A block bonded to a held one, thrown off it at 1 m/s aslant; gravity brings it back."""
    law = CohesiveZone(1e5, 0.05, 20.0, friction=MU)
    scene = Scene(
        box_bodies((1, 2), (2, 4), "crossed", lambda x: x[1] > 1.0, {2: lambda x: x[1] > 1.0}),
        {1: LinearElastic(1e4, 0.2, 1.0), 2: LinearElastic(1e4, 0.2, 1.0)},
        default_interaction=law,
        loads=[PrescribedDisplacement(BOTTOM, axis, 0.0) for axis in (0, 1)]
        + [Gravity((0, -GRAVITY))],
        initial_velocity={2: lambda x: np.stack([0.2 + 0.0 * x[0], 1.0 + 0.0 * x[0]])},
    )
    options = {"tolerance": 1e-10, "num_threads": 1}
    return Simulation(scene, 1e-3, scheme=scheme, solver=solver, theta=theta, **options), law


@pytest.mark.slow
@pytest.mark.parametrize("scheme, solver, theta", SCHEMES)
def test_lips_that_part_and_close_again_at_speed(scheme, solver, theta, figure):
    """Of the speed at which the block comes back less is left, and its momentum is accounted."""
    simulation, law = thrown(scheme, solver, theta)
    points, step = simulation.interactions, simulation.step_size
    mass = simulation.bulk.mass.reshape(-1, 2)
    upper = simulation.bulk.layout.body_of_node() == 1
    weight = mass[upper].sum(axis=0) * np.array([0.0, -GRAVITY])
    total = mass[upper, 0].sum()
    start, lost, deepest, unbalanced = bulk_energy(simulation), np.zeros(3), 0.0, 0.0
    speeds, pushing = [1.0], []
    for _ in range(200):
        momentum = (mass * field(simulation, "velocity"))[upper].sum(axis=0)
        broken = not points.gather("damage").any()
        run(simulation, 1)
        jump, impulse = points.gather("jump"), points.gather("impulse")
        on_upper = np.einsum("pi,pij->j", impulse, points.points.frame)
        after = (mass * field(simulation, "velocity"))[upper].sum(axis=0)
        error = np.abs(after - momentum - step * weight - on_upper).max()
        unbalanced = max(unbalanced, error / total)
        before, lost = lost, dissipations(simulation)
        assert np.all(lost >= before - 1e-12 * start)
        deepest = max(deepest, -jump[:, 0].min() / law.critical_opening)
        if broken:
            assert_lips(jump, impulse, law.critical_opening, total)
        speeds.append(after[1] / total)
        pushing.append(broken and impulse[:, 0].sum() > 1e-6 * total)
    back = pushing.index(True)
    arrival, rebound = -speeds[back], max(speeds[back:])
    assert back > 50 and arrival > 0.7
    missing = missing_energy(simulation, start) / start
    case = f"lips that close at speed, {scheme}, {solver}, theta {theta}"
    figure(case, "penetration / dc < 1e-9", deepest)
    figure(case, "rebound / arrival, 0 to 1", rebound / arrival)
    figure(case, "momentum missing < 1e-12", unbalanced)
    figure(case, "energy missing < 1e-10", missing)
    assert 0.0 <= rebound <= arrival
    assert unbalanced < 1e-12
    assert missing < 1e-10
    assert deepest < 1e-9
