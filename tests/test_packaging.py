# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lists of packages that say the same: the launcher's, conda's, pip's, and the container's."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

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
