# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy under impact with restitution e, for theta from 1/2 to beyond 1 / (1 + e).

With E = kinetic + elastic - work of the loads, the theta scheme changes E in a step by

    sum over points of P . U_m - (theta - 1/2) (dv . M . dv + dq . K . dq),
    U_m = theta U1 + (1 - theta) U0.

A point that closes (U0_N < 0) leaves with U1_N = -e U0_N, and P_N U_m,N = P_N U0_N (1 - theta
(1 + e)) <= 0 if theta <= 1 / (1 + e). Two things add to that. A point still below its gap that was
already leaving (U0_N > 0) and that a force stops again has U1_N = 0, P_N U_m,N = (1 - theta) P_N
U0_N; friction, which opposes U1_T, works at most (1 - theta) |P_T| |U0_T| where a force turns the
slip round within the step. So

    dE <= (1 - theta) sum [P_N max(U0_N, 0) + |P_T| |U0_T|],

without friction dE <= 0 in every step in which no closed point was leaving, and with theta = 1 and
e = 0 always. The explicit bulk has theta = 1/2 and the energy E - h^2 v.K.v / 8.
"""

from __future__ import annotations

import numpy as np
import pytest
from energies import bulk_energy
from point_mass import PointMass
from scenes import BOTTOM, EXACT, box_bodies, run

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

RESTITUTIONS = [0.0, 0.4, 1.0]
# theta from 1/2 (0) to 1 / (1 + e) (1)
SHARES = [0.0, 0.5, 1.0]


def theta_of(share, e):
    return 0.5 + share * (1.0 / (1.0 + e) - 0.5)


# -- points


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("e", RESTITUTIONS)
def test_two_masses_under_changing_forces(e, share, dim, figure):
    """Masses of ratio up to 100 thrown and pushed against each other."""
    rng = np.random.default_rng(0)
    theta, step, impacts, most, leaving = theta_of(share, e), 1e-2, 0, 0.0, 0
    for friction in (0.0, 0.5, 2.0):
        law = SignoriniCoulomb(friction, e)
        masses = 10.0 ** rng.uniform(-1.0, 1.0, 2)
        pair = PointMass(law, masses, rng.normal(size=(2, dim)), gap=0.02, theta=theta)
        for count in range(200):
            if count % 20 == 0:
                force = 50.0 * rng.normal(size=(2, dim))
                force[0, 0] -= 40.0
            before, kinetic = pair.velocity.copy(), pair.kinetic
            u0 = pair.frame @ (before[0] - before[1])
            pair.step(step, force)
            work = step * np.sum(force * (theta * pair.velocity + (1.0 - theta) * before))
            scale = kinetic + pair.kinetic + abs(work)
            gained = (pair.kinetic - kinetic - work) / scale
            p = pair.impulse
            allowed = p[0] * max(u0[0], 0.0) + np.linalg.norm(p[1:]) * np.linalg.norm(u0[1:])
            assert gained <= (1.0 - theta) * allowed / scale + 1e-14
            impacts += p[0] > 0.0 and u0[0] < 0.0
            leaving += p[0] > 0.0 and u0[0] > 0.0
            if friction == 0.0 and u0[0] <= 0.0:
                most = max(most, gained)
                assert gained <= 1e-14
    assert impacts > 8
    if 0.0 < e < 1.0:
        assert leaving > 0
    figure(f"impact, e = {e}, theta = {theta:.3g}", "energy gained in a step <= 1e-14", most)


@pytest.mark.parametrize("e", RESTITUTIONS[1:])
def test_the_bound_on_theta_is_sharp(e, figure):
    """A mass that arrives with speed v pressed by F: dE = a h F v - (1 - e^2) m v^2 / 2.

    a = theta (1 + e) - 1 is what the mass moves, over h v, while it is stopped: against F. For a
    just above zero and F large enough E grows, for a = 0 it does not whatever F.
    """
    mass, speed, step = 2.0, 0.3, 1e-2
    for a in (-1e-2, 0.0, 1e-2):
        theta = (1.0 + a) / (1.0 + e)
        if theta < 0.5:
            continue
        for pressed in (0.0, 1.0, 1e4):  # h F over m v
            force = pressed * mass * speed / step
            ball = PointMass(SignoriniCoulomb(restitution=e), mass, [-speed, 0.0], theta=theta)
            kinetic = ball.kinetic
            ball.step(step, [[-force, 0.0]])
            moved, rounding = ball.jump[0] / (step * speed), 1e-15 * (1.0 + pressed)
            assert moved == pytest.approx(a, abs=rounding)
            gained = (ball.kinetic - kinetic) / kinetic + 2.0 * pressed * moved
            exact = 2.0 * a * pressed - (1.0 - e * e)
            assert gained == pytest.approx(exact, abs=10.0 * rounding * (1.0 + pressed))
    figure(f"theta 1 % above 1 / (1 + e), e = {e}, pressed", "energy grows: > 1", gained)
    assert gained > 1.0


# -- bodies


def askew(x):
    return np.stack([0.5 + 0.2 * x[1], -1.0 - 0.3 * x[1]])


def blocks(theta, e, friction, *, velocity=askew, gap=1e-3, young=100.0, gravity=0.0, **options):
    """Two crossed blocks, one on the other, thrown at the ground."""
    law = SignoriniCoulomb(friction, e)
    scene = Scene(
        box_bodies((1, 2), (2, 4), "crossed", lambda x: x[1] > 1.0),
        {1: LinearElastic(young, 0.3, 1.0)},
        default_interaction=law,
        walls=[Wall(BOTTOM, (0, -gap), (0, 1), law)],
        loads=[Gravity((0.0, -gravity))],
        initial_velocity=velocity,
    )
    return Simulation(scene, 4e-3, theta=theta, **options, **EXACT)


def gains(simulation, steps):
    """By steps: energy gained, and the gain that leaving points and turned slips allow.

    Also the number of points that were arriving when they pushed.
    """
    points, theta, rows = simulation.interactions, simulation.theta, []
    for _ in range(steps):
        before, u0 = bulk_energy(simulation), points.gather("velocity")
        run(simulation, 1)
        p = points.gather("impulse")
        allowed = p[:, 0] * np.maximum(u0[:, 0], 0.0)
        allowed += np.linalg.norm(p[:, 1:], axis=1) * np.linalg.norm(u0[:, 1:], axis=1)
        arriving = np.count_nonzero((p[:, 0] > 0.0) & (u0[:, 0] < 0.0))
        rows.append((bulk_energy(simulation) - before, (1.0 - theta) * allowed.sum(), arriving))
    return np.array(rows).T


@pytest.mark.slow
@pytest.mark.parametrize(
    "scheme, solver, friction",
    [("implicit", "nlgs", 0.5), ("implicit", "newton", 0.5), ("implicit", "accelerated", 0.5)]
    + [("implicit", "auto", 0.0), ("implicit", "auto", 0.5), ("explicit", "auto", 0.5)],
)
def test_blocks_thrown_at_the_ground(scheme, solver, friction, figure):
    """Bodies that hit the ground and each other askew never have more energy than at the start."""
    most = -np.inf
    for e in RESTITUTIONS:
        for share in SHARES if (scheme, solver) == ("implicit", "auto") else [0.0]:
            theta = theta_of(share, e)
            simulation = blocks(theta, e, friction, scheme=scheme, solver=solver)
            start = bulk_energy(simulation)
            gained, allowed, arriving = gains(simulation, 120)
            assert arriving.sum() > 8
            assert np.all(gained <= allowed + 1e-12 * start), (e, theta)
            if friction == 0.0 or theta == 1.0:
                assert np.all(gained[allowed == 0.0] <= 1e-12 * start), (e, theta)
            most = max(most, np.cumsum(gained).max() / start)
    figure(f"blocks thrown, mu {friction}, {scheme}, {solver}", "energy above start <= 1e-12", most)
    assert most <= 1e-12


def test_pressed_blocks_gain_energy_beyond_the_bound(figure):
    """Stiff blocks that fall slowly on the ground under a large weight, e = 1: dE of a mass."""
    speed, gravity = 1e-4, 10.0
    gained = {}
    for theta in (0.5, 0.55):
        simulation = blocks(
            theta, 1.0, 0.0, velocity=lambda x: np.stack([0.0 * x[0], 0.0 * x[0] - speed]),
            gap=0.0, young=1e9, gravity=gravity,
        )  # fmt: skip
        start = bulk_energy(simulation)
        run(simulation, 1)
        gained[theta] = bulk_energy(simulation) / start - 1.0
    assert abs(gained[0.5]) <= 1e-9
    figure("pressed blocks, e = 1, theta = 0.55", "energy grows: > 1", gained[0.55])
    pressed = gravity * simulation.step_size / speed
    assert gained[0.55] == pytest.approx(2.0 * 0.1 * pressed, rel=0.1)  # less what then vibrates
