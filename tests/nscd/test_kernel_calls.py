# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels that are called by their address."""

import sys
from typing import NamedTuple

import numpy as np
import pytest

from xper_fx.cache import njit
from xper_fx.cache.content import digest
from xper_fx.nscd.kernel_calls import _bind, bind_calls, make_call
from xper_fx.nscd.kernel_options import LEAN_ENTRY, LEAN_INNER


class Inner(NamedTuple):
    flags: np.ndarray
    missing: None
    factors: np.ndarray


@njit(**LEAN_INNER)
def scale(values, given, factor, twice):
    for i in range(len(values)):
        if given.flags[i]:
            values[i] *= factor * given.factors[i, 1]
            if twice:
                values[i] *= factor


@njit(**LEAN_INNER)
def shift(values, by):
    values += by


@njit(**LEAN_INNER)
def first_of(arrays):
    arrays[0][0] = 1.0


@njit(**LEAN_ENTRY)
def all_of(calls):
    for number in range(len(calls)):
        make_call(calls, number)


def test_calls_of_different_kernels_run_in_one_loop():
    values, other = np.array([1.0, 2.0, 3.0]), np.zeros(2)
    factors = np.array([[9.0, 1.0], [9.0, 2.0], [9.0, 3.0]])
    given = Inner(np.array([True, False, True]), None, factors)
    arguments = [(values, given, 2.0, True), (other, 5)]
    calls = bind_calls([scale, shift], arguments)
    all_of(calls)
    assert values.tolist() == [4.0, 2.0, 36.0]
    assert other.tolist() == [5.0, 5.0]
    # what the arrays hold then counts, not what they held before
    factors[:, 1], given.flags[1] = 0.5, True
    make_call(calls, 0)
    assert values.tolist() == [8.0, 4.0, 72.0]


def test_a_loop_is_compiled_once_for_all_kernels():
    @njit(**LEAN_INNER)
    def negate(values, _):
        for i in range(len(values)):
            values[i] = -values[i]

    values = np.arange(3.0)
    all_of(bind_calls([shift], [(values, 1.0)]))
    signatures = list(all_of.signatures)
    all_of(bind_calls([negate, shift], [(values, (1, 2.0)), (values, 1)]))
    assert all_of.signatures == signatures
    assert values.tolist() == [0.0, -1.0, -2.0]


def test_references_of_the_arrays_are_not_counted():
    values = np.zeros(1)
    before = sys.getrefcount(values)
    calls = bind_calls([shift], [(values, 1.0)])
    # the owner of an array that is passed lives as long as the call that binds it
    assert calls[0, 1:3].tolist() == [0, 0]
    assert calls[0, 5] == values.ctypes.data
    for _ in range(100):
        all_of(calls)
    assert sys.getrefcount(values) == before
    assert values[0] == 100.0


def test_too_many_arrays_are_refused():
    with pytest.raises(ValueError, match="at most 8192 are foreseen"):
        bind_calls([first_of], [(tuple(np.zeros(1) for _ in range(200)),)])


def test_kernels_that_bind_and_make_calls_have_a_known_content():
    @njit(**LEAN_ENTRY)
    def bind_and_make(call, arguments):
        _bind(shift, arguments, call)
        make_call(call, 0)

    assert len(digest(bind_and_make)) == 64  # else they would be compiled in each process
