# SPDX-License-Identifier: LGPL-3.0-or-later
"""The demo of the masonry arch, small: limit analysis, and dynamics on either side of it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import masonry_arch as demo

pytestmark = pytest.mark.demos


def test_limit_analysis_tends_to_milankovitch():
    """From below: an arch of blocks opens at its joints only."""
    ratios = [demo.least_ratio(n) for n in (8, 30, 100)]
    assert np.all(np.diff(ratios) > 0.0)
    assert ratios[-1] == pytest.approx(demo.MILANKOVITCH, rel=1e-3)
    assert ratios[-1] < demo.MILANKOVITCH


def test_without_enough_friction_no_thickness_stands():
    """At a springing the thrust is steeper than at the crown, where it is horizontal."""
    assert demo.can_stand(demo.Arch(12, 0.2, 0.5))
    assert not demo.can_stand(demo.Arch(12, 0.2, 0.2))


@pytest.mark.parametrize("step", [4e-3, 8e-3])
def test_dynamics_bracket_the_limit_whatever_the_step(step):
    """Half a per cent above it an arch of 12 blocks stays where it is, half a per cent below its
    joints open and it falls: inside at the crown and the springings, outside at the haunches."""
    least = demo.least_ratio(12)
    above = demo.run(demo.Arch(12, 1.005 * least), step)
    assert above.verdict == "stands" and above.time == pytest.approx(demo.END)
    assert above.moved < 1e-3 * least and not above.hinges
    below = demo.run(demo.Arch(12, 0.995 * least), step)
    assert below.verdict == "falls" and below.time < demo.END
    hinges = dict(below.hinges)
    assert hinges[6] == 1
    haunches = sorted(joint for joint, end in hinges.items() if end == 0)
    assert len(haunches) >= 2 and haunches[0] == 12 - haunches[-1]
    assert hinges.get(0, 1) == 1 and hinges.get(12, 1) == 1


def test_the_line_of_thrust_stays_inside():
    """It touches the outside at the crown and the inside at the haunches, nearly, and no more."""
    least = demo.least_ratio(12)
    outcome = demo.run(demo.Arch(12, 1.01 * least), 4e-3)
    radius = np.linalg.norm(outcome.thrust, axis=1)
    assert len(radius) == 13
    half = 0.5 * 1.01 * least
    assert np.all(np.abs(radius - 1.0) < half * (1.0 + 1e-6))
    assert radius.max() - 1.0 > 0.9 * half and 1.0 - radius.min() > 0.9 * half


def test_files(tmp_path):
    """Verdicts and picture of a small run."""
    options = f"--blocks 7 8 --step 8e-3 --quiet --out {tmp_path}"
    result = demo.main(options.split())
    assert [[o.verdict for o in pair] for pair in result["pairs"]] == [["stands", "falls"]] * 2
    assert (tmp_path / "masonry_arch.png").stat().st_size > 10_000
    assert "limit_analysis" in (tmp_path / "summary.json").read_text()
