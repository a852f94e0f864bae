# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the tests share the cores: two processes of one thread each, unless a test asks for more."""

import os

import numba
import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
numba.set_num_threads(1)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Tests that share what is made once a module run in one process, so that it is made once."""
    for item in items:
        fixtures = item._fixtureinfo.name2fixturedefs.values()
        if any(last.scope == "module" for *_, last in fixtures):
            item.add_marker(pytest.mark.xdist_group(item.module.__name__))
