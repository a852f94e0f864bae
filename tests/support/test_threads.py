# SPDX-License-Identifier: LGPL-3.0-or-later
"""Threads that a user asks for."""

import os
import subprocess
import sys

import pytest

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
