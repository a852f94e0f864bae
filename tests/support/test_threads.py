# SPDX-License-Identifier: LGPL-3.0-or-later
"""Threads that a user asks for."""

import os
import subprocess
import sys

import numpy as np
import pytest

from xper_fx.support.threads import in_ranges

SWEPT = """
import numpy as np
from numba import prange

from xper_fx.cache import njit
from xper_fx.support.threads import worth_taking


@njit(parallel=True)
def inner(x):
    for i in prange(len(x)):
        x[i] += i


@njit
def outer(x):
    inner(x)


assert worth_taking(1, 1, asked=2) == 2
x = np.zeros(1000)
outer(x)
print(x.sum(), sum(outer.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_threads_are_there_for_a_kept_kernel_that_calls_one_with_threads(tmp_path):
    """Numba starts them where it compiles; the second process compiles nothing."""
    script = tmp_path / "swept.py"
    script.write_text(SWEPT)
    environment = os.environ | {"XPER_FX_CACHE": str(tmp_path / "kept")}
    for hits in range(2):
        run = subprocess.run(
            [sys.executable, script], env=environment, text=True, capture_output=True, check=False
        )
        assert (run.returncode, run.stdout) == (0, f"499500.0 {hits}\n"), run.stderr


@pytest.mark.parametrize("ranges", [1, 2, 5])
def test_ranges_have_work_space_of_their_own(ranges):
    """As many ranges as there are spaces, in order, together all items."""

    def work(first, last, squares, space):
        for i in range(first, last):
            space.append(i)
            squares[i] = i * i
        return first, last

    squares, spaces = np.zeros(13), [[] for _ in range(ranges)]
    ends = in_ranges(work, 13, squares, spaces=spaces)
    assert [list(range(first, last)) for first, last in ends] == spaces
    assert sum(spaces, []) == list(range(13))
    np.testing.assert_array_equal(squares, np.arange(13) ** 2)
