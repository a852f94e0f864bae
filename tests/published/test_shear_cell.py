# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane shear of discs against da Cruz et al. (2005) (`benchmarks/shear_cell.py`), a small cell."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import shear_cell  # noqa: E402


@pytest.mark.slow
def test_sheared_discs_follow_the_published_laws(tmp_path):
    """48 discs at I = 0.2, two units of strain after the first.

    The solid fraction is within 0.02 of the law, friction within 0.1, five times the standard error
    of a cell so small and a strain so short; the mean stress is the one asked for, and symmetric.
    """
    flow, simulation = shear_cell.sheared(0.2, 48, 3.0)
    friction, fraction = shear_cell.laws(flow.inertial)
    assert flow.inertial == pytest.approx(0.19, abs=0.02)
    assert flow.friction[0] == pytest.approx(friction, abs=0.1)
    assert flow.fraction[0] == pytest.approx(fraction, abs=0.02)
    assert flow.asymmetry < 0.02
    assert flow.overlap < 0.02
    ledger = simulation.ledger
    assert abs(ledger.closure) < 1e-10 * ledger.energies.external_work
    # work is done by the shear and by the pressure: mu P times the strain, less what is held
    cell = simulation.macroscopic
    assert cell.gradient[0, 1] > 0.8
    assert np.all(simulation.rigid.displayed.position[:, 1] >= 0.0)
    shear_cell.draw(str(tmp_path / "figure.png"), [flow, flow], simulation)
    assert (tmp_path / "figure.png").stat().st_size > 10_000
