# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stacks that bounce for long: no energy from nothing, momentum kept, no drift into one another.

At theta = 1/2 the energy changes in a step by sum P_N (U0_N + U1_N) / 2, which is zero where
U1_N = -U0_N: with e = 1 the energy is that of the start for ever. `benchmarks/bouncing_stack.py`
makes a million steps of the stack of five.
"""

from __future__ import annotations

import numpy as np
import pytest
from stacks import Stack

MASSES = (1.0, 2.0, 0.5, 3.0, 1.5)
STEP, GAP = 2e-3, 0.01


def stack(e, count):
    return Stack(MASSES[:count], GAP * np.arange(1, count + 1), e)


def test_a_mass_that_leaves_is_struck_again(figure):
    """Two masses just below the ground, 1 m/s up and 10 m/s down: e = 1 keeps the energy.

    Both contacts turn their velocities round: -1 m/s at the ground, 11 m/s between the masses.
    """
    pair = Stack((1.0, 2.0), (-0.01, -0.01), 1.0, velocity=(1.0, -10.0), gravity=0.0)
    before = pair.energy
    pair.step(1e-3)
    error = abs(pair.energy / before - 1.0)
    figure("leaving the ground, struck from above", "energy error < 1e-12", error)
    assert error < 1e-12
    assert pair.velocity == pytest.approx([-1.0, 10.0], rel=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 5])
def test_elastic_stack_keeps_its_energy(count, figure):
    """e = 1, 3000 steps: energy, momentum, and gaps that never fall below h |U|."""
    bodies, most, deepest, momentum = stack(1.0, count), 0.0, 0.0, 0.0
    start = bodies.energy
    fastest = np.sqrt(2.0 * start / min(MASSES[:count]))
    weight = bodies.gravity * bodies.masses.sum()
    for number in range(1, 3001):
        bodies.step(STEP)
        most = max(most, abs(bodies.energy / start - 1.0))
        deepest = min(deepest, bodies.gaps.min())
        missing = bodies.momentum + weight * number * STEP - bodies.ground_impulse
        momentum = max(momentum, abs(missing) / (weight * number * STEP))
    figure(f"elastic stack of {count}, 3e3 steps", "energy error < 1e-10", most)
    figure(f"elastic stack of {count}, 3e3 steps", "momentum error < 1e-11", momentum)
    depth = -deepest / (STEP * fastest)
    figure(f"elastic stack of {count}, 3e3 steps", "depth / (h largest speed) < 1", depth)
    assert most < 1e-10
    assert momentum < 1e-11
    assert depth < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_inelastic_stack_comes_to_rest_and_stays(e, figure):
    """Energy never above what it was, but for what gravity takes back of a penetration.

    A pair of closed masses may rise out of each other: it then regains what it lost sinking, at
    most the weight above it times the depth.
    """
    bodies = stack(e, 5)
    start = least = bodies.energy
    weight, grown = bodies.gravity * bodies.masses.sum(), 0.0
    for number in range(3000):
        bodies.step(STEP)
        if number == 2000:
            settled = bodies.height.copy()
        depth = np.maximum(-bodies.gaps, 0.0).sum()
        grown = max(grown, bodies.energy - least)
        assert bodies.energy < start + 1e-12 * start
        assert bodies.energy > -weight * depth * (1.0 + 1e-12)
        least = min(least, bodies.energy)
    drift = np.abs(bodies.height - settled).max() / GAP
    figure(f"stack, e = {e}, 3e3 steps", "energy regained / its start < 0.01", grown / start)
    figure(f"stack at rest, e = {e}, 1e3 steps", "drift / gap at the start < 1e-12", drift)
    assert grown < 0.01 * start
    assert drift < 1e-12
    assert np.abs(bodies.velocity).max() < 1e-12 * np.sqrt(bodies.gravity * GAP)
