# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of DOLFINx functions at positions."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem, geometry


def is_function(given: Any) -> bool:
    """Whether something is a DOLFINx function, which can be called, but not with positions."""
    return isinstance(given, fem.Function)


def num_components(function: fem.Function) -> int:
    """Components of a function's values."""
    return int(np.prod(function.ufl_shape, dtype=int))


def function_values(function: fem.Function, x: np.ndarray) -> np.ndarray:
    """Values of a function, each in some cell that has the position.

    Args:
        function: of this rank's part of its mesh.
        x: positions, shape (3, n), m.

    Returns:
        Shape (n, number of components); NaN outside of the mesh.
    """
    mesh, positions = function.function_space.mesh, np.ascontiguousarray(x.T)
    tree = geometry.bb_tree(mesh, mesh.topology.dim)
    candidates = geometry.compute_collisions_points(tree, positions)
    cells = geometry.compute_colliding_cells(mesh, candidates, positions)
    offsets, all_cells = cells.offsets, cells.array
    values = np.full((len(positions), num_components(function)), np.nan)
    inside = np.flatnonzero(np.diff(offsets) > 0)
    if len(inside):
        found = function.eval(positions[inside], all_cells[offsets[inside]])
        values[inside] = np.reshape(found, (len(inside), -1))
    return values
