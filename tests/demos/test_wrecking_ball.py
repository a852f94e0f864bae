# SPDX-License-Identifier: LGPL-3.0-or-later
"""The demo of the wrecking ball: the plain column comes apart, the post-tensioned one rocks."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
import wrecking_ball as demo

pytestmark = pytest.mark.demos


def test_columns_and_files(tmp_path):
    plain, tied = demo.main(f"--step 4e-3 --end 1.5 --quiet --out {tmp_path}".split())
    assert plain.lean[-1] > 1.5 * demo.WIDTH
    assert np.abs(tied.lean).max() < 0.7 * demo.WIDTH
    struck = np.flatnonzero(tied.lean > 1e-3)[0]
    np.testing.assert_allclose(tied.tension[: struck - 1], tied.prestress, rtol=1e-3)
    assert tied.tension.max() > 1.5 * tied.prestress and not plain.tension.any()
    # at rest on a straight chain the hinge bears the weight along it, in the first steps
    held = (demo.MASS + 12 * 7800.0 * 0.04 * 0.2125) * demo.GRAVITY * np.cos(demo.ANGLE)
    assert plain.pull[0] == pytest.approx(held, rel=0.05)
    assert max(plain.closure, tied.closure) < 1e-10
    assert (tmp_path / "wrecking_ball.png").stat().st_size > 10_000
    assert len(json.loads((tmp_path / "summary.json").read_text())) == 2
