# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of rigid bodies: when the solvers stop, and what a heap keeps from step to step."""

from dataclasses import replace

import numpy as np
import pytest
from heaps import GRAVITY, Heap, box, grains
from solving import solve

from xper_fx.nscd.rigid.body import RigidBody
from xper_fx.nscd.rigid.shapes import Disc
from xper_fx.nscd.solvers import AcceleratedSweeps, Automatic, NonlinearGaussSeidel

TOLERANCE = 1e-3


def violation(layer, free, velocity):
    """By how much the contacts break their laws, relative to |w H r| in the kinetic norm.

    In NumPy, from the laws as they are written: with a velocity u (shifted by the least normal
    one), r is the projection of r - W_d^-1 u on Coulomb's cone of its own normal impulse.
    """
    square = 0.0
    for g in layer.groups:
        u = g.points.relative(velocity.reshape(-1, layer.dim))
        u[:, 0] -= g.terms[:, 0]
        scale = g.compliance[:, [0, 2]] if layer.dim == 2 else g.compliance[:, [0, 3, 5]]
        normal = np.maximum(g.impulse[:, 0] - u[:, 0] / scale[:, 0], 0.0)
        tangent = g.impulse[:, 1:] - u[:, 1:] / scale[:, 1:]
        size = np.linalg.norm(tangent, axis=1)
        bound = g.terms[:, 1] * normal
        tangent *= np.minimum(1.0, bound / np.maximum(size, 1e-300))[:, None]
        answer = np.concatenate([normal[:, None], tangent], axis=1)
        square += np.sum(scale * (answer - g.impulse) ** 2)
    kick = np.vdot(layer.impulses(), velocity - free)
    return np.sqrt(square / kick)


@pytest.fixture(scope="module")
def heap():
    """Discs in a box that come to rest."""
    heap = Heap(grains(60, 6, pitch=2.05))
    heap.advance(600, tolerance=TOLERANCE)
    return heap


@pytest.mark.slow
@pytest.mark.parametrize("solver", [NonlinearGaussSeidel, AcceleratedSweeps, Automatic])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
@pytest.mark.parametrize("guess", [0.5, 1e6])
def test_laws_hold_to_the_tolerance_at_the_stop(heap, solver, tolerance, guess):
    heap.search()
    for g in heap.layer.groups:
        g.impulse[:] *= guess  # a poor one
    free = heap.free_velocity()
    velocity = free.copy()
    report = solve(heap.layer, velocity, solver, tolerance=tolerance, num_threads=1)
    assert report.converged and report.residual <= tolerance
    found = violation(heap.layer, free, velocity)
    assert found < (3.0 if guess < 1.0 else 10.0) * tolerance
    assert guess > 1.0 or found > 0.01 * report.residual
    assert max(g.impulse[:, 0].min() for g in heap.layer.groups) >= 0.0


def test_heap_at_rest_starts_from_its_last_impulses(heap):
    sweeps = []
    for warm in (True, False):
        heap.search()
        if not warm:
            for g in heap.layer.groups:
                g.impulse[:] = 0.0
        velocity = heap.free_velocity()
        report = solve(heap.layer, velocity, tolerance=TOLERANCE, num_threads=1)
        sweeps.append(report.sweeps)
    heap.end(velocity)
    assert sweeps[0] < 0.2 * sweeps[1]


def test_floor_and_walls_carry_the_heap(heap):
    """Over steps at rest the impulses of the walls are the weight, to the tolerance."""
    start, deepest = heap.motion.momentum(), []
    pushed = np.zeros(2)
    for _ in range(20):
        heap.search()
        heap.solve(tolerance=TOLERANCE)
        slots = heap.layer.rigid_part(heap.layer.impulses()).reshape(-1, 4)
        pushed -= slots[60:, :2].sum(axis=0)
        deepest.append(max(-g.points.gap.min() for g in heap.layer.groups))
    weight = heap.bodies.mass[:60].sum() * GRAVITY * 20 * heap.step
    gained = heap.motion.momentum() - start
    np.testing.assert_allclose(pushed - gained, [0.0, weight], atol=1e-9 * weight)
    assert np.abs(gained).max() < 0.05 * weight
    assert deepest[-1] - deepest[0] < GRAVITY * heap.step**2


