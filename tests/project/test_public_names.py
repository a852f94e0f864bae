# SPDX-License-Identifier: LGPL-3.0-or-later
"""`import xper_fx as xf`: all public names are there, and cost nothing before they are used."""

import subprocess
import sys
from pathlib import Path

import pytest

import xper_fx as xf


@pytest.mark.parametrize("name", xf.__all__)
def test_every_public_name_is_there(name):
    thing = getattr(xf, name)
    assert name in dir(xf)
    assert name in ("__version__", *xf._NAMESPACES) or thing.__name__ == name


@pytest.mark.parametrize("namespace", [xf.plotting, xf.output], ids=["plotting", "results"])
def test_names_gathered_from_several_modules_are_there(namespace):
    for name in namespace.__all__:
        assert getattr(namespace, name) is not None


def test_no_public_name_is_that_of_a_module():
    """A module that is imported would take its place."""
    modules = {path.stem for path in Path(xf.__file__).parent.iterdir()}
    assert not modules & set(xf._MODULE_OF)
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
