# SPDX-License-Identifier: LGPL-3.0-or-later
"""A rupture on a fault, small: against boundary integrals (`benchmarks/fault_rupture.py`)."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from fault_rupture import (  # noqa: E402
    C_P,
    C_S,
    CASES,
    LAMBDA,
    by_elements,
    by_integrals,
    compare,
    kernel,
    rayleigh_speed,
)


def test_the_kernel_is_that_of_the_rayleigh_function():
    """Laplace transforms at three points; at p = 0 statics, 2 (1 - c_s^2 / c_p^2)."""
    t, square = np.linspace(0.0, 300.0, 300_001), (C_S / C_P) ** 2
    values = kernel(t)
    for p in (0.1, 1.0, 3.0):
        s, d = np.sqrt(1.0 + p**2), np.sqrt(1.0 + p**2 * square)
        exact = ((2.0 + p**2) ** 2 - 4.0 * d * s) / (p**2 * s) - p
        assert np.trapezoid(values * np.exp(-p * t), t) == pytest.approx(exact, rel=1e-5)
    assert rayleigh_speed() == pytest.approx(0.9194 * C_S, rel=1e-3)  # of nu = 1/4


@pytest.mark.slow
def test_ruptures_run_as_boundary_integrals_have_them():
    """Six facets in the cohesive zone; found within 1.1 to 2.6 %, and 1e-10 in the energy."""
    case = CASES[0.5]._replace(reach=6.0, time=7.0)
    reference = by_integrals(case, 12)
    found, balance = by_elements(case, 6)
    errors = compare(found, reference, case)
    assert len(errors) == 8 and np.abs(errors).max() < 0.04
    assert found.speed(4.5 * LAMBDA, 5.5 * LAMBDA) > np.sqrt(2.0) * C_S
    assert balance.lost == pytest.approx(1.0, abs=1e-8)
    assert balance.fracture > 0.02
    assert abs(balance.closure) < 1e-12
