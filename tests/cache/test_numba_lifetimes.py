# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numba looks where variables live when it needs it, and finds what it found before."""

import numba
import numpy as np
from numba import literal_unroll
from numba.core import analysis

import xper_fx.cache  # noqa: F401 - from here on it looks when it needs it


def test_it_looks_for_each_del_alone(monkeypatch):
    looked = []
    find = analysis.compute_dead_maps
    monkeypatch.setattr(analysis, "compute_dead_maps", lambda *a: looked.append(a) or find(*a))

    @numba.njit
    def sums(x, y):
        for i in range(len(x)):
            y[i] = x[:i].sum() if x[i] > 0.0 else 0.0

    y = np.zeros(3)
    sums(np.array([1.0, -2.0, 3.0]), y)
    np.testing.assert_array_equal(y, [0.0, 0.0, -1.0])
    assert len(looked) <= 9  # 27 where each pass looks


def test_what_yields_keeps_its_variables():
    @numba.njit
    def steps(count):
        left, before = count, 0
        while left > 0:
            yield before + left
            before, left = left, left - 1

    @numba.njit
    def total(count):
        out = 0
        for value in steps(count):
            out += value
        return out

    assert total(4) == 4 + 7 + 5 + 3


def test_objects_of_python_and_their_loops():
    """Object mode asks for what lives where a block begins; a loop is compiled by itself there."""

    @numba.jit(forceobj=True, looplift=True)
    def described(values):
        total = 0.0
        for value in values:
            total += value
        return {"total": total, "least": min(list(values), default=None)}

    assert described(np.array([3.0, 1.0])) == {"total": 4.0, "least": 1.0}
    assert described(np.array([])) == {"total": 0.0, "least": None}


def test_loops_over_tuples_of_several_types():
    """What they change lives on after them."""

    @numba.njit
    def by_value(x):
        out, last = 0.0, 0.0
        for part in literal_unroll((1, 2.5, x)):
            last = part
            if last > 1.0:
                out += last
        return out, last

    @numba.njit
    def by_number(x):
        out, last = 0.0, 0.0
        parts = (1, 2.5, x)
        for i in range(len(literal_unroll(parts))):
            last = parts[i]
            if last > 1.0:
                out += last
        return out, last

    for total in (by_value, by_number):
        assert total(np.float32(4.0)) == (6.5, 4.0)


def test_what_lives_after_a_block_in_object_mode():
    @numba.njit
    def described(x):
        total, last = 0.0, 0.0
        for i in range(len(x)):
            last = x[i]
            with numba.objmode(part="float64"):
                part = round(last, 1)
            with numba.objmode(twice="float64"):
                twice = 2.0 * part + last
            total += twice
        return total, last, part

    assert described(np.array([0.26, 0.52])) == (2.0 * 0.8 + 0.78, 0.52, 0.5)
