# SPDX-License-Identifier: LGPL-3.0-or-later
"""A stretching bar breaks into pieces of the published mean sizes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import bar_fragmentation  # noqa: E402
from bar_fragmentation import RATE, SIZE, TIME, Bar, fragment  # noqa: E402

RATES = (1e4, 1e5, 1e6)


@pytest.fixture(scope="module")
def runs():
    """Bars of 1000 cells, 9 to 11 in a piece."""
    return [(bar, fragment(bar)) for bar in (Bar(rate, 1000, 0.02, seed=3) for rate in RATES)]


def test_scales_and_formulas_give_the_known_numbers():
    """s0, t0, e0, and mean sizes in um at the three rates."""
    assert 1e6 * SIZE == pytest.approx(305.6, rel=3e-4)
    assert 1e9 * TIME == pytest.approx(30.6, rel=3e-3)
    assert RATE == pytest.approx(3.57e4, rel=1e-3)
    known = ((470.0, 138.3, 32.4), (378.0, 100.5, 20.1), (596.0, 339.0, 90.6), (2059, 444, 95.6))
    x = np.array(RATES) / RATE
    for formula, sizes in zip(bar_fragmentation.PUBLISHED.values(), known, strict=True):
        np.testing.assert_allclose(1e6 * SIZE * formula(x), sizes, rtol=2e-3)


@pytest.mark.slow
def test_mean_sizes_are_those_published(runs):
    """Within 15 % of one fit; the other is for bars of smaller pieces."""
    for bar, pieces in runs:
        x = bar.rate / RATE
        assert pieces.mean / SIZE == pytest.approx(bar_fragmentation.zhou_b(x), rel=0.15)
        assert pieces.mean / SIZE > 1.15 * bar_fragmentation.zhou_a(x)


def test_a_homogeneous_bar_breaks_into_smaller_pieces(runs):
    bar, pieces = runs[1]
    even = fragment(bar._replace(scatter=1e-6))
    uneven = fragment(bar._replace(scatter=0.3))
    assert even.mean < 0.85 * pieces.mean < 0.85 * 0.95 * uneven.mean
    x = bar.rate / RATE
    assert even.mean / SIZE == pytest.approx(bar_fragmentation.zhou_a(x), rel=0.25)


def test_pieces_add_up_and_each_crack_spends_its_energy(runs):
    for bar, pieces in runs:
        assert pieces.size.sum() == pytest.approx(bar.length, rel=1e-12)
        cells = pieces.size / bar.cell
        np.testing.assert_allclose(cells, np.round(cells), atol=1e-6)
        # One crack between each two pieces; what is spent is that of bonds, broken or not.
        assert np.count_nonzero(pieces.spent > 0.99) == len(pieces.size) - 1
        assert pieces.dissipated == pytest.approx(pieces.spent.sum(), rel=1e-6)
        assert abs(pieces.closure) < 1e-8


def test_sizes_scatter_less_than_rayleighs(runs):
    """Their deviation is 0.3 to 0.4 of the mean, and that of Rayleigh's distribution 0.52."""
    sizes = np.concatenate([pieces.size / pieces.mean for _, pieces in runs])
    assert 0.27 < sizes.std() < 0.45
    grid = np.linspace(0.0, 10.0, 10_001)
    mean = np.trapezoid(1.0 - bar_fragmentation.rayleigh(grid), grid)
    assert mean == pytest.approx(1.0, rel=1e-6)


def test_the_run_ends_when_no_piece_has_broken_for_a_while(runs):
    for bar, pieces in runs:
        peak = bar_fragmentation.STRENGTH / (bar_fragmentation.YOUNG * bar.rate)
        assert pieces.time > peak
        assert pieces.end - pieces.time >= (bar_fragmentation.STILL - 1e-6) * TIME
