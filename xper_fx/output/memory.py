# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a simulation holds in memory, part by part, counted from its arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx.fem import Function
from dolfinx.mesh import Mesh, MeshTags

from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_kind
from xper_fx.support.compat import geometry_dofmap

# What arrays are looked for in, beside containers.
_PACKAGES = ("xper_fx.", "scipy.sparse")


def memory_by_part(simulation: Simulation) -> dict[str, int]:
    """Bytes of the arrays that each part of a simulation holds, each array counted once.

    Args:
        simulation: at rest or under way.

    Returns:
        By part: "bodies" (mesh, tags, facing facets), "bulk" (masses, stiffness, forms),
        "inverse" (w), "interactions" (points with their history), "solver" (what the solver keeps
        from step to step), "state" (the last two states and the last step).

    Raises:
        TypeError: no simulation.
    """
    require_kind("simulation", simulation, Simulation)
    held = simulation.interactions
    parts = {
        "bodies": simulation.scene,
        "bulk": simulation.bulk,
        "inverse": simulation.scheme,
        "interactions": held,
        "solver": simulation.solver.kept(),
        "state": (simulation.state, simulation.last, simulation._before),
    }
    seen: dict[int, Any] = {}
    return {name: _bytes(part, seen) for name, part in parts.items()}


def _bytes(item: object, seen: dict[int, Any]) -> int:
    """Bytes of the arrays in an object that were not seen yet; `seen` holds what was, by id."""
    if isinstance(item, np.ndarray):
        while isinstance(item.base, np.ndarray):
            item = item.base
    if id(item) in seen or item is None or isinstance(item, type):
        return 0
    seen[id(item)] = item
    if isinstance(item, np.ndarray):
        return item.nbytes
    if isinstance(item, Mesh):
        return item.geometry.x.nbytes + geometry_dofmap(item).nbytes
    if isinstance(item, MeshTags):
        return item.indices.nbytes + item.values.nbytes
    if isinstance(item, Function):
        return item.x.array.nbytes
    if isinstance(item, dict):
        return sum(_bytes(value, seen) for value in item.values())
    if isinstance(item, list | tuple):
        return sum(_bytes(value, seen) for value in item)
    if type(item).__module__.startswith(_PACKAGES) and hasattr(item, "__dict__"):
        return _bytes(vars(item), seen)
    return 0
