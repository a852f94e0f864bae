# SPDX-License-Identifier: LGPL-3.0-or-later
"""A coarse panel: the path goes over its peak and back, and the crack takes the energy it costs."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))

import slow_fracture  # noqa: E402

pytestmark = pytest.mark.demos


@pytest.mark.slow
def test_a_panel_cracks_along_its_path(tmp_path):
    out = tmp_path / "out"
    arguments = f"--facets 30e-3 --displacement 0.5 --out {out}".split()
    time, load, dissipated = slow_fracture.main(arguments)[30e-3].T
    peak = load.argmax()
    # elastic at first; found: 74.4 kN/mm
    assert load[1] / time[1] == pytest.approx(74.4, rel=0.02)
    assert 8.0 < load[peak] < 11.0
    assert 0.12 < time[peak] < 0.2
    assert time[-1] == pytest.approx(0.5, rel=0.02) and load[-1] < 0.5 * load[peak]
    assert np.all(np.diff(dissipated) > -1e-9)
    # no more than a crack through the ligament, 250 mm by 100 mm, by facets up to twice its length
    assert 0.3 < dissipated[-1] / (slow_fracture.TOUGHNESS * 0.25 * 0.1) < 2.0
    assert (out / "slow_fracture.png").stat().st_size > 10_000
