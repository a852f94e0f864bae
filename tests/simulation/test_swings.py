# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the time integration leaves of signals that swing, beside lags that are known."""

from __future__ import annotations

import numpy as np
import pytest

from xper_fx.simulation.swings import Swings

PERIODS = 40.0


def followed(signal, steps: int, end: float, count: int = 1) -> Swings:
    """Swings of a function of time with values of shape (n,), in equal steps."""
    swings, size = Swings(count), end / steps
    for k in range(steps):
        start, stop = (np.atleast_1d(signal(size * i)) for i in (k, k + 1))
        swings.now[:] = (stop - start) / size
        swings.take((k + 0.5) * size, size)
    return swings


def test_a_wave_lags_by_its_phase_error():
    """An energy sin(2 w t) / 2 of a wave w: (w h)^2 / 12 w t of its phase, twice in the energy."""
    frequency, steps = 2.0 * np.pi, 8000
    size = PERIODS / steps
    swings = followed(lambda t: 0.5 * np.sin(2.0 * frequency * t), steps, PERIODS)
    phase = (frequency * size) ** 2 / 12.0 * frequency * PERIODS
    # the mean of |cos| is 2 / pi: the sum of sizes is 4 / pi of the lag
    assert swings.error == pytest.approx(phase * 4.0 / np.pi, rel=1e-2)
    assert swings.error == swings.linear and swings.out_of_phase == 0.0


def test_a_wave_out_of_phase_errs_by_its_amplitude():
    """The root mean square of what two waves of unrelated phases differ by: 2^(1/2) of theirs."""
    steps = 200
    swings = followed(lambda t: 0.3 * np.sin(2.0 * np.pi * t), steps, PERIODS)
    assert swings.linear > 2.0
    assert swings.amplitude == pytest.approx(0.3 / np.sqrt(2.0), rel=2e-2)
    assert swings.error == pytest.approx(0.3, rel=0.25)
    assert swings.out_of_phase == pytest.approx(1.0 - swings.error / swings.linear)


@pytest.mark.parametrize("ripple", [1e-3, 1e-2])
def test_small_waves_of_the_mesh_do_not_add_up(ripple):
    """A slow energy with a ripple errs by its own lag and the ripple's amplitude, not by sums."""
    steps = 4000  # of 1 s, in which the ripple swings 1 080 times
    slow = followed(lambda t: np.sin(0.02 * t), steps, float(steps))
    rippled = followed(lambda t: np.sin(0.02 * t) + ripple * np.sin(1.7 * t), steps, float(steps))
    assert rippled.linear > 20.0 * ripple
    least, most = slow.linear + 0.8 * ripple, slow.linear + 1.6 * ripple
    assert least < rippled.error < most


def test_what_was_seen_is_restored():
    swings = followed(lambda t: np.array([np.sin(t), t**3]), 21, 5.0, count=2)
    again = Swings(2)
    again.restore(swings.saved())
    for one in (swings, again):
        for k in range(9):
            one.now[:] = 0.1 * k, (-1.0) ** k
            one.take(5.0 + 0.1 * k, 0.1)
    assert again.error == swings.error and again.linear == swings.linear
    assert again.out_of_phase == swings.out_of_phase
