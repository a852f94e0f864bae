# SPDX-License-Identifier: LGPL-3.0-or-later
"""A laminate bent in mixed mode delaminates at the load of theory (`benchmarks/`)."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import mixed_mode_bending as bending  # noqa: E402


def test_the_lever_gives_its_share_of_shear():
    for share in (0.1, 0.2, 0.5, 0.8):
        made = bending.Bending.of(share)
        assert made.share(np.array(bending.CRACK)) == pytest.approx(share, rel=1e-12)
    assert bending.Bending.of(0.0).share(np.array(0.04)) == 0.0
    assert bending.Bending.of(1.0).share(np.array(0.04)) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("share, length", [(0.5, 0.4e-3), (1.0, 0.5e-3)])
def test_it_delaminates_at_the_load_of_theory(share, length):
    found = bending.compare(share, length)
    assert len(found["lefm"]) > 3
    assert np.abs(found["lefm"] - 1.0).max() < 0.01  # found 0.006 and 0.002
    assert np.abs(found["beam"] - 1.0).max() < 0.01  # found 0.007 and 0.006
