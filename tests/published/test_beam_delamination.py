# SPDX-License-Identifier: LGPL-3.0-or-later
"""Delamination of beams, small: against beam theory, J and w for each length of crack."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from beam_delamination import DCB, ENF, MMB, compare, delaminate


@pytest.mark.parametrize("beam", [DCB, ENF, MMB], ids=lambda b: b.kind)
def test_beam_theory_is_its_own_inverse(beam):
    """A compliance gives its crack back, and G = P^2 / 2 dC/da."""
    for crack in (beam.crack, 1.3 * beam.crack):
        assert beam.crack_of(beam.compliance(crack)) == pytest.approx(crack, rel=1e-12)
        slope = (beam.compliance(crack * 1.0001) - beam.compliance(crack * 0.9999)) / (2e-4 * crack)
        assert beam.release_rate(7.0, crack) == pytest.approx(24.5 * slope, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("beam", "peak", "share"),
    [(replace(DCB, strength=28.5e6), 0.957, 1.0), (ENF, 0.962, 0.0), (MMB, 0.973, 0.507)],
    ids=lambda value: getattr(value, "kind", None),
)
def test_the_crack_takes_its_toughness(beam, peak, share):
    """Facets of half a millimetre, three to four in the cohesive zone.

    The peak is that of the cohesive zone: `benchmarks/` has it for other strengths.
    """
    beam = replace(beam, facet=0.5e-3, growth=6e-3)
    found = compare(beam, delaminate(beam))
    assert found.zone > 3.0
    assert found.share == pytest.approx(share, abs=2e-3)
    assert found.compliance == pytest.approx(1.0, abs=6e-3)
    assert found.peak == pytest.approx(peak, abs=5e-3)
    assert found.started == pytest.approx(1.0, abs=1.5e-2)
    assert found.grown == pytest.approx(1.0, abs=1e-2)
    assert found.rate == pytest.approx(1.0, abs=1e-2)
    assert found.spent == pytest.approx(1.0, abs=3e-3)
    assert abs(found.numerical) < 1e-2
    assert abs(found.closure) < 1e-7
