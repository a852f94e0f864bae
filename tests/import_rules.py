# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which room of the package may import which, and a check that imports run one way.

    ./fenicsx python3 tests/import_rules.py

All imports count: those inside functions, those for types alone, `import_module("...")`, and the
tables of `xper_fx.support.lazy.importer`. That a module brings its packages along (`a.b` imports
`a`) does not count.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

# ------------------------------------------------------------------------------------- the table

# From top to ground. A room may import the rooms below its floor; rooms of one floor do not import
# each other. A room is named with its modules, packages with all that no other room names.
FLOORS: tuple[dict[str, str], ...] = (
    {"door": ""},  # the package's own `__init__`
    {"study": "study"},
    {"output": "output"},
    {"plotting": "plotting", "simulation": "simulation"},
    {"scene": "scene"},
    {"parallel": "parallel", "periodic": "periodic"},
    {"bulk": "bulk"},
    {"forms": "forms"},
    {"materials": "materials", "bodies": "bodies"},
    {"nscd": "nscd"},
    {"support": "support", "DOLFINx": "support.compat", "ranks": "support.ranks"},
    {"cache": "cache"},
)
# Rooms below that a room does not import all the same.
NEVER = {"forms": ("nscd", "ranks"), "nscd": ("DOLFINx", "ranks")}
# Libraries that modules may import beside the standard one, where not all may be.
LIBRARIES = {
    "nscd": ("numpy", "scipy", "numba"),
    "nscd.friction.problem_files": ("numpy", "scipy", "h5py"),
    "support.checks": ("numpy",),
    "support.hdf5_checks": ("h5py",),
    "support.threads": ("numpy", "numba"),
    "support.lazy": (),
    "cache": ("numpy", "numba", "llvmlite"),
}
# Circles that are known; the list may only get shorter.
KNOWN_CIRCLES: frozenset[frozenset[str]] = frozenset()
# The one module that imports by names which only its callers know.
DEFERS = "support.lazy"


class Rules(NamedTuple):
    """A package and what holds for it; the fields are those of the table above."""

    package: str
    floors: Sequence[Mapping[str, str]]
    never: Mapping[str, Sequence[str]] = {}
    libraries: Mapping[str, Sequence[str]] = {}
    known_circles: frozenset[frozenset[str]] = frozenset()
    defers: str = ""


RULES = Rules("xper_fx", FLOORS, NEVER, LIBRARIES, KNOWN_CIRCLES, DEFERS)

# ------------------------------------------------------------------------------------- reading


class Import(NamedTuple):
    """A module that is imported, and the line; `all_of` where any module of a package may be."""

    target: str
    line: int
    all_of: bool = False


class Unreadable(Exception):
    """An import whose target cannot be told from the text."""


def modules_of(root: Path) -> dict[str, Path]:
    """The files of a package by the names of their modules."""
    found = {}
    for file in sorted(root.rglob("*.py")):
        parts = [root.name, *file.relative_to(root).with_suffix("").parts]
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imports_of(name: str, file: Path) -> Iterator[Import]:
    """All imports that stand in a file.

    Args:
        name: of the file's module.
        file: its text.

    Raises:
        Unreadable: `import_module` or `importer` with arguments that are neither text nor a table.
    """
    tree = ast.parse(file.read_text(), str(file))
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node.lineno)
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) + 1 - node.level]
            base = ".".join([*(parents if node.level else ()), *filter(None, [node.module])])
            for alias in node.names:
                yield Import(f"{base}.{alias.name}", node.lineno)
        elif isinstance(node, ast.Call):
            called = node.func.attr if isinstance(node.func, ast.Attribute) else None
            called = node.func.id if isinstance(node.func, ast.Name) else called
            if called in ("import_module", "__import__"):
                yield from _by_name(node)
            elif called == "importer":
                given = node.args[0] if node.args else None
                base = (isinstance(given, ast.Constant) and given.value) or package
                for module in _table(node, tree):
                    yield Import(f"{base}.{module}", node.lineno)


