# SPDX-License-Identifier: LGPL-3.0-or-later
"""A strip peeled at a right angle, small: the elastica's energy release rate is the toughness."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from elastica_peel import TOUGHNESS, peel  # noqa: E402


@pytest.mark.slow
def test_the_load_is_that_of_the_elastica():
    found = peel(np.radians(90.0), facets=40, growth=1.6e-3)
    late = found.grown > 1e-3
    rate = found.release_rate[late]
    assert rate.mean() == pytest.approx(1.0, abs=1e-2)
    assert np.abs(rate - 1.0).max() < 5e-2
    assert np.degrees(found.end[-1]) > 60.0
    assert np.degrees(found.turned.max()) > 10.0
    assert found.load[late].min() > TOUGHNESS  # the end is not yet upright
    assert found.closure < 5e-3
