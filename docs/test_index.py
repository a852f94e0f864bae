# SPDX-License-Identifier: LGPL-3.0-or-later
"""The page that lists every test file with what it says of itself."""

import ast
from pathlib import Path

_INTRODUCTION = """# All test files

What each file of `tests/` checks, in its own words. `./fenicsx pytest` runs them all,
`./fenicsx pytest FILE` one.

"""
_GROUPS = {
    "": "The package",
    "nscd": "The interaction layer, without FEniCSx",
    "hard_cases": "Hard cases",
}


def first_paragraph(path: Path) -> str:
    """The first paragraph of a module's docstring, on one line."""
    text = ast.get_docstring(ast.parse(path.read_text())) or ""
    return " ".join(text.split("\n\n")[0].split())


def write_test_index(tests: Path, page: Path) -> None:
    """Write the page.

    Args:
        tests: folder of the tests.
        page: Markdown file to write.
    """
    text = _INTRODUCTION
    for folder, title in _GROUPS.items():
        text += f"## {title}\n\n| file | what it checks |\n|---|---|\n"
        for path in sorted((tests / folder).glob("test_*.py")):
            what = first_paragraph(path).replace("|", r"\|")
            text += f"| `{path.relative_to(tests.parent)}` | {what} |\n"
        text += "\n"
    if not page.exists() or page.read_text() != text:
        page.write_text(text)
