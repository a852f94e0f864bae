# SPDX-License-Identifier: LGPL-3.0-or-later
"""`import xper_fx as xf`: all public names are there, and cost nothing before they are used."""

import os
import pkgutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import xper_fx as xf

# All packages that say which names are theirs.
ROOMS = [
    module.name
    for module in pkgutil.walk_packages(xf.__path__, "xper_fx.")
    if module.ispkg and hasattr(import_module(module.name), "__all__")
] + ["xper_fx"]


@pytest.mark.parametrize("name", xf.__all__)
def test_every_public_name_is_there(name):
    thing = getattr(xf, name)
    assert name in dir(xf)
    assert name in ("__version__", *xf._NAMESPACES) or thing.__name__ == name


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_shows_what_it_has(room):
    """And no name is that of a module there, which would take its place once it is imported."""
    package = import_module(room)
    for name in package.__all__:
        assert name in dir(package)
        assert getattr(package, name) is not None
    assert "__name__" in dir(package)
    modules = {path.stem for path in Path(package.__file__).parent.iterdir()}
    assert modules.isdisjoint(set(package.__all__) - set(getattr(package, "_NAMESPACES", ())))


def test_a_namespace_of_the_door_is_the_module_of_its_name():
    modules = {path.stem for path in Path(xf.__file__).parent.iterdir()}
    for name in modules & set(xf._NAMESPACES):
        assert xf._NAMESPACES[name] == name


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'xper_fx' has no attribute 'Sccene'"):
        _ = xf.Sccene


def test_importing_the_package_imports_nothing_else():
    script = """
import sys
before = set(sys.modules)
import xper_fx as xf
print(*sorted(name for name in set(sys.modules) - before if not name.startswith("importlib")))
xf.laws.CohesiveZone
print("dolfinx" in sys.modules, "xper_fx.nscd.laws.perfect_bond" in sys.modules)
"""
    out = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    new = out[0].split()
    assert {name for name in new if name.startswith("xper_fx")} == {
        "xper_fx", "xper_fx.support", "xper_fx.support.lazy", "xper_fx.support.version"
    }  # fmt: skip
    assert not {"numpy", "numba", "dolfinx"} & set(new)
    assert out[1] == "False False"


def test_a_run_of_cells_needs_no_sparse_algebra():
    """They take a tenth of a start; and what DOLFINx brings is not searched again for garbage."""
    script = """
import sys
import xper_fx as xf
mesh = xf.crossed_rectangle((0, 0), (5e-5, 5e-5), (1, 1))
import gc
print(gc.isenabled(), gc.get_freeze_count() > 50_000)
scene = xf.Scene(
    xf.explode(mesh), {1: xf.library.ZIRCALOY_4}, default_interaction=xf.library.ZIRCALOY_BOND
)
next(xf.Simulation(scene, 1e-12).steps(1e-11))
print("dolfinx" in sys.modules, "scipy.sparse" in sys.modules)
"""
    out = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},  # to compile takes more modules
    ).stdout.splitlines()  # fmt: skip
    assert out == ["True True", "True False"]


def test_a_program_that_collects_no_garbage_goes_on_so():
    script = """
import gc
gc.disable()
import xper_fx as xf
xf.Scene
print(gc.isenabled(), gc.get_freeze_count())
"""
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["False", "0"]
