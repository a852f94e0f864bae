# SPDX-License-Identifier: LGPL-3.0-or-later
"""Packages whose names are imported when they are first asked for (PEP 562)."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any


def _imported(module: str) -> ModuleType:
    """A module; what it brings with DOLFINx is set aside from the search for reference cycles.

    DOLFINx and Numba make some 90 000 objects that stay. To search them while they are imported,
    and three times when the process ends, takes an eighth of a start with kept kernels.
    """
    if "dolfinx" in sys.modules or not gc.isenabled():
        return import_module(module)
    gc.disable()
    try:
        return import_module(module)
    finally:
        gc.enable()
        if "dolfinx" in sys.modules:
            gc.freeze()


def importer(
    package: str, module_of: Mapping[str, str], namespaces: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """A `__getattr__` for a package, so that a scene imports the laws and materials it has alone.

    The package's `dir` shows the names from now on.

    Args:
        package: `__name__` of the package.
        module_of: the module, within the package, of each name that it exports.
        namespaces: modules, within the package, that it exports whole, by the name they get.
    """
    whole, held = namespaces or {}, vars(import_module(package))
    held["__dir__"] = lambda: sorted({*held, *module_of, *whole})

    def __getattr__(name: str) -> Any:
        if name in whole:
            return _imported(f"{package}.{whole[name]}")
        if name not in module_of:
            message = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(message, name=name, obj=import_module(package))
        return getattr(_imported(f"{package}.{module_of[name]}"), name)

    return __getattr__
