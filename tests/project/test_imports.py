# SPDX-License-Identifier: LGPL-3.0-or-later
"""Imports of the package run one way, and the check of it sees what it should."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from import_rules import FLOORS, KNOWN_CIRCLES, Rules, modules_of, violations

ROOT = Path(__file__).resolve().parents[2] / "xper_fx"

pytestmark = pytest.mark.skipif(not ROOT.exists(), reason="the package is not in its checkout")

# A house of three floors: `solver` beside `plotter`, `laws`, and the ground.
RULES = Rules(
    "house",
    (
        {"plots": "plotter", "solving": "solver"},
        {"laws": "laws"},
        {"ground": "lazy"},
        {"top": ""},
    ),
    never={"solving": ("ground",)},
    libraries={"laws": ("numpy",)},
    defers="lazy",
)
SOUND = {
    "__init__": "",
    "lazy": "from importlib import import_module\ndef importer(p, t): import_module(f'{p}.{t}')\n",
    "laws/__init__": "from house.lazy import importer\nT = {'Bond': 'bond'}\nx = importer('', T)\n",
    "laws/bond": "import math, numpy.linalg\nfrom house.lazy import importer\n",
    "laws/contact": "def f():\n    from house.laws.bond import Bond\n",
    "plotter": "from house.laws import Bond\n",
    "solver": "from importlib import import_module\nimport_module(f'house.laws.{1}')\n",
}


def built(folder: Path, **changed: str) -> Path:
    """The package `house` with some of its files changed; "laws/bond" is `laws_bond`."""
    files = SOUND | {name.replace("_", "/"): text for name, text in changed.items()}
    for name, text in files.items():
        file = folder / "house" / f"{name}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return folder / "house"


def test_imports_of_the_package_run_one_way():
    assert violations(ROOT) == []


def test_the_package_is_read():
    """The check is not empty: most modules import others, and every one is in a room."""
    assert len(modules_of(ROOT)) > 150
    assert len(FLOORS) > 10


def test_lazy_packages_show_checkers_what_they_have():
    """The names that a package imports when asked are those that it imports for their types."""
    lazy = [file for file in ROOT.rglob("__init__.py") if "_MODULE_OF" in file.read_text()]
    assert len(lazy) >= 5
    for file in lazy:
        tree = ast.parse(file.read_text())
        assigned = [node for node in tree.body if isinstance(node, ast.Assign)]
        tables = {ast.unparse(a.targets[0]): a.value for a in assigned}
        # `importer(__name__, ...)`, or the text of another package
        given = tables["__getattr__"].args[0]
        package = ".".join(["xper_fx", *file.parent.relative_to(ROOT).parts])
        package = given.value if isinstance(given, ast.Constant) else package
        modules = {
            name: f"{package}.{module}"
            for name, module in ast.literal_eval(tables["_MODULE_OF"]).items()
        }
        for name, module in ast.literal_eval(tables.get("_NAMESPACES", "{}")).items():
            modules[name] = f"{package}.{module}".rpartition(".")[0]
        shown = {
            alias.asname: node.module
            for block in tree.body
            if isinstance(block, ast.If)
            for node in block.body
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        assert shown == modules, package


def test_known_circles_only_become_fewer():
    assert KNOWN_CIRCLES == frozenset()


def test_a_sound_house(tmp_path):
    assert violations(built(tmp_path), RULES) == []


@pytest.mark.parametrize(
    "text",
    [
        "from house.laws.contact import f",
        "import house.laws.contact",
        "def g():\n    from house.laws import contact",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.laws.contact import f",
        "from .contact import f",
        "from . import contact",
        "from importlib import import_module\nimport_module('house.laws.contact')",
        "import importlib\nimportlib.import_module('house.laws.contact' if 1 else 'math')",
        "from importlib import import_module\nimport_module(f'house.laws.{1}')",
    ],
)
def test_a_new_circle_is_seen(tmp_path, text):
    said = violations(built(tmp_path, laws_bond=text), RULES)
    assert len(said) == 1 and said[0].startswith("a circle: ")
    assert "house.laws.bond" in said[0] and "house.laws.contact" in said[0]


def test_a_circle_through_a_lazy_table_is_seen(tmp_path):
    said = violations(built(tmp_path, laws_bond="from house.laws import Contact"), RULES)
    assert said == ["a circle: house.laws, house.laws.bond"]


def test_a_lazy_table_of_another_package_is_seen(tmp_path):
    text = "from house.lazy import importer\nT = {'Solver': 'solver'}\nx = importer('house', T)"
    said = violations(built(tmp_path, laws_contact=text, solver=""), RULES)
    assert said == ["house.laws.contact, line 3: laws does not import house.solver of solving"]


@pytest.mark.parametrize(
    "text",
    [
        "import house.solver",
        "def f():\n    from house import solver",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.solver import Solver",
        "from importlib import import_module\nimport_module('house.solver')",
        "from ..solver import Solver",
    ],
)
def test_an_import_of_a_floor_above_is_seen(tmp_path, text):
    said = violations(built(tmp_path, laws_contact=text, solver=""), RULES)
    where = f"house.laws.contact, line {len(text.splitlines())}"
    assert said == [f"{where}: laws does not import house.solver of solving"]


def test_rooms_of_one_floor_do_not_import_each_other(tmp_path):
    said = violations(built(tmp_path, plotter="import house.solver"), RULES)
    assert said == ["house.plotter, line 1: plots does not import house.solver of solving"]


def test_what_a_room_never_imports_is_seen(tmp_path):
    said = violations(built(tmp_path, solver="import house.lazy"), RULES)
    assert said == ["house.solver, line 1: solving does not import house.lazy of ground"]


def test_a_library_that_is_not_for_a_room_is_seen(tmp_path):
    text = "import numpy\ndef f():\n    from dolfinx.fem import Function"
    said = violations(built(tmp_path, laws_bond=text), RULES)
    assert said == ["house.laws.bond, line 3: dolfinx is not for this module"]
    assert violations(built(tmp_path, laws_bond="", solver="import dolfinx"), RULES) == []


@pytest.mark.parametrize(
    "text",
    ["import_module(name)", "import_module('house' + name)", "import_module(f'{name}.bond')",
     "importer(__name__, table())"],
)  # fmt: skip
def test_an_import_that_cannot_be_read_is_refused(tmp_path, text):
    (said,) = violations(built(tmp_path, solver=text), RULES)
    assert said.startswith("house.solver, line 1: import")


def test_a_module_without_a_room_is_seen(tmp_path):
    (said,) = violations(built(tmp_path, cellar=""), RULES)
    assert said.startswith("house.cellar has no room")


def test_a_room_without_a_module_is_seen(tmp_path):
    rules = RULES._replace(floors=({"attic": "attic"}, *RULES.floors))
    said = violations(built(tmp_path), rules)
    assert said == ["the table names house.attic, which does not exist"]


def test_a_known_circle_passes_until_it_is_broken(tmp_path):
    circle = frozenset({"house.laws.bond", "house.laws.contact"})
    rules = RULES._replace(known_circles=frozenset({circle}))
    assert violations(built(tmp_path, laws_bond="import house.laws.contact"), rules) == []
    (said,) = violations(built(tmp_path, laws_bond=""), rules)
    assert said.startswith("no circle any more, strike it out: house.laws.bond")
