# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs the hard cases and prints what each demands and what was found, as a Markdown table.

./fenicsx python3 benchmarks/hard_cases.py
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

CASES = Path(__file__).parent.parent / "tests" / "hard_cases"


def figures(report: Path) -> list[tuple[str, str, float, bool]]:
    """Case, demand, figure found and whether its test passed, from a JUnit report, by file."""
    rows = []
    tests = ElementTree.parse(report).iter("testcase")
    for test in sorted(tests, key=lambda test: test.get("classname")):
        passed = test.find("failure") is None and test.find("error") is None
        for item in test.iterfind("properties/property[@name='figure']"):
            rows.append((*json.loads(item.get("value")), passed))
    return rows


def table(rows: list[tuple[str, str, float, bool]]) -> str:
    """The figures as Markdown."""
    lines = ["| case | demanded | found | |", "|---|---|---|---|"]
    for case, demand, found, passed in rows:
        case, demand = case.replace("|", r"\|"), demand.replace("|", r"\|")
        lines.append(f"| {case} | {demand} | {found:.2g} | {'' if passed else 'FAILED'} |")
    return "\n".join(lines)


def main() -> int:
    """Run, write, and return pytest's exit status."""
    parser = argparse.ArgumentParser(description="Hard cases and their figures.")
    parser.add_argument("--output", type=Path, help="file for the table (default: print it)")
    output = parser.parse_args().output
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "hard_cases.xml"
        junit = [f"--junitxml={report}", "-o", "junit_family=xunit1"]
        status = pytest.main([str(CASES), "-q", *junit])
        text = table(figures(report))
    if output is None:
        print(text)
    else:
        output.write_text(f"# Hard cases\n\n`benchmarks/hard_cases.py` wrote this.\n\n{text}\n")
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
