# SPDX-License-Identifier: LGPL-3.0-or-later
"""A notched bar that snaps back, small: against an arc-length solution apart from the package."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from snap_back import HEIGHT, TOUGHNESS, arc_length, differences, follow  # noqa: E402

import xper_fx as xf  # noqa: E402


@pytest.mark.slow
def test_both_controls_follow_the_arc_length_solution():
    """Over the peak of the load and where the displacement goes back."""
    other = arc_length(8, 0.2)
    assert other.load[-1] < 0.9 * other.load.max()
    assert other.moved[-1] < 0.98 * other.moved.max()
    for control in (xf.GrowthControl(), xf.DissipationControl(0.2 * TOUGHNESS * HEIGHT / 8)):
        apart = differences(follow(8, control, 0.2), other)
        assert apart.shape[1] > 5
        assert apart.max() < 1e-4
