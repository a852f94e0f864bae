# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numba's options are equal where Numba says so."""

import itertools

from numba.core.compiler import Flags
from numba.core.cpu_options import FastMathOptions
from numba.core.targetconfig import Option, TargetConfig

import xper_fx.cache  # noqa: F401 - from here on options are compared at once


class Others(TargetConfig):
    nrt = Option(type=bool, default=False, doc="as one of Flags")


def flags(**given):
    made = Flags()
    for name, value in given.items():
        setattr(made, name, value)
    return made


def test_equal_where_all_values_are():
    made = [
        Flags(), flags(nrt=True), flags(nrt=False), flags(nrt=True, fastmath=FastMathOptions(True)),
        flags(fastmath=FastMathOptions(True)), flags(error_model="numpy"), Others(),
    ]  # fmt: skip
    for a, b in itertools.product(made, made):
        assert (a == b) == (a.values() == b.values())
        if a == b:
            assert hash(a) == hash(b)
    assert len(set(made)) == 6
    assert Flags() != 1
    assert Flags().copy() in {Flags()}
