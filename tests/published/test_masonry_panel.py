# SPDX-License-Identifier: LGPL-3.0-or-later
"""A small panel of bricks and mortar against limit analysis (`benchmarks/masonry_panel.py`)."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from masonry_panel import BRICK, GRAVITY, HEIGHT, LENGTH, PANELS, Panel, limit, push  # noqa: E402


def test_the_limit_of_one_brick_is_known():
    """It slides, with its cohesion or without, or tips about its toe, on the beam or below it."""
    thrust, brick = 3e4, BRICK.density * GRAVITY * LENGTH * HEIGHT
    smooth = Panel("brick", 0.2, 1e5, 1e5, width=1, courses=1)
    assert limit(smooth, False, thrust) == pytest.approx(0.2 * (thrust + brick), rel=1e-9)
    cohesion = 1e5 * LENGTH
    level = smooth._replace(level=True, tension=5e5)
    assert limit(level, True, thrust) == pytest.approx(0.2 * (thrust + brick) + cohesion, rel=1e-9)
    rough = smooth._replace(friction=5.0, cohesion=6e5)
    tips = (thrust + 2.0 * brick) * 0.5 * LENGTH / (2.0 * HEIGHT)
    assert limit(rough, False, thrust) == pytest.approx(tips, rel=1e-9)
    tension = 1e5 * 0.5 * LENGTH * LENGTH / (2.0 * HEIGHT)
    assert limit(rough, True, thrust) == pytest.approx(tips + tension, rel=1e-9)


@pytest.mark.slow
def test_a_panel_bears_what_its_joints_do():
    """Two courses that slide: a peak between both limits, then friction alone.

    Slow waves are left when it slides: found are 0.975 to 0.995 of it, by the last digits.
    """
    panel = PANELS[1]._replace(width=2, courses=2, slip=0.1e-3, end=0.5e-3)
    found = push(panel, 1)
    broken, sound = (limit(panel, is_sound, found.thrust[-1]) for is_sound in (False, True))
    assert 1.1 * broken < found.load.max() < sound
    assert found.residual == pytest.approx(found.sliding, rel=0.04)
    assert abs(found.closure) < 1e-6
