# SPDX-License-Identifier: LGPL-3.0-or-later
"""Packages whose names are imported when they are first asked for (PEP 562)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


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
            return import_module(f"{package}.{whole[name]}")
        if name not in module_of:
            message = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(message, name=name, obj=import_module(package))
        return getattr(import_module(f"{package}.{module_of[name]}"), name)

    return __getattr__