def test_contacts_found_again_are_those_built_anew(monkeypatch):
    """A run whose contacts keep their order when nothing changed, and one that always builds."""
    ends, built = [], []
    for again in (True, False):
        heap = Heap(grains(12, 3, pitch=2.05))
        if not again:
            monkeypatch.setattr("xper_fx.nscd.found_contacts._ContactSet.are", lambda *_: False)
        count, grouped = [0], heap.layer._permanent.grouping.groups
        heap.layer._permanent.grouping.groups = lambda *a, c=count, f=grouped: (
            c.__setitem__(0, c[0] + 1),
            f(*a),
        )[1]
        heap.advance(60, tolerance=TOLERANCE)
        ends.append(heap.motion.state.position.copy())
        built.append(count[0])
    assert built[0] < built[1] == 50
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("solver", [NonlinearGaussSeidel, AcceleratedSweeps])
def test_heavier_bodies_take_the_same_sweeps(solver):
    """Masses of another unit change impulses in proportion, and nothing of motions or stops."""
    runs = []
    for factor in (1.0, 4.0**10, 4.0**-10):
        bodies = [
            body if body.density is None else replace(body, density=factor * body.density)
            for body in grains(30, 6, pitch=2.05)
        ]
        heap = Heap(bodies)
        heap.advance(120, tolerance=1e-2)
        heap.search()
        heap.solve(solver, tolerance=1e-3)
        impulse = np.concatenate([g.impulse for g in heap.layer.groups])
        runs.append((heap.report.sweeps, heap.motion.state.velocity.copy(), impulse / factor))
    assert runs[0][0] > 5
    for other in runs[1:]:
        np.testing.assert_equal(other, runs[0])


def test_column_carries_its_weight_to_the_ground():
    """Discs that touch above one another: contact k from the top carries k weights."""
    count, radius = 30, 0.01
    discs = [
        RigidBody(Disc(radius), (0.05, (2 * k + 1) * radius * (1 - 1e-9)), "grains", density=2000.0)
        for k in range(count)
    ]
    heap = Heap(discs + box(0.1, 0.0))
    heap.search()
    heap.solve(tolerance=1e-5)
    (group,) = heap.layer.contacts
    weight = heap.bodies.mass[0] * GRAVITY * heap.step
    np.testing.assert_allclose(
        np.sort(group.impulse[:, 0]), weight * np.arange(1, count + 1), rtol=1e-3
    )


def test_heavy_disc_on_light_ones_is_held():
    """Mass ratio 1000: the impulses on the floor are the weight, and nothing is pushed through."""
    row = [
        RigidBody(Disc(0.01), (0.02 * k + 0.03, 0.01), "grains", density=2000.0) for k in range(3)
    ]
    light = row[0].density * np.pi * 0.01**2
    block = RigidBody(Disc(0.02), (0.05, 0.01 + np.sqrt(0.03**2)), "grains", mass=1e3 * light,
                      inertia=0.2 * light)  # fmt: skip
    heap = Heap([*row, block, *box(0.1, 0.0)])
    heap.advance(30, tolerance=1e-4)
    slots = heap.layer.rigid_part(heap.layer.impulses()).reshape(-1, 4)
    floor = -slots[4:, 1].sum()
    weight = heap.bodies.mass[:4].sum() * GRAVITY * heap.step
    gained = heap.motion.state.velocity[3, 1]
    assert abs(floor / weight - 1.0) < 1e-2
    assert abs(gained) < GRAVITY * heap.step
