# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the tests are shared out among processes."""

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Tests that share what is made once a module run in one process, so that it is made once."""
    for item in items:
        fixtures = item._fixtureinfo.name2fixturedefs.values()
        if any(last.scope == "module" for *_, last in fixtures):
            item.add_marker(pytest.mark.xdist_group(item.module.__name__))
