# SPDX-License-Identifier: LGPL-3.0-or-later
"""The shape of the package: few rooms, no two files of one name, no class or function too long.

    ./fenicsx python3 tests/project/test_house.py [PACKAGE]

prints the counts.
"""

import ast
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "xper_fx"


class Counts(NamedTuple):
    """Of a package; kernels, and functions that make kernels, may be long.

    `many_parameters` counts the functions of more than eight, kernels among them.
    """

    entries: int
    files: int
    lines: int
    same_names: tuple[str, ...]
    longest_class: tuple[int, str]
    longest_function: tuple[int, str]
    many_parameters: int


def is_compiled(function: ast.FunctionDef) -> bool:
    """Whether a function is a kernel or makes kernels."""
    inner = any(isinstance(n, ast.FunctionDef) for n in ast.walk(function) if n is not function)
    return inner or any("njit" in ast.unparse(d) or "KERNEL" in ast.unparse(d)
                        for d in function.decorator_list)  # fmt: skip


def length(node: ast.ClassDef | ast.FunctionDef) -> int:
    """Lines of a class or function."""
    return node.end_lineno - node.lineno + 1


def parameters(function: ast.FunctionDef) -> int:
    """Parameters of a function, `self` left out."""
    names = [a.arg for a in (*function.args.args, *function.args.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def counts(package: Path) -> Counts:
    """What the files of a package add up to."""
    entries = [p for p in package.iterdir() if p.name not in ("py.typed", "__pycache__")]
    files = sorted(package.rglob("*.py"))
    names = Counter(p.stem for p in files if not p.stem.startswith("__"))
    classes, functions, many = [], [], 0
    for file in files:
        compiled = set()
        for node in ast.walk(ast.parse(file.read_text())):
            if not isinstance(node, ast.ClassDef | ast.FunctionDef):
                continue
            where = f"{file.relative_to(package)}:{node.name}"
            many += isinstance(node, ast.FunctionDef) and parameters(node) > 8
            if isinstance(node, ast.ClassDef):
                classes.append((length(node), where))
            elif node not in compiled:
                if is_compiled(node):
                    compiled |= {n for n in ast.walk(node) if isinstance(n, ast.FunctionDef)}
                else:
                    functions.append((length(node), where))
    return Counts(
        len(entries),
        len(files),
        sum(len(p.read_text().splitlines()) for p in files),
        tuple(sorted(name for name, n in names.items() if n > 1)),
        max(classes),
        max(functions),
        many,
    )


@pytest.fixture(scope="module")
def here() -> Counts:
    return counts(PACKAGE)


def test_few_rooms_each_with_a_first_line(here):
    assert here.entries <= 15
    for room in (p for p in PACKAGE.iterdir() if p.is_dir() and p.name != "__pycache__"):
        first = (room / "__init__.py").read_text().splitlines()[1]
        assert first.startswith('"""') and len(first) > 20, room


def test_a_file_name_occurs_once(here):
    assert here.same_names == ()


def test_nothing_is_too_long(here):
    assert here.longest_class[0] <= 370, here.longest_class
    assert here.longest_function[0] <= 145, here.longest_function


def test_few_functions_have_many_parameters(here):
    """Half are steps of laws; elsewhere what belongs together is handed over as a record."""
    assert here.many_parameters <= 54


def test_no_module_is_found_through_the_interpreter():
    """State stands in objects; `sys.modules` is for what reads kernels, or imports."""
    users = [p for p in PACKAGE.rglob("*.py") if "sys.modules" in p.read_text()]
    assert sorted(p.name for p in users) == ["content.py", "lazy.py"]


if __name__ == "__main__":
    for name, value in counts(Path(*sys.argv[1:2]) if sys.argv[1:] else PACKAGE)._asdict().items():
        print(f"{name:20s} {value}")
