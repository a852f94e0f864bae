# SPDX-License-Identifier: LGPL-3.0-or-later
"""The silo of the demo, small: its rate is that of a free-fall arch, its pictures are drawn."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import silo_discharge as demo

pytestmark = pytest.mark.demos


def test_constant_of_the_free_fall_arch():
    """Speeds sqrt(2 g h) below a semicircle over an opening of 1 m, by quadrature."""
    rate, _ = quad(lambda x: np.sqrt(2.0 * np.sqrt(0.25 - x**2)), -0.5, 0.5)
    assert rate == pytest.approx(demo.FREE_FALL_ARCH, abs=5e-4)


def test_fit_finds_the_law_it_was_given():
    openings = 0.01 * np.array([4.0, 6.0, 9.0])
    rates = 0.8 * np.sqrt(demo.GRAVITY) * demo.beverloo(openings, 0.7, 1.3)
    none = np.empty(0)
    pairs = zip(openings, rates, strict=True)
    found = [demo.Discharge(d, none, none, q, 1.0, []) for d, q in pairs]
    law = demo.fit(found, 0.8)
    assert (law["C"], law["k"]) == pytest.approx((0.7, 1.3), rel=1e-5)
    assert law["largest_error"] < 1e-5


def test_a_small_silo(tmp_path):
    options = "--discs 80 --width 12 --openings 4 6 --share 0.3 --film --quiet"
    result = demo.main([*options.split(), "--out", str(tmp_path)])
    assert 0.72 < result["law"]["phi"] < 0.86
    for one in result["found"]:
        t, left, start = one.times, one.left, len(one.times) // 4
        assert np.all(np.diff(left) >= 0.0) and len(one.frames) == 3
        mean = (left[-1] - left[start]) / (t[-1] - t[start])
        assert one.rate == pytest.approx(mean, rel=0.3)
    np.testing.assert_allclose(result["law"]["over_free_fall"], 1.0, atol=0.45)
    slow, fast = (one.rate for one in result["found"])
    assert 1.3 < fast / slow < 3.3  # (5 / 3)^1.5 = 2.15
    # three of ten of 80 grains have left
    area = 0.25 * np.pi * demo.DIAMETER**2
    assert result["found"][0].left[-1] == pytest.approx(24 * area, rel=0.1)
    assert json.loads((tmp_path / "summary.json").read_text())["phi"] == result["law"]["phi"]
    for name in ("frames.png", "rates.png", "silo.gif"):
        assert (tmp_path / name).stat().st_size > 10_000
