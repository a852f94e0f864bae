# SPDX-License-Identifier: LGPL-3.0-or-later
"""A crack on a weak plane against Freund's equation of motion and Rayleigh's speed."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import crack_speed  # noqa: E402
from crack_speed import HALF_HEIGHT, TRANSIT, WAVES, Strip, Waves  # noqa: E402

from xper_fx.materials import LinearElastic  # noqa: E402


@pytest.fixture(scope="module")
def runs():
    """Growth under G0 = w, 2 w and 4 w until just after the edges answer."""
    strips = [Strip(load, 80, 3.5, cohesive_length=0.1) for load in (1.0, 2.0, 4.0)]
    return {strip: crack_speed.crack(strip, duration=2.3) for strip in strips}


def test_waves_have_their_known_speeds():
    """nu = 1/4: c_d^2 = 3 c_s^2 and c_R^2 = (2 - 2 / sqrt 3) c_s^2 (Rayleigh 1885)."""
    waves = Waves(LinearElastic(young=2.5, poisson=0.25, density=1.0))
    assert waves.slow == pytest.approx(1.0, rel=1e-12)
    assert waves.fast == pytest.approx(np.sqrt(3.0), rel=1e-12)
    assert waves.rayleigh == pytest.approx(np.sqrt(2.0 - 2.0 / np.sqrt(3.0)), rel=1e-9)


def test_freunds_share_falls_from_one_to_zero_at_rayleighs_speed():
    """Near 1 - v / c_R, as Freund (1990) notes, and inverted by `speed`."""
    ratios = np.linspace(0.02, 0.98, 25)
    shares = np.array([WAVES.share(v) for v in ratios * WAVES.rayleigh])
    assert np.all(np.diff(shares) < 0.0)
    np.testing.assert_allclose(shares, 1.0 - ratios, atol=0.06)
    assert WAVES.share(1e-4 * WAVES.rayleigh) == pytest.approx(1.0, abs=2e-4)
    assert WAVES.share((1.0 - 1e-6) * WAVES.rayleigh) < 1e-5
    for v, share in zip(ratios * WAVES.rayleigh, shares, strict=True):
        assert WAVES.speed(share) == pytest.approx(v, rel=1e-6)
    assert WAVES.speed(1.0) == 0.0


@pytest.mark.slow
def test_speed_is_freunds_until_the_edges_answer(runs):
    """Within 4 % of c_R; the zone of weakening bonds, 0.1 H, is not small at first."""
    compared = 0
    for strip, growth in runs.items():
        time, speed = growth.speeds()
        seen = time < 2.0 * TRANSIT
        exact = crack_speed.freund(strip.load, time[seen])
        np.testing.assert_allclose(speed[seen], exact, atol=0.04 * WAVES.rayleigh)
        compared += np.count_nonzero(seen)
    assert compared >= 10


def test_crack_is_slower_than_rayleighs_waves_and_faster_under_more_load(runs):
    largest = [growth.speeds()[1].max() / WAVES.rayleigh for growth in runs.values()]
    assert 0.5 < largest[0] < largest[1] - 0.1 < largest[2] - 0.15 < 0.8
    for growth in runs.values():
        # it grows point by point: none breaks ahead of the tip
        assert np.all(np.diff(growth.arrival) >= 0.0)
        assert growth.place[0] == pytest.approx(crack_speed.START * HALF_HEIGHT)


def test_each_bond_spends_its_energy_and_the_balance_closes(runs):
    for growth in runs.values():
        np.testing.assert_allclose(growth.spent, 1.0, rtol=1e-6)
        assert abs(growth.closure) < 5e-4


def test_a_crack_that_rests_has_no_speed():
    growth = crack_speed.crack(Strip(0.25, 40, 3.0, cohesive_length=0.1), duration=2.0)
    with pytest.raises(ValueError, match="grew by"):
        growth.speeds()
