# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs the hard cases and prints what each demands and what was found, as a Markdown table.

./fenicsx python3 benchmarks/hard_cases.py
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

CASES = Path(__file__).parent.parent / "tests" / "hard_cases"


def figures(report: Path) -> list[tuple[str, str, float, bool]]:
    """Case, demand, figure found and whether its test passed, from a JUnit report."""
    rows = []
    for test in ElementTree.parse(report).iter("testcase"):
        passed = test.find("failure") is None and test.find("error") is None
        for item in test.iterfind("properties/property[@name='figure']"):
            rows.append((*json.loads(item.get("value")), passed))
    return rows


def main() -> int:
    """Run, print, and return pytest's exit status."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "hard_cases.xml"
        status = pytest.main(
            [str(CASES), "-q", f"--junitxml={report}", "-o", "junit_family=xunit1"]
        )
        rows = figures(report)
    print("\n| case | demanded | found | |\n|---|---|---|---|")
    for case, demand, found, passed in rows:
        print(f"| {case} | {demand} | {found:.2g} | {'' if passed else 'FAILED'} |")
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
