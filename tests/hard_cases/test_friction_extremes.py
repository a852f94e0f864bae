# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction of 0, 1e-12 and 2: nearly none is none, and much is neither too much nor gained."""

from __future__ import annotations

import numpy as np
import problems
import pytest
from scenes import BOTTOM, box_bodies, field, run
from test_friction_problem import assert_honest

from xper_fx.forms.loads import Gravity
from xper_fx.materials import LinearElastic
from xper_fx.nscd.friction import SOLVERS, FrictionProblem
from xper_fx.nscd.laws import SignoriniCoulomb
from xper_fx.scene import Scene, Wall
from xper_fx.simulation.simulation import Simulation

SCHEMES = [("implicit", s) for s in ("nlgs", "newton", "accelerated", "auto")] + [
    ("explicit", "auto")
]

# -- problems of rigid bodies

HEAPS = {
    "disks": lambda mu: problems.disks_on_wall(30, mu=mu),
    "spheres": lambda mu: problems.sphere_heap(20, mu=mu),
}


# To 1e-11; the interior point ends at rounding before.
REACHING = [solver for solver in SOLVERS if solver != "interior_point"]


@pytest.mark.parametrize("solver", REACHING)
@pytest.mark.parametrize("name", HEAPS)
def test_nearly_no_friction_is_none(name, solver, figure):
    results = []
    for mu in (0.0, 1e-12):
        problem = FrictionProblem(*HEAPS[name](mu))
        results.append(problem.solve(solver, tolerance=1e-11))
        assert results[-1].converged
    size = np.abs(problem.q).max()
    difference = np.abs(results[0].velocity - results[1].velocity).max() / size
    figure(f"{name}, mu 0 and 1e-12, {solver}", "velocities apart < 1e-10", difference)
    assert difference < 1e-10
    assert results[0].reaction.reshape(-1, problem.dim)[:, 0].max() > 0.0
    np.testing.assert_array_equal(results[0].reaction.reshape(-1, problem.dim)[:, 1:], 0.0)


@pytest.mark.parametrize("mu", [0.0, 1e-12, 1e-6])
@pytest.mark.parametrize("name", HEAPS)
def test_interior_point_with_nearly_no_friction(name, mu, figure):
    """Its cones have next to no inside: it has to start where impulses are, not where cones end."""
    result = FrictionProblem(*HEAPS[name](mu)).solve("interior_point")
    figure(f"{name}, mu {mu:g}, interior point", "error < 1e-8", result.error)
    assert result.converged and len(result.history) <= 30


@pytest.mark.parametrize("solver", REACHING)
@pytest.mark.parametrize("name", HEAPS)
def test_much_friction_dissipates(name, solver, figure):
    """mu = 2, at which a contact may wedge: no gain, and what does not converge says so."""
    problem = FrictionProblem(*HEAPS[name](2.0))
    result = problem.solve(solver, max_sweeps=3000)
    assert_honest(problem, result)
    assert result.converged or solver != "auto"
    if not result.converged:
        return
    r, u = (a.reshape(-1, problem.dim)[:, 1:] for a in (result.reaction, result.velocity))
    heat = -(r * u).sum(axis=1)
    scale = np.abs(result.reaction).max() * np.abs(problem.q).max()
    figure(f"{name}, mu 2, {solver}", "heat of each contact > -1e-7", heat.min() / scale)
    assert heat.min() > -1e-7 * scale
    assert result.reaction @ (0.5 * (result.velocity + problem.q)) < 0.0


# -- bodies

GRAVITY = 10.0


def block(mu, scheme, solver, angle=0.0, velocity=None, step=2e-4, theta=0.5):
    """A block of two bodies on each other on a plane inclined by `angle`."""
    law = SignoriniCoulomb(mu)
    down = GRAVITY * np.array([np.sin(angle), -np.cos(angle)])
    scene = Scene(
        box_bodies((4, 1), (4, 2), "crossed", lambda x: x[1] > 0.5),
        {1: LinearElastic(1e5, 0.3, 1.0)},
        default_interaction=law,
        walls=[Wall(BOTTOM, (0, 0), (0, 1), law)],
        loads=[Gravity(down)],
        initial_velocity=velocity,
    )
    options = {"tolerance": 1e-12, "num_threads": 1}
    return Simulation(scene, step, scheme=scheme, solver=solver, theta=theta, **options)


def thrown(x):
    return np.stack([1.0 + 0.3 * x[1], -0.5 + 0.0 * x[0]])


@pytest.mark.parametrize("scheme, solver", SCHEMES)
def test_blocks_with_nearly_no_friction(scheme, solver, figure):
    """The frictionless law has no tangential solve at all; that with 1e-12 has."""
    none, little = (block(mu, scheme, solver, velocity=thrown) for mu in (0.0, 1e-12))
    for simulation in (none, little):
        run(simulation, 60)
    apart = np.abs(none.state.velocity - little.state.velocity).max()
    figure(f"blocks, mu 0 and 1e-12, {scheme}, {solver}", "velocities apart < 1e-10 m/s", apart)
    assert none.ledger.energies.dissipated_impact > 0.0
    assert none.ledger.energies.dissipated_friction == 0.0
    assert little.ledger.energies.dissipated_friction > 0.0
    assert apart < 1e-10  # thrown at 1 m/s


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["nlgs", "newton", "accelerated", "auto"])
@pytest.mark.parametrize("mu", [1.5, 2.0])
def test_block_on_a_steep_incline(mu, solver, figure):
    """At 60 degrees, tan = 1.732: mu = 2 holds both blocks, 1.5 lets them slide, g (s - mu c)."""
    angle = np.pi / 3.0
    simulation = block(mu, "implicit", solver, angle, step=1e-2, theta=1.0)
    run(simulation, 100)
    impulse = simulation.interactions.gather("impulse")
    largest = impulse[:, 0].max()
    assert np.all(np.abs(impulse[:, 1]) <= mu * impulse[:, 0] + 1e-9 * largest)
    weights = simulation.bulk.mass.reshape(-1, 2)[:, 0]
    speed = weights @ field(simulation, "velocity")[:, 0] / weights.sum()
    fall = GRAVITY * max(np.sin(angle) - mu * np.cos(angle), 0.0) * simulation.time
    error = abs(speed - fall) / (GRAVITY * simulation.time)
    figure(f"steep incline, mu {mu}, {solver}", "speed off by < 5e-3 g t", error)
    assert error < 5e-3