def _by_name(call: ast.Call) -> Iterator[Import]:
    """The modules, or the package of the modules, that `import_module` is called with."""
    given = call.args[0] if call.args else None
    for text in (given.body, given.orelse) if isinstance(given, ast.IfExp) else (given,):
        if isinstance(text, ast.Constant) and isinstance(text.value, str):
            yield Import(text.value, call.lineno)
            continue
        first = text.values[0] if isinstance(text, ast.JoinedStr) and text.values else None
        start = first.value if isinstance(first, ast.Constant) else ""
        if not isinstance(start, str) or "." not in start:
            raise Unreadable(f"line {call.lineno}: import_module takes text that names a package")
        yield Import(start.rpartition(".")[0], call.lineno, all_of=True)


def _table(call: ast.Call, tree: ast.Module) -> set[str]:
    """The modules of a table of names that `importer` is called with."""
    table = call.args[1] if len(call.args) > 1 else None
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else None
        if isinstance(target, ast.Name) and isinstance(table, ast.Name) and target.id == table.id:
            table = node.value
    values = table.values if isinstance(table, ast.Dict) else [None]
    if not all(isinstance(value, ast.Constant) for value in values):
        raise Unreadable(f"line {call.lineno}: importer takes a table of texts of this file")
    return {str(value.value) for value in values if isinstance(value, ast.Constant)}


# ------------------------------------------------------------------------------------- judging


def _longest(name: str, known: Mapping[str, object]) -> str | None:
    """The longest beginning of a dotted name that is known."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name or None


def circles(graph: Mapping[str, set[str]]) -> list[frozenset[str]]:
    """Sets of nodes that reach each other along the edges, of two nodes or more (Tarjan 1972)."""
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(node: str) -> None:
        number[node] = lowest[node] = len(number)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in number:
                visit(other)
            if other in stack:
                lowest[node] = min(lowest[node], lowest[other])
        if lowest[node] == number[node]:
            at = stack.index(node)
            if len(stack) > at + 1:
                found.append(frozenset(stack[at:]))
            del stack[at:]

    for node in graph:
        if node not in number:
            visit(node)
    return found


def violations(root: Path, rules: Rules = RULES) -> list[str]:
    """What a package does that its rules forbid, a line each; nothing if all is well.

    Args:
        root: folder of the package.
        rules: the table.
    """
    files, said = modules_of(root), []
    heights, room_of = {}, {}
    for height, floor in enumerate(rules.floors):
        for room, modules in floor.items():
            heights[room] = height
            for module in modules.split() or [""]:
                room_of[f"{rules.package}.{module}".rstrip(".")] = room
    said += [f"the table names {m}, which does not exist" for m in room_of if m not in files]
    libraries = {f"{rules.package}.{module}": names for module, names in rules.libraries.items()}
    graph: dict[str, set[str]] = {name: set() for name in files}
    for name, file in files.items():
        room = room_of.get(_longest(name, room_of) or "")
        if room is None or (room_of[rules.package] == room and name != rules.package):
            said.append(f"{name} has no room: name it in {Path(__file__).name}")
            continue
        allowed = libraries.get(_longest(name, libraries) or "")
        try:
            imports = list(imports_of(name, file))
        except Unreadable as error:
            if name != f"{rules.package}.{rules.defers}":
                said.append(f"{name}, {error}")
            continue
        for target, line, all_of in imports:
            where = f"{name}, line {line}"
            if target.partition(".")[0] != rules.package:
                library = target.partition(".")[0]
                known = library in sys.stdlib_module_names or allowed is None or library in allowed
                if not known:
                    said.append(f"{where}: {library} is not for this module")
                continue
            module = _longest(target, files) or rules.package
            ends = {module}
            if all_of:
                ends |= {m for m in files if m.rpartition(".")[0] == module}
            graph[name] |= ends - {name}
            other = room_of.get(_longest(module, room_of) or "", room)
            if other == room:
                continue
            if heights[other] <= heights[room] or other in rules.never.get(room, ()):
                said.append(f"{where}: {room} does not import {module} of {other}")
    found = frozenset(circles(graph))
    for circle in sorted(found - rules.known_circles, key=sorted):
        said.append(f"a circle: {', '.join(sorted(circle))}")
    for circle in sorted(rules.known_circles - found, key=sorted):
        said.append(f"no circle any more, strike it out: {', '.join(sorted(circle))}")
    return said


def main() -> int:
    """Print what is wrong; the exit status says whether anything is."""
    said = violations(Path(__file__).resolve().parents[1] / RULES.package)
    print("\n".join(said) or "imports run one way")
    return bool(said)


if __name__ == "__main__":
    sys.exit(main())
