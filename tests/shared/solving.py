# SPDX-License-Identifier: LGPL-3.0-or-later
"""A solver called once, with its options by name."""

from xper_fx.nscd.solvers import NonlinearGaussSeidel, SolveOptions


def solve(interactions, velocity, solver=NonlinearGaussSeidel, **options):
    """The report of a solver of that class that has no memory yet."""
    return solver().solve(interactions, velocity, SolveOptions(**options))
