# SPDX-License-Identifier: LGPL-3.0-or-later
"""The interaction layer runs where only NumPy, SciPy and Numba are."""

from __future__ import annotations

import ast
import pkgutil
import subprocess
import sys
from pathlib import Path

import xper_fx.nscd

_OF_SUPPORT = ("lazy", "checks", "hdf5_checks", "saved_rows", "threads")
BELOW = [f"xper_fx.support.{name}" for name in _OF_SUPPORT]
FOLDER = Path(xper_fx.nscd.__file__).parent


def test_imports_nothing_of_the_bulk():
    names = [m.name for m in pkgutil.walk_packages(xper_fx.nscd.__path__, prefix="xper_fx.nscd.")]
    assert "xper_fx.nscd.solvers.nlgs" in names and "xper_fx.nscd.laws.cohesive_zone" in names
    code = (
        "import sys, importlib\n"
        f"for name in {names!r}: importlib.import_module(name)\n"
        "print(*sorted({name.partition('.')[0] for name in sys.modules}))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert {"xper_fx", "numpy", "numba"} <= loaded
    assert not loaded & {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py", "h5py", "meshio"}


def test_names_numpy_scipy_and_numba_only():
    """In the text, where imports inside functions show too; files of problems may be HDF5.

    So have the modules of `xper_fx.support` that it imports (`tests/import_rules.py`).
    """
    common = set(sys.stdlib_module_names) | {"numpy", "scipy", "numba"}
    files = sorted(FOLDER.rglob("*.py"))
    assert len(files) > 10
    for file in files:
        allowed = common | ({"h5py"} if file.name == "problem_files.py" else set())
        tree = ast.parse(file.read_text())
        for node in tree.body:  # what is imported for its types is not imported
            if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                node.body.clear()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                modules = [node.module or ""]
                assert node.level == 0, f"{file.name}: relative import"
            else:
                continue
            for module in modules:
                below = ("xper_fx.nscd", "xper_fx.cache", *BELOW)
                inside = module in below or module.startswith("xper_fx.nscd.")
                assert inside or module.partition(".")[0] in allowed, f"{file.name}: {module}"
