# SPDX-License-Identifier: LGPL-3.0-or-later
"""The end of an explicit step in one pass is what its equations say, array by array."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from test_cell_forces import bulk_of, uneven

from xper_fx.bulk.cell_forces import CellForces
from xper_fx.bulk.state import State
from xper_fx.bulk.step_by_cell import StepByCell
from xper_fx.materials import LinearElastic
from xper_fx.support import threads

STEP = 0.3


def ended(dim, cells=7):
    """What a pass gives of vectors at random, the bulk, and these vectors."""
    bulk = bulk_of(uneven(dim, cells), LinearElastic(100.0, 0.3, 1.0))
    rng = np.random.default_rng(4)
    q0, v0, v1, halfway = rng.standard_normal((4, bulk.num_dofs))
    forces = CellForces.of(bulk.stiffness, bulk.forms.V)
    state = SimpleNamespace(displacement=q0, velocity=v0)
    mass, w = rng.random((2, bulk.num_dofs))
    end = StepByCell(forces, mass, w).end(state, v1, halfway, STEP, bulk.num_dofs + dim)
    return end, bulk, (q0, v0, v1, halfway, mass, w)


@pytest.mark.parametrize("dim", [2, 3])
def test_one_pass_is_the_equations(dim):
    """Of cells whose number is no multiple of those that are ended together."""
    cells = {2: 7, 3: 3}[dim]
    end, bulk, (q0, v0, v1, halfway, mass, w) = ended(dim, cells)
    q1 = q0 + 0.5 * STEP * (v0 + v1)
    ahead = bulk.stiffness.to_scipy() @ (q1 + 0.5 * STEP * v1)
    internal = 0.5 * (halfway + ahead)
    size = np.abs(ahead).max()
    np.testing.assert_allclose(end.displacement, q1, atol=1e-14 * np.abs(q1).max())
    np.testing.assert_allclose(end.ahead, ahead, atol=1e-12 * size)
    of_end = State(STEP, end.displacement, v1, end.forces)
    np.testing.assert_allclose(of_end.internal, internal, atol=1e-12 * size)
    assert of_end.internal is of_end.internal and len(end.free) == bulk.num_dofs + dim
    free = v1 - STEP * w * ahead
    np.testing.assert_allclose(end.free[:-dim], free, atol=1e-12 * np.abs(free).max())
    assert end.power == pytest.approx(v1 @ (internal - halfway), rel=1e-11)
    assert end.held == pytest.approx((0.5 * mass @ v1**2, 0.5 * q1 @ internal), rel=1e-11)


def test_threads_change_no_bit(monkeypatch):
    one, *_ = ended(2, 12)
    monkeypatch.setattr(threads, "_MANY", 10)
    monkeypatch.setattr(threads, "get_num_threads", lambda: 3)
    assert threads.num_ranges(288) == 3
    several, *_ = ended(2, 12)
    for a, b in zip(one[:-1], several[:-1], strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(one.free[:-2], several.free[:-2])
