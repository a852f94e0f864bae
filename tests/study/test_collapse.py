# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equilibria and collapse loads of rigid blocks against those known by hand."""

from __future__ import annotations

import numpy as np
import pytest

import xper_fx as xf

GRAVITY = 9.81


def block_pushed(multiple, width=1.0, height=2.0, friction=0.7, **options):
    """A block on the ground under its weight and a multiple of it to the right."""
    shape = xf.rigid.Polygon.box((width, height))
    block = xf.RigidBody(shape, (0.0, 0.5 * height), "block", density=1000.0, **options)
    ground = xf.rigid.wall((0.0, 0.0), (0.0, 1.0), "ground")
    law = xf.laws.SignoriniCoulomb(friction=friction)
    return xf.Scene(
        rigid=[block, ground], contacts=[xf.Contact(("block", "ground"), law)],
        loads=[xf.Gravity((multiple * GRAVITY, -GRAVITY))],
    )  # fmt: skip


@pytest.mark.parametrize(("friction", "expected"), [(0.7, 0.5), (0.3, 0.3)])
def test_a_block_overturns_or_slides(friction, expected):
    """At width / height or at mu, whichever is less."""
    found = xf.study.collapse_load(lambda a: block_pushed(a, friction=friction), (0.0, 2.0), 1e-5)
    assert found.stands <= expected * (1.0 + 1e-5)
    assert found.falls >= expected * (1.0 - 1e-5)
    assert found.falls - found.stands <= 2e-5


def test_how_a_block_begins_to_fall():
    """It slides by (a - mu) g, or turns about its edge by the moment over I + m r^2."""
    slides = xf.study.equilibrium(block_pushed(0.4, friction=0.3))
    assert not slides.stands
    assert slides.acceleration[0] == pytest.approx([0.1 * GRAVITY, 0.0], abs=1e-6)
    turns = xf.study.equilibrium(block_pushed(0.6))
    moment = GRAVITY * (0.6 * 1.0 - 0.5)
    expected = -moment / ((1.0 + 4.0) / 12.0 + 0.25 + 1.0)
    assert turns.spin[0] == pytest.approx(expected, rel=1e-6)
    stands = xf.study.equilibrium(block_pushed(0.2))
    assert stands.stands
    total = stands.forces.force.sum(axis=0)
    assert np.abs(total) == pytest.approx([2000.0 * 0.2 * GRAVITY, 2000.0 * GRAVITY], rel=1e-6)


def test_what_is_asked_wrongly():
    with pytest.raises(ValueError, match="rigid body 0 moves"):
        xf.study.equilibrium(block_pushed(0.0, velocity=(1.0, 0.0)))
    with pytest.raises(ValueError, match="falls"):
        xf.study.collapse_load(block_pushed, (0.6, 1.0))
    with pytest.raises(ValueError, match="stands"):
        xf.study.collapse_load(block_pushed, (0.0, 0.1))
