# SPDX-License-Identifier: LGPL-3.0-or-later
"""Operators are resolved once, and anew when they have got another version."""

import operator

import numba
import numpy as np
import pytest
from numba.core import utils
from numba.extending import overload

import xper_fx.cache  # noqa: F401 - from here on operators are chosen once


def test_an_operator_may_be_given_a_version_later():
    def ask():
        return numba.njit(lambda a, b: a @ b)(0.5, True)

    with pytest.raises(numba.TypingError):
        ask()

    @overload(operator.matmul)
    def _of_number_and_truth(a, b):
        if str((a, b)) == "(float64, bool)":
            return lambda a, b: 3.0

    assert ask() == 3.0


def test_templates_are_tried_once(monkeypatch):
    tried = []
    order = utils.order_by_target_specificity

    def count(target, templates, fnkey=""):
        tried.append(fnkey)
        return order(target, templates, fnkey)

    monkeypatch.setattr(utils, "order_by_target_specificity", count)

    @numba.njit
    def ninth_powers(x, y):
        for i in range(3):
            y[i] = x[i] * x[i] * x[i] * x[i] * x[i] * x[i] * x[i] * x[i] * x[i]

    y = np.zeros(3, np.float32)
    ninth_powers(np.full(3, 2.0, np.float32), y)
    np.testing.assert_array_equal(y, 512.0)
    # by inference and by lowering, in several rounds, it would be some thirty times each
    for chosen in (operator.mul, operator.getitem, operator.setitem):
        assert tried.count(chosen) <= 2, chosen
