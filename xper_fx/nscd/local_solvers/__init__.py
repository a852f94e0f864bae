# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solvers of Signorini's condition with Coulomb friction at one point, interchangeable by name."""

from __future__ import annotations

from functools import cache

from xper_fx.nscd.local_solvers.bipotential import BIPOTENTIAL
from xper_fx.nscd.local_solvers.exact import EXACT
from xper_fx.nscd.local_solvers.explicit_projection import EXPLICIT, explicit_applies
from xper_fx.nscd.local_solvers.generalized_newton import NEWTON
from xper_fx.nscd.local_solvers.graph import GRAPH
from xper_fx.nscd.local_solvers.interface import LocalSolver
from xper_fx.nscd.local_solvers.lcp import faceting_error, lcp_solver

__all__ = [
    "LOCAL_SOLVERS",
    "LocalSolver",
    "explicit_applies",
    "faceting_error",
    "local_solver",
    "requires_diagonal",
]

LOCAL_SOLVERS: dict[int, tuple[str, ...]] = {
    2: ("explicit", "graph", "bipotential", "lcp"),
    3: ("explicit", "bipotential", "newton", "lcp", "exact"),
}

_SOLVERS = {
    2: {"explicit": EXPLICIT[2], "graph": GRAPH, "bipotential": BIPOTENTIAL[2]},
    3: {"explicit": EXPLICIT[3], "bipotential": BIPOTENTIAL[3], "newton": NEWTON, "exact": EXACT},
}


def requires_diagonal(name: str) -> bool:
    """Whether the solver is right for uncoupled directions only; `explicit_applies` checks W."""
    return name == "explicit"


@cache
def local_solver(dim: int, name: str, **options) -> LocalSolver:
    """The local solver of that name.

    Args:
        dim: 2 or 3.
        name: one of `LOCAL_SOLVERS[dim]`.
        options: `facets`, of "lcp" in 3D.

    Raises:
        ValueError: a dimension, name or option that does not exist.
    """
    if dim not in LOCAL_SOLVERS:
        raise ValueError(f"Interactions live in dimension 2 or 3, got {dim}.")
    if name not in LOCAL_SOLVERS[dim]:
        raise ValueError(
            f"No local solver {name!r} in dimension {dim}: choose among "
            f"{', '.join(LOCAL_SOLVERS[dim])}."
        )
    unknown = set(options) - ({"facets"} if name == "lcp" else set())
    if unknown:
        raise ValueError(f"The local solver {name!r} has no option {', '.join(sorted(unknown))}.")
    return lcp_solver(dim, **options) if name == "lcp" else _SOLVERS[dim][name]
