# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the tests share the cores: two processes of one thread each, unless a test asks for more.

A file's tests run in one process (`--dist loadfile`): what one has compiled serves the next.
"""

import os

import numba

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
numba.set_num_threads(1)
