# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initial velocities: functions of positions or DOLFINx's, for all cells or by cell tag."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
from dolfinx import fem

from xper_fx.bodies.function_values import function_values, is_function, num_components
from xper_fx.support.checks import refuse_expression
from xper_fx.support.ranks import Ranks

Field = Callable[[np.ndarray], np.ndarray] | fem.Function


def check_initial_velocity(
    given: Field | Mapping[int, Field] | None, cell_tags: Collection[int], dim: int
) -> None:
    """See that an initial velocity is a function, or functions by cell tag.

    Args:
        given: as of a `Scene`.
        cell_tags: those that occur.

    Raises:
        ValueError: a tag that occurs nowhere; a DOLFINx function without `dim` components.
        TypeError: something that is no function; an expression of UFL.
    """
    if isinstance(given, Mapping):
        unknown = set(given) - set(cell_tags)
        if unknown:
            raise ValueError(
                f"initial_velocity names cell tags {sorted(unknown)}, which occur nowhere; "
                f"tags that do: {sorted(cell_tags)}."
            )
    for field_ in given.values() if isinstance(given, Mapping) else (given,):
        if not is_function(field_):
            refuse_expression("initial_velocity", field_, "a function of positions, or of DOLFINx")
        if field_ is not None and not callable(field_):
            raise TypeError(f"initial_velocity should be a function, got {field_!r}.")
        if is_function(field_) and num_components(field_) != dim:
            raise ValueError(
                f"initial_velocity should have {dim} components, of a space such as "
                f'functionspace(mesh, ("Lagrange", 1, ({dim},))); this function has '
                f"{num_components(field_)}."
            )


def velocities_at(field: Field, x: np.ndarray, dim: int, ranks: Ranks) -> np.ndarray:
    """Velocities at positions of this rank; all ranks call it together.

    Args:
        field: an initial velocity.
        x: positions, shape (3, n), m.
        dim: components.
        ranks: those that know all of the mesh.

    Returns:
        Shape (dim, n), m/s.

    Raises:
        ValueError: on all ranks where it gives one something else than finite numbers.
    """
    known = function_values(field, x, ranks).T if is_function(field) else None

    def values() -> np.ndarray:
        given = np.asarray(field(x) if known is None else known)
        if given.shape != (dim, x.shape[1]) or given.dtype.kind not in "biuf":
            raise ValueError(
                f"initial_velocity should give numbers of shape ({dim}, {x.shape[1]}) for as many "
                f"points, got {given.dtype} of shape {given.shape}."
            )
        if not np.all(np.isfinite(given)):
            where = x[:dim, ~np.isfinite(given).all(axis=0)][:, 0]
            raise ValueError(f"initial_velocity is not finite at {where.tolist()}.")
        return given.astype(float)

    return ranks.together(values)
