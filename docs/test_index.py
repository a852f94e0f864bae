# SPDX-License-Identifier: LGPL-3.0-or-later
"""The page that lists every test file with what it says of itself."""

import ast
import re
from pathlib import Path

_INTRODUCTION = """# All tests

What each file of `tests/` checks, in its own words, and its tests that say more than their name.
`./fenicsx pytest` runs them all, `./fenicsx pytest FILE` one.

"""
_GROUPS = {
    "study": "Studies",
    "output": "Output, restart, effects",
    "simulation": "Time loop, energies, accuracy",
    "plotting": "Figures",
    "scene": "Scenes",
    "parallel": "Several ranks",
    "periodic": "Periodic cells",
    "bulk": "Bulk",
    "forms": "Forms",
    "materials": "Materials",
    "bodies": "Bodies and meshes",
    "nscd": "The interaction layer",
    "support": "Support",
    "cache": "Kept kernels",
    "demos": "Demos",
    "published": "Published problems",
    "hard_cases": "Hard cases",
    "project": "The project: documentation, imports, launcher",
}


def first_paragraph(node: ast.Module | ast.FunctionDef) -> str:
    """The first paragraph of a docstring, on one line, such that no character is markup."""
    text = " ".join((ast.get_docstring(node) or "").split("\n\n")[0].split())
    return re.sub(r"([*_|<>])", r"\\\1", text)


def entry(path: Path, root: Path) -> str:
    """A test file and its tests as a list."""
    module = ast.parse(path.read_text())
    text = f"`{path.relative_to(root)}`\n: {first_paragraph(module)}\n"
    for node in module.body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            what = first_paragraph(node)
            text += f"\n  - `{node.name}`: {what}" if what else ""
    return text + "\n\n"


def write_test_index(tests: Path, page: Path) -> None:
    """Write the page.

    Args:
        tests: folder of the tests.
        page: Markdown file to write.
    """
    text = _INTRODUCTION
    for folder, title in _GROUPS.items():
        text += f"## {title}\n\n"
        for path in sorted((tests / folder).glob("test_*.py")):
            text += entry(path, tests.parent)
    if not page.exists() or page.read_text() != text:
        page.write_text(text)
