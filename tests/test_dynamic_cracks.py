# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cracks that run: below the Rayleigh speed, and from the notch of Kalthoff and Winkler's plate."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import kalthoff
from crack_speed import Strip, crack, wave_speeds

from xper_fx.materials import LinearElastic
from xper_fx.materials.library import ZIRCALOY_4


def test_rayleigh_speed():
    """At nu = 1/4 the cubic has the root c^2 = (2 - 2 / sqrt 3) c_s^2 (Rayleigh 1885)."""
    _, slow, limit = wave_speeds(LinearElastic(2.5, 0.25, 1.0))
    assert slow == pytest.approx(1.0, rel=1e-14)
    assert limit == pytest.approx(np.sqrt(2.0 - 2.0 / np.sqrt(3.0)), rel=1e-9)
    assert wave_speeds(ZIRCALOY_4)[2] == pytest.approx(2038.077, abs=1e-3)


def test_a_crack_stays_below_the_rayleigh_speed_and_spends_w():
    strip = Strip(10.0, cells=12, length=5.0)
    growth = crack(strip)
    speeds = growth.speeds()[1] / wave_speeds(ZIRCALOY_4)[2]
    assert len(speeds) > 8
    assert speeds.max() < 1.0
    assert speeds[-1] > 0.6 and speeds[-1] > speeds[0]
    spent = np.ptp(growth.dissipated) / np.ptp(growth.tip)
    assert spent == pytest.approx(strip.bond.fracture_energy, rel=0.15)  # and the zone's part
    assert abs(growth.closure) < 1e-3


def test_the_angle_is_that_of_a_line_of_damage():
    away = np.linspace(0.0, 0.05, 20)[:, None] * [np.cos(1.2), np.sin(1.2)]
    middle = np.concatenate([kalthoff.TIP + away, [[0.09, 0.03], [0.06, 0.01]]])
    lost = np.append(np.ones(20), [0.0, 5.0])  # unbroken, and below the notch
    nothing = np.zeros(len(lost))
    damage = kalthoff.Damage(middle, np.zeros((22, 2, 2)), lost, nothing, nothing, {})
    assert kalthoff.crack_angle(damage, 0.1) == pytest.approx(np.degrees(1.2), abs=1e-9)


def test_kalthoffs_crack_starts_at_the_notch_and_turns_up():
    """A mesh too coarse for more: where it starts, which way it goes, the balance."""
    damage, simulation = kalthoff.run(kalthoff.scene_of(5e-3), 40e-6)
    first = damage.midpoint[np.argmin(damage.first)]
    assert np.linalg.norm(first - kalthoff.TIP) < 5e-3
    # not before the pressure wave from the edge is there
    arrival = kalthoff.NOTCH_LENGTH / wave_speeds(kalthoff.STEEL)[0]
    assert arrival < damage.first.min() < 2.5 * arrival
    assert 30.0 < kalthoff.crack_angle(damage, 0.03) < 110.0
    above = damage.midpoint[:, 1] > kalthoff.NOTCH_HEIGHT + 2e-3
    assert damage.dissipated[above].sum() > 0.5 * damage.dissipated.sum() > 0.0
    assert abs(damage.energies["closure"]) < 5e-3 * damage.energies["external_work"]
    assert simulation.scene.bodies.num_bodies > 500
