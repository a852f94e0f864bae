# SPDX-License-Identifier: LGPL-3.0-or-later
"""A kernel that other kernels call is compiled once for all signed integers."""

import numpy as np
import pytest
from numba import types

from xper_fx.cache import kernel_folder, njit


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch):
    """All is compiled here: a kept kernel does not ask those that it calls."""
    monkeypatch.setenv("XPER_FX_CACHE", "off")
    kernel_folder.cache_clear()
    yield
    monkeypatch.undo()
    kernel_folder.cache_clear()


@njit
def third(i, x):
    return x[i] / 3.0


@njit
def sum_of(places, x):
    total, last = 0.0, 0
    for place in places:  # int32
        total += third(place, x)
        last = place + 1
    return total + third(last, x) + third(i=0, x=x)


@njit
def unsigned(x):
    return third(np.uintp(len(x) - 1), x)


def test_one_version_serves_all_signed_integers():
    x = np.arange(3.0, 9.0)
    places = np.array([1, 2], np.int32)
    assert sum_of(places, x) == (x[1] + x[2] + x[3] + x[0]) / 3.0
    assert [arguments[0] for arguments in third.overloads] == [types.int64]


def test_an_unsigned_integer_stays_one():
    """It indexes faster, as it needs no test for being negative."""
    x = np.arange(4.0)
    assert unsigned(x) == 1.0
    assert types.uint64 in [arguments[0] for arguments in third.overloads]
