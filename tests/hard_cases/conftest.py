# SPDX-License-Identifier: LGPL-3.0-or-later
"""What hard cases record: a figure each, which `benchmarks/hard_cases.py` gathers into a table."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest


@pytest.fixture
def figure(record_property) -> Callable[[str, str, float], None]:
    """Record a figure of a hard case beside its assertion.

    Called as `figure(case, demand, found)`: the case in a few words ("mass ratio 1e6"), what is
    asserted of it ("momentum error < 1e-12"), the value found.
    """

    def record(case: str, demand: str, found: float) -> None:
        record_property("figure", json.dumps([case, demand, float(found)]))

    return record
