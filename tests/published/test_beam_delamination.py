# SPDX-License-Identifier: LGPL-3.0-or-later
"""Delamination of beams, small: against beam theory, and w for each length of crack."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from beam_delamination import DCB, ENF, compare, delaminate


@pytest.mark.parametrize("beam", [DCB, ENF], ids=lambda b: b.kind)
def test_beam_theory_is_its_own_inverse(beam):
    """A compliance gives its crack back, and G = P^2 / 2 dC/da."""
    for crack in (beam.crack, 1.3 * beam.crack):
        assert beam.crack_of(beam.compliance(crack)) == pytest.approx(crack, rel=1e-12)
        slope = (beam.compliance(crack * 1.0001) - beam.compliance(crack * 0.9999)) / (2e-4 * crack)
        assert beam.release_rate(7.0, crack) == pytest.approx(24.5 * slope, rel=1e-7)


@pytest.mark.slow
def test_double_cantilever():
    """A short one, five facets to an arm's height.

    Found: peak 0.3 % below the load of beam theory at twice as many facets (`benchmarks/`).
    """
    beam = replace(
        DCB, crack=15e-3, growth=4e-3, displacement=1.0e-3, time=2e-3, steps=400, facet=0.3e-3
    )
    found = compare(beam, delaminate(beam))
    assert found.zone > 2.0
    assert found.compliance == pytest.approx(1.0, abs=0.03)
    assert found.peak == pytest.approx(1.0, abs=0.03)
    assert found.release_rate == pytest.approx(1.0, abs=0.03)
    assert found.spent == pytest.approx(1.0, abs=2e-3)
    assert abs(found.closure) < 1e-8
