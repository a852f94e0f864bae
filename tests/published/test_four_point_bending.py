# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bilayer that delaminates in four-point bending, small: load and w of steady cracks."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from four_point_bending import INNER, OUTER, SPECIMENS, delaminate  # noqa: E402


def test_the_steady_load_of_equal_layers():
    """E' of both, h1 = h2 = h: 1 / I2 - 1 / I = (21 / 2) / h^3, so that G = 21 M^2 / (4 E' h^3)."""
    specimen = SPECIMENS["equal layers"]
    moment = specimen.steady_load * (OUTER - INNER)
    rate = 21.0 * moment**2 * (1.0 - 0.3**2) / (4.0 * 200e9 * 1e-9)
    assert rate == pytest.approx(specimen.fracture_energy, rel=1e-12)


@pytest.mark.slow
def test_cracks_run_at_the_steady_load():
    """Facets of a quarter of a millimetre; the load stays while cracks grow from 4 to 5.5 mm."""
    found = delaminate(SPECIMENS["cut layer three times as stiff"], 5.5e-3)
    assert found.plateau == pytest.approx(1.0, abs=1e-2)
    assert found.spread < 5e-3
    # the cracks grow together or one after the other, as rounding decides
    assert found.spent == pytest.approx(1.0, abs=2e-2)
    assert abs(found.closure) < 1e-8
