# SPDX-License-Identifier: LGPL-3.0-or-later
"""The interaction layer runs where only NumPy and Numba are."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

import xper_fx.nscd

FOREIGN = ("dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py", "scipy", "h5py", "meshio")


def test_imports_numpy_and_numba_only():
    names = [
        m.name for m in pkgutil.walk_packages(xper_fx.nscd.__path__, prefix="xper_fx.nscd.")
    ]
    assert "xper_fx.nscd.nlgs" in names and "xper_fx.nscd.laws.cohesive_zone" in names
    code = (
        "import sys, importlib, numba\n"
        "before = set(sys.modules)\n"  # Numba looks for SciPy by itself
        f"for name in {names!r}: importlib.import_module(name)\n"
        "new = {name.partition('.')[0] for name in set(sys.modules) - before}\n"
        f"print(*sorted(new & set({FOREIGN!r})))\n"
        "print(*sorted(n for n in new if n.startswith('xper')))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    foreign, own = done.stdout.split("\n")[:2]
    assert foreign == ""
    assert own == "xper_fx"
