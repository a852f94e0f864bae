# SPDX-License-Identifier: LGPL-3.0-or-later
"""A crack at an interface, small: the ratio of energies, and what a crack chooses."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import deflection_or_penetration as crack  # noqa: E402


@pytest.mark.slow
def test_the_ratio_of_energies_tends_to_the_published_one():
    sizes = np.array([300.0, 1200.0, 4800.0])
    ratios = [crack.ratio_of_rates(size, 3, around=2, growth=1.8) for size in sizes]
    assert np.all(np.diff(ratios) > 0.01) and ratios[-1] < 0.25
    assert crack.limit(3.0 / sizes, np.array(ratios)) == pytest.approx(crack.PUBLISHED, abs=0.01)


@pytest.mark.slow
def test_the_crack_turns_along_what_is_weak_enough():
    """A quarter of the toughness, where energies leave the choice open: strength decides."""
    small = {"size": 1200.0, "fine": 10, "zone": 4.0, "far": 3.0}
    assert [crack.turns(0.25, strength, **small) for strength in (0.15, 0.4)] == [True, False]
