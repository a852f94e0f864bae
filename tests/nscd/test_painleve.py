# SPDX-License-Identifier: LGPL-3.0-or-later
"""Painleve's rod: a rigid rod sliding on a rough ground, in and out of the paradox.

A rod of length 2 l, mass m, inertia m l^2 / 3, leans at theta on its lower end, which slides
towards -x, away from the centre: friction then presses it down. With the reaction at the limit of
friction, the end accelerates by A(theta) / m times the normal force plus its free acceleration,

    A(theta) = 1 + 3 cos(theta) (cos(theta) - mu sin(theta)),

negative around tan(theta) = 2 if and only if mu > 4/3 (Painleve 1895; Genot and Brogliato 1999): no
force then keeps it sliding. Impulses do: it stops at once, an impact without collision.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from problems import FIXED, Contacts, reduced, transfer

from xper_fx.nscd import FrictionProblem

LENGTH, MASS, GRAVITY = 0.5, 2.0, 9.81  # l, m
INERTIA = MASS * LENGTH**2 / 3.0
STEP = 2e-3


# theta, slip, spin: outside, inside the paradox, just before it and turning into it, lifting off
STARTS = [(0.6, -3.0, 0.0), (1.1, -3.0, 0.0), (0.6, -3.0, 2.0), (1.1, -3.0, 6.0)]


def paradox(theta, mu):
    return 1.0 + 3.0 * np.cos(theta) * (np.cos(theta) - mu * np.sin(theta))


class Step(NamedTuple):
    theta: float  # where the contact was written, the middle of the step
    active: np.ndarray
    q: np.ndarray
    r: np.ndarray
    u: np.ndarray
    velocity: np.ndarray
    gaps: np.ndarray
    energy: float


def ends(position):
    x, y, theta = position
    along = LENGTH * np.array([np.cos(theta), np.sin(theta)])
    return np.array([x, y]) - along, np.array([x, y]) + along


def contact_problem(position, active, velocity, step):
    """W, q and H^T of the `active` ends on the ground (0 the lower one at first), t = (-1, 0)."""
    points = np.array(ends(position))[active]
    n = len(points)
    contacts = Contacts(
        points, np.tile([0.0, 1.0], (n, 1)), np.zeros(n, dtype=int), np.full(n, FIXED)
    )
    centre = np.array([position[:2]])
    free = velocity - [0.0, step * GRAVITY, 0.0]
    problem = reduced(centre, np.array([MASS]), np.array([INERTIA]), contacts, 0.0)
    H_T = transfer(centre, contacts)
    return problem.W, H_T @ free, H_T, free


def reactions(W, q, mu):
    result = FrictionProblem(W, q, mu, 2).solve(tolerance=1e-12)
    assert result.converged, result.reason
    return result.reaction


def energy(position, velocity):
    kinetic = 0.5 * MASS * (velocity[0] ** 2 + velocity[1] ** 2) + 0.5 * INERTIA * velocity[2] ** 2
    return kinetic + MASS * GRAVITY * position[1]


def sliding_rod(theta, slip, spin=0.0):
    """Position and velocity with the lower end on the ground, sliding at `slip` along x."""
    position = np.array([0.0, LENGTH * np.sin(theta), theta])
    velocity = np.array([slip, 0.0, spin])
    velocity[:2] += spin * LENGTH * np.array([-np.sin(theta), np.cos(theta)])
    return position, velocity


def run(position, velocity, mu, end_time, step=STEP):
    """Moreau-Jean, e = 0: contact where the middle of the step touches; yields each `Step`.

    Positions move with the end velocity: the energy then changes by u.r - |dv|_M^2 / 2 <= 0.
    """
    position, velocity = position.copy(), velocity.copy()
    for _ in range(round(end_time / step)):
        middle = position + 0.5 * step * velocity
        active = np.flatnonzero([end[1] <= 1e-12 for end in ends(middle)])
        q = r = u = np.zeros(0)
        W, q, H_T, velocity = contact_problem(middle, active, velocity, step)
        if active.size:
            r = reactions(W, q, np.full(active.size, mu))
            velocity = velocity + (H_T.T @ r) / [MASS, MASS, INERTIA]
            u = H_T @ velocity
        position = position + step * velocity
        gaps = np.array([end[1] for end in ends(position)])
        yield Step(middle[2], active, q, r, u, velocity, gaps, energy(position, velocity))
        if active.size == 2 and np.abs(velocity).max() < 1e-9:
            return


def test_paradox_needs_friction_above_four_thirds():
    """The compliance of the end gives A, least for its friction at tan(theta) = 2."""
    for theta in np.linspace(0.05, 1.5, 30):
        position, velocity = sliding_rod(theta, -1.0)
        W, q, _, _ = contact_problem(position, np.array([0]), velocity, STEP)
        W = MASS * W.toarray()
        c, s = np.cos(theta), np.sin(theta)
        expected = [[1 + 3 * c * c, 3 * c * s], [3 * c * s, 1 + 3 * s * s]]
        np.testing.assert_allclose(W, expected, rtol=1e-12)
        np.testing.assert_allclose(q, [-STEP * GRAVITY, 1.0], rtol=1e-12)
        for mu in (0.5, 4 / 3 - 1e-9, 2.0):
            # sliding towards -x, r = (1, -mu) r_N
            assert W[0] @ [1.0, -mu] == pytest.approx(paradox(theta, mu), abs=1e-12)
            assert mu > 4 / 3 or paradox(theta, mu) > 0.0
    assert paradox(np.arctan(2.0), 4 / 3) == pytest.approx(0.0, abs=1e-15)
    assert paradox(np.arctan(2.0), 1.34) < 0.0


@pytest.mark.parametrize(
    "mu, theta", [(0.3, 1.1), (1.0, 0.6), (1.0, 1.1), (1.3, 1.1), (2.0, 0.6), (2.0, 1.45)]
)
def test_slides_outside_the_paradox(mu, theta):
    """r_N = -m q_N / A: the weight's impulse and a little more, of the order of the step."""
    assert paradox(theta, mu) > 0.0
    position, velocity = sliding_rod(theta, -3.0)
    for step in (1e-3, 1e-5):
        W, q, _, _ = contact_problem(position, np.array([0]), velocity, step)
        normal = MASS * GRAVITY * step / paradox(theta, mu)
        np.testing.assert_allclose(
            reactions(W, q, np.array([mu])), [normal, -mu * normal], rtol=1e-9
        )


