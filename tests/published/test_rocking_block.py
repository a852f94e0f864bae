# SPDX-License-Identifier: LGPL-3.0-or-later
"""A free rocking block (`benchmarks/rocking_block.py`): exact motion, impact, and their orders."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import rocking_block as rocking  # noqa: E402

TILTS = rocking.ALPHA * (0.5 + 0.004 * np.arange(4))


@pytest.mark.slow
def test_second_order_until_the_impact_and_first_over_it():
    found = [
        np.sqrt(np.mean([np.square(rocking.errors(tilt, step)) for tilt in TILTS], axis=0))
        for step in (8e-3, 2e-3)
    ]
    angle, period, ratio = np.log(found[0] / found[1]) / np.log(4.0)
    assert angle == pytest.approx(2.0, abs=0.15)
    assert period > 0.7
    assert ratio > 0.6
    assert found[1][0] < 5e-6  # rad
    assert found[1][1] < 6e-5  # s
    assert found[1][2] < 5e-3


@pytest.mark.slow
@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_position_level_converges_on_rocking(theta):
    """To its own end: theta = 1 damps, so that the ratio of speeds is looser."""
    _, period, ratio = rocking.errors(TILTS[0], 2e-3, contact="position", theta=theta)
    assert abs(period) < 2e-3
    assert abs(ratio) < 0.1
