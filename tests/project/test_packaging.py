# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lists of packages, versions of tools and what a release holds: the files that say them agree."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(
    not (ROOT / "fenicsx").exists(), reason="the package is not run from its checkout"
)

# What gives on conda-forge what a package of Debian's gives; None: another of the list brings it.
CONDA = {
    "python3-dolfinx": "fenics-dolfinx",
    "python3-dolfinx-real": None,
    "python3-ufl": None,
    "python3-basix": None,
    "python3-petsc4py": "petsc4py",
    "python3-petsc4py-real": None,
    "libtbb12": "tbb",
    "libopenblas0-pthread": None,
    "python3-gmsh": "python-gmsh",
    "python3-matplotlib": "matplotlib-base",
    "gcc": "c-compiler",
    "libc6-dev": None,
    "python3-dev": "python",
    "openmpi-bin": None,
}
# What pip needs, and conda has under another name.
RENAMED = {"gmsh": "python-gmsh", "matplotlib": "matplotlib-base", "numpy": None}


def launcher_list(name: str) -> list[str]:
    """A list of packages as the shell reads it from the launcher."""
    text = (ROOT / "fenicsx").read_text()
    array = re.search(rf"^{name}=\(.*?\)$", text, re.MULTILINE | re.DOTALL).group()
    script = f"{array}\nprintf '%s\\n' \"${{{name}[@]}}\""
    return subprocess.check_output(["bash", "-c", script], text=True).split()


def conda_list() -> dict[str, str]:
    """Packages of environment.yml with what is asked of their versions."""
    lines = re.findall(r"^  - ([\w-]+)([^#\n]*)", (ROOT / "environment.yml").read_text(), re.M)
    channels = {"conda-forge", "nodefaults"}
    return {name: version.strip() for name, version in lines if name not in channels}


def project() -> dict:
    """The project's table of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_conda_has_what_the_launcher_has():
    packages = launcher_list("packages") + launcher_list("docs_packages")
    expected = {CONDA.get(name, name.removeprefix("python3-")) for name in packages} - {None}
    assert len(packages) > 20
    assert set(conda_list()) == expected | {"pip"}


def test_conda_has_what_pip_asks_for():
    extras = project()["optional-dependencies"]
    asked = [*project()["dependencies"], *(line for lines in extras.values() for line in lines)]
    names = [re.match(r"[\w-]+", line).group() for line in asked]
    assert {RENAMED.get(name, name) for name in names} - {None} <= set(conda_list())
    assert conda_list()["python"] == project()["requires-python"]


def test_the_launcher_has_what_pip_asks_for():
    have = {name.removeprefix("python3-") for name in launcher_list("packages")}
    have |= {name.removeprefix("python3-") for name in launcher_list("docs_packages")}
    extras = project()["optional-dependencies"]
    asked = [*project()["dependencies"], *(line for lines in extras.values() for line in lines)]
    names = {re.match(r"[\w-]+", line).group() for line in asked} - {"numpy", "fenics-dolfinx"}
    assert names <= have


def test_the_container_takes_the_launcher_s_list():
    """No list of its own that could drift: it runs the launcher, and names no package."""
    text = (ROOT / "Dockerfile").read_text()
    steps = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    assert "FROM debian:13" in steps
    assert re.search(r"RUN .*/opt/xper_fx/fenicsx ", steps)
    assert steps.index("COPY fenicsx") < steps.index("RUN") < steps.index("COPY . ")
    assert "apt-get install" not in steps and "python3-" not in steps
    assert steps.index("USER xper_fx") < steps.index("CMD")


# ------------------------------------------------------------------------------ tools and releases


def pins() -> dict[str, str]:
    """The tools of CI with their versions."""
    lines = (ROOT / ".ci" / "requirements.txt").read_text().splitlines()
    found = [re.fullmatch(r"([\w-]+)==([\d.]+)", line) for line in lines if line[0] != "#"]
    assert all(found), "every tool has one version, name==version"
    return {match[1]: match[2] for match in found if match}


def test_tools_have_one_version():
    """Hooks of pre-commit run `.ci/check`, which installs what requirements.txt names."""
    assert {"ruff", "mypy"} <= set(pins())
    hooks = (ROOT / ".pre-commit-config.yaml").read_text()
    assert "rev:" not in hooks and "additional_dependencies" not in hooks
    assert re.findall(r"- repo: (.*)", hooks) == ["local"]
    entries = re.findall(r"entry: (.*)", hooks)
    assert {entry.split()[0] for entry in entries} == {".ci/check"}
    assert {entry.split()[1] for entry in entries} == {"style", "imports", "types"}
    check = (ROOT / ".ci" / "check").read_text()
    assert "requirements.txt" in check
    assert not re.search(r"(ruff|mypy)[=<>]", check)


def test_continuous_integration_checks_before_it_tests():
    """Style, imports and types come before the tests, and sid's after them."""
    steps = re.findall(r'^(?:.*\|\| )?step "[^"]*" (.*)', (ROOT / ".ci" / "run").read_text(), re.M)
    assert steps == [
        "./fenicsx true", ".ci/check style", ".ci/check imports", ".ci/check types",
        './fenicsx pytest "$@"', "newest_userland", "newest_fast_tests",
    ]  # fmt: skip


def test_types_are_shipped():
    """PEP 561: type checkers read the annotations of a package that has a file `py.typed`."""
    assert (ROOT / "xper_fx" / "py.typed").read_text() == ""
    tool = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    assert tool["setuptools"]["package-data"] == {"xper_fx": ["py.typed"]}


def test_the_version_stands_in_one_place():
    version = re.search(
        r'^__version__ = "(\d+\.\d+\.\d+)"$',
        (ROOT / "xper_fx" / "support" / "version.py").read_text(),
        re.M,
    )
    assert version
    assert project()["dynamic"] == ["version"]
    latest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert latest and latest[1] == version[1]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert cited is None or cited[1] == version[1]


def test_what_contributing_names_exists():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    named = re.findall(r"[\s`]((?:\.ci|docs|tests|xper_fx)/[\w./]*)", text)
    assert len(named) > 20
    missing = sorted({name for name in named if not (ROOT / name).exists()})
    assert [name for name in missing if name != "docs/_build"] == []
    figures = (ROOT / "docs" / "gallery.py").read_text()
    for name in re.findall(r"docs/gallery.py (\w+)$", text, re.M):
        assert f'"{name}"' in figures
