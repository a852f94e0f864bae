# SPDX-License-Identifier: LGPL-3.0-or-later
"""Round bodies on a rigid plane against Hertz, Cattaneo and Mindlin (`benchmarks/hertz.py`)."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import hertz  # noqa: E402


@pytest.fixture(scope="module")
def slipping():
    """Partial slip on 24 elements in a: its steps, and the run after the last."""
    return hertz.partial_slip(24)


@pytest.mark.slow
def test_line_contact_converges_to_hertz():
    """a and p0 within 1 % on 8 elements in a; pressures of first order, a of second."""
    errors = {n: hertz.normal_errors(2, n)[0] for n in (4, 8, 16)}
    for name, bound in (("a", 1e-2), ("a2", 1e-2), ("p0", 2e-3), ("profile", 3e-2)):
        assert errors[8][name] < bound, name
    for name, least, most in (("profile", 0.7, 1.3), ("a", 1.6, 2.6), ("a2", 1.6, 2.6)):
        assert least < hertz.rate(4, 16, errors[4][name], errors[16][name]) < most, name


@pytest.mark.slow
def test_point_contact_is_hertz():
    """a and p0 within 2 % on 4 elements in a, and P like d^(3/2), within 4 % in a coarse body."""
    errors, last = hertz.normal_errors(3, 4, even=1.25, growth=2.0)
    for name, bound in (("a2", 2e-2), ("p0", 2e-2), ("law", 4e-2)):
        assert errors[name] < bound, name
    assert errors["exponent"] == pytest.approx(1.5, abs=0.04)
    # the pressure is that of a body of revolution: mirrored about x = y
    by_place = {
        tuple(np.round(x / hertz.HALF_WIDTH, 6)): p for x, p in zip(last.x, last.p, strict=True)
    }
    for (x, y), p in by_place.items():
        assert by_place[y, x] == pytest.approx(p, abs=1e-5 * last.p.max())


@pytest.mark.slow
def test_stick_zone_is_that_of_cattaneo_and_mindlin(slipping):
    """c within 2 % of a sqrt(1 - Q / (mu P)) at every load, nodes that stick to an element."""
    steps = [s for s in slipping[0] if s.share > 0.2]
    shares = [s.share for s in steps]
    assert len(steps) >= 6 and 0.7 < max(shares) < 0.9 and np.all(np.diff(shares) > 0.0)
    element = hertz.HALF_WIDTH / 24
    for s in steps:
        assert s.c == pytest.approx(s.c_exact, rel=2e-2)
        assert s.height == pytest.approx(1.0, abs=1e-2)
        assert s.c_status == pytest.approx(s.c_exact, abs=1.01 * element)
    assert hertz.slip_errors(steps)["profile"] < 2e-2


def test_contact_is_in_balance_with_the_top(slipping):
    """What the nodes bear is what the top gives; nodes that slip bear mu p, the others less."""
    _, simulation = slipping
    now = hertz.reading(simulation)
    given = simulation.reaction(hertz.TOP)
    np.testing.assert_allclose([now.drag, -now.force], given, rtol=1e-6)
    slides = (now.p > 0.0) & ~now.sticks
    assert np.count_nonzero(slides) > 10
    np.testing.assert_allclose(now.q[slides], hertz.FRICTION * now.p[slides], rtol=1e-6)
    bound = hertz.FRICTION * now.p[now.sticks]
    assert np.all(np.abs(now.q[now.sticks]) < bound)


@pytest.mark.slow
def test_one_system_finds_the_same_slip(monkeypatch):
    """Bulk and contacts in one system, whose iterations alone go round in circles here."""
    coarse = hertz.partial_slip(6, pressing=3)[0]
    made = partial(hertz.Simulation, solver="monolithic", max_halvings=0)
    monkeypatch.setattr(hertz, "Simulation", made)
    found = hertz.partial_slip(6, pressing=3)[0]
    for one, other in zip(found, coarse, strict=True):
        assert one.share == pytest.approx(other.share, rel=1e-5)
        np.testing.assert_allclose(one.q, other.q, atol=1e-4 * one.p0)
