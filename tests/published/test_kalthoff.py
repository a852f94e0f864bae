# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kalthoff and Winkler's plate, coarse: where its crack starts and which way it goes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import kalthoff


def test_the_angle_is_that_of_a_line_of_damage():
    away = np.linspace(0.0, 0.05, 20)[:, None] * [np.cos(1.2), np.sin(1.2)]
    middle = np.concatenate([kalthoff.TIP + away, [[0.09, 0.03], [0.06, 0.01]]])
    lost = np.append(np.ones(20), [0.0, 5.0])  # unbroken, and below the notch
    nothing = np.zeros(len(lost))
    damage = kalthoff.Damage(middle, np.zeros((22, 2, 2)), lost, nothing, nothing, {})
    assert kalthoff.crack_angle(damage, 0.1) == pytest.approx(np.degrees(1.2), abs=1e-9)


@pytest.mark.slow
def test_kalthoffs_crack_starts_at_the_notch_and_turns_up():
    """A mesh too coarse for more: where it starts, which way it goes, the balance."""
    damage, simulation = kalthoff.run(kalthoff.scene_of(5e-3), 40e-6)
    first = damage.midpoint[np.argmin(damage.first)]
    assert np.linalg.norm(first - kalthoff.TIP) < 5e-3
    # not before the pressure wave from the edge is there
    steel = kalthoff.STEEL
    shear = 0.5 * steel.young / (1.0 + steel.poisson)
    stiffness = 2.0 * shear * (1.0 - steel.poisson) / (1.0 - 2.0 * steel.poisson)
    arrival = kalthoff.NOTCH_LENGTH / np.sqrt(stiffness / steel.density)
    assert arrival < damage.first.min() < 2.5 * arrival
    assert 30.0 < kalthoff.crack_angle(damage, 0.03) < 110.0
    above = damage.midpoint[:, 1] > kalthoff.NOTCH_HEIGHT + 2e-3
    assert damage.dissipated[above].sum() > 0.5 * damage.dissipated.sum() > 0.0
    assert abs(damage.energies["closure"]) < 5e-3 * damage.energies["external_work"]
    assert simulation.scene.bodies.num_bodies > 500