@pytest.mark.parametrize("mu, theta", [(1.4, np.arctan(2.0)), (1.5, 1.1), (2.0, 0.8), (2.0, 1.3)])
def test_impact_without_collision(mu, theta):
    """No normal velocity, A < 0: the end stops, by an impulse that no step is short enough for.

    r = (3 c s, -(1 + 3 c^2)) m |slip| / 4, in the cone exactly when A <= 0; it takes away
    m slip^2 (1 + 3 c^2) / 8.
    """
    assert paradox(theta, mu) < 0.0
    c, s = np.cos(theta), np.sin(theta)
    slip = 3.0
    for step in (1e-3, 1e-5, 1e-8):
        position, velocity = sliding_rod(theta, -slip)
        W, q, H_T, free = contact_problem(position, np.array([0]), velocity, step)
        r = reactions(W, q, np.array([mu]))
        expected = np.array([3 * c * s, -(1 + 3 * c * c)]) * MASS * slip / 4
        np.testing.assert_allclose(r, expected, atol=2 * MASS * GRAVITY * step)
        np.testing.assert_allclose(W @ r + q, 0.0, atol=1e-10)
        after = free + H_T.T @ r / [MASS, MASS, INERTIA]
    lost = energy(position, velocity) - energy(position, after)
    assert lost == pytest.approx(MASS * slip**2 * (1 + 3 * c * c) / 8, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mu", "start"),
    [(0.5, 0), (0.5, 3), (1.5, 1), (1.5, 2), (3.0, 0), (3.0, 1), (3.0, 3)],
)
def test_goes_through(mu, start):
    """To rest on both ends: finite, no energy gained, penetrating by no more than a step's motion.

    At each step, where the lower end alone slides on the side where friction presses, its reaction
    is the one that A allows, and A is positive.
    """
    theta, slip, spin = STARTS[start]
    position, velocity = sliding_rod(theta, slip, spin)
    steps = list(run(position, velocity, mu, end_time=2.0))
    energies = np.array([energy(position, velocity)] + [step.energy for step in steps])
    assert np.isfinite(energies).all()
    assert np.diff(energies).max() <= 1e-12 * energies[0]
    velocities = np.array([step.velocity for step in steps])
    fastest = np.linalg.norm(velocities[:, :2], axis=1) + LENGTH * np.abs(velocities[:, 2])
    assert min(step.gaps.min() for step in steps) >= -STEP * fastest.max()
    assert steps[-1].active.size == 2 and np.abs(velocities[-1]).max() < 1e-9

    sliding = [
        step for step in steps
        if list(step.active) == [0] and step.q[0] < 0 and abs(step.u[1]) > 1e-6
        and step.u[1] * np.cos(step.theta) > 0
    ]  # fmt: skip
    for step in sliding:
        side = np.sign(step.u[1])
        A = paradox(step.theta if side > 0 else np.pi - step.theta, mu)
        assert A > 0.0
        np.testing.assert_allclose(step.r[0], -MASS * step.q[0] / A, rtol=1e-6)
    if LENGTH * spin**2 * np.sin(theta) > GRAVITY:
        assert not sliding and steps[1].active.size == 0  # its rotation lifts the end off
    else:
        assert sliding or paradox(theta, mu) < 0.0
